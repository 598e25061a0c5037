#include "devices/sim/wrist.h"

#include <algorithm>
#include <cmath>

namespace haptrace {
namespace {

constexpr double kLongestTurn = 2e-4;  // longest step [s]

}  // namespace

Wrist::Wrist(const WristSpec& spec, const HandSpec* hand, const Quat& start)
    : inertia_(spec.inertia),
      viscous_(spec.viscous),
      coulomb_(spec.coulomb),
      hand_stiffness_(hand != nullptr ? hand->turn_stiffness : 0),
      hand_damping_(hand != nullptr ? hand->turn_damping : 0),
      longest_step_(kLongestTurn),
      orientation_(start) {
  // Semi-implicit Euler is stable up to a step of 2 / omega.
  if (hand_stiffness_ > 0) longest_step_ = std::min(longest_step_, 0.2 * std::sqrt(inertia_ / hand_stiffness_));
}

void Wrist::advance(double span, const Vec3& torque, const Quat& intent) noexcept {
  if (!(span > 0)) return;
  const double steps = std::ceil(span / longest_step_);
  const double h = span / steps;
  for (double k = 0; k < steps; ++k) step(h, torque, intent);
}

void Wrist::step(double h, const Vec3& torque, const Quat& intent) noexcept {
  Vec3 drive = torque;
  if (hand_stiffness_ > 0) drive += hand_stiffness_ * rotation_between(orientation_, intent);
  velocity_ = (velocity_ + h / inertia_ * drive) / (1 + h / inertia_ * (viscous_ + hand_damping_));
  const double stops = h * coulomb_ / inertia_, speed = velocity_.norm();
  velocity_ = speed > stops ? Vec3(velocity_ * (1 - stops / speed)) : Vec3::Zero();
  orientation_ = (quaternion(h * velocity_) * orientation_).normalized();
}

}  // namespace haptrace
