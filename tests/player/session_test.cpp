#include "control/path/shapes.h"
#include "control/pd.h"
#include "devices/registry.h"
#include "formats/path/path_file.h"
#include "formats/recording/recording.h"
#include "player/playback/playback.h"
#include "player/playback/playback_controller.h"
#include "player/playback/reference_stream.h"
#include "player/record.h"
#include "player/record_controllers.h"
#include "tests/player/calibration/identified_device.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"
#include "tests/support/point_mass.h"
#include "tests/support/temp_folder.h"

#include <algorithm>
#include <filesystem>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::error_of;
using test::PointMass;
using test::TempFolder;
using testing::HasSubstr;

std::vector<std::string> texts_of(const std::vector<Warning>& warnings) {
  std::vector<std::string> texts;
  for (const Warning& warning : warnings) texts.push_back(warning.text);
  return texts;
}

/// Returns the warning with this code; fails the test unless there is exactly one.
Warning warning_in(const SessionResult& result, const std::string& code) {
  std::vector<Warning> found;
  for (const Warning& warning : result.warnings)
    if (warning.code == code) found.push_back(warning);
  EXPECT_EQ(found.size(), 1U) << code << " among " << testing::PrintToString(texts_of(result.warnings));
  return found.empty() ? Warning{} : found.front();
}

PlayOptions options_for(const std::string& file) {
  PlayOptions options;
  options.gains = PdGains{Vec3::Constant(800), Vec3::Constant(12)};
  options.session.loop.limits.max_velocity = 1.5;
  if (!file.empty()) options.session.recording = SessionOptions::Recording{.file = file};
  return options;
}

TEST(Session, PlaysAPathAndRecordsEveryTickOfIt) {
  const TempFolder folder;
  PointMass device;
  const PlayOptions options = options_for(folder / "played.h5");
  const PlayResult result =
      play(device, plan_playback(device.info(), make_shape("square", {}), options), options, StopRequest{});
  EXPECT_EQ(result.session.servo.cause, StopCause::finished);
  EXPECT_GT(result.last.rms_error, 0);
  EXPECT_LT(result.last.rms_error, 0.005);

  const RecordingReader reader(folder / "played.h5");
  EXPECT_TRUE(reader.header().complete);
  EXPECT_EQ(reader.header().clock, "virtual");
  EXPECT_EQ(reader.rows(), result.session.servo.samples);
  EXPECT_TRUE(reader.columns().reference);
  const auto rows = reader.read(0, reader.rows());
  for (std::size_t i = 0; i < rows.size(); ++i) ASSERT_EQ(rows[i].tick, i);
  EXPECT_EQ(rows.back().force, Vec3::Zero());

  // The metrics computed during the session equal those of the file.
  double sum = 0;
  std::size_t n = 0;
  for (const Sample& row : rows)
    if (row.phase == Phase::run) {
      sum += (row.position - row.reference_position).squaredNorm();
      ++n;
    }
  EXPECT_NEAR(std::sqrt(sum / static_cast<double>(n)), result.last.rms_error, 1e-12);
  EXPECT_TRUE(check_recording(folder / "played.h5").empty());
}

TEST(Session, PlaysARecordingOfItselfAtItsOwnTimeStamps) {
  const TempFolder folder;
  PointMass device;
  PlayOptions options = options_for(folder / "first.h5");
  const Path square = make_shape("square", {.duration = 3});
  const PlayResult first = play(device, plan_playback(device.info(), square, options), options, StopRequest{});
  EXPECT_NEAR(first.last.duration, 3, 2e-3);

  PointMass again;
  options = options_for("");
  const PlayResult second =
      play(again, plan_playback(again.info(), load_path(folder / "first.h5"), options), options, StopRequest{});
  EXPECT_NEAR(second.last.duration, 3, 4e-3);
}

