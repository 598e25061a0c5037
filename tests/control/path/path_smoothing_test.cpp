#include "control/path/path_smoothing.h"

#include "control/path/shapes.h"
#include "control/path/trajectory.h"

#include <cmath>
#include <functional>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

constexpr double kCount = 5e-5;  // encoder resolution [m]

/// Returns a hand's position at `t`: a movement of a few hertz, over 10 cm, at up to 0.5 m/s.
Vec3 hand(double t) {
  return {0.05 * std::sin(2 * t) + 0.004 * std::sin(14 * t), 0.04 * std::cos(3 * t), 0.03 * std::sin(0.7 * t)};
}

Vec3 hand_acceleration(double t) {
  return {-0.2 * std::sin(2 * t) - 0.784 * std::sin(14 * t), -0.36 * std::cos(3 * t), -0.0147 * std::sin(0.7 * t)};
}

struct Sampling {
  double duration = 5, step = 1e-3, jitter = 0;
};

Path sampled(const std::function<Vec3(double)>& motion, const Sampling& sampling = {}) {
  Path path{.name = "test path"};
  std::mt19937 random(1);
  std::uniform_real_distribution<double> jitter(1 - sampling.jitter, 1 + sampling.jitter);
  for (double t = 0; t < sampling.duration; t += sampling.step * jitter(random)) {
    path.time.push_back(t);
    path.position.push_back(motion(t));
  }
  return path;
}

Path counted(Path path, double count) {
  for (Vec3& p : path.position) p = count * (p / count).array().round().matrix();
  return path;
}

Path shaken(Path path, double deviation) {
  std::mt19937 random(2);
  std::normal_distribution<double> error(0, deviation);
  for (Vec3& p : path.position) p += Vec3(error(random), error(random), error(random));
  return path;
}

double smoothing_of(const Path& path) {
  return smoothing_time({&path, 1});
}

Vec3 noise_of(const Path& path) {
  return position_noise({&path, 1});
}

/// Returns the rms error of the curve's acceleration, away from the ends [m/s^2].
double acceleration_error(const Path& path, double smoothing) {
  const Trajectory curve(path, Interpolation::cubic,
                         {.begin = path.time.front(), .end = path.time.back(), .extent = 1, .smoothing = smoothing});
  double squares = 0;
  int count = 0;
  for (double t = 0.5; t < path.time.back() - 0.5; t += 7.3e-4, ++count)
    squares += (curve.sample(t).acceleration - hand_acceleration(t)).squaredNorm();
  return std::sqrt(squares / count);
}

double position_error(const Path& path, const std::vector<Vec3>& position) {
  double squares = 0;
  for (std::size_t i = 0; i < path.size(); ++i) squares += (position[i] - hand(path.time[i])).squaredNorm();
  return std::sqrt(squares / static_cast<double>(path.size()));
}

TEST(PathSmoothing, IsTheLowPassOfItsFormula) {
  const double tau = 0.01;
  for (const double omega : {20.0, 60.0, 100.0, 200.0, 400.0}) {
    const Path wave = sampled([&](double t) -> Vec3 { return Vec3(0.01, 0.02, 0) * std::sin(omega * t); });
    const std::vector<Vec3> smooth = smooth_positions(wave, tau);
    const double gain = 1 / (1 + std::pow(omega * tau, 4));
    for (std::size_t i = 1000; i < 4000; ++i)
      ASSERT_NEAR((smooth[i] - gain * wave.position[i]).norm(), 0, 2e-4 * wave.position[i].norm() + 2e-7) << omega;
  }
}

TEST(PathSmoothing, LeavesAStraightLineUnchangedAtAnySteps) {
  const Path line = sampled([](double t) { return Vec3(0.1 * t - 0.3, 0.02 * t, 1); }, {.jitter = 0.9});
  const std::vector<Vec3> smooth = smooth_positions(line, 0.02, {.begins_at_rest = false, .ends_at_rest = false});
  for (std::size_t i = 0; i < line.size(); ++i) ASSERT_LT((smooth[i] - line.position[i]).norm(), 1e-9);
}

