// Metrics of a movement: duration, length, speed, smoothness, and the forces and work of the device.
#pragma once

#include "control/design/plant_model.h"
#include "metrics/smoothness.h"

#include <optional>
#include <span>

namespace haptrace {

/// Samples of one trial. Columns have the length of `time`, or are empty. NaN means "not measured".
struct Trial {
  std::span<const double> time;         ///< [s], strictly increasing; steps may vary
  std::span<const Vec3> position;       ///< p_WT [m]
  std::span<const Vec3> force = {};     ///< force of the device on the hand [N]
  std::span<const Vec3> measured = {};  ///< the same force, measured by a sensor [N]
};

struct MovementOptions {
  /// Cut-off of the zero-phase low pass, where its gain is 1 / sqrt(2) [Hz].
  double cutoff_hz = 10;
  /// A movement starts where the speed first reaches this fraction of its peak, and ends where it last falls below.
  double threshold = 0.05;
  /// A speed peak rises above its surroundings by at least this fraction of the largest, and by `least_speed`.
  double prominence = 0.05;
  /// A trial whose peak speed is lower is not a movement [m/s]. One count of 0.05 mm, low-passed, is 1 mm/s.
  double least_speed = 2e-3;
  /// Gaps up to this length are bridged by straight lines [s]; their corners count as jerk.
  double max_gap = 0.1;
  std::optional<double> reference_length;  ///< length of the reference path [m]
  std::optional<PlantModel> plant;         ///< for the estimate of the participant's work
  SparcOptions sparc;
};

/// Metrics of a force during a movement, low-passed but for the peak.
struct ForceFigures {
  double mean = 0;         ///< mean magnitude [N]
  double peak = 0;         ///< largest magnitude of the rows of the whole trial, unfiltered [N]
  double mean_across = 0;  ///< mean magnitude of the component perpendicular to the velocity, while the hand moves [N]
  double assist = 0;       ///< work on the hand where the force is along the velocity: integral of max(F.v, 0) dt [J]
  double resist = 0;       ///< work taken from the hand: integral of max(-F.v, 0) dt [J]
};

/// Metrics of the movement from its onset to its end, computed from the low-passed columns. Peak forces are those of
/// the rows: the low pass would lower a short one by a third and more.
struct MovementFigures {
  double duration = 0;        ///< duration of the trial, first to last position [s]
  double onset = 0, end = 0;  ///< after the trial's first position [s]
  double movement_time = 0;   ///< end - onset [s]
  double dwell_time = 0;      ///< part of the movement time below the speed threshold [s]
  double path_length = 0;     ///< [m]
  double mean_speed = 0;      ///< path_length / movement_time [m/s]
  double peak_speed = 0;      ///< [m/s]
  int speed_peaks = 0;        ///< speed maxima with the required prominence; the ends of the trial do not count
  std::optional<double> normalised_length;  ///< path_length / reference_length
  std::optional<double> sparc, log_jerk;    ///< of the speed from onset to end, see smoothness.h
  std::optional<double> log_jerk_vector;    ///< of the velocity from onset to end
  std::optional<ForceFigures> force, measured;

  /// ESTIMATE of the work that the participant did on the device [J]. It requires a plant and a force:
  ///
  ///     W_person = change of sum of m_i v_i^2 / 2 + integral of sum of (b_i v_i^2 + F_c,i |v_i|) dt
  ///                - integral of (gravity + gradient x) . v dt - integral of F . v dt
  ///
  /// It is as accurate as the plant (see PlantModel) and uses the commanded force without its delay. It does not see
  /// work inside the hand: a hand that pushes against a wall works, but this metric does not show it.
  std::optional<double> person_work_estimate;
};

/// Computes the metrics of one trial. Positions and forces are resampled evenly, at 100 times the cut-off: each new
/// sample is the mean, over its step, of the straight lines between the old ones. Then a second-order Butterworth
/// filter runs over them forwards and backwards (no lag; the trial continues beyond its ends as its point reflection).
/// The velocity is the central difference of the result. So the metrics do not depend on the sampling of the movement:
/// from 250 Hz to 4 kHz, also with uneven stamps, they change by less than 2 %. Position counts of 0.05 mm change them
/// by no more, with one exception: in movements slower than 20 cm in about 1.5 s, such counts have more jerk than the
/// hand. Then log_jerk measures the counts; sparc does not. In movements longer than 256 samples, sparc takes at most
/// every eighth sample: 12 in a period of the low pass.
///
/// Returns nothing when nothing moves, with fewer than 3 positions, and when positions are missing for longer than
/// `max_gap`. The metrics of a force are also undefined when that force is missing for longer. Rows that are not finite
/// are left out.
///
/// Throws Error(input) naming the row when time does not strictly increase. Also throws when columns have different
/// lengths, when the trial is so long that its unit must be wrong (10^8 samples after resampling), or when an option is
/// invalid.
///
/// O(N log N) for N samples. Threads: free function without state. Real-time: no; it allocates.
std::optional<MovementFigures> movement_figures(const Trial& trial, const MovementOptions& options = {});

}  // namespace haptrace
