#include "control/iterative_learning.h"

#include "control/observer_pd.h"
#include "tests/support/allocations.h"
#include "tests/support/delayed_mass.h"
#include "tests/support/errors.h"

#include <algorithm>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

namespace haptrace {
namespace {

using test::DelayedMass;
using test::kNone;
using test::kPeriod;
using test::late_plant;
using Learned = LearningOutcome;

constexpr double kDuration = 2;  // duration of the path [s]

/// Returns the reference of a movement there and back along x and y, from rest to rest.
Reference reference_at(double time, double speed) {
  const double w = 2 * M_PI / kDuration, a = w * time;
  const Vec3 x(0.02 * (1 - std::cos(a)), 0.01 * (1 - std::cos(2 * a)), 0);
  const Vec3 v(0.02 * w * std::sin(a), 0.02 * w * std::sin(2 * a), 0);
  const Vec3 b(0.02 * w * w * std::cos(a), 0.04 * w * w * std::cos(2 * a), 0);
  return {x, speed * v, speed * speed * b, time};
}

/// Force of a load [N] as a function of path time, position and velocity.
using Load = std::function<Vec3(double, const Vec3&, const Vec3&)>;

Vec3 sine_load(double time, const Vec3&, const Vec3&) {
  return {1.5 * std::sin(2 * M_PI * 3 * time), std::sin(2 * M_PI * 5 * time + 1), 0.7 * std::cos(2 * M_PI * time)};
}
Vec3 friction_load(double, const Vec3&, const Vec3& v) {
  return test::friction(v, 0.7, 2);
}

/// A session that repeats a movement of a simulated mass and learns from the repetitions.
class Session {
 public:
  explicit Session(double speed = 1, bool jitter = false)
      : design(design_tracking(late_plant(), {.max_force = 20})),
        learning({.mass = late_plant().mass, .delay = late_plant().delay, .speed = speed, .duration = kDuration}),
        learned(kDuration, 10000),
        law_({.design = design}),
        plant_(late_plant().mass, late_plant().delay / kPeriod),
        speed_(speed),
        jitter_(jitter) {
    log.reserve(10000);
    tuning.gains = design.gains;
    tuning.observer = 0;  // the learned force alone, without an observer
    learned.use(&learning.table());
    law_.start({});
  }

  /// Repeats the movement once, with half a second of rest before it and 0.2 s after it. Returns true if the repetition
  /// was stored in `log`. `pause` [s] stops the path's time in its middle.
  bool repeat(const Load& load, double pause = 0) {
    worst_step = 0;
    for (int i = 0; i < 500; ++i) tick(kNaN, load);
    const double step = speed_ * kPeriod;
    double time = 0;
    bool taken = false;
    for (int i = 0; time < kDuration; ++i) {
      tick(time, load);
      if (pause > 0 && time > 0.5 * kDuration) {
        for (int k = 0; k < static_cast<int>(pause / kPeriod); ++k) tick(time, load, true);
        pause = 0;
      }
      // Early and late ticks make the path's time jitter; its mean rate is unchanged.
      time += step * (jitter_ ? (i % 2 == 0 ? 1.4 : 0.6) : 1.0);
    }
    for (int i = 0; i < 200; ++i) {
      tick(kDuration, load);
      taken = learned.take_repetition(log) || taken;
    }
    return taken;
  }

  Learned learn(const Load& load) {
    EXPECT_TRUE(repeat(load));
    return learning.learn(log);
  }

  TrackingDesign design;
  IterativeLearning learning;
  LearnedForce learned;
  RepetitionLog log;
  Tuning tuning;
  double soften_from = 2 * kDuration;   ///< time on the path from which the feedback is softened [s]
  double vibrate_from = 2 * kDuration;  ///< time on the path from which it vibrates [s]
  double worst_step = 0;                ///< Largest change of the learned force from one tick to the next [N].

