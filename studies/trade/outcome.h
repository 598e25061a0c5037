// What a configuration costs and what it gives.
#pragma once

#include "base/types.h"
#include "studies/trade/configuration.h"

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// A mean over runs, and half of its 95 % interval (Student's t): infinite for one run, which says nothing of others.
struct Estimate {
  double mean = kNaN, half_width = 0;

  /// Values that are not finite make the mean infinite.
  static Estimate of(const std::vector<double>& values);
};

/// One configuration, measured. What was not measured is NaN.
struct Outcome {
  Configuration configuration;
  std::size_t runs = 0;
  std::string refused;  ///< why it cannot be run, or why a run ended early; empty otherwise

  // What it gives, over phase run of the last repetition, and over runs that differ in the hand's noise.
  Estimate error;        ///< rms distance from where the path as it was given is at that instant, 3-D [m]
  Estimate peak;         ///< the largest of it [m]
  Estimate rms_error;    ///< rms_error_m of play: against the reference that was followed [m]
  Estimate peak_error;   ///< peak_error_m of play [m]
  Estimate force;        ///< rms difference of the sent force to that of the finest configuration, over 20 ms [N]
  Estimate ripple;       ///< force_ripple_n of play: sent force above 25 Hz, rms [N]
  Estimate max_force;    ///< [N]
  double margin = kNaN;  ///< times the gains may be raised before the loop oscillates, up to 4

  // What it costs.
  double tick = kNaN;          ///< median of a tick on this machine, with the device's exchange [s]
  double control = kNaN;       ///< the same on a device that costs nothing [s]
  double instructions = kNaN;  ///< of that tick
  /// Of that tick, summed from what each part of it costs: instructions, or where they cannot be counted nanoseconds.
  double price = kNaN;
  double start = kNaN;           ///< from a path in memory to the first tick [s]
  double duration = 0;           ///< of a session, with its repetitions [s]
  double bytes_per_hour = kNaN;  ///< of a recording of it

  [[nodiscard]] bool ran() const noexcept { return refused.empty() && runs > 0; }
  /// Its price a second.
  [[nodiscard]] double load() const noexcept { return configuration.rate_hz * price; }
};

/// What a budget can bound.
enum class Measure { error, peak, force, ripple, margin, tick, instructions, load, start, bytes };

/// How a measure is told, and what it is of an outcome.
struct MeasureFacts {
  Measure measure;
  const char* name;  ///< in a budget
  const char* unit;  ///< in which people are told
  double scale;      ///< of that unit, in SI
  bool at_most;      ///< smaller is better
  bool accuracy;     ///< what a configuration gives; else what it costs
  const char* what;
};

const std::vector<MeasureFacts>& measures();
const MeasureFacts& facts_of(Measure measure);

/// What the outcome is expected to show in use, on the safe side: the mean, or for errors the mean and its half width.
double value_of(const Outcome& outcome, Measure measure);
double mean_of(const Outcome& outcome, Measure measure);

/// "0.052 mm"
std::string text_of(Measure measure, double value);

nlohmann::json to_json(const Outcome& outcome);

}  // namespace haptrace