TEST(PathSmoothing, BeginsAndEndsAtRestWhereThePathDoes) {
  const Path line = sampled([](double t) { return Vec3(0.1 * t, 0, 0); });
  const Trajectory curve(line, Interpolation::cubic,
                         {.begin = 0, .end = line.time.back(), .extent = 1, .smoothing = 0.01});
  EXPECT_LT(curve.sample(1e-3).velocity.x(), 0.02);
  EXPECT_LT(curve.sample(1e-3).acceleration.norm(), 20) << "from rest to 0.1 m/s within the time constant";
  EXPECT_NEAR(curve.sample(2).velocity.x(), 0.1, 1e-6);
  EXPECT_LT(curve.sample(line.time.back() - 1e-3).velocity.x(), 0.02);
}

TEST(PathSmoothing, OfAPieceEqualsThatOfTheWholeExceptNearItsEnds) {
  const Path whole = counted(sampled(hand, {.jitter = 0.6}), kCount);
  const double tau = 0.008;
  const std::vector<Vec3> all = smooth_positions(whole, tau);
  Path piece{.name = "piece"};
  piece.time.assign(whole.time.begin() + 1000, whole.time.begin() + 3000);
  piece.position.assign(whole.position.begin() + 1000, whole.position.begin() + 3000);
  const std::vector<Vec3> part = smooth_positions(piece, tau, {.begins_at_rest = false, .ends_at_rest = false});
  const double begin = piece.time.front() + smoothing_reach(tau), end = piece.time.back() - smoothing_reach(tau);
  int compared = 0;
  for (std::size_t i = 0; i < piece.size(); ++i) {
    if (piece.time[i] < begin || piece.time[i] > end) continue;
    ++compared;
    ASSERT_LT((part[i] - all[i + 1000]).norm(), 1e-12);
  }
  EXPECT_GT(compared, 1000);
}

TEST(PathSmoothing, DistinguishesNoiseFromMovement) {
  for (const double jitter : {0.0, 0.6})
    for (const double deviation : {1e-6, 1e-5, 1e-4}) {
      const Vec3 noise = noise_of(shaken(sampled(hand, {.jitter = jitter}), deviation));
      for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(noise[axis], deviation, 0.1 * deviation) << jitter;
    }
  for (const double step : {1e-4, 1e-3, 4e-3})
    for (const double count : {1e-5, 5e-5, 2e-4}) {
      const Vec3 noise = noise_of(counted(sampled(hand, {.step = step}), count));
      for (int axis = 0; axis < 3; ++axis)
        EXPECT_NEAR(noise[axis], count / std::sqrt(12), 0.35 * count) << step << ", " << count;
    }
}

TEST(PathSmoothing, LeavesPathsWithoutNoiseAlone) {
  EXPECT_EQ(smoothing_of(sampled(hand)), 0) << "exact";
  EXPECT_EQ(smoothing_of(sampled(hand, {.jitter = 0.9})), 0) << "exact at uneven times";
  EXPECT_EQ(smoothing_of(counted(sampled(hand), 1e-9)), 0) << "nine digits";
  EXPECT_EQ(smoothing_of(counted(sampled(hand, {.step = 0.02}), 1e-3)), 0) << "waypoints in millimetres";
  EXPECT_EQ(smoothing_of(sampled([](double) { return Vec3(0.1, 0.2, 0.3); })), 0) << "a rest";
  EXPECT_EQ(smoothing_of(sampled(hand, {.duration = 2.5e-3})), 0) << "three samples";
  for (const std::string& shape : shape_names()) EXPECT_EQ(smoothing_of(make_shape(shape, {})), 0) << shape;
  Path corners{.name = "corners"};  // lines without slowing down at the corners
  for (int i = 0; i < 4000; ++i) {
    const double s = 1e-4 * (i % 1000);
    corners.time.push_back(1e-3 * i);
    corners.position.push_back(i < 1000   ? Vec3(s, 0, 0)
                               : i < 2000 ? Vec3(0.1, s, 0)
                               : i < 3000 ? Vec3(0.1 - s, 0.1, 0)
                                          : Vec3(0, 0.1 - s, 0));
  }
  EXPECT_EQ(smoothing_of(corners), 0);
}

