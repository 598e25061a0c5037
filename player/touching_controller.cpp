#include "player/touching_controller.h"

#include "control/design/loop_analysis.h"
#include "devices/device.h"
#include "player/guidance/guide.h"
#include "player/passivity_defaults.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace haptrace {
namespace {

std::unique_ptr<SceneController> scene_controller(const TouchOptions& touch, const DeviceInfo& device, double rate_hz) {
  std::optional<PassivityLayer::Options> passivity;
  if (touch.scene->options().passivity) passivity = passivity_for(touch.plant, rate_hz, device.position_resolution);
  return make_scene_controller(touch.scene, rate_hz, touch.slow, passivity, device.position_resolution);
}

}  // namespace

TouchingController::TouchingController(Controller& inner, const TouchOptions& touch, const DeviceInfo& device,
                                       double rate_hz)
    : inner_(inner),
      scene_(scene_controller(touch, device, rate_hz)),
      driven_(device.force_axes[0] ? 1 : 0, device.force_axes[1] ? 1 : 0, device.force_axes[2] ? 1 : 0),
      mailbox_(touch.requests),
      rests_in_pause_(touch.rests_in_pause) {}

void TouchingController::forget(const State& first) noexcept {
  scene_->start(first);
  touched_.setZero();
}

void TouchingController::start(const State& first) noexcept {
  requests_ = RequestFollower(mailbox_, rests_in_pause_);
  inner_.start(first);
  forget(first);
}

void TouchingController::resume(const State& first) noexcept {
  inner_.resume(first);
  forget(first);
}

Command TouchingController::update(const State& state) noexcept {
  requests_.update(state.dt);
  State seen = state;
  seen.force_touched = state.share_applied * driven_.cwiseProduct(touched_);
  Command command = inner_.update(seen);

  seen.force_applied = seen.force_touched;
  const Command felt = scene_->touch(seen);
  touched_ = requests_.share() * felt.wrench.force;
  command.wrench.force += touched_;
  command.vibration += requests_.share() * felt.vibration;
  command.contacts = felt.contacts;
  if (!command.event) command.event = scene_->take_event();
  return command;
}

void TouchingController::between_ticks(bool may_wait) noexcept {
  inner_.between_ticks(may_wait);
  scene_->between_ticks(may_wait);
}

PassivityLayer::Options passivity_for(const std::optional<PlantModel>& plant, double rate_hz, double resolution) {
  LoopModel loop{.mass = kUnknownMass, .delay = kUnknownDelay, .rate_hz = rate_hz, .resolution = resolution};
  if (plant) {
    loop.delay = plant->delay;
    // Only axes with a motor were identified.
    double mass = std::numeric_limits<double>::infinity(), viscous = mass;
    for (int axis = 0; axis < 3; ++axis) {
      if (!(plant->mass[axis] > 0)) continue;
      mass = std::min(mass, plant->mass[axis]);
      viscous = std::min(viscous, std::max(plant->viscous[axis], 0.0));
    }
    if (std::isfinite(mass)) {
      loop.mass = mass;
      loop.viscous = viscous;
    }
  }
  return passivity_layer_for(loop);
}

}  // namespace haptrace