 private:
  void tick(double time, const Load& load, bool stands = false) {
    const double on_path = std::isfinite(time) ? time : 0;
    Reference reference = reference_at(on_path, stands || !(on_path < kDuration) || !std::isfinite(time) ? 0 : speed_);
    reference.time = time;
    State state;
    state.dt = kPeriod;
    state.position = plant_.x;
    state.force_applied = sent_;
    state.softened = on_path >= soften_from;
    state.vibrated = on_path >= vibrate_from;
    const Vec3 feedforward = learned.force({state, reference, tuning, kNone});
    worst_step = std::max(worst_step, (feedforward - last_).norm());
    last_ = feedforward;
    sent_ = feedforward + law_.force({state, reference, tuning, feedforward}) +
            late_plant().mass.cwiseProduct(reference.acceleration);
    double at = on_path;
    plant_.advance(sent_, [&](const Vec3& x, const Vec3& v) {
      const Vec3 force = load(at, x, v);
      if (std::isfinite(time) && !stands) at += speed_ * kPeriod / 20;
      return force;
    });
  }

  ObserverPd law_;
  DelayedMass plant_;
  double speed_;
  bool jitter_;
  Vec3 sent_ = kNone, last_ = kNone;
};

TEST(IterativeLearning, MakesARepeatableLoadsErrorFiveTimesSmallerInThreeRepetitions) {
  for (const double speed : {0.5, 1.0, 2.0}) {
    Session session(speed);
    ASSERT_EQ(session.learn(sine_load), Learned::learned);
    const double first = session.learning.rms_error();
    for (int i = 0; i < 3; ++i) session.learn(sine_load);
    EXPECT_LT(session.learning.rms_error(), first / 5) << "at speed " << speed;
  }
}

TEST(IterativeLearning, MakesFrictionsErrorTwiceAsSmallInThreeRepetitions) {
  Session session;
  session.learn(friction_load);
  const double first = session.learning.rms_error();
  for (int i = 0; i < 3; ++i) session.learn(friction_load);
  EXPECT_LT(session.learning.rms_error(), first / 2) << "steps contain more than Q passes";
}

TEST(IterativeLearning, LearnsTheTrueLoadAtTheTrueTimeAtAnyDelayAndSpeed) {
  for (const double speed : {0.5, 1.0, 2.0}) {
    Session session(speed);
    for (int i = 0; i < 6; ++i) session.learn(sine_load);
    // The load meets the force that was sent earlier by the delay and half a tick.
    const double early = speed * (late_plant().delay + 0.5 * kPeriod);
    double worst = 0, worst_late = 0;
    for (double t = 0.3; t < 1.7; t += 0.01) {
      worst = std::max(worst, (session.learning.table().at(t) + sine_load(t + early, kNone, kNone)).norm());
      worst_late = std::max(worst_late, (session.learning.table().at(t) + sine_load(t - early, kNone, kNone)).norm());
    }
    // At twice the speed the 5 Hz component is at 10 Hz, where Q has a gain of 0.83.
    EXPECT_LT(worst, speed > 1 ? 0.35 : 0.06) << "at speed " << speed;
    EXPECT_GT(worst_late, worst + 0.05) << "the time is right to well within the delay";
  }
}

TEST(IterativeLearning, IsNotMisledByTicksThatComeUnevenly) {
  Session session(1, true);
  session.learn(sine_load);
  const double first = session.learning.rms_error();
  for (int i = 0; i < 3; ++i) EXPECT_EQ(session.learn(sine_load), Learned::learned);
  EXPECT_LT(session.learning.rms_error(), first / 4);
}

TEST(IterativeLearning, StopsWhereNothingRepeatsAndDoesNotGrow) {
  Session session;
  std::mt19937 engine(5);
  Vec3 push = kNone;
  const Load noise = [&](double, const Vec3&, const Vec3&) -> Vec3 {
    const auto even = [&] { return static_cast<double>(engine()) / 2147483648.0 - 1; };
    const double x = even(), y = even();
    push += 0.005 * (12 * Vec3(x, y, even()) - push);  // a hand's force, below a few Hz
    return push;
  };
  session.learn(noise);
  const double first = session.learning.rms_error();
  bool converged = false;
  double largest = 0;
  for (int i = 0; i < 12; ++i) {
    const Learned outcome = session.learn(noise);
    converged = converged || outcome == Learned::converged;
    if (i > 2) largest = std::max(largest, session.learning.rms_error());
  }
  EXPECT_TRUE(converged);
  EXPECT_LT(largest, 1.6 * first);
}

TEST(IterativeLearning, StopsWhenTheResidualDoesNotRepeat) {
  Session session;
  std::mt19937 engine(5);
  Vec3 push = kNone;
  const Load load = [&](double time, const Vec3& x, const Vec3& v) -> Vec3 {
    push += 0.005 * (2 * Vec3::Constant(static_cast<double>(engine()) / 2147483648.0 - 1) - push);
    return sine_load(time, x, v) + push;
  };
  session.learn(load);
  const double first = session.learning.rms_error();
  std::vector<Learned> outcomes;
  for (int i = 0; i < 9; ++i) outcomes.push_back(session.learn(load));
  EXPECT_THAT(outcomes, testing::Contains(Learned::converged));
  EXPECT_LT(session.learning.rms_error(), first / 3);
}

TEST(IterativeLearning, RevertsATableThatMadeARepetitionWorse) {
  Session session;
  std::vector<Vec3> best;
  double rms = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 4; ++i) {
    const std::vector<Vec3> driven = session.learning.table().force;
    session.learn(sine_load);
    if (session.learning.rms_error() < rms) best = driven;
    rms = std::min(rms, session.learning.rms_error());
  }
  ASSERT_NE(session.learning.table().force, best);
  const Load other = [](double time, const Vec3&, const Vec3&) -> Vec3 { return Vec3(4 * std::sin(20 * time), 0, 0); };
  EXPECT_EQ(session.learn(other), Learned::undone);
  EXPECT_TRUE(session.learning.table().force == best) << "the table of the best repetition";
  const int learned = session.learning.repetitions();
  EXPECT_EQ(session.learn(other), Learned::undone);
  EXPECT_EQ(session.learning.repetitions(), learned);
  EXPECT_EQ(session.learn(sine_load), Learned::learned) << "learning continues when the conditions are as before";
}

TEST(IterativeLearning, SkipsARepetitionThatWasInterruptedPausedOrShort) {
  Session session;
  ASSERT_TRUE(session.repeat(sine_load, 0.5));
  const std::vector<Vec3> before = session.learning.table().force;
  EXPECT_EQ(session.learning.learn(session.log), Learned::skipped) << "paused";

  ASSERT_TRUE(session.repeat(sine_load));
  RepetitionLog cut = session.log;
  const std::size_t half = cut.size() / 2;
  cut.time.resize(half);
  for (auto* column : {&cut.position, &cut.reference, &cut.acceleration, &cut.known, &cut.sent}) column->resize(half);
  EXPECT_EQ(session.learning.learn(cut), Learned::skipped) << "interrupted";
  EXPECT_EQ(session.learning.learn({}), Learned::skipped) << "nothing";
  EXPECT_EQ(session.learning.table().force, before);
  EXPECT_EQ(session.learning.repetitions(), 0);
  EXPECT_EQ(session.learning.learn(session.log), Learned::learned) << "the complete repetition is not skipped";
}

TEST(IterativeLearning, LearnsNothingFromASoftenedRepetitionAndReturnsToTheBestTable) {
  Session session;
  std::vector<Vec3> best;
  double rms = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 3; ++i) {
    const std::vector<Vec3> driven = session.learning.table().force;
    session.learn(sine_load);
    if (session.learning.rms_error() < rms) best = driven;
    rms = std::min(rms, session.learning.rms_error());
  }
  ASSERT_NE(session.learning.table().force, best);
  const int learned = session.learning.repetitions();

