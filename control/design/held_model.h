// A device in a hand as a law's design sees it.
#pragma once

#include "control/design/axis_model.h"

#include <array>
#include <complex>

namespace haptrace {

/// A device in a hand, for each axis of W: the parameters of an AxisModel. Zero on axes without force output.
struct HeldModel {
  Vec3 mass = Vec3::Zero();         ///< of the motors, without link and hand [kg]
  Vec3 viscous = Vec3::Zero();      ///< [N s/m]
  double delay = 0;                 ///< from the tick that commands a force to the motor, without the lag [s]
  double lag = 0;                   ///< first-order lag of the motors [s]
  std::array<LinkModel, 3> link{};  ///< mass 0: the device is rigid
  std::array<HandModel, 3> hand{};  ///< mass 0: nobody holds the device
  /// Force of the hand's own, per axis, the mean over the axes; zero if it was not measured.
  HandNoise noise{.drift = 0, .drift_hz = 0, .tremor = 0, .tremor_hz = 0};

  [[nodiscard]] bool held() const noexcept { return hand[0].mass > 0 || hand[1].mass > 0 || hand[2].mass > 0; }
  [[nodiscard]] bool flexible() const noexcept { return link[0].mass > 0 || link[1].mass > 0 || link[2].mass > 0; }
};

/// Hand and link of an axis as its motors feel them, at a complex frequency s.
struct HeldResponse {
  std::complex<double> impedance;  ///< force for a displacement of the motors [N/m]
  std::complex<double> share;  ///< of a force on the hand's mass (without a hand, on the link's or the device's own)
                               ///< that acts on motors at rest
};

/// With a || b = a b / (a + b), the arm a(s) = m_h s^2 + b_a s + k_a s tau / (1 + s tau) and the grip g(s) = k_g + b_g
/// s, the impedance of a hand is g || a, and its share g / (g + a); see HandModel. A link stands before it likewise.
HeldResponse held_response(const HandModel& hand, const LinkModel& link, std::complex<double> s) noexcept;

/// Lag of a motor and its amplifier where it was not identified [s].
inline constexpr double kTypicalLag = 0.5e-3;

/// Returns the model of `plant` in the hand `hand`. `lag` [s] of the plant's delay is the motor's lag. Friction is left
/// to the feedforward, and so is the damping, in which an arm has a share.
HeldModel held_model(const PlantModel& plant, const HandModel& hand, double lag = kTypicalLag) noexcept;

/// Returns the models of the axes that have a mass, at this rate of the servo loop. `position_noise` is the standard
/// deviation of a measured position, see measured_noise() [m]; at least 0.1 um is assumed.
std::array<std::optional<AxisModel>, 3> axis_models(const HeldModel& held, double position_noise, double rate_hz);

}  // namespace haptrace
