// Options for the path of a session: the part of a recording, its place and its repetitions.
#pragma once

#include "cli/verb.h"
#include "formats/path/path_source.h"

#include <optional>

namespace haptrace::cli {

/// The options of every verb that moves along a path, in the groups Path and Safety.
struct PathArguments {
  PathSelection selection;
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

  /// Returns the number of repetitions; 0: until stopped. Throws Error(input) if --repeat is out of range.
  [[nodiscard]] int repetitions() const;
};

}  // namespace haptrace::cli