  session.soften_from = 0.5 * kDuration;
  EXPECT_EQ(session.learn(sine_load), Learned::softened);
  EXPECT_EQ(session.learning.table().force, best);
  EXPECT_EQ(session.learning.repetitions(), learned);
  session.soften_from = 2 * kDuration;
  EXPECT_EQ(session.learn(sine_load), Learned::learned) << "the whole feedback acts again";
  session.soften_from = 0.99 * kDuration;
  EXPECT_EQ(session.learn(sine_load), Learned::learned) << "a moment is no other loop";
}

TEST(IterativeLearning, ForgetsATableOfAnEarlierSessionThatMayBeWhatShakesTheDevice) {
  Session session;
  for (int i = 0; i < 3; ++i) session.learn(sine_load);
  const auto is_zero = [&] {
    return std::ranges::all_of(session.learning.table().force, [](const Vec3& force) { return force.isZero(); });
  };
  const IterativeLearning::Options options{.mass = late_plant().mass, .duration = kDuration};
  session.learning = IterativeLearning(options, session.learning.table(), 1);
  session.soften_from = 0;
  EXPECT_EQ(session.learn(sine_load), Learned::softened);
  EXPECT_FALSE(is_zero()) << "the law may be the cause";
  EXPECT_EQ(session.learn(sine_load), Learned::softened);
  EXPECT_TRUE(is_zero());
  EXPECT_EQ(session.learning.repetitions(), 0);
  session.soften_from = 2 * kDuration;
  EXPECT_EQ(session.learn(sine_load), Learned::learned);
  EXPECT_FALSE(is_zero());

  session.learning = IterativeLearning(options, session.learning.table(), 1);
  EXPECT_EQ(session.learn(sine_load), Learned::learned) << "a repetition that is calm shows that it is good";
  session.soften_from = 0;
  for (int i = 0; i < 3; ++i) EXPECT_EQ(session.learn(sine_load), Learned::softened);
  EXPECT_FALSE(is_zero());
}

