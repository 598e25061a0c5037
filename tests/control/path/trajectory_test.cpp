#include "control/path/trajectory.h"

#include "base/error.h"
#include "control/path/min_jerk.h"
#include "tests/support/allocations.h"

#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

namespace haptrace {
namespace {

using testing::HasSubstr;

/// A movement whose position, velocity and acceleration are known at every time.
struct Motion {
  std::function<Vec3(double)> position, velocity, acceleration;
};

const Motion kEllipse{[](double t) { return Vec3(0.1 * std::cos(t), 0.05 * std::sin(t), 0.02 * std::sin(2 * t)); },
                      [](double t) { return Vec3(-0.1 * std::sin(t), 0.05 * std::cos(t), 0.04 * std::cos(2 * t)); },
                      [](double t) { return Vec3(-0.1 * std::cos(t), -0.05 * std::sin(t), -0.08 * std::sin(2 * t)); }};

/// A movement from rest to rest, as the spline without velocities assumes.
const Motion kReach{[](double t) -> Vec3 { return Vec3(0.1, 0.2, -0.05) * MinJerk::at(t).s; },
                    [](double t) -> Vec3 { return Vec3(0.1, 0.2, -0.05) * MinJerk::at(t).ds; },
                    [](double t) -> Vec3 { return Vec3(0.1, 0.2, -0.05) * MinJerk::at(t).dds; }};

/// Returns the movement x(t) = sum of c_k t^k, with a different polynomial in every axis.
Motion polynomial(int degree) {
  const auto derivative = [degree](double t, int order) {
    Vec3 sum = Vec3::Zero();
    for (int k = order; k <= degree; ++k) {
      double factor = std::pow(t, k - order);
      for (int j = 0; j < order; ++j) factor *= k - j;
      sum += factor * Vec3(0.01 * (k + 1), -0.02 / (k + 1), 0.01 * (k % 2 ? 1 : -1));
    }
    return sum;
  };
  return {[=](double t) { return derivative(t, 0); }, [=](double t) { return derivative(t, 1); },
          [=](double t) { return derivative(t, 2); }};
}

Path sampled(const Motion& motion, const std::vector<double>& time, bool with_velocity) {
  Path path;
  path.name = "test path";
  path.time = time;
  for (const double t : time) {
    path.position.push_back(motion.position(t));
    if (with_velocity) path.velocity.push_back(motion.velocity(t));
  }
  return path;
}

std::vector<double> even_steps(double end, int steps) {
  std::vector<double> time;
  for (int i = 0; i <= steps; ++i) time.push_back(end * i / steps);
  return time;
}

/// Returns stamps whose steps differ by up to 1 : 3.
std::vector<double> uneven_steps(double end, int steps) {
  std::vector<double> time = even_steps(end, steps);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> jitter(-0.25, 0.25);
  for (int i = 1; i < steps; ++i) time[static_cast<std::size_t>(i)] += jitter(random) * end / steps;
  return time;
}

Path with_noisy_velocity(Path path, double noise) {
  std::mt19937 random(2);
  std::normal_distribution<double> error(0, noise);
  for (Vec3& v : path.velocity) v += Vec3(error(random), error(random), error(random));
  return path;
}

Path moved(Path path, double scale, const Vec3& offset, double time_offset) {
  for (Vec3& p : path.position) p = scale * p + offset;
  for (Vec3& v : path.velocity) v *= scale;
  for (double& t : path.time) t += time_offset;
  return path;
}

/// Returns a path with neighbouring steps of 1 us to 10 s and positions that jump by 1 nm to 10 m.
Path wild() {
  Path path;
  path.name = "wild";
  std::mt19937 random(3);
  std::uniform_real_distribution<double> step(-6, 1), jump(-9, 1), sign(-1, 1);
  double t = 0;
  for (int i = 0; i < 200; ++i) {
    path.time.push_back(t);
    path.position.emplace_back(std::copysign(std::pow(10, jump(random)), sign(random)),
                               std::copysign(std::pow(10, jump(random)), sign(random)), 1e-9 * i);
    t += std::pow(10, step(random));
  }
  return path;
}

/// Returns a movement of 2 s at 1 kHz, with a gap of an hour in its middle.
Path paused() {
  Path path = sampled(kEllipse, even_steps(2, 2000), true);
  for (std::size_t i = 1000; i < path.size(); ++i) path.time[i] += 3600;
  return path;
}

struct NamedPath {
  std::string name;
  Path path;
};

std::vector<NamedPath> make_paths() {
  const Path even = sampled(kEllipse, even_steps(6, 300), false);
  Path constant = sampled(kEllipse, even_steps(1, 10), false);
  std::fill(constant.position.begin(), constant.position.end(), Vec3(0.1, 0.2, 0.3));
  Path drifting = constant;
  drifting.velocity.assign(drifting.size(), Vec3(1e-3, 0, 0));
  Path absurd = sampled(kEllipse, even_steps(6, 50), true);
  for (Vec3& v : absurd.velocity) v *= 1e300;
  return {{"OneSample", sampled(kEllipse, {7}, true)},
          {"TwoSamples", sampled(kEllipse, {0, 1}, false)},
          {"TwoSamplesWithVelocity", sampled(kEllipse, {0, 1}, true)},
          {"ThreeSamples", sampled(kEllipse, {0, 1e-6, 10}, true)},
          {"Even", even},
          {"EvenWithVelocity", sampled(kEllipse, even_steps(6, 300), true)},
          {"Uneven", sampled(kEllipse, uneven_steps(6, 200), false)},
          {"UnevenWithVelocity", sampled(kEllipse, uneven_steps(6, 200), true)},
          {"NoisyVelocity", with_noisy_velocity(sampled(kEllipse, even_steps(6, 3000), true), 0.01)},
          {"Wild", wild()},
          {"Paused", paused()},
          {"Tiny", moved(even, 1e-8, Vec3::Zero(), 0)},
          {"Large", moved(even, 50, Vec3::Constant(10), 0)},
          {"EpochStamps", moved(even, 1, Vec3::Zero(), 1.7e9)},
          {"NegativeStamps", moved(even, 1, Vec3::Zero(), -3)},
          {"Constant", constant},
          {"ConstantButForItsVelocity", drifting},
          {"AbsurdVelocity", absurd}};
}

/// Returns the paths. Every test runs in its own process and needs their names, so each process makes them once.
const std::vector<NamedPath>& paths() {
  static const std::vector<NamedPath> all = make_paths();
  return all;
}

/// Rounding errors of one segment [m, m/s, m/s^2], used as tolerances. Smaller movements cannot be distinguished from
/// the rounding of positions and stamps.
struct Rounding {
  double position, velocity, acceleration;
};

class TrajectoryLaws : public testing::TestWithParam<std::tuple<Interpolation, std::size_t>> {
 protected:
  [[nodiscard]] Interpolation interpolation() const { return std::get<0>(GetParam()); }
  [[nodiscard]] double time(std::size_t i) const { return path_.time[i] - path_.time[0]; }
  [[nodiscard]] double step(std::size_t i) const { return time(i + 1) - time(i); }

