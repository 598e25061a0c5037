// Assessments with simulated participants: what is measured is what they really did.
#include "base/json_reader.h"
#include "control/velocity_estimator.h"
#include "devices/registry.h"
#include "metrics/position_sense.h"
#include "metrics/recorded_trial.h"
#include "player/programme/programme_session.h"
#include "player/programme/reach_controller.h"
#include "player/programme/reach_order.h"
#include "player/programme/reach_session.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"
#include "tests/support/point_mass.h"
#include "tests/support/temp_folder.h"

#include <fmt/format.h>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numeric>
#include <optional>
#include <random>

namespace haptrace {
namespace {

using test::error_of;
using test::TempFolder;
using testing::HasSubstr;

constexpr double kDt = 1e-3;  // [s]

/// The force of a hand at `since` the cue, negative before it, at a place and a velocity.
using Hand = std::function<Vec3(double since, const Vec3& position, const Vec3& velocity)>;

struct AssessedTrial {
  RecordedTrial recorded;
  TrialFigures figures;
  std::vector<EventCode> events;
  std::string words;  ///< of the last event
  Phase last = Phase::approach;
};

/// Runs one trial with a hand of 1 kg, tick by tick.
AssessedTrial assessed(const ReachTrial& trial, const ReachForces::Options& forces, const ReachCourse& course,
                       const Hand& hand) {
  ReachController controller(trial, forces, course, {.kp = Vec3::Constant(100), .kd = Vec3::Constant(2)},
                             hand_watch_of(10));
  const auto estimator = make_velocity_estimator("lowpass:100", 1 / kDt, 0);
  AssessedTrial result{.recorded = {.kind = TrialKind::reach, .reach = trial}};
  Vec3 position = trial.geometry.start, velocity = Vec3::Zero(), sent = Vec3::Zero();
  std::optional<double> cue;
  for (int tick = 0; tick < 100'000; ++tick) {
    State state{.dt = tick > 0 ? kDt : 0, .position = position, .force_applied = sent};
    state.velocity = estimator->update(state.position, kDt);
    if (tick == 0) controller.start(state);
    const std::size_t before = test::allocations();
    const Command command = controller.update(state);
    EXPECT_EQ(test::allocations(), before) << "the tick allocates nothing";
    if (command.event) {
      result.events.push_back(command.event->code);
      result.words = describe(*command.event);
    }
    if (command.phase == Phase::run) {
      if (!cue) cue = tick * kDt;
      result.recorded.time.push_back(tick * kDt);
      result.recorded.position.push_back(position);
      result.recorded.force.push_back(command.wrench.force);
    }
    result.last = command.phase;
    if (command.status == Command::Status::finished) break;
    sent = command.wrench.force;
    velocity += kDt * (sent + hand(cue ? tick * kDt - *cue : -1, position, velocity));
    position += kDt * velocity;
  }
  result.figures = trial_figures(result.recorded, std::nullopt);
  return result;
}

ReachTrial goal_ahead(ReachGoal goal) {
  ReachTrial trial{.geometry = {.target = Vec3(0.05, 0, 0)}, .goal = goal};
  if (goal == ReachGoal::track) trial.track = {.frequency = {0.13, 0.29, 0.61}, .phase = {0.5, 2, 4}};
  return trial;
}

/// A hand that holds a place.
Vec3 held_at(const Vec3& place, const Vec3& position, const Vec3& velocity) {
  return 300 * (place - position) - 30 * velocity;
}

TEST(RangeAssessment, EndsWhenTheHandHasStayedAtItsFarthestPlace) {
  const AssessedTrial tried =
      assessed(goal_ahead(ReachGoal::range), {}, {.start_hold = 0.5, .target_hold = 0.5, .time_limit = 10, .hold = 0.1},
               [](double since, const Vec3& p, const Vec3& v) {
                 return held_at(Vec3(since < 0.3 ? 0 : std::min(0.08, 0.1 * (since - 0.3)), 0, 0), p, v);
               });
  EXPECT_THAT(tried.events, testing::ElementsAre(EventCode::repetition));
  EXPECT_NEAR(tried.recorded.time.back() - tried.recorded.time.front(), 0.3 + 0.8 + 0.5, 0.25);
  EXPECT_NEAR(tried.figures.range.value_or(RangeFigures{}).distance, 0.08, 1e-3);
  for (const Vec3& force : tried.recorded.force) EXPECT_EQ(force.norm(), 0) << "no force helps or hinders";
}

TEST(RangeAssessment, IsOverForAHandThatStaysInTheStartOrNeverRests) {
  const ReachCourse course{.start_hold = 0.5, .target_hold = 0.5, .time_limit = 3, .hold = 0.1};
  const AssessedTrial still =
      assessed(goal_ahead(ReachGoal::range), {}, course,
               [](double, const Vec3& p, const Vec3& v) { return held_at(Vec3::Zero(), p, v); });
  EXPECT_THAT(still.events, testing::ElementsAre(EventCode::repetition, EventCode::time_over));
  const AssessedTrial restless =
      assessed(goal_ahead(ReachGoal::range), {}, course, [](double since, const Vec3& p, const Vec3& v) {
        return held_at(Vec3(since < 0 ? 0 : 0.04 + 0.02 * std::sin(9 * since), 0, 0), p, v);
      });
  EXPECT_THAT(restless.events, testing::ElementsAre(EventCode::repetition, EventCode::time_over));
}

TEST(RangeAssessment, DoesNotEndForAHandThatGoesAnotherWayOrSlowly) {
  const ReachCourse course{.start_hold = 0.5, .target_hold = 0.1, .time_limit = 8, .hold = 0.1};
  for (const Vec3& way : {Vec3(-0.05, 0, 0), Vec3(0, 0.05, 0)}) {
    const AssessedTrial other =
        assessed(goal_ahead(ReachGoal::range), {}, course, [&](double since, const Vec3& p, const Vec3& v) {
          return held_at(since < 0 ? Vec3(Vec3::Zero()) : way, p, v);
        });
    EXPECT_THAT(other.events, testing::ElementsAre(EventCode::repetition, EventCode::time_over)) << way.transpose();
    EXPECT_LT(other.figures.range.value_or(RangeFigures{}).distance, 1e-3);
  }
  const AssessedTrial slow =
      assessed(goal_ahead(ReachGoal::range), {}, course, [](double since, const Vec3& p, const Vec3& v) {
        return held_at(Vec3(std::clamp(0.01 * since, 0.0, 0.06), 0, 0), p, v);
      });
  EXPECT_NEAR(slow.figures.range.value_or(RangeFigures{}).distance, 0.06, 2e-3) << "1 cm/s, and a hold of 0.1 s";
}

TEST(RangeAssessment, TheMeanOf200SessionsIsWithinFivePerCentOfWhatTheHandsReached) {
  std::mt19937_64 random(7);
  double truth = 0, shown = 0;
  for (int session = 0; session < 200; ++session) {
    const double range = std::uniform_real_distribution(0.03, 0.12)(random);
    std::normal_distribution<double> tremor(0, 0.3);
    const AssessedTrial tried = assessed(
        goal_ahead(ReachGoal::range), {}, {.start_hold = 0.3, .target_hold = 0.5, .time_limit = 10, .hold = 0},
        [&](double since, const Vec3& p, const Vec3& v) {
          const Vec3 shaken = since < 0 ? Vec3::Zero() : Vec3(tremor(random), tremor(random), tremor(random));
          return Vec3(held_at(Vec3(since < 0.3 ? 0 : std::min(range, 0.15 * (since - 0.3)), 0, 0), p, v) + shaken);
        });
    ASSERT_TRUE(tried.figures.range);
    truth += range;
    shown += tried.figures.range->distance;
  }
  EXPECT_NEAR(shown / truth, 1, 0.05);
}

ReachForces::Options lock(double max_force) {
  return {.clamp = ClampOptions{.stiffness = 1000, .damping = 10, .rise = 0.4, .break_out = 0.03, .locks = true},
          .max_force = max_force,
          .delay = 0};
}

/// A hand that presses along x with `force`, which rises in 0.3 s and trembles.
Hand pressing(double force, double tremor, std::mt19937_64& random, std::vector<double>& real) {
  return [&, force, tremor](double since, const Vec3&, const Vec3& v) {
    const double pressed =
        since < 0.2 ? 0
                    : force * std::min(1.0, (since - 0.2) / 0.3) + tremor * std::normal_distribution<double>()(random);
    if (since >= 0) real.push_back(pressed);
    return Vec3(pressed - 15 * v.x(), -15 * v.y(), -15 * v.z());
  };
}

TEST(PressAssessment, TheMeanOf200SessionsIsWithinFivePerCentOfWhatTheHandsDid) {
  std::mt19937_64 random(9);
  double truth = 0, shown = 0;
  ReachTrial trial = goal_ahead(ReachGoal::press);
  trial.largest = 8;
  for (int session = 0; session < 200; ++session) {
    std::vector<double> real;
    const double force = std::uniform_real_distribution(1.0, 6.0)(random);
    const AssessedTrial tried =
        assessed(trial, lock(8), {.start_hold = 0.5, .time_limit = 3, .hold = 0}, pressing(force, 0.2, random, real));
    ASSERT_TRUE(tried.figures.press);
    EXPECT_FALSE(tried.figures.press->at_limit) << force;
    double best = 0;
    for (std::size_t i = 0; i + 500 < real.size(); ++i)
      best = std::max(best, std::accumulate(real.begin() + static_cast<std::ptrdiff_t>(i),
                                            real.begin() + static_cast<std::ptrdiff_t>(i) + 500, 0.0) /
                                500);
    EXPECT_NEAR(tried.figures.press->force, best, 0.05 * best) << "the realised value";
    truth += force;
    shown += tried.figures.press->force;
  }
  EXPECT_NEAR(shown / truth, 1, 0.05);
}

TEST(PressAssessment, IsALowerBoundForAHandThatIsStrongerThanTheLock) {
  std::mt19937_64 random(1);
  std::vector<double> real;
  ReachTrial trial = goal_ahead(ReachGoal::press);
  trial.largest = 4;
  const AssessedTrial tried =
      assessed(trial, lock(4), {.start_hold = 0.5, .time_limit = 3, .hold = 0.3}, pressing(9, 0, random, real));
  EXPECT_THAT(tried.events, testing::ElementsAre(EventCode::repetition, EventCode::deviation_over));
  EXPECT_LT(tried.recorded.time.back() - tried.recorded.time.front(), 1) << "it ends when the lock broke";
  EXPECT_THAT(tried.words, HasSubstr("the lock gave way: it was pressed off by"));
  EXPECT_EQ(tried.last, Phase::hold);
}

TEST(PressAssessment, EndsBeforeTheForceOfTheLockDecays) {
  std::mt19937_64 random(1);
  std::vector<double> real;
  const AssessedTrial tried =
      assessed(goal_ahead(ReachGoal::press), lock(8), {.start_hold = 0.5, .time_limit = 30, .hold = 0.3},
               pressing(3, 0, random, real));
  EXPECT_THAT(tried.events, testing::ElementsAre(EventCode::repetition)) << "a press of 2 s is whole";
  EXPECT_NEAR(tried.recorded.time.back() - tried.recorded.time.front(), 0.3 + ClampOptions{}.holds, 0.3);
  EXPECT_NEAR(tried.figures.press.value_or(PressFigures{}).force, 3, 0.1);
}

TEST(PressAssessment, WaitsForAHandThatPressesBeforeTheCue) {
  const Hand eager = [](double since, const Vec3& p, const Vec3& v) {
    return Vec3(Vec3(since < 0 ? 4 : 0, 0, 0) - 200 * p - 20 * v);
  };
  ReachTrial trial = goal_ahead(ReachGoal::press);
  trial.geometry.start_radius = 0.02;
  const AssessedTrial tried = assessed(trial, lock(8), {.start_hold = 0.5, .time_limit = 3, .hold = 0.1}, eager);
  EXPECT_THAT(tried.events, testing::ElementsAre(EventCode::time_over)) << "no cue in 60 s";
  EXPECT_TRUE(tried.recorded.time.empty());
}

TEST(PressAssessment, LocksAgainAHandThatPressedTheLockOffBeforeTheCue) {
  // Presses with 12 N for a second, comes back, and presses with 3 N after the cue.
  double time = 0;
  const AssessedTrial tried =
      assessed(goal_ahead(ReachGoal::press), lock(4), {.start_hold = 1, .time_limit = 1.5, .hold = 0},
               [&](double since, const Vec3& p, const Vec3& v) {
                 time += kDt;
                 if (since < 0 && time > 0.3 && time < 1.3) return Vec3(Vec3(12, 0, 0) - 30 * v);
                 if (since < 0) return held_at(Vec3::Zero(), p, v);
                 return Vec3(Vec3(since > 0.2 ? 3 : 0, 0, 0) - 20 * v);
               });
  EXPECT_THAT(tried.events, testing::ElementsAre(EventCode::repetition));
  EXPECT_NEAR(tried.figures.press.value_or(PressFigures{}).force, 3, 0.2);
}

TEST(PressAssessment, LetsTheHandGoSlowly) {
  std::mt19937_64 random(1);
  std::vector<double> real;
  ReachForces forces(goal_ahead(ReachGoal::press).geometry, lock(8));
  forces.begin();
  const Vec3 pressed(0.005, 0, 0);
  for (int i = 0; i < 1000; ++i) (void)forces.update({.dt = kDt, .position = pressed}, true, 1, true);
  EXPECT_NEAR(forces.force().x(), -5, 0.1);
  for (int i = 0; i < 500; ++i) (void)forces.update({.dt = kDt, .position = pressed}, false, 1, true);
  EXPECT_NEAR(forces.force().x(), -2.5, 0.2) << "half a second later";
  for (int i = 0; i < 510; ++i) (void)forces.update({.dt = kDt, .position = pressed}, false, 1, true);
  EXPECT_EQ(forces.force().norm(), 0);
}

ReachTrial weighing() {
  ReachTrial trial{.geometry = {.target = Vec3(0, -0.03, 0), .lateral = Vec3::UnitX()}, .goal = ReachGoal::weigh};
  trial.largest = 8;
  return trial;
}

ReachForces::Options carrying(double max_force) {
  ReachForces::Options options = lock(max_force);
  options.clamp->stiffness = 500;
  options.clamp->holds = 8;
  return options;
}

/// An arm that is held in the start before the cue, and rests on the device within 0.5 s after it, trembling.
Hand resting(double weight, double tremor, std::mt19937_64& random) {
  return [&, weight, tremor](double since, const Vec3& p, const Vec3& v) {
    const double share = std::clamp((since - 0.4) / 0.5, 0.0, 1.0);
    const double noise = tremor * std::normal_distribution<double>()(random);
    return Vec3(Vec3(0, -share * weight + noise, 0) + (1 - share) * held_at(Vec3::Zero(), p, v) - 15 * v);
  };
}

TEST(WeighAssessment, TheMeanOf200ArmsIsWithinFivePerCentOfTheirWeight) {
  std::mt19937_64 random(4);
  double truth = 0, shown = 0;
  for (int session = 0; session < 200; ++session) {
    const double weight = std::uniform_real_distribution(0.5, 6.0)(random);
    const AssessedTrial tried = assessed(weighing(), carrying(8), {.start_hold = 0.5, .time_limit = 6, .hold = 0},
                                         resting(weight, 0.3, random));
    ASSERT_TRUE(tried.figures.weigh);
    EXPECT_EQ(tried.figures.weigh->refused, "") << weight;
    EXPECT_FALSE(tried.figures.weigh->at_limit) << weight;
    EXPECT_NEAR(tried.figures.weigh->weight, weight, 0.05 * weight + 0.05);
    EXPECT_THAT(tried.events, testing::ElementsAre(EventCode::repetition)) << "the lock holds for all of it";
    truth += weight;
    shown += tried.figures.weigh->weight;
  }
  EXPECT_NEAR(shown / truth, 1, 0.05);
}

TEST(WeighAssessment, IsALowerBoundForAnArmThatIsTooHeavyAndNoResultForOneThatDoesNotRest) {
  std::mt19937_64 random(1);
  const ReachCourse course{.start_hold = 0.5, .time_limit = 6, .hold = 0};
  ReachTrial trial = weighing();
  trial.largest = 4;
  const AssessedTrial heavy = assessed(trial, carrying(4), course, resting(9, 0, random));
  EXPECT_THAT(heavy.events, testing::ElementsAre(EventCode::repetition, EventCode::deviation_over))
      << "the lock gives way, and spoils the trial";
  RecordedTrial spoiled = heavy.recorded;
  spoiled.spoiled = "the lock gave way";
  const WeighFigures bound = trial_figures(spoiled, std::nullopt).weigh.value_or(WeighFigures{});
  EXPECT_TRUE(bound.at_limit);
  EXPECT_EQ(bound.refused, "");
  EXPECT_NEAR(bound.weight, 4, 0.4) << "what it bore, not the mean with the time before the arm rested";
  const AssessedTrial moving = assessed(weighing(), carrying(8), course, [](double since, const Vec3&, const Vec3& v) {
    return Vec3(Vec3(0, since < 0 ? 0 : -4 + 3 * std::sin(9 * since), 0) - 5 * v);
  });
  EXPECT_THAT(moving.figures.weigh.value_or(WeighFigures{}).refused, HasSubstr("so it did not rest"));
  const AssessedTrial nobody = assessed(weighing(), carrying(8), course, [](double, const Vec3& p, const Vec3& v) {
    return held_at(Vec3::Zero(), p, v);
  });
  EXPECT_THAT(nobody.figures.weigh.value_or(WeighFigures{}).refused, HasSubstr("no arm rested on the device"));
}

TEST(WeighAssessment, WaitsForNoArmThatRestsBeforeTheCue) {
  const AssessedTrial tried = assessed(weighing(), carrying(8), {.start_hold = 0.5, .time_limit = 6, .hold = 0},
                                       [](double since, const Vec3& p, const Vec3& v) {
                                         const Vec3 weight(0, p.norm() > 0 || since >= 0 ? -4 : -0.01, 0);
                                         return Vec3(weight - 15 * v);
                                       });
  EXPECT_THAT(tried.events, testing::ElementsAre(EventCode::repetition));
  EXPECT_NEAR(tried.figures.weigh.value_or(WeighFigures{}).weight, 4, 0.1);
}

TEST(WeighAssessment, HoldsTheArmWithAForceThatTheMotorsCanHold) {
  DeviceInfo info = test::PointMass().info();
  info.max_continuous_force = 2;
  ReachOptions options{.trial = weighing(), .course = {.time_limit = 6}};
  const ReachPlan plan = plan_reach(info, options);
  EXPECT_NEAR(plan.trial.largest, 1.5, 1e-9) << "below the knee of the continuous limit";
  EXPECT_GE(plan.forces.clamp->holds, 6) << "it does not decay within the trial";
  info.force_axes = {true, false, true};
  EXPECT_THAT(error_of([&] { (void)plan_reach(info, options); }), HasSubstr("no motor along y"));
}

TEST(PressAssessment, KeepsTheBreakOutAndTheForceLimitsOfTheSession) {
  const DeviceInfo info = test::PointMass().info();
  ReachOptions options{.trial = goal_ahead(ReachGoal::press), .clamp_stiffness = 100, .break_out = 0.01};
  EXPECT_NEAR(plan_reach(info, options).trial.largest, 0.8 * 100 * 0.01, 1e-9) << "the spring, before it goes off";
  EXPECT_EQ(plan_reach(info, options).forces.clamp->break_out, 0.01);
  options.break_out = 0.5;
  options.session.loop.limits.max_force = 2;
  EXPECT_NEAR(plan_reach(info, options).trial.largest, 1.6, 1e-9);
}

TEST(PressAssessment, NeedsASensorForALockedHandleAndMotorsForALock) {
  ReachOptions options{.trial = goal_ahead(ReachGoal::press), .locked = true};
  DeviceInfo info = test::PointMass().info();
  info.measures_force = false;
  EXPECT_THAT(error_of([&] { (void)plan_reach(info, options); }), HasSubstr("has no force sensor"));
  info.measures_force = true;
  EXPECT_FALSE(plan_reach(info, options).forces.clamp) << "the device sends no force";
  options.locked = false;
  EXPECT_TRUE(plan_reach(info, options).forces.clamp->locks);
  EXPECT_GT(plan_reach(info, options).trial.largest, 0);
  info.force_axes = {false, false, false};
  EXPECT_THAT(error_of([&] { (void)plan_reach(info, options); }),
              HasSubstr("has no motor along x, which the lock needs"));
}

TEST(TrackAssessment, FindsDelayAndGainOfHandsThatFollowTheTarget) {
  std::mt19937_64 random(3);
  const ReachTrial trial = goal_ahead(ReachGoal::track);
  double gains = 0, delays = 0;
  constexpr int kSessions = 200;
  for (int session = 0; session < kSessions; ++session) {
    const double gain = std::uniform_real_distribution(0.6, 1.1)(random),
                 delay = std::uniform_real_distribution(0.1, 0.5)(random);
    std::normal_distribution<double> tremor(0, 0.3);
    const AssessedTrial tried = assessed(
        trial, {}, {.start_hold = 0.5, .time_limit = 20, .hold = 0}, [&](double since, const Vec3& p, const Vec3& v) {
          // A stiff hand on a place that is a late copy of the target.
          const Vec3 place(0.05 * gain * trial.track.at(since - delay), 0, 0);
          return Vec3(4000 * (place - p) - 126 * v + (since < 0 ? Vec3(Vec3::Zero()) : Vec3(tremor(random), 0, 0)));
        });
    ASSERT_TRUE(tried.figures.track && tried.figures.track->delay);
    EXPECT_THAT(tried.events, testing::ElementsAre(EventCode::repetition));
    EXPECT_NEAR(tried.recorded.time.back() - tried.recorded.time.front(), 20, 0.01);
    gains += *tried.figures.track->gain / gain;
    // The hand itself is late by its damping over its stiffness.
    delays += *tried.figures.track->delay / (delay + 126.0 / 4000);
    for (const Vec3& force : tried.recorded.force) EXPECT_EQ(force.norm(), 0);
  }
  EXPECT_NEAR(gains / kSessions, 1, 0.05);
  EXPECT_NEAR(delays / kSessions, 1, 0.05);
}

TEST(TrackAssessment, ShowsTheTargetAsTheReference) {
  const ReachTrial trial = goal_ahead(ReachGoal::track);
  ReachController controller(trial, {}, {.start_hold = 0.1, .time_limit = 20},
                             {.kp = Vec3::Constant(100), .kd = Vec3::Constant(2)}, hand_watch_of(10));
  State state{.position = Vec3::Zero()};
  controller.start(state);
  state.dt = kDt;
  double since = 0, farthest = 0;
  for (int tick = 0; tick < 10'000; ++tick) {
    const Command command = controller.update(state);
    if (command.phase != Phase::run) {
      EXPECT_EQ(command.reference.position.norm(), 0);
      continue;
    }
    EXPECT_NEAR(command.reference.position.x(), 0.05 * trial.track.at(since), 2e-4) << since;
    farthest = std::max(farthest, std::abs(command.reference.position.x()));
    since += kDt;
  }
  EXPECT_GT(farthest, 0.02);
}

TEST(SenseOrder, HasEachDifferenceAsOftenInBothOrders) {
  const SenseTask task{.differences = {0.002, 0.01}, .tries = 6};
  OrderDraw draw(4);
  std::vector<int> counts(4, 0);
  const std::vector<SenseTrial> trials = order_of_pairs(task, draw);
  for (const SenseTrial& trial : trials) ++counts.at(static_cast<std::size_t>(trial.pair));
  EXPECT_THAT(counts, testing::Each(3));
  EXPECT_THAT(task.pairs(), testing::ElementsAre(-0.002, -0.01, 0.002, 0.01));
  OrderDraw again(4), other(5);
  EXPECT_EQ(order_of_pairs(task, again), trials);
  EXPECT_NE(order_of_pairs(task, other), trials);
}

/// Runs a programme with one exercise in mode sense on a simulated device.
class SenseSession : public testing::Test {
 protected:
  SessionLog run(const std::string& sense, const std::string& keys = "") {
    options_.folder = folder_ / "session";
    options_.session.recording.emplace();
    options_.open = [this](const Exercise&, const TrialSettings&, const std::string&) {
      return std::shared_ptr<Device>(open_device(hand_));
    };
    const nlohmann::json programme = parse_json(
        fmt::format(R"({{"haptrace_programme": 1, "seed": 3, "exercises": [{{"mode": "sense", "rest": 0, "hold": 0.1{},
                        "sense": {}}}]}})",
                    keys, sense),
        "p.json");
    const auto device = open_device(hand_);
    const ProgrammePlan plan =
        plan_programme(programme_from_json(programme, "p.json"), folder_.path(), "p.json", &device->info(), false);
    (void)begin_session(programme, "p.json", plan, device->info(), options_);
    return run_programme(options_, stop_).log;
  }
  TempFolder folder_;
  std::string hand_ = "sim:preset=falcon,hand=relaxed";
  ProgrammeOptions options_;
  StopRequest stop_;
};

