// Warnings: everything that a person should know of a session, whoever finds it out. One type, and one list of them,
// SessionResult::warnings, which reaches the terminal, the summary, --json, the recording and the report.
#pragma once

#include "base/mailbox.h"
#include "control/sample.h"

#include <array>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace haptrace {

struct Warning {
  enum class Severity {
    note,     ///< worth knowing
    warning,  ///< something is not as it should be; the session goes on
    error,    ///< ended the session, or cost data
  };
  Severity severity = Severity::warning;
  std::string code;    ///< the kind, for programs: lower case, words joined by _
  double time = kNaN;  ///< since the session's first tick [s]; NaN: not of a moment
  std::string text;    ///< one line for people, complete without the other members
};

const char* to_string(Warning::Severity severity) noexcept;

/// How the warnings list reports an event of this kind. A new EventCode gets a row in the table beside describe().
struct EventWords {
  EventCode code = EventCode::mark;
  const char* name = "";                      ///< Warning::code
  std::optional<Warning::Severity> severity;  ///< absent: the event is no warning
  const char* repeated = "";  ///< what happens several times, as in "the force was limited"; needed with a severity
  bool stops = false;         ///< the event ends a session; SessionResult warns of the end, whatever its cause
  int share = -1;             ///< index of the value that is the share of the gains in force; -1: none
};

inline constexpr std::size_t kMostEventKinds = 64;
std::span<const EventWords> event_words() noexcept;   ///< one row for every EventCode
const EventWords* words_of(EventCode code) noexcept;  ///< null for a code of a newer version

/// Whether warnings with this code are made of a recording's events.
bool is_of_event(std::string_view warning_code) noexcept;

/// Several events of one kind.
struct EventCount {
  std::uint64_t count = 0;
  Event first, last;
};

/// One warning for all events of a kind. Words and count must not be empty.
Warning warning_of(const EventWords& words, const EventCount& events);

/// Counts the events of a session that are warnings.
///
/// Threads: push from the servo loop, latest from one other thread. Real-time: push.
class EventTally final : public SampleSink {
 public:
  using Counts = std::array<EventCount, kMostEventKinds>;  ///< by row of event_words()

  void push(const Sample&) noexcept override {}
  void push(const Event& event) noexcept override;
  [[nodiscard]] const Counts& latest() noexcept { return mailbox_.latest(); }

 private:
  Mailbox<Counts> mailbox_;
  Counts counts_;
};

}  // namespace haptrace