  /// Returns the largest errors within segment i from rounding alone: 1e-9 of the largest values on the segment, plus
  /// the effect of the last bits of positions and stamps over its length.
  [[nodiscard]] Rounding rounding(std::size_t i) const {
    const double h = step(i), eps = 4 * std::numeric_limits<double>::epsilon();
    double position = 0, velocity = 0, acceleration = 0;
    for (const double u : {0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 0.999999}) {
      const Reference r = trajectory_.sample(time(i) + u * h);
      position = std::max(position, r.position.norm());
      velocity = std::max(velocity, r.velocity.norm());
      acceleration = std::max(acceleration, r.acceleration.norm());
    }
    const double stamp = eps * time(i + 1) / h + 1e-9;  // rounding of a stamp as a fraction of the segment
    Rounding tolerance{};
    tolerance.position = eps * position + stamp * h * velocity;
    tolerance.velocity = eps * position / h + stamp * (velocity + h * acceleration);
    tolerance.acceleration = tolerance.velocity / h + stamp * acceleration;
    return tolerance;
  }

  Path path_ = paths().at(std::get<1>(GetParam())).path;
  Trajectory trajectory_{path_, interpolation()};
};

TEST_P(TrajectoryLaws, HitsEverySampleAtItsStamp) {
  for (std::size_t i = 0; i < path_.size(); ++i)
    EXPECT_EQ(trajectory_.sample(time(i)).position, path_.position[i]) << i;
}

TEST_P(TrajectoryLaws, RestsAtItsEndsOutsideItsDuration) {
  const double end = trajectory_.duration();
  EXPECT_EQ(end, path_.duration());
  for (const double before : {-1e-12, -1.0, -1e300, -std::numeric_limits<double>::infinity(), kNaN}) {
    const Reference r = trajectory_.sample(before);
    EXPECT_EQ(r.position, path_.position.front());
    EXPECT_EQ(r.velocity, Vec3::Zero());
    EXPECT_EQ(r.acceleration, Vec3::Zero());
  }
  for (const double after : {std::nextafter(end, 1e300), end + 1, 1e300, std::numeric_limits<double>::infinity()}) {
    const Reference r = trajectory_.sample(after);
    EXPECT_EQ(r.position, path_.position.back());
    EXPECT_EQ(r.velocity, Vec3::Zero());
    EXPECT_EQ(r.acceleration, Vec3::Zero());
  }
}

TEST_P(TrajectoryLaws, IsFiniteEverywhere) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> anywhere(-0.1, 1.1);
  for (int i = 0; i < 2000; ++i) {
    const double t = anywhere(random) * trajectory_.duration();
    const Reference r = trajectory_.sample(t);
    ASSERT_TRUE(is_finite(r.position) && is_finite(r.velocity) && is_finite(r.acceleration)) << t;
  }
}

TEST_P(TrajectoryLaws, ReportsTheDerivativesOfItsOwnPosition) {
  for (std::size_t i = 0; i + 1 < path_.size(); ++i) {
    const double h = step(i) / 8, middle = time(i) + 4 * h;
    const Rounding tolerance = rounding(i);
    // The central difference over seven points, exact for polynomials of degree six.
    Vec3 velocity = Vec3::Zero(), acceleration = Vec3::Zero();
    for (const auto& [k, weight] : {std::pair{1, 3.0 / 4}, {2, -3.0 / 20}, {3, 1.0 / 60}}) {
      const Reference after = trajectory_.sample(middle + k * h), before = trajectory_.sample(middle - k * h);
      velocity += weight * (after.position - before.position) / h;
      acceleration += weight * (after.velocity - before.velocity) / h;
    }
    const Reference r = trajectory_.sample(middle);
    ASSERT_LE((r.velocity - velocity).norm(), 30 * tolerance.velocity) << "segment " << i;
    ASSERT_LE((r.acceleration - acceleration).norm(), 30 * tolerance.acceleration) << "segment " << i;
  }
}

/// Laws of the interpolations that do not jump between samples.
class ContinuousTrajectoryLaws : public TrajectoryLaws {};

TEST_P(ContinuousTrajectoryLaws, IsAsSmoothAcrossItsSamplesAsItsDegreeSays) {
  for (std::size_t i = 1; i + 1 < path_.size(); ++i) {
    const Rounding before = rounding(i - 1), after = rounding(i);
    const Reference left = trajectory_.sample(std::nextafter(time(i), 0)), right = trajectory_.sample(time(i));
    ASSERT_LE((left.position - right.position).norm(), 4 * std::max(before.position, after.position)) << "sample " << i;
    if (interpolation() == Interpolation::linear) continue;
    ASSERT_LE((left.velocity - right.velocity).norm(), 4 * std::max(before.velocity, after.velocity)) << "sample " << i;
    if (interpolation() == Interpolation::cubic) continue;
    ASSERT_LE((left.acceleration - right.acceleration).norm(), 4 * std::max(before.acceleration, after.acceleration))
        << "sample " << i;
  }
}

TEST_P(TrajectoryLaws, StaysNearTheStraightLinesBetweenItsSamples) {
  const double extent = path_.bounds().size().norm();
  const double reach = interpolation() == Interpolation::cubic     ? 3.0 / 4
                       : interpolation() == Interpolation::quintic ? 9.0 / 8
                                                                   : 0;
  for (std::size_t i = 0; i + 1 < path_.size(); ++i) {
    const Vec3 from = path_.position[i], line = path_.position[i + 1] - from;
    for (double u = 0; u < 1; u += 1.0 / 16) {
      const Vec3 p = trajectory_.sample(time(i) + u * step(i)).position - from;
      const double along = line.squaredNorm() > 0 ? std::clamp(p.dot(line) / line.squaredNorm(), 0.0, 1.0) : 0;
      ASSERT_LE((p - along * line).norm(), reach * extent + 1e-14) << "segment " << i;
    }
  }
}

TEST_P(TrajectoryLaws, AnswersTheSameWithAnyCursorInAnyOrder) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> anywhere(-0.1, 1.1);
  std::uniform_int_distribution<std::size_t> any_segment(0, 2 * path_.size());
  Trajectory::Cursor cursor;
  for (int i = 0; i < 2000; ++i) {
    const double t = anywhere(random) * trajectory_.duration();
    if (i % 10 == 0) cursor.segment = any_segment(random);
    const Reference with = trajectory_.sample(t, cursor), without = trajectory_.sample(t);
    ASSERT_EQ(with.position, without.position);
    ASSERT_EQ(with.velocity, without.velocity);
    ASSERT_EQ(with.acceleration, without.acceleration);
  }
}

