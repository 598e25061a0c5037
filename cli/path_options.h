// Options for a path: the part of a recording, its place and its repetitions.
#pragma once

#include "cli/verb.h"
#include "control/path/path_change.h"
#include "formats/path/path_source.h"

#include <optional>

namespace haptrace {
class Device;
}

namespace haptrace::cli {

/// The options that move, turn, scale or mirror a path. docs/play.md states their order.
struct ChangeArguments {
  std::string mirror, rotate, about, offset, frame;
  std::optional<double> scale;

  void add_to(CLI::App& app, const std::string& group);
  /// Adds --frame, for verbs that read files. `meaning` is its description.
  void add_frame_to(CLI::App& app, const std::string& group, const std::string& meaning);

  /// Returns the change. Throws Error(input) naming the option.
  [[nodiscard]] PathChange change() const;

  /// Sets the keys of a programme that state the same as the given options. Throws like change().
  void set_keys(nlohmann::json& keys) const;
};

/// The options of every verb that moves along a path, in the groups Path and Safety.
struct PathArguments {
  PathSelection selection;
  ChangeArguments place;
  bool start_here = false;
  bool fit = false;
  std::optional<double> smoothing;
  int repeat = 1;
  bool loop = false;
  double hold = 0.5;            ///< [s]
  double approach_speed = 0.1;  ///< [m/s]
  double max_deviation;         ///< [m]

  /// `deviation_limit` [m] is the default of --max-deviation.
  explicit PathArguments(double deviation_limit) : max_deviation(deviation_limit) {}

  void add_to(CLI::App& app);

  /// Returns the change of the path. For --start-here, reads the position of `device`, with zero force. Throws
  /// Error(input) naming the option; Error(fault) if the device does not answer.
  [[nodiscard]] PathChange change(Device& device) const;

  /// Returns the number of repetitions; 0: until stopped. Throws Error(input) if --repeat is out of range.
  [[nodiscard]] int repetitions() const;

  /// Sets the repetitions in PlaybackOptions or GuidanceOptions. Throws like repetitions().
  template <class Options>
  void apply_to(Options& options) const {
    options.repetitions = repetitions();
    options.hold = hold;
    options.approach_speed = approach_speed;
    options.max_deviation = max_deviation;
  }
};

/// Stores in the metadata of the recording, if there is one, what was applied to its path. Stores no empty text.
void keep_applied(SessionOptions& options, const char* key, const std::string& text);

}  // namespace haptrace::cli
