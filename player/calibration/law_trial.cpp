#include "player/calibration/law_trial.h"

#include "control/oscillation_count.h"
#include "control/path/min_jerk.h"
#include "player/playback/playback.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

constexpr double kTwoTurns = 4 * std::numbers::pi;
constexpr double kMostTrialRipple = 0.04;  // share of the largest force
constexpr double kMostTrialError = 0.3;    // share of the radius

/// Returns a path from rest to rest that lies within the workspace, also along axes that the device does not drive.
Path trial_path(const DeviceInfo& info, const LawTrialOptions& options) {
  const double duration = MinJerk::kPeakSpeed * kTwoTurns * options.radius / options.speed;
  Path path{.name = "the trial circle"};
  constexpr double kStep = 2e-3;  // [s]
  const auto steps = static_cast<int>(std::ceil(duration / kStep));
  for (int i = 0; i <= steps; ++i) {
    const double angle = kTwoTurns * MinJerk::at(static_cast<double>(i) / steps).s;
    const Vec3 place(std::cos(angle), std::sin(angle), 0.5 * std::sin(2 * angle));
    Vec3 position = options.centre + options.radius * place;
    for (int axis = 0; axis < 3; ++axis)
      if (!info.force_axes[static_cast<std::size_t>(axis)])
        position[axis] = std::clamp(options.centre[axis], info.workspace_min[axis], info.workspace_max[axis]);
    path.time.push_back(i * kStep);
    path.position.push_back(position);
  }
  return path;
}

}  // namespace

LawTrial try_out(Device& device, const IdentifiedDevice& identified, const LawTrialOptions& options,
                 const StopRequest& stop, const Progress& progress) {
  PlayOptions play_options{.identified = identified};
  play_options.gains = {kTrialRaise * identified.design.gains.kp, kTrialRaise * identified.design.gains.kd};
  play_options.learn = play_options.playback.repetitions = 2;
  play_options.playback.max_deviation = options.max_deviation;
  play_options.smoothing = 0;
  play_options.find_oscillations = true;
  play_options.session = options.session;
  play_options.session.recording.reset();
  OscillationCount oscillations;
  play_options.sinks.push_back(&oscillations);

  const DeviceInfo& info = device.info();
  const PlayResult played =
      play(device, plan_playback(info, trial_path(info, options), play_options), play_options, stop, progress);
  LawTrial trial{
      .session = played.session, .rms_error = played.last.rms_error, .force_ripple = played.last.force_ripple};
  const double allowed = std::max(2 * kTrialRaise * identified.design.ripple, kMostTrialRipple * info.max_force);
  if (trial.session.servo.cause != StopCause::finished)
    trial.reason = "it ended early: " + trial.session.servo.detail;
  else if (trial.rms_error > kMostTrialError * options.radius)
    trial.reason = fmt::format("its error is {:.1f} mm rms", 1e3 * trial.rms_error);
  else if (oscillations.count() > 0)
    trial.reason = "it oscillates";
  else if (trial.force_ripple > allowed)
    trial.reason = fmt::format("its force ripple is {:.2f} N rms above 25 Hz", trial.force_ripple);
  return trial;
}

}  // namespace haptrace
