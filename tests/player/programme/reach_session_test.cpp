// Reaches in force fields and error clamps with simulated participants whose internal model is known.
#include "player/programme/reach_session.h"

#include "base/json_reader.h"
#include "control/velocity_estimator.h"
#include "formats/path/path_file.h"
#include "metrics/reach_blocks.h"
#include "metrics/recorded_trial.h"
#include "player/guidance/live_guidance.h"
#include "player/programme/programme_session.h"
#include "player/programme/reach_controller.h"
#include "tests/player/programme/participant.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"
#include "tests/support/not_a_tick.h"
#include "tests/support/point_mass.h"
#include "tests/support/temp_folder.h"

#include <filesystem>
#include <fmt/format.h>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numeric>
#include <random>
#include <utility>

namespace haptrace {
namespace {

using nlohmann::json;
using test::error_of;
using test::Participant;
using test::ParticipantDevice;
using test::TempFolder;
using testing::HasSubstr;

constexpr double kReachStep = 1e-3;  // [s]

ReachTrial reach_ahead(ReachKind kind, bool field = true) {
  return {.geometry = {.target = Vec3(0.08, 0, 0), .lateral = Vec3::UnitY()},
          .kind = kind,
          .field = curl_field(13, Vec3::UnitZ()),
          .field_block = field};
}

ReachForces::Options forces_of(const ReachTrial& trial) {
  ReachForces::Options options{.max_force = 10, .delay = 0};
  if (trial.field_acts()) options.field = trial.field;
  if (trial.kind == ReachKind::clamp) options.clamp = ClampOptions{.stiffness = 2000, .damping = 3, .rise = 0.5};
  return options;
}

/// Runs the controller of a reach against a participant, tick by tick, and returns the metrics of its run.
TrialFigures reached(Participant& participant, const ReachTrial& trial) {
  ReachController controller(trial, forces_of(trial), {.start_hold = 0.6, .target_hold = 0.3, .hold = 0},
                             {.kp = Vec3::Constant(100), .kd = Vec3::Constant(2)}, hand_watch_of(10));
  participant.begin(trial.geometry.start, trial.geometry.target, 0.9);
  const auto estimator = make_velocity_estimator("lowpass:100", 1 / kReachStep, 0);
  RecordedTrial recorded{.kind = TrialKind::reach, .reach = trial};
  Vec3 sent = Vec3::Zero();
  for (int tick = 0; tick < 5000; ++tick) {
    State state{.dt = tick > 0 ? kReachStep : 0, .position = participant.position, .force_applied = sent};
    state.velocity = estimator->update(state.position, kReachStep);
    if (tick == 0) controller.start(state);
    const std::size_t before = test::allocations();
    const Command command = controller.update(state);
    EXPECT_EQ(test::allocations(), before) << "the tick allocates nothing";
    if (command.phase == Phase::run) {
      recorded.time.push_back(tick * kReachStep);
      recorded.position.push_back(state.position);
      recorded.force.push_back(command.wrench.force);
    }
    if (command.status == Command::Status::finished) break;
    sent = command.wrench.force;
    participant.step(sent, kReachStep);
  }
  return trial_figures(recorded, std::nullopt);
}

TEST(ReachAdaptation, TheIndexOf200SimulatedSessionsIsWithinFivePerCentOfTheTruth) {
  std::mt19937_64 random(5);
  double truth = 0, shown = 0;
  int clamps = 0;
  for (int session = 0; session < 200; ++session) {
    Participant participant;
    participant.learned = std::uniform_real_distribution(0.3, 0.9)(random);
    participant.rate = std::uniform_real_distribution(2.0, 10.0)(random);
    for (int trial = 1; trial <= 6; ++trial) {
      const bool clamp = trial % 3 == 0;
      const double learned = participant.learned;
      const TrialFigures figures = reached(participant, reach_ahead(clamp ? ReachKind::clamp : ReachKind::plain));
      ASSERT_TRUE(figures.reach);
      if (clamp) {
        ASSERT_TRUE(figures.reach->adaptation_index) << figures.reach->refused;
        EXPECT_NEAR(*figures.reach->adaptation_index, participant.realised(), 0.05 * learned) << "the realised value";
        EXPECT_GT(*figures.reach->adaptation_r, 0.9);
        truth += learned;
        shown += *figures.reach->adaptation_index;
        ++clamps;
      }
      participant.learn(clamp);
    }
  }
  ASSERT_EQ(clamps, 400);
  EXPECT_NEAR(shown / truth, 1, 0.05);
}

TEST(ReachAdaptation, NaiveAndAdaptedDeviationsHaveTheRightSign) {
  Participant naive, adapted;
  adapted.learned = 1;
  // The field pushes to the right of the movement.
  EXPECT_LT(reached(naive, reach_ahead(ReachKind::plain)).reach->lateral_deviation, -5e-3);
  EXPECT_NEAR(reached(adapted, reach_ahead(ReachKind::plain)).reach->lateral_deviation, 0, 2e-3);
  EXPECT_GT(reached(adapted, reach_ahead(ReachKind::catch_trial)).reach->lateral_deviation, 5e-3);
  EXPECT_NEAR(reached(naive, reach_ahead(ReachKind::catch_trial)).reach->lateral_deviation, 0, 1e-3);
  EXPECT_NEAR(reached(naive, reach_ahead(ReachKind::clamp)).reach->adaptation_index.value_or(1), 0, 0.02);
}

/// Sends states to the controller of a reach.
struct ReachRig {
  ReachCourse course{.start_hold = 0.5, .target_hold = 0.2, .time_limit = 1, .hold = 0.1};
  ReachTrial trial = reach_ahead(ReachKind::plain);
  Mailbox<SessionRequests> requests;
  std::optional<ReachController> controller;
  Command last;
  std::vector<EventCode> events;
  std::vector<std::string> words;

