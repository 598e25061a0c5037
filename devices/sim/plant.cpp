#include "devices/sim/plant.h"

#include "base/error.h"
#include "control/norm.h"
#include "control/rotation.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

constexpr double kWallStiffness = 2e4;  // [N/m]

// Largest step times natural frequency, or times damping over mass. Keeps a spring's period accurate to half a per
// cent.
constexpr double kFinest = 0.3;

// Share of the stability limit for an integrator by matrices. With it, a force held over the step still moves a body in
// its own direction: a step contains less than half a period of the fastest mode.
constexpr double kPartOfLimit = 0.8;

constexpr double kShortestStep = 1e-9;  // [s]
constexpr std::size_t kStepsKnown = 4;  // the delay and the hand's decisions divide a period

/// Returns a spring's stretch beyond a backlash of `half` on each side.
Vec3 beyond_play(const Vec3& stretch, double half) {
  return stretch - stretch.cwiseMax(-half).cwiseMin(half);
}

}  // namespace

Plant::Plant(const SimSpec& spec, const Vec3& start, bool follows_intent, double longest_step, Integrator integrator)
    : rotation_(quaternion(spec.rotation).toRotationMatrix()),
      integrator_(integrator),
      structure_(spec.structural_mode.has_value()) {
  Vec3 moving = Vec3::Zero();
  for (int axis = 0; axis < 3; ++axis) moving[axis] = spec.axes[static_cast<std::size_t>(axis)] ? 1 : 0;
  place_bodies(spec, rotation_ * start.cwiseProduct(moving), moving);
  if (spec.actuator_bandwidth_hz > 0) lag_time_constant_ = 1 / (2 * std::numbers::pi * spec.actuator_bandwidth_hz);
  take_friction(spec);
  take_position_forces(spec);

  workspace_ = spec.workspace;
  const double nearest = std::min(spec.workspace.max.minCoeff(), (-spec.workspace.min).minCoeff());
  safe_radius_squared_ = nearest > 0 ? nearest * nearest : 0;
  wall_mass_ = motor_mass_.minCoeff();

  if (spec.hand) take_hand(*spec.hand, start, follows_intent);

  const bool by_matrices = integrator != Integrator::semi_implicit;
  longest_step_ = std::min(longest_step, longest_good_step(spec.model, by_matrices));
  if (by_matrices) linear_.resize(kStepsKnown);
  const Friction friction = spec.coulomb.isZero(0)                ? Friction::none
                            : spec.presliding_stiffness.isZero(0) ? Friction::rigid
                                                                  : Friction::lugre;
  advance_ = choose(friction, structure_, spec.hand.has_value(), by_matrices);
}

/// Places the motors and, if the structure is elastic, the handle at `start`, at rest. `moving` is 0 on an axis that is
/// held, else 1.
void Plant::place_bodies(const SimSpec& spec, const Vec3& start, const Vec3& moving) {
  Vec3 motor_mass = spec.mass;
  if (spec.structural_mode) {
    const Vec3 handle_mass = spec.structural_mode->handle_fraction * spec.mass;
    motor_mass -= handle_mass;
    handle_ = {start, Vec3::Zero(), moving.cwiseQuotient(handle_mass)};
    const double omega = 2 * std::numbers::pi * spec.structural_mode->frequency_hz;
    const Vec3 reduced_mass = motor_mass.cwiseProduct(handle_mass).cwiseQuotient(spec.mass);
    link_stiffness_ = omega * omega * reduced_mass;
    link_damping_ = 2 * spec.structural_mode->damping_ratio * omega * reduced_mass;
    half_backlash_ = 0.5 * spec.backlash;
  }
  motor_ = {start, Vec3::Zero(), moving.cwiseQuotient(motor_mass)};
  motor_mass_ = motor_mass;
  inertia_variation_ = spec.inertia_variation;
  inertia_wave_number_ = std::numbers::pi / spec.inertia_length;
}

