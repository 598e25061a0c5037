#include "studies/trade/stand_in.h"

#include "base/statistics.h"
#include "devices/sim/noise.h"
#include "devices/sim/presets.h"
#include "devices/sim/sim_device.h"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace haptrace {
namespace {

constexpr std::uint64_t kStandInStream = 77;  // random stream of the draws, separate from the device's noise
constexpr double kFarthestDraw = 2;           // standard deviations
constexpr double kLeastShare = 0.5;           // smallest share of a parameter that remains
constexpr double kBristle = 8e-5;             // presliding distance of measured mechanisms [m]

/// Returns a random value within its interval, from kLeastShare to 2 - kLeastShare of `value`.
double drawn(double value, double half_width, Gaussian& noise) {
  const double deviations = std::clamp(noise(), -kFarthestDraw, kFarthestDraw);
  if (!(half_width > 0 && value > 0)) return value;
  return std::clamp(value + deviations * half_width / kInterval95, kLeastShare * value, (2 - kLeastShare) * value);
}

HandSpec relaxed_hand() {
  return *read_sim_spec({{"mass", 1}, {"max_force", 1}, {"hand", hand_preset("relaxed", "the stand-in's hand")}},
                        "the stand-in")
              .hand;
}

}  // namespace

SimSpec stand_in_spec(const DeviceInfo& info, const DeviceProfile& profile, std::uint64_t seed) {
  HandSpec hand = relaxed_hand();
  hand.arm_stiffness = hand.arm_relaxation = hand.arm_damping = 0;
  Gaussian noise(seed, kStandInStream);
  PlantModel plant = profile.plant;
  for (int axis = 0; axis < 3; ++axis) {
    const PlantModel& half = profile.half_width;
    plant.mass[axis] = drawn(plant.mass[axis], half.mass[axis], noise);
    plant.viscous[axis] = std::max(drawn(plant.viscous[axis], half.viscous[axis], noise), 0.0);
    plant.coulomb[axis] = std::max(drawn(plant.coulomb[axis], half.coulomb[axis], noise), 0.0);
    if (profile.coarse) plant.mass[axis] = std::max(plant.mass[axis] - hand.mass, kLeastShare * plant.mass[axis]);
    // The mass of a held axis does not matter; calibration cannot identify it.
    if (!info.force_axes[static_cast<std::size_t>(axis)]) plant.mass[axis] = 1;
  }
  plant.delay = drawn(plant.delay, profile.half_width.delay, noise);
  plant.gravity_gradient = (0.5 * (plant.gravity_gradient + plant.gravity_gradient.transpose())).eval();
  const double stated = profile.facts.max_force > 0 ? profile.facts.max_force : info.max_force;
  SimSpec spec = sim_spec_of(plant, stated > 0 ? stated : kUnstatedForce);
  spec.model = info.model;
  spec.axes = info.force_axes;
  spec.max_continuous_force = info.max_continuous_force;
  spec.nominal_rate = info.nominal_rate;
  spec.presliding_stiffness = spec.coulomb / kBristle;
  if ((info.workspace_min.array() < info.workspace_max.array()).all())
    spec.workspace = {info.workspace_min, info.workspace_max};
  spec.hand = hand;
  return spec;
}

std::unique_ptr<Device> stand_in(const DeviceInfo& info, const DeviceProfile& profile, std::uint64_t seed) {
  return std::make_unique<SimDevice>(stand_in_spec(info, profile, seed), SimOptions{.name = info.name, .seed = seed});
}

}  // namespace haptrace