TEST(Session, RecordsAFreeHandWithoutForce) {
  const TempFolder folder;
  PointMass device;
  RecordOptions options{.duration = 0.5};
  options.session.recording = SessionOptions::Recording{.file = folder / "free.h5", .title = "a title"};
  const SessionResult result = record(device, options, StopRequest{});
  EXPECT_EQ(result.servo.cause, StopCause::finished);
  for (const Vec3& force : device.forces()) ASSERT_EQ(force, Vec3::Zero());
  const RecordingReader reader(folder / "free.h5");
  EXPECT_EQ(reader.header().title, "a title");
  EXPECT_FALSE(reader.columns().reference);
  EXPECT_NEAR(static_cast<double>(reader.rows()), 501, 1);
}

TEST(Session, SaysInTheRecordingThatAPersonSteeredTheHand) {
  const TempFolder folder;
  for (const auto& [intent, input] : {std::pair{",intent=view", "view"}, std::pair{"", ""}}) {
    const auto device = open_device(std::string("sim:preset=omega3,hand=relaxed") + intent);
    RecordOptions options{.duration = 0.05};
    options.session.recording = SessionOptions::Recording{.file = folder / (std::string(input) + "x.h5")};
    const SessionResult result = record(*device, options, StopRequest{});
    EXPECT_EQ(result.virtual_time, *input == '\0') << "a person's time does not wait";
    const RecordingHeader header = RecordingReader(options.session.recording->file).header();
    const auto found = header.meta.find("input");
    EXPECT_EQ(found != header.meta.end() ? found->second : "", input);
  }
}

TEST(Session, RefusesARecordingWithoutEndInVirtualTime) {
  PointMass device;
  EXPECT_THAT(error_of([&] { record(device, {}, StopRequest{}); }), HasSubstr("limit the recording with --duration"));
}

TEST(Session, RefusesAPathOutsideTheWorkspaceBeforeAnyForceAndSaysHowFar) {
  const TempFolder folder;
  PointMass device;
  PlayOptions options = options_for(folder / "never.h5");
  const Path far = make_shape("circle", {.size = 0.1, .centre = Vec3(0.2, 0, 0)});
  EXPECT_THAT(error_of([&] { plan_playback(device.info(), far, options); }),
              testing::AllOf(HasSubstr("leaves the workspace of point mass by 50.0 mm"), HasSubstr("--fit")));
  EXPECT_TRUE(device.forces().empty());
  EXPECT_FALSE(std::filesystem::exists(folder / "never.h5"));

  options.fit = true;
  const PlayPlan plan = plan_playback(device.info(), far, options);
  ASSERT_TRUE(plan.fit);
  const Box played = plan.path->source().facts().bounds;
  EXPECT_LE(played.max.maxCoeff(), 0.2);
  EXPECT_GE(played.min.minCoeff(), -0.2);
}

TEST(Session, RejectsAPathThatIsTooFastAndSuggestsASpeed) {
  PointMass device;
  PlayOptions options = options_for("");
  const Path fast = make_shape("circle", {.size = 0.3, .duration = 0.5});
  options.playback.speed = 8;  // slower, its time would be stretched
  const std::string error = error_of([&] { plan_playback(device.info(), fast, options); });
  EXPECT_THAT(error, HasSubstr("too close to the velocity limit of 1.50 m/s"));
  const double speed = std::stod(error.substr(error.find("--speed ") + 8));
  options.playback.speed = speed;
  EXPECT_NO_THROW(plan_playback(device.info(), fast, options));
}

TEST(Session, PlaysAPathInSpaceOnAPlanarDevice) {
  PointMass device;
  device.mutable_info().force_axes = {true, true, false};
  device.mutable_info().workspace_min.z() = device.mutable_info().workspace_max.z() = 0;
  PlayOptions options = options_for("");
  options.fit = true;
  Path path = make_shape("circle", {});
  for (std::size_t i = 0; i < path.size(); ++i) path.position[i].z() = 0.3;
  const PlayResult result = play(device, plan_playback(device.info(), path, options), options, StopRequest{});
  EXPECT_EQ(result.session.servo.cause, StopCause::finished);
  EXPECT_EQ(result.plan.fit.has_value(), false) << "the plane fits; the third axis has no say";
}

