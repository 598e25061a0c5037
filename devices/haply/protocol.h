// The bytes that a Haply board and its host exchange.
#pragma once

#include "devices/haply/calibration.h"

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace haptrace {

/// Commands of the hAPI firmware (boards M0, M3 and the development kit, by the sources of hAPI). A message has neither
/// frame nor length nor check sum: the first byte says what it is, and the board waits for as many more as that needs.
/// Numbers are little-endian float32. Motors and encoders stand in the order of their ports.
///
///     0 id                                              forget motors and encoders
///     1 id motors senses.. encoders senses.. 0 0 (offset [deg], counts per turn)..      know them; ports are bits
///     2 id torques.. [N m]                              answered by: id angles.. [deg]
///                                   or, by newer firmware, by: id (angle [deg], velocity [deg/s])..
///
/// No other command is answered.
enum class TwoDiyCommand : std::uint8_t { reset = 0, setup = 1, exchange = 2 };

using TwoDiyTorques = std::array<std::uint8_t, 10>;   ///< a message `exchange` for two motors
inline constexpr std::size_t kTwoDiyAngles = 9;       ///< bytes of an answer with two angles
inline constexpr std::size_t kTwoDiyVelocities = 17;  ///< and of one that has their velocities as well

/// Torques of the arms [N m].
TwoDiyTorques two_diy_exchange(const TwoDiyCalibration& device, const Vec2& torques) noexcept;

/// The angles of the arms [rad]; none when that is no answer: its length, its id, or a number that no encoder has.
/// Velocities are checked and not returned: haptrace estimates its own.
std::optional<Vec2> two_diy_angles(const TwoDiyCalibration& device, std::span<const std::uint8_t> answer) noexcept;

std::vector<std::uint8_t> two_diy_setup(const TwoDiyCalibration& device);

/// Zero torque, wherever the stream broke off: first as many bytes as a message `exchange` can still wait for. They are
/// no command, and as floats they are next to nothing (1e-35). An intact board keeps its encoders.
std::vector<std::uint8_t> two_diy_calm(const TwoDiyCalibration& device);

/// Sets the board up anew and sends zero torque, whatever state it is in. It begins like two_diy_calm; then come zeros,
/// enough to end a set-up that broke off. They are resets themselves; two more, with the id, end the last half of one.
/// Its encoders are at their offsets afterwards, wherever the arms are.
std::vector<std::uint8_t> two_diy_restart(const TwoDiyCalibration& device);

}  // namespace haptrace
