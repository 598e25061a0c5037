// Requests from outside to a running session, as its servo loop reads them.
#pragma once

#include "base/mailbox.h"
#include "control/limits.h"

#include <cstdint>

namespace haptrace {

/// Requests that concern a whole session. Plain data, to be posted through a Mailbox.
struct SessionRequests {
  bool paused = false;        ///< the session waits
  double share = 1;           ///< of the feedback forces, 0 to 1
  double support = kNaN;      ///< force that shall carry the arm [N]; NaN: as the session began
  std::uint32_t skips = 0;    ///< number of requests so far to end the present repetition
  std::uint32_t repeats = 0;  ///< number of requests so far for a further repetition
};

/// Follows the requests of a session in its servo loop.
///
/// Real-time: all.
class RequestFollower {
 public:
  static constexpr double kFade = 0.2;  ///< time in which the forces fade out completely [s]
  static constexpr double kReturn = 1;  ///< ... and come back; slower, because the hand may be far from the path

  RequestFollower() = default;
  /// Borrows `requests`; may be null. Requests to skip or repeat from before this call have no effect. With
  /// `rests_in_pause`, a pause takes the whole share.
  explicit RequestFollower(Mailbox<SessionRequests>* requests, bool rests_in_pause = false) noexcept
      : requests_(requests), rests_in_pause_(rests_in_pause) {
    if (requests_ == nullptr) return;
    now_ = requests_->latest();
    skips_ = now_.skips;
    repeats_ = now_.repeats;
    share_ = Ramp(wanted_share());
  }

  /// Reads the newest requests, `dt` [s] after the last call.
  void update(double dt) noexcept {
    if (requests_ != nullptr) now_ = requests_->latest();
    share_.advance(wanted_share(), dt, wanted_share() > share_.value() ? kReturn : kFade);
  }

  [[nodiscard]] bool paused() const noexcept { return now_.paused; }
  [[nodiscard]] double wanted_share() const noexcept { return paused() && rests_in_pause_ ? 0 : now_.share; }
  /// Returns the share of the feedback forces in force, which follows the wanted one without a step.
  [[nodiscard]] double share() const noexcept { return share_.value(); }
  /// Returns the force that shall carry the arm [N]; NaN: as the session began.
  [[nodiscard]] double support() const noexcept { return now_.support; }
  /// Returns true once for each request, or several requests in one tick, to end the present repetition.
  [[nodiscard]] bool take_skip() noexcept {
    const bool asked = now_.skips != skips_;
    skips_ = now_.skips;
    return asked;
  }
  /// Returns the number of further repetitions requested since the last call.
  [[nodiscard]] int take_repeats() noexcept {
    const auto asked = static_cast<int>(now_.repeats - repeats_);
    repeats_ = now_.repeats;
    return asked;
  }

 private:
  Mailbox<SessionRequests>* requests_ = nullptr;
  bool rests_in_pause_ = false;
  SessionRequests now_;
  std::uint32_t skips_ = 0, repeats_ = 0;
  Ramp share_{1};
};

}  // namespace haptrace
