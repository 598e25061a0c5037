// A simulated device that replaces a real one, which must not move while configurations are tried.
#pragma once

#include "devices/device.h"
#include "devices/sim/spec.h"
#include "formats/documents/device_profile.h"

#include <cstdint>
#include <memory>

namespace haptrace {

/// Share by which a prediction on a stand-in may miss the device's own result in either direction, in addition to the
/// spread of its runs: eleven of the thirteen held-out plants of docs/tradeoff.md lie within it, and the two beyond it
/// are named there.
inline constexpr double kStandInError = 0.35;

/// The largest force of a stand-in for a device that states none [N].
inline constexpr double kUnstatedForce = 8;

/// Returns the model of `profile` in a relaxed simulated hand. Calibration identifies a device in a hand: its viscous
/// damping and gradient contain those of the arm, and a coarse model's mass contains the hand's. The simulated hand
/// therefore brings its grip, tremor and drift but no arm, and a coarse model's mass is reduced by the hand's, to half
/// at most.
///
/// Parameters are drawn from their 95 % intervals, at most two deviations out, so that runs of different seeds differ
/// as far as the calibration leaves the device open. Axes that take no force are held. Unknown facts get cautious
/// values: kUnstatedForce, the default workspace.
SimSpec stand_in_spec(const DeviceInfo& info, const DeviceProfile& profile, std::uint64_t seed);

/// Returns a device of stand_in_spec(), new and at rest.
std::unique_ptr<Device> stand_in(const DeviceInfo& info, const DeviceProfile& profile, std::uint64_t seed);

}  // namespace haptrace
