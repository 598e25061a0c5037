#include "control/velocity_estimator.h"

#include "base/error.h"
#include "tests/support/allocations.h"

#include <deque>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

using std::numbers::pi;
using testing::AllOf;
using testing::HasSubstr;

constexpr double kResolution = 5e-5;  // encoder resolution [m]
constexpr double kInfinity = std::numeric_limits<double>::infinity();
const Vec3 kSlope(0.1, -0.23, 0.017);  // [m/s]

double quantised(double x) {
  return kResolution * std::round(x / kResolution);
}
Vec3 quantised(const Vec3& x) {
  return x.unaryExpr([](double v) { return quantised(v); });
}

/// Returns the positions of a wandering hand, quantised to encoder counts [m].
std::vector<Vec3> walk(int samples) {
  std::mt19937 random(1);
  std::normal_distribution<double> push(0, 3e-4);
  std::vector<Vec3> positions;
  Vec3 p(0.1, 0.2, 0.3), v = Vec3::Zero();
  for (int i = 0; i < samples; ++i) {
    v += Vec3(push(random), push(random), push(random)) - 0.01 * v;
    p += 1e-2 * v;
    positions.push_back(quantised(p));
  }
  return positions;
}

class VelocityEstimatorLaws : public testing::TestWithParam<std::tuple<std::string, double>> {
 protected:
  [[nodiscard]] std::unique_ptr<VelocityEstimator> make(double resolution = kResolution) const {
    return make_velocity_estimator(spec(), rate(), resolution);
  }
  [[nodiscard]] std::string spec() const { return std::get<0>(GetParam()); }
  [[nodiscard]] double rate() const { return std::get<1>(GetParam()); }
  [[nodiscard]] double dt() const { return 1 / rate(); }

  /// Returns a number of ticks after which every tested estimator has settled: a few times the longest memory.
  [[nodiscard]] int settled() const { return 400 + 2 * static_cast<int>(rate()); }
};

TEST_P(VelocityEstimatorLaws, IsZeroForAConstantPosition) {
  const auto estimator = make();
  for (int i = 0; i < 100; ++i) EXPECT_EQ(estimator->update({0.1, -0.2, 1e3}, dt()), Vec3::Zero());
}

TEST_P(VelocityEstimatorLaws, BecomesExactlyZeroAfterAMovement) {
  const auto estimator = make();
  for (const Vec3& p : walk(1000)) estimator->update(p, dt());
  const Vec3 end(0.3, 0.1, -0.7);
  Vec3 v = Vec3::Zero();
  for (int i = 0; i < 100 * settled(); ++i) {
    v = estimator->update(end, dt());
    for (const double axis : v) ASSERT_NE(std::fpclassify(axis), FP_SUBNORMAL);
    if (v.isZero(0)) break;
  }
  EXPECT_EQ(v, Vec3::Zero());
}

TEST_P(VelocityEstimatorLaws, IsTheSlopeOfARamp) {
  const auto estimator = make();
  Vec3 v = Vec3::Zero();
  for (int i = 0; i < settled(); ++i) v = estimator->update(i * dt() * kSlope, dt());
  EXPECT_LE((v - kSlope).norm(), 1e-9 * rate() / 1000 + 1e-12);
}

TEST_P(VelocityEstimatorLaws, IsTheSlopeOfARampAtAnySteps) {
  const auto estimator = make();
  std::mt19937 random(2);
  std::uniform_real_distribution<double> jitter(0.5, 1.5);
  double t = 0;
  for (int i = 0; i < 2 * settled(); ++i) {
    const double step = jitter(random) * dt();
    t += step;
    const Vec3 v = estimator->update(t * kSlope, step);
    if (i > settled()) {
      ASSERT_LE((v - kSlope).norm(), 1e-9 * rate() / 1000 + 1e-12);
    }
  }
}

TEST_P(VelocityEstimatorLaws, IsTheSlopeOfAQuantisedRampOnAverage) {
  const auto estimator = make();
  Vec3 sum = Vec3::Zero();
  const int n = 20000;
  for (int i = 0; i < settled() + n; ++i) {
    const Vec3 v = estimator->update(quantised(i * dt() * kSlope), dt());
    if (i >= settled()) sum += v;
  }
  EXPECT_LE((sum / n - kSlope).norm(), 0.02 * kSlope.norm());
}

