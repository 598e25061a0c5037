// Homing of a pantograph, whose encoders count from their position at power-on.
#pragma once

#include "devices/haply/kinematics.h"

#include <array>
#include <cstdint>

namespace haptrace {

/// Finds the mechanical stops by a movement of the user: swing both arms inward, press them outward into their stops,
/// and hold them there. The position of the arms when counting began does not matter.
///
/// The first arm is in its stop at its largest angle, the second at its smallest. Arms count as in their stops if they
/// rest at their outermost position so far after they were well inside. A user who holds them short of the stops
/// deceives this; that shows as soon as an arm moves farther outward (`beyond`).
///
/// Real-time: all members.
class StopHoming {
 public:
  static constexpr double kSwing = 0.25;   ///< required inward swing of each arm [rad]
  static constexpr double kNear = 0.03;    ///< tolerance to the outermost angle, and at rest [rad]
  static constexpr double kRest = 0.5;     ///< [s]
  static constexpr double kBeyond = 0.09;  ///< angle explained by a yielding stop and backlash [rad]

  explicit StopHoming(const Vec2& stops) : stops_(stops) {}

  /// Skips the search: the arms are in their stops and count from them.
  void trust() noexcept { homed_ = true; }

  /// Restarts the search, because counting restarted.
  void restart() noexcept { *this = StopHoming(stops_); }

  /// Takes the counted angles of the arms [rad] at `now_ns`.
  void update(const Vec2& counted, std::int64_t now_ns) noexcept;

  [[nodiscard]] bool is_homed() const noexcept { return homed_; }
  /// Returns the angles of the arms, once homed [rad].
  [[nodiscard]] Vec2 angles(const Vec2& counted) const noexcept { return counted + correction_; }
  /// Returns how far an arm is beyond its stop, where it cannot be [rad]; 0 if all is well.
  [[nodiscard]] double beyond(const Vec2& counted) const noexcept;

 private:
  Vec2 stops_, correction_ = Vec2::Zero();
  bool homed_ = false, begun_ = false;
  Vec2 outermost_ = Vec2::Zero(), resting_ = Vec2::Zero();  ///< outermost_: outward is positive
  std::array<bool, 2> swung_{};
  std::int64_t resting_since_ns_ = 0;
};

}  // namespace haptrace