  void begin(const Vec3& at) {
    controller.emplace(trial, forces_of(trial), course, PdGains{.kp = Vec3::Constant(100), .kd = Vec3::Constant(2)},
                       hand_watch_of(10));
    controller->obey(requests);
    controller->start({.position = at});
  }
  /// Keeps the hand at a place for some time.
  Phase hold(const Vec3& at, double seconds, const Vec3& velocity = Vec3::Zero()) {
    for (int i = 0; i < std::lround(seconds / kReachStep); ++i) {
      last = controller->update({.dt = kReachStep, .position = at, .velocity = velocity});
      if (!last.event) continue;
      events.push_back(last.event->code);
      words.push_back(describe(*last.event));
    }
    return last.phase;
  }
};

const Vec3 kTarget(0.08, 0, 0), kBetween(0.04, 0, 0);

TEST(ReachController, GivesTheCueAfterAWholeHoldInTheStart) {
  ReachRig rig;
  rig.begin(Vec3::Zero());
  EXPECT_EQ(rig.hold(Vec3::Zero(), 0.4), Phase::approach);
  EXPECT_EQ(rig.hold(kBetween, 0.1), Phase::approach) << "too early";
  EXPECT_EQ(rig.hold(Vec3::Zero(), 0.45), Phase::approach) << "the hold begins again";
  EXPECT_EQ(rig.hold(Vec3::Zero(), 0.1), Phase::run);
  EXPECT_EQ(rig.hold(kTarget, 0.15), Phase::run);
  EXPECT_EQ(rig.hold(kBetween, 0.1), Phase::run) << "it left the target";
  EXPECT_EQ(rig.hold(kTarget, 0.25), Phase::hold);
  (void)rig.hold(kTarget, 0.2);
  EXPECT_EQ(rig.last.status, Command::Status::finished);
  EXPECT_THAT(rig.events, testing::ElementsAre(EventCode::repetition));
}

TEST(ReachController, EndsAtTheTimeLimitAndSaysSo) {
  ReachRig rig;
  rig.begin(Vec3::Zero());
  (void)rig.hold(Vec3::Zero(), 0.6);
  EXPECT_EQ(rig.hold(kBetween, 0.85), Phase::run);
  EXPECT_EQ(rig.hold(kBetween, 0.2), Phase::hold);
  EXPECT_THAT(rig.events, testing::ElementsAre(EventCode::repetition, EventCode::time_over));
}

TEST(ReachController, WaitsForAHandThatDoesNotComeNoLongerThanAMinute) {
  ReachRig rig;
  rig.begin(kBetween);
  EXPECT_EQ(rig.hold(kBetween, 59), Phase::approach);
  (void)rig.hold(kBetween, 2);
  EXPECT_EQ(rig.last.status, Command::Status::finished);
  EXPECT_THAT(rig.events, testing::ElementsAre(EventCode::time_over));
  EXPECT_EQ(rig.words.back(), "the hand did not hold still in the start within 60 s");
}

TEST(ReachController, SendsNoFieldBeforeTheCueAndTheWholeFieldBeforeAHandCanReact) {
  ReachRig rig;
  rig.begin(Vec3::Zero());
  const Vec3 shaken(0.2, 0, 0);
  EXPECT_EQ(rig.hold(Vec3::Zero(), 0.49, shaken), Phase::approach);
  EXPECT_EQ(rig.last.wrench.force.norm(), 0) << "a hand that is shaken in the start";
  EXPECT_EQ(rig.hold(Vec3::Zero(), 0.12, shaken), Phase::run);
  EXPECT_NEAR(rig.last.wrench.force.norm(), 13 * 0.2, 1e-6);
}

TEST(ReachController, PullsTheHandBackSoftlyAndLetsGoBeforeTheCue) {
  ReachRig rig;
  rig.course.pull = true;
  rig.begin(kBetween);
  (void)rig.hold(kBetween, kReachStep);
  EXPECT_LT(rig.last.wrench.force.norm(), 0.1) << "it begins without a step";
  double before = 0, steepest = 0;
  for (int i = 0; i < 700; ++i) {
    (void)rig.hold(kBetween, kReachStep);
    steepest = std::max(steepest, std::abs(rig.last.wrench.force.x() - before));
    before = rig.last.wrench.force.x();
  }
  EXPECT_LT(before, -2) << "towards the start";
  EXPECT_LT(steepest, 0.1);
  EXPECT_EQ(rig.hold(Vec3::Zero(), 0.7), Phase::approach) << "0.3 s without force come first";
  EXPECT_EQ(rig.last.wrench.force.norm(), 0);
  EXPECT_EQ(rig.hold(Vec3::Zero(), 0.2), Phase::run);
}

TEST(ReachController, SendsNoForceInAPauseAndStartsTheReachAgainAfterIt) {
  ReachRig rig;
  rig.begin(Vec3::Zero());
  (void)rig.hold(Vec3::Zero(), 0.6);
  (void)rig.hold(kBetween, 0.2, Vec3(0.2, 0, 0));
  EXPECT_GT(rig.last.wrench.force.norm(), 2);
  rig.requests.post({.paused = true});
  EXPECT_EQ(rig.hold(kBetween, 3, Vec3(0.2, 0, 0)), Phase::run) << "its time stands still";
  EXPECT_EQ(rig.last.wrench.force.norm(), 0);
  rig.requests.post({});
  EXPECT_EQ(rig.hold(kBetween, 0.1), Phase::approach);
  EXPECT_EQ(rig.hold(Vec3::Zero(), 0.6), Phase::run);
}

TEST(ReachController, SendsNoForceAfterTheReach) {
  ReachRig rig;
  rig.course.hold = 2;
  rig.begin(Vec3::Zero());
  (void)rig.hold(Vec3::Zero(), 0.6);
  (void)rig.hold(kTarget, 0.19, Vec3(0.2, 0, 0));
  EXPECT_GT(rig.last.wrench.force.norm(), 2);
  EXPECT_EQ(rig.hold(kTarget, 0.3, Vec3(0.2, 0, 0)), Phase::hold);
  EXPECT_EQ(rig.last.wrench.force.norm(), 0);
}

TEST(ReachController, StartsAgainAfterAGap) {
  ReachRig rig;
  rig.begin(Vec3::Zero());
  EXPECT_EQ(rig.hold(Vec3::Zero(), 0.6), Phase::run);
  rig.controller->resume({.position = kBetween});
  EXPECT_EQ(rig.hold(kBetween, 0.1), Phase::approach);
}

TEST(ReachController, ReportsAChannelThatTheHandBroke) {
  ReachRig rig;
  rig.trial = reach_ahead(ReachKind::clamp);
  rig.begin(Vec3::Zero());
  (void)rig.hold(Vec3::Zero(), 0.6);
  (void)rig.hold(Vec3(0.04, 0.04, 0), 0.3, Vec3(0.1, 0, 0));
  EXPECT_EQ(rig.last.wrench.force.norm(), 0);
  EXPECT_THAT(rig.events, testing::ElementsAre(EventCode::repetition, EventCode::deviation_over));
  EXPECT_THAT(rig.words.back(), HasSubstr("the clamp went off: the hand was 40.0 mm off, the limit is 30.0"));
}

TEST(ReachController, RefusesATargetWithinTheStart) {
  EXPECT_THAT(error_of([] {
                ReachRig rig;
                rig.trial.geometry.target = Vec3(0.01, 0, 0);
                rig.begin(Vec3::Zero());
              }),
              HasSubstr("a target is 10.0 mm from the start, within start_radius and target_radius"));
}

/// Runs whole programmes with one participant.
class ReachSession : public testing::Test {
 protected:
  ReachSession() {
    options_.folder = temp_ / "session";
    options_.session.recording.emplace();
    options_.open = [this](const Exercise&, const TrialSettings& settings, const std::string& path) {
      if (opened_++ > 0) participant_->learn(false);
      const Path movement = load_path(path);
      participant_->begin(movement.position.front(), movement.position.back(), *settings.start_hold + 0.25);
      device_ = std::make_shared<ParticipantDevice>(participant_);
      return std::shared_ptr<Device>(act_ ? std::exchange(act_, nullptr)(device_) : device_);
    };
  }

