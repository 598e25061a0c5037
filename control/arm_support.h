// Support of an arm: a steady force upwards that carries a part of its weight.
#pragma once

#include "control/controller.h"
#include "control/limits.h"

namespace haptrace {

/// A force that carries a part of an arm's weight, whatever else a session does.
///
///     F = r(t) (s h F_0 - (1 - h) b (v . u)+) u
///
/// u is the unit vector upwards. r rises over kRise and, while a request takes the forces away, falls over kFall. It
/// cannot know whether an arm is there, so it gives an empty handle neither speed nor a push against its stop:
///   - s falls from 1 to 0 while the hand rises faster than kCarried, up to kFastest: damping, of a rise alone;
///   - h falls from 1 to 0 at `top`, over F_0 / `stiffness` and at least kShortest: a spring;
///   - b damps a rise there, with F_0 / (kFastest - kCarried) and at most kMostDamping.
///
/// F_0 may be changed meanwhile: it follows the wish at kSlew.
///
/// Energy: with r steady, F is a potential less what s and b take. It gives at most F_0 times the way from the lowest
/// place to the top, as the arm gave when it came down.
///
/// A stale state is no state: at a first tick, after a gap, and for values that are not finite, the force is zero.
///
/// Real-time: all but the constructor. Threads: one at a time.
class ArmSupport {
 public:
  static constexpr double kRise = 2, kFall = 0.5;            ///< [s]
  static constexpr double kCarried = 0.25, kFastest = 0.75;  ///< speeds upwards [m/s]
  static constexpr double kMostDamping = 5;                  ///< stable on a light device that is late [N s/m]
  static constexpr double kShortest = 1e-3;                  ///< way over which h falls at least [m]
  static constexpr double kSlew = 2;                         ///< of F_0, when it is changed [N/s]

  struct Options {
    double force = 0;         ///< F_0 at the beginning [N]
    Vec3 up = Vec3::UnitY();  ///< u, in W
    double top = 1;           ///< height p . u of the end of the workspace [m]
    double stiffness = 100;   ///< of the end at the top [N/m]
  };

  /// Throws Error(input) naming the value that is out of its range.
  explicit ArmSupport(const Options& options);

  /// The force rises anew.
  void begin() noexcept { on_ = Ramp(0); }

  /// Returns the force on the hand, in W [N]. `acts` turns it on or off, and `wanted` [N] is the F_0 that it shall
  /// have.
  [[nodiscard]] Vec3 update(const State& state, bool acts, double wanted) noexcept;

  /// Returns the present F_0 [N].
  [[nodiscard]] double force() const noexcept { return force_; }

 private:
  [[nodiscard]] Vec3 steady(const Vec3& position, const Vec3& velocity) const noexcept;

  Options options_;
  double force_;  ///< F_0 [N]
  Ramp on_{0};
};

}  // namespace haptrace
