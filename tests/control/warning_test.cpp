#include "control/warning.h"

#include "control/event_words.h"
#include "control/sample.h"

#include <array>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <set>
#include <string>
#include <string_view>
#include <utility>

namespace haptrace {
namespace {

using testing::HasSubstr;

/// Returns true if EventCode names this number: the compilers print a named value as EventCode::name, and any other one
/// as a cast of a number.
template <EventCode code>
constexpr bool is_named() {
  return std::string_view(__PRETTY_FUNCTION__).find("EventCode::") != std::string_view::npos;
}
static_assert(is_named<EventCode::mark>() && !is_named<static_cast<EventCode>(0)>());

constexpr int kMostCode = 200;

template <int... number>
constexpr std::array<bool, sizeof...(number)> named_codes(std::integer_sequence<int, number...>) {
  return {is_named<static_cast<EventCode>(number)>()...};
}

TEST(Warning, HasATextForEveryEventCode) {
  constexpr auto kNamed = named_codes(std::make_integer_sequence<int, kMostCode>());
  std::set<std::string> names;
  std::size_t codes = 0;
  for (int number = 0; number < kMostCode; ++number) {
    const auto code = static_cast<EventCode>(number);
    if (!kNamed[static_cast<std::size_t>(number)]) {
      EXPECT_EQ(describe({.code = code}), "event " + std::to_string(number));
      continue;
    }
    ++codes;
    EXPECT_NE(describe({.code = code}), "event " + std::to_string(number));
    const EventWords* words = words_of(code);
    ASSERT_NE(words, nullptr) << "EventCode " << number << " has no row in kEventWords";
    EXPECT_TRUE(names.insert(words->name).second) << words->name << " names two codes";
    EXPECT_EQ(words->severity.has_value(), std::string(words->repeated) != "") << words->name;
    EXPECT_LT(words->share, 3) << words->name;
  }
  EXPECT_EQ(event_words().size(), codes) << "a code has two rows, or is not below kMostCode";
}

TEST(Warning, ReportsSeveralEventsOfAKindAsOne) {
  EventTally tally;
  for (int i = 0; i < 14; ++i)
    tally.push({.time_ns = 3'200'000'000 + i, .code = EventCode::force_limit, .values = {12, 8.9, kNaN}});
  tally.push({.time_ns = 1, .code = EventCode::mark});
  const EventTally::Counts& counts = tally.latest();
  std::size_t kinds = 0;
  for (std::size_t row = 0; row < event_words().size(); ++row) {
    if (counts[row].count == 0) continue;
    ++kinds;
    const Warning warning = warning_of(event_words()[row], counts[row]);
    EXPECT_EQ(warning.code, "force_limit");
    EXPECT_EQ(warning.text, "the force was limited 14 times, first at 3.2 s");
    EXPECT_DOUBLE_EQ(warning.time, 3.2);
    EXPECT_EQ(warning.severity, Severity::warning);
  }
  EXPECT_EQ(kinds, 1U);
}

TEST(Warning, OfOneEventIsTheTextOfTheEvent) {
  const EventWords* words = words_of(EventCode::oscillation);
  ASSERT_NE(words, nullptr);
  EventCount events{1, {.time_ns = 450'000'000, .code = EventCode::oscillation, .values = {3e-4, 59, 0.5}}, {}};
  EXPECT_EQ(warning_of(*words, events).text, "the loop oscillates at 59 Hz, 0.30 mm: gains softened to 50 %, at 0.5 s");
  events.count = 3;
  events.last = {.time_ns = 900'000'000, .code = EventCode::oscillation, .values = {3e-4, 59, 0.125}};
  EXPECT_THAT(warning_of(*words, events).text, HasSubstr("3 times, first at 0.5 s; last: "));
  EXPECT_THAT(warning_of(*words, events).text, HasSubstr("softened to 12 %"));
}

TEST(Events, SayByHowMuchAForceWasLimitedEvenIfItIsLittle) {
  EXPECT_EQ(describe({.code = EventCode::force_limit, .values = {14.25, 12, kNaN}}),
            "force limited: 14.2 N requested, 12 N allowed");
  EXPECT_EQ(describe({.code = EventCode::force_limit, .values = {12.004, 12, kNaN}}),
            "force limited: 12.004 N requested, 12 N allowed");
}

TEST(Events, SayWhatAPersonSteersASimulatedHandWith) {
  EXPECT_EQ(describe({.code = EventCode::input, .values = {1, 1, kNaN}}), "input: mouse, depth from path");
  EXPECT_EQ(describe({.code = EventCode::input, .values = {5, 0, kNaN}}), "input: keys, depth from a plane");
  EXPECT_EQ(describe({.code = EventCode::input, .values = {kNaN, kNaN, kNaN}}), "input: unknown, depth from a plane");
}

}  // namespace
}  // namespace haptrace
