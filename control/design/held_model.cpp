#include "control/design/held_model.h"

#include <algorithm>

namespace haptrace {

HeldResponse held_response(const HandModel& hand, const LinkModel& link, std::complex<double> s) noexcept {
  HeldResponse result{.impedance = 0, .share = 1};
  // Puts a body behind a spring and a damper, whose force for a displacement is `spring`.
  const auto behind = [&](std::complex<double> spring, std::complex<double> body) {
    result.impedance = spring * body / (spring + body);
    result.share *= spring / (spring + body);
  };
  if (hand.mass > 0) {
    const std::complex<double> relaxing = s * hand.arm_relaxation_s / (1.0 + s * hand.arm_relaxation_s);
    behind(hand.grip_stiffness + hand.grip_damping * s,
           hand.mass * s * s + hand.arm_damping * s + hand.arm_stiffness * relaxing);
  }
  if (link.mass > 0) behind(link.stiffness + link.damping * s, link.mass * s * s + result.impedance);
  return result;
}

HeldModel held_model(const PlantModel& plant, const HandModel& hand, double lag) noexcept {
  const double delay = std::max(plant.delay, 0.0);
  lag = std::min(lag, delay);
  HeldModel held{.mass = plant.mass, .delay = delay - lag, .lag = lag};
  for (std::size_t axis = 0; axis < 3; ++axis)
    if (plant.mass[static_cast<Eigen::Index>(axis)] > 0) held.hand[axis] = hand;
  return held;
}

std::array<std::optional<AxisModel>, 3> axis_models(const HeldModel& held, double position_noise, double rate_hz) {
  constexpr double kLeastNoise = 1e-7;  // [m]
  std::array<std::optional<AxisModel>, 3> axes;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto axis = static_cast<Eigen::Index>(i);
    if (held.mass[axis] > 0)
      axes[i] = {.mass = held.mass[axis],
                 .viscous = held.viscous[axis],
                 .delay_ticks = held.delay * rate_hz,
                 .lag = held.lag,
                 .link = held.link[i],
                 .hand = held.hand[i],
                 .noise = held.noise,
                 .position_noise = std::max(position_noise, kLeastNoise),
                 .rate_hz = rate_hz};
  }
  return axes;
}

}  // namespace haptrace