TEST_P(TrajectoryLaws, AllocatesNothingInAQuery) {
  const std::size_t before = test::allocations();
  Trajectory::Cursor cursor;
  Vec3 sum = Vec3::Zero();
  for (int i = -10; i < 1010; ++i) sum += trajectory_.sample(1e-3 * i * trajectory_.duration(), cursor).position;
  EXPECT_EQ(test::allocations(), before);
  EXPECT_TRUE(is_finite(sum));
}

std::string name_of_trajectory(const testing::TestParamInfo<std::tuple<Interpolation, std::size_t>>& tested) {
  return to_string(std::get<0>(tested.param)) + paths()[std::get<1>(tested.param)].name;
}

INSTANTIATE_TEST_SUITE_P(All, TrajectoryLaws,
                         testing::Combine(testing::Values(Interpolation::hold, Interpolation::linear,
                                                          Interpolation::cubic, Interpolation::quintic),
                                          testing::Range<std::size_t>(0, paths().size())),
                         name_of_trajectory);
INSTANTIATE_TEST_SUITE_P(All, ContinuousTrajectoryLaws,
                         testing::Combine(testing::Values(Interpolation::linear, Interpolation::cubic,
                                                          Interpolation::quintic),
                                          testing::Range<std::size_t>(0, paths().size())),
                         name_of_trajectory);