  ProgrammeResult run(const std::string& reach, const std::string& keys = R"("repetitions": 6)") {
    const json programme = parse_json(
        fmt::format(R"({{"haptrace_programme": 1, "seed": 3, "exercises": [{{"name": "out", "mode": "reach", "rest": 0,
                        "hold": 0.1, {}, "reach": {{{}}}}}]}})",
                    keys, reach),
        "p.json");
    const ProgrammePlan plan = plan_programme(programme_from_json(programme, "p.json"), temp_.path(), "p.json",
                                              &ParticipantDevice(participant_).info(), false);
    (void)begin_session(programme, "p.json", plan, ParticipantDevice(participant_).info(), options_);
    return run_programme(options_, *stop_);
  }
  ProgrammeResult resume() {
    stop_ = std::make_unique<StopRequest>();
    return run_programme(options_, *stop_);
  }

  const std::string targets_ = R"("targets": {"kind": "centre-out", "count": 4, "distance": 0.08})";
  TempFolder temp_;
  ProgrammeOptions options_;
  std::unique_ptr<StopRequest> stop_ = std::make_unique<StopRequest>();
  std::shared_ptr<Participant> participant_ = std::make_shared<Participant>();
  std::shared_ptr<ParticipantDevice> device_;
  std::function<std::shared_ptr<Device>(std::shared_ptr<Device>)> act_;
  int opened_ = 0;
};

