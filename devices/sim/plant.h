// Equations of motion of a simulated device's mechanism and of the hand that holds it.
#pragma once

#include "devices/sim/linear_step.h"
#include "devices/sim/spec.h"

#include <array>
#include <string>
#include <vector>

namespace haptrace {

/// Inputs of a plant, in actuator axes.
struct PlantInput {
  Vec3 command = Vec3::Zero();          ///< force that reaches the motors now [N]
  Vec3 hand_force = Vec3::Zero();       ///< force of tremor and drift on the hand [N]
  Vec3 hand_force_rate = Vec3::Zero();  ///< [N/s]
  Vec3 intent = Vec3::Zero();           ///< intended position of the hand [m]
  Vec3 intent_velocity = Vec3::Zero();  ///< [m/s]
};

/// Up to three bodies in a chain, each a point mass in space: motors (x, v), handle (behind the structural mode's
/// spring), hand (behind the grip):
///
///     m s v' = u + F_bias + G x - F_cog sin(2 pi x / period) - b v - F_friction + F_wall - F_grip + F_inertia
///     m_h v_h' = F_grip + F_arm + k_i (x_i - x_h) + b_i (v_i - v_h) + F_tremor
///     F_grip = k_g (x - x_h) + b_g (v - v_h),   F_arm' = k_a (v_i - v_h) - F_arm / tau
///
/// Where the mass varies with the place, s(x) = 1 + v cos(pi |x| / L), and Lagrange's equation adds the force
/// F_inertia = grad s (m . v^2) / 2 - m v (grad s . v). It needs the semi-implicit integrator.
///
/// Friction is LuGre's (Canudas de Wit, Olsson, Astrom and Lischinsky 1995) when presliding is given,
///
///     z' = v - sigma_0 |v| z / g(v),   F = sigma_0 z + sigma_1 z',   g(v) = F_c (1 + (r - 1) exp(-(v / v_s)^2)),
///
/// otherwise it sticks rigidly up to g(0). Steps are semi-implicit Euler. Friction, viscous damping and walls are
/// implicit in the velocity, so that no stiffness of theirs can make a step unstable.
///
/// Every other integrator advances the linear part of each axis (its bodies, springs, dampers and b) by its own
/// matrices (linear_step). Within the backlash these are the matrices of bodies that the link does not connect. All
/// other forces are held over the step: cogging, gravity's gradient and the arm's spring at the position extrapolated
/// by half a step, tremor and intent at half a step, and the mean of the motor force. Smooth movements thus keep the
/// integrator's order up to 2, and its full order if only the linear part and the bias act. Friction is the held force
/// that agrees with the velocity at the end of the step; the walls act after it. With any integrator, the order is 1
/// where friction reverses or sticks, where the backlash ends, and at walls.
///
/// Everything here is expressed in actuator axes: p_A = R p_W. Only the parts that a spec names are computed.
/// Real-time: advance, let_go.
class Plant {
 public:
  /// Starts at rest with every body at `start` (W). Without `follows_intent`, the hand has no intent springs.
  /// `longest_step` [s] bounds a step. Stiff springs and dampers may shorten it further: semi_implicit to an accurate
  /// step, euler and rk4 to 0.8 of their limits. verlet uses 0.8 of semi_implicit's limit, and exact 0.8 of verlet's,
  /// so that friction and walls brake within a step. With implicit, only cogging, gravity and the arm shorten it.
  /// Throws Error(input) if no step is stable, as with euler and a spring without a damper.
  Plant(const SimSpec& spec, const Vec3& start, bool follows_intent, double longest_step,
        Integrator integrator = Integrator::semi_implicit);

  /// Advances by `span` [s] in equal steps.
  void advance(double span, const PlantInput& input) noexcept { (this->*advance_)(span, input); }

  [[nodiscard]] const Eigen::Matrix3d& rotation() const noexcept { return rotation_; }  ///< R: p_A = R p_W
  [[nodiscard]] const Vec3& motor_position() const noexcept { return motor_.x; }        ///< measured by encoders [m]
  [[nodiscard]] const Vec3& motor_velocity() const noexcept { return motor_.v; }
  [[nodiscard]] const Vec3& handle_position() const noexcept { return structure_ ? handle_.x : motor_.x; }
  [[nodiscard]] const Vec3& handle_velocity() const noexcept { return structure_ ? handle_.v : motor_.v; }
  [[nodiscard]] const Vec3& hand_position() const noexcept { return hand_.x; }