/// Largest errors over a movement, except within `margin` seconds of its ends [m, m/s, m/s^2].
struct Errors {
  double position = 0, velocity = 0, acceleration = 0;
};

Errors errors(const Motion& motion, const Trajectory& trajectory, double margin) {
  Errors worst;
  for (int i = 0; i <= 5000; ++i) {
    const double t = margin + (trajectory.duration() - 2 * margin) * i / 5000;
    const Reference r = trajectory.sample(t);
    worst.position = std::max(worst.position, (r.position - motion.position(t)).norm());
    worst.velocity = std::max(worst.velocity, (r.velocity - motion.velocity(t)).norm());
    worst.acceleration = std::max(worst.acceleration, (r.acceleration - motion.acceleration(t)).norm());
  }
  return worst;
}

/// Expects that halving the step divides the error by 2^order.
void expect_order(double coarse, double fine, double order) {
  EXPECT_NEAR(std::log2(coarse / fine), order, 0.35);
}

TEST(Trajectory, OfStraightLinesConvergesWithTheSquareOfTheStep) {
  const Errors coarse = errors(kEllipse, {sampled(kEllipse, even_steps(6, 60), false), Interpolation::linear}, 0);
  const Errors fine = errors(kEllipse, {sampled(kEllipse, even_steps(6, 120), false), Interpolation::linear}, 0);
  expect_order(coarse.position, fine.position, 2);
  expect_order(coarse.velocity, fine.velocity, 1);
}

