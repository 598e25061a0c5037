// Tests of the commands that tune a running session: their limits, their answers and their traces in the recording.
#include "player/tuning/live_tuning.h"

#include "control/path/shapes.h"
#include "control/pd.h"
#include "formats/recording/recording.h"
#include "player/playback/playback.h"
#include "player/tuning/tuning_file.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"
#include "tests/support/point_mass.h"
#include "tests/support/temp_folder.h"

#include <chrono>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>
#include <thread>

namespace haptrace {
namespace {

using test::error_of;
using test::PointMass;
using test::TempFolder;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

const Tuning kStart{.gains = {Vec3::Constant(1000), Vec3(10, 10, 20)}, .observer = 0.8, .observer_hz = 10};
const Compensations kAll{true, true, true, true, true};

LiveTuning::Options identified() {
  return {.limits = {.largest = {Vec3(5200, 5200, 4000), Vec3::Constant(60)},
                     .observer_hz = 25,
                     .because = "stability limit of this device"},
          .composed = kAll};
}

/// Waits until `done()`, without a time limit of its own.
template <class Condition>
void wait_until(const Condition& done) {
  while (!done()) std::this_thread::sleep_for(std::chrono::milliseconds(5));
}

TEST(LiveTuning, AnswersWithTheValueInForceWhichTheTickTakes) {
  LiveTuning tuning(kStart, identified());
  EXPECT_EQ(tuning.mailbox().latest().gains.kp, kStart.gains.kp);
  const std::pair<const char*, const char*> dialogue[] = {{"kp 2000", "ok kp 2000 2000 2000"},
                                                          {"kp 2000 2000 1500", "ok kp 2000 2000 1500"},
                                                          {"  kd\t20 \r", "ok kd 20 20 20"},
                                                          {"gains * 1.1", "ok kp 2200 2200 1650 kd 22 22 22"},
                                                          {"gains/1.1", "ok kp 2000 2000 1500 kd 20 20 20"},
                                                          {"observer 0.5", "ok observer 0.5"},
                                                          {"observer off", "ok observer 0"},
                                                          {"observer on", "ok observer 0.8"},
                                                          {"observer_hz 12", "ok observer_hz 12"},
                                                          {"inertia off", "ok inertia 0"},
                                                          {"friction 0.8", "ok friction 0.8"},
                                                          {"gravity", "ok gravity 1"},
                                                          {"learning toggle", "ok learning 0"},
                                                          {"learning toggle", "ok learning 1"},
                                                          {"feedforward toggle", "ok inertia 0 gravity 0 friction 0"},
                                                          {"feedforward on", "ok inertia 1 gravity 1 friction 1"},
                                                          {"get kp", "ok kp 2000 2000 1500"},
                                                          {"quit", "ok bye"}};
  for (const auto& [command, answer] : dialogue) EXPECT_EQ(tuning.obey(command), answer) << command;

  const Tuning& taken = tuning.mailbox().latest();
  EXPECT_EQ(taken.gains.kp, tuning.wanted().gains.kp);
  EXPECT_DOUBLE_EQ(taken.gains.kp.z(), 1500);
  EXPECT_DOUBLE_EQ(taken.gains.kd.x(), 20);
  EXPECT_EQ(taken.observer_hz, 12);
  EXPECT_EQ(taken.observer, 0.8);
}

TEST(LiveTuning, GetsEverythingAsOneObject) {
  LiveTuning tuning(kStart, identified());
  const nlohmann::json json = nlohmann::json::parse(tuning.obey("get"));
  EXPECT_EQ(json["kp"], nlohmann::json({1000, 1000, 1000}));
  EXPECT_EQ(json["kd"], nlohmann::json({10, 10, 20}));
  EXPECT_EQ(json["observer"], 0.8);
  EXPECT_EQ(json["limits"]["kp"], nlohmann::json({5200, 5200, 4000}));
  EXPECT_EQ(json["limits"]["observer_hz"], 25);
  LiveTuning plain(kStart, {});
  EXPECT_FALSE(nlohmann::json::parse(plain.obey("get")).contains("observer")) << "a missing compensation has no share";
}

TEST(LiveTuning, ClampsToTheLimitsOfTheDeviceAndReportsIt) {
  LiveTuning tuning(kStart, identified());
  EXPECT_EQ(tuning.obey("kp 9000"),
            "ok kp 5200 5200 4000 clamped from 9000: 5200 5200 4000 is the stability limit of this device");
  EXPECT_EQ(tuning.obey("kd 1e300"), "ok kd 60 60 60 clamped from 1e+300: 60 is the stability limit of this device");
  EXPECT_EQ(tuning.obey("observer_hz 40"),
            "ok observer_hz 25 clamped from 40: 25 is the stability limit of this device");
  LiveTuning unknown(kStart, {});
  EXPECT_THAT(unknown.obey("kp 2e5"),
              StartsWith("ok kp 100000 100000 100000 clamped from 200000: 100000 is the limit for every device"));
}

TEST(LiveTuning, ScalesAllGainsByOneFactorAlsoWhenItIsClamped) {
  LiveTuning tuning({.gains = {Vec3::Constant(1000), Vec3::Constant(30)}}, identified());
  EXPECT_THAT(tuning.obey("gains * 3"),
              AllOf(StartsWith("ok kp 2000 2000 2000 kd 60 60 60 clamped from * 3"), HasSubstr("kd 60")));
  tuning.obey("gains / 2");
  EXPECT_TRUE(tuning.wanted().gains.kp.isApprox(Vec3::Constant(1000), 1e-12));
}

TEST(LiveTuning, NeverClampsBelowItsOwnStart) {
  LiveTuning tuning({.gains = {Vec3::Constant(8000), Vec3::Constant(100)}, .observer_hz = 50}, identified());
  EXPECT_EQ(tuning.obey("kp 100"), "ok kp 100 100 100");
  EXPECT_EQ(tuning.obey("kp 8000"), "ok kp 8000 8000 8000");
  EXPECT_THAT(tuning.obey("reset"), StartsWith("ok"));
  EXPECT_EQ(tuning.wanted().gains.kd, Vec3::Constant(100));
  EXPECT_THAT(error_of([] { LiveTuning({.gains = {Vec3::Constant(-1), Vec3::Zero()}}, {}); }), HasSubstr("kp"));
}

TEST(LiveTuning, LimitsADeviceOfUnknownDynamicsToTenTimesItsCautiousGains) {
  LiveTuning tuning({.gains = cautious_gains(8, 1000)}, {.limits = limits_of_unidentified(8, 1000)});
  EXPECT_THAT(tuning.obey("kp 9000"), AllOf(StartsWith("ok kp 5000 5000 5000"), HasSubstr("--expert")));
}

TEST(LiveTuning, RefusesWithTheReasonAndChangesNothing) {
  LiveTuning tuning(kStart, identified());
  const std::string before = tuning.obey("get");
  const std::pair<const char*, const char*> slips[] = {{"kq 2000", "did you mean 'kp'"},
                                                       {"obsever off", "did you mean 'observer'"},
                                                       {"kp -5", "negative"},
                                                       {"kp 1 2", "three"},
                                                       {"kp nan", "not a number"},
                                                       {"kp 12x", "'12x' is not a number"},
                                                       {"kp 1 -2 3", "negative"},
                                                       {"kp inf", "not a number"},
                                                       {"gains 2", "gains * 1.1"},
                                                       {"gains * 0", "above 0"},
                                                       {"gains / 0", "above 0"},
                                                       {"gains * -1", "above 0"},
                                                       {"gains / 1e-320", "above 0"},
                                                       {"observer 1.5", "from 0 (none) to 1 (all)"},
                                                       {"observer of", "not a number"},
                                                       {"observer_hz 0", "at least"},
                                                       {"get obsever", "'observer'"},
                                                       {"get kp kd", "one name"},
                                                       {"reset kp", "takes no value"},
                                                       {"", "the line is empty"},
                                                       {"kp \x1b[2J", "printable ASCII"},
                                                       {"kp 2000\nkd 5", "printable ASCII"},
                                                       {"k\xc3\xa4p 5", "printable ASCII"}};
  for (const auto& [command, reason] : slips)
    EXPECT_THAT(tuning.obey(command), AllOf(StartsWith("error "), HasSubstr(reason))) << command;
  EXPECT_EQ(tuning.obey("get"), before);
  EXPECT_THAT(tuning.take_notices(), IsEmpty());
}

TEST(LiveTuning, SaysHowToStartWithACompensationThatIsNotThere) {
  LiveTuning tuning(kStart, {.composed = {.gravity = true}, .remedy = "start it with --observer"});
  for (const char* command : {"observer off", "observer", "observer_hz 5", "get observer", "learning on"})
    EXPECT_THAT(tuning.obey(command), AllOf(StartsWith("error "), HasSubstr("start it with --observer"))) << command;
  EXPECT_EQ(tuning.obey("feedforward 0.5"), "ok gravity 0.5") << "applies to the present ones of the three";
  EXPECT_EQ(tuning.wanted().inertia, kStart.inertia);
}

TEST(LiveTuning, AnswersAnyBytesWithOneLineOfPrintableAsciiWithinItsLimits) {
  LiveTuning tuning(kStart, identified());
  const std::vector<std::string> words{"kp",     "kd",   "gains",    "*",  "/",   "1e999", "-0",
                                       "1e-308", "get",  "observer", "on", "off", "reset", "nan",
                                       "0x10",   "\xff", "toggle",   "5",  "help"};
  std::mt19937 random(7);
  for (int i = 0; i < 20000; ++i) {
    std::string command;
    for (auto n = random() % 5; n > 0; --n)
      command += random() % 8 == 0 ? std::string(1, static_cast<char>(random())) : words[random() % words.size()] + " ";
    for (const char c : tuning.obey(command)) ASSERT_TRUE(c >= ' ' && c <= '~') << command;
    const Tuning wanted = tuning.wanted();
    ASSERT_TRUE((wanted.gains.kp.array() >= 0).all() && (wanted.gains.kp.array() <= 5200).all()) << command;
    ASSERT_TRUE((wanted.gains.kd.array() >= 0).all() && (wanted.gains.kd.array() <= 60).all()) << command;
    ASSERT_TRUE(wanted.observer >= 0 && wanted.observer <= 1) << command;
  }
}

TEST(LiveTuning, LeavesATraceOfEveryChangeAndOfNothingElse) {
  LiveTuning::Options options = identified();
  options.annotations = std::make_shared<Annotations>();
  LiveTuning tuning(kStart, options);
  tuning.push(Sample{.time_ns = 1'500'000'000});
  options.annotations->tick(1'500'000'000);
  for (const char* command : {"kp 1000", "get", "kp oops", "kp 1100", "kp 1200", "observer off", "reset", "reset"})
    tuning.obey(command);

  std::vector<std::string> marks;
  for (const TimedEvent& event : options.annotations->take()) {
    EXPECT_EQ(event.time_ns, 1'500'000'000);
    EXPECT_EQ(event.code, EventCode::mark);
    marks.push_back(event.text);
  }
  EXPECT_THAT(marks, ElementsAre("tuned: kp 1100", "tuned: kp 1200", "tuned: observer 0",
                                 "tuned: reset to kp 1000 kd 10 10 20"));
  EXPECT_THAT(tuning.take_notices(),
              ElementsAre("tuned: kp 1200", "tuned: observer 0", "tuned: reset to kp 1000 kd 10 10 20"))
      << "of several in a row to the same, the last";
  EXPECT_THAT(tuning.take_notices(), IsEmpty());
  const nlohmann::json history = tuning.history();
  EXPECT_EQ(history["changed"], 4);
  EXPECT_EQ(history["changes"][1]["text"], "kp 1200");
  EXPECT_EQ(history["changes"][1]["time_s"], 1.5);
}

TEST(LiveTuning, SummarisesGainsAndChangedShares) {
  LiveTuning tuning(kStart, identified());
  EXPECT_EQ(tuning.summary(), "kp 1000 kd 10 10 20 observer 0.8");
  tuning.obey("observer on");
  tuning.obey("friction off");
  EXPECT_EQ(tuning.summary(), "kp 1000 kd 10 10 20 friction off observer 0.8");
}

TEST(LiveTuning, TakesCommandsFromManyThreadsWhileATickReadsWholeValuesWithoutAllocating) {
  LiveTuning tuning(kStart, identified());
  std::vector<std::jthread> threads;
  for (int t = 0; t < 3; ++t)
    threads.emplace_back([&tuning, t](const std::stop_token& stop) {
      for (int i = 1; !stop.stop_requested(); ++i) tuning.obey("kp " + std::to_string(100 * (t + 1) + i % 50));
    });
  const std::size_t before = test::allocations();
  bool whole = true;
  for (int i = 0; i < 200'000; ++i) {
    const Tuning& taken = tuning.mailbox().latest();
    tuning.push(Sample{.time_ns = i});
    whole = whole && taken.gains.kp.x() == taken.gains.kp.y() && taken.gains.kp.y() == taken.gains.kp.z();
  }
  EXPECT_EQ(test::allocations(), before);
  EXPECT_TRUE(whole);
  threads.clear();
  EXPECT_EQ(tuning.mailbox().latest().gains.kp, tuning.wanted().gains.kp);
}

TEST(LiveTuning, ChangesAPlaybackThatRunsAndIsKeptInItsRecording) {
  const TempFolder folder;
  PointMass device;
  PlayOptions options;
  options.gains = PdGains{Vec3::Constant(400), Vec3::Constant(12)};
  options.session.loop.limits.max_velocity = 1.5;
  SessionOptions::Recording recording{.file = folder / "played.h5"};
  recording.options.annotations = std::make_shared<Annotations>();
  options.session.recording = recording;
  const PlayPlan plan = plan_playback(device.info(), make_shape("circle", {.duration = 4}), options);
  LiveTuning tuning(plan.tuning, {.annotations = recording.options.annotations});
  options.tuning = &tuning;

  /// A device that raises the gains at a fixed tick, independent of the machine's speed.
  struct Handled final : Device {
    Handled(Device& device, LiveTuning& live) : inner(device), tuning(live) {}
    [[nodiscard]] const DeviceInfo& info() const noexcept override { return inner.info(); }
    Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
      return inner.exchange(wrench, dt, state);
    }
    void between_ticks(bool may_wait) noexcept override {
      if (++calls == 2500) tuning.obey("gains * 5");
      inner.between_ticks(may_wait);
    }
    void close() noexcept override { inner.close(); }
    Device& inner;
    LiveTuning& tuning;
    int calls = 0;
  } handled(device, tuning);

  const PlayResult result = play(handled, plan, options, StopRequest{});
  EXPECT_EQ(result.session.servo.cause, StopCause::finished);
  EXPECT_THAT(result.session.warnings, testing::Contains(testing::Field(&Warning::text, "tuned: kp 2000 kd 60")));

  const RecordingReader reader(folder / "played.h5");
  const auto rows = reader.read(0, reader.rows());
  const auto rms = [&](std::int64_t from_ns, std::int64_t to_ns) {
    double sum = 0;
    int n = 0;
    for (const Sample& row : rows)
      if (row.phase == Phase::run && row.time_ns >= from_ns && row.time_ns < to_ns)
        sum += (row.position - row.reference_position).squaredNorm(), ++n;
    return std::sqrt(sum / n);
  };
  const std::int64_t begin =
      std::find_if(rows.begin(), rows.end(), [](const Sample& row) { return row.phase == Phase::run; })->time_ns;
  EXPECT_LT(begin, 2'000'000'000);
  EXPECT_LT(rms(3'000'000'000, begin + 4'000'000'000), 0.4 * rms(begin + 500'000'000, 2'400'000'000));
  const auto events = reader.events();
  const auto mark = std::find_if(events.begin(), events.end(),
                                 [](const StoredEvent& event) { return event.text == "tuned: kp 2000 kd 60"; });
  ASSERT_NE(mark, events.end());
  EXPECT_NEAR(mark->time, 2.5, 0.01);
}

TEST(TuningFile, IsObeyedAtOnceAndPassesOverComments) {
  const TempFolder folder;
  LiveTuning tuning(kStart, identified());
  const TuningFile file(tuning, folder.write("tune", "# mine\n\nkp 2000 # stiffer\n  kd 30\nobserver off"));
  EXPECT_EQ(tuning.wanted().gains.kp, Vec3::Constant(2000));
  EXPECT_EQ(tuning.wanted().gains.kd, Vec3::Constant(30));
  EXPECT_EQ(tuning.wanted().observer, 0);
}

TEST(TuningFile, IsObeyedAgainWhenItIsCreatedChangedOrReplaced) {
  const TempFolder folder;
  LiveTuning tuning(kStart, identified());
  const TuningFile file(tuning, folder / "tune");
  const auto kp = [&] { return tuning.wanted().gains.kp.x(); };
  EXPECT_EQ(kp(), 1000);
  (void)folder.write("tune", "kp 1100\n");
  wait_until([&] { return kp() == 1100; });
  (void)folder.write("tune", "kp 1200\n");
  wait_until([&] { return kp() == 1200; });
  std::filesystem::rename(folder.write("new", "kp 1300\n"), folder / "tune");
  wait_until([&] { return kp() == 1300; });
  std::filesystem::remove(folder / "tune");
  tuning.obey("kp 900");
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_EQ(kp(), 900) << "a file that went away changes nothing";
  (void)folder.write("tune", "kp 1300\n");
  wait_until([&] { return kp() == 1300; });
}

TEST(TuningFile, ReportsItsErrorsByLineAndObeysTheOtherLines) {
  const TempFolder folder;
  LiveTuning tuning(kStart, identified());
  const std::string name = folder.write("tune", "kp 2000\nkq 5\nkp 9000\n\x1b[2J\n");
  const TuningFile file(tuning, name);
  EXPECT_EQ(tuning.wanted().gains.kp.x(), 5200);
  const std::vector<std::string> notices = tuning.take_notices();
  EXPECT_THAT(notices, testing::Contains(AllOf(StartsWith(name + ": line 2: error"), HasSubstr("'kp'"))));
  EXPECT_THAT(notices, testing::Contains(AllOf(StartsWith(name + ": line 3: "), HasSubstr("clamped from 9000"))));
  EXPECT_THAT(notices, testing::Contains(StartsWith(name + ": line 4: error")));
  for (const std::string& notice : notices) EXPECT_EQ(notice.find('\x1b'), std::string::npos);
}

TEST(TuningFile, IsNotObeyedWhenOtherUsersCanWriteIt) {
  const TempFolder folder;
  const std::string name = folder.write("tune", "kp 2000\n");
  std::filesystem::permissions(name, std::filesystem::perms{0666});
  LiveTuning tuning(kStart, identified());
  const TuningFile file(tuning, name);
  EXPECT_THAT(tuning.take_notices(), ElementsAre(HasSubstr("other users can write this file")));
  EXPECT_EQ(tuning.wanted().gains.kp, kStart.gains.kp);
}

TEST(TuningFile, RejectsFilesThatAreNotRegularOrTooLarge) {
  const TempFolder folder;
  LiveTuning tuning(kStart, identified());
  const TuningFile directory(tuning, folder.path()), endless(tuning, "/dev/zero");
  const TuningFile large(tuning, folder.write("large", std::string(70'000, '\n') + "kp 5\n"));
  EXPECT_THAT(tuning.take_notices(),
              ElementsAre(HasSubstr("not a regular file"), HasSubstr("not a regular file"), HasSubstr("65536 bytes")));
  EXPECT_EQ(tuning.wanted().gains.kp, kStart.gains.kp);
}

}  // namespace
}  // namespace haptrace
