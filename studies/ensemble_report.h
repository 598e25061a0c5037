// What an ensemble amounts to: distributions, counts, ratios; as JSON, as a figure, in words.
#pragma once

#include "studies/ensemble.h"

namespace haptrace {

/// Of a sample of any order; quantiles by linear interpolation between order statistics (Hyndman and Fan 1996, type 7).
/// Values that are not finite are left out. All NaN when there are none.
struct Distribution {
  std::size_t count = 0;
  double median = kNaN, p5 = kNaN, p95 = kNaN, max = kNaN;

  static Distribution of(std::vector<double> values);
};

nlohmann::json to_json(const Distribution& distribution);

/// The draws, by index, of which something is true.
using Draws = std::vector<std::uint64_t>;

/// One controller on one path, over the draws that count: not beyond the device's force. Figures are of those that it
/// did not stop in.
struct ControllerSummary {
  Distribution rms_error, peak_error, measured_rms_error, measured_peak_error, force_ripple, ripple;
  Draws stopped;       ///< by a limit
  Draws limit_cycles;  ///< see EnsembleRun::limit_cycle
  Draws oscillations;  ///< in which the oscillation monitor spoke
  Draws saturated;     ///< see EnsembleRun::overpowered, and the others were not
};

struct PathSummary {
  std::string name;
  std::size_t counted = 0;
  Draws beyond_force;  ///< not counted: see EnsembleMember::beyond_force
  std::array<ControllerSummary, kEnsembleControllers.size()> controllers;
  Distribution stiff_over_calibrated, cautious_over_calibrated;  ///< ratios of true rms errors, draw by draw
};

struct HoldSummary {
  Distribution ripple, hunting;
  Draws stopped, limit_cycles, oscillations;
};

struct OverdriveSummary {
  Draws oscillating;
  Draws late;    ///< of them: noticed after kCatchWithin, or never
  Draws uncalm;  ///< of them: still oscillating in the end, and not stopped either
  Draws stopped;
  Distribution delay;  ///< of those that were noticed [s]
};

struct EnsembleSummary {
  Draws not_calibrated;
  std::vector<PathSummary> paths;
  std::array<HoldSummary, kEnsembleControllers.size()> holds;
  OverdriveSummary overdrive;
};

EnsembleSummary summarise(const EnsembleReport& report);

/// SI. Holds the criteria beside what was counted by them, and the summary; draws are named by their index.
nlohmann::json to_json(const EnsembleReport& report);

/// Cumulative distributions over the draws: true rms error of each path and controller, force ripple, true ripple, and
/// the hold's.
Figure figure_of(const EnsembleReport& report);

/// A few lines for people.
std::string text_of(const EnsembleReport& report);

}  // namespace haptrace