TEST(Trajectory, OfCubicsConvergesWithTheFourthPowerOfTheStep) {
  const Errors coarse = errors(kEllipse, {sampled(kEllipse, even_steps(6, 60), true), Interpolation::cubic}, 0);
  const Errors fine = errors(kEllipse, {sampled(kEllipse, even_steps(6, 120), true), Interpolation::cubic}, 0);
  expect_order(coarse.position, fine.position, 4);
  expect_order(coarse.velocity, fine.velocity, 3);
  expect_order(coarse.acceleration, fine.acceleration, 2);
}

TEST(Trajectory, OfCubicsWithoutVelocitiesConvergesWithTheFourthPowerOfTheStep) {
  const Errors coarse = errors(kReach, {sampled(kReach, even_steps(1, 40), false), Interpolation::cubic}, 0);
  const Errors fine = errors(kReach, {sampled(kReach, even_steps(1, 80), false), Interpolation::cubic}, 0);
  expect_order(coarse.position, fine.position, 4);
  expect_order(coarse.velocity, fine.velocity, 3);
  expect_order(coarse.acceleration, fine.acceleration, 2);
}

TEST(Trajectory, OfQuinticsConvergesWithTheSixthPowerOfTheStepAwayFromItsEnds) {
  const Errors coarse = errors(kEllipse, {sampled(kEllipse, even_steps(6, 30), true), Interpolation::quintic}, 2);
  const Errors fine = errors(kEllipse, {sampled(kEllipse, even_steps(6, 60), true), Interpolation::quintic}, 2);
  expect_order(coarse.position, fine.position, 6);
  expect_order(coarse.velocity, fine.velocity, 5);
  expect_order(coarse.acceleration, fine.acceleration, 4);
}

TEST(Trajectory, OfQuinticsConvergesWithTheFourthPowerOfTheStepAtItsEnds) {
  const Errors coarse = errors(kEllipse, {sampled(kEllipse, even_steps(6, 60), true), Interpolation::quintic}, 0);
  const Errors fine = errors(kEllipse, {sampled(kEllipse, even_steps(6, 120), true), Interpolation::quintic}, 0);
  expect_order(coarse.position, fine.position, 4);
  expect_order(coarse.velocity, fine.velocity, 3);
}

TEST(Trajectory, ReproducesPolynomialsUpToItsDegreeOverUnevenSteps) {
  const auto expect_exact = [](int degree, Interpolation interpolation) {
    const Motion motion = polynomial(degree);
    const Errors e = errors(motion, {sampled(motion, uneven_steps(2, 20), true), interpolation}, 0);
    EXPECT_LE(e.position, 1e-14);
    EXPECT_LE(e.velocity, 1e-12);
    EXPECT_LE(e.acceleration, 1e-10);
  };
  expect_exact(0, Interpolation::hold);
  expect_exact(1, Interpolation::linear);
  expect_exact(3, Interpolation::cubic);
  expect_exact(3, Interpolation::quintic);
}

