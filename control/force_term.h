// Terms that sum to a tracking force.
#pragma once

#include "control/controller.h"
#include "control/tuning.h"

#include <memory>
#include <vector>

namespace haptrace {

/// Input of a force term.
struct TermInput {
  const State& state;
  const Reference& reference;  ///< finite, except its time
  const Tuning& tuning;
  Vec3 before = Vec3::Zero();  ///< sum of the terms before this one [N]
};

/// One summand of a tracking force. A session holds only the terms that it is composed of; a term that is off is
/// absent. The session calls the terms in their order, each with the sum of the terms before it.
///
/// Real-time: force and start.
class ForceTerm {
 public:
  virtual ~ForceTerm() = default;
  /// Called with the first state of a session, and with the first state after a gap in it.
  virtual void start(const State& first) noexcept { (void)first; }

  /// Returns this term's force on the hand [N], in W.
  [[nodiscard]] virtual Vec3 force(const TermInput& input) noexcept = 0;

  /// Returns the stiffness and damping of the last force; zero for a term that does not respond to the position.
  ///
  /// Real-time.
  [[nodiscard]] virtual PdGains gains(const Tuning& tuning) const noexcept {
    (void)tuning;
    return {};
  }

  /// Returns true if another law computes the feedback from the last force on; see Command::renewed.
  ///
  /// Real-time.
  [[nodiscard]] virtual bool renewed() const noexcept { return false; }

  /// Returns true if the term responds to the position, and thus oscillates when the loop does. Otherwise its force is
  /// known beforehand, from the reference.
  [[nodiscard]] virtual bool feeds_back() const noexcept { return false; }

  /// Called after every tick, outside of it, like SampleSink::between_ticks. May wait only if `may_wait` is set, that
  /// is, if time stands still meanwhile.
  virtual void between_ticks(bool may_wait) noexcept { (void)may_wait; }
};

using ForceTerms = std::vector<std::unique_ptr<ForceTerm>>;

}  // namespace haptrace