TEST_F(SenseSession, KeepsTheAnswerAndTheDifferenceThatTheHandFelt) {
  int asked = 0;
  options_.asks = [&](double) { return ++asked % 3; };  // none, first, second, ...
  const SessionLog log = run(R"({"differences": [0.005, 0.012], "tries": 2, "move": 0.5, "stay": 0.6})");
  ASSERT_TRUE(log.complete);
  ASSERT_EQ(log.trials.size(), 4U);
  const std::vector<double> pairs = programme_from_json(log.programme, "p").exercises[0].sense->pairs();
  for (std::size_t i = 0; i < log.trials.size(); ++i) {
    const LoggedTrial& trial = log.trials[i];
    EXPECT_EQ(trial.sense->pair, log.schedule[i].sense->pair);
    EXPECT_EQ(trial.sense->answer, static_cast<int>(i + 1) % 3);
    EXPECT_EQ(trial.finished(), trial.sense->answer != 0);
    const double planned = pairs.at(static_cast<std::size_t>(trial.sense->pair));
    EXPECT_NEAR(figure_in(trial.figures, "sense_difference_m").value_or(0), planned, 0.4 * std::abs(planned))
        << "an uncalibrated device";
  }
  EXPECT_EQ(load_session_log(options_.folder).trials[1].sense, log.trials[1].sense);
}

