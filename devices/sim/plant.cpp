#include "devices/sim/plant.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace haptrace {
namespace {

constexpr double kWallStiffness = 2e4;  // [N/m]

// Largest step times natural frequency, or times damping over mass: keeps a spring's period within half a per cent.
constexpr double kFinest = 0.3;

Eigen::Matrix3d rotation_matrix(const Vec3& vector) {
  const double angle = vector.norm();
  if (angle == 0) return Eigen::Matrix3d::Identity();
  return Eigen::AngleAxisd(angle, vector / angle).toRotationMatrix();
}

/// A spring's stretch with `half` a gap of play on each side.
Vec3 beyond_play(const Vec3& stretch, double half) {
  return stretch - stretch.cwiseMax(-half).cwiseMin(half);
}

}  // namespace

Plant::Plant(const SimSpec& spec, const Vec3& start, bool follows_intent, double longest_step)
    : rotation_(rotation_matrix(spec.rotation)), structure_(spec.structural_mode.has_value()) {
  Vec3 moving = Vec3::Zero();
  for (int axis = 0; axis < 3; ++axis) moving[axis] = spec.axes[static_cast<std::size_t>(axis)] ? 1 : 0;
  const Vec3 start_a = rotation_ * start.cwiseProduct(moving);

  Vec3 motor_mass = spec.mass;
  if (spec.structural_mode) {
    const Vec3 handle_mass = spec.structural_mode->handle_fraction * spec.mass;
    motor_mass -= handle_mass;
    handle_ = {start_a, Vec3::Zero(), moving.cwiseQuotient(handle_mass)};
    const double omega = 2 * std::numbers::pi * spec.structural_mode->frequency_hz;
    const Vec3 reduced_mass = motor_mass.cwiseProduct(handle_mass).cwiseQuotient(spec.mass);
    link_stiffness_ = omega * omega * reduced_mass;
    link_damping_ = 2 * spec.structural_mode->damping_ratio * omega * reduced_mass;
    half_backlash_ = 0.5 * spec.backlash;
  }
  motor_ = {start_a, Vec3::Zero(), moving.cwiseQuotient(motor_mass)};

  if (spec.actuator_bandwidth_hz > 0) lag_time_constant_ = 1 / (2 * std::numbers::pi * spec.actuator_bandwidth_hz);
  viscous_ = spec.viscous;
  coulomb_ = spec.coulomb;
  if (spec.static_ratio > 1) {
    stribeck_gain_ = spec.static_ratio - 1;
    inverse_stribeck_velocity_ = 1 / spec.stribeck_velocity;
  }
  bristle_stiffness_ = spec.presliding_stiffness;
  bristle_damping_ = spec.presliding_damping;

  bias_ = rotation_ * spec.gravity_bias;
  gradient_ = rotation_ * spec.gravity_gradient * rotation_.transpose();
  has_gradient_ = !spec.gravity_gradient.isZero(0);
  has_cogging_ = !spec.cogging.isZero(0);
  cogging_ = spec.cogging;
  if (has_cogging_) cogging_wave_number_ = 2 * std::numbers::pi / spec.cogging_period;

  workspace_ = spec.workspace;
  const double nearest = std::min(spec.workspace.max.minCoeff(), (-spec.workspace.min).minCoeff());
  safe_radius_squared_ = nearest > 0 ? nearest * nearest : 0;
  wall_mass_ = motor_mass.minCoeff();

  if (spec.hand) {
    hand_ = {rotation_ * start, Vec3::Zero(), Vec3::Constant(1 / spec.hand->mass)};
    grip_stiffness_ = spec.hand->grip_stiffness;
    grip_damping_ = spec.hand->grip_damping;
    arm_stiffness_ = spec.hand->arm_stiffness;
    arm_relaxation_ = spec.hand->arm_relaxation;
    arm_damping_ = spec.hand->arm_damping;
    if (follows_intent) {
      intent_stiffness_ = spec.hand->intent_stiffness;
      intent_damping_ = spec.hand->intent_damping;
    }
  }

  longest_step_ = std::min(longest_step, stable_step());
  const Friction friction = spec.coulomb.isZero(0)                ? Friction::none
                            : spec.presliding_stiffness.isZero(0) ? Friction::rigid
                                                                  : Friction::lugre;
  advance_ = choose(friction, structure_, spec.hand.has_value());
}

