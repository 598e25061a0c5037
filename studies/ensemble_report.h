// Report of an ensemble: distributions, counts and ratios, as JSON, plot and text.
#pragma once

#include "studies/ensemble.h"

namespace haptrace {

/// Distribution of values in any order. Quantiles are linear interpolations between order statistics (Hyndman and Fan
/// 1996, type 7). Values that are not finite are left out; without values, all members are NaN.
struct Distribution {
  std::size_t count = 0;
  double median = kNaN, p5 = kNaN, p95 = kNaN, max = kNaN, min = kNaN;

  static Distribution of(std::vector<double> values);
};

nlohmann::json to_json(const Distribution& distribution);

/// Indices of draws that share a property.
using Draws = std::vector<std::uint64_t>;

/// One controller on one path, over the counted draws, whose path needs no more force than the device has. Draws that
/// stopped do not enter the distributions.
struct ControllerSummary {
  Distribution rms_error, peak_error, measured_rms_error, measured_peak_error, force_ripple, ripple;
  Draws stopped;       ///< draws that a limit stopped
  Draws limit_cycles;  ///< see EnsembleRun::limit_cycle
  Draws oscillations;  ///< draws in which the oscillation monitor reported
  Draws saturated;     ///< see EnsembleRun::overpowered; finished draws only
  Draws shaking;       ///< see EnsembleRun::shakes
};

struct PathSummary {
  std::string name;
  std::size_t counted = 0;
  Draws beyond_force;  ///< not counted, see EnsembleMember::beyond_force
  std::array<ControllerSummary, kEnsembleControllers.size()> controllers;
  Distribution stiff_over_calibrated, cautious_over_calibrated;  ///< ratios of true rms errors, draw by draw
  Distribution ripple_over_stiff;                                ///< ratio of force ripples, calibrated over stiff
};

struct HoldSummary {
  Distribution ripple, hunting;
  Draws stopped, limit_cycles, oscillations;
};

struct OverdriveSummary {
  Draws oscillating;
  Draws late;    ///< oscillating draws that were detected after kCatchWithin, or never
  Draws uncalm;  ///< oscillating draws that still oscillated at the end and were not stopped
  Draws stopped;
  Distribution delay;  ///< detection delay of the oscillating draws [s]
};

/// The draws of one kind.
struct KindSummary {
  EnsembleKind kind = EnsembleKind::small;
  std::size_t draws = 0;
  std::vector<PathSummary> paths;
};

struct EnsembleSummary {
  Draws not_calibrated;
  std::vector<PathSummary> paths;
  std::array<HoldSummary, kEnsembleControllers.size()> holds;
  OverdriveSummary overdrive;
  std::vector<KindSummary> kinds;  ///< in the order of EnsembleKind, those that were drawn
};

EnsembleSummary summarise(const EnsembleReport& report);

/// Returns the summary, the counts and their criteria in SI units. Draws are identified by index.
nlohmann::json to_json(const EnsembleReport& report);

/// Returns a plot of cumulative distributions over the draws: true rms error, force ripple and true ripple of each path
/// and controller, and ripple and hunting of the hold.
Figure figure_of(const EnsembleReport& report);

/// Returns a short text summary.
std::string text_of(const EnsembleReport& report);

}  // namespace haptrace