TEST_F(SenseSession, ScalesAndTurnsThePlacesWithTheExercise) {
  options_.asks = [](double) { return 1; };
  const SessionLog log = run(R"({"differences": [0.02], "tries": 2})", R"(, "scale": 0.5, "rotate": "z=90deg")");
  ASSERT_EQ(log.trials.size(), 2U);
  for (const LoggedTrial& trial : log.trials)
    EXPECT_NEAR(std::abs(figure_in(trial.figures, "sense_difference_m").value_or(0)), 0.01, 3e-3);
}

TEST_F(SenseSession, AsksAgainAfterAStopInTheQuestion) {
  options_.asks = [&](double) {
    stop_.raise();
    return 0;
  };
  const SessionLog log = run(R"({"differences": [0.01], "tries": 2})");
  EXPECT_FALSE(log.complete);
  ASSERT_EQ(log.trials.size(), 1U);
  EXPECT_EQ(log.trials[0].stopped_by, "interrupted");
  options_.asks = [](double) { return 2; };
  StopRequest stop;
  const SessionLog resumed = run_programme(options_, stop).log;
  EXPECT_TRUE(resumed.complete);
  ASSERT_EQ(resumed.trials.size(), 3U);
  EXPECT_EQ(resumed.trials[1].repetition, 1);
  EXPECT_EQ(resumed.trials[1].attempt, 2);
}