/// Acts once, when a reach is half done.
class MidReach final : public Device {
 public:
  MidReach(std::shared_ptr<Device> device, std::function<void()> act)
      : device_(std::move(device)), act_(std::move(act)) {}
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return device_->info(); }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
    const Status status = device_->exchange(wrench, dt, state);
    if (act_ && state.position.norm() > 0.04) {
      const test::NotATick scope;
      std::exchange(act_, nullptr)();
    }
    return status;
  }
  void close() noexcept override { device_->close(); }

 private:
  std::shared_ptr<Device> device_;
  std::function<void()> act_;
};

TEST_F(ReachSession, KeepsTargetsOrderSeedAndMetricsOfEveryReach) {
  const ProgrammeResult result = run(targets_);
  ASSERT_TRUE(result.log.complete);
  const SessionLog log = load_session_log(options_.folder);
  EXPECT_EQ(log.programme["seed"], 3);
  EXPECT_THAT(log.generator, HasSubstr("mt19937_64"));
  ASSERT_EQ(log.schedule.size(), 6U);
  ASSERT_EQ(log.trials.size(), 6U);
  for (std::size_t i = 0; i < log.trials.size(); ++i) {
    const LoggedTrial& trial = log.trials[i];
    SCOPED_TRACE(trial.file);
    EXPECT_TRUE(trial.finished()) << trial.stopped_by << trial.detail;
    EXPECT_EQ(trial.reach, log.schedule[i].reach);
    EXPECT_NEAR(trial.places->geometry.distance(), 0.08, 1e-9);
    EXPECT_NEAR(trial.figures["reaction_time_s"].get<double>(), 0.25, 0.02);
    EXPECT_NEAR(trial.figures["movement_time_s"].get<double>(), 0.44, 0.08);
    EXPECT_NEAR(trial.figures["path_ratio"].get<double>(), 1, 0.03);
    EXPECT_NEAR(trial.figures["lateral_deviation_m"].get<double>(), 0, 1e-3);
    EXPECT_LT(trial.figures["end_error_m"].get<double>(), 8e-3);
    EXPECT_TRUE(trial.figures["contour_rms_m"].is_null()) << "a reach follows no path";
    EXPECT_EQ(RecordingReader(options_.folder + "/" + trial.file).header().meta.at("mode"), "reach");
  }
}

