// The mechanism of a simulated device and the hand that holds it: equations of motion.
#pragma once

#include "devices/sim/linear_step.h"
#include "devices/sim/spec.h"

#include <array>
#include <vector>

namespace haptrace {

/// What acts on a plant, in actuator axes.
struct PlantInput {
  Vec3 command = Vec3::Zero();          ///< reaches the motors now [N]
  Vec3 hand_force = Vec3::Zero();       ///< tremor and drift, on the hand [N]
  Vec3 hand_force_rate = Vec3::Zero();  ///< [N/s]
  Vec3 intent = Vec3::Zero();           ///< where the hand means to be [m]
  Vec3 intent_velocity = Vec3::Zero();  ///< [m/s]
};

/// Up to three bodies in a chain, each a point mass in space: motors (x, v), handle (behind the structural mode's
/// spring), hand (behind the grip):
///
///     m v' = u + F_bias + G x - F_cog sin(2 pi x / period) - b v - F_friction + F_wall - F_grip
///     m_h v_h' = F_grip + F_arm + k_i (x_i - x_h) + b_i (v_i - v_h) + F_tremor
///     F_grip = k_g (x - x_h) + b_g (v - v_h),   F_arm' = k_a (v_i - v_h) - F_arm / tau
///
/// Friction is LuGre's (Canudas de Wit, Olsson, Astrom and Lischinsky 1995) when presliding is given,
///
///     z' = v - sigma_0 |v| z / g(v),   F = sigma_0 z + sigma_1 z',   g(v) = F_c (1 + (r - 1) exp(-(v / v_s)^2)),
///
/// else it sticks rigidly up to g(0). Steps are semi-implicit Euler; friction, viscous damping and walls are implicit
/// in the velocity, so that no stiffness of theirs can make the step unstable.
///
/// Any other integrator moves the linear part of every axis, which is its bodies with their springs, dampers and b, by
/// its own matrices (linear_step; those of bodies that the link does not connect while they are within the play). All
/// else is a force that is held over the step: cogging, gravity's gradient and the arm's spring where the body would be
/// half-way if it went on at its speed, tremor and intent half-way, the motor's mean. With that, smooth movements keep
/// the integrator's order up to 2, and all of it where nothing but the linear part and the bias acts. Friction is the
/// held force that makes it hold with the velocity at the step's end, and walls follow it: order 1 where friction turns
/// or sticks, where play ends and at walls, whatever the integrator.
///
/// Everything here is expressed in actuator axes: p_A = R p_W. Only what a spec names is computed.
/// Real-time: advance, let_go.
class Plant {
 public:
  /// At rest with every body at `start` (W). Without `follows_intent` the hand's intent springs are left out.
  /// `longest_step` [s] bounds a step; stiff springs and dampers may ask for a shorter one: semi_implicit for an
  /// accurate one; euler and rk4 for four fifths of their limits, verlet for as much of semi_implicit's and exact of
  /// verlet's, so that friction and walls brake within a step; implicit for cogging, gravity and the arm only. Throws
  /// Error(input) when no step is stable: euler where a spring has no damper.
  Plant(const SimSpec& spec, const Vec3& start, bool follows_intent, double longest_step,
        Integrator integrator = Integrator::semi_implicit);

  /// Moves on by `span` [s] in equal steps.
  void advance(double span, const PlantInput& input) noexcept { (this->*advance_)(span, input); }

  [[nodiscard]] const Eigen::Matrix3d& rotation() const noexcept { return rotation_; }  ///< R: p_A = R p_W
  [[nodiscard]] const Vec3& motor_position() const noexcept { return motor_.x; }        ///< what encoders see [m]
  [[nodiscard]] const Vec3& motor_velocity() const noexcept { return motor_.v; }
  [[nodiscard]] const Vec3& handle_position() const noexcept { return structure_ ? handle_.x : motor_.x; }
  [[nodiscard]] const Vec3& handle_velocity() const noexcept { return structure_ ? handle_.v : motor_.v; }
  [[nodiscard]] const Vec3& hand_position() const noexcept { return hand_.x; }

  /// Of the handle on the hand; zero when nobody holds it [N].
  [[nodiscard]] const Vec3& contact_force() const noexcept { return contact_force_; }

  /// Kinetic, and stored in springs, bristles and the position-dependent forces; without the walls [J].
  [[nodiscard]] double energy() const noexcept;

