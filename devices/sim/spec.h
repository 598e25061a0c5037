// What a simulated device is made of.
#pragma once

#include "control/design/plant_model.h"
#include "control/path/path.h"

#include <array>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace haptrace {

/// The hand that holds a simulated device: a mass behind a grip, an arm behind the mass. The same in every direction.
/// Zero leaves a part out. Ranges of real hands: Hajian and Howe 1997 (finger), Hasser and Cutkosky 2002 (pinch),
/// Mussa-Ivaldi, Hogan and Bizzi 1985, Gomi and Kawato 1997 (arm).
struct HandSpec {
  double mass = 0;              ///< [kg]
  double grip_stiffness = 0;    ///< between handle and hand [N/m]
  double grip_damping = 0;      ///< [N s/m]
  double arm_stiffness = 0;     ///< between hand and shoulder [N/m]
  double arm_relaxation = 0;    ///< the arm's spring forgets with this time constant (Maxwell) [s]; 0: it never does
  double arm_damping = 0;       ///< [N s/m]
  double tremor = 0;            ///< force, 6 to 12 Hz, rms per axis [N]
  double drift = 0;             ///< force, below 1 Hz, rms per axis [N]
  double intent_stiffness = 0;  ///< what pulls the hand to where it intends to be [N/m]
  double intent_damping = 0;    ///< [N s/m]
  double turn_stiffness = 0;    ///< what turns the handle to where it intends to point [N m/rad]
  double turn_damping = 0;      ///< [N m s/rad]
  std::string intent;           ///< the file of the path that the hand intends to follow, or empty
};

/// A flexible link between the motors, which carry the encoders, and the handle, which the hand holds.
struct StructuralModeSpec {
  double frequency_hz = 0;  ///< of the free device
  double damping_ratio = 0;
  double handle_fraction = 0.5;  ///< of the mass
};

/// A handle that turns about every axis and is turned by motors.
struct WristSpec {
  double inertia = 0;     ///< about every axis [kg m^2], never zero
  double viscous = 0;     ///< [N m s/rad]
  double coulomb = 0;     ///< friction [N m]
  double max_torque = 0;  ///< magnitude [N m]
  double resolution = 0;  ///< of the orientation that is measured [rad]
};

/// A simulated device. Members stand in the order of the chain: command, motor, mechanism, sensors, hand. Vectors are
/// per actuator axis unless they name W. Zero leaves a part out: it costs nothing.
struct SimSpec {
  std::string model = "simulated device";
  Vec3 rotation = Vec3::Zero();                ///< from W to the actuator axes, rotation vector [rad]
  std::array<bool, 3> axes{true, true, true};  ///< that move and take force; the others are held at zero, in W

  double max_force = 0;             ///< magnitude; the motors saturate here [N]
  double max_continuous_force = 0;  ///< magnitude, stated only; 0: unknown, see ServoLoop [N]
  double force_resolution = 0;      ///< [N]
  double delay = 0;                 ///< from exchange to the motor [s]
  double actuator_bandwidth_hz = 0;

  Vec3 mass = Vec3::Zero();                  ///< [kg], never zero
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
  Box workspace{Vec3::Constant(-1), Vec3::Constant(1)};        ///< in W; stiff, damped walls stand round it [m]
  std::optional<StructuralModeSpec> structural_mode;
  double backlash = 0;  ///< play in the structural mode's spring [m]
  std::optional<WristSpec> wrist;

  double position_resolution = 0;  ///< [m]
  double position_noise = 0;       ///< rms per axis [m]
  bool force_sensor = false;       ///< measures the force of the handle on the hand
  double force_noise = 0;          ///< rms per axis [N]
  double nominal_rate = 1000;      ///< [Hz]

  std::optional<HandSpec> hand;
};

/// Reads a device from JSON, whose keys samples/devices/example.json explains. Paths in it are relative to `folder`.
/// Throws Error(input) naming `where` and the key: unknown, missing, out of its range, or at odds with another.
SimSpec read_sim_spec(const nlohmann::json& json, const std::string& where, const std::string& folder = "");

/// A device that moves as `plant` does, in W: friction sticks rigidly, `lag` [s] of its delay is the motor's bandwidth.
/// What the model does not know is left out; the workspace is the default. Throws Error(input) when a mass is not
/// positive, the gradient is not symmetric or the lag is longer than the delay.
SimSpec sim_spec_of(const PlantModel& plant, double max_force, double lag = 0);

}  // namespace haptrace