TEST_P(VelocityEstimatorLaws, IsAsGoodHoursLaterAndMetresAway) {
  const auto estimator = make();
  const Vec3 far(40, -40, 40);
  Vec3 v = Vec3::Zero();
  for (int i = 0; i < settled(); ++i) v = estimator->update(far, dt());
  // One step of a day in each direction, then regular ticks.
  estimator->update(far + 86400 * kSlope, 86400);
  estimator->update(far, 86400);
  for (int i = 0; i < 2 * settled(); ++i) v = estimator->update(far + i * dt() * kSlope, dt());
  EXPECT_LE((v - kSlope).norm(), 1e-9 * rate() + 1e-12);
}

TEST_P(VelocityEstimatorLaws, StartsAtZeroWhateverTheFirstStep) {
  for (const double first : {0.0, dt(), -1.0, kNaN, 1e300}) {
    const auto estimator = make();
    EXPECT_EQ(estimator->update({1, 2, 3}, first), Vec3::Zero());
    EXPECT_EQ(estimator->update({1, 2, 3}, dt()), Vec3::Zero());
  }
}

TEST_P(VelocityEstimatorLaws, IgnoresInvalidMeasurements) {
  const auto disturbed = make(), undisturbed = make();
  const auto positions = walk(500);
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const Vec3 v = undisturbed->update(positions[i], dt());
    ASSERT_EQ(disturbed->update(positions[i], dt()), v);
    for (const double bad : {0.0, -dt(), -0.0, kNaN, kInfinity, -kInfinity, 1e-12, 1e300})
      ASSERT_EQ(disturbed->update({7, 8, 9}, bad), v);
    for (const double bad : {kNaN, kInfinity, -kInfinity, 1e300})
      for (int axis = 0; axis < 3; ++axis) {
        Vec3 p = positions[i];
        p[axis] = bad;
        ASSERT_EQ(disturbed->update(p, dt()), v);
      }
  }
}

TEST_P(VelocityEstimatorLaws, IsFiniteWhateverItIsFed) {
  const auto estimator = make();
  std::mt19937 random(3);
  std::uniform_real_distribution<double> exponent(-330, 300), step(-12, 8), sign(-1, 1);
  std::uniform_int_distribution<int> chance(0, 3);
  for (int i = 0; i < 20000; ++i) {
    Vec3 p;
    for (double& axis : p)
      axis = std::copysign(std::pow(10, chance(random) ? 0.02 * exponent(random) : exponent(random)), sign(random));
    const Vec3 v = estimator->update(p, chance(random) ? std::pow(10, step(random)) : dt());
    ASSERT_TRUE(is_finite(v)) << i;
    for (const double axis : v) ASSERT_NE(std::fpclassify(axis), FP_SUBNORMAL);
  }
  Vec3 v = Vec3::Zero();
  for (int i = 0; i < 4 * settled(); ++i) v = estimator->update(i * dt() * kSlope, dt());
  EXPECT_LE((v - kSlope).norm(), 1e-6) << "does not recover";
}

TEST_P(VelocityEstimatorLaws, BehavesAsNewAfterAReset) {
  const auto used = make(), fresh = make();
  for (const Vec3& p : walk(777)) used->update(10 * p, 1.3 * dt());
  used->reset();
  for (const Vec3& p : walk(777)) ASSERT_EQ(used->update(p, dt()), fresh->update(p, dt()));
}

TEST_P(VelocityEstimatorLaws, ScalesWithThePositionsAndTheResolution) {
  const double scale = 1.0 / 1024;
  const auto large = make(), small = make(scale * kResolution);
  for (const Vec3& p : walk(2000)) {
    // The estimators treat values below 1e-100 as zero.
    const Vec3 v = scale * large->update(p, dt());
    ASSERT_LE((small->update(scale * p, dt()) - v).norm(), 1e-99);
  }
}

TEST_P(VelocityEstimatorLaws, TreatsEveryAxisAlike) {
  const auto straight = make(), turned = make();
  for (const Vec3& p : walk(2000)) {
    const Vec3 v = straight->update(p, dt()), w = turned->update({p.z(), p.x(), p.y()}, dt());
    ASSERT_EQ(w, Vec3(v.z(), v.x(), v.y()));
  }
}

TEST_P(VelocityEstimatorLaws, AllocatesNothing) {
  const auto estimator = make();
  const auto positions = walk(1000);
  const std::size_t before = test::allocations();
  for (const Vec3& p : positions) estimator->update(p, dt());
  estimator->reset();
  for (const Vec3& p : positions) estimator->update(p, 0.7 * dt());
  EXPECT_EQ(test::allocations(), before);
}

