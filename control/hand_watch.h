// Notices a hand that resists, and one that lets go.
#pragma once

#include "control/sample.h"

#include <optional>

namespace haptrace {

struct HandWatchOptions {
  /// What the law needs against the device alone: its friction, gravity and inertia along the path, as far as they are
  /// not compensated. With a disturbance estimate, what of them its model leaves [N].
  double needed = 2;
  double resisting = 3;      ///< beyond `needed`, from which a hand resists; it has stopped at half of it [N]
  double resist_time = 0.5;  ///< for which it must [s]
  double held = 3;           ///< load from which a hand can let go [N]
  double held_time = 0.3;    ///< for which that load must have been there [s]
};

/// Options for a device whose peak force is `max_force` [N] and whose friction and weight are unknown: the hand resists
/// from half the peak force on.
HandWatchOptions hand_watch_of(double max_force);

/// Throws Error(input) naming the option that is out of its range.
void validate(const HandWatchOptions& options);

/// Judges the load on a tracking law: the force that holds the tool back from its reference. It is what a disturbance
/// observer says, and without one the law's own force, which is the load when nothing accelerates. First-order low
/// passes take tremor and acceleration out of it: 50 ms for resisting; for letting go, 20 ms against 200 ms, so that
/// only a fall within about a quarter of a second is one.
///
/// Each condition is told once, and again only after it was over.
///
/// Real-time: all but the constructor. Threads: one at a time.
class HandWatch {
 public:
  /// Throws what validate throws.
  explicit HandWatch(const HandWatchOptions& options = {});

  /// At every tick, `dt` [s] after the one before. `force` is what was applied on the tool [N], `error` reference minus
  /// position [m], `disturbance` what others push the tool with [N], NaN when nobody estimates it. Values that are not
  /// finite change nothing. Answers hand_resists or hand_let_go when it begins.
  std::optional<Event> update(const Vec3& force, const Vec3& error, const Vec3& disturbance, double dt) noexcept;

  /// Forgets what the load was.
  void reset() noexcept;

  [[nodiscard]] bool resists() const noexcept { return resists_; }
  [[nodiscard]] double opposing() const noexcept { return opposing_; }  ///< force beyond what is needed [N]

 private:
  HandWatchOptions options_;
  Vec3 load_ = Vec3::Zero(), quick_ = Vec3::Zero(), slow_ = Vec3::Zero();  ///< low-passed [N]
  double opposing_ = 0;                                                    ///< [N]
  double resisting_for_ = 0, held_for_ = 0;                                ///< [s]
  bool resists_ = false;
};

}  // namespace haptrace