TEST(Session, LeavesNoFileBehindWhenAnOptionIsWrong) {
  const TempFolder folder;
  PointMass device;
  PlayOptions options = options_for(folder / "never.h5");
  const PlayPlan plan = plan_playback(device.info(), make_shape("circle", {}), options);
  options.session.loop.rate_hz = 5;
  EXPECT_THAT(error_of([&] { play(device, plan, options, StopRequest{}); }), HasSubstr("the rate is 5 Hz"));
  options.session.loop.rate_hz = 1000;
  options.session.velocity = "kalmann";
  EXPECT_THAT(error_of([&] { play(device, plan, options, StopRequest{}); }), HasSubstr("kalmann"));
  EXPECT_FALSE(std::filesystem::exists(folder / "never.h5"));
}

TEST(Session, KeepsTheRecordingWhenTheDeviceIsLost) {
  const TempFolder folder;
  PointMass device(0.5, 2, {.lost_at = 1500});
  const PlayOptions options = options_for(folder / "lost.h5");
  const PlayResult result =
      play(device, plan_playback(device.info(), make_shape("square", {}), options), options, StopRequest{});
  EXPECT_EQ(result.session.servo.cause, StopCause::device_lost);
  const RecordingReader reader(folder / "lost.h5");
  EXPECT_TRUE(reader.header().complete);
  EXPECT_NEAR(static_cast<double>(reader.rows()), 1499, 1);
  const auto events = reader.events();
  ASSERT_FALSE(events.empty());
  EXPECT_EQ(events.back().code, static_cast<std::int32_t>(EventCode::device_lost));
}

TEST(Session, ContinuesWithADeviceThatWasLostAndFound) {
  const TempFolder folder;
  // The device comes back at another position, beyond the deviation limit.
  PointMass device(0.5, 2, {.away_from = 2500, .away_until = 4500, .moved_while_away = Vec3(-0.05, 0.04, 0.03)});
  PlayOptions options = options_for(folder / "found.h5");
  options.session.loop.away_timeout = 5;
  const PlayPlan plan = plan_playback(device.info(), make_shape("square", {}), options);
  const PlayResult result = play(device, plan, options, StopRequest{});
  EXPECT_EQ(result.session.servo.cause, StopCause::finished) << result.session.servo.detail;
  EXPECT_EQ(result.session.servo.returns, 1U);
  ASSERT_EQ(result.repetitions.size(), 1U);

  PointMass undisturbed;
  const PlayOptions plain = options_for("");
  const PlayResult expected =
      play(undisturbed, plan_playback(undisturbed.info(), make_shape("square", {}), plain), plain, StopRequest{});
  EXPECT_NEAR(result.last.duration, expected.last.duration + 0.05, 0.01) << "the gap does not count";
  EXPECT_NEAR(result.last.rms_error, expected.last.rms_error, 0.1 * expected.last.rms_error);

  EXPECT_TRUE(check_recording(folder / "found.h5").empty()) << check_recording(folder / "found.h5").front().what;
  const RecordingReader reader(folder / "found.h5");
  const auto rows = reader.read(0, reader.rows());
  const auto back = std::find_if(rows.begin(), rows.end(), [](const Sample& row) { return row.tick >= 2499; });
  ASSERT_EQ(back->tick, 4499U);
  EXPECT_EQ(back->force, Vec3::Zero());
  EXPECT_LE((back->reference_position - back->position).norm(), 1e-12);
  for (auto row = back + 1; row != rows.end(); ++row) {
    const double grown = row->force.norm() - (row - 1)->force.norm();
    ASSERT_LE(grown, 0.15) << "tick " << row->tick;
  }
}

