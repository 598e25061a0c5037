// The largest force that the motors of a calibrated device give, and how long they withstand less.
#pragma once

#include "control/design/plant_model.h"
#include "player/session.h"

#include <string>

namespace haptrace {

/// Lowers the force limit of `session` to the largest force that the motors of a calibrated device give, so that what
/// the session sends is what acts, and adds a warning that says so to those known before the session. Returns false,
/// without a change, if the motors give all that the session may send. Otherwise the last of `session.known` is the new
/// warning.
bool bound_by_motors(SessionOptions& session, const DeviceInfo& device, const PlantModel& plant);

/// Says from when on the continuous limit of `loop` reduces the force of a session of `duration` [s] on a device whose
/// law took `force` [N], rms, in its trial, and takes as much again. Empty if it lasts, or if `force` is 0. The motors
/// are as warm as `loop.motors` says.
std::string heat_foreseen(const DeviceInfo& device, const ServoOptions& loop, double force, double duration);

}  // namespace haptrace
