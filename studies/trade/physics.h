// How good a simulation has to be: each part of a simulated device's physics left out in turn.
#pragma once

#include "devices/sim/spec.h"
#include "studies/trade/tradeoff.h"

namespace haptrace {

/// A part of what a simulated device and its hand are made of.
struct PhysicsPart {
  const char* name;
  bool (*there)(const SimSpec& spec);
  void (*leave_out)(SimSpec& spec);
};

/// In the order of the chain: command, motor, mechanism, sensors, hand.
const std::vector<PhysicsPart>& physics_parts();

/// `configuration` played on `spec`, then on the same without each of its parts, with the profile of the whole: what is
/// not there may make the controller's compensation of it a disturbance. Of a part, `control` is what a tick costs more
/// with it, the device's exchange included. `make` makes the device of a spec, for a seed. As explain() otherwise.
Explanation explain_physics(const Workplace& place, const SimSpec& spec,
                            const std::function<std::unique_ptr<Device>(const SimSpec& spec, std::uint64_t seed)>& make,
                            const Configuration& configuration, const Budget& budget, const TradeOptions& options,
                            const StopRequest& stop);

}  // namespace haptrace
