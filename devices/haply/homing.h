// Where the arms of a pantograph are: encoders count from wherever they were switched on.
#pragma once

#include "devices/haply/kinematics.h"

#include <array>
#include <cstdint>

namespace haptrace {

/// Finds the mechanical stops as a hand shows them: both arms are swung inward, pressed outward into their stops, and
/// held there. Where the arms stood when counting began does not matter.
///
/// The first arm lies on its stop with its largest angle, the second with its smallest. Arms that rest where they never
/// were farther out, after they were well inside, are in their stops; it can be deceived by who holds them short of
/// them, and finds out as soon as an arm goes on outward (`beyond`).
///
/// Real-time: all members.
class StopHoming {
 public:
  static constexpr double kSwing = 0.25;   ///< how far inside an arm has to have been [rad]
  static constexpr double kNear = 0.03;    ///< of the outermost angle, and while it rests [rad]
  static constexpr double kRest = 0.5;     ///< [s]
  static constexpr double kBeyond = 0.09;  ///< what a stop that yields, and play, explain [rad]

  explicit StopHoming(const Vec2& stops) : stops_(stops) {}

  /// The arms are in their stops and count from them: nothing has to be found.
  void trust() noexcept { homed_ = true; }

  /// Counting began anew.
  void restart() noexcept { *this = StopHoming(stops_); }

  /// The arms as they are counted [rad], at `now_ns`.
  void update(const Vec2& counted, std::int64_t now_ns) noexcept;

  [[nodiscard]] bool is_homed() const noexcept { return homed_; }
  /// The angles of the arms, once it is homed [rad].
  [[nodiscard]] Vec2 angles(const Vec2& counted) const noexcept { return counted + correction_; }
  /// By how much an arm is farther out than its stop, where it cannot be [rad]; 0 when all is well.
  [[nodiscard]] double beyond(const Vec2& counted) const noexcept;

 private:
  Vec2 stops_, correction_ = Vec2::Zero();
  bool homed_ = false, begun_ = false;
  Vec2 outermost_ = Vec2::Zero(), resting_ = Vec2::Zero();  ///< outward is positive in the first
  std::array<bool, 2> swung_{};
  std::int64_t resting_since_ns_ = 0;
};

}  // namespace haptrace
