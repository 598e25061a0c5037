#include "player/record_controllers.h"

#include "control/design/loop_analysis.h"
#include "player/guidance/guide.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace haptrace {

Command TimedController::update(const State& state) noexcept {
  Command command = inner_.update(state);
  requests_.update(state.dt);
  if (const double share = requests_.share(); share < 1) {
    command.wrench.force *= share;
    command.wrench.torque *= share;
    command.feedforward *= share;
  }
  if (kept_) std::swap(kept_, command.event);
  if (waits_) {
    const auto fired = trigger_->check(state);
    if (!fired) return command;
    kept_ = std::exchange(command.event, fired);
    waits_ = false;  // the trigger is kept: a tick must not free memory
    begin_ns_ = state.time_ns;
  }
  if (duration_ > 0 && 1e-9 * static_cast<double>(state.time_ns - begin_ns_) >= duration_)
    command.status = Command::Status::finished;
  return command;
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