TEST(IterativeLearning, LearnsOnUnderAnotherLawThatIsWorseThanTheOneThatVibrated) {
  Session session;
  for (int i = 0; i < 3; ++i) session.learn(sine_load);
  session.vibrate_from = 0.995 * kDuration;
  EXPECT_EQ(session.learn(sine_load), Learned::softened) << "a moment of it is another loop";
  session.vibrate_from = 2 * kDuration;
  const auto other = [](double t, const Vec3& x, const Vec3& v) -> Vec3 { return -3 * sine_load(t, x, v); };
  EXPECT_EQ(session.learn(other), Learned::learned);
  const double first = session.learning.rms_error();
  EXPECT_EQ(session.learn(other), Learned::learned);
  EXPECT_LT(session.learning.rms_error(), 0.7 * first);
}

TEST(IterativeLearning, LeavesLoadsToTheTermsThatCancelThem) {
  Session session;
  ASSERT_TRUE(session.repeat(sine_load));
  RepetitionLog log = session.log;
  IterativeLearning one = session.learning, other = session.learning;
  one.learn(log);
  for (Vec3& known : log.known) known += Vec3(1, 2, 3);
  other.learn(log);
  for (const double t : {0.2, 1.0, 1.8})
    EXPECT_LT((one.table().at(t) - other.table().at(t) - Vec3(1, 2, 3)).norm(), 1e-6);
}

/// Returns the largest force [N] in the table learned from a mass without a load, which responds exactly to the sent
/// force. `force(t)` acts on the mass at t.
template <class Position, class Force>
double invented(double delay, const Position& position, const Force& force) {
  IterativeLearning learning({.mass = Vec3::Constant(0.4), .delay = delay, .duration = 1});
  RepetitionLog log;
  for (int i = 0; i <= 1000; ++i) {
    const double t = i * kPeriod;
    log.time.push_back(t);
    log.position.emplace_back(position(t), 0, 0);
    log.reference.push_back(log.position.back());
    log.acceleration.emplace_back(force(t) / 0.4, 0, 0);
    log.known.push_back(kNone);
    log.sent.emplace_back(force(t + delay + 0.5 * kPeriod), 0, 0);
  }
  EXPECT_EQ(learning.learn(log), Learned::learned);
  double largest = 0;
  for (const Vec3& row : learning.table().force) largest = std::max(largest, row.norm());
  return largest;
}

