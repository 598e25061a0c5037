// The force limit of a session on a device whose motors give less than it states.
#pragma once

#include "control/design/plant_model.h"
#include "player/session.h"

namespace haptrace {

/// Lowers the force limit of `session` to the largest force that the motors of a calibrated device give, so that what
/// the session sends is what acts, and adds a warning that says so to those known before the session. Returns false,
/// without a change, if the motors give all that the session may send. Otherwise the last of `session.known` is the new
/// warning.
bool bound_by_motors(SessionOptions& session, const DeviceInfo& device, const PlantModel& plant);

}  // namespace haptrace
