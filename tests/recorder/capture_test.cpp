// Selection of the recorded part of a session: laws over random sessions, then single cases.
#include "recorder/capture.h"

#include "tests/support/errors.h"

#include <algorithm>
#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

namespace haptrace {
namespace {

using testing::HasSubstr;

constexpr std::int64_t kMs = 1'000'000;

/// A sample or an event of the output, in the order of output.
struct Kept {
  std::int64_t time_ns = 0;
  std::int64_t tick = -1;  ///< Tick of a sample; -1 for an event.
  std::int32_t code = 0;   ///< Code of an event.
  std::string text;
  bool operator==(const Kept&) const = default;
};

void PrintTo(const Kept& kept, std::ostream* out) {
  *out << (kept.tick >= 0 ? "sample " + std::to_string(kept.tick) : "event " + kept.text) << " at " << kept.time_ns;
}

class List final : public Capture::Output {
 public:
  void append(std::span<const Sample> samples, std::span<const ContactSample> touched) override {
    for (const Sample& s : samples) items.push_back({s.time_ns, static_cast<std::int64_t>(s.tick), 0, {}});
    contacts.insert(contacts.end(), touched.begin(), touched.end());
  }
  void append(const StoredEvent& event) override {
    items.push_back({std::llround(1e9 * event.time), -1, event.code, event.text});
  }
  std::vector<Kept> items;
  std::vector<ContactSample> contacts;
};

/// A session: samples with gaps in ticks and times, and events at any time, some at the time of a sample.
struct Session {
  CaptureOptions options;
  std::vector<Sample> samples;
  std::vector<TimedEvent> events;  ///< oldest first
};

Session random_session(std::mt19937& random) {
  const auto below = [&](std::uint32_t n) { return static_cast<std::int64_t>(random() % n); };
  Session session;
  session.options.mark_buttons = below(2) == 0;
  if (below(3) > 0) session.options.pre = 1e-3 * static_cast<double>(below(2) == 0 ? below(40) : below(400));
  std::int64_t time = 0, tick = 0;
  for (std::int64_t i = below(300); i >= 0; --i) {
    Sample sample;
    sample.tick = static_cast<std::uint64_t>(tick);
    sample.time_ns = time;
    sample.buttons = below(12) == 0 ? static_cast<std::uint32_t>(below(4)) : 0;
    session.samples.push_back(sample);
    const std::int64_t missed = below(20) == 0 ? below(10) : 0;
    tick += 1 + missed;
    time += (1 + missed) * kMs + below(kMs / 10);
  }
  for (std::int64_t i = below(12); i > 0; --i) {
    constexpr EventCode kCodes[] = {EventCode::mark, EventCode::paused, EventCode::resumed, EventCode::triggered,
                                    EventCode::overrun};
    const std::int64_t at = below(3) == 0 ? session.samples[random() % session.samples.size()].time_ns
                                          : below(static_cast<std::uint32_t>(time + kMs));
    session.events.push_back({at, kCodes[below(5)], "event " + std::to_string(i)});
  }
  std::stable_sort(session.events.begin(), session.events.end(),
                   [](const TimedEvent& a, const TimedEvent& b) { return a.time_ns < b.time_ns; });
  return session;
}

/// Feeds a session in batches of random sizes, or in one batch without `random`. An event comes with the samples of its
/// time or before them.
std::vector<Kept> feed(const Session& session, std::mt19937* random) {
  List list;
  Capture capture(session.options, list);
  std::size_t sample = 0, event = 0;
  while (sample < session.samples.size()) {
    const std::size_t left = session.samples.size() - sample;
    const std::size_t count = random == nullptr ? left : std::min<std::size_t>(left, (*random)() % 50);
    const std::span batch = std::span(session.samples).subspan(sample, count);
    const std::int64_t until = count > 0 ? batch.back().time_ns : -1;
    std::vector<TimedEvent> events;
    while (event < session.events.size() &&
           (session.events[event].time_ns <= until || (random != nullptr && (*random)() % 8 == 0)))
      events.push_back(session.events[event++]);
    capture.feed(batch, std::move(events));
    sample += count;
  }
  capture.feed({}, {session.events.begin() + static_cast<std::ptrdiff_t>(event), session.events.end()});
  capture.finish();
  return list.items;
}

TEST(Capture, KeepsTheSameSamplesForAnyBatchSizes) {
  std::mt19937 random(1);
  for (int i = 0; i < 3000; ++i) {
    const Session session = random_session(random);
    const std::vector<Kept> whole = feed(session, nullptr);
    ASSERT_EQ(feed(session, &random), whole) << "session " << i;
  }
}

TEST(Capture, KeepsExactlyTheSamplesAroundTheTriggerAndOutsideOfPauses) {
  std::mt19937 random(2);
  int triggered_sessions = 0, paused_samples = 0;
  for (int i = 0; i < 3000; ++i) {
    const Session session = random_session(random);
    // The expectation follows from the definition, for each sample by itself.
    const auto trigger = std::find_if(session.events.begin(), session.events.end(),
                                      [](const TimedEvent& e) { return e.code == EventCode::triggered; });
    const auto pause_at = [&](std::int64_t time) {
      bool paused = false;
      for (const TimedEvent& e : session.events)
        if (e.time_ns <= time && (e.code == EventCode::paused || e.code == EventCode::resumed))
          paused = e.code == EventCode::paused;
      return paused;
    };
    std::vector<std::int64_t> expected, times;
    for (const Sample& sample : session.samples) {
      if (session.options.pre && (trigger == session.events.end() ||
                                  sample.time_ns < trigger->time_ns - std::llround(1e9 * *session.options.pre)))
        continue;
      if (pause_at(sample.time_ns)) {
        ++paused_samples;
        continue;
      }
      expected.push_back(static_cast<std::int64_t>(sample.tick));
      times.push_back(sample.time_ns);
    }
    const bool armed_for_ever = session.options.pre && trigger == session.events.end();
    std::int64_t begin = 0;
    if (session.options.pre && !armed_for_ever) {
      ++triggered_sessions;
      const bool something_before = !times.empty() && times.front() < trigger->time_ns;
      begin = something_before ? times.front() : trigger->time_ns;
    }

    std::vector<std::int64_t> kept;
    std::vector<std::pair<std::int64_t, std::string>> events, expected_events;
    for (const Kept& item : feed(session, &random)) {
      if (item.tick < 0) {
        if (item.text.find("button") == std::string::npos) events.emplace_back(item.time_ns, item.text);
        continue;
      }
      ASSERT_LT(kept.size(), times.size()) << "session " << i;
      EXPECT_EQ(item.time_ns, times[kept.size()] - begin) << "session " << i;
      kept.push_back(item.tick);
    }
    ASSERT_EQ(kept, expected) << "session " << i;
    // Events stay in order, from the trigger on, with the recording's time.
    for (auto e = session.options.pre ? trigger : session.events.begin(); e != session.events.end(); ++e)
      expected_events.emplace_back(e->time_ns - begin, e->text);
    ASSERT_EQ(events, expected_events) << "session " << i;
  }
  EXPECT_GT(triggered_sessions, 300);
  EXPECT_GT(paused_samples, 3000);
}

TEST(Capture, MarksAButtonAtTheSampleInWhichItWentDown) {
  std::mt19937 random(3);
  for (int i = 0; i < 1000; ++i) {
    Session session = random_session(random);
    session.options = {.pre = std::nullopt, .mark_buttons = true};
    session.events.clear();
    std::vector<Kept> expected;
    std::uint32_t before = 0;
    for (const Sample& s : session.samples) {
      for (int button = 0; button < 2; ++button)
        if ((s.buttons >> button & 1U) != 0 && (before >> button & 1U) == 0)
          expected.push_back(
              {s.time_ns, -1, static_cast<std::int32_t>(EventCode::mark), "button " + std::to_string(button + 1)});
      expected.push_back({s.time_ns, static_cast<std::int64_t>(s.tick), 0, {}});
      before = s.buttons;
    }
    ASSERT_EQ(feed(session, &random), expected) << "session " << i;
  }
}

Sample at(std::int64_t ms) {
  Sample sample;
  sample.tick = static_cast<std::uint64_t>(ms);
  sample.time_ns = ms * kMs;
  return sample;
}

TEST(Capture, ReportsThatItIsArmedAndKeepsNothing) {
  List list;
  Capture capture({.pre = 0.01}, list);
  for (int i = 0; i < 100; ++i) capture.feed(std::vector{at(i)}, {{i * kMs, EventCode::mark, "m"}});
  EXPECT_TRUE(capture.armed());
  capture.finish();
  EXPECT_TRUE(capture.armed());
  EXPECT_TRUE(list.items.empty());
}

TEST(Capture, StartsItsTimeAtTheTriggerWithoutEarlierSamples) {
  List list;
  Capture capture({.pre = 0}, list);
  capture.feed(std::vector{at(0), at(1), at(2), at(3)}, {{2 * kMs, EventCode::triggered, "now"}});
  ASSERT_EQ(list.items.size(), 3U);
  EXPECT_EQ(list.items[0], (Kept{0, -1, static_cast<std::int32_t>(EventCode::triggered), "now"}));
  EXPECT_EQ(list.items[1], (Kept{0, 2, 0, {}}));
  EXPECT_EQ(list.items[2], (Kept{kMs, 3, 0, {}}));
}

TEST(Capture, ActsOnAnEventThatComesLateBeforeTheNextSample) {
  List list;
  Capture capture({}, list);
  capture.feed(std::vector{at(0), at(1), at(2)}, {});
  capture.feed(std::vector{at(3), at(4)}, {{1 * kMs, EventCode::paused, "paused"}});
  EXPECT_TRUE(capture.paused());
  ASSERT_EQ(list.items.size(), 4U);
  EXPECT_EQ(list.items[3].text, "paused");
  EXPECT_EQ(list.items[3].time_ns, kMs);
}

TEST(Capture, KeepsEverySampleWhileThePathOfAPlaybackWaitsForTheHand) {
  List list;
  Capture capture({}, list);
  capture.feed(std::vector{at(0), at(1), at(2), at(3), at(4)},
               {{1 * kMs, EventCode::reference_waits, "waits"}, {3 * kMs, EventCode::reference_goes_on, "continues"}});
  EXPECT_FALSE(capture.paused());
  EXPECT_EQ(std::count_if(list.items.begin(), list.items.end(), [](const Kept& item) { return item.tick >= 0; }), 5);
}

TEST(Capture, KeepsTheContactsOfTheSamplesThatItKeeps) {
  const auto touch = [](std::int64_t ms) {
    return ContactSample{.tick = static_cast<std::uint64_t>(ms), .time_ns = ms * kMs};
  };
  List list;
  Capture capture({.pre = 0.002}, list);
  std::vector<Sample> samples;
  std::vector<ContactSample> contacts;
  for (int ms = 0; ms < 20; ++ms) {
    samples.push_back(at(ms));
    if (ms % 2 == 0) contacts.insert(contacts.end(), {touch(ms), touch(ms)});
  }
  capture.feed(
      samples,
      {{9 * kMs, EventCode::triggered, "now"}, {12 * kMs, EventCode::paused, "p"}, {17 * kMs, EventCode::resumed, "r"}},
      contacts);
  capture.finish();
  std::vector<std::int64_t> ticks, times;
  for (const ContactSample& contact : list.contacts) {
    ticks.push_back(static_cast<std::int64_t>(contact.tick));
    times.push_back(contact.time_ns / kMs);
  }
  EXPECT_EQ(ticks, (std::vector<std::int64_t>{8, 8, 10, 10, 18, 18}));
  EXPECT_EQ(times, (std::vector<std::int64_t>{1, 1, 3, 3, 11, 11})) << "time 0 is 2 ms before the trigger";
}

TEST(Capture, RejectsAnInvalidTimeBeforeTheTrigger) {
  for (const double pre : {-0.1, 601.0, std::nan(""), std::numeric_limits<double>::infinity()})
    EXPECT_THAT(test::error_of([&] { validate(CaptureOptions{.pre = pre}); }), HasSubstr("must be from 0 to 600 s"));
  validate(CaptureOptions{.pre = 0});
  validate(CaptureOptions{.pre = kLongestPre});
}

}  // namespace
}  // namespace haptrace
