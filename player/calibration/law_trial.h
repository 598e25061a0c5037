// Trying out a law that was designed for a model that is not to be trusted.
#pragma once

#include "control/design/tracking_design.h"
#include "player/session.h"

#include <array>
#include <string>

namespace haptrace {

struct LawTrialOptions {
  Vec3 centre = Vec3::Zero();   ///< of what is followed [m]
  double radius = 0.01;         ///< [m]
  double speed = 0.1;           ///< peak [m/s]
  double max_deviation = 0.03;  ///< [m]
  SessionOptions session;       ///< without a recording
};

/// What became of a law on the device.
struct LawTrial {
  SessionResult session;
  double rms_error = 0;     ///< of the second repetition, 3-D [m]
  double force_ripple = 0;  ///< likewise, above 25 Hz, rms [N]
  std::string reason;       ///< why the device does not bear it; empty when it does

  [[nodiscard]] bool passed() const noexcept { return reason.empty(); }
};

inline constexpr double kTrialRaise = 1.3;  ///< of the gains in a trial, over those of the design

/// Follows two turns of a small circle that also goes up and down, twice, with learning and with gains kTrialRaise
/// times those of the design, so that what passes has a margin. It fails when the oscillation monitor speaks, the force
/// ripples over more than twice what the position quantum is expected to make and kMostTrialRipple of the largest
/// force, or the session does not reach its end.
///
/// Throws what plan_playback and run_session throw before any force.
LawTrial try_out(Device& device, const IdentifiedDevice& identified, const LawTrialOptions& options,
                 const StopRequest& stop, const Progress& progress = {});

}  // namespace haptrace
