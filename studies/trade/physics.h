// Effect of each part of a simulated device's physics, left out in turn.
#pragma once

#include "devices/sim/spec.h"
#include "studies/trade/tradeoff.h"

namespace haptrace {

/// A part of the model of a simulated device and its hand.
struct PhysicsPart {
  const char* name;
  bool (*there)(const SimSpec& spec);
  void (*leave_out)(SimSpec& spec);
};

/// Returns the parts in the order of the chain: command, motor, mechanism, sensors, hand.
const std::vector<PhysicsPart>& physics_parts();

/// Plays `configuration` on `spec`, then on `spec` without each of its parts in turn, always with the profile of the
/// whole: the compensation of a missing part may become a disturbance. `control` of a term is the time per tick that
/// the part costs, including the device's exchange. `make` makes the device of a spec for a seed. Otherwise like
/// explain().
Explanation explain_physics(const Workplace& place, const SimSpec& spec,
                            const std::function<std::unique_ptr<Device>(const SimSpec& spec, std::uint64_t seed)>& make,
                            const Configuration& configuration, const Budget& budget, const TradeOptions& options,
                            const StopRequest& stop);

}  // namespace haptrace