INSTANTIATE_TEST_SUITE_P(All, VelocityEstimatorLaws,
                         testing::Combine(testing::Values("difference", "lowpass", "lowpass:4", "lowpass:50000", "foaw",
                                                          "foaw:1", "foaw:64", "least-squares", "least-squares:2",
                                                          "least-squares:64", "alpha-beta-gamma", "alpha-beta-gamma:4",
                                                          "alpha-beta-gamma:50000"),
                                          testing::Values(10.0, 1000.0, 20000.0)),
                         [](const auto& tested) {
                           std::string name = std::get<0>(tested.param) + "_at_" +
                                              std::to_string(int(std::get<1>(tested.param))) + "_Hz";
                           for (char& c : name)
                             if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
                           return name;
                         });

TEST(VelocityEstimator, HasLawsForAllNames) {
  for (const std::string& name : velocity_estimator_names())
    EXPECT_THAT(name, testing::AnyOf("difference", "lowpass", "foaw", "least-squares", "alpha-beta-gamma"));
  EXPECT_EQ(velocity_estimator_names().size(), 5u);
}

/// Returns the standard deviation of the estimate for a resting device whose position has white noise of 1 m.
double noise_gain(const std::string& spec, double rate) {
  // All estimators but foaw are linear: the result is the root of the sum of squares of the unit impulse response.
  const auto estimator = make_velocity_estimator(spec, rate, 0);
  double sum = 0;
  for (int i = 0; i < 20000; ++i) sum += std::pow(estimator->update({i == 100 ? 1.0 : 0.0, 0, 0}, 1 / rate).x(), 2);
  return std::sqrt(sum);
}

/// Returns the lag [s] of the estimate behind the true velocity at constant acceleration.
double lag(const std::string& spec, double rate) {
  const auto estimator = make_velocity_estimator(spec, rate, 0);
  const int n = 5000;
  double v = 0;
  for (int i = 0; i <= n; ++i) v = estimator->update({0.5 * std::pow(i / rate, 2), 0, 0}, 1 / rate).x();
  return n / rate - v;
}

/// Returns the gain and the lag [s] for a sinusoidal movement of `frequency` [Hz].
std::pair<double, double> response(const std::string& spec, double rate, double frequency) {
  const auto estimator = make_velocity_estimator(spec, rate, 0);
  const double w = 2 * pi * frequency;
  double in_phase = 0, quadrature = 0;
  const int settle = static_cast<int>(rate), n = static_cast<int>(rate);  // whole periods for whole frequencies
  for (int i = 0; i < settle + n; ++i) {
    const double t = i / rate, v = estimator->update({std::sin(w * t) / w, 0, 0}, 1 / rate).x();
    if (i < settle) continue;
    in_phase += 2 * v * std::cos(w * t) / n;
    quadrature += 2 * v * std::sin(w * t) / n;
  }
  return {std::hypot(in_phase, quadrature), std::atan2(quadrature, in_phase) / w};
}

TEST(Difference, HasTheNoiseAndTheLagOfItsFormula) {
  EXPECT_NEAR(noise_gain("difference", 1000), std::sqrt(2) * 1000, 1e-9);
  EXPECT_NEAR(lag("difference", 1000), 0.5e-3, 1e-9);
}

TEST(LeastSquares, HasTheNoiseAndTheLagOfItsFormula) {
  for (const int n : {2, 3, 8, 15, 64}) {
    const std::string spec = "least-squares:" + std::to_string(n);
    EXPECT_NEAR(noise_gain(spec, 1000) / (std::sqrt(12.0 / (n * (n * n - 1.0))) * 1000), 1, 1e-9) << n;
    EXPECT_NEAR(lag(spec, 1000), (n - 1) / 2.0 * 1e-3, 1e-9) << n;
  }
}

TEST(LeastSquares, IsTheSlopeOfTheLineThroughUnevenSamples) {
  const auto estimator = make_velocity_estimator("least-squares:6", 1000, 0);
  std::mt19937 random(4);
  std::uniform_real_distribution<double> step(1e-4, 5e-3), noise(-1e-3, 1e-3);
  std::deque<std::pair<double, double>> window;
  double t = 0;
  for (int i = 0; i < 500; ++i) {
    const double dt = step(random), x = 0.2 + 0.1 * std::sin(t) + noise(random);
    t += dt;
    window.emplace_back(t, x);
    if (window.size() > 6) window.pop_front();
    const double v = estimator->update({x, 0, 0}, dt).x();
    if (window.size() < 2) continue;
    double mean_t = 0, mean_x = 0, tx = 0, tt = 0;
    for (const auto& [time, position] : window) mean_t += time, mean_x += position;
    mean_t /= static_cast<double>(window.size());
    mean_x /= static_cast<double>(window.size());
    for (const auto& [time, position] : window) {
      tx += (time - mean_t) * (position - mean_x);
      tt += (time - mean_t) * (time - mean_t);
    }
    ASSERT_NEAR(v, tx / tt, 1e-9);
  }
}