TEST(Trajectory, HonoursVelocitiesOfSparseSamples) {
  // With six samples per turn, the velocities add information that the positions alone lack.
  const Trajectory with(sampled(kEllipse, even_steps(6, 6), true), Interpolation::cubic);
  const Trajectory without(sampled(kEllipse, even_steps(6, 6), false), Interpolation::cubic);
  EXPECT_LE(errors(kEllipse, with, 0).position, 4e-3);
  EXPECT_GE(errors(kEllipse, without, 0).position, 8e-3);
}

/// A velocity column that contradicts its positions.
struct Contradiction {
  std::string name;
  std::function<Path(Path)> make;
};

class ContradictingVelocities : public testing::TestWithParam<Contradiction> {};

TEST_P(ContradictingVelocities, AreIgnored) {
  const Path path = GetParam().make(sampled(kReach, even_steps(1, 1000), true));
  Path without = path;
  without.velocity.clear();
  for (const Interpolation interpolation : {Interpolation::cubic, Interpolation::quintic}) {
    const Trajectory given(path, interpolation), spline(without, interpolation);
    for (double t = 0; t < 1; t += 1.7e-4) {
      ASSERT_EQ(given.sample(t).position, spline.sample(t).position);
      ASSERT_EQ(given.sample(t).velocity, spline.sample(t).velocity);
      ASSERT_EQ(given.sample(t).acceleration, spline.sample(t).acceleration);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, ContradictingVelocities,
                         testing::Values(Contradiction{"NoiseOfOnePercent",
                                                       [](Path p) { return with_noisy_velocity(p, 0.004); }},
                                         Contradiction{"Zeros",
                                                       [](Path p) {
                                                         p.velocity.assign(p.size(), Vec3::Zero());
                                                         return p;
                                                       }},
                                         Contradiction{"Millimetres",
                                                       [](Path p) {
                                                         for (Vec3& v : p.velocity) v *= 1000;
                                                         return p;
                                                       }},
                                         Contradiction{"AnotherFrame",
                                                       [](Path p) {
                                                         for (Vec3& v : p.velocity) v = Vec3(v.y(), -v.x(), v.z());
                                                         return p;
                                                       }},
                                         Contradiction{"TwoSamplesLate",
                                                       [](Path p) {
                                                         std::copy_backward(p.velocity.begin(), p.velocity.end() - 2,
                                                                            p.velocity.end());
                                                         return p;
                                                       }},
                                         Contradiction{"OneGlitch",
                                                       [](Path p) {
                                                         p.velocity[500] *= -1;
                                                         return p;
                                                       }}),
                         [](const auto& tested) { return tested.param.name; });

TEST(Trajectory, KeepsTheVelocityOfAStraightLineWhateverItsRounding) {
  for (const double speed : {1e-6, 0.1, 1.0 / 3, 7.0}) {
    const Motion line{[=](double t) { return Vec3(0.5 + speed * t, 0.1, -speed * t); },
                      [=](double) { return Vec3(speed, 0, -speed); }, [](double) { return Vec3::Zero(); }};
    for (const int steps : {1, 2, 3, 1000}) {
      const Trajectory trajectory(sampled(line, uneven_steps(1, steps), true), Interpolation::cubic);
      EXPECT_LE(errors(line, trajectory, 0).velocity, 1e-12 * steps * steps) << speed << " m/s, " << steps << " steps";
    }
  }
}

TEST(Trajectory, CrossesALongPauseWithoutLeavingThePath) {
  const Path path = paused();
  const double extent = path.bounds().size().norm();
  for (const Interpolation interpolation : {Interpolation::cubic, Interpolation::quintic}) {
    const Trajectory trajectory(path, interpolation);
    for (double t = 0; t < trajectory.duration(); t += 1)
      ASSERT_LE((trajectory.sample(t).position - path.position[1000]).norm(), 1.2 * extent) << t;
  }
}

TEST(Trajectory, RestsAtBothEndsWithoutVelocities) {
  for (const Interpolation interpolation : {Interpolation::cubic, Interpolation::quintic}) {
    const Trajectory trajectory(sampled(kEllipse, even_steps(6, 100), false), interpolation);
    EXPECT_EQ(trajectory.sample(0).velocity, Vec3::Zero());
    EXPECT_EQ(trajectory.sample(6).velocity, Vec3::Zero());
  }
  const Trajectory quintic(sampled(kEllipse, {0, 1}, false), Interpolation::quintic);
  EXPECT_LE(quintic.sample(0).acceleration.norm() + quintic.sample(1).acceleration.norm(), 1e-15);
  // Two samples alone give the minimum-jerk movement.
  const Vec3 from = kEllipse.position(0), to = kEllipse.position(1);
  EXPECT_LE((quintic.sample(0.3).position - from - MinJerk::at(0.3).s * (to - from)).norm(), 1e-16);
}

TEST(Trajectory, WithoutAPathReportsThatThereIsNone) {
  const Trajectory none;
  EXPECT_EQ(none.duration(), 0);
  EXPECT_EQ(none.size(), 0u);
  EXPECT_TRUE(none.sample(0).position.hasNaN());
}

TEST(Trajectory, HoldsTheLastSampleBeforeTheInstant) {
  const Path path = sampled(kEllipse, {0, 1, 4}, true);
  const Trajectory trajectory(path, Interpolation::hold);
  EXPECT_EQ(trajectory.sample(0.999).position, path.position[0]);
  EXPECT_EQ(trajectory.sample(3.999).position, path.position[1]);
  EXPECT_EQ(trajectory.sample(1.5).velocity, Vec3::Zero());
}

TEST(Trajectory, OfAMillionSamplesAnswersLikeAShortOne) {
  const int n = 1'000'000;
  const Trajectory trajectory(sampled(kEllipse, even_steps(1000, n), true), Interpolation::quintic);
  EXPECT_EQ(trajectory.size(), static_cast<std::size_t>(n) + 1);
  EXPECT_LE(errors(kEllipse, trajectory, 0.01).position, 1e-12);
}

std::string message_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), Error::Kind::input);
    return error.what();
  }
  return "nothing was thrown";
}