double Plant::stable_step() const {
  const Vec3 grip_k = Vec3::Constant(grip_stiffness_), grip_b = Vec3::Constant(grip_damping_);
  const Vec3 fields = Vec3::Constant(gradient_.cwiseAbs().rowwise().sum().maxCoeff()) + cogging_ * cogging_wave_number_;
  const Vec3 arm_k = Vec3::Constant(arm_stiffness_ + intent_stiffness_);
  const Vec3 arm_b = Vec3::Constant(arm_damping_ + intent_damping_);

  // Gershgorin: no eigenvalue exceeds twice a body's stiffness (damping) over its mass.
  const auto step = [](const Vec3& inverse_mass, const Vec3& stiffness, const Vec3& damping) {
    const double rate_squared = 2 * inverse_mass.cwiseProduct(stiffness).maxCoeff();
    const double rate = 2 * inverse_mass.cwiseProduct(damping).maxCoeff();
    return kFinest / std::max({std::sqrt(rate_squared), rate, 1e-9});
  };
  const Vec3 motor_grip_k = structure_ ? link_stiffness_ : grip_k, motor_grip_b = structure_ ? link_damping_ : grip_b;
  return std::min({step(motor_.inverse_mass, motor_grip_k + fields, motor_grip_b),
                   step(handle_.inverse_mass, link_stiffness_ + grip_k, link_damping_ + grip_b),
                   step(hand_.inverse_mass, grip_k + arm_k, grip_b + arm_b)});
}

void Plant::prepare(double h) noexcept {
  if (h == step_.h) return;
  step_.h = h;
  if (lag_time_constant_ > 0) {
    step_.lag_decay = std::exp(-h / lag_time_constant_);
    step_.lag_mean = (1 - step_.lag_decay) * lag_time_constant_ / h;
  }
  step_.arm_decay = arm_relaxation_ > 0 ? std::exp(-h / arm_relaxation_) : 1;
  step_.arm_gain = arm_stiffness_ * (arm_relaxation_ > 0 ? (1 - step_.arm_decay) * arm_relaxation_ : h);
  // A soft bristle is a spring as any other, without numerical damping; a stiff one is as implicit as it has to be.
  step_.theta = (h * h * motor_.inverse_mass.cwiseProduct(bristle_stiffness_)).cwiseMin(1.0);
}

double Plant::sliding_force(int axis, double speed) const noexcept {
  if (stribeck_gain_ == 0) return coulomb_[axis];
  const double s = speed * inverse_stribeck_velocity_;
  return coulomb_[axis] * (1 + stribeck_gain_ * std::exp(-s * s));
}

Vec3 Plant::position_force(const Vec3& x) const noexcept {
  Vec3 force = bias_;
  if (has_gradient_) force += gradient_ * x;
  if (has_cogging_)
    for (int axis = 0; axis < 3; ++axis) force[axis] -= cogging_[axis] * std::sin(cogging_wave_number_ * x[axis]);
  return force;
}

/// The new velocity under `force` and friction, which are solved for together:
/// v' = v + h / m (force - b v' - F_friction(v')).
template <Plant::Friction friction>
void Plant::move_motor(const Vec3& force) noexcept {
  const double h = step_.h;
  for (int axis = 0; axis < 3; ++axis) {
    const double w = h * motor_.inverse_mass[axis];
    const double free = motor_.v[axis] + w * force[axis];
    const double viscous = 1 + w * viscous_[axis];
    double& v = motor_.v[axis];

    if (friction == Friction::none || coulomb_[axis] == 0) {
      v = free / viscous;
    } else if constexpr (friction == Friction::rigid) {
      const double slip = std::abs(free) - w * sliding_force(axis, std::abs(v));
      v = slip > 0 ? std::copysign(slip, free) / viscous : 0.0;
    } else {
      // The bristle relaxes at the rate of a speed known beforehand (exactly, by an exponential) and stretches with the
      // speed to be found, which makes the friction linear in it. The speed beforehand is the larger of the old one and
      // the one that rigid friction would leave: a push that breaks it loose is not held back for a step.
      const double sigma0 = bristle_stiffness_[axis], theta = step_.theta[axis];
      const double g = sliding_force(axis, std::abs(v));
      const double rate = sigma0 * std::max(std::abs(v), std::abs(free) - w * g) / g;
      const double decay = std::exp(-rate * h);
      const double stretch = rate * h > 1e-6 ? (1 - decay) / rate : h;
      const double held = sigma0 * (1 - theta + theta * decay) - bristle_damping_ * (1 - decay) / h;
      const double slope = stretch * (theta * sigma0 + bristle_damping_ / h);
      v = (free - w * held * bristle_[axis]) / (viscous + w * slope);
      bristle_[axis] = decay * bristle_[axis] + stretch * v;
    }
  }
}

/// A stiff, damped wall beyond each side of the workspace, implicit in the velocity.
void Plant::push_back_from_walls() noexcept {
  if (motor_.x.squaredNorm() < safe_radius_squared_) return;
  const Vec3 p = rotation_.transpose() * motor_.x;
  const Vec3 depth = p - p.cwiseMax(workspace_.min).cwiseMin(workspace_.max);
  if (depth.isZero(0)) return;
  const double w = step_.h / wall_mass_;
  const double resistance = 1 + w * 2 * std::sqrt(kWallStiffness * wall_mass_) + w * step_.h * kWallStiffness;
  Vec3 v = rotation_.transpose() * motor_.v;
  for (int axis = 0; axis < 3; ++axis)
    if (depth[axis] != 0) v[axis] = (v[axis] - w * kWallStiffness * depth[axis]) / resistance;
  motor_.v = rotation_ * v;
}

