// Measured cost and accuracy of a configuration.
#pragma once

#include "base/types.h"
#include "studies/trade/configuration.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// Mean over runs with the half-width of its 95 % confidence interval (Student's t). The half-width of a single run is
/// infinite.
struct Estimate {
  double mean = kNaN, half_width = 0;

  /// Returns the estimate for `values`. Values that are not finite make the mean infinite.
  static Estimate of(const std::vector<double>& values);
};

/// Measurements of one configuration; NaN if not measured.
struct Outcome {
  Configuration configuration;
  std::size_t runs = 0;
  std::string refused;  ///< why it cannot be run, or why a run ended early; empty otherwise

  // Accuracy, over phase run of the last repetition and over runs that differ in the hand's noise.
  Estimate error;        ///< 3-D rms distance to the original path at the same instant [m]
  Estimate peak;         ///< largest such distance [m]
  Estimate rms_error;    ///< rms_error_m of play: distance to the reference that was followed [m]
  Estimate peak_error;   ///< peak_error_m of play [m]
  Estimate force;        ///< rms difference of the sent force, averaged over 20 ms, to the finest configuration's [N]
  Estimate ripple;       ///< force_ripple_n of play: sent force above 25 Hz, rms [N]
  Estimate max_force;    ///< [N]
  double margin = kNaN;  ///< factor by which the gains may be raised before the loop oscillates, up to 4

  // Cost.
  double tick = kNaN;          ///< median time of a tick on this machine, with the device's exchange [s]
  double control = kNaN;       ///< the same on a device without computing cost [s]
  double instructions = kNaN;  ///< instructions of that tick
  /// Cost of that tick, summed over its parts [instructions, or ns if they cannot be counted].
  double price = kNaN;
  double start = kNaN;           ///< time from a path in memory to the first tick [s]
  double duration = 0;           ///< duration of a session with its repetitions [s]
  double bytes_per_hour = kNaN;  ///< size of an hour of its recording [bytes]

  [[nodiscard]] bool ran() const noexcept { return refused.empty() && runs > 0; }
  [[nodiscard]] bool counted() const noexcept { return std::isfinite(instructions); }
  /// Returns its price per second [1/s], or its share of a second if instructions were not counted [1e-9].
  [[nodiscard]] double load() const noexcept { return configuration.rate_hz * price; }
};

/// Quantities that a budget can bound.
enum class Measure { error, peak, force, ripple, margin, tick, instructions, load, start, bytes };

/// Name, unit and sense of a measure.
struct MeasureFacts {
  Measure measure;
  const char* name;  ///< name in a budget
  const char* unit;  ///< display unit
  double scale;      ///< one display unit in SI
  bool at_most;      ///< smaller is better
  bool accuracy;     ///< accuracy measure; else a cost
  const char* what;
};

const std::vector<MeasureFacts>& measures();
const MeasureFacts& facts_of(Measure measure);

/// Returns a conservative estimate of the measure in use: the mean, for errors plus its half-width.
double value_of(const Outcome& outcome, Measure measure);
double mean_of(const Outcome& outcome, Measure measure);

/// Returns a text like "0.052 mm".
std::string text_of(Measure measure, double value);
/// Returns the load: "5.3 MIPS", or "0.13 % of the time" if instructions were not counted.
std::string text_of_load(const Outcome& outcome);

nlohmann::json to_json(const Outcome& outcome);

}  // namespace haptrace
