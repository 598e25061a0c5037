#include "view/live_view.h"

#include "base/error.h"
#include "devices/loop/clock.h"
#include "devices/registry.h"
#include "devices/sim/hand_steering.h"
#include "formats/recording/recording.h"
#include "player/record.h"
#include "player/record_controllers.h"
#include "player/tuning/commands.h"
#include "recorder/annotations.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"
#include "tests/support/temp_folder.h"
#include "tests/view/page_client.h"
#include "view/frames.h"
#include "view/live_sink.h"
#include "view/view_channels.h"

#include <atomic>
#include <cmath>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <memory>
#include <mutex>
#include <thread>

namespace haptrace {
namespace {

using test::BinaryMessage;
using test::PageClient;
using test::port_of;
using test::TempFolder;
using test::token_of;

/// A page of a role that has shown its token.
struct JoinedPage : PageClient {
  JoinedPage(const LiveView& view, ViewRole role, const char* wants = "none")
      : PageClient(port_of(view.address(role))) {
    hello(token_of(view.address(role)));
    greeting = wait_for("hello");
    send({{"type", "want"}, {"data", wants}});
    // Messages are obeyed in order, so the wish is known when the answer is here.
    send({{"type", "ping"}, {"id", 1}, {"sent", 0}});
    (void)wait_for("pong");
  }
  nlohmann::json greeting;
};

ViewedSession session_of(const Device& device) {
  ViewedSession session;
  session.name = "recorded.h5";
  session.title = "a title";
  session.verb = "record";
  session.device = device.info();
  session.virtual_time = device.info().virtual_time;
  session.max_force = 3;
  return session;
}

constexpr const char* kSimulated = "sim:preset=falcon,hand=firm,seed=1";

TEST(LiveView, APageSeesEverySampleThatTheFileHolds) {
  const TempFolder folder;
  LiveView view({});
  JoinedPage page(view, ViewRole::therapist, "samples");
  const auto device = open_device(kSimulated);
  RecordOptions options;
  options.duration = 0.5;
  options.session.loop.realtime = false;
  options.session.clock = ClockChoice::real;
  options.session.recording.emplace();
  options.session.recording->file = folder / "recorded.h5";
  SampleSink* const sinks[] = {&view.sink()};
  PassiveController passive;
  TimedController controller(passive, options.duration);
  view.begin(session_of(*device), {});
  StopRequest stop;
  const SessionResult result = run_session(*device, controller, {}, sinks, options.session, stop,
                                           [&](const SessionView& status) { view.show(status); });
  view.end(result);

  const RecordingReader reader(folder / "recorded.h5");
  const std::vector<Sample> samples = reader.read(0, reader.rows());
  ASSERT_GT(samples.size(), 50U);
  const ViewChannels channels(reader.columns());
  std::vector<float> values(channels.size());
  std::size_t row = 0;
  while (row < samples.size()) {
    const BinaryMessage batch = page.wait_for_binary(1);
    EXPECT_EQ(batch.flags, 0);
    ASSERT_EQ(batch.body.size(), 4 * batch.rows * (channels.size() + 1));
    std::vector<std::vector<float>> planes;
    for (std::size_t plane = 0; plane <= channels.size(); ++plane) planes.push_back(batch.plane(plane));
    for (std::uint32_t i = 0; i < batch.rows; ++i, ++row) {
      ASSERT_LT(row, samples.size());
      EXPECT_NEAR(batch.t0 + static_cast<double>(planes[0][i]), 1e-9 * static_cast<double>(samples[row].time_ns), 1e-8);
      channels.fill(samples[row], values);
      for (std::size_t c = 0; c < channels.size(); ++c)
        ASSERT_TRUE(planes[c + 1][i] == values[c] || (std::isnan(values[c]) && std::isnan(planes[c + 1][i])))
            << channels[c].name << " in row " << row;
    }
  }
  const nlohmann::json status =
      page.wait_for("status", [](const nlohmann::json& said) { return said["ended"] == true; });
  EXPECT_EQ(status["reason"], "finished");
  EXPECT_EQ(status["lost_rows"], 0);
}

/// Pushes with a constant force until it is stopped.
class PushingController final : public Controller {
 public:
  [[nodiscard]] Command update(const State&) noexcept override { return {.wrench = {.force = Vec3(0.5, 0, 0)}}; }
};

/// Notes the forces that left after the request to stop.
class ForcesAfterStop final : public SampleSink {
 public:
  explicit ForcesAfterStop(const StopRequest& stop) : stop_(stop) {}
  using SampleSink::push;
  void push(const Sample& sample) noexcept override {
    (sample.force.norm() > 0 ? pushing_ : zero_).fetch_add(1);
    if (stop_.count() > 0 && sample.force.norm() > 0) after_.fetch_add(1);
  }
  [[nodiscard]] bool pushes() const { return pushing_.load() > 100; }
  [[nodiscard]] int after() const { return after_.load(); }

