// Assumptions about a device without a profile, with which walls and scenes stay passive on it.
#pragma once

namespace haptrace {

/// Assumed delay from the sending of a force to its effect on an uncalibrated device [s]. It is the longest delay of
/// such devices: walls designed for too short a delay give out energy that no account sees.
inline constexpr double kUnknownDelay = 5e-3;

/// Assumed mass of such a device, for the passivity layer of a scene [kg]. A lighter device withstands less damping.
inline constexpr double kUnknownMass = 0.1;

}  // namespace haptrace