TEST_F(SenseSession, IsNotCompleteAfterAStopInItsLastQuestion) {
  int asked = 0;
  options_.asks = [&](double) {
    if (++asked == 2) stop_.raise();
    return asked == 2 ? 0 : 1;
  };
  const SessionLog log = run(R"({"differences": [0.01], "tries": 2})");
  ASSERT_EQ(log.trials.size(), 2U);
  EXPECT_FALSE(log.complete);
  EXPECT_EQ(log.sittings.back().ended_by, "interrupted");
  options_.asks = [](double) { return 2; };
  const StopRequest stop;
  EXPECT_TRUE(run_programme(options_, stop).log.complete);
}

TEST_F(SenseSession, SaysThatAQuestionDoesNotWaitInVirtualTime) {
  options_.asks = [](double) { return 0; };
  const SessionLog log = run(R"({"differences": [0.01], "tries": 2})");
  ASSERT_EQ(log.trials.size(), 2U);
  EXPECT_THAT(log.trials[0].notices, testing::Contains(HasSubstr("use --clock real")));
  EXPECT_THAT(log.trials[1].notices, testing::Not(testing::Contains(HasSubstr("use --clock real")))) << "said once";
}

// The motors do not cool in the moment between two repetitions.
TEST_F(SenseSession, KeepsTheContinuousForceOverAllRepetitions) {
  options_.asks = [](double) { return 1; };
  options_.max_deviation = 1;
  options_.session.loop.limits.max_continuous_force = 1;
  options_.session.loop.limits.continuous_time = 10;
  hand_ = "sim:preset=falcon,hand=firm";
  const SessionLog log = run(R"({"differences": [0.016], "tries": 6, "move": 0.5})");
  ASSERT_EQ(log.trials.size(), 6U);
  double square = 0, hottest = 0;
  for (const LoggedTrial& trial : log.trials) {
    RecordingReader reader((std::filesystem::path(options_.folder) / trial.file).string());
    for (const Sample& sample : reader.read(0, reader.rows())) {
      square += 1e-3 / 10 * (sample.force.squaredNorm() - square);
      hottest = std::max(hottest, square);
    }
  }
  EXPECT_LE(std::sqrt(hottest), 1.01);
  EXPECT_GT(std::sqrt(hottest), 0.95) << "the hand asks for more";
}

