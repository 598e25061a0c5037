// Rest of a tracking law: what it does when the reference stands still.
#pragma once

#include "control/controller.h"

namespace haptrace {

/// At rest, an observer that integrates, stiction and the position resolution make a limit cycle of about one count.
/// This class stops the integration. Rest begins when the reference rests, and for kRestTime the device stays within
/// kStillCounts of one place and that within kRestCounts of the reference. Then load and spring force are kept, and a
/// feedback for rest replaces the one for movement. Rest ends when the device is farther away than twice kRestCounts,
/// or the reference moves. Each time that the device slips instead of staying, both bounds grow by a tenth, up to twice
/// their size, until the reference moves. A hunting device therefore comes to rest.
///
/// The feedback for rest also acts at standstill, with the weight that the law chooses: when the reference has rested
/// for a second with the device near it.
///
/// Real-time: all but the constructor.
class Rest {
 public:
  static constexpr double kRestCounts = 2;
  static constexpr double kStillCounts = 1.5;
  static constexpr double kRestTime = 0.06;   ///< [s]
  static constexpr double kLeisure = 0.1;     ///< share of the bandwidth of the load at standstill
  static constexpr double kAwakening = 0.01;  ///< time constant of the transition back to movement [s]

  /// Watches the axes where `driven` is 1, not those where it is 0. `position_resolution`: [m]. `standing`: weight of
  /// the feedback for rest at standstill, 0 to 1.
  Rest(const Vec3& driven, double position_resolution, double standing)
      : driven_(driven), quantum_(position_resolution), standing_(standing) {}

  /// Forgets everything.
  void start() noexcept;

  /// Takes one tick. To be called before the others.
  void watch(const State& state, const Reference& reference) noexcept;

  /// Returns true at standstill: a load is then to be followed slowly.
  [[nodiscard]] bool stands() const noexcept;

  struct Feedback {
    Vec3 spring = Vec3::Zero();  ///< part that is proportional to the error [N]
    Vec3 other = Vec3::Zero();   ///< the rest of it [N]
  };
  struct Forces {
    Vec3 feedback = Vec3::Zero();  ///< [N]
    Vec3 load = Vec3::Zero();      ///< force that cancels the load [N]
  };

  /// Returns the forces of this tick from the feedback for movement, that for rest, and the force that cancels the load
  /// [N].
  [[nodiscard]] Forces forces(const Feedback& moving, const Feedback& resting, const Vec3& load, double dt) noexcept;

  /// Returns the weight of the feedback for rest: 0 in a movement, 1 at rest.
  [[nodiscard]] double weight() const noexcept { return weight_; }

 private:
  [[nodiscard]] bool rests(const State& state, const Reference& reference) noexcept;

  Vec3 driven_;
  double quantum_, standing_;
  Vec3 anchor_ = Vec3::Zero();  ///< place where the device stays [m]
  double weight_then_ = 0;      ///< weight when rest began
  double patience_ = 1;         ///< factor on the bounds of rest
  double stood_ = 0;            ///< time for which the reference has rested with the device near it [s]
  Vec3 kept_ = Vec3::Zero();    ///< at rest: the load that is kept; after it: the fading difference [N]
  Vec3 spring_ = Vec3::Zero();  ///< spring force that rest took away when it began, fading after it [N]
  double rested_ = 0;           ///< time for which the device has stayed at anchor_ [s]
  bool was_resting_ = false, resting_ = false;
  double weight_ = 0;
};

}  // namespace haptrace
