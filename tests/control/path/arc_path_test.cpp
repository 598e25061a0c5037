#include "control/path/arc_path.h"

#include "tests/support/errors.h"

#include <cmath>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>

namespace haptrace {
namespace {

using testing::HasSubstr;

struct Moment {
  Vec3 position = Vec3::Zero(), force = Vec3::Zero();
};

ArcPath built(const std::function<Moment(double)>& motion, double duration, double step = 1e-3,
              double spacing = 2.5e-4) {
  ArcPath::Builder builder(spacing);
  for (int i = 0; i * step <= duration + 1e-9; ++i) {
    const Moment moment = motion(i * step);
    builder.add(i * step, moment.position, moment.force);
  }
  return builder.finish(0.005);
}

/// Returns the motion along x at 0.05 m/s, with a force that grows with x.
Moment line(double t) {
  return {{0.05 * t, 0, 0}, {0, 20 * 0.05 * t, 1}};
}

Moment circle(double t) {
  return {0.04 * Vec3(std::cos(t), std::sin(t), 0), Vec3(std::cos(t), 0, 0)};
}

TEST(ArcPath, HasTheLengthOfALine) {
  const ArcPath path = built(line, 2);
  EXPECT_NEAR(path.length(), 0.1, 1e-12);
  EXPECT_EQ(path.knots(), 401U);
  for (const double s : {0.0, 0.0123, 0.05, 0.09999, 0.1}) {
    const ArcPath::Place place = path.at(s);
    EXPECT_NEAR(place.position.x(), s, 1e-9);
    EXPECT_NEAR(place.tangent.x(), 1, 1e-12);
    EXPECT_NEAR(place.speed, 0.05, 1e-9);
    EXPECT_NEAR(place.force.y(), 20 * s, 20 * 1.3e-4) << "half a segment at the ends";
    EXPECT_NEAR(place.force.z(), 1, 1e-6);
    EXPECT_FLOAT_EQ(static_cast<float>(place.radius), 0.005F);
    EXPECT_NEAR(path.time_at(s), s / 0.05, 1e-6);
    EXPECT_NEAR(path.place_at(s / 0.05), s, 1e-9);
  }
}

TEST(ArcPath, BeginsWithARestOfMovesWhoseSquaresUnderflow) {
  // As a smoothing filter leaves them before a movement that begins late.
  ArcPath::Builder builder(2.5e-4);
  double t = 0, y = 1e-170;
  for (; y < 1e-9; y *= 3) builder.add(t += 1e-3, {-0.04, y, 1e-165 - y * 1e-3}, Vec3::Zero());
  for (int i = 0; i <= 100; ++i) builder.add(t += 1e-3, {-0.04 + 5e-4 * i, 0, 0}, Vec3::Zero());
  const ArcPath path = builder.finish(0.005);
  EXPECT_NEAR(path.length(), 0.05, 1e-9);
  EXPECT_EQ(path.knots(), 201U);
  EXPECT_NEAR(path.diagonal(), 0.05, 1e-9);
}

TEST(ArcPath, DoesNotDependOnSamplingOrSpeed) {
  const ArcPath fine = built(circle, 2 * std::numbers::pi, 1e-4);
  EXPECT_NEAR(fine.length(), 0.08 * std::numbers::pi, 1e-5);
  const auto hurried = [](double t) { return circle(t * t / (2 * std::numbers::pi)); };
  for (const ArcPath& other : {built(circle, 2 * std::numbers::pi, 4e-3), built(hurried, 2 * std::numbers::pi, 5e-4)}) {
    EXPECT_NEAR(other.length(), fine.length(), 2e-4);
    for (double s = 0.005; s < 0.24; s += 0.0031) {
      EXPECT_LT((other.at(s).position - fine.at(s).position).norm(), 2e-4);
      EXPECT_LT((other.at(s).force - fine.at(s).force).norm(), 0.02);
    }
  }
}

TEST(ArcPath, IgnoresTremorAtRestAndTreatsAPauseAsASlowPoint) {
  const auto paused = [](double t) {
    Moment moment = line(std::clamp(t, 0.0, 1.0) + std::max(t - 3, 0.0));
    if (t > 1 && t < 3) {
      moment.position += 5e-5 * Vec3(std::sin(300 * t), std::cos(170 * t), 0);
      moment.force = Vec3(0, 3, 0);
    }
    return moment;
  };
  const ArcPath path = built(paused, 4);
  EXPECT_NEAR(path.length(), 0.1, 3e-4);
  double slowest = 1, strongest = 0;
  for (double s = 0.049; s < 0.051; s += 1e-5) {
    slowest = std::min(slowest, path.at(s).speed);
    strongest = std::max(strongest, path.at(s).force.y());
  }
  EXPECT_NEAR(strongest, 3, 0.1) << "the force that the trainee felt there most of the time";
  EXPECT_LT(slowest, 5e-4);
  EXPECT_NEAR(path.at(0.02).speed, 0.05, 1e-6);
  EXPECT_NEAR(path.time_at(path.length()), 4, 1e-9);
}

TEST(ArcPath, KeepsBothLegsOfARetracedStroke) {
  const auto there_and_back = [](double t) {
    return Moment{{0.05 * (t < 1 ? t : 2 - t), 0, 0}, {t < 1 ? 1.0 : -1.0, 0, 0}};
  };
  const ArcPath path = built(there_and_back, 2);
  EXPECT_NEAR(path.length(), 0.1, 6e-4) << "the turn is cut by less than a spacing";
  EXPECT_NEAR(path.at(0.03).tangent.x(), 1, 1e-9);
  EXPECT_NEAR(path.at(0.07).tangent.x(), -1, 1e-9);
  EXPECT_NEAR(path.at(0.07).position.x(), 0.03, 5e-4);
  EXPECT_NEAR(path.at(0.07).force.x(), -1, 1e-6);
}

TEST(ArcPath, KeepsTheValuesOfItsEndsBeyondThem) {
  const ArcPath path = built(line, 2);
  EXPECT_EQ(path.at(-1).position, path.at(0).position);
  EXPECT_EQ(path.at(9).position, path.at(path.length()).position);
  EXPECT_EQ(path.at(kNaN).position, path.at(0).position);
  EXPECT_EQ(path.place_at(-1), 0);
  EXPECT_EQ(path.place_at(9), path.length());
}

TEST(ArcPath, OfOnePointStaysAtThatPoint) {
  for (const double duration : {0.0, 1.0}) {
    const ArcPath path = built([](double) { return Moment{{1, 2, 3}, {0, 1, 0}}; }, duration);
    EXPECT_EQ(path.length(), 0);
    EXPECT_EQ(path.at(0.5).position, Vec3(1, 2, 3));
    EXPECT_EQ(path.at(0).force, Vec3(0, 1, 0));
    EXPECT_EQ(path.at(0).tangent, Vec3::Zero());
    EXPECT_EQ(path.at(0).speed, 0);
  }
}

TEST(ArcPath, CanHaveAnySize) {
  for (const double size : {1e-9, 1e-6, 10.0}) {
    const auto scaled = [&](double t) { return Moment{size * line(t).position / 0.1, {}}; };
    const ArcPath path = built(scaled, 2, 1e-3, ArcPath::spacing_for(size));
    EXPECT_NEAR(path.length(), size, 1e-6 * size);
    EXPECT_GT(path.knots(), 64U);
    EXPECT_NEAR(path.at(size / 3).position.x(), size / 3, 1e-6 * size);
  }
}

TEST(ArcPath, TakesARadiusForEveryKnot) {
  ArcPath path = built(line, 2);
  std::vector<double> radius(path.knots());
  for (std::size_t i = 0; i < radius.size(); ++i) radius[i] = 0.1 * path.knot_at(i);
  path.set_radius(radius);
  EXPECT_NEAR(path.at(0.04567).radius, 0.004567, 1e-8);
  radius.pop_back();
  EXPECT_THAT(test::error_of([&] { path.set_radius(radius); }), HasSubstr("400 radii were given for 401 knots"));
  radius.push_back(-1);
  EXPECT_THAT(test::error_of([&] { path.set_radius(radius); }), HasSubstr("it must be at least 0"));
}

TEST(ArcPath, EndsTwoMillimetresBeforeTheLastPointAndAShortOneLater) {
  EXPECT_TRUE(is_at_end(0.1985, 0.2));
  EXPECT_FALSE(is_at_end(0.1975, 0.2));
  EXPECT_TRUE(is_at_end(9.6e-3, 10e-3));
  EXPECT_FALSE(is_at_end(9.4e-3, 10e-3)) << "2 mm are a fifth of the movement";
  EXPECT_TRUE(is_at_end(0, 0));
}

TEST(ArcPath, NeedsASample) {
  EXPECT_THAT(test::error_of([] { (void)ArcPath::Builder(2.5e-4).finish(0); }), HasSubstr("without samples"));
  EXPECT_THAT(test::error_of([] { ArcPath::Builder(0); }), HasSubstr("must be greater than 0"));
}

}  // namespace
}  // namespace haptrace
