// Driver of 3D Systems' Touch and PHANTOM devices through OpenHaptics' HD API, loaded at run time.
#pragma once

#include "devices/registry.h"
#include "devices/vendor/shared_library.h"

namespace haptrace {

// HD's frame has the axes of W: x to the user's right, y up, z towards the user. Only its units differ.

inline constexpr double kHdLength = 1e-3;  ///< HD's unit of length, mm [m]; also for speeds
inline constexpr double kHdTorque = 1e-3;  ///< HD's unit of torque, mN m [N m]

/// Returns R_WT for HD's transform of 4 x 4, by columns. Real-time safe.
Quat orientation_from_open_haptics(const double (&transform)[16]);

/// Returns the default places to search for libHD.
WantedLibrary open_haptics_library();

/// Returns the backend `openhaptics`, with the options library, name, rate and reset_encoders, which
/// docs/devices/openhaptics.md explains.
///
/// HD owns the servo thread and calls our callback at its own rate. Only this callback reads states and sends forces.
/// Device::exchange passes states and forces through mailboxes, like ThreadedDevice and under the same watchdog;
/// DeviceState::age is measured. HD has one scheduler for all devices, so a process can open one device at a time.
///
/// After an error in a frame the device is `away`: no force is sent until kHdCalm has passed without another error. The
/// device is also `away` if HD does not call for kHdPatience, but then nothing can be sent. It is `lost` if either
/// lasts for kHdLongestFault.
///
/// If the vendor's library does not return from a call of close(), close() gives it up (LooseThread). Frames then still
/// send zero force, and no further device can be opened until the call returns.
DeviceBackend open_haptics_backend();

inline constexpr double kHdCalm = 0.1;        ///< [s]
inline constexpr double kHdPatience = 0.25;   ///< [s]
inline constexpr double kHdLongestFault = 1;  ///< [s]

}  // namespace haptrace
