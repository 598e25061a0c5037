#include "studies/ensemble_draw.h"

#include "base/error.h"

#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

HandSpec draw_hand(Lot& lot) {
  HandSpec hand;
  hand.mass = lot.in(ensemble::kHandMass);
  hand.grip_stiffness = lot.in_logarithm(ensemble::kGripStiffness);
  hand.grip_damping = lot.in(ensemble::kGripDamping);
  hand.arm_stiffness = lot.in(ensemble::kArmStiffness);
  hand.arm_relaxation = lot.in(ensemble::kArmRelaxation);
  hand.arm_damping = lot.in(ensemble::kArmDamping);
  hand.tremor = ensemble::kTremor;
  hand.drift = ensemble::kDrift;
  return hand;
}

}  // namespace

void check_draws(std::size_t draws) {
  if (draws < 1 || draws > 1'000'000)
    throw input_error(fmt::format("the number of draws is {}; it must be from 1 to 1000000", draws));
}

EnsembleDraw draw_device(std::uint64_t seed, std::uint64_t index) {
  Lot lot(seed, index);
  EnsembleDraw draw;
  SimSpec& s = draw.spec;
  s.model = fmt::format("device {} of ensemble {}", index, seed);

  s.rotation = lot.in(ensemble::kRotation)*lot.direction();
  s.mass = lot.by_axis(lot.in(ensemble::kMass));
  s.viscous = lot.by_axis(lot.in(ensemble::kViscous));
  s.coulomb = lot.by_axis(lot.in(ensemble::kCoulomb));
  s.static_ratio = lot.in(ensemble::kStaticRatio);
  s.stribeck_velocity = lot.in(ensemble::kStribeckVelocity);
  s.presliding_stiffness = s.coulomb / lot.in(ensemble::kPreslidingDistance);
  s.cogging = Vec3::Constant(lot.in(ensemble::kCogging));
  s.cogging_period = lot.in(ensemble::kCoggingPeriod);
  s.gravity_bias = lot.in(ensemble::kGravity)*lot.direction();
  for (int axis = 0; axis < 3; ++axis) s.gravity_gradient(axis, axis) = lot.in(ensemble::kGravityGradient);

  s.delay = lot.in(ensemble::kDelay);
  s.actuator_bandwidth_hz = 1 / (2 * std::numbers::pi * lot.in(ensemble::kActuatorLag));
  s.position_resolution = ensemble::kPositionResolution;
  s.force_resolution = ensemble::kForceResolution;
  s.max_force = s.max_continuous_force = ensemble::kMaxForce;  // the loop is judged, not motor heating
  s.workspace = {Vec3::Constant(-ensemble::kReach), Vec3::Constant(ensemble::kReach)};

  draw.noise_seed = lot.seed();
  if (!lot.happens(ensemble::kNobody)) s.hand = draw_hand(lot);
  return draw;
}

}  // namespace haptrace
