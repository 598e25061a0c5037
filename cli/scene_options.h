// Options for the scene that the hand touches in a session.
#pragma once

#include "cli/verb.h"
#include "devices/device.h"
#include "player/session.h"

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace haptrace::cli {

/// The options of every verb whose session can have a scene, in the group Scene.
struct TouchArguments {
  std::string file, prediction;
  double rate = 0;  ///< [Hz]; 0: in the servo loop

  void add_to(CLI::App& app);

  /// Reads the scene into the options, shows on a terminal that it does, and returns notes for the user. Throws
  /// Error(input) that names the option, or the file and the place in it.
  [[nodiscard]] std::vector<std::string> apply(SessionOptions& session, const Output& output) const;
};

/// Returns a note on the objects of the session's scene that the device cannot reach, if there are any.
std::vector<std::string> notes_on_reach(const SessionOptions& session, const DeviceInfo& info);

}  // namespace haptrace::cli