TEST(LowPass, IsAButterworthFilter) {
  for (const double cutoff : {10.0, 40.0, 100.0}) {
    const std::string spec = "lowpass:" + std::to_string(cutoff);
    EXPECT_NEAR(response(spec, 20000, cutoff).first, std::sqrt(0.5), 1e-3) << cutoff;
    EXPECT_NEAR(response(spec, 20000, cutoff / 2).first, 1 / std::sqrt(1 + 1.0 / 16), 1e-3) << cutoff;
    EXPECT_NEAR(response(spec, 20000, 4 * cutoff).first, 1 / std::sqrt(1 + 256.0), 1e-3) << cutoff;
  }
}

TEST(LowPass, HasTheNoiseAndTheLagOfItsFormula) {
  const double w = 2 * pi * 20;
  EXPECT_NEAR(lag("lowpass:20", 1000), std::sqrt(2) / w, 2e-5);
  EXPECT_NEAR(lag("lowpass:100", 1000), std::sqrt(2) / (2 * pi * 100), 1e-4);
  // The theoretical noise is the integral of w^2 |H|^2 of the continuous filter over white noise of spectral density T.
  EXPECT_NEAR(noise_gain("lowpass:20", 10000), std::sqrt(1e-4 * w * w * w / (2 * std::sqrt(2))),
              0.01 * noise_gain("lowpass:20", 10000));
}

TEST(LowPass, BecomesTheDifferenceAsItsCutOffPassesNyquist) {
  const auto filter = make_velocity_estimator("lowpass:5000", 1000, 0);
  const auto difference = make_velocity_estimator("difference", 1000, 0);
  for (const Vec3& p : walk(1000)) {
    const Vec3 v = difference->update(p, 1e-3);
    ASSERT_LE((filter->update(p, 1e-3) - v).norm(), 1e-8);
  }
}

TEST(LowPass, RespondsToAVelocityStepIndependentlyOfTheTimeSteps) {
  const auto even = make_velocity_estimator("lowpass:30", 1000, 0),
             uneven = make_velocity_estimator("lowpass:30", 1000, 0);
  std::mt19937 random(5);
  std::uniform_int_distribution<int> ticks(1, 9);
  std::vector<double> answer;
  for (int i = 0; i < 2000; ++i) answer.push_back(even->update({1e-3 * i, 0, 0}, 1e-3).x());
  uneven->update(Vec3::Zero(), 0);
  for (int i = 0, skipped = ticks(random); i + skipped < 2000; skipped = ticks(random)) {
    i += skipped;
    const double v = uneven->update({1e-3 * i, 0, 0}, 1e-3 * skipped).x();
    ASSERT_NEAR(v, answer[static_cast<std::size_t>(i)], 1e-12);
  }
}

/// Returns the slope of the line from x_{k-n} to x_k. As in the definition, n is the largest number such that, for it
/// and all smaller ones, the line passes every position in between within the band.
double first_order_adaptive_window(const std::vector<double>& t, const std::vector<double>& x, int longest,
                                   double band) {
  const std::size_t k = x.size() - 1;
  double fitting = 0;
  for (std::size_t n = 1; n <= std::min<std::size_t>(k, static_cast<std::size_t>(longest)); ++n) {
    const double slope = (x[k] - x[k - n]) / (t[k] - t[k - n]);
    for (std::size_t i = 1; i < n; ++i)
      if (std::abs(x[k] - slope * (t[k] - t[k - i]) - x[k - i]) > band) return fitting;
    fitting = slope;
  }
  return fitting;
}

TEST(AdaptiveWindow, MatchesItsDefinition) {
  // The band is no multiple of the resolution, so that rounding does not decide whether a position is within it.
  const double band = 1.01 * kResolution;
  const auto estimator = make_velocity_estimator("foaw:12", 1000, band);
  std::mt19937 random(6);
  std::uniform_real_distribution<double> step(0.5e-3, 1.5e-3);
  std::vector<double> t, x;
  for (const Vec3& p : walk(2000)) {
    const double dt = step(random);
    t.push_back((t.empty() ? 0 : t.back()) + dt);
    x.push_back(p.x());
    ASSERT_NEAR(estimator->update({p.x(), 0, 0}, dt).x(), first_order_adaptive_window(t, x, 12, band), 1e-9);
  }
}

