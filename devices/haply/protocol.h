// Serial protocol between a Haply board and its host.
#pragma once

#include "devices/haply/calibration.h"

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace haptrace {

/// Commands of the hAPI firmware (boards M0, M3 and the development kit, by the sources of hAPI). A message has no
/// frame, length or check sum: the first byte is the command, and the board waits for as many more bytes as it needs.
/// Numbers are little-endian float32. Motors and encoders are in the order of their ports.
///
///     0 id                                              forget motors and encoders
///     1 id motors senses.. encoders senses.. 0 0 (offset [deg], counts per turn)..      set them up; ports are bits
///     2 id torques.. [N m]                              answered by: id angles.. [deg]
///                                   or, by newer firmware, by: id (angle [deg], velocity [deg/s])..
///
/// The board answers no other command.
enum class TwoDiyCommand : std::uint8_t { reset = 0, setup = 1, exchange = 2 };

using TwoDiyTorques = std::array<std::uint8_t, 10>;   ///< a message `exchange` for two motors
inline constexpr std::size_t kTwoDiyAngles = 9;       ///< bytes of an answer with two angles
inline constexpr std::size_t kTwoDiyVelocities = 17;  ///< bytes of an answer with two angles and velocities

/// Returns a message `exchange` with the torques of the arms [N m].
TwoDiyTorques two_diy_exchange(const TwoDiyCalibration& device, const Vec2& torques) noexcept;

/// Returns the angles of the arms [rad]; none if the length, the id or a number is invalid. Velocities are checked but
/// not returned: haptrace estimates its own.
std::optional<Vec2> two_diy_angles(const TwoDiyCalibration& device, std::span<const std::uint8_t> answer) noexcept;

std::vector<std::uint8_t> two_diy_setup(const TwoDiyCalibration& device);

/// Returns bytes that set zero torque, wherever the stream broke off. They begin with as many bytes as an unfinished
/// message `exchange` can wait for. These bytes are no command, and as floats they are almost zero (1e-35). A board
/// that did not reset keeps its encoders.
std::vector<std::uint8_t> two_diy_calm(const TwoDiyCalibration& device);

/// Returns bytes that set the board up again and set zero torque, whatever state it is in. They begin like
/// two_diy_calm. Then come enough zeros to end an unfinished set-up; zeros are resets themselves, and two more, with
/// the id, end a half-finished reset. Afterwards the encoders are at their offsets, wherever the arms are.
std::vector<std::uint8_t> two_diy_restart(const TwoDiyCalibration& device);

}  // namespace haptrace