  /// What the motors have done to the mechanism so far [J].
  [[nodiscard]] double motor_work() const noexcept { return motor_work_; }

  /// The hand lets go, and holds nothing from now on.
  void let_go() noexcept {
    grip_stiffness_ = grip_damping_ = 0;
    for (LinearSteps& known : linear_) known.h = 0;
  }

  [[nodiscard]] double longest_step() const noexcept { return longest_step_; }

 private:
  enum class Friction { none, rigid, lugre };

  struct Body {
    Vec3 x = Vec3::Zero(), v = Vec3::Zero();
    Vec3 inverse_mass = Vec3::Zero();  ///< zero on an axis that is held
  };

  /// What depends on the length of a step only.
  struct Step {
    double h = 0;
    double lag_decay = 0, lag_mean = 0;  ///< of the motor force over a step
    double arm_decay = 1, arm_gain = 0, arm_half_decay = 1, arm_half_gain = 0;
    Vec3 theta = Vec3::Zero();  ///< how implicit the bristle's spring is
  };

  /// The matrices of every axis for one length of step: of bodies that the link connects, and of bodies within its
  /// play.
  struct LinearSteps {
    double h = 0;
    std::array<LinearStep, 3> linked, apart;
  };

  using Advance = void (Plant::*)(double, const PlantInput&) noexcept;
  static Advance choose(Friction friction, bool structure, bool hand, bool by_matrices);
  template <Friction friction, bool structure, bool hand>
  void advance_as(double span, const PlantInput& input) noexcept;
  template <Friction friction, bool structure, bool hand>
  void advance_by_matrices(double span, const PlantInput& input) noexcept;

  double steps_in(double span) const noexcept;
  Vec3 motor_force_over_step(const Vec3& command) noexcept;
  template <Friction friction>
  double braked(int axis, double before, double free, double w, double viscous) noexcept;
  double sliding_force(int axis, double speed) const noexcept;
  Vec3 position_force(const Vec3& x) const noexcept;
  void push_back_from_walls(double w) noexcept;
  void prepare(double h) noexcept;
  const LinearSteps& linear_steps(double h) noexcept;
  LinearBodies bodies(int axis, bool linked, bool held) const noexcept;
  double accurate_step() const;
  double stable_step() const;
  Vec3 field_stiffness() const;

  Advance advance_ = nullptr;
  Eigen::Matrix3d rotation_ = Eigen::Matrix3d::Identity();
  Integrator integrator_;
  bool structure_ = false;
  double longest_step_;
  Step step_;
  std::vector<LinearSteps> linear_;  ///< of the lengths met last; none for semi_implicit
  std::size_t oldest_linear_ = 0;

  Body motor_, handle_, hand_;

  // Mechanism.
  double lag_time_constant_ = 0;
  Vec3 motor_force_ = Vec3::Zero();
  double motor_work_ = 0;
  Vec3 viscous_ = Vec3::Zero();
  Vec3 coulomb_ = Vec3::Zero();
  double stribeck_gain_ = 0, inverse_stribeck_velocity_ = 0;
  Vec3 bristle_stiffness_ = Vec3::Zero();
  double bristle_damping_ = 0;
  Vec3 bristle_ = Vec3::Zero();  ///< z [m]
  Vec3 bias_ = Vec3::Zero();
  bool has_gradient_ = false, has_cogging_ = false;
  Eigen::Matrix3d gradient_ = Eigen::Matrix3d::Zero();
  Vec3 cogging_ = Vec3::Zero();
  double cogging_wave_number_ = 0;  ///< [rad/m]
  Vec3 link_stiffness_ = Vec3::Zero(), link_damping_ = Vec3::Zero();
  double half_backlash_ = 0;
  Box workspace_;
  double safe_radius_squared_ = 0;  ///< no wall is nearer to the origin
  double wall_mass_ = 0;

  // Hand.
  double grip_stiffness_ = 0, grip_damping_ = 0;
  double arm_stiffness_ = 0, arm_relaxation_ = 0, arm_damping_ = 0;
  double intent_stiffness_ = 0, intent_damping_ = 0;
  Vec3 arm_force_ = Vec3::Zero();
  Vec3 contact_force_ = Vec3::Zero();
};

}  // namespace haptrace
