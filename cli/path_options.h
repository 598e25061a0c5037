// The path of a session: which part of a recording, where, how often.
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

  /// `deviation_limit` [m] without --max-deviation.
  explicit PathArguments(double deviation_limit) : max_deviation(deviation_limit) {}

  void add_to(CLI::App& app);

  /// 0: until stopped. Throws Error(input) when --repeat is out of its range.
  [[nodiscard]] int repetitions() const;
};

}  // namespace haptrace::cli