 private:
  const StopRequest& stop_;
  std::atomic<int> pushing_{0}, zero_{0}, after_{0};
};

class LiveViewStops : public testing::TestWithParam<ViewRole> {};

TEST_P(LiveViewStops, AForceIsZeroAtTheNextTickAlthoughThePageMayNotControlAndTheReleaseIsLong) {
  LiveView view({});
  JoinedPage page(view, GetParam());
  EXPECT_EQ(page.greeting["control"], false);
  const auto device = open_device("sim:preset=falcon,hand=firm,seed=1");
  SessionOptions options;
  options.clock = ClockChoice::real;
  options.loop.realtime = false;
  options.loop.limits.release = 5;
  StopRequest stop;
  ForcesAfterStop forces(stop);
  SampleSink* const sinks[] = {&view.sink(), &forces};
  view.begin(session_of(*device), {.stop = &stop});
  PushingController controller;
  SessionResult result;
  std::thread session([&] { result = run_session(*device, controller, {}, sinks, options, stop); });
  while (!forces.pushes()) std::this_thread::yield();
  page.send({{"type", "stop"}, {"id", "not a number"}});
  session.join();
  view.end(result);
  EXPECT_EQ(result.servo.cause, StopCause::interrupted);
  EXPECT_EQ(stop.count(), 2);
  EXPECT_LE(forces.after(), 2) << "the tick that was under way, and one between the two requests";
  const nlohmann::json status =
      page.wait_for("status", [](const nlohmann::json& said) { return said["ended"] == true; });
  EXPECT_EQ(status["zero_force"], "confirmed");
  EXPECT_TRUE(status["force"].is_null()) << "nothing is measured any more";
}

INSTANTIATE_TEST_SUITE_P(Roles, LiveViewStops, testing::Values(ViewRole::therapist, ViewRole::trainee),
                         [](const auto& tested) { return to_string(tested.param); });

/// Keeps the commands of pages.
class NotedCommands final : public Commands {
 public:
  std::string obey(std::string_view command) override {
    const std::lock_guard lock(mutex_);
    lines_.emplace_back(command);
    if (command == "pause" || command == "resume") paused_ = command == "pause";
    if (command.starts_with("kp ")) value_ = std::stod(std::string(command.substr(3)));
    return "ok " + std::string(command);
  }
  [[nodiscard]] std::vector<LiveControl> controls() const override {
    const std::lock_guard lock(mutex_);
    return {
        {.name = "kp", .label = "Stiffness", .unit = "N/m", .value = value_, .least = 0, .largest = 2000, .step = 10}};
  }
  [[nodiscard]] std::vector<std::string> actions() const override { return {"pause", "mark"}; }
  bool attend(bool attended) override {
    const std::lock_guard lock(mutex_);
    lines_.emplace_back(attended ? "attended" : "unattended");
    return true;
  }
  [[nodiscard]] double share() const override { return 0.3; }
  [[nodiscard]] bool paused() const override {
    const std::lock_guard lock(mutex_);
    return paused_;
  }