TEST(Trajectory, RefusesStampsThatCanOnlyBeAUnitMistake) {
  const auto build = [](std::vector<double> time) {
    return message_of([&] { Trajectory(sampled(kEllipse, time, false), Interpolation::cubic); });
  };
  EXPECT_THAT(build({0, 1, 1 + 1e-12}), HasSubstr("test path: sample 3: time is 1.00"));
  EXPECT_THAT(build({0, 1, 1 + 1e-12}), HasSubstr("at least 1 ns"));
  EXPECT_THAT(build({-1e20, 1, 2}), HasSubstr("sample 3"));
  EXPECT_THAT(build({0, 3.6e12}), HasSubstr("test path: the path lasts 3.6e+12 s"));
  EXPECT_THAT(build({0, 0}), HasSubstr("sample 2"));
  EXPECT_THAT(build({}), HasSubstr("no samples"));
}

TEST(Trajectory, NamesItsInterpolations) {
  for (const Interpolation i :
       {Interpolation::hold, Interpolation::linear, Interpolation::cubic, Interpolation::quintic})
    EXPECT_EQ(parse_interpolation(to_string(i)), i);
  EXPECT_EQ(message_of([] { (void)parse_interpolation("cubik"); }),
            "unknown interpolation 'cubik'; did you mean 'cubic'?");
}

}  // namespace
}  // namespace haptrace
