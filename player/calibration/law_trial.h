// Trial of a control law that was designed for a coarse model.
#pragma once

#include "control/design/identified_device.h"
#include "player/session.h"

#include <array>
#include <string>

namespace haptrace {

struct LawTrialOptions {
  Vec3 centre = Vec3::Zero();   ///< centre of the circle [m]
  double radius = 0.01;         ///< radius of the circle [m]
  double speed = 0.1;           ///< peak speed [m/s]
  double max_deviation = 0.03;  ///< distance from the reference beyond which the session stops [m]
  SessionOptions session;       ///< without a recording
};

/// Result of a trial on the device.
struct LawTrial {
  SessionResult session;
  double rms_error = 0;     ///< 3-D rms error of the second repetition [m]
  double force_ripple = 0;  ///< force above 25 Hz in the second repetition, rms [N]
  std::string reason;       ///< why the law failed; empty when it passed

  [[nodiscard]] bool passed() const noexcept { return reason.empty(); }
};

inline constexpr double kTrialRaise = 1.3;  ///< gains in a trial, relative to the design

/// Follows two turns of a small circle with a vertical movement, twice, with learning and with gains kTrialRaise times
/// those of the design, so that a law that passes has a margin. The trial fails when the loop oscillates (oscillation
/// monitor), when the rms error exceeds kMostTrialError of the radius, or when the session ends early. It also fails
/// when the force ripple exceeds both kMostTrialRipple of the largest force and twice the ripple that the position
/// resolution is expected to cause.
///
/// Throws what plan_playback and run_session throw before any force.
LawTrial try_out(Device& device, const IdentifiedDevice& identified, const LawTrialOptions& options,
                 const StopRequest& stop, const Progress& progress = {});

}  // namespace haptrace