TEST(IterativeLearning, InventsNoLoadWhereThePathAcceleratesAtItsEnds) {
  for (const double delay : {0.0, 2e-3, 3.3e-3})
    EXPECT_LT(invented(
                  delay, [](double t) { return 0.5 * t * t; }, [](double) { return 0.4; }),
              1e-6)
        << delay;
}

TEST(IterativeLearning, TakesTheInertiaAtTheTimeWhenAForceActs) {
  const double w = 2 * M_PI * 5;
  for (const double delay : {0.0, 2e-3, 3.3e-3})
    EXPECT_LT(invented(
                  delay, [&](double t) { return -std::sin(w * t) / (0.4 * w * w); },
                  [&](double t) { return std::sin(w * t); }),
              5e-3)
        << delay;
}

TEST(IterativeLearning, RejectsRepetitionsThatAreTooLongOrHaveNoDuration) {
  const auto error_of = [](double duration, double speed) {
    return test::error_of([&] { (void)IterativeLearning({.speed = speed, .duration = duration}); });
  };
  EXPECT_EQ(error_of(600, 1), "no error");
  EXPECT_EQ(error_of(1200, 2), "no error");
  EXPECT_THAT(error_of(600, 0.5), testing::HasSubstr("a repetition lasts 1200.0 s"));
  EXPECT_THAT(error_of(600, 0.5), testing::HasSubstr("600 s"));
  EXPECT_THAT(error_of(0, 1), testing::HasSubstr("a repetition lasts 0.0 s"));
  EXPECT_THAT(error_of(kNaN, 1), testing::HasSubstr("nan"));

  for (const double step : {0.0, -0.004, kNaN})
    EXPECT_THAT(test::error_of([&] { (void)IterativeLearning({.duration = 1}, {.step = step, .force = {kNone}}); }),
                testing::HasSubstr("the step of a learned force is"));
}

TEST(IterativeLearning, ContinuesFromAKnownTable) {
  Session first;
  for (int i = 0; i < 4; ++i) first.learn(sine_load);
  Session second;
  second.learning =
      IterativeLearning({.mass = late_plant().mass, .delay = 2e-3, .duration = kDuration}, first.learning.table(), 1);
  EXPECT_EQ(second.learning.table().force, first.learning.table().force);
  second.learn(sine_load);
  EXPECT_LT(second.learning.rms_error(), 1.5 * first.learning.rms_error());
}

TEST(ForceTable, IsStraightBetweenItsRowsAndHoldsItsEnds) {
  const ForceTable table{.step = 0.5, .force = {Vec3(1, 0, 0), Vec3(3, 0, 0), Vec3(2, 1, 0)}};
  EXPECT_TRUE(table.at(0.25).isApprox(Vec3(2, 0, 0), 1e-12));
  EXPECT_TRUE(table.at(0.75).isApprox(Vec3(2.5, 0.5, 0), 1e-12));
  EXPECT_EQ(table.at(-1), Vec3(1, 0, 0));
  EXPECT_EQ(table.at(9), Vec3(2, 1, 0));
  EXPECT_EQ(ForceTable{}.at(1), kNone);
}

TEST(LearnedForce, MakesNoStepWhenTheTableChangesOrThePathBegins) {
  ForceTable one{.step = 0.1, .force = {Vec3(5, 0, 0), Vec3(5, 0, 0)}};
  ForceTable two{.step = 0.1, .force = {Vec3(-5, 0, 0), Vec3(0, 5, 0)}};
  LearnedForce learned(1, 0);
  State state;
  state.dt = kPeriod;
  const Tuning tuning;
  Vec3 before = kNone;
  for (int i = 0; i < 3000; ++i) {
    if (i % 700 == 10) learned.use(&one);
    if (i % 700 == 300) learned.use(&two);
    if (i == 2900) learned.use(nullptr);
    Reference reference{kNone, kNone, kNone, i % 1000 < 300 ? kNaN : 0.1};
    const Vec3 force = learned.force({state, reference, tuning});
    EXPECT_LE((force - before).norm(), 20 * kPeriod / 0.05) << i;
    before = force;
  }
}

