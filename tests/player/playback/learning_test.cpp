#include "player/playback/learning.h"

#include "control/path/shapes.h"
#include "tests/player/calibration/identified_device.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using Outcome = LearningOutcome;

constexpr double kPeriod = 1e-3;
const Vec3 kLoad(0, 0, -2);  // constant; at rest, the applied force cancels it

LearningTerm::Options options_of(int repetitions, double duration = 1) {
  return {.law = {.mass = Vec3::Constant(0.4), .delay = 2e-3, .duration = duration}, .repetitions = repetitions};
}

/// A device at rest under a constant load; feedback compensates for the load.
class Bench {
 public:
  Bench(LearningTerm& term, double duration) : term_(term), duration_(duration) {}

  /// Runs one repetition, with `rest` ticks before and after it.
  void repeat(bool virtual_time, int rest = 100) {
    for (int i = 0; i < rest; ++i) tick(kNaN, virtual_time);
    for (double time = 0; time < duration_; time += kPeriod) tick(time, virtual_time);
    for (int i = 0; i < rest; ++i) tick(duration_, virtual_time);
  }

  Vec3 learned = Vec3::Zero();

 private:
  void tick(double time, bool virtual_time) {
    State state;
    state.dt = kPeriod;
    state.force_applied = -kLoad;
    const Reference reference{Vec3(1e-3, 0, 0), Vec3::Zero(), Vec3::Zero(), time};
    learned = term_.force({state, reference, tuning_});
    term_.between_ticks(virtual_time);
  }

  LearningTerm& term_;
  double duration_;
  Tuning tuning_;
};

TEST(LearningTerm, LearnsBetweenTwoTicksWhereTimeStandsStillMeanwhile) {
  LearningTerm term(options_of(2));
  Bench bench(term, 1);
  bench.repeat(true, 500);
  ASSERT_EQ(term.lessons().size(), 1U);
  EXPECT_EQ(term.lessons()[0].outcome, Outcome::learned);
  EXPECT_NEAR(term.lessons()[0].rms_error, 1e-3, 1e-9);
  EXPECT_LT((bench.learned + kLoad).norm(), 1e-3) << "and it is used at once";
  bench.repeat(true);
  bench.repeat(true);
  bench.repeat(true);
  EXPECT_EQ(term.lessons().size(), 2U) << "no more than was asked for";
}

TEST(LearningTerm, LearnsInAThreadOfItsOwnOnTheRealClock) {
  LearningTerm term(options_of(1));
  Bench bench(term, 1);
  bench.repeat(false);
  term.finish();
  ASSERT_EQ(term.lessons().size(), 1U);
  EXPECT_EQ(term.lessons()[0].outcome, Outcome::learned);
  for (const Vec3& force : term.table().force) ASSERT_LT((force + kLoad).norm(), 1e-6);
  bench.repeat(false, 500);
  EXPECT_LT((bench.learned + kLoad).norm(), 1e-3) << "the computed forces are used from the next tick on";
  term.finish();
}

TEST(LearningTerm, LeavesARepetitionOutThatEndsWhileTheOneBeforeIsStillWorkedOn) {
  LearningTerm term(options_of(50, 0.05));
  Bench bench(term, 0.05);
  for (int i = 0; i < 50; ++i) bench.repeat(false, 2);  // each takes microseconds
  term.finish();
  EXPECT_GE(term.lessons().size(), 1U);
  EXPECT_LE(term.lessons().size(), 50U);
  for (const Vec3& force : term.table().force) ASSERT_LT((force + kLoad).norm(), 1e-6);
  for (const Lesson& lesson : term.lessons()) EXPECT_NEAR(lesson.rms_error, 1e-3, 1e-9);
}

TEST(LearningTerm, UsesKnownForcesUnchangedWithoutRepetitionsToLearnFrom) {
  LearningTerm::Options options = options_of(0);
  options.known = {.step = 0.5, .force = {Vec3(1, 0, 0), Vec3(1, 0, 0), Vec3(1, 0, 0)}};
  LearningTerm term(options);
  Bench bench(term, 1);
  bench.repeat(true, 500);
  bench.repeat(false, 500);
  EXPECT_NEAR(bench.learned.x(), 1, 1e-3);
  EXPECT_TRUE(term.lessons().empty());
  EXPECT_TRUE(term.table().force == options.known.force);
}

TEST(LearningTerm, EndsInTheMiddleOfARepetition) {
  for (const bool virtual_time : {true, false}) {
    LearningTerm term(options_of(3));
    State state;
    state.dt = kPeriod;
    const Tuning tuning;
    for (int i = 0; i < 300; ++i) {
      (void)term.force({state, {Vec3::Zero(), Vec3::Zero(), Vec3::Zero(), i * kPeriod}, tuning});
      term.between_ticks(virtual_time);
    }
    term.finish();
    EXPECT_TRUE(term.lessons().empty());
  }
}

