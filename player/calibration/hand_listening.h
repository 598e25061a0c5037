// Listens to the hand that holds a device, without force.
#pragma once

#include "control/design/hand_noise.h"
#include "player/calibration/calibration_plan.h"

namespace haptrace {

struct Listened {
  StopCause ended = StopCause::finished;
  HeldModel held;  ///< with the tremor, if one stands out
};

/// Lets the hand move the device for kListening without force, and returns the tremor of a relaxed hand that would move
/// a device of `mass` [kg] in this way, if one stands out. Without force no loop can vibrate: what moves is the hand.
/// There is none if the session did not come to its end. Throws what run_session throws.
Listened listen_to_hand(Device& device, const CalibrationPlan& plan, const Vec3& mass, const SessionOptions& session,
                        const StopRequest& stop, const Progress& progress);
inline constexpr double kListening = 3.2;  ///< [s]

}  // namespace haptrace
