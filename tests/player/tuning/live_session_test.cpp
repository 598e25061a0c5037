// Tests of the commands that every running session obeys.
#include "player/tuning/live_session.h"

#include "control/path/shapes.h"
#include "control/path/trajectory.h"
#include "control/pd.h"
#include "player/playback/playback.h"
#include "player/playback/playback_controller.h"
#include "player/tuning/live_recording.h"
#include "player/tuning/live_tuning.h"
#include "tests/player/timed_commands.h"
#include "tests/support/allocations.h"
#include "tests/support/point_mass.h"

#include <algorithm>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <optional>

namespace haptrace {
namespace {

using test::Log;
using test::PointMass;
using test::TimedCommands;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::StartsWith;

const Tuning kSoft{.gains = {Vec3::Constant(500), Vec3::Constant(10)}};

struct Played {
  std::optional<PlayResult> result;
  std::vector<std::string> answers;
  Log log;
  nlohmann::json history;

  [[nodiscard]] std::size_t repetitions() const {
    return static_cast<std::size_t>(std::count_if(
        log.events.begin(), log.events.end(), [](const Event& event) { return event.code == EventCode::repetition; }));
  }
};

void play_with(Played& played, std::vector<std::pair<double, std::string>> commands, int repetitions = 1) {
  PointMass device;
  StopRequest stop;
  PlayOptions options{.gains = kSoft.gains,
                      .playback = {.repetitions = repetitions, .hold = 0.1, .max_deviation = 0.2}};
  const PlayPlan plan = plan_playback(device.info(), make_shape("line", {.size = 0.1, .duration = 4}), options);
  LiveTuning tuning(plan.tuning, {.stop = &stop});
  TimedCommands commander(tuning, std::move(commands));
  options.tuning = &tuning;
  options.sinks = {&commander, &played.log};
  played.result = play(device, plan, options, stop);
  played.answers = commander.answers;
  played.history = tuning.history();
}

TEST(LiveSession, AnswersEveryCommandAndSaysWhyItCannotObey) {
  StopRequest stop;
  LiveTuning tuning(kSoft, {.stop = &stop});
  const std::pair<const char*, const char*> dialogue[] = {
      {"pause", "ok pause"},
      {"pause", "error pause: the session is paused already; resume continues it"},
      {"resume", "ok resume"},
      {"resume", "error resume: the session is not paused"},
      {"skip", "ok skip: this repetition ends"},
      {"repeat", "ok repeat: once more after this repetition"},
      {"soften", "ok soften: feedback forces at 30 %"},
      {"restore", "ok restore: feedback forces at 100 %"},
      {"mark", "ok mark: kept in the history only; the session is not recorded"},
      {"note  muede, linke Hand ", "ok note: kept in the history only; the session is not recorded"},
      {"note", "error note takes a text, as in note tired"},
      {"skip 3", "error skip takes no value"},
      {"skipp", "error unknown command 'skipp'; did you mean 'skip'?"},
      {"stop", "ok stop: the force fades out and the session ends; another stop ends it at once"}};
  for (const auto& [command, answer] : dialogue) EXPECT_EQ(tuning.obey(command), answer) << command;
  EXPECT_EQ(stop.count(), 1);

  std::vector<std::string> texts;
  const nlohmann::json history = tuning.history();
  for (const auto& change : history["changes"]) texts.push_back(change["text"]);
  EXPECT_THAT(texts, ElementsAre("pause", "resume", "skip", "repeat", "soften", "restore", "mark 1",
                                 "note: muede, linke Hand", "stop"));
  LiveTuning bare(kSoft, {.endless = true});
  EXPECT_THAT(bare.obey("stop"), HasSubstr("error stop: this session cannot be stopped"));
  EXPECT_EQ(bare.obey("repeat"), "error repeat: the session repeats until it is stopped");
}

TEST(LiveSession, MarksTheRecordingWithEveryCommand) {
  const auto annotations = std::make_shared<Annotations>();
  LiveTuning tuning(kSoft, {.annotations = annotations});
  for (const char* command : {"kp 600", "pause", "mark here", "mark", "note Hand zittert \xc3\xbc", "soften"})
    EXPECT_THAT(tuning.obey(command), StartsWith("ok")) << command;
  std::vector<std::string> marks;
  for (const TimedEvent& event : annotations->take()) marks.push_back(event.text);
  EXPECT_THAT(marks, ElementsAre("tuned: kp 600", "session: pause", "here", "mark 1", "note: Hand zittert \xc3\xbc",
                                 "session: soften"));
  EXPECT_THAT(tuning.obey("note a\x1b[2J"), StartsWith("error note: the text must be UTF-8"));
  EXPECT_THAT(tuning.obey("mark " + std::string(121, 'a')), StartsWith("error mark: the text has 121 bytes"));
}

TEST(LiveSession, ListsTheActionsThatWorkNow) {
  LiveTuning tuning(kSoft, {});
  EXPECT_THAT(tuning.actions(), ElementsAre("pause", "skip", "repeat", "mark", "note"));
  (void)tuning.obey("pause");
  EXPECT_THAT(tuning.actions(), Contains("resume"));
  std::vector<std::string> names;
  for (const LiveControl& control : tuning.controls()) names.push_back(control.name);
  EXPECT_THAT(names, ElementsAre("kp", "kd")) << "the terms that the session has";
}

TEST(LiveSession, AButtonForAGainChangesItByTenPerCentOfItsPresentValue) {
  LiveTuning live(kSoft, {});
  for (const char* line : {"kp 556", "kp 200"}) {
    (void)live.obey(line);
    const LiveControl kp = live.controls()[0];
    EXPECT_NEAR(kp.ratio, 1.1, 1e-12);
    EXPECT_NEAR(kp.step, 0.1 * kp.value, 1e-9);
  }
  (void)live.obey("kp 0");
  EXPECT_GT(live.controls()[0].step, 0) << "a factor would stay at 0";
}

TEST(LiveSession, GainsThatDifferByAxisAreAControlThatOnlyAFactorChanges) {
  LiveTuning live(kSoft, {});
  (void)live.obey("kp 200 200 150");
  const std::vector<LiveControl> controls = live.controls();
  ASSERT_EQ(controls.size(), 2U);
  EXPECT_EQ(controls[0].name, "kd");
  EXPECT_EQ(controls[1].name, "gains");
  EXPECT_EQ(controls[1].kind, LiveControl::Kind::factor);
  EXPECT_THAT(controls[1].text, HasSubstr("kp 200 200 150"));
  EXPECT_FALSE(controls[1].because.empty());
  EXPECT_THAT(live.obey("gains / 1.1"), HasSubstr("ok kp 181.818 181.818 136.364"));
}

TEST(LiveSession, TakesAnAnswerOnlyWhileThereIsAQuestion) {
  LiveTuning live(kSoft, {});
  EXPECT_THAT(live.obey("first"), HasSubstr("first: there is no question now"));
  EXPECT_EQ(live.answer_of(true), 0);
  EXPECT_THAT(live.actions(), testing::IsSupersetOf(std::vector<std::string>{"first", "second"}));
  EXPECT_EQ(live.obey("second"), "ok second");
  EXPECT_EQ(live.obey("first"), "ok first") << "before it is taken, it can be mended";
  EXPECT_EQ(live.answer_of(true), 1);
  EXPECT_THAT(live.actions(), testing::Not(Contains("first")));
  EXPECT_THAT(live.obey("second"), HasSubstr("there is no question now")) << "it was answered";
  EXPECT_EQ(live.answer_of(true), 0) << "the next question";
  EXPECT_EQ(live.answer_of(false), 0);
  EXPECT_THAT(live.obey("second"), HasSubstr("there is no question now")) << "its time is over";
}

TEST(LiveSession, KeepsTheReferenceOfAPausedPlaybackStill) {
  Played played;
  play_with(played, {{2, "pause"}, {5, "resume"}});
  EXPECT_EQ(played.result->session.servo.cause, StopCause::finished);
  Vec3 before = nan3(), after = nan3();
  double fastest = 0;
  for (const Sample& sample : played.log.samples) {
    const double t = 1e-9 * static_cast<double>(sample.time_ns);
    if (t < 2.2) before = sample.reference_position;
    if (t > 2.2 && t < 5) fastest = std::max(fastest, sample.reference_velocity.norm());
    if (t < 5) after = sample.reference_position;
  }
  EXPECT_LT((after - before).norm(), 1e-9);
  EXPECT_EQ(fastest, 0);
  Played whole;
  play_with(whole, {});
  EXPECT_NEAR(played.result->session.servo.duration - whole.result->session.servo.duration, 3, 0.2);
}

TEST(LiveSession, SkipsAndRepeatsRepetitionsOfAPlaybackWithoutAJumpOfTheReference) {
  Played all, skipped, repeated, both;
  play_with(all, {}, 2);
  EXPECT_EQ(all.repetitions(), 2U);
  play_with(skipped, {{2, "skip"}}, 2);
  EXPECT_EQ(skipped.repetitions(), 2U);
  EXPECT_LT(skipped.result->session.servo.duration, all.result->session.servo.duration - 1);
  double jump = 0;
  for (std::size_t i = 1; i < skipped.log.samples.size(); ++i)
    jump = std::max(jump,
                    (skipped.log.samples[i].reference_position - skipped.log.samples[i - 1].reference_position).norm());
  EXPECT_LT(jump, 3e-4) << "at most 0.3 m/s";
  play_with(repeated, {{2, "repeat"}}, 2);
  EXPECT_EQ(repeated.repetitions(), 3U);
  EXPECT_EQ(repeated.result->repetitions.size(), 3U);
  // Both in the approach to the first repetition: the one is left out, and there is one more.
  play_with(both, {{0.1, "skip"}, {0.2, "repeat"}}, 1);
  EXPECT_EQ(both.repetitions(), 0U) << "the only repetition was skipped, so the session was over";
}

TEST(LiveSession, StopsAPlayback) {
  Played played;
  play_with(played, {{2, "stop"}});
  EXPECT_EQ(played.result->session.servo.cause, StopCause::interrupted);
  EXPECT_LT(played.result->session.servo.duration, 3);
}

TEST(LiveSession, SoftensThePlaybacksFeedbackToThirtyPercent) {
  ForceTerms terms;
  terms.push_back(std::make_unique<PdLaw>());
  PlaybackController controller(Trajectory(make_shape("circle", {.size = 0.06, .duration = 60}), Interpolation::cubic),
                                std::move(terms), {.gains = {Vec3::Constant(100), Vec3::Zero()}},
                                {.max_deviation = 10});
  Mailbox<SessionRequests> requests;
  controller.obey(requests);
  State state;
  state.position = Vec3(0.2, 0, 0);
  controller.start(state);
  state.dt = 1e-3;
  Command command;
  const auto share_after = [&](double seconds) {
    for (int i = 0; i < static_cast<int>(1e3 * seconds); ++i) command = controller.update(state);
    return command.wrench.force.norm() / (100 * (command.reference.position - state.position).norm());
  };
  EXPECT_NEAR(share_after(3), 1, 1e-9);
  requests.post({.share = LiveSession::kSoftened});
  const std::size_t before = test::allocations();
  const double first = share_after(0.001), softened = share_after(0.2);
  const std::size_t allocated = test::allocations() - before;
  EXPECT_GT(first, 0.99) << "no step";
  EXPECT_NEAR(softened, 0.3, 1e-9);
  EXPECT_EQ(allocated, 0U);
  requests.post({});
  EXPECT_LT(share_after(0.2), 0.51) << "it comes back in a second, because the hand may be far away";
  EXPECT_NEAR(share_after(0.8), 1, 1e-9);
}

TEST(LiveSession, HoldsASoftenedFeedbackBelowItsShareOfTheLimitHoweverFarTheHandDrifts) {
  ForceTerms terms;
  terms.push_back(std::make_unique<PdLaw>());
  PlaybackController controller(Trajectory(make_shape("circle", {.size = 0.06, .duration = 60}), Interpolation::cubic),
                                std::move(terms), {.gains = {Vec3::Constant(100), Vec3::Zero()}},
                                {.max_deviation = 10, .softened_force = 3});
  Mailbox<SessionRequests> requests;
  controller.obey(requests);
  State state;
  controller.start(state);
  state.dt = 1e-3;
  Command command;
  const auto largest_in = [&](double seconds, double x) {
    state.position = Vec3(x, 0, 0);
    const auto limited = [&] { return std::min(3.0, command.wrench.force.norm()); };  // as the loop does
    double largest = 0, steepest = 0, before = limited();
    for (int i = 0; i < static_cast<int>(1e3 * seconds); ++i) {
      command = controller.update(state);
      largest = std::max(largest, limited());
      steepest = std::max(steepest, limited() - before);
      before = limited();
    }
    return std::pair(largest, steepest);
  };
  (void)largest_in(3, 0);
  requests.post({.share = LiveSession::kSoftened});
  (void)largest_in(0.3, 0);
  EXPECT_NEAR(largest_in(1, 0.5).first, 0.9, 1e-9) << "30 % of 3 N, where the gains alone would give 15 N";
  requests.post({});
  EXPECT_LT(largest_in(0.99, 0.5).second, 0.05) << "and it comes back without a surge, 3 N in a second";
}

TEST(LiveSession, SoftensWhileNobodyAttendsAndKeepsTheTherapistsOwnSoftening) {
  StopRequest stop;
  LiveRecording live(nullptr, stop);
  EXPECT_EQ(live.share(), 1);
  EXPECT_TRUE(live.attend(false));
  EXPECT_EQ(live.share(), LiveSession::kSoftened);
  EXPECT_TRUE(live.attend(true));
  EXPECT_EQ(live.share(), 1);
  (void)live.obey("soften");
  (void)live.attend(false);
  (void)live.attend(true);
  EXPECT_EQ(live.share(), LiveSession::kSoftened) << "the page that is back lifts what its silence did, and no more";
  (void)live.attend(false);
  EXPECT_EQ(live.obey("restore"), "ok restore: feedback forces at 30 % until the controlling page is back");
  EXPECT_EQ(live.share(), LiveSession::kSoftened);
  (void)live.attend(true);
  EXPECT_EQ(live.share(), 1);
}

}  // namespace
}  // namespace haptrace