TEST(Session, RestartsTheLoadEstimateAndLearnsNothingFromARepetitionWithAGap) {
  SimDevice device(test::true_device(), {.lost_at = 1.5, .lost_for = 0.8});
  PlayOptions options = test::everything();
  options.session.loop.away_timeout = 5;
  const PlayPlan plan = plan_playback(device.info(), make_shape("circle", {.size = 0.06, .duration = 3}), options);
  test::Log log;
  options.sinks.push_back(&log);
  const PlayResult result = play(device, plan, options, StopRequest{});
  ASSERT_EQ(result.session.servo.cause, StopCause::finished) << result.session.servo.detail;
  EXPECT_EQ(result.session.servo.returns, 1U);
  ASSERT_EQ(result.lessons.size(), 2U);
  EXPECT_EQ(result.lessons[0].outcome, LearningOutcome::skipped);
  EXPECT_EQ(result.lessons[1].outcome, LearningOutcome::learned);
  EXPECT_LT(result.repetitions[2].rms_error, 0.7 * result.repetitions[1].rms_error);
  // The gap raises no alarm about the hand and causes no larger steps of the force.
  EXPECT_FALSE(log.has(EventCode::hand_let_go));
  EXPECT_FALSE(log.has(EventCode::oscillation));
  double before = 0;
  for (std::size_t i = 1; i < log.samples.size(); ++i) {
    const double step = (log.samples[i].force - log.samples[i - 1].force).norm();
    const std::uint64_t tick = log.samples[i].tick;
    if (tick < 1500) before = std::max(before, step);
    if (tick > 2300 && tick < 3000) {
      EXPECT_LE(step, 1.2 * before) << "tick " << tick;
    }
  }
}

TEST(Session, ReportsThatTheDeviceIsLostAndBackOnTheRealClock) {
  SimDevice device(test::true_device(), {.lost_at = 0.3, .lost_for = 0.5});
  RecordOptions options{.duration = 1.2};
  options.session.clock = ClockChoice::real;
  options.session.loop.realtime = false;
  options.session.loop.away_timeout = 60;
  const SessionResult result = record(device, options, StopRequest{});
  EXPECT_EQ(result.servo.cause, StopCause::finished) << result.servo.detail;
  EXPECT_EQ(result.servo.returns, 1U);
  EXPECT_GT(result.servo.away, 0);  // counts from when the loop noticed the loss, which a busy machine may delay
  EXPECT_THAT(texts_of(result.warnings),
              testing::IsSupersetOf({HasSubstr("the device was lost; the session waits up to 60 s"),
                                     HasSubstr("the device is back after")}));
}

TEST(Session, WarnsOfForcesThatWereLimitedAtOnceInItsResultAndInTheRecording) {
  const TempFolder folder;
  PointMass device;
  PlayOptions options = options_for(folder / "played.h5");
  options.session.loop.limits.max_force = 0.05;
  options.playback.max_deviation = 0.2;
  std::vector<std::string> shown;
  const PlayResult result = play(device, plan_playback(device.info(), make_shape("square", {}), options), options,
                                 StopRequest{}, [&](const SessionView& view) {
                                   for (const Warning& warning : view.warnings) shown.push_back(warning.code);
                                 });
  const Warning limited = warning_in(result.session, "force_limit");
  EXPECT_THAT(limited.text, testing::AnyOf(HasSubstr("the force was limited"), HasSubstr("force limited")));
  EXPECT_EQ(std::count(shown.begin(), shown.end(), "force_limit"), 1) << "once, however often it was limited";
  const nlohmann::json json = to_json(result);
  EXPECT_EQ(json["warnings"].size(), result.session.warnings.size());
  EXPECT_THAT(json["notices"].dump(), HasSubstr(limited.text));
  EXPECT_EQ(RecordingReader(folder / "played.h5").header().warnings, json["warnings"]);
  EXPECT_TRUE(check_recording(folder / "played.h5").empty());
}

TEST(Session, WarnsOnceOfAllOscillationsAndKeepsTheRemainingShareOfTheGains) {
  /// A controller that reports an oscillation twice.
  class Oscillating final : public Controller {
   public:
    [[nodiscard]] Command update(const State&) noexcept override {
      Command command;
      ++tick_;
      if (tick_ == 100) command.event = Event{.code = EventCode::oscillation, .values = {3e-4, 59, 0.5}};
      if (tick_ == 200) command.event = Event{.code = EventCode::oscillation, .values = {3e-4, 59, 0.25}};
      if (tick_ == 300) command.status = Command::Status::finished;
      return command;
    }

   private:
    int tick_ = 0;
  } controller;
  PointMass device;
  const SessionResult session = run_session(device, controller, {}, {}, options_for("").session, StopRequest{});
  const Warning warning = warning_in(session, "oscillation");
  EXPECT_THAT(warning.text,
              HasSubstr("the loop oscillated 2 times, first at 0.1 s; last: the loop oscillates at 59 Hz"));
  EXPECT_NEAR(warning.time, 0.1, 0.002);
  EXPECT_EQ(session.gain_share, 0.25);
}