TEST(AdaptiveWindow, FollowsAJumpAtOnceAndAStraightLineWithItsLongestWindow) {
  const auto estimator = make_velocity_estimator("foaw:8", 1000, kResolution);
  for (int i = 0; i < 20; ++i) estimator->update({0, 0, 0}, 1e-3);
  EXPECT_DOUBLE_EQ(estimator->update({10 * kResolution, 0, 0}, 1e-3).x(), 10 * kResolution / 1e-3);
  for (int i = 0; i < 20; ++i) estimator->update({0, 0, 0}, 1e-3);
  EXPECT_DOUBLE_EQ(estimator->update({kResolution, 0, 0}, 1e-3).x(), kResolution / 8e-3);
}

TEST(AdaptiveWindow, EqualsTheDifferenceWithoutAResolution) {
  const auto foaw = make_velocity_estimator("foaw", 1000, 0),
             difference = make_velocity_estimator("difference", 1000, 0);
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0, 1e-6);
  for (int i = 0; i < 1000; ++i) {
    const Vec3 p(std::sin(0.01 * i) + noise(random), noise(random), i * 1e-4);
    const Vec3 v = difference->update(p, 1e-3);
    ASSERT_LE((foaw->update(p, 1e-3) - v).norm(), 1e-9);
  }
}

TEST(AlphaBetaGamma, IsTheSteadyStateOfTheKalmanFilter) {
  for (const double bandwidth : {5.0, 60.0, 300.0}) {
    const double rate = 1000, dt = 1 / rate, index = std::pow(2 * pi * bandwidth * dt, 3);
    // In the filter's model, the acceleration changes by white noise from step to step, and the position noise is 1 m.
    Eigen::Matrix3d f;
    f << 1, dt, dt * dt / 2, 0, 1, dt, 0, 0, 1;
    const Vec3 g(dt * dt / 2, dt, 1);
    const Eigen::Matrix3d q = std::pow(index / (dt * dt), 2) * g * g.transpose();
    Eigen::Matrix3d p = q;
    Vec3 gain;
    for (int i = 0; i < 20000; ++i) {
      p = (f * p * f.transpose() + q).eval();
      gain = p.col(0) / (p(0, 0) + 1);
      p = (p - gain * p.row(0)).eval();
    }
    const auto estimator = make_velocity_estimator("alpha-beta-gamma:" + std::to_string(bandwidth), rate, 0);
    Vec3 state = Vec3::Zero();
    for (const Vec3& position : walk(2000)) {
      const double x = position.x() - 0.1;
      state = (f * state).eval();
      state += gain * (x - state.x());
      if (estimator->update({x, 0, 0}, dt).x() == 0) state = Vec3(x, 0, 0);  // the first position
      ASSERT_NEAR(estimator->update({kNaN, 0, 0}, dt).x(), state.y(), 1e-6);
    }
  }
}

TEST(AlphaBetaGamma, DoesNotLagBehindAConstantAcceleration) {
  EXPECT_NEAR(lag("alpha-beta-gamma", 1000), 0, 1e-6);
}

TEST(AlphaBetaGamma, HasTheNoiseOfAThirdOrderButterworthFilter) {
  // The continuous filter is v / x = (2 w^2 s^2 + w^3 s) / (s^3 + 2 w s^2 + 2 w^2 s + w^3). By Parseval's theorem, its
  // integral over white noise of density T is 3/2 T w^3.
  const double w = 2 * pi * 20, rate = 20000;
  EXPECT_NEAR(noise_gain("alpha-beta-gamma:20", rate), std::sqrt(1.5 * w * w * w / rate),
              0.02 * noise_gain("alpha-beta-gamma:20", rate));
}

TEST(AlphaBetaGamma, BecomesTheDifferenceAtNyquist) {
  const auto filter = make_velocity_estimator("alpha-beta-gamma:500", 1000, 0);
  const auto difference = make_velocity_estimator("difference", 1000, 0);
  for (const Vec3& p : walk(100)) {
    const Vec3 v = difference->update(p, 1e-3);
    ASSERT_EQ(filter->update(p, 1e-3), v);
  }
}