template <Plant::Friction friction, bool structure, bool hand>
void Plant::advance_as(double span, const PlantInput& input) noexcept {
  const double steps = std::max(1.0, std::ceil(span / longest_step_ * (1 - 1e-9)));
  prepare(span / steps);
  const double h = step_.h;
  Vec3 hand_force = input.hand_force, intent = input.intent;

  for (double left = steps; left > 0; --left) {
    Vec3 force = input.command;
    if (lag_time_constant_ > 0) {
      const Vec3 lacking = motor_force_ - input.command;
      force += step_.lag_mean * lacking;
      motor_force_ = input.command + step_.lag_decay * lacking;
    }
    const Vec3 of_motors = force;
    force += position_force(motor_.x);

    Vec3 on_handle = Vec3::Zero();
    if constexpr (structure) {
      const Vec3 stretch = motor_.x - handle_.x, play = beyond_play(stretch, half_backlash_);
      on_handle = link_stiffness_.cwiseProduct(play);
      for (int axis = 0; axis < 3; ++axis)
        if (half_backlash_ == 0 || play[axis] != 0)
          on_handle[axis] += link_damping_[axis] * (motor_.v[axis] - handle_.v[axis]);
      force -= on_handle;
    }
    if constexpr (hand) {
      const Body& held = structure ? handle_ : motor_;
      contact_force_ = grip_stiffness_ * (held.x - hand_.x) + grip_damping_ * (held.v - hand_.v);
      if constexpr (structure)
        on_handle -= contact_force_;
      else
        force -= contact_force_;

      const Vec3 behind = input.intent_velocity - hand_.v;
      arm_force_ = step_.arm_decay * arm_force_ + step_.arm_gain * behind;
      const Vec3 on_hand = contact_force_ + arm_force_ + (arm_damping_ + intent_damping_) * behind +
                           intent_stiffness_ * (intent - hand_.x) + hand_force;
      hand_.v += h * hand_.inverse_mass.cwiseProduct(on_hand);
      hand_.x += h * hand_.v;
      intent += h * input.intent_velocity;
      hand_force += h * input.hand_force_rate;
    }

    move_motor<friction>(force);
    push_back_from_walls();
    motor_.x += h * motor_.v;
    motor_work_ += h * of_motors.dot(motor_.v);
    if constexpr (structure) {
      handle_.v += h * handle_.inverse_mass.cwiseProduct(on_handle);
      handle_.x += h * handle_.v;
    }
  }
}

Plant::Advance Plant::choose(Friction friction, bool structure, bool hand) {
  const auto with = [&]<Friction kind>() -> Advance {
    if (structure) return hand ? &Plant::advance_as<kind, true, true> : &Plant::advance_as<kind, true, false>;
    return hand ? &Plant::advance_as<kind, false, true> : &Plant::advance_as<kind, false, false>;
  };
  switch (friction) {
    case Friction::rigid:
      return with.operator()<Friction::rigid>();
    case Friction::lugre:
      return with.operator()<Friction::lugre>();
    case Friction::none:
      break;
  }
  return with.operator()<Friction::none>();
}

double Plant::energy() const noexcept {
  const auto kinetic = [](const Body& body) {
    double energy = 0;
    for (int axis = 0; axis < 3; ++axis)
      if (body.inverse_mass[axis] > 0) energy += 0.5 * body.v[axis] * body.v[axis] / body.inverse_mass[axis];
    return energy;
  };
  double energy = kinetic(motor_) + kinetic(handle_) + kinetic(hand_);
  energy -= bias_.dot(motor_.x) + 0.5 * motor_.x.dot(gradient_ * motor_.x);
  energy += 0.5 * bristle_.dot(bristle_stiffness_.cwiseProduct(bristle_));
  if (has_cogging_)
    for (int axis = 0; axis < 3; ++axis)
      energy -= cogging_[axis] / cogging_wave_number_ * std::cos(cogging_wave_number_ * motor_.x[axis]);
  if (structure_) {
    const Vec3 stretch = beyond_play(motor_.x - handle_.x, half_backlash_);
    energy += 0.5 * stretch.dot(link_stiffness_.cwiseProduct(stretch));
  }
  energy += 0.5 * grip_stiffness_ * (handle_position() - hand_.x).squaredNorm();
  if (arm_stiffness_ > 0) energy += 0.5 * arm_force_.squaredNorm() / arm_stiffness_;
  return energy;
}

}  // namespace haptrace
