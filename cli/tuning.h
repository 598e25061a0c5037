// How a session is tuned from outside while it runs: the options, and what they open.
#pragma once

#include "player/live_tuning.h"
#include "player/tuning_file.h"
#include "player/tuning_server.h"

#include <CLI/CLI.hpp>
#include <cstdint>
#include <optional>
#include <string>

namespace haptrace::cli {

struct TuningArguments {
  std::string port, file;
  bool expert = false;

  void add_to(CLI::App& app);
};

/// The socket and the file that were asked for, from construction to the end of the object.
class TuningInputs {
 public:
  /// Throws Error(input) naming the option. `tuning` is borrowed.
  TuningInputs(const TuningArguments& arguments, LiveTuning& tuning);

  /// Of the socket, if there is one.
  [[nodiscard]] std::optional<std::uint16_t> port() const noexcept;

 private:
  std::optional<TuningServer> server_;
  std::optional<TuningFile> file_;
};

}  // namespace haptrace::cli
