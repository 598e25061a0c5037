// A device with known dynamics, as after calibration.
#pragma once

#include "control/design/identified_device.h"
#include "devices/sim/sim_device.h"
#include "player/playback/playback.h"

namespace haptrace::test {

inline PlantModel known_plant() {
  PlantModel plant;
  plant.mass = Vec3(0.4, 0.4, 0.3);
  plant.viscous = Vec3::Constant(1.8);
  plant.coulomb = Vec3::Constant(0.7);
  plant.gravity = Vec3(0, 0.3, -1.5);
  plant.delay = 1.5e-3;
  plant.position_resolution = 5e-5;
  return plant;
}

inline IdentifiedDevice identified(const PlantModel& plant, double max_force = 8) {
  return {plant, design_tracking(plant, {.max_force = max_force}), {}};
}

/// The known plant with laws for a relaxed hand, searched once.
inline const IdentifiedDevice& identified_in_a_hand() {
  static const IdentifiedDevice device = [] {
    IdentifiedDevice made = identified(known_plant());
    made.held = held_device({.plant = known_plant()}, {}, 1000, 8);
    (void)design_laws(*made.held, 1000, StopRequest{});
    return made;
  }();
  return device;
}

/// Returns the true device: 10 % lighter than the known plant, with 30 % more friction and gravity, and with cogging.
inline SimSpec true_device() {
  PlantModel plant = known_plant();
  plant.mass *= 0.9;
  plant.coulomb *= 1.3;
  plant.gravity *= 1.3;
  SimSpec spec = sim_spec_of(plant, 8);
  spec.cogging = Vec3::Constant(0.6);
  spec.cogging_period = 0.008;
  spec.workspace = {Vec3::Constant(-0.2), Vec3::Constant(0.2)};
  return spec;
}

inline HandSpec relaxed_hand() {
  return {.mass = 0.15, .grip_stiffness = 800, .grip_damping = 4, .arm_stiffness = 40, .arm_damping = 2.5};
}

/// Returns options with every compensation on.
inline PlayOptions everything() {
  PlayOptions options;
  options.identified = identified(known_plant());
  options.learn = 2;
  options.playback.repetitions = 3;
  options.playback.hold = 0.2;
  return options;
}

}  // namespace haptrace::test
