// Tests of the back wall with hands along a line.
#include "control/back_wall.h"

#include "control/guidance.h"
#include "control/path/place_tracker.h"
#include "control/tunnel_wall.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <memory>
#include <numbers>
#include <optional>
#include <vector>

namespace haptrace {
namespace {

using test::error_of;
using testing::HasSubstr;

constexpr double kTick = 1e-3, kStroke = 0.06, kStrokeTime = 1.5, kPause = 1.0;

double stroke(double t) {
  const double u = std::clamp(t / kStrokeTime, 0.0, 1.0);
  return kStroke * u * u * u * (10 - 15 * u + 6 * u * u);
}

/// Returns the place of an expert on a line who rests for 0.8 s, makes a stroke, pauses, and makes another one.
double expert_place(double t) {
  const double moving = t - 0.8;
  return moving <= kStrokeTime + kPause ? stroke(moving) : kStroke + stroke(moving - kStrokeTime - kPause);
}

constexpr double kExpertTime = 0.8 + 2 * kStrokeTime + kPause;

std::shared_ptr<const ArcPath> line() {
  ArcPath::Builder builder(2.5e-4);
  for (double t = 0; t <= kExpertTime; t += kTick) builder.add(t, Vec3(expert_place(t), 0, 0), Vec3::Zero());
  return std::make_shared<const ArcPath>(builder.finish(0.02));
}

/// Returns a movement that starts at `start` [s]: the expert's without its first rest.
std::function<double(double)> after(double start) {
  return [start](double t) { return expert_place(std::max(t - start, 0.0) + 0.8); };
}

/// One tick of a course.
struct Tick {
  double time, hand, wall, force, place;
};

/// A course of a hand along the line with a back wall in guidance, as GuidanceController runs it.
class Course {
 public:
  explicit Course(const BackWallOptions& options = {}, bool allow_back = false)
      : path_(line()), tracker_(*path_, {.allow_back = allow_back}) {
    GuideTerms terms;
    terms.push_back(std::make_unique<TunnelWall>(TunnelWall::Options{}));
    auto wall = std::make_unique<BackWall>(path_, options);
    wall_ = wall.get();
    terms.push_back(std::move(wall));
    guidance_.emplace(std::move(terms), Guidance::Options{.energy = 0.05, .delay = 0});
    tracker_.start();
    guidance_->begin();
    wall_->begin();
  }

  /// Advances by one tick. Returns the force on the hand along the line [N].
  double step(double hand) {
    State state;
    state.position = Vec3(hand, 0, 0);
    state.velocity = Vec3((hand - before_) / kTick, 0, 0);
    state.force_applied = Vec3(force_, 0, 0);
    state.dt = kTick;
    before_ = hand;
    const auto& foot = tracker_.update(state.position, kTick);
    wall_->update(foot, state.position, kTick);
    force_ = guidance_->update(state, foot, false).x();
    wall_->acted(guidance_->tank().share());
    ticks.push_back({time_ += kTick, hand, wall_->place(), force_, foot.s});
    return force_;
  }

  /// Moves the hand as `place` says.
  void lead(const std::function<double(double)>& place, double duration) {
    for (double t = 0; t < duration; t += kTick) step(place(t));
  }

  /// Lets a passive arm of 1 kg with viscous (10 N s/m) and dry resistance [N] be pushed.
  void push(double dry, double duration) {
    double x = before_, v = 0;
    for (double t = 0; t < duration; t += kTick) {
      const double free = v + kTick * (step(x) - 10 * v), most = kTick * dry;
      v = std::abs(free) > most ? free - std::copysign(most, free) : 0;
      x += kTick * v;
    }
  }

  [[nodiscard]] double largest_force(double from = 0, double to = 1e9) const {
    double most = 0;
    for (const Tick& tick : ticks)
      if (tick.time >= from && tick.time < to) most = std::max(most, std::abs(tick.force));
    return most;
  }
  [[nodiscard]] const Initiation& initiation() const { return wall_->initiation(); }
  [[nodiscard]] const Guidance& guidance() const { return *guidance_; }
  [[nodiscard]] const ArcPath& path() const { return *path_; }

  std::vector<Tick> ticks;

