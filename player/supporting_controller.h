// A controller whose hand is also relieved of a part of its arm's weight.
#pragma once

#include "control/arm_support.h"
#include "player/session.h"
#include "player/tuning/session_requests.h"

#include <string>
#include <vector>

namespace haptrace {

/// Adds the support of the arm to another controller: F = F_inner + F_support, before every limit.
///
/// It is known beforehand, so it is feedforward, which neither the loop nor a request softens: an arm must not drop
/// because a wall vibrates, or a page is silent. A pause that takes all forces takes it, too.
///
/// `inner` gets the force without the support in State::force_applied: what the support carries is no load any more,
/// neither for an observer, which would cancel it a second time, nor for the energy account of guidance.
///
/// Real-time: all but the constructor.
class SupportingController final : public Controller {
 public:
  /// Borrows `inner` and the requests of `touch`. Throws what ArmSupport throws.
  SupportingController(Controller& inner, const ArmSupport::Options& support, const TouchOptions& touch);

  void start(const State& first) noexcept override;
  void resume(const State& first) noexcept override;
  [[nodiscard]] Command update(const State& state) noexcept override;
  void between_ticks(bool may_wait) noexcept override { inner_.between_ticks(may_wait); }

  /// Returns the force that carries the arm once it has risen [N]. After the session, the last one.
  [[nodiscard]] double force() const noexcept { return support_.force(); }

 private:
  void forget() noexcept;

  Controller& inner_;
  ArmSupport support_;
  double planned_;  ///< force that carries the arm until a request changes it [N]
  Mailbox<SessionRequests>* mailbox_;
  bool rests_in_pause_;
  RequestFollower requests_;
  Vec3 carried_ = Vec3::Zero();  ///< support, as sent to the loop at the last tick [N]
};

/// A support that was checked against a device.
struct SupportPlan {
  ArmSupport::Options support;
  double most = 0;      ///< largest force that it may have [N]
  std::string because;  ///< what bounds it, as in "force that this device can hold for long"
  std::vector<std::string> warnings;
};

/// Returns the support of a session on a device: at most kSupportShare of the force that the motors can hold and of the
/// session's limit, so that the rest of the session has some, and ending below the top of the workspace as softly as
/// the device is stable. Throws Error(input) if the device has no motor against gravity, or a value is out of its
/// range.
SupportPlan plan_support(const DeviceInfo& device, const SessionOptions& options);

inline constexpr double kSupportShare = 0.7;    ///< of the continuous force, and of the limit
inline constexpr double kSupportedRelease = 1;  ///< least time in which the forces of such a session fade out [s]

}  // namespace haptrace
