// Specification of a simulated device.
#pragma once

#include "control/design/plant_model.h"
#include "control/path/path.h"

#include <array>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace haptrace {

/// The hand that holds a simulated device: a mass with a grip to the handle and an arm behind it, equal in every
/// direction. Zero omits a part. Ranges of real hands: Hajian and Howe 1997 (finger), Hasser and Cutkosky 2002 (pinch),
/// Mussa-Ivaldi, Hogan and Bizzi 1985, Gomi and Kawato 1997 (arm).
struct HandSpec {
  double mass = 0;              ///< [kg]
  double grip_stiffness = 0;    ///< between handle and hand [N/m]
  double grip_damping = 0;      ///< [N s/m]
  double arm_stiffness = 0;     ///< between hand and shoulder [N/m]
  double arm_relaxation = 0;    ///< time constant with which the arm's spring relaxes (Maxwell) [s]; 0: it does not
  double arm_damping = 0;       ///< [N s/m]
  double tremor = 0;            ///< force, rms per axis [N]
  double tremor_hz = 0;         ///< its frequency; 0: 6 to 12 Hz [Hz]
  double drift = 0;             ///< force, rms per axis [N]
  double drift_hz = 0;          ///< corner of first order; 0: it ends at 1 Hz (fourth order) [Hz]
  double intent_stiffness = 0;  ///< of the spring that pulls the hand to its intent [N/m]
  double intent_damping = 0;    ///< [N s/m]
  double turn_stiffness = 0;    ///< of the spring that turns the handle to its intent [N m/rad]
  double turn_damping = 0;      ///< [N m s/rad]
  std::string intent;           ///< file of the path that the hand follows, or empty
};

/// A flexible link between the motors, which carry the encoders, and the handle, which the hand holds.
struct StructuralModeSpec {
  double frequency_hz = 0;  ///< natural frequency of the free device
  double damping_ratio = 0;
  double handle_fraction = 0.5;  ///< the handle's share of the mass
};

/// A handle that motors turn about every axis.
struct WristSpec {
  double inertia = 0;     ///< about every axis [kg m^2], never zero
  double viscous = 0;     ///< [N m s/rad]
  double coulomb = 0;     ///< friction [N m]
  double max_torque = 0;  ///< magnitude [N m]
  double resolution = 0;  ///< resolution of the measured orientation [rad]
};

/// A simulated device. Members follow the order of the chain: command, motor, mechanism, sensors, hand. Vectors are per
/// actuator axis unless they name W. Zero omits a part, at no cost.
struct SimSpec {
  std::string model = "simulated device";
  Vec3 rotation = Vec3::Zero();                ///< from W to the actuator axes, rotation vector [rad]
  std::array<bool, 3> axes{true, true, true};  ///< axes that move and take force, in W; the others are held at zero

  double max_force = 0;             ///< magnitude; the motors saturate here [N]
  double max_continuous_force = 0;  ///< magnitude, information only; 0: unknown, see ServoLoop [N]
  double motor_limit = 0;           ///< magnitude, where the motors saturate below max_force without saying so [N]
  double force_resolution = 0;      ///< [N]
  double delay = 0;                 ///< from exchange to the motor [s]
  double actuator_bandwidth_hz = 0;

  Vec3 mass = Vec3::Zero();                  ///< [kg], never zero
  double inertia_variation = 0;              ///< v: the motors' mass is mass (1 + v cos(pi |p| / L)), at p
  double inertia_length = 0.1;               ///< L, from the largest mass at the origin to the smallest [m]
  Vec3 viscous = Vec3::Zero();               ///< [N s/m]
  Vec3 coulomb = Vec3::Zero();               ///< sliding friction [N]
  double static_ratio = 1;                   ///< static over sliding friction (Stribeck)
  double stribeck_velocity = 0;              ///< [m/s]
  Vec3 presliding_stiffness = Vec3::Zero();  ///< sigma_0 of the LuGre model; zero: friction sticks rigidly [N/m]
  double presliding_damping = 0;             ///< sigma_1 [N s/m]
  Vec3 gravity_bias = Vec3::Zero();          ///< in W, at the origin [N]
  Eigen::Matrix3d gravity_gradient = Eigen::Matrix3d::Zero();  ///< in W, symmetric: F = bias + gradient p [N/m]
  Vec3 cogging = Vec3::Zero();                                 ///< amplitude [N]
  double cogging_period = 0;                                   ///< [m]
  Box workspace{Vec3::Constant(-1), Vec3::Constant(1)};        ///< in W; stiff, damped walls surround it [m]
  std::optional<StructuralModeSpec> structural_mode;
  double backlash = 0;  ///< in the spring of the structural mode [m]
  std::optional<WristSpec> wrist;

  double position_resolution = 0;  ///< [m]
  double position_noise = 0;       ///< rms per axis [m]
  bool force_sensor = false;       ///< the device measures the force of the handle on the hand
  double force_noise = 0;          ///< rms per axis [N]
  double nominal_rate = 1000;      ///< [Hz]

  std::optional<HandSpec> hand;

  /// Returns the largest magnitude of the motors' force [N].
  [[nodiscard]] double strongest() const noexcept {
    return motor_limit > 0 && motor_limit < max_force ? motor_limit : max_force;
  }
};

/// Reads a device from JSON; samples/devices/example.json explains the keys. Paths in it are relative to `folder`.
/// Throws Error(input) naming `where` and the key if a key is unknown, missing, out of range, or in conflict with
/// another.
SimSpec read_sim_spec(const nlohmann::json& json, const std::string& where, const std::string& folder = "");

/// Returns a device that moves as `plant` does, in W. Friction sticks rigidly; `lag` [s] of the delay becomes the
/// motor's bandwidth. Parts that the model lacks are omitted; the workspace is the default. Throws Error(input) if a
/// mass is not positive, the gradient is not symmetric or the lag exceeds the delay.
SimSpec sim_spec_of(const PlantModel& plant, double max_force, double lag = 0);

}  // namespace haptrace
