// Detection of a hand that resists, and of one that lets go.
#pragma once

#include "control/sample.h"

#include <optional>

namespace haptrace {

struct HandWatchOptions {
  static constexpr double kNever = 1e3;  ///< for `held`: a hand that lets go is not reported

  /// Force that the law needs to move the device alone [N]: its friction, gravity and inertia along the path, as far as
  /// they are not compensated. With a disturbance estimate, the part of them that its model leaves.
  double needed = 2;
  double resisting = 3;      ///< force beyond `needed` from which a hand resists; resistance ends at half of it [N]
  double resist_time = 0.5;  ///< time for which this force must last [s]
  double held = 3;           ///< load from which a hand can let go [N]
  double held_time = 0.3;    ///< time for which this load must last before [s]
};

/// Returns options for a device with peak force `max_force` [N] and unknown friction and weight: the hand resists from
/// half the peak force on.
HandWatchOptions hand_watch_of(double max_force);

/// Throws Error(input) naming the option that is out of its range.
void validate(const HandWatchOptions& options);

/// Watches the load on a tracking law: the force that holds the tool back from its reference. The load is the estimate
/// of a disturbance observer or, without one, the law's own force, which equals the load when nothing accelerates.
/// First-order low passes remove tremor and acceleration. Resistance uses 50 ms. Letting go compares 20 ms with 200 ms,
/// so that only a fall within about a quarter of a second counts.
///
/// Each condition is reported once, and again only after it has ended.
///
/// Real-time: all but the constructor. Threads: one at a time.
class HandWatch {
 public:
  /// Throws the errors of validate().
  explicit HandWatch(const HandWatchOptions& options = {});

  /// Takes the values of a tick, `dt` [s] after the previous one. `force` is the force applied to the tool [N], `error`
  /// the reference minus the position [m], `disturbance` the external force on the tool [N], NaN without an estimate.
  /// Ignores values that are not finite. Returns hand_resists or hand_let_go when the condition begins.
  std::optional<Event> update(const Vec3& force, const Vec3& error, const Vec3& disturbance, double dt) noexcept;

  /// Forgets the past load.
  void reset() noexcept;

  [[nodiscard]] bool resists() const noexcept { return resists_; }

 private:
  HandWatchOptions options_;
  Vec3 load_ = Vec3::Zero(), quick_ = Vec3::Zero(), slow_ = Vec3::Zero();  ///< low-passed [N]
  double opposing_ = 0;                                                    ///< [N]
  double resisting_for_ = 0, held_for_ = 0;                                ///< [s]
  bool resists_ = false;
};

}  // namespace haptrace
