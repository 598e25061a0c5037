// Comparison of the laws of a calibrated device over its workspace.
#pragma once

#include "player/playback/playback.h"
#include "player/session.h"

#include <string>
#include <vector>

namespace haptrace {

/// A tour of a device's workspace: from place to place, and once round a circle at each, every second one slowly.
struct WorkspaceTour {
  std::vector<Vec3> places;     ///< centres of the circles, the first of them the workspace's [m]
  double radius = 0.01;         ///< of the circles [m]
  double speed = 0.12;          ///< peak speed on the circles and between them [m/s]
  double max_deviation = 0.03;  ///< distance from the reference beyond which the session stops [m]
  /// Small oscillations count, too (OscillationMonitor), beside what the guard reports.
  bool small_oscillations = true;
  SessionOptions session;  ///< without a recording
};

/// The result of a law on a tour.
struct TourResult {
  SessionResult session;
  std::vector<double> rms_error;  ///< measured rms error at each place [m]
  std::vector<double> ripple;     ///< force above 25 Hz at each place, rms [N]
  std::vector<double> saturated;  ///< share of the ticks from each place on in which the force was at its limit
  double force = 0;               ///< magnitude that was sent, rms [N]
  int oscillations = 0;           ///< reports of the monitors, but for slow ones and those while the motors are hot

  [[nodiscard]] bool finished() const noexcept { return session.servo.cause == StopCause::finished; }
};

/// Follows a tour under the law that `law` chooses for an identified device: its `identified`, `law`, `firmness` and
/// `compensations` count. Nothing is learned. Throws what plan_playback and run_session throw before any force.
TourResult toured(Device& device, const PlayOptions& law, const WorkspaceTour& tour, const StopRequest& stop,
                  const Progress& progress = {});

/// Returns how many times smaller the error under `law` is than under `plain`, at the place where it is least so of
/// those where the force sufficed; 0 if it sufficed nowhere.
double least_improvement(const TourResult& law, const TourResult& plain) noexcept;

/// Returns the rms error of `law` over that of `plain`, over all places where the force sufficed; 0 if it sufficed
/// nowhere.
double error_ratio(const TourResult& law, const TourResult& plain) noexcept;

/// Returns the rms error over all places that were reached [m].
double whole_error(const TourResult& toured) noexcept;

/// Returns why a law must not be used on a device that followed the same tour under plain PD control; empty if it may:
/// it finished without an oscillation, its error over all places was smaller, and at no place was it larger
/// than 1.3 times that of PD control. Places where either was at the limit of the force do not count. `max_ripple`
/// bounds the force ripple at any place [N].
std::string refusal_of(const TourResult& law, const TourResult& plain, const WorkspaceTour& tour, double max_ripple);

}  // namespace haptrace
