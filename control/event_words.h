// How the list of warnings reports the events of a session.
#pragma once

#include "base/mailbox.h"
#include "control/sample.h"
#include "control/warning.h"

#include <array>
#include <optional>
#include <span>
#include <string_view>

namespace haptrace {

/// Describes how the list of warnings reports an event of this kind. A new EventCode needs a row in each of the two
/// tables beside describe().
struct EventWords {
  EventCode code = EventCode::mark;
  const char* name = "";             ///< Warning::code
  std::optional<Severity> severity;  ///< absent: the event is not a warning
  const char* repeated = "";  ///< text for repeated events, as in "the force was limited"; needed with a severity
  bool stops = false;         ///< true if the event ends a session; SessionResult warns of the end, whatever its cause
  int share = -1;             ///< index of the value that is the remaining share of the gains; -1: none
};

inline constexpr std::size_t kMostEventKinds = 64;
std::span<const EventWords> event_words() noexcept;   ///< one row for every EventCode
const EventWords* words_of(EventCode code) noexcept;  ///< null for a code of a newer version

/// Returns true if warnings with this code come from a recording's events.
bool is_of_event(std::string_view warning_code) noexcept;

/// Number of events of one kind, with the first and the last.
struct EventCount {
  std::uint64_t count = 0;
  Event first, last;
};

/// Returns one warning for all events of a kind. `words` and `events` must not be empty.
Warning warning_of(const EventWords& words, const EventCount& events);

/// Counts the events of a session that are warnings.
///
/// Threads: push from the servo loop, latest from one other thread. Real-time: push.
class EventTally final : public SampleSink {
 public:
  using Counts = std::array<EventCount, kMostEventKinds>;  ///< indexed by row of event_words()

  void push(const Sample&) noexcept override {}
  void push(const Event& event) noexcept override;
  [[nodiscard]] const Counts& latest() noexcept { return mailbox_.latest(); }

 private:
  Mailbox<Counts> mailbox_;
  Counts counts_;
};

}  // namespace haptrace