  [[nodiscard]] std::vector<std::string> lines() const {
    const std::lock_guard lock(mutex_);
    return lines_;
  }
  void wait_for(const std::string& line) const {
    for (;;) {
      for (const std::string& known : lines())
        if (known == line) return;
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }

 private:
  mutable std::mutex mutex_;
  std::vector<std::string> lines_;
  double value_ = 100;
  bool paused_ = false;
};

/// A session that does not run: its samples are pushed by the test.
struct StandingSession {
  explicit StandingSession(LiveView& shown, ViewTargets targets = {}) : view(shown) {
    view.begin(session_of(*device), targets);
  }
  ~StandingSession() { view.abandon("over"); }
  StandingSession(const StandingSession&) = delete;
  StandingSession& operator=(const StandingSession&) = delete;

  void push(int milliseconds) {
    Sample sample;
    sample.tick = static_cast<std::uint64_t>(milliseconds);
    sample.time_ns = milliseconds * 1'000'000LL;
    sample.position = Vec3(1e-3 * milliseconds, 0, 0);
    sample.phase = milliseconds < 100 ? Phase::approach : Phase::run;
    view.sink().push(sample);
  }

  LiveView& view;
  std::unique_ptr<Device> device = open_device(kSimulated);
};

TEST(LiveView, ATherapistWithControlCommandsTheSessionAndSeesItsControls) {
  NotedCommands commands;
  LiveView view({.control = true});
  JoinedPage page(view, ViewRole::therapist);
  EXPECT_EQ(page.greeting["control"], true);
  const StandingSession session(view, {.commands = &commands});
  const nlohmann::json controls = page.wait_for("controls");
  EXPECT_EQ(controls["list"][0]["name"], "kp");
  EXPECT_EQ(controls["list"][0]["kind"], "number");
  EXPECT_EQ(controls["list"][0]["largest"], 2000);
  EXPECT_EQ(controls["actions"], (nlohmann::json{"pause", "mark"}));
  page.send({{"type", "command"}, {"id", 4}, {"line", "kp 250"}});
  const nlohmann::json answer = page.wait_for("answer");
  EXPECT_EQ(answer["id"], 4);
  EXPECT_EQ(answer["text"], "ok kp 250");
  EXPECT_EQ(page.wait_for("controls")["list"][0]["value"], 250) << "sent again because it changed";
  EXPECT_THAT(commands.lines(), testing::ElementsAre("kp 250"));

  JoinedPage late(view, ViewRole::therapist);
  EXPECT_EQ(late.wait_for("controls")["list"][0]["value"], 250);
}

TEST(LiveView, TakesTheTokensThatItsPageTakesAndNoOthers) {
  for (const std::string& token : {std::string("Sixteen0letters0"), std::string(128, 'z')})
    EXPECT_EQ(token_of(LiveView({.token = token}).address(ViewRole::therapist)), token);
  for (const std::string& token : {std::string("short"), std::string(129, 'z'), std::string("sixteen-letters-")})
    EXPECT_THAT(test::error_of([&] { (void)LiveView({.token = token}); }), testing::HasSubstr("16 to 128 letters"));
}

TEST(LiveView, TheStatusSaysWhetherACommandPausesTheSession) {
  NotedCommands commands;
  LiveView view({.control = true});
  JoinedPage page(view, ViewRole::therapist), trainee(view, ViewRole::trainee);
  const StandingSession session(view, {.commands = &commands});
  for (const bool paused : {false, true, false}) {
    const std::string line = paused ? "pause" : "resume";
    page.send({{"type", "command"}, {"id", 1}, {"line", line}});
    EXPECT_EQ(page.wait_for("answer")["text"], "ok " + line);
    for (JoinedPage* one : {&page, &trainee})
      one->wait_for("status", [&](const nlohmann::json& said) { return said["paused"] == paused; });
  }
}

TEST(LiveView, WithoutPermissionNoCommandReachesTheSession) {
  NotedCommands commands;
  const auto refused = [&](LiveView& view, ViewRole role) {
    const StandingSession session(view, {.commands = &commands});
    JoinedPage page(view, role);
    EXPECT_EQ(page.greeting["control"], false);
    page.send({{"type", "command"}, {"id", 1}, {"line", "kp 250"}});
    EXPECT_THAT(page.wait_for("answer")["text"].get<std::string>(), testing::StartsWith("error "));
  };
  LiveView without({.on_page_lost = PageLost::ignore}), with({.control = true, .on_page_lost = PageLost::ignore});
  refused(without, ViewRole::therapist);
  refused(without, ViewRole::trainee);
  refused(with, ViewRole::trainee);
  EXPECT_TRUE(commands.lines().empty());
}

TEST(LiveView, AfterASessionCommandsReachItNoMore) {
  NotedCommands commands;
  StopRequest stop;
  LiveView view({.control = true});
  JoinedPage page(view, ViewRole::therapist);
  { const StandingSession session(view, {.commands = &commands, .stop = &stop}); }
  page.send({{"type", "stop"}});
  page.send({{"type", "command"}, {"id", 1}, {"line", "kp 250"}});
  EXPECT_EQ(page.wait_for("answer")["text"], "error no session takes commands now");
  EXPECT_TRUE(commands.lines().empty());
  EXPECT_EQ(stop.count(), 0);
}

TEST(LiveView, ASilentControllingPageSoftensTheFeedbackUntilItIsBack) {
  NotedCommands commands;
  LiveView view({.control = true, .page_patience = 0.5});
  JoinedPage page(view, ViewRole::therapist);
  StandingSession session(view, {.commands = &commands});
  session.push(1);
  commands.wait_for("unattended");
  EXPECT_THAT(commands.lines(), testing::ElementsAre("unattended")) << "once, though the page said no more than hello";
  std::vector<Warning> warnings = view.warnings();
  while (warnings.empty()) warnings = view.warnings();
  EXPECT_EQ(warnings.front().code, "page_lost");
  EXPECT_EQ(warnings.front().severity, Severity::warning);
  page.send({{"type", "ping"}, {"id", 3}, {"sent", 0}});
  commands.wait_for("attended");
}

TEST(LiveView, TheStatusStatesTheShareThatCommandsAskFor) {
  NotedCommands commands;
  LiveView view({});
  const StandingSession session(view, {.commands = &commands});
  JoinedPage page(view, ViewRole::trainee);
  EXPECT_EQ(page.wait_for("status")["share"], 0.3);
}

TEST(LiveView, WhenAskedASilentControllingPageStopsTheSessionWithARelease) {
  StopRequest stop;
  LiveView view({.control = true, .on_page_lost = PageLost::stop, .page_patience = 0.5});
  auto page = std::make_unique<JoinedPage>(view, ViewRole::therapist);
  const StandingSession session(view, {.stop = &stop});
  page.reset();  // closed: that is silence, too
  while (stop.count() == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_EQ(stop.count(), 1);
  EXPECT_EQ(stop.source(), StopSource::lost_page);
  std::vector<Warning> warnings = view.warnings();
  while (warnings.empty()) warnings = view.warnings();
  EXPECT_EQ(warnings.front().severity, Severity::problem);
}

TEST(LiveView, AControllingPageThatWasLostInARestSoftensTheNextRepetition) {
  NotedCommands commands;
  LiveView view({.control = true, .page_patience = 0.5});
  {
    JoinedPage page(view, ViewRole::therapist);
    const StandingSession session(view, {.commands = &commands});
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(700));
  EXPECT_TRUE(commands.lines().empty()) << "no session runs";
  const StandingSession session(view, {.commands = &commands});
  commands.wait_for("unattended");
}

TEST(LiveView, AControllingPageThatIsBackInTheNextRepetitionLiftsTheSofteningOfTheOneBefore) {
  NotedCommands commands;
  LiveView view({.control = true, .page_patience = 0.5});
  JoinedPage page(view, ViewRole::therapist);
  const std::unique_ptr<Device> device = open_device(kSimulated);
  view.begin(session_of(*device), {.commands = &commands});
  commands.wait_for("unattended");
  view.end(SessionResult{}, true);
  view.begin(session_of(*device), {.commands = &commands});
  page.send({{"type", "ping"}, {"id", 3}, {"sent", 0}});
  commands.wait_for("attended");
  view.abandon("over");
}

TEST(LiveView, BetweenSessionsNoPhaseRunsAndAStopThereIsTheReasonOfTheEnd) {
  LiveView view({});
  JoinedPage page(view, ViewRole::therapist, "state");
  const std::unique_ptr<Device> device = open_device(kSimulated);
  view.begin(session_of(*device), {});
  view.end(SessionResult{}, true);
  const auto is_idle = [](const nlohmann::json& said) { return said["phase"] == "idle" && said["ended"] == false; };
  EXPECT_EQ(page.wait_for("status", is_idle)["reason"], "");
  view.over("stopped by a person");
  const auto has_ended = [](const nlohmann::json& said) { return said["ended"] == true; };
  EXPECT_EQ(page.wait_for("status", has_ended)["reason"], "stopped by a person");
}

TEST(LiveView, TheStatusSaysWhatBecomesOfTheSamples) {
  LiveView view({});
  const StandingSession session(view);
  JoinedPage page(view, ViewRole::therapist, "state");
  for (const auto& [armed, paused, expected] :
       {std::tuple(true, false, "armed"), std::tuple(false, true, "paused"), std::tuple(false, false, "on")}) {
    SessionView status;
    status.recording.emplace();
    status.recording->armed = armed;
    status.recording->paused = paused;
    view.show(status);
    (void)page.wait_for("status", [&](const nlohmann::json& said) { return said["recording"] == expected; });
  }
  view.show(SessionView{});
  (void)page.wait_for("status", [](const nlohmann::json& said) { return said["recording"] == ""; });
}

TEST(LiveView, TheStatusHasNoValuesWhenRowsStopComing) {
  LiveView view({});
  StandingSession session(view);
  JoinedPage page(view, ViewRole::therapist, "state");
  for (int i = 0; i < 20; ++i) session.push(i);
  const nlohmann::json later = page.wait_for(
      "status", [](const nlohmann::json& said) { return said["time"] == 0.019 && said["force"].is_null(); });
  EXPECT_EQ(later["rate"], 0);
  EXPECT_EQ(later["ended"], false);
}

TEST(LiveView, AStopBetweenTwoSessionsIsObeyedToo) {
  StopRequest between, within;
  LiveView view({.stop_between = &between});
  JoinedPage page(view, ViewRole::trainee);
  const auto stop = [&] {
    page.send({{"type", "stop"}});
    page.send({{"type", "ping"}, {"id", 2}, {"sent", 0}});
    (void)page.wait_for("pong");
  };
  stop();
  EXPECT_EQ(between.count(), 2);
  const StandingSession session(view, {.stop = &within});
  stop();
  EXPECT_EQ(between.count(), 2);
  EXPECT_EQ(within.count(), 2);
  EXPECT_EQ(within.source(), StopSource::page);
}

TEST(LiveView, APageThatJoinsAfterVeryManyEventsGetsTheNewest) {
  LiveView view({});
  StandingSession session(view);
  JoinedPage first(view, ViewRole::therapist);
  for (int i = 0; i < 30'000; ++i) {
    view.sink().push(
        Event{.time_ns = i, .code = EventCode::repetition, .values = {static_cast<double>(i), kNaN, kNaN}});
    if (i % 1000 == 0) {
      session.push(i);
      (void)first.wait_for("events", [&](const nlohmann::json& said) {
        return !said["list"].empty() && said["list"].back()["text"] == "repetition " + std::to_string(i + 1);
      });
    }
  }
  (void)first.wait_for("events", [](const nlohmann::json& said) {
    return !said["list"].empty() && said["list"].back()["text"] == "repetition 30000";
  });
  JoinedPage late(view, ViewRole::therapist);
  const nlohmann::json events = late.wait_for("events");
  EXPECT_EQ(events["list"].size(), 2000U);
  EXPECT_EQ(events["list"].back()["text"], "repetition 30000");
}

TEST(LiveView, TheSilenceOfAPageWithoutControlChangesNothing) {
  NotedCommands commands;
  LiveView view({.control = true, .page_patience = 0.5});
  JoinedPage trainee(view, ViewRole::trainee);
  const StandingSession session(view, {.commands = &commands});
  std::this_thread::sleep_for(std::chrono::milliseconds(900));
  EXPECT_TRUE(commands.lines().empty());
}

TEST(LiveView, WhatAPageShowedIsAnEventOfTheRecording) {
  Annotations annotations;
  LiveView view({});
  JoinedPage page(view, ViewRole::trainee);
  StandingSession session(view, {.annotations = &annotations});
  for (int i = 0; i < 200; ++i) session.push(i);
  (void)page.wait_for("status", [](const nlohmann::json& said) { return said["time"] > 0.19; });
  page.send({{"type", "shown"}, {"what", "go"}, {"trial", 3}, {"frame", 1234}, {"time", 0.125}});
  page.send({{"type", "shown"}, {"what", "later"}, {"trial", 3}, {"frame", 1234}, {"time", 0.125}});
  page.send({{"type", "shown"}, {"what", "done"}, {"trial", 3}, {"frame", 1300}, {"time", 1e6}});
  const nlohmann::json told = page.wait_for("events", [](const nlohmann::json& said) { return !said["list"].empty(); });
  EXPECT_EQ(told["reset"], false);
  EXPECT_EQ(told["list"][0]["name"], "shown_go");
  page.send({{"type", "ping"}, {"id", 2}, {"sent", 0}});
  (void)page.wait_for("pong");
  const std::vector<TimedEvent> events = annotations.take();
  ASSERT_EQ(events.size(), 2U);
  EXPECT_EQ(events[0].code, EventCode::shown_go);
  EXPECT_EQ(events[0].time_ns, 125'000'000);
  EXPECT_EQ(events[0].text, "go shown: trial 3, frame 1234");
  EXPECT_EQ(events[1].code, EventCode::shown_done);
  EXPECT_EQ(events[1].time_ns, 199'000'000) << "not later than the session";
}

TEST(LiveView, MarksFromElsewhereReachThePagesToo) {
  Annotations annotations;
  annotations.mark("before the page came");
  LiveView view({});
  JoinedPage page(view, ViewRole::therapist);
  const StandingSession session(view, {.annotations = &annotations});
  annotations.mark("from the keyboard");
  const nlohmann::json told = page.wait_for("events", [](const nlohmann::json& said) { return !said["list"].empty(); });
  EXPECT_EQ(told["list"][0]["text"], "from the keyboard");
}

/// Waits until the newest intention is as asked.
HandIntention wait_for_hand(HandSteering& steering, const std::function<bool(const HandIntention&)>& asked) {
  while (!asked(steering.latest())) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  return steering.latest();
}

TEST(LiveView, OnePageAtATimeMovesTheSimulatedHandWithinItsWorkspace) {
  HandSteering steering;
  LiveView view({.steer = true});
  JoinedPage first(view, ViewRole::trainee), second(view, ViewRole::therapist);
  EXPECT_EQ(first.greeting["steer"], true);
  const StandingSession session(view, {.steering = &steering});
  const std::int64_t before = monotonic_ns();
  first.intend(0.01, 0.02, -0.005, 0.5);
  HandIntention hand = wait_for_hand(steering, [](const HandIntention& now) { return now.grip > 0; });
  EXPECT_FLOAT_EQ(static_cast<float>(hand.position.y()), 0.02F);
  EXPECT_EQ(hand.grip, 0.5);
  EXPECT_GE(hand.time_ns, before);
  EXPECT_LE(hand.time_ns, monotonic_ns());

  second.intend(-0.01, 0, 0, 1);
  second.send({{"type", "ping"}, {"id", 5}, {"sent", 0}});
  (void)second.wait_for("pong");
  EXPECT_GT(steering.latest().position.x(), 0) << "the first page holds the hand";

  first.intend(1000, 0, 0, 1);
  hand = wait_for_hand(steering, [](const HandIntention& now) { return now.position.x() > 0.02; });
  EXPECT_LE(hand.position.x(), session.device->info().workspace_max.x() * 1.3);

  first.disconnect();
  hand = wait_for_hand(steering, [](const HandIntention& now) { return now.grip == 0; });
  second.intend(-0.01, 0, 0, 1);
  (void)wait_for_hand(steering, [](const HandIntention& now) { return now.grip == 1 && now.position.x() < 0; });
  // Silence lets go, without a message.
  (void)wait_for_hand(steering, [](const HandIntention& now) { return now.grip == 0; });
}

TEST(LiveView, WithoutPermissionNoPageMovesTheHand) {
  HandSteering steering;
  LiveView view({.control = true});
  JoinedPage page(view, ViewRole::therapist);
  const StandingSession session(view, {.steering = &steering});
  page.intend(0.01, 0, 0, 1);
  page.send({{"type", "ping"}, {"id", 5}, {"sent", 0}});
  (void)page.wait_for("pong");
  EXPECT_EQ(steering.latest().grip, 0);
  EXPECT_EQ(steering.latest().time_ns, 0);
}

TEST(LiveView, APageThatJoinsLaterSeesWhatHappenedBefore) {
  LiveView view({});
  StandingSession session(view);
  JoinedPage first(view, ViewRole::therapist, "state");
  view.programme({{"title", "lesson"}});
  view.training({{"state", "approach"}});
  view.training({{"state", "go"}});
  SessionView status;
  status.live.overruns = 3;
  status.warnings.push_back({Severity::warning, "force_limit", 0.1, "the force was limited"});
  view.show(status);
  view.sink().push(Event{.code = EventCode::repetition, .values = {0, kNaN, kNaN}});
  for (int i = 0; i < 300; ++i) session.push(i);
  while (first.wait_for_binary(2).t0 < 0.299) {
  }
  (void)first.wait_for("status", [](const nlohmann::json& said) { return said["overruns"] == 3; });

  JoinedPage late(view, ViewRole::therapist);
  const nlohmann::json recording = late.wait_for("recording");
  EXPECT_EQ(recording["title"], "a title");
  EXPECT_EQ(recording["limits"], (nlohmann::json{{"max_force", 3}}));
  EXPECT_NEAR(recording["end"].get<double>(), 0.299, 1e-9);
  EXPECT_EQ(late.wait_for("events")["list"][0]["text"], "repetition 1");
  EXPECT_EQ(late.wait_for("warning")["text"], "the force was limited");
  const nlohmann::json phases = late.wait_for("phases");
  EXPECT_EQ(phases["reset"], true);
  EXPECT_EQ(phases["list"][0], (nlohmann::json{0.0, 0.1, "approach"}));
  EXPECT_EQ(late.wait_for("programme")["title"], "lesson");
  EXPECT_EQ(late.wait_for("training")["state"], "go") << "the newest";
  EXPECT_EQ(late.wait_for_binary(4).rows, 0U) << "no path";

  late.send({{"type", "rows"}, {"id", 8}, {"t0", 0.1}, {"t1", 0.2}});
  const BinaryMessage rows = late.wait_for_answer(8);
  EXPECT_EQ(rows.rows, 101U);
  EXPECT_FLOAT_EQ(rows.plane(1).front(), 0.1F);
  late.send({{"type", "bins"}, {"id", 9}, {"t0", 0}, {"t1", 0.3}, {"pixels", 10}, {"channels", {"x"}}});
  const test::DecodedBins bins = test::decode_bins(late.wait_for_answer(9));
  EXPECT_FLOAT_EQ(bins.channels[0].max.back(), 0.299F);
  late.send({{"type", "bins"}, {"id", 10}, {"t0", 0}, {"t1", 0.3}, {"pixels", 10}, {"channels", {"nothing"}}});
  EXPECT_EQ(late.wait_for("error")["id"], 10);
}

TEST(LiveView, AfterAReconnectThePageGetsTheRowsThatItMissed) {
  LiveView view({});
  StandingSession session(view);
  {
    JoinedPage page(view, ViewRole::therapist, "samples");
    for (int i = 0; i <= 5000; ++i) session.push(i);
    (void)page.wait_for_binary(
        [](const BinaryMessage& batch) { return batch.kind == 1 && batch.t0 + 1e-3 * batch.rows > 5; });
  }
  for (const auto& [last, first_row] : {std::pair(4.5, 4.501), std::pair(5.0, 0.0)}) {
    PageClient page(port_of(view.address(ViewRole::therapist)));
    page.hello(token_of(view.address(ViewRole::therapist)), last);
    page.send({{"type", "ping"}, {"id", 2}, {"sent", 0}});
    if (first_row == 0) {
      (void)page.wait_for("pong");
      continue;
    }
    const BinaryMessage rows = page.wait_for_binary(1);
    EXPECT_EQ(rows.flags, FrameFlags::kBackfill);
    EXPECT_NEAR(rows.t0, first_row, 1e-9);
    EXPECT_EQ(rows.rows, 500U);
  }
  for (int i = 5001; i <= 20'000; ++i) {
    session.push(i);
    if (i % 1000 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  JoinedPage watching(view, ViewRole::therapist);
  (void)watching.wait_for("status", [](const nlohmann::json& said) { return said["time"] == 20; });
  PageClient page(port_of(view.address(ViewRole::therapist)));
  page.hello(token_of(view.address(ViewRole::therapist)), 1.0);
  const BinaryMessage rows = page.wait_for_binary(1);
  EXPECT_EQ(rows.flags, FrameFlags::kBackfill | FrameFlags::kGap);
  EXPECT_NEAR(rows.t0, 8, 1e-9) << "twelve seconds at most";
}

TEST(LiveView, InVirtualTimeNoSampleIsLostHoweverFastTheSessionRuns) {
  LiveView view({});
  JoinedPage page(view, ViewRole::therapist);
  const auto device = open_device(kSimulated);
  SessionOptions options;
  SampleSink* const sinks[] = {&view.sink()};
  PassiveController passive;
  TimedController controller(passive, 120);
  view.begin(session_of(*device), {});
  const SessionResult result = run_session(*device, controller, {}, sinks, options, StopRequest{});
  view.end(result);
  const nlohmann::json status =
      page.wait_for("status", [](const nlohmann::json& said) { return said["ended"] == true; });
  EXPECT_EQ(status["lost_rows"], 0);
  EXPECT_GT(status["time"], 119);
  page.send({{"type", "bins"}, {"id", 3}, {"t0", 0}, {"t1", 120}, {"pixels", 200}, {"channels", {"x"}}});
  const test::DecodedBins bins = test::decode_bins(page.wait_for_answer(3));
  for (const float value : bins.channels[0].min) EXPECT_FALSE(std::isnan(value));
}

TEST(LiveView, ItsSinkAllocatesNothingAndNeverWaitsInRealTime) {
  LiveSink sink;
  sink.prepare(1000);
  const Sample sample;
  const Event event;
  const std::size_t before = test::allocations();
  for (int i = 0; i < 50'000; ++i) {
    sink.push(sample);
    sink.push(event);
    sink.between_ticks(false);
  }
  EXPECT_EQ(test::allocations(), before);
  std::size_t kept = 0;
  sink.take([&](const Sample&, const ContactSample*) { ++kept; }, [](const Event&) {});
  EXPECT_EQ(kept + sink.lost(), 50'000U) << "what does not fit is counted";
  EXPECT_GE(kept, 16'384U);
}

TEST(LiveView, SeveralSessionsFollowOneAnotherOnTheSamePages) {
  LiveView view({});
  JoinedPage page(view, ViewRole::therapist);
  for (int trial = 1; trial <= 3; ++trial) {
    StandingSession session(view);
    EXPECT_EQ(page.wait_for("recording")["trial"], trial);
    EXPECT_EQ(page.wait_for("events")["reset"], true);
    session.push(1);
    view.abandon("the next one comes");
    EXPECT_EQ(page.wait_for("status", [](const nlohmann::json& said) { return said["ended"] == true; })["reason"],
              "the next one comes");
  }
}

TEST(LiveView, ItWaitsForAPageAndCountsThem) {
  LiveView view({});
  EXPECT_FALSE(view.wait_for_page(std::chrono::milliseconds(1)));
  const JoinedPage page(view, ViewRole::trainee);
  EXPECT_TRUE(view.wait_for_page(std::chrono::minutes(1)));
  EXPECT_EQ(view.pages(), 1U);
}

TEST(LiveView, InvalidOptionsAreRefused) {
  EXPECT_NE(test::error_of([] { LiveView({.page_patience = 0}); }), "no error");
  EXPECT_NE(test::error_of([] { LiveView({.page_patience = kNaN}); }), "no error");
  EXPECT_THAT(test::error_of([] { (void)parse_page_lost("sotfen"); }), testing::HasSubstr("soften"));
  EXPECT_EQ(parse_page_lost("stop"), PageLost::stop);
}

}  // namespace
}  // namespace haptrace