void Plant::take_friction(const SimSpec& spec) {
  viscous_ = spec.viscous;
  coulomb_ = spec.coulomb;
  if (spec.static_ratio > 1) {
    stribeck_gain_ = spec.static_ratio - 1;
    inverse_stribeck_velocity_ = 1 / spec.stribeck_velocity;
  }
  bristle_stiffness_ = spec.presliding_stiffness;
  bristle_damping_ = spec.presliding_damping;
}

void Plant::take_position_forces(const SimSpec& spec) {
  bias_ = rotation_ * spec.gravity_bias;
  gradient_ = rotation_ * spec.gravity_gradient * rotation_.transpose();
  has_gradient_ = !spec.gravity_gradient.isZero(0);
  has_cogging_ = !spec.cogging.isZero(0);
  cogging_ = spec.cogging;
  if (has_cogging_) cogging_wave_number_ = 2 * std::numbers::pi / spec.cogging_period;
}

void Plant::take_hand(const HandSpec& hand, const Vec3& start, bool follows_intent) {
  hand_ = {rotation_ * start, Vec3::Zero(), Vec3::Constant(1 / hand.mass)};
  grip_stiffness_ = hand.grip_stiffness;
  grip_damping_ = hand.grip_damping;
  arm_stiffness_ = hand.arm_stiffness;
  arm_relaxation_ = hand.arm_relaxation;
  arm_damping_ = hand.arm_damping;
  if (follows_intent) {
    intent_stiffness_ = full_intent_stiffness_ = hand.intent_stiffness;
    intent_damping_ = full_intent_damping_ = hand.intent_damping;
  }
}

/// Returns the longest step with which the integrator is accurate, or, by matrices, stable [s]. Throws Error(input) if
/// there is none.
double Plant::longest_good_step(const std::string& model, bool by_matrices) const {
  if (by_matrices && inertia_variation_ > 0)
    throw input_error(
        fmt::format("integrator {}: the mass of the {} varies with the place (inertia), and the matrices of this "
                    "integrator are those of one mass; use {}",
                    to_string(integrator_), model, to_string(Integrator::semi_implicit)));
  const double stable = by_matrices ? stable_step() : accurate_step();
  if (by_matrices && !(stable >= kShortestStep))
    throw input_error(
        fmt::format("integrator {}: no step is stable for the {}, because some of its springs have almost no damping; "
                    "add damping, or use another integrator",
                    to_string(integrator_), model));
  return stable;
}

void Plant::follow_intent(double share) noexcept {
  const double stiffness = share * full_intent_stiffness_;
  if (stiffness == intent_stiffness_) return;
  intent_stiffness_ = stiffness;
  intent_damping_ = share * full_intent_damping_;
  for (LinearSteps& known : linear_) known.h = 0;
}

/// Returns an upper bound of the stiffness of the position-dependent forces [N/m].
Vec3 Plant::field_stiffness() const {
  return Vec3::Constant(gradient_.cwiseAbs().rowwise().sum().maxCoeff()) + cogging_ * cogging_wave_number_;
}

double Plant::accurate_step() const {
  const Vec3 grip_k = Vec3::Constant(grip_stiffness_), grip_b = Vec3::Constant(grip_damping_);
  const Vec3 fields = field_stiffness();
  const Vec3 arm_k = Vec3::Constant(arm_stiffness_ + intent_stiffness_);
  const Vec3 arm_b = Vec3::Constant(arm_damping_ + intent_damping_);

  // Gershgorin: no eigenvalue exceeds twice a body's stiffness (or damping) over its mass.
  const auto step = [](const Vec3& inverse_mass, const Vec3& stiffness, const Vec3& damping) {
    const double rate_squared = 2 * inverse_mass.cwiseProduct(stiffness).maxCoeff();
    const double rate = 2 * inverse_mass.cwiseProduct(damping).maxCoeff();
    return kFinest / std::max({std::sqrt(rate_squared), rate, 1e-9});
  };
  const Vec3 lightest = motor_.inverse_mass / (1 - inertia_variation_);
  const Vec3 motor_grip_k = structure_ ? link_stiffness_ : grip_k, motor_grip_b = structure_ ? link_damping_ : grip_b;
  return std::min({step(lightest, motor_grip_k + fields, motor_grip_b),
                   step(handle_.inverse_mass, link_stiffness_ + grip_k, link_damping_ + grip_b),
                   step(hand_.inverse_mass, grip_k + arm_k, grip_b + arm_b)});
}