TEST(Session, WarnsOfTheLimitThatEndedIt) {
  PointMass device;
  PlayOptions options = options_for("");
  options.playback.max_deviation = 1e-4;
  const PlayResult result =
      play(device, plan_playback(device.info(), make_shape("square", {}), options), options, StopRequest{});
  ASSERT_EQ(result.session.servo.cause, StopCause::deviation);
  const Warning stopped = warning_in(result.session, "stopped");
  EXPECT_EQ(stopped.severity, Severity::problem);
  EXPECT_EQ(stopped.text, result.session.servo.detail);
}

TEST(Session, StopsInEveryPhaseWhenAsked) {
  for (const int at : {0, 50, 400, 2000, 4700}) {
    PointMass device;
    StopRequest stop;
    PlayOptions options = options_for("");
    options.playback.hold = 2;
    const PlayPlan plan = plan_playback(device.info(), make_shape("square", {.duration = 3}), options);

    /// Raises the stop request at a tick, like a signal.
    struct Raiser final : SampleSink {
      using SampleSink::push;
      Raiser(StopRequest& request, int tick) : request_(request), tick_(tick) {}
      void push(const Sample& sample) noexcept override {
        if (sample.tick == static_cast<std::uint64_t>(tick_)) request_.raise();
      }
      StopRequest& request_;
      int tick_;
    } raiser(stop, at);

    ForceTerms terms;
    terms.push_back(std::make_unique<PdLaw>());
    PlaybackController controller(ReferenceStream(*plan.path, {}), std::move(terms), plan.tuning, options.playback);
    SampleSink* const sinks[] = {&raiser};
    const SessionResult result = run_session(device, controller, {.reference = true}, sinks, options.session, stop);
    EXPECT_EQ(result.servo.cause, StopCause::interrupted) << at;
    EXPECT_LE(result.servo.samples, static_cast<std::uint64_t>(at) + 260) << at;
    EXPECT_EQ(device.forces().back(), Vec3::Zero()) << at;
  }
}

/// Keeps what a session tells its observer.
class Observed final : public SessionObserver {
 public:
  test::Log log;
  std::vector<std::string> calls;
  FollowedPath followed;
  RecordingColumns columns;
  SessionResult result;

  SampleSink& sink() noexcept override { return log; }
  void begins(Device& device, const SessionOptions& options, const RecordingColumns& has, bool virtual_time) override {
    calls.push_back(fmt::format("begins {} {} after {} samples", device.info().name, virtual_time, log.samples.size()));
    followed = options.followed;
    columns = has;
  }
  void shows(const SessionView&) override { shown = true; }
  void ends(const SessionResult& whole) override {
    calls.emplace_back("ends");
    result = whole;
  }
  bool shown = false;
};

TEST(Session, ShowsItsObserverThePathEverySampleAndTheResult) {
  PointMass device;
  Observed observed;
  PlayOptions options = options_for("");
  options.session.observer = &observed;
  const PlayPlan plan = plan_playback(device.info(), make_shape("square", {.size = 0.04, .duration = 2}), options);
  const PlayResult result = play(device, plan, options, StopRequest{});
  EXPECT_EQ(observed.calls,
            (std::vector{fmt::format("begins {} true after 0 samples", device.info().name), std::string("ends")}));
  EXPECT_TRUE(observed.shown);
  EXPECT_TRUE(observed.columns.reference);
  EXPECT_EQ(observed.log.samples.size(), result.session.servo.samples);
  EXPECT_EQ(observed.result.servo.samples, result.session.servo.samples);
  // The path as it is played, from its start to its end.
  ASSERT_GT(observed.followed.time.size(), 100U);
  EXPECT_EQ(observed.followed.time.front(), 0);
  EXPECT_NEAR(observed.followed.time.back(), plan.path->duration(), 1e-12);
  EXPECT_TRUE(observed.followed.radius.empty());
  const Path square = make_shape("square", {.size = 0.04, .duration = 2});
  for (std::size_t i = 0; i < observed.followed.time.size(); i += 37) {
    const Reference reference = plan.path->first()->trajectory.sample(observed.followed.time[i]);
    ASSERT_LE((observed.followed.position[i] - reference.position).norm(), 1e-12);
  }
  EXPECT_LE((observed.followed.position.back() - square.position.back()).norm(), 1e-3);
}