struct Kind {
  double count;   ///< Encoder resolution [m].
  double step;    ///< Sampling step [s].
  double jitter;  ///< Relative jitter of the step.
};

class NoisyPath : public testing::TestWithParam<Kind> {};

TEST_P(NoisyPath, IsNearerToTheMovementWhenSmoothedAndItsAccelerationMuchNearer) {
  const Kind& kind = GetParam();
  const Path path = counted(sampled(hand, {.step = kind.step, .jitter = kind.jitter}), kind.count);
  const double tau = smoothing_of(path);
  ASSERT_GT(tau, 0);
  // This movement is not at rest at its ends, so the ends are not held at rest.
  const PathEnds moving{.begins_at_rest = false, .ends_at_rest = false};
  EXPECT_LT(position_error(path, smooth_positions(path, tau, moving)), position_error(path, path.position));
  // The rms acceleration of the movement itself is 0.6 m/s^2.
  EXPECT_LT(acceleration_error(path, tau), 0.35);
  EXPECT_LT(acceleration_error(path, tau), 0.2 * acceleration_error(path, 0));
}

INSTANTIATE_TEST_SUITE_P(Counts, NoisyPath,
                         testing::Values(Kind{1e-5, 1e-3, 0}, Kind{5e-5, 1e-3, 0}, Kind{2e-4, 1e-3, 0},
                                         Kind{5e-5, 1e-3, 0.6}, Kind{5e-5, 2.5e-4, 0.3}, Kind{5e-5, 4e-3, 0}));

TEST(PathSmoothing, DoesNotTakeTheStepsOfASlowMovementForNoise) {
  // At 2 mm/s every count lasts 25 ms, so the differences between successive samples do not look like noise.
  const Path slow = counted(sampled([](double t) { return Vec3(2e-3 * t, 3e-3 * t, 0); }, {.duration = 10}), kCount);
  const double tau = smoothing_of(slow);
  const std::vector<Vec3> smooth = smooth_positions(slow, tau, {.begins_at_rest = false, .ends_at_rest = false});
  double fastest = 0;
  for (std::size_t i = 500; i + 500 < slow.size(); ++i)
    fastest = std::max(fastest, (smooth[i + 1].x() - smooth[i].x()) / 1e-3);
  EXPECT_LT(fastest, 6e-3) << "one step is 50 mm/s";
}

TEST(PathSmoothing, IsFiniteAtTheExtremes) {
  Path wild{.name = "wild"};
  std::mt19937 random(3);
  std::uniform_real_distribution<double> step(-9, 1), jump(-9, 1), sign(-1, 1);
  double t = 0;
  for (int i = 0; i < 400; ++i) {
    wild.time.push_back(t);
    wild.position.emplace_back(std::copysign(std::pow(10, jump(random)), sign(random)), sign(random), 1e-9 * i);
    t += std::pow(10, step(random));
  }
  const Path fast = counted(sampled(hand, {.duration = 0.5, .step = 5e-5}), 1e-3);
  const Path two = sampled(hand, {.duration = 1.5e-3});
  for (const Path* path : std::initializer_list<const Path*>{&wild, &fast, &two})
    for (const double tau : {0.0, 1e-6, 1e-3, 0.05, 1.0})
      for (const bool rest : {true, false})
        for (const Vec3& p : smooth_positions(*path, tau, {.begins_at_rest = rest, .ends_at_rest = rest}))
          ASSERT_TRUE(is_finite(p) && p.norm() < 50) << tau;
  EXPECT_LE(smoothing_of(fast), 0.05);
  EXPECT_EQ(smoothing_time({}), 0);
}

}  // namespace
}  // namespace haptrace