/// Returns a step that is stable in every state of the chain. The forces held over a step count among its springs.
double Plant::stable_step() const {
  const Vec3 fields = field_stiffness();
  if (integrator_ == Integrator::implicit) {
    const double fastest =
        std::max(motor_.inverse_mass.cwiseProduct(fields).maxCoeff(), hand_.inverse_mass.maxCoeff() * arm_stiffness_);
    return kFinest / std::max(std::sqrt(2 * fastest), 1e-9);
  }
  // At verlet's own limit, its first half-kick may reverse a damped velocity, which makes friction and walls unstable.
  const Integrator bounding = integrator_ == Integrator::verlet  ? Integrator::semi_implicit
                              : integrator_ == Integrator::exact ? Integrator::verlet
                                                                 : integrator_;
  double limit = std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis)
    for (const bool linked : {true, false})
      for (const bool held : {true, false}) {
        LinearBodies chain = bodies(axis, linked || half_backlash_ == 0, held);
        chain.tie(0, fields[axis], 0);
        chain.tie(chain.size() - 1, arm_stiffness_, 0);
        limit = std::min(limit, stability_limit(bounding, chain));
      }
  return kPartOfLimit * limit;
}

/// Returns the motors, handle and hand along an axis, as far as they exist.
LinearBodies Plant::bodies(int axis, bool linked, bool held) const noexcept {
  const bool hand = hand_.inverse_mass[axis] > 0;
  const int handle = structure_ ? 1 : 0, last = handle + (hand ? 1 : 0);
  LinearBodies chain(last + 1);
  chain.inverse_mass[0] = motor_.inverse_mass[axis];
  chain.tie(0, 0, viscous_[axis]);
  if (structure_) {
    chain.inverse_mass[handle] = handle_.inverse_mass[axis];
    if (linked) chain.connect(0, handle, link_stiffness_[axis], link_damping_[axis]);
  }
  if (hand) {
    chain.inverse_mass[last] = hand_.inverse_mass[axis];
    chain.tie(last, intent_stiffness_, intent_damping_ + arm_damping_);
    if (held) chain.connect(handle, last, grip_stiffness_, grip_damping_);
  }
  return chain;
}