 private:
  std::shared_ptr<const ArcPath> path_;
  PlaceTracker tracker_;
  std::optional<Guidance> guidance_;
  BackWall* wall_ = nullptr;
  double before_ = 0, force_ = 0, time_ = 0;
};

TEST(BackWall, IsExactlyAbsentForATraineeWhoStartsInTime) {
  for (const double start : {0.0, 0.3, 1.0, 1.8}) {
    Course course;
    course.lead(after(start), start + kExpertTime);
    EXPECT_EQ(course.largest_force(), 0) << "start after " << start << " s";
    EXPECT_EQ(course.initiation().initiator, Initiator::self);
    EXPECT_NEAR(course.initiation().waited, start + 0.33, 0.12) << "5 mm or 20 mm/s of a stroke take a while";
    EXPECT_EQ(course.initiation().work, 0);
  }
}

TEST(BackWall, TakesTheRecoilOfAnArmAfterTheApproachForNoStart) {
  for (const double way : {0.004, 0.012, 0.02}) {
    Course course;
    course.lead([&](double t) { return way * std::clamp((t - 0.05) / 0.3, 0.0, 1.0); }, 1.9);
    EXPECT_EQ(course.initiation().initiator, Initiator::none) << way;
    EXPECT_EQ(course.largest_force(), 0) << way;
    course.push(0.8, 6);
    EXPECT_EQ(course.initiation().initiator, Initiator::helped) << way;
  }
  Course leaves;
  leaves.lead([](double t) { return 0.06 * std::max(t - 0.05, 0.0); }, 1.5);
  EXPECT_EQ(leaves.initiation().initiator, Initiator::self) << "a hand that does not come to rest has left";
  EXPECT_NEAR(leaves.initiation().waited, 0.08, 0.06) << "when it began to move";
}

TEST(BackWall, LeadsAHandThatNeverStartsToTheEnd) {
  Course course;
  course.push(0.8, 12);
  EXPECT_EQ(course.largest_force(0, 1.99), 0) << "it waits for 2 s";
  EXPECT_GT(course.largest_force(0, 4), 1);
  EXPECT_GT(course.ticks.back().hand, course.path().length() - 0.01);
  EXPECT_EQ(course.initiation().initiator, Initiator::helped);
  EXPECT_GT(course.initiation().waited, 2);
  double work = 0;
  for (std::size_t i = 1; i < course.ticks.size(); ++i)
    work += course.ticks[i - 1].force * (course.ticks[i].hand - course.ticks[i - 1].hand);
  EXPECT_NEAR(course.initiation().work, work, 1e-9);
  EXPECT_GT(work, 0.05) << "more than the tank held";
  EXPECT_LE(course.guidance().given(), course.guidance().budget());
}

TEST(BackWall, WaitsAgainWhereTheExpertStopped) {
  Course course;
  course.push(0.8, 12);
  // It arrives at the pause, waits for 2 s, and moves on.
  double arrives = 0, leaves = 0;
  for (const Tick& tick : course.ticks) {
    if (arrives == 0 && tick.wall > kStroke - 1e-3) arrives = tick.time;
    if (leaves == 0 && tick.wall > kStroke + 1e-3) leaves = tick.time;
  }
  EXPECT_NEAR(leaves - arrives, 2, 0.4);

  // A trainee who rests there for 1.5 s and continues alone feels nothing.
  Course alone;
  const auto place = after(0.2);
  alone.lead([&](double t) { return place(t < 2.5 ? t : std::max(2.5, t - 0.5)); }, 8);
  EXPECT_EQ(alone.largest_force(), 0);
}

TEST(BackWall, PushesATooWeakHandWithItsLargestForceAndDoesNotWindUp) {
  const BackWallOptions options{.stiffness = 200, .max_force = 1.5};
  Course course(options);
  course.push(3, 8);
  EXPECT_EQ(course.ticks.back().hand, 0);
  EXPECT_NEAR(course.largest_force(), options.max_force, 1e-9);
  EXPECT_NEAR(course.ticks.back().wall, options.max_force / options.stiffness, 1e-6);
  EXPECT_EQ(course.initiation().initiator, Initiator::none);
  EXPECT_NEAR(course.initiation().waited, 8, 0.01);
  EXPECT_EQ(course.initiation().work, 0);
}

TEST(BackWall, StaysNearAHandThatGoesBackAndGivesNoEnergyWithoutEnd) {
  Course course({}, true);
  // Pushed half way, then the hand goes to and fro over 30 mm, ten times.
  course.push(0.8, 4);
  const double half = course.ticks.back().hand;
  ASSERT_GT(half, 0.04);
  course.lead([&](double t) { return half - 0.015 * (1 - std::cos(2 * std::numbers::pi * t)); }, 10);
  const BackWallOptions options;
  for (const Tick& tick : course.ticks)
    ASSERT_LE(tick.wall, tick.place + options.max_force / options.stiffness + 1e-9) << tick.time;
  EXPECT_LE(course.guidance().given(), course.guidance().budget() + 1e-6);
}

TEST(BackWall, StartsEveryRepetitionAnew) {
  BackWall wall(line(), {});
  PathProjection projection(*line(), {});
  wall.begin();
  for (int i = 0; i < 2500; ++i) wall.update(projection.foot(), Vec3::Zero(), kTick);
  EXPECT_GT(wall.place(), 0);
  wall.begin();
  EXPECT_EQ(wall.place(), 0);
  EXPECT_EQ(wall.initiation().waited, 0);
}

TEST(BackWall, NamesTheInvalidOption) {
  EXPECT_THAT(error_of([] { BackWall(line(), {.wait = -1}); }), HasSubstr("the time for which the back wall waits"));
  EXPECT_THAT(error_of([] { BackWall(line(), {.stiffness = 0}); }), HasSubstr("the stiffness of the back wall is 0"));
  EXPECT_THAT(error_of([] { BackWall(line(), {.max_force = -1}); }), HasSubstr("the largest force of the back wall"));
}

TEST(BackWall, AllocatesNothing) {
  BackWall wall(line(), {});
  const auto path = line();
  PathProjection projection(*path, {});
  const GuideTuning tuning;
  const State state;
  const std::size_t before = test::allocations();
  wall.begin();
  for (int i = 0; i < 6000; ++i) {
    const auto& foot = projection.update(Vec3(1e-5 * i, 0, 0), kTick);
    wall.update(foot, Vec3(1e-5 * i, 0, 0), kTick);
    (void)wall.force({state, foot, 1, tuning});
    wall.acted(1);
  }
  EXPECT_EQ(test::allocations(), before);
}

}  // namespace
}  // namespace haptrace