TEST_F(ReachSession, ShowsLearningInDeviationsAndItsAfterEffectInCatchTrials) {
  const ProgrammeResult result = run(targets_ + R"(, "field": {"curl": 13}, "blocks": [
      {"name": "baseline", "reaches": 4}, {"name": "field", "reaches": 20, "field": true, "catches": 0.1},
      {"name": "washout", "reaches": 3}])",
                                     R"("time_limit": 3)");
  ASSERT_TRUE(result.log.complete);
  std::vector<double> field, after, washout;
  for (const LoggedTrial& trial : result.log.trials) {
    if (trial.reach->kind == ReachKind::catch_trial)
      after.push_back(figure_in(trial.figures, "after_effect_m").value_or(0));
    else
      (trial.reach->block == 1 ? field : washout)
          .push_back(figure_in(trial.figures, "lateral_deviation_m").value_or(kNaN));
  }
  ASSERT_EQ(after.size(), 2U);
  EXPECT_LT(field.front(), -5e-3) << "naive: the field pushes to the right";
  EXPECT_GT(field.back(), 0.5 * field.front()) << "learned";
  for (const double deviation : after) EXPECT_GT(deviation, 2e-3) << "adapted, without the field: to the left";
  EXPECT_GT(washout[4], 2e-3) << "the first reach after the field";
}