TEST(LearnedForce, IsItsShareOfTheTable) {
  const ForceTable table{.step = 1, .force = {Vec3(2, 0, 0), Vec3(2, 0, 0)}};
  LearnedForce learned(1, 0);
  learned.use(&table);
  State state;
  state.dt = kPeriod;
  Tuning tuning;
  const Reference reference{kNone, kNone, kNone, 0.5};
  Vec3 force = kNone;
  for (int i = 0; i < 2000; ++i) force = learned.force({state, reference, tuning});
  EXPECT_NEAR(force.x(), 2, 1e-9);
  tuning.learning = 0.25;
  EXPECT_NEAR(learned.force({state, reference, tuning}).x(), 0.5, 1e-9);
}

TEST(LearnedForce, LogsNoRepetitionThatExceedsItsRowsOrHasNone) {
  for (const std::size_t rows : {std::size_t{0}, std::size_t{50}, std::size_t{101}}) {
    LearnedForce learned(0.1, rows);
    RepetitionLog log;
    log.reserve(rows);
    State state;
    state.dt = kPeriod;
    const Tuning tuning;
    int taken = 0;
    for (int repetition = 0; repetition < 2; ++repetition)
      for (int i = 0; i < 200; ++i) {
        const double time = i < 20 ? kNaN : std::min(0.1, (i - 20) * kPeriod);
        (void)learned.force({state, {kNone, kNone, kNone, time}, tuning});
        if (learned.take_repetition(log)) ++taken;
      }
    EXPECT_EQ(taken, rows > 100 ? 2 : 0);
  }
}

TEST(LearnedForce, LogsTheSentForceBesideTheStateOfEachTick) {
  LearnedForce learned(0.1, 200);
  RepetitionLog log;
  log.reserve(200);
  const Tuning tuning;
  for (int i = 0; i < 130; ++i) {
    State state;
    state.dt = kPeriod;
    state.position = Vec3(i, 0, 0);
    state.force_applied = Vec3(i - 1, 0, 0);  // force of the previous tick
    const double time = i < 20 ? kNaN : std::min(0.1, (i - 20) * kPeriod);
    (void)learned.force({state, {Vec3(0, i, 0), kNone, kNone, time}, tuning, Vec3(0, 0, i)});
    if (learned.take_repetition(log)) break;
  }
  ASSERT_EQ(log.size(), 101U);
  ASSERT_EQ(log.sent.size(), log.size());
  for (std::size_t k = 0; k < log.size(); ++k) {
    const double i = static_cast<double>(k) + 20;
    EXPECT_EQ(log.position[k].x(), i);
    EXPECT_EQ(log.reference[k].y(), i);
    EXPECT_EQ(log.known[k].z(), i);
    EXPECT_EQ(log.sent[k].x(), i);
  }
}

TEST(LearnedForce, AllocatesNothing) {
  const ForceTable table{.step = 0.1, .force = {Vec3(5, 0, 0), Vec3(5, 0, 0)}};
  LearnedForce learned(0.5, 1000);
  RepetitionLog log;
  log.reserve(1000);
  learned.use(&table);
  State state;
  state.dt = kPeriod;
  const Tuning tuning;
  const std::size_t before = test::allocations();
  for (int i = 0; i < 3000; ++i) {
    const double time = i % 1000 < 300 ? kNaN : std::min(0.5, (i % 1000 - 300) * kPeriod);
    (void)learned.force({state, {kNone, kNone, kNone, time}, tuning});
    (void)learned.take_repetition(log);
  }
  EXPECT_EQ(test::allocations(), before);
}

}  // namespace
}  // namespace haptrace