const Plant::LinearSteps& Plant::linear_steps(double h) noexcept {
  for (const LinearSteps& known : linear_)
    if (known.h == h) return known;
  LinearSteps& steps = linear_[oldest_linear_];
  oldest_linear_ = (oldest_linear_ + 1) % linear_.size();
  steps.h = h;
  for (int axis = 0; axis < 3; ++axis) {
    const auto at = static_cast<std::size_t>(axis);
    steps.linked[at] = linear_step(integrator_, bodies(axis, true, true), h);
    steps.apart[at] = half_backlash_ > 0 ? linear_step(integrator_, bodies(axis, false, true), h) : steps.linked[at];
  }
  return steps;
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
  step_.arm_half_decay = std::sqrt(step_.arm_decay);
  step_.arm_half_gain = arm_stiffness_ * (arm_relaxation_ > 0 ? (1 - step_.arm_half_decay) * arm_relaxation_ : 0.5 * h);
  // A soft bristle is an ordinary spring, without numerical damping. A stiff one is only as implicit as necessary.
  const double lightest = 1 - inertia_variation_;  // of the spec's mass
  step_.theta = (h * h / lightest * motor_.inverse_mass.cwiseProduct(bristle_stiffness_)).cwiseMin(1.0);
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

/// Returns s, the motors' mass over that of the spec.
double Plant::mass_scale(const Vec3& x) const noexcept {
  return inertia_variation_ > 0 ? 1 + inertia_variation_ * std::cos(inertia_wave_number_ * norm_of(x)) : 1;
}

/// Returns the force of the motors' motion through places of other mass.
Vec3 Plant::inertia_force() const noexcept {
  if (inertia_variation_ == 0) return Vec3::Zero();
  const double distance = norm_of(motor_.x);
  if (distance == 0) return Vec3::Zero();
  const Vec3& v = motor_.v;
  const Vec3 momentum = motor_mass_.cwiseProduct(v);
  const Vec3 slope =
      -inertia_variation_ * inertia_wave_number_ * std::sin(inertia_wave_number_ * distance) / distance * motor_.x;
  return 0.5 * momentum.dot(v) * slope - slope.dot(v) * momentum;
}

/// Returns the velocity that remains of `free` after friction and a viscous damper of (`viscous` - 1) / w. All other
/// forces change the motor's velocity from `before` to `free` within a step. The friction is a force held over the
/// step, and w is the change of velocity per force. Both are solved for together: v = free - w (b v + F_friction(v)).
template <Plant::Friction friction>
double Plant::braked(int axis, double before, double free, double w, double viscous) noexcept {
  if (friction == Friction::none || coulomb_[axis] == 0) return free / viscous;
  if constexpr (friction == Friction::rigid) {
    const double slip = std::abs(free) - w * sliding_force(axis, std::abs(before));
    return slip > 0 ? std::copysign(slip, free) / viscous : 0.0;
  } else {
    // The bristle relaxes at the rate of a speed that is known beforehand (exactly, by an exponential) and stretches
    // with the unknown speed, which makes the friction linear in that speed. The known speed is the larger of the old
    // one and the one that rigid friction would leave, so that a push that breaks the bristle loose is not delayed by a
    // step.
    const double h = step_.h, sigma0 = bristle_stiffness_[axis], theta = step_.theta[axis];
    const double g = sliding_force(axis, std::abs(before));
    const double rate = sigma0 * std::max(std::abs(before), std::abs(free) - w * g) / g;
    const double decay = std::exp(-rate * h);
    const double stretch = rate * h > 1e-6 ? (1 - decay) / rate : h;
    const double held = sigma0 * (1 - theta + theta * decay) - bristle_damping_ * (1 - decay) / h;
    const double slope = stretch * (theta * sigma0 + bristle_damping_ / h);
    const double v = (free - w * held * bristle_[axis]) / (viscous + w * slope);
    bristle_[axis] = decay * bristle_[axis] + stretch * v;
    return v;
  }
}

/// Applies a stiff, damped wall beyond each side of the workspace, implicit in the velocity; w is the change of
/// velocity per force.
void Plant::push_back_from_walls(double w) noexcept {
  if (motor_.x.squaredNorm() < safe_radius_squared_) return;
  const Vec3 p = rotation_.transpose() * motor_.x;
  const Vec3 depth = p - p.cwiseMax(workspace_.min).cwiseMin(workspace_.max);
  if (depth.isZero(0)) return;
  const double resistance = 1 + w * 2 * std::sqrt(kWallStiffness * wall_mass_) + w * step_.h * kWallStiffness;
  Vec3 v = rotation_.transpose() * motor_.v;
  for (int axis = 0; axis < 3; ++axis)
    if (depth[axis] != 0) v[axis] = (v[axis] - w * kWallStiffness * depth[axis]) / resistance;
  motor_.v = rotation_ * v;
}

double Plant::steps_in(double span) const noexcept {
  return std::max(1.0, std::ceil(span / longest_step_ * (1 - 1e-9)));
}

/// Returns the mean force on the mechanism over a step, while the motors lag behind their command.
Vec3 Plant::motor_force_over_step(const Vec3& command) noexcept {
  if (lag_time_constant_ == 0) return command;
  const Vec3 lacking = motor_force_ - command;
  motor_force_ = command + step_.lag_decay * lacking;
  return command + step_.lag_mean * lacking;
}

template <Plant::Friction friction, bool structure, bool hand>
void Plant::advance_as(double span, const PlantInput& input) noexcept {
  const double steps = steps_in(span);
  prepare(span / steps);
  const double h = step_.h;
  Vec3 hand_force = input.hand_force, intent = input.intent;

  for (double left = steps; left > 0; --left) {
    const Vec3 of_motors = motor_force_over_step(input.command);
    const double mass_scale = this->mass_scale(motor_.x);
    Vec3 force = of_motors;
    force += position_force(motor_.x) + inertia_force();

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

    for (int axis = 0; axis < 3; ++axis) {
      const double w = h * motor_.inverse_mass[axis] / mass_scale;
      double& v = motor_.v[axis];
      v = braked<friction>(axis, v, v + w * force[axis], w, 1 + w * viscous_[axis]);
    }
    push_back_from_walls(h / (wall_mass_ * mass_scale));
    motor_.x += h * motor_.v;
    motor_work_ += h * of_motors.dot(motor_.v);
    if constexpr (structure) {
      handle_.v += h * handle_.inverse_mass.cwiseProduct(on_handle);
      handle_.x += h * handle_.v;
    }
  }
}

/// The bodies of every axis, each as a chain, over one step.
template <bool structure, bool hand>
struct Plant::Chains {
  static constexpr int kBodies = 1 + structure + hand, kMotor = 0, kHandle = structure ? 1 : 0, kHand = kBodies - 1;
  using State = Eigen::Matrix<double, 2 * kBodies, 1>;
  using Forces = Eigen::Matrix<double, kBodies, 1>;
  using Phi = Eigen::Map<const Eigen::Matrix<double, 2 * kBodies, 2 * kBodies>>;
  using Gamma = Eigen::Map<const Eigen::Matrix<double, 2 * kBodies, kBodies>>;

  std::array<State, 3> next;                   ///< positions and then velocities at the end of the step
  std::array<const LinearStep*, 3> of_axis{};  ///< its matrices
  Vec3 free;                                   ///< velocity of the motors at its end without friction and walls [m/s]
};

/// Advances the chains by a step without friction and walls, and the velocity of the motors with friction. The forces
/// are held over the step [N].
template <Plant::Friction friction, bool structure, bool hand>
[[gnu::always_inline]] inline void Plant::advance_chains(const LinearSteps& linear, const Vec3& on_motor,
                                                         const Vec3& on_hand,
                                                         Chains<structure, hand>& chains) noexcept {
  using Chain = Chains<structure, hand>;
  constexpr int kBodies = Chain::kBodies, kMotor = Chain::kMotor, kHandle = Chain::kHandle, kHand = Chain::kHand;
  Vec3 play = Vec3::Zero();
  if constexpr (structure) play = beyond_play(motor_.x - handle_.x, half_backlash_);
  for (int axis = 0; axis < 3; ++axis) {
    const auto at = static_cast<std::size_t>(axis);
    const bool linked = !structure || half_backlash_ == 0 || play[axis] != 0;
    const LinearStep& step = linked ? linear.linked[at] : linear.apart[at];
    chains.of_axis[at] = &step;
    typename Chain::State x = Chain::State::Zero();
    typename Chain::Forces f = Chain::Forces::Zero();
    x[kMotor] = motor_.x[axis], x[kBodies + kMotor] = motor_.v[axis];
    f[kMotor] = on_motor[axis];
    if constexpr (structure) {
      x[kHandle] = handle_.x[axis], x[kBodies + kHandle] = handle_.v[axis];
      // The spring in the matrices has no backlash: correct its force.
      const double too_much = linked ? link_stiffness_[axis] * (x[kMotor] - x[kHandle] - play[axis]) : 0;
      f[kMotor] += too_much;
      f[kHandle] -= too_much;
    }
    if constexpr (hand) {
      x[kHand] = hand_.x[axis], x[kBodies + kHand] = hand_.v[axis];
      f[kHand] = on_hand[axis];
    }
    chains.next[at] = typename Chain::Phi(step.phi.data()) * x + typename Chain::Gamma(step.gamma.data()) * f;
    chains.free[axis] = chains.next[at][kBodies + kMotor];
    motor_.v[axis] = braked<friction>(axis, motor_.v[axis], chains.free[axis], step.gamma(kBodies, 0), 1);
  }
}

/// Moves the bodies to the end of the step. Applies friction and walls as the force that, held over the step, leaves
/// the velocity of the motors.
template <bool structure, bool hand>
[[gnu::always_inline]] inline void Plant::end_step(Chains<structure, hand>& chains) noexcept {
  using Chain = Chains<structure, hand>;
  constexpr int kBodies = Chain::kBodies, kMotor = Chain::kMotor, kHandle = Chain::kHandle, kHand = Chain::kHand;
  for (int axis = 0; axis < 3; ++axis) {
    const auto at = static_cast<std::size_t>(axis);
    typename Chain::State& next = chains.next[at];
    const LinearStep& step = *chains.of_axis[at];
    const double by_force = step.gamma(kBodies, 0), change = motor_.v[axis] - chains.free[axis];
    if (change != 0 && by_force != 0)
      next += typename Chain::Gamma(step.gamma.data()).col(kMotor) * (change / by_force);
    motor_.x[axis] = next[kMotor];
    if constexpr (structure) handle_.x[axis] = next[kHandle], handle_.v[axis] = next[kBodies + kHandle];
    if constexpr (hand) hand_.x[axis] = next[kHand], hand_.v[axis] = next[kBodies + kHand];
  }
}

template <Plant::Friction friction, bool structure, bool hand>
void Plant::advance_by_matrices(double span, const PlantInput& input) noexcept {
  const double steps = steps_in(span);
  prepare(span / steps);
  const double h = step_.h;
  const LinearSteps& linear = linear_steps(h);
  Vec3 mobility;  // change of the motor's velocity at the step's end per force held over the step
  for (int axis = 0; axis < 3; ++axis)
    mobility[axis] = linear.linked[static_cast<std::size_t>(axis)].gamma(Chains<structure, hand>::kBodies, 0);
  Vec3 hand_force = input.hand_force, intent = input.intent;

  for (double left = steps; left > 0; --left) {
    const Vec3 of_motors = motor_force_over_step(input.command);
    const Vec3 on_motor = of_motors + position_force(motor_.x + 0.5 * h * motor_.v);
    Vec3 on_hand = Vec3::Zero();
    if constexpr (hand) {
      const Vec3 arm = step_.arm_half_decay * arm_force_ + step_.arm_half_gain * (input.intent_velocity - hand_.v);
      on_hand = arm + (arm_damping_ + intent_damping_) * input.intent_velocity +
                intent_stiffness_ * (intent + 0.5 * h * input.intent_velocity) + hand_force +
                0.5 * h * input.hand_force_rate;
      intent += h * input.intent_velocity;
      hand_force += h * input.hand_force_rate;
    }
    const Vec3 motor_before = motor_.x, hand_before = hand_.x;
    Chains<structure, hand> chains;
    advance_chains<friction>(linear, on_motor, on_hand, chains);
    push_back_from_walls(mobility.maxCoeff());
    end_step(chains);
    motor_work_ += of_motors.dot(motor_.x - motor_before);
    if constexpr (hand)
      arm_force_ =
          step_.arm_decay * arm_force_ + step_.arm_gain * (input.intent_velocity - (hand_.x - hand_before) / h);
  }
  if constexpr (hand) {
    const Body& held = structure ? handle_ : motor_;
    contact_force_ = grip_stiffness_ * (held.x - hand_.x) + grip_damping_ * (held.v - hand_.v);
  }
}

Plant::Advance Plant::choose(Friction friction, bool structure, bool hand, bool by_matrices) {
  const auto with = [&]<Friction kind>() -> Advance {
    const auto moved_by = [&]<bool has_structure, bool has_hand>() -> Advance {
      return by_matrices ? &Plant::advance_by_matrices<kind, has_structure, has_hand>
                         : &Plant::advance_as<kind, has_structure, has_hand>;
    };
    if (structure)
      return hand ? moved_by.template operator()<true, true>() : moved_by.template operator()<true, false>();
    return hand ? moved_by.template operator()<false, true>() : moved_by.template operator()<false, false>();
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
  double energy = mass_scale(motor_.x) * kinetic(motor_) + kinetic(handle_) + kinetic(hand_);
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
