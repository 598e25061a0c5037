#include "metrics/deviation.h"

#include "metrics/path_alignment.h"
#include "tests/metrics/support.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>

namespace haptrace {
namespace {

using test::error_of;
using test::Reach;
using test::reach;
using test::Sampled;
using test::sampled;
using test::Sampling;

Vec3 circle(double t) {
  return {0.05 * std::cos(t), 0.05 * std::sin(t), 0};
}

/// Returns the position at `t` on a loop around the circle in 2 pi seconds, alternately inside and outside of it.
Vec3 wavering(double t) {
  return (1 + 0.1 * std::sin(5 * t)) * circle(t);
}

Vec3 no_force(double /*t*/) {
  return Vec3::Zero();
}

constexpr double kAround = 2 * std::numbers::pi;

Polyline around() {
  return Polyline(sampled(kAround, circle, no_force, {.rate_hz = 2000}).position);
}

std::vector<Vec3> references(const Sampled& movement, Vec3 (*reference)(double)) {
  std::vector<Vec3> points;
  for (const double t : movement.time) points.push_back(reference(t));
  return points;
}

TEST(Deviation, EqualsAConstantDistance) {
  const Sampled movement = reach({.jitter = 0.4});
  std::vector<Vec3> reference = movement.position;
  for (Vec3& p : reference) p += Vec3(1e-3, 2e-3, -2e-3);
  const auto error = deviation(movement.time, movement.position, reference);
  EXPECT_NEAR(error->rms, 3e-3, 1e-12);
  EXPECT_NEAR(error->peak, 3e-3, 1e-12);
}

TEST(Deviation, DoesNotDependOnPlaceAndDirection) {
  const Sampled movement = sampled(kAround, wavering, no_force);
  const auto error = deviation(movement.time, movement.position, references(movement, circle));
  const Eigen::AngleAxisd turn(0.7, Vec3(1, 2, 3).normalized());
  const auto moved = [&](std::vector<Vec3> points) {
    for (Vec3& p : points) p = turn * p + Vec3(0.1, -2, 0.4);
    return points;
  };
  const auto there = deviation(movement.time, moved(movement.position), moved(references(movement, circle)));
  EXPECT_NEAR(there->rms, error->rms, 1e-12);
  EXPECT_NEAR(there->peak, error->peak, 1e-12);
}

TEST(Deviation, DoesNotDependOnHowAMovementWasSampled) {
  const Polyline curve = around();
  for (const Sampling& sampling : {Sampling{.rate_hz = 250}, Sampling{.rate_hz = 4000}, Sampling{.jitter = 0.8},
                                   Sampling{.rate_hz = 250, .start = 1e5}}) {
    const Sampled movement = sampled(kAround, wavering, no_force, sampling);
    std::vector<Vec3> reference;
    for (const double t : movement.time) reference.push_back(circle(t - sampling.start));
    const auto feet = align_with_path(curve, movement.position).arc;
    const auto same_time = deviation(movement.time, movement.position, reference);
    const auto contour = contour_deviation(movement.time, movement.position, curve, feet);
    EXPECT_NEAR(same_time->rms, 5e-3 / std::numbers::sqrt2, 5e-6);
    EXPECT_NEAR(same_time->peak, 5e-3, 5e-6);
    EXPECT_NEAR(contour->rms, same_time->rms, 5e-6);
    EXPECT_NEAR(contour->peak, same_time->peak, 5e-6);
  }
}

TEST(Deviation, AStretchCountsByItsTimeAndNotByItsSamples) {
  std::vector<double> time;
  std::vector<Vec3> position;
  for (int i = 0; i <= 1000; ++i) time.push_back(i * 1e-3), position.push_back(Vec3::Zero());
  for (int i = 1; i <= 10; ++i) time.push_back(1 + i * 0.1), position.emplace_back(1e-3, 0, 0);
  const std::vector<Vec3> reference(time.size(), Vec3::Zero());
  EXPECT_NEAR(deviation(time, position, reference)->rms, 1e-3 / std::numbers::sqrt2, 2e-5);
}

TEST(Deviation, ADelayDeviatesFromTheReferenceButNotFromTheCurve) {
  const Sampled movement = sampled(
      kAround, [](double t) { return circle(t - 0.2 * std::sin(t / 2)); }, no_force);
  const Polyline curve = around();
  const auto feet = align_with_path(curve, movement.position).arc;
  EXPECT_GT(deviation(movement.time, movement.position, references(movement, circle))->rms, 5e-3);
  EXPECT_LT(contour_deviation(movement.time, movement.position, curve, feet)->peak, 1e-8);
}

TEST(Deviation, LeavesOutMissingSamples) {
  Sampled movement = sampled(kAround, wavering, no_force);
  const Polyline curve = around();
  auto reference = references(movement, circle);
  for (std::size_t i = 1000; i < 2000; ++i) movement.position[i] = nan3();
  for (std::size_t i = 4000; i < 4010; ++i) reference[i].x() = kNaN;
  const auto error = deviation(movement.time, movement.position, reference);
  // The integral of sin^2 5t over all but the second second; the missing 10 ms are negligible.
  const double left = std::numbers::pi - 0.5 + (std::sin(20) - std::sin(10)) / 20;
  EXPECT_NEAR(error->rms, 5e-3 * std::sqrt(left / (kAround - 1)), 5e-6);
  EXPECT_NEAR(error->peak, 5e-3, 1e-6);
  const auto feet = align_with_path(curve, movement.position).arc;
  EXPECT_NEAR(contour_deviation(movement.time, movement.position, curve, feet)->rms, error->rms, 3e-5);
}

TEST(Deviation, IsUndefinedWithoutSamplesAndTheDistanceOfOneSample) {
  const std::vector<double> time{7};
  const std::vector<Vec3> here{Vec3(0, 3e-3, 0)}, there{Vec3(4e-3, 0, 0)}, nowhere{nan3()};
  EXPECT_NEAR(deviation(time, here, there)->rms, 5e-3, 1e-15);
  EXPECT_NEAR(deviation(time, here, there)->peak, 5e-3, 1e-15);
  EXPECT_FALSE(deviation(time, here, nowhere));
  EXPECT_FALSE(deviation({}, {}, {}));
}

TEST(Deviation, NamesTheInvalidColumn) {
  const std::vector<double> time{0, 1, 1};
  const std::vector<Vec3> three(3, Vec3::Zero()), two(2, Vec3::Zero());
  EXPECT_THAT(error_of([&] { return deviation(time, two, three); }), testing::HasSubstr("2 positions"));
  EXPECT_THAT(error_of([&] { return deviation(time, three, two); }), testing::HasSubstr("2 references"));
  EXPECT_THAT(error_of([&] { return deviation(time, three, three); }), testing::HasSubstr("sample 3"));
  EXPECT_THAT(error_of([&] { return contour_deviation(time, three, Polyline(three), {}); }),
              testing::HasSubstr("0 arc lengths"));
}

/// Returns a force whose y component depends on the arc length and whose x component is constant [N].
Vec3 force_at(double arc) {
  return {0.5, 2 * std::sin(20 * arc), 0};
}

struct Pressed {
  std::vector<double> arc;
  std::vector<Vec3> force;
};

Pressed pressed(const std::function<double(double)>& arc, double rate_hz, const Vec3& more = Vec3::Zero()) {
  Pressed result;
  for (int i = 0; i <= static_cast<int>(2 * rate_hz); ++i) {
    result.arc.push_back(arc(i / rate_hz));
    result.force.push_back(force_at(result.arc.back()) + more);
  }
  return result;
}

constexpr double kLength = 0.3;

double steady(double t) {
  return kLength * t / 2;
}
double hesitant(double t) {
  return kLength * (t / 2 + std::sin(2 * std::numbers::pi * t) / 8);  // goes back at times
}

std::vector<Vec3> by_arc_length(const Pressed& trial) {
  return force_by_arc_length(trial.arc, trial.force, kLength);
}

TEST(ForceByArcLength, DoesNotDependOnTheSpeedAndRate) {
  for (const double rate : {100.0, 1000.0, 4000.0})
    for (const auto& trial : {pressed(steady, rate), pressed(hesitant, rate)}) {
      const auto cells = by_arc_length(trial);
      ASSERT_EQ(cells.size(), 300U);
      for (std::size_t i = 0; i < cells.size(); ++i)
        EXPECT_LT((cells[i] - force_at((static_cast<double>(i) + 0.5) * 1e-3)).norm(), 0.02) << rate << " " << i;
    }
}

TEST(ForceByArcLength, IsTheSameOnTheWayBack) {
  const auto back = by_arc_length(pressed([](double t) { return kLength - steady(t); }, 1000));
  const auto difference = force_deviation(back, by_arc_length(pressed(steady, 1000)));
  ASSERT_TRUE(difference);
  EXPECT_LT(difference->error.peak, 1e-9);
  EXPECT_EQ(difference->compared, 1);
}

TEST(ForceByArcLength, WeighsByTheLengthCovered) {
  const std::vector<double> arc{0, 0.75e-3, 0.75e-3, 1e-3};
  const std::vector<Vec3> force{Vec3::Zero(), Vec3::Zero(), Vec3(4, 0, 0), Vec3(4, 0, 0)};
  EXPECT_NEAR(force_by_arc_length(arc, force, 1e-3).front().x(), 1, 1e-12);
}

TEST(ForceByArcLength, StandingStillHasNoWeight) {
  Pressed trial = pressed(steady, 1000);
  trial.arc.insert(trial.arc.begin() + 1000, 5000, trial.arc[1000]);
  trial.force.insert(trial.force.begin() + 1001, 5000, Vec3(99, 0, 0));
  trial.force[1001] = trial.force[1000];
  trial.force[6000] = trial.force[1000];
  EXPECT_LT(force_deviation(by_arc_length(trial), by_arc_length(pressed(steady, 1000)))->error.peak, 1e-9);
}

TEST(ForceDeviation, IsTheDifferenceOfForcesAtTheSamePoint) {
  const auto expert = by_arc_length(pressed(steady, 1000));
  const auto same = force_deviation(by_arc_length(pressed(hesitant, 800)), expert);
  EXPECT_LT(same->error.peak, 0.02);
  EXPECT_EQ(same->compared, 1);
  const auto more = force_deviation(by_arc_length(pressed(steady, 1000, {0.3, 0, 0.4})), expert);
  EXPECT_NEAR(more->error.rms, 0.5, 1e-9);
  EXPECT_NEAR(more->error.peak, 0.5, 1e-9);
}

TEST(ForceDeviation, ComparesOnlyPointsThatBothReached) {
  Pressed half = pressed([](double t) { return steady(t) / 2; }, 1000, {0, 0, 1});
  half.force[7].x() = kNaN;
  half.arc[900] = kNaN;
  const auto expert = by_arc_length(pressed(steady, 1000));
  const auto error = force_deviation(by_arc_length(half), expert);
  EXPECT_NEAR(error->error.rms, 1, 1e-3);
  EXPECT_NEAR(error->compared, 0.5, 0.011);
  EXPECT_FALSE(force_deviation(std::vector<Vec3>(300, nan3()), expert));
  EXPECT_THAT(error_of([&] { return force_deviation(std::vector<Vec3>(299, nan3()), expert); }),
              testing::HasSubstr("299 and 300"));
}

TEST(ForceByArcLength, AcceptsAnyCurve) {
  const std::vector<double> arc{0, 0, 5, -5, 0.2};
  const std::vector<Vec3> force(5, Vec3(1, 0, 0));
  EXPECT_TRUE(std::isnan(force_by_arc_length(arc, force, 0).front().x()));
  EXPECT_EQ(force_by_arc_length(arc, force, 0.2505).size(), 251U);
  EXPECT_EQ(force_by_arc_length(arc, force, 0.2505).back(), Vec3(1, 0, 0));
  for (const double bad : {0.0, kNaN, 1e-12})
    EXPECT_THAT(error_of([&] { return force_by_arc_length(arc, force, 0.2, bad); }),
                testing::HasSubstr("divided into cells"));
}

}  // namespace
}  // namespace haptrace