TEST_F(ReachSession, MeasuresClampsOrSaysWhyItCannot) {
  const std::string blocks = targets_ + R"(, "field": {"curl": 13}, "clamp": {"stiffness": 5000}, "start_hold": 0.6,
      "blocks": [{"name": "field", "reaches": 8, "field": true, "clamps": 0.125}])";
  participant_->learned = 0.7;
  participant_->rate = 0;
  DeviceProfile profile;
  profile.plant.mass = Vec3::Constant(1);
  profile.plant.viscous = Vec3::Constant(2);
  profile.plant.delay = 0;
  options_.profile = profile;
  const auto clamp_of = [](const SessionLog& log) {
    return *std::find_if(log.trials.begin(), log.trials.end(),
                         [](const LoggedTrial& trial) { return trial.reach->kind == ReachKind::clamp; });
  };
  const LoggedTrial stiff = clamp_of(run(blocks, R"("time_limit": 3)").log);
  EXPECT_NEAR(figure_in(stiff.figures, "adaptation_index").value_or(0), 0.7 * 2000 / 2060, 0.04) << stiff.figures;
  EXPECT_THAT(fmt::format("{}", fmt::join(stiff.notices, "; ")),
              testing::AllOf(HasSubstr("is not stable with a clamp of 5000 N/m; it is limited to 2000 N/m"),
                             HasSubstr("shows 83 to 98 % of the true adaptation")));
  // Without a calibration only a soft channel is safe, and a soft channel gives way.
  options_.profile.reset();
  options_.folder = temp_ / "soft";
  const LoggedTrial soft = clamp_of(run(blocks, R"("time_limit": 3)").log);
  EXPECT_FALSE(figure_in(soft.figures, "adaptation_index"));
  EXPECT_THAT(fmt::format("{}", fmt::join(soft.notices, "; ")),
              HasSubstr("the clamp has no adaptation index: its lateral play was"));
}

TEST_F(ReachSession, LimitsTheDampingOfAClampToWhatIsStable) {
  (void)run(targets_ + R"(, "field": {"curl": 13}, "clamp": {"damping": 300}, "start_hold": 0.6,
      "blocks": [{"name": "field", "reaches": 8, "field": true, "clamps": 0.125}])",
            R"("time_limit": 3)");
  std::string notices;
  for (const LoggedTrial& trial : load_session_log(options_.folder).trials)
    notices += fmt::format("{}; ", fmt::join(trial.notices, "; "));
  EXPECT_THAT(notices, HasSubstr("is not stable with a clamp whose damping is 300 N s/m; it is limited to 4 N s/m; "
                                 "calibrate the device to allow more"));
  EXPECT_LT(device_->largest_force(), 10);
}

TEST(ReachPlan, GivesACurlATenthOfTheEnergyBecauseItDoesNoWork) {
  ReachOptions options{.trial = reach_ahead(ReachKind::plain)};
  const DeviceInfo info = test::PointMass().info();
  options.trial.field = curl_field(13, Vec3::UnitZ());
  EXPECT_NEAR(plan_reach(info, options).forces.energy, 0.1 * options.energy, 1e-12);
  options.trial.field(0, 0) = 1;
  EXPECT_EQ(plan_reach(info, options).forces.energy, options.energy);
}

TEST_F(ReachSession, LeavesReachesInAWeakFieldOutOfTheMeansOfTheirBlock) {
  options_.session.loop.limits.max_force = 1;  // of 2.6 N that the field has at 0.2 m/s
  const std::string block = targets_ + R"(, "field": {"curl": 13}, "blocks": [{"reaches": 3, "field": true}])";
  const SessionLog log = run(block, R"("time_limit": 3)").log;
  const Programme programme = programme_from_json(log.programme, "p.json");
  const std::vector<ReachBlockSummary> blocks = summarise_blocks(programme, 0, log);
  ASSERT_EQ(blocks.size(), 1U);
  EXPECT_EQ(blocks[0].plain, 3U);
  EXPECT_EQ(blocks[0].weakened, 3U);
  EXPECT_FALSE(blocks[0].lateral_deviation);
  EXPECT_THAT(describe(blocks[0]), HasSubstr("3 of 3 reaches left out, in which less than 90 % of the field acted"));
}

