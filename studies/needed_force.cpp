#include "studies/needed_force.h"

#include "control/norm.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace haptrace {
namespace {

constexpr double kSliding = 1e-3;  // below this speed friction rises from zero, as it has any value at rest [m/s]

}  // namespace

NeededForce::NeededForce(const SimSpec& spec, double rate_hz) : spec_(spec), period_(1 / rate_hz) {
  const double angle = spec.rotation.norm();
  rotation_ = angle > 0 ? Eigen::AngleAxisd(angle, spec.rotation / angle).toRotationMatrix()
                        : Eigen::Matrix3d(Eigen::Matrix3d::Identity());
}

Vec3 NeededForce::update(const Vec3& position) noexcept {
  const Vec3 x = rotation_ * position;
  if (!begun_) x_ = hand_x_ = x;
  begun_ = true;
  const Vec3 v = (x - x_) / period_, a = (v - v_) / period_;
  x_ = x;
  v_ = v;
  const Vec3 force = of_device(x, v, a) + of_hand(x, v);
  return rotation_.transpose() * force - spec_.gravity_bias - spec_.gravity_gradient * position;
}

Vec3 NeededForce::of_device(const Vec3& x, const Vec3& v, const Vec3& a) const noexcept {
  const double scale = 1 + spec_.inertia_variation * std::cos(std::numbers::pi * norm_of(x) / spec_.inertia_length);
  Vec3 force = scale * spec_.mass.cwiseProduct(a) + spec_.viscous.cwiseProduct(v);
  for (int axis = 0; axis < 3; ++axis) {
    double friction = spec_.coulomb[axis];
    if (spec_.stribeck_velocity > 0)
      friction *= 1 + (spec_.static_ratio - 1) * std::exp(-std::pow(v[axis] / spec_.stribeck_velocity, 2));
    force[axis] += friction * std::clamp(v[axis] / kSliding, -1.0, 1.0);
    if (spec_.cogging_period > 0)
      force[axis] += spec_.cogging[axis] * std::sin(2 * std::numbers::pi * x[axis] / spec_.cogging_period);
  }
  return force;
}

Vec3 NeededForce::of_hand(const Vec3& x, const Vec3& v) noexcept {
  if (!spec_.hand || !(spec_.hand->mass > 0)) return Vec3::Zero();
  const HandSpec& hand = *spec_.hand;
  Vec3 grip = hand.grip_stiffness * (x - hand_x_) + hand.grip_damping * (v - hand_v_);
  const Vec3 forgotten = hand.arm_relaxation > 0 ? Vec3(arm_ / hand.arm_relaxation) : Vec3(Vec3::Zero());
  arm_ -= period_ * (hand.arm_stiffness * hand_v_ + forgotten);
  hand_v_ += period_ * (grip + arm_ - hand.arm_damping * hand_v_) / hand.mass;
  hand_x_ += period_ * hand_v_;
  return grip;
}

}  // namespace haptrace