TEST(Session, ShowsItsObserverALongPathInFewPointsOverItsWholeLength) {
  PointMass device;
  Path path;
  for (int i = 0; i < 200'000; ++i) {
    const double t = 1e-3 * i;
    path.time.push_back(5 + t);
    path.position.emplace_back(0.02 * std::cos(t), 0.02 * std::sin(t), 0);
  }
  const TrajectoryPieces pieces(source_of(path), Interpolation::cubic);
  ASSERT_GT(pieces.count(), 1U);
  const FollowedPath followed = followed_path(pieces);
  ASSERT_EQ(followed.time.size(), FollowedPath::kMostPathPoints);
  EXPECT_EQ(followed.time.front(), 0);
  EXPECT_NEAR(followed.time.back(), 199.999, 1e-9);
  for (std::size_t i = 0; i < followed.time.size(); ++i) {
    const double t = followed.time[i];
    ASSERT_LE((followed.position[i] - Vec3(0.02 * std::cos(t), 0.02 * std::sin(t), 0)).norm(), 1e-9);
  }
}

TEST(SessionJson, HasTheNamesOfTheContract) {
  PointMass device;
  PlayOptions options = options_for("");
  options.playback.repetitions = 2;
  options.playback.hold = 0.1;
  const Path path = make_shape("circle", {.duration = 1});
  const nlohmann::json json =
      to_json(play(device, plan_playback(device.info(), path, options), options, StopRequest{}));
  for (const char* key :
       {"samples", "duration_s", "rms_error_m", "peak_error_m", "force_ripple_n", "max_force_n", "overruns",
        "latency_s", "tick_s", "stopped_by", "repetitions", "ticks", "gaps", "tick_rate_hz", "achieved_rate_hz"})
    EXPECT_TRUE(json.contains(key)) << key;
  for (const char* key : {"p50", "p99", "p999", "max"}) EXPECT_TRUE(json["latency_s"].contains(key)) << key;
  EXPECT_EQ(json["repetitions"].size(), 2U);
  EXPECT_EQ(json["rms_error_m"], json["repetitions"][1]["rms_error_m"]);
  EXPECT_EQ(json["stopped_by"], "finished");
}

TEST(Gains, AreReadFromJsonStrictly) {
  const PdGains gains = gains_from_json({{"kp", 1500}, {"kd", {1, 2, 3}}}, "g.json");
  EXPECT_EQ(gains.kp, Vec3::Constant(1500));
  EXPECT_EQ(gains.kd, Vec3(1, 2, 3));
  EXPECT_EQ(gains_from_json(to_json(gains), "again").kd, gains.kd);
  EXPECT_THAT(error_of([] { (void)gains_from_json({{"kp", 1}}, "g.json"); }), HasSubstr("g.json: gains need 'kd'"));
  EXPECT_THAT(error_of([] { (void)gains_from_json({{"kp", -1}, {"kd", 1}}, "g.json"); }), HasSubstr("kp"));
  EXPECT_THAT(error_of([] { (void)gains_from_json({{"kp", 1}, {"kd", 1}, {"kdd", 1}}, "g.json"); }), HasSubstr("kdd"));
}

TEST(TimedController, FreesNothingWhenItsTriggerFires) {
  struct Still final : Controller {
    void start(const State&) noexcept override {}
    [[nodiscard]] Command update(const State&) noexcept override { return {}; }
  } still;
  TimedController controller(still, 0.5, Trigger::parse("speed>0.1|button"));
  State state{.dt = 1e-3};
  controller.start(state);
  const std::size_t before = test::allocations();
  (void)controller.update(state);
  state.velocity.x() = 0.2;
  EXPECT_TRUE(controller.update(state).event);
  state.time_ns = 600'000'000;
  EXPECT_EQ(controller.update(state).status, Command::Status::finished);
  EXPECT_EQ(test::allocations(), before);
}

}  // namespace
}  // namespace haptrace
