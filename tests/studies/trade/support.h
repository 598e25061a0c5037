// Device, workplace and configuration for the tests of the trade-off.
#pragma once

#include "control/path/shapes.h"
#include "player/calibration/device_identity.h"
#include "studies/trade/tradeoff.h"
#include "tests/player/calibration/identified_device.h"

namespace haptrace::test {

/// Returns a device that differs from its profile, in a hand with tremor.
inline std::unique_ptr<Device> held_device(std::uint64_t seed) {
  SimSpec spec = true_device();
  spec.hand = HandSpec{.mass = 0.1,
                       .grip_stiffness = 500,
                       .grip_damping = 5,
                       .arm_stiffness = 50,
                       .arm_relaxation = 1,
                       .arm_damping = 2,
                       .tremor = 0.04,
                       .drift = 0.1};
  return std::make_unique<SimDevice>(spec, SimOptions{.seed = seed});
}

inline DeviceProfile profile_of_held() {
  const IdentifiedDevice device = identified(known_plant());
  return {.device = identity_of(held_device(1)->info()),
          .facts = facts_of(held_device(1)->info()),
          .created = "2026-01-01T00:00:00Z",
          .software = "test",
          .rate_hz = 1000,
          .plant = device.plant,
          .half_width = {},
          .reason = {},
          .design = device.design};
}

inline Workplace small_workplace() {
  return {.open = held_device,
          .path = source_of(make_shape("circle", {.size = 0.03, .duration = 1})),
          .profile = profile_of_held(),
          .play = {}};
}

inline Configuration full_configuration() {
  return {.with = {.inertia = true, .gravity = true, .friction = true, .observer = true}};
}

}  // namespace haptrace::test
