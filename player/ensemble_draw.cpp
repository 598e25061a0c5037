#include "player/ensemble_draw.h"

#include "devices/sim/noise.h"

#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

using ensemble::Range;

/// The numbers of one draw. Their order is the ensemble: a new one goes to the end.
class Lot {
 public:
  Lot(std::uint64_t seed, std::uint64_t index) : bits_(seed, index) {}

  double in(const Range& range) { return bits_.between(range.low, range.high); }

  double in_logarithm(const Range& range) { return range.low * std::pow(range.high / range.low, bits_.between(0, 1)); }

  bool happens(double probability) { return bits_.between(0, 1) < probability; }

  /// `value`, a little different for each axis.
  Vec3 by_axis(double value) {
    Vec3 v;
    for (double& component : v) component = value * in(ensemble::kOfAxis);
    return v;
  }

  /// A unit vector, every direction alike.
  Vec3 direction() {
    Vec3 v;
    do {
      for (double& component : v) component = bits_.symmetric();
    } while (v.squaredNorm() > 1 || v.squaredNorm() < 1e-6);
    return v.normalized();
  }

  std::uint64_t seed() { return bits_.next(); }

 private:
  SplitMix64 bits_;
};

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
  s.max_force = ensemble::kMaxForce;
  s.workspace = {Vec3::Constant(-ensemble::kReach), Vec3::Constant(ensemble::kReach)};

  draw.noise_seed = lot.seed();
  if (!lot.happens(ensemble::kNobody)) s.hand = draw_hand(lot);
  return draw;
}

}  // namespace haptrace