  /// Returns the force of the handle on the hand; zero without a hand [N].
  [[nodiscard]] const Vec3& contact_force() const noexcept { return contact_force_; }

  /// Returns the kinetic energy and the energy stored in springs, bristles and the position-dependent forces, without
  /// the walls [J].
  [[nodiscard]] double energy() const noexcept;

  /// Returns the work that the motors have done on the mechanism so far [J].
  [[nodiscard]] double motor_work() const noexcept { return motor_work_; }

  /// Makes the hand let go of the handle for good.
  void let_go() noexcept {
    grip_stiffness_ = grip_damping_ = 0;
    for (LinearSteps& known : linear_) known.h = 0;
  }

  /// Scales the spring and the damper with which the hand follows its intent, from 0 (none) to 1.
  void follow_intent(double share) noexcept;

  [[nodiscard]] double longest_step() const noexcept { return longest_step_; }

 private:
  enum class Friction { none, rigid, lugre };

  struct Body {
    Vec3 x = Vec3::Zero(), v = Vec3::Zero();
    Vec3 inverse_mass = Vec3::Zero();  ///< zero on an axis that is held
  };

  /// Factors that depend only on the length of a step.
  struct Step {
    double h = 0;
    double lag_decay = 0, lag_mean = 0;  ///< motor lag over a step
    double arm_decay = 1, arm_gain = 0, arm_half_decay = 1, arm_half_gain = 0;
    Vec3 theta = Vec3::Zero();  ///< implicit share of the bristle's spring
  };

  /// The matrices of every axis for one length of step: of bodies that the link connects, and of bodies within its
  /// backlash.
  struct LinearSteps {
    double h = 0;
    std::array<LinearStep, 3> linked, apart;
  };

  void place_bodies(const SimSpec& spec, const Vec3& start, const Vec3& moving);
  void take_friction(const SimSpec& spec);
  void take_position_forces(const SimSpec& spec);
  void take_hand(const HandSpec& hand, const Vec3& start, bool follows_intent);
  double longest_good_step(const std::string& model, bool by_matrices) const;

  using Advance = void (Plant::*)(double, const PlantInput&) noexcept;
  static Advance choose(Friction friction, bool structure, bool hand, bool by_matrices);
  template <Friction friction, bool structure, bool hand>
  void advance_as(double span, const PlantInput& input) noexcept;
  template <Friction friction, bool structure, bool hand>
  void advance_by_matrices(double span, const PlantInput& input) noexcept;
  template <bool structure, bool hand>
  struct Chains;
  template <Friction friction, bool structure, bool hand>
  void advance_chains(const LinearSteps& linear, const Vec3& on_motor, const Vec3& on_hand,
                      Chains<structure, hand>& chains) noexcept;
  template <bool structure, bool hand>
  void end_step(Chains<structure, hand>& chains) noexcept;

  double steps_in(double span) const noexcept;
  Vec3 motor_force_over_step(const Vec3& command) noexcept;
  template <Friction friction>
  double braked(int axis, double before, double free, double w, double viscous) noexcept;
  double sliding_force(int axis, double speed) const noexcept;
  Vec3 position_force(const Vec3& x) const noexcept;
  double mass_scale(const Vec3& x) const noexcept;
  Vec3 inertia_force() const noexcept;
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
  std::vector<LinearSteps> linear_;  ///< of the most recent lengths; empty for semi_implicit
  std::size_t oldest_linear_ = 0;

  Body motor_, handle_, hand_;

  // Mechanism.
  Vec3 motor_mass_ = Vec3::Zero();
  double inertia_variation_ = 0, inertia_wave_number_ = 0;  ///< v, pi / L [rad/m]
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
  double safe_radius_squared_ = 0;  ///< no wall is closer to the origin
  double wall_mass_ = 0;

  // Hand.
  double grip_stiffness_ = 0, grip_damping_ = 0;
  double arm_stiffness_ = 0, arm_relaxation_ = 0, arm_damping_ = 0;
  double intent_stiffness_ = 0, intent_damping_ = 0;
  double full_intent_stiffness_ = 0, full_intent_damping_ = 0;  ///< of a hand that follows its intent completely
  Vec3 arm_force_ = Vec3::Zero();
  Vec3 contact_force_ = Vec3::Zero();
};

}  // namespace haptrace