TEST_F(SenseSession, DoesNotCountAPairToWhichTheHandWasNotLed) {
  options_.asks = [](double) { return 1; };
  options_.max_deviation = 1;
  hand_ = "sim:preset=falcon,hand=tense";
  const SessionLog log = run(R"({"differences": [0.016], "tries": 2})");
  const Programme programme = programme_from_json(log.programme, "p");
  const auto summary = summarise_sense(programme, 0, log);
  ASSERT_TRUE(summary);
  for (const LoggedTrial& trial : log.trials) {
    const double difference = figure_in(trial.figures, "sense_difference_m").value_or(0);
    EXPECT_EQ(trial.figures.contains("refused"), std::abs(difference) < 0.008) << difference;
  }
  EXPECT_EQ(summary->refused + summary->answers, log.trials.size());
}

TEST(AssessmentPlan, RefusesWhatTheDeviceHasNoMotorOrSensorFor) {
  const auto error = [](const std::string& exercise) {
    const auto device = open_device("sim:preset=hapkit");
    return error_of([&] {
      (void)plan_programme(
          programme_from_json(
              parse_json(fmt::format(R"({{"haptrace_programme": 1, "exercises": [{}]}})", exercise), "p.json"),
              "p.json"),
          ".", "p.json", &device->info(), false);
    });
  };
  EXPECT_THAT(error(R"({"mode": "press", "press": {"targets": [[0.01, 0, 0], [0, 0.01, 0]]}})"),
              HasSubstr("p.json: 'exercise 1': Hapkit has no motor along y, which the lock needs"));
  EXPECT_THAT(error(R"({"mode": "press", "press": {"targets": [[0, 0.01, 0]], "locked": true}})"),
              HasSubstr("has no force sensor"));
  EXPECT_THAT(error(R"({"mode": "sense", "sense": {"axis": [0, 1, 0], "reference": 0.01, "differences": [0.002]}})"),
              HasSubstr("has no motor along y"));
  EXPECT_EQ(error(R"({"mode": "range", "range": {"targets": [[5, 0, 0]]}})"), "no error")
      << "a direction, and no place to reach";
}

}  // namespace
}  // namespace haptrace