TEST(LearningTerm, LearnsNothingFromARepetitionWithAGap) {
  for (const int gap_at : {1, 150, 500, 950, 1001}) {
    LearningTerm term(options_of(2));
    const Tuning tuning;
    State state;
    state.dt = kPeriod;
    state.force_applied = -kLoad;
    const auto tick = [&](double time) {
      const Vec3 force = term.force({state, {Vec3(1e-3, 0, 0), Vec3::Zero(), Vec3::Zero(), time}, tuning});
      term.between_ticks(true);
      return force;
    };
    term.start(state);
    for (int repetition = 0; repetition < 2; ++repetition) {
      for (int i = 0; i < 100; ++i) tick(kNaN);
      for (int i = 0; i <= 1000; ++i) {
        const double time = std::min(1.0, i * kPeriod);
        const Vec3 before = tick(time);
        if (repetition > 0 || i + 1 != gap_at) continue;
        term.start(state);
        Vec3 last = before;
        for (int k = 0; k < 400; ++k) {  // the way back; the path's time stands still
          const Vec3 force = tick(time);
          ASSERT_LE((force - last).norm(), 0.1) << "without a bump";
          last = force;
        }
      }
      for (int i = 0; i < 100; ++i) tick(1.0);
    }
    ASSERT_EQ(term.lessons().size(), 2U) << gap_at;
    EXPECT_EQ(term.lessons()[0].outcome, Outcome::skipped) << gap_at;
    EXPECT_EQ(term.lessons()[1].outcome, Outcome::learned) << gap_at;
    for (const Vec3& force : term.table().force) ASSERT_LT((force + kLoad).norm(), 1e-6);
  }
}

TEST(LearningTerm, IsNotDisturbedByAGapWhileItHolds) {
  LearningTerm term(options_of(1));
  Bench bench(term, 1);
  bench.repeat(true, 200);
  ASSERT_EQ(term.lessons().size(), 1U);
  term.start({});
  bench.repeat(true, 200);
  EXPECT_EQ(term.lessons().size(), 1U);
  EXPECT_EQ(term.lessons()[0].outcome, Outcome::learned);
}

TEST(LearningTerm, AllocatesNothingInTheTick) {
  LearningTerm term(options_of(1));
  State state;
  state.dt = kPeriod;
  const Tuning tuning;
  std::size_t allocated = 0;
  for (int i = 0; i < 1500; ++i) {
    const double time = i < 100 ? kNaN : std::min(1.0, (i - 100) * kPeriod);
    const std::size_t before = test::allocations();
    (void)term.force({state, {Vec3::Zero(), Vec3::Zero(), Vec3::Zero(), time}, tuning});
    allocated += test::allocations() - before;
    term.between_ticks(true);
  }
  EXPECT_EQ(allocated, 0U);
  EXPECT_EQ(term.lessons().size(), 1U);
}

TEST(Learning, LowersTheErrorOfAPlaybackFromOneRepetitionToTheNext) {
  SimDevice device(test::true_device());
  PlayOptions options = test::everything();
  options.learn = 3;
  options.playback.repetitions = 4;
  const PlayPlan plan = plan_playback(device.info(), make_shape("circle", {.size = 0.06, .duration = 3}), options);
  const PlayResult result = play(device, plan, options, StopRequest{});
  ASSERT_EQ(result.session.servo.cause, StopCause::finished) << result.session.servo.detail;
  ASSERT_EQ(result.lessons.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_NEAR(result.lessons[i].rms_error, result.repetitions[i].rms_error, 0.02 * result.lessons[i].rms_error);
  EXPECT_LT(result.repetitions[3].rms_error, 0.4 * result.repetitions[0].rms_error);
  EXPECT_FALSE(result.learned.force.empty());

  // The learned forces help a new session from its first repetition on.
  options.learn = 0;
  options.learned = result.learned;
  options.playback.repetitions = 1;
  SimDevice again(test::true_device());
  const PlayResult later =
      play(again, plan_playback(again.info(), make_shape("circle", {.size = 0.06, .duration = 3}), options), options,
           StopRequest{});
  EXPECT_LT(later.last.rms_error, 0.5 * result.repetitions[0].rms_error);
  EXPECT_TRUE(later.lessons.empty());
}

TEST(Learning, RunsBesideASessionOnTheRealClock) {
  SimDevice device(test::true_device());
  PlayOptions options = test::everything();
  options.session.clock = ClockChoice::real;
  options.session.loop.realtime = false;
  options.playback.on_deviation = DeviationPolicy::soften;  // a machine that stalls must not end the test
  const PlayPlan plan = plan_playback(device.info(), make_shape("circle", {.size = 0.02, .duration = 0.5}), options);
  const PlayResult result = play(device, plan, options, StopRequest{});
  EXPECT_EQ(result.session.servo.cause, StopCause::finished) << result.session.servo.detail;
  EXPECT_GE(result.lessons.size(), 1U);
  EXPECT_LE(result.lessons.size(), 2U);
}

}  // namespace
}  // namespace haptrace
