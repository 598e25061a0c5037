// A person's intention, which replaces the intent of a simulated hand.
#pragma once

#include "base/mailbox.h"
#include "base/types.h"

#include <cstdint>

namespace haptrace {

class Device;

/// Where a person wants a simulated hand to be.
struct HandIntention {
  Vec3 position = Vec3::Zero();  ///< in W [m]
  double grip = 0;               ///< firmness of the hold: 0 lets go, 1 holds with the hand's full stiffness
  std::int64_t time_ns = 0;      ///< CLOCK_MONOTONIC when it arrived [ns]
};

/// Passes the newest intention from the thread that receives it to the simulated hand.
///
/// An intention older than kStale lets go: a person who is not there holds nothing.
///
/// Threads: post from one thread, latest from one other. Real-time: latest.
class HandSteering {
 public:
  static constexpr std::int64_t kStale = 300'000'000;  ///< [ns]

  void post(const HandIntention& intention) noexcept { mailbox_.post(intention); }
  [[nodiscard]] const HandIntention& latest() noexcept { return mailbox_.latest(); }

 private:
  Mailbox<HandIntention> mailbox_;
};

/// Returns the intentions of the person at the live view, which steer every simulated hand with intent=view. A process
/// steers one such hand at a time.
HandSteering& view_steering() noexcept;

/// Returns the intentions that steer the simulated hand of `device`, which may be wrapped or emulated; null if nobody
/// steers it.
HandSteering* steering_of(const Device& device);

}  // namespace haptrace