TEST_F(ReachSession, RefusesATargetThatIsScaledIntoTheStartBeforeAnythingMoves) {
  EXPECT_THAT(error_of([&] { (void)run(R"("targets": [[0.08, 0, 0], [0.04, 0, 0]])", R"("scale": 0.3)"); }),
              HasSubstr("target 2 of 'out', as it is scaled, is 12.0 mm from the start"));
  EXPECT_FALSE(std::filesystem::exists(options_.folder));
}

TEST_F(ReachSession, ResumesAtTheReachThatAStopInterruptedWithTheSameTargets) {
  act_ = [&](std::shared_ptr<Device> device) {
    return std::make_shared<MidReach>(std::move(device), [&] { stop_->raise(); });
  };
  const ProgrammeResult first =
      run(targets_ + R"(, "field": {"curl": 5}, "blocks": [{"reaches": 5, "field": true}])", R"("time_limit": 3)");
  EXPECT_FALSE(first.log.complete);
  ASSERT_EQ(first.log.trials.size(), 1U);
  EXPECT_TRUE(first.log.trials[0].figures.is_null());
  const ProgrammeResult second = resume();
  EXPECT_TRUE(second.log.complete);
  ASSERT_EQ(second.log.trials.size(), 6U);
  EXPECT_EQ(second.log.trials[1].attempt, 2);
  for (std::size_t i = 1; i < 6; ++i) EXPECT_EQ(second.log.trials[i].reach, first.log.schedule[i - 1].reach);
}

TEST_F(ReachSession, SkipsAReachAndGoesOnWithTheNext) {
  LiveGuidance live({.programme = true});
  options_.live = &live;
  act_ = [&](std::shared_ptr<Device> device) {
    return std::make_shared<MidReach>(std::move(device), [&] { (void)live.obey("skip"); });
  };
  const SessionLog log = run(targets_).log;
  EXPECT_TRUE(log.complete);
  ASSERT_EQ(log.trials.size(), 6U);
  EXPECT_TRUE(log.trials[0].skipped());
  EXPECT_TRUE(log.trials[0].figures.is_null());
  EXPECT_TRUE(log.trials[1].finished());
}

TEST_F(ReachSession, StaysWithinTheForceLimitOfTheSession) {
  options_.session.loop.limits.max_force = 1.5;
  ASSERT_TRUE(
      run(targets_ + R"(, "field": {"curl": 13}, "blocks": [{"reaches": 2, "field": true}])", R"("time_limit": 3)")
          .log.complete);
  EXPECT_LE(device_->largest_force(), 1.5 * (1 + 1e-12));
  EXPECT_GT(device_->largest_force(), 1);
}

TEST_F(ReachSession, MirrorsTargetsAndFieldTogether) {
  const auto deviation = [&](const std::string& keys, const char* folder) {
    options_.folder = temp_ / folder;
    *participant_ = Participant{};
    const LoggedTrial trial = run(R"("targets": [[0.08, 0, 0]], "field": {"curl": 13},
                                     "blocks": [{"reaches": 1, "field": true}])",
                                  keys + R"("time_limit": 3)")
                                  .log.trials.at(0);
    return std::pair(figure_in(trial.figures, "lateral_deviation_m").value_or(kNaN), trial.places->geometry.target);
  };
  const auto [plain, there] = deviation("", "plain");
  const auto [mirrored, other] = deviation(R"("mirror": "x", )", "mirrored");
  EXPECT_NEAR(there.x(), -other.x(), 1e-12);
  EXPECT_NEAR(plain, mirrored, 1e-4) << "the other hand has the same sign";
  EXPECT_LT(plain, -5e-3);
}

}  // namespace
}  // namespace haptrace
