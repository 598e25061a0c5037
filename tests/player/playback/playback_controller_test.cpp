#include "player/playback/playback_controller.h"

#include "control/path/shapes.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <memory>

namespace haptrace {
namespace {

using testing::HasSubstr;

Path timed_circle(double duration = 2) {
  return make_shape("circle", {.size = 0.06, .duration = duration});
}

PlaybackController follower(const Path& path, const PlaybackOptions& options, double kp = 100) {
  ForceTerms terms;
  terms.push_back(std::make_unique<PdLaw>());
  return {
      Trajectory(path, Interpolation::cubic), std::move(terms), {.gains = {Vec3::Constant(kp), Vec3::Zero()}}, options};
}

/// Runs a controller and returns its commands; `where` computes the hand's position from the previous reference.
template <class Where>
std::vector<Command> drive(Controller& controller, Where where, std::size_t most = 100000, double dt = 1e-3) {
  State state;
  state.position = where(0, Vec3::Zero().eval());
  controller.start(state);
  std::vector<Command> answers;
  for (std::size_t i = 0; i < most; ++i) {
    state.tick = i;
    state.dt = i == 0 ? 0 : dt;
    state.position = where(i, answers.empty() ? state.position : answers.back().reference.position);
    answers.push_back(controller.update(state));
    if (answers.back().status != Command::Status::working) break;
  }
  return answers;
}

const auto obedient = [](std::size_t i, const Vec3& reference) -> Vec3 {
  return i == 0 ? Vec3(0, 0, 0.02) : reference;
};

double seconds_in(const std::vector<Command>& answers, Phase phase) {
  return 1e-3 * static_cast<double>(
                    std::count_if(answers.begin(), answers.end(), [&](const Command& c) { return c.phase == phase; }));
}

TEST(Playback, ApproachesRunsHoldsAndFinishesInThatOrder) {
  auto controller = follower(timed_circle(2), {.hold = 0.3});
  const auto answers = drive(controller, obedient);
  EXPECT_EQ(answers.back().status, Command::Status::finished);
  for (std::size_t i = 1; i < answers.size(); ++i) EXPECT_GE(answers[i].phase, answers[i - 1].phase);
  EXPECT_NEAR(seconds_in(answers, Phase::run), 2, 0.0021);
  EXPECT_NEAR(seconds_in(answers, Phase::hold), 0.3, 0.0021);
}

TEST(Playback, StartsWhereTheToolIsAndKeepsTheApproachSpeed) {
  auto controller = follower(timed_circle(), {.approach_speed = 0.05});
  const auto answers = drive(controller, obedient);
  EXPECT_TRUE(answers.front().reference.position.isApprox(Vec3(0, 0, 0.02), 1e-12));
  double fastest = 0;
  for (const Command& c : answers)
    if (c.phase == Phase::approach) fastest = std::max(fastest, c.reference.velocity.norm());
  EXPECT_LE(fastest, 0.05 * (1 + 1e-9));
  EXPECT_GE(fastest, 0.049);
}

TEST(Playback, ReferenceIsContinuousThroughEveryPhaseAndRepetition) {
  Path open = make_shape("reach", {.size = 0.08, .duration = 0.8});
  auto controller = follower(open, {.repetitions = 3, .hold = 0.05});
  const auto answers = drive(controller, obedient);
  for (std::size_t i = 1; i < answers.size(); ++i) {
    const Vec3 step = answers[i].reference.position - answers[i - 1].reference.position;
    const Vec3 expected = 0.5e-3 * (answers[i].reference.velocity + answers[i - 1].reference.velocity);
    ASSERT_LE((step - expected).norm(), 5e-6) << "tick " << i;
  }
}

TEST(Playback, RunsByTheTimeStampsOfThePathWhateverTheirSpacing) {
  Path path;
  path.name = "uneven";
  for (const double t : {5.0, 5.001, 5.5, 5.503, 6.0}) {
    path.time.push_back(t);
    path.position.emplace_back(0.01 * (t - 5), 0, 0);
  }
  auto controller = follower(path, {});
  const auto answers = drive(controller, obedient);
  EXPECT_NEAR(seconds_in(answers, Phase::run), 1, 0.0021);
}

TEST(Playback, SpeedScalesTimeVelocityAndAcceleration) {
  auto slow = follower(timed_circle(2), {});
  auto fast = follower(timed_circle(2), {.speed = 2});
  const auto one = drive(slow, obedient), two = drive(fast, obedient);
  EXPECT_NEAR(seconds_in(two, Phase::run), 1, 0.0021);
  const auto largest = [](const std::vector<Command>& answers, auto pick) {
    double most = 0;
    for (const Command& c : answers)
      if (c.phase == Phase::run) most = std::max(most, pick(c.reference).norm());
    return most;
  };
  const auto velocity = [](const Reference& r) { return r.velocity; };
  const auto acceleration = [](const Reference& r) { return r.acceleration; };
  EXPECT_NEAR(largest(two, velocity) / largest(one, velocity), 2, 1e-3);
  EXPECT_NEAR(largest(two, acceleration) / largest(one, acceleration), 4, 1e-2);
}

TEST(Playback, ReportsEveryRepetition) {
  auto controller = follower(timed_circle(0.2), {.repetitions = 4, .hold = 0});
  std::vector<double> told;
  for (const Command& c : drive(controller, obedient))
    if (c.event && c.event->code == EventCode::repetition) told.push_back(c.event->values[0]);
  EXPECT_EQ(told, (std::vector<double>{0, 1, 2, 3}));
}

TEST(Playback, LoopsUntilItIsStopped) {
  auto controller = follower(timed_circle(0.2), {.repetitions = 0, .hold = 0});
  EXPECT_EQ(drive(controller, obedient, 20000).back().status, Command::Status::working);
}

TEST(Playback, WaitsForAHandAfterAStallInsteadOfRunningAway) {
  auto controller = follower(timed_circle(2), {});
  State state;
  state.position = timed_circle(2).position.front();
  controller.start(state);
  state.dt = 1e-3;
  Command before;
  for (int i = 0; i < 1200; ++i)
    before = controller.update(state = {.dt = 1e-3,
                                        .position = before.reference.position.array().isNaN().any()
                                                        ? state.position
                                                        : before.reference.position});
  state.dt = 0.5;
  state.position = before.reference.position;
  const Command after = controller.update(state);
  EXPECT_NEAR((after.reference.position - before.reference.position).norm(), 5e-3 * before.reference.velocity.norm(),
              1e-5);
}

TEST(Playback, SumsItsTerms) {
  struct Constant final : ForceTerm {
    [[nodiscard]] Vec3 force(const TermInput&) noexcept override { return Vec3(1, 2, 3); }
  };
  ForceTerms terms;
  for (int i = 0; i < 3; ++i) terms.push_back(std::make_unique<Constant>());
  PlaybackController controller(Trajectory(timed_circle(), Interpolation::linear), std::move(terms), {}, {});
  EXPECT_EQ(drive(controller, obedient, 5).back().wrench.force, Vec3(3, 6, 9));
  PlaybackController nothing(Trajectory(timed_circle(), Interpolation::linear), {}, {}, {});
  EXPECT_EQ(drive(nothing, obedient, 5).back().wrench.force, Vec3::Zero());
}

/// A hand that stays 50 mm beside the reference from 1 s to 2 s.
const auto resisting = [](std::size_t i, const Vec3& reference) -> Vec3 {
  if (i == 0) return Vec3::Zero();
  return i >= 1000 && i < 2000 ? Vec3(reference + Vec3(0, 0.05, 0)) : reference;
};

TEST(Playback, StopsBeyondTheDeviationLimitAndSaysHowFar) {
  auto controller = follower(timed_circle(2), {.max_deviation = 0.03});
  const auto answers = drive(controller, resisting);
  ASSERT_EQ(answers.back().status, Command::Status::deviation);
  EXPECT_EQ(answers.size(), 1001U);
  ASSERT_TRUE(answers.back().event);
  EXPECT_NEAR(answers.back().event->values[0], 0.05, 1e-3);
  EXPECT_THAT(describe(*answers.back().event), HasSubstr(" mm off the path, the limit is 30.0 mm"));
}

TEST(Playback, PausesBeyondTheDeviationLimitAndResumesWithoutAJump) {
  auto controller = follower(timed_circle(2), {.max_deviation = 0.03, .on_deviation = DeviationPolicy::pause});
  const auto answers = drive(controller, resisting);
  EXPECT_EQ(answers.back().status, Command::Status::finished);
  EXPECT_EQ(answers[1500].reference.velocity, Vec3::Zero());
  EXPECT_EQ(answers[1500].reference.position, answers[1900].reference.position);
  EXPECT_NEAR(seconds_in(answers, Phase::run), 3, 0.01) << "a second of waiting";
  for (std::size_t i = 1; i < answers.size(); ++i)
    ASSERT_LE((answers[i].reference.position - answers[i - 1].reference.position).norm(), 3e-4);
  std::vector<EventCode> told;
  for (const Command& c : answers)
    if (c.event) told.push_back(c.event->code);
  EXPECT_EQ(told, (std::vector{EventCode::repetition, EventCode::reference_waits, EventCode::reference_goes_on}));
}

TEST(Playback, DoesNotSayThatAHandCameBackWhereOnlyTheSamplesDid) {
  auto controller = follower(timed_circle(2), {.max_deviation = 0.03, .on_deviation = DeviationPolicy::pause});
  State state{.position = timed_circle(2).position.front()};
  controller.start(state);
  state.dt = 1e-3;
  Command command;
  const auto update = [&](const Vec3& position) {
    state.position = position;
    command = controller.update(state);
    return command.event ? std::optional(command.event->code) : std::nullopt;
  };
  (void)update(state.position);
  while (command.phase != Phase::run) (void)update(command.reference.position);
  EXPECT_EQ(update(command.reference.position + Vec3(0, 0.05, 0)), EventCode::reference_waits);
  state.position = command.reference.position;
  controller.resume(state);
  for (int i = 0; i < 500; ++i) EXPECT_EQ(update(command.reference.position), std::nullopt) << i;
}

TEST(Playback, SoftensBeyondTheDeviationLimit) {
  auto controller = follower(timed_circle(2), {.max_deviation = 0.03, .on_deviation = DeviationPolicy::soften}, 100);
  const auto answers = drive(controller, resisting);
  EXPECT_EQ(answers.back().status, Command::Status::finished);
  EXPECT_NEAR(answers[1500].wrench.force.norm(), 100 * 0.03, 1e-2) << "the force at the limit";
  EXPECT_NEAR(answers[1500].kp.x(), 100 * 0.03 / 0.05, 0.5);
  EXPECT_NEAR(answers[900].kp.x(), 100, 1e-9);
  EXPECT_NEAR(seconds_in(answers, Phase::run), 2, 0.0021) << "and the path continues";
}

TEST(Playback, HasNoReferenceWhereThereIsNoMotor) {
  auto controller = follower(timed_circle(2), {.axes = {true, true, false}});
  const auto answers = drive(controller, [](std::size_t i, const Vec3& reference) -> Vec3 {
    return i == 0 ? Vec3::Zero() : Vec3(reference.x(), reference.y(), 0.08);
  });
  EXPECT_EQ(answers.back().status, Command::Status::finished);
  for (std::size_t i = 1; i < answers.size(); ++i) EXPECT_EQ(answers[i].wrench.force.z(), 0);
}

TEST(Playback, RestsAtAPathOfOnePoint) {
  Path path;
  path.name = "point";
  path.time = {3};
  path.position = {Vec3(0.01, 0, 0)};
  auto controller = follower(path, {.hold = 0.2});
  const auto answers = drive(controller, obedient);
  EXPECT_EQ(answers.back().status, Command::Status::finished);
  EXPECT_TRUE(answers.back().reference.position.isApprox(Vec3(0.01, 0, 0), 1e-12));
}

// ------------------------------------------------------------------------------------------------------ after a gap

/// Like drive(), with a gap before tick `at` in which the hand moves to `elsewhere`.
std::vector<Command> drive_with_gap(Controller& controller, std::size_t at, const Vec3& elsewhere) {
  State state{.position = Vec3(0, 0, 0.02)};
  controller.start(state);
  std::vector<Command> answers;
  for (std::size_t i = 0; i < 100000; ++i) {
    state.tick = i < at ? i : i + 5000;
    state.dt = i == 0 || i == at ? 0 : 1e-3;
    if (i > 0) state.position = answers.back().reference.position;
    if (i == at) {
      state.position = elsewhere;
      controller.resume(state);
    }
    answers.push_back(controller.update(state));
    if (answers.back().status != Command::Status::working) break;
  }
  return answers;
}

TEST(Playback, ReturnsAfterAGapToTheLastReferenceAndContinuesThere) {
  const Vec3 elsewhere(0.05, 0.07, -0.03);  // beyond the deviation limit
  for (const std::size_t at : {100U, 1000U, 1600U, 2100U, 2800U}) {
    auto whole = follower(timed_circle(2), {.hold = 0.3}), broken = follower(timed_circle(2), {.hold = 0.3});
    const auto expected = drive(whole, obedient), answers = drive_with_gap(broken, at, elsewhere);
    ASSERT_GT(answers.size(), at + 300);
    ASSERT_EQ(answers.back().status, Command::Status::finished) << at;
    EXPECT_TRUE(answers[at].reference.position.isApprox(elsewhere, 1e-12)) << "begins where the hand is";
    EXPECT_EQ(answers[at].reference.velocity, Vec3::Zero());
    EXPECT_EQ(answers[at].phase, Phase::approach);
    for (std::size_t i = at + 1; i < answers.size(); ++i) {
      const Vec3 step = answers[i].reference.position - answers[i - 1].reference.position;
      ASSERT_LE(step.norm(), 2.5e-4) << "no jump, tick " << i;
      if (answers[i].phase != Phase::approach) continue;
      ASSERT_LE(answers[i].reference.velocity.norm(), 0.1 * (1 + 1e-9)) << "at the speed of the approach";
    }
    // Without the gap and the way back, the references are those of an undisturbed run, with the same durations.
    EXPECT_NEAR(seconds_in(answers, Phase::run), 2 + (at > 600 && at < 2500 ? 0.05 : 0), 0.01) << at;
    EXPECT_NEAR(seconds_in(answers, Phase::hold), 0.3, 0.0031) << "nor does it hold again";
    EXPECT_LE((answers.back().reference.position - expected.back().reference.position).norm(), 1e-9);
    const auto told = std::count_if(answers.begin(), answers.end(),
                                    [](const Command& c) { return c.event && c.event->code == EventCode::repetition; });
    EXPECT_EQ(told, 1) << "it is still the same repetition";
  }
}

TEST(Playback, LetsThePathsTimeStandStillUntilItIsBackOnIt) {
  auto controller = follower(timed_circle(2), {});
  const auto answers = drive_with_gap(controller, 1500, Vec3(0.06, 0, 0));
  const double stood = answers[1499].reference.time;
  ASSERT_TRUE(std::isfinite(stood));
  std::size_t i = 1500;
  for (; answers[i].phase == Phase::approach; ++i) ASSERT_EQ(answers[i].reference.time, stood);
  EXPECT_GT(i, 1800U);
  EXPECT_EQ(answers[i].phase, Phase::run);
  EXPECT_NEAR(answers[i].reference.time, stood, 1e-3);
  EXPECT_LE((answers[i].reference.position - answers[1499].reference.position).norm(), 1e-4);
  EXPECT_LT(answers[i + 5].reference.velocity.norm(), 0.2 * answers[1499].reference.velocity.norm())
      << "and gathers speed from there";
  for (std::size_t k = i + 1; k < answers.size(); ++k) {
    const Vec3 change = answers[k].reference.velocity - answers[k - 1].reference.velocity;
    ASSERT_LE(change.norm(), 0.02) << "tick " << k;
  }
}

TEST(Playback, ReturnsFromAGapThatInterruptsTheReturnFromAnother) {
  auto controller = follower(timed_circle(2), {});
  State state{.position = Vec3(0, 0, 0.02)};
  controller.start(state);
  Vec3 reference = state.position;
  double time = kNaN;
  int repetitions = 0;
  for (int i = 0; i < 6000; ++i) {
    state.dt = i == 0 || i == 1500 || i == 1600 ? 0 : 1e-3;
    state.position = i == 1500 ? Vec3(0.06, 0, 0) : i == 1600 ? Vec3(-0.06, 0, 0.02) : reference;
    if (i == 1500 || i == 1600) controller.resume(state);
    const Command command = controller.update(state);
    if (command.event && command.event->code == EventCode::repetition) ++repetitions;
    reference = command.reference.position;
    if (i == 1499) time = command.reference.time;
    if (i > 1500 && command.phase == Phase::approach) {
      EXPECT_EQ(command.reference.time, time);
    }
    if (command.status != Command::Status::working) {
      EXPECT_EQ(command.status, Command::Status::finished);
      break;
    }
  }
  EXPECT_EQ(repetitions, 1);
}

TEST(Playback, NotifiesItsTermsOfAGapBeforeItUsesThem) {
  struct Starts final : ForceTerm {
    explicit Starts(std::vector<Vec3>& at) : at_(at) {}
    void start(const State& first) noexcept override { at_.push_back(first.position); }
    [[nodiscard]] Vec3 force(const TermInput&) noexcept override { return Vec3::Zero(); }
    std::vector<Vec3>& at_;
  };
  std::vector<Vec3> at;
  ForceTerms terms;
  terms.push_back(std::make_unique<Starts>(at));
  PlaybackController controller(Trajectory(timed_circle(), Interpolation::linear), std::move(terms), {}, {});
  (void)drive_with_gap(controller, 1500, Vec3(0.06, 0, 0));
  ASSERT_EQ(at.size(), 2U);
  EXPECT_EQ(at[1], Vec3(0.06, 0, 0));
}

TEST(Playback, AllocatesNothing) {
  auto controller = follower(timed_circle(1), {.repetitions = 2});
  State state;
  controller.start(state);
  const std::size_t before = test::allocations();
  for (int i = 0; i < 3000; ++i) {
    state.dt = 1e-3;
    state.position = controller.update(state).reference.position;
  }
  EXPECT_EQ(test::allocations(), before);
}

TEST(PlaybackOptions, NameTheOneThatIsOutOfRange) {
  const auto error_of = [](const PlaybackOptions& options) { return test::error_of([&] { validate(options); }); };
  EXPECT_EQ(error_of({}), "no error");
  EXPECT_THAT(error_of({.speed = 0}), HasSubstr("the speed factor is 0"));
  EXPECT_THAT(error_of({.speed = kNaN}), HasSubstr("the speed factor is nan"));
  EXPECT_THAT(error_of({.repetitions = -1}), HasSubstr("repetitions is -1"));
  EXPECT_THAT(error_of({.max_deviation = 0}), HasSubstr("the deviation limit is 0"));
}

TEST(DeviationPolicy, AnswersASlipWithTheNearest) {
  EXPECT_EQ(parse_deviation_policy("soften"), DeviationPolicy::soften);
  try {
    (void)parse_deviation_policy("puase");
    ADD_FAILURE();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("unknown deviation policy 'puase'; did you mean 'pause'?"));
  }
}

}  // namespace
}  // namespace haptrace