/// Returns the standard deviation of the estimate for a slow quantised ramp [m/s].
double ripple(const std::string& spec) {
  const auto estimator = make_velocity_estimator(spec, 1000, kResolution);
  double sum = 0, squares = 0;
  const int n = 20000;
  for (int i = -2000; i < n; ++i) {
    const double v = estimator->update({quantised(0.0123 * 1e-3 * i), 0, 0}, 1e-3).x();
    if (i >= 0) sum += v, squares += v * v;
  }
  return std::sqrt(squares / n - std::pow(sum / n, 2));
}

TEST(VelocityEstimator, QuietensTheRippleOfQuantisation) {
  // Encoder counts arrive as pulses of one tick, at a rate of v / resolution.
  const double duty = 0.0123 * 1e-3 / kResolution;
  const double raw = ripple("difference");
  EXPECT_NEAR(raw, kResolution / 1e-3 * std::sqrt(duty * (1 - duty)), 0.01 * raw);
  EXPECT_LE(ripple("foaw:8"), raw / 4);
  EXPECT_LE(ripple("foaw:32"), raw / 10);
  EXPECT_LE(ripple("least-squares:8"), raw / 3);
  EXPECT_LE(ripple("lowpass:100"), raw / 3);
  EXPECT_LE(ripple("lowpass:30"), raw / 30);
  EXPECT_LE(ripple("alpha-beta-gamma:30"), raw / 10);
}

std::string refusal(const std::string& spec, double rate = 1000, double resolution = 0) {
  try {
    (void)make_velocity_estimator(spec, rate, resolution);
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), Error::Kind::input);
    return error.what();
  }
  return "nothing was thrown";
}

TEST(VelocityEstimator, TakesAFrequencyWithItsUnit) {
  for (const auto& [with, without] : {std::pair{"lowpass:100Hz", "lowpass:100"},
                                      {"lowpass:0.25kHz", "lowpass:250"},
                                      {"alpha-beta-gamma:60 Hz", "alpha-beta-gamma:60"}}) {
    const auto one = make_velocity_estimator(with, 1000, 0), other = make_velocity_estimator(without, 1000, 0);
    for (int i = 0; i < 100; ++i) {
      const Vec3 position = Vec3::Constant(1e-5 * i * i);
      EXPECT_EQ(one->update(position, 1e-3), other->update(position, 1e-3)) << with;
    }
  }
  EXPECT_THAT(refusal("foaw:8Hz"), HasSubstr("the window must be a whole number"));
}

TEST(VelocityEstimator, RefusesAnInvalidSpecWithAReason) {
  EXPECT_EQ(
      refusal("low-pass:80"),
      "velocity estimator 'low-pass:80': 'low-pass' is not known; known: difference, lowpass, foaw, least-squares, "
      "alpha-beta-gamma");
  EXPECT_THAT(refusal(""), HasSubstr("'' is not known"));
  EXPECT_EQ(refusal("difference:3"), "velocity estimator 'difference:3': difference takes no parameter");
  EXPECT_EQ(refusal("lowpass:0"),
            "velocity estimator 'lowpass:0': the cut-off must be a number from 0.1 to 100000 Hz, as in 'lowpass:100'");
  for (const char* bad :
       {"lowpass:", "lowpass:-1", "lowpass:nan", "lowpass:inf", "lowpass:1e9", "lowpass:80mm", "lowpass:8:8"})
    EXPECT_THAT(refusal(bad), HasSubstr("the cut-off must be a number from 0.1 to 100000 Hz")) << bad;
  for (const char* bad : {"foaw:0", "foaw:2.5", "foaw:257", "foaw:1e99", "foaw:x"})
    EXPECT_THAT(refusal(bad), HasSubstr("the window must be a whole number from 1 to 256 steps")) << bad;
  EXPECT_THAT(refusal("least-squares:1"), HasSubstr("whole number from 2 to 256 samples"));
  EXPECT_THAT(refusal("alpha-beta-gamma:0"), HasSubstr("the bandwidth must be a number from 0.1 to 100000 Hz"));
}

TEST(VelocityEstimator, RefusesAnInvalidRateOrResolution) {
  for (const double rate : {0.0, -1.0, kNaN, kInfinity})
    EXPECT_THAT(refusal("foaw", rate), AllOf(HasSubstr("the servo rate is"), HasSubstr("Hz; it must be 1 to 1e6")));
  for (const double resolution : {-1e-6, kNaN, kInfinity})
    EXPECT_THAT(refusal("foaw", 1000, resolution), HasSubstr("the position resolution is"));
}

}  // namespace
}  // namespace haptrace
