// What a movement was like: how long, how far, how fast, how smooth, and what the device did to it.
#pragma once

#include "control/design/plant_model.h"
#include "metrics/smoothness.h"

#include <optional>
#include <span>

namespace haptrace {

/// One trial as it was sampled. Columns have the length of `time`, or are empty. NaN is "not measured".
struct Trial {
  std::span<const double> time;         ///< [s], strictly increasing, need not be even
  std::span<const Vec3> position;       ///< p_WT [m]
  std::span<const Vec3> force = {};     ///< of the device on the hand [N]
  std::span<const Vec3> measured = {};  ///< of the device on the hand, by a sensor [N]
};

struct MovementOptions {
  /// Of the zero-phase low pass: where its gain is 1 / sqrt(2) [Hz].
  double cutoff_hz = 10;
  /// A movement begins where the speed first reaches this share of its peak, and ends where it last falls below.
  double threshold = 0.05;
  /// A peak of the speed rises above what lies beside it by this share of the largest, and by `least_speed`.
  double prominence = 0.05;
  /// What nowhere is as fast as this is no movement [m/s]. One count of 0.05 mm, low-passed, is 1 mm/s.
  double least_speed = 2e-3;
  /// Times without a sample up to this are bridged by straight lines [s], whose corners count as jerk.
  double max_gap = 0.1;
  std::optional<double> reference_length;  ///< of the path that was to be followed [m]
  std::optional<PlantModel> plant;         ///< for the estimate of the person's work
  SparcOptions sparc;
};

/// What a force did during a movement.
struct ForceFigures {
  double mean = 0;         ///< mean magnitude [N]
  double peak = 0;         ///< largest magnitude [N]
  double mean_across = 0;  ///< mean magnitude of the part perpendicular to the velocity, while it moves [N]
  double assist = 0;       ///< work on the hand where the force is along the velocity: integral of max(F.v, 0) dt [J]
  double resist = 0;       ///< work taken from the hand: integral of max(-F.v, 0) dt [J]
};

/// Of the movement from its onset to its end, all of it from the low-passed columns.
struct MovementFigures {
  double duration = 0;        ///< of the trial, first to last position [s]
  double onset = 0, end = 0;  ///< after the trial's first position [s]
  double movement_time = 0;   ///< end - onset [s]
  double dwell_time = 0;      ///< of it, slower than the threshold [s]
  double path_length = 0;     ///< [m]
  double mean_speed = 0;      ///< path_length / movement_time [m/s]
  double peak_speed = 0;      ///< [m/s]
  int speed_peaks = 0;        ///< maxima of the speed with the prominence asked for; ends of the trial are none
  std::optional<double> normalised_length;  ///< path_length / reference_length
  std::optional<double> sparc, log_jerk;    ///< of the speed from onset to end, see smoothness.h
  std::optional<ForceFigures> force, measured;

  /// An ESTIMATE of the work that the person did on the device [J], with a plant given and a force:
  ///
  ///     W_person = change of sum of m_i v_i^2 / 2 + integral of sum of (b_i v_i^2 + F_c,i |v_i|) dt
  ///                - integral of (gravity + gradient x) . v dt - integral of F . v dt
  ///
  /// It is as good as the plant (see PlantModel), takes the force as commanded, without its delay, and knows nothing of
  /// what the hand does to itself: a hand that pushes against a wall works, but not by this figure.
  std::optional<double> person_work_estimate;
};

/// The figures of one trial. Positions and forces are resampled evenly, at 100 times the cut-off: each of the new
/// samples is the mean, over its step, of the straight lines between the old ones. Then a second-order Butterworth
/// filter runs over them forwards and backwards (no lag; beyond its ends the trial goes on as its point reflection),
/// and the velocity is the central difference of what is left. So the figures do not depend on how the movement was
/// sampled: from 250 Hz to 4 kHz, also with uneven stamps, they change by less than 2 %. Positions in counts of 0.05 mm
/// change them by no more, with one exception: in movements slower than 20 cm in some 1.5 s such counts have more jerk
/// than the hand. log_jerk then tells of the counts; sparc does not.
///
/// Undefined when nothing moves, with fewer than 3 positions, and when positions are missing for longer than `max_gap`;
/// figures of a force also when that force is. Rows that are not finite are left out.
///
/// Throws Error(input) naming the row when time does not strictly increase; when columns are unequal, the trial can
/// only be a unit mistake (10^8 samples after resampling), or options mean nothing.
///
/// O(N log N) for N samples. Threads: free function without state. Real-time: no; it allocates.
std::optional<MovementFigures> movement_figures(const Trial& trial, const MovementOptions& options = {});

}  // namespace haptrace
