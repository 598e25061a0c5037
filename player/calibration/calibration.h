// Finding out what a device is: a session that moves it about, and what that session said.
#pragma once

#include "control/design/identification.h"
#include "control/design/tracking_design.h"
#include "player/session.h"

#include <optional>
#include <string>

namespace haptrace {

struct CalibrationOptions {
  bool full = false;         ///< half a minute instead of ten seconds: four times the data
  double force_share = 0.7;  ///< of the device's largest force, never to be passed, 0.1 to 1
  SessionOptions session;
};

/// What a calibration is going to do.
struct CalibrationPlan {
  bool full = false;
  double rate_hz = 1000;
  std::array<bool, 3> axes{};   ///< that take a force
  Vec3 centre = Vec3::Zero();   ///< round which everything happens, the middle of the workspace [m]
  Vec3 reach = Vec3::Zero();    ///< farthest from the centre, per axis [m]
  double max_force = 0;         ///< magnitude [N]
  double device_force = 0;      ///< largest that the device, or who asks, allows [N]
  double max_dither = 0;        ///< rms per axis of what is felt as a hum [N]
  double max_speed = 0;         ///< of the sweeps [m/s]
  double max_deviation = 0;     ///< from where the device should be, beyond which the session stops [m]
  double approach_speed = 0.1;  ///< peak [m/s]
  double duration = 0;          ///< without the way to the centre [s]
  Multisine dither;
};

/// Throws Error(input) when the device takes no force, nobody says how much it bears, its workspace leaves less than
/// 3 mm to move, or the rate is too low for the dither.
CalibrationPlan plan_calibration(const DeviceInfo& device, const CalibrationOptions& options);

struct CalibrationResult {
  SessionResult session;
  Identification identification;         ///< of what was recorded; `fits` false when it was not enough
  std::optional<TrackingDesign> design;  ///< when the session finished and the model fits
  std::string reason;                    ///< why there is no design; empty when there is one
  std::string doubt;                     ///< why the model is only a coarse one; empty when it is not
  double bandwidth = 1;                  ///< share of what the model would allow, that trials left of the design
  int trials = 0;                        ///< of a coarse model's design

  [[nodiscard]] bool succeeded() const noexcept { return design.has_value(); }
};

/// Moves the device to the middle of its workspace, swings it round with a dither of many frequencies on the force,
/// which shows mass and delay, then sweeps it along each axis, which shows friction and gravity. A first look at the
/// dither's response checks that the device moves where it is pushed, and sets gains and dither for the rest. Forces,
/// speed and distances are bounded by the plan; a device that is blocked, pushed away or driven the wrong way ends the
/// session. When the response to the dither is not that of a mass, a coarse model is made (identify_coarsely), and the
/// law that is designed for it is tried out on a circle within the same bounds (law_trial.h), at 1, 0.7, 0.5 and 0.35
/// of its bandwidth: the first that passes stays, and none is what is then told. What is known of the device beforehand
/// is its largest force, its workspace and its axes.
///
/// Throws what plan_calibration and run_session throw before any force.
CalibrationResult calibrate(Device& device, const CalibrationOptions& options, const StopRequest& stop,
                            const Progress& progress = {});

}  // namespace haptrace
