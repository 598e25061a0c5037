// 3D Systems' Touch and the PHANTOMs, through OpenHaptics' HD API: not linked, but looked for.
#pragma once

#include "devices/registry.h"
#include "devices/vendor/shared_library.h"

namespace haptrace {

// HD's frame has W's axes: x to the user's right, y up, z towards him. Only its units differ. Real-time safe.

inline constexpr double kHdLength = 1e-3;  ///< [m] of HD's mm; speeds alike
inline constexpr double kHdTorque = 1e-3;  ///< [N m] of HD's mN m

/// R_WT of HD's transform of 4 x 4, by columns.
Quat orientation_from_open_haptics(const double (&transform)[16]);

/// Where libHD is looked for when nobody says where it is.
WantedLibrary open_haptics_library();

/// `openhaptics`, with the options library, name, rate and reset_encoders, which docs/devices/openhaptics.md explains.
///
/// HD owns the servo thread: it calls a function of ours at its own rate, in which alone states are read and forces
/// sent. Device::exchange passes states and forces to and fro by mailboxes, as ThreadedDevice does and under the same
/// watchdog; DeviceState::age is measured. HD knows one scheduler for all: one device at a time is open in a process.
///
/// After an error of a frame the device is away: no force is sent until kHdCalm without one. So it is when HD does not
/// call for kHdPatience, but then nothing can be sent. It is lost when either lasts for kHdLongestFault.
DeviceBackend open_haptics_backend();

inline constexpr double kHdCalm = 0.1;        ///< [s]
inline constexpr double kHdPatience = 0.25;   ///< [s]
inline constexpr double kHdLongestFault = 1;  ///< [s]

}  // namespace haptrace
