// Tests of averaged paths on generated experts, whose true path, noise and pauses are known.
#include "metrics/path_average.h"

#include "control/path/shapes.h"
#include "metrics/polyline.h"
#include "tests/support/errors.h"

#include <array>
#include <cmath>
#include <fmt/format.h>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

using test::error_of;
using testing::HasSubstr;

constexpr double kSigma = 2e-3;  // true standard deviation of the generated experts in each axis [m]

/// The movement that generated experts intend.
struct Intended {
  std::string name;
  Polyline curve;
};

Intended intended(const std::string& shape, int turns = 1) {
  ShapeOptions options{.size = shape == "script" ? 0.108 : 0.08, .duration = 4, .blend = 0, .turns = turns};
  return {shape, Polyline(make_shape(shape, options).position)};
}

/// Returns twelve strokes of 45 mm, up and down.
Intended zigzag() {
  std::vector<Vec3> corners;
  for (int i = 0; i <= 12; ++i) corners.emplace_back(0.009 * i, i % 2 == 0 ? 0 : 0.044, 0);
  return {"zigzag", Polyline(corners)};
}

struct ExpertDraw {
  double sigma = kSigma;       ///< of the smooth noise in x and y [m]
  double depth = 0;            ///< of that in z [m]
  double white = 0;            ///< rms of a sensor's noise in each axis, at 1 kHz [m]
  double tremor = 0;           ///< rms of a tremor of 5 Hz along x + y + z [m]
  std::vector<double> pauses;  ///< where the experts pause, as shares of the length
  double scale = 1;            ///< of everything
  std::function<Vec3(double)> force = [](double) -> Vec3 { return Vec3::Zero(); };  ///< by share of the length [N]
};

/// Noise with a standard deviation of 1 that is smooth over centimetres: random waves of 30 to 150 mm.
class SmoothNoise {
 public:
  explicit SmoothNoise(std::mt19937& random) {
    std::uniform_real_distribution<double> wave(0.03, 0.15), phase(0, 2 * std::numbers::pi);
    for (auto& [number, shift] : waves_) {
      number = 2 * std::numbers::pi / wave(random);
      shift = phase(random);
    }
  }
  [[nodiscard]] double at(double s) const {
    double sum = 0;
    for (const auto& [number, shift] : waves_) sum += std::sin(number * s + shift);
    return sum * std::sqrt(2.0 / static_cast<double>(waves_.size()));
  }

 private:
  std::array<std::pair<double, double>, 12> waves_;
};

/// Returns one expert: the curve with noise that depends on the place, at a speed that varies by a factor of 4.
PathCopy expert(const Intended& task, unsigned seed, const ExpertDraw& draw = {}) {
  std::mt19937 random(seed);
  const SmoothNoise x(random), y(random), pace(random);
  std::mt19937 another(seed + 1'000'000);
  const SmoothNoise z(another);
  std::normal_distribution<double> sensor;
  std::uniform_real_distribution<double> jitter(-0.01, 0.01), rest(0.5, 1.5), mean_speed(0.04, 0.16);
  const double length = task.curve.length(), speed = mean_speed(random);
  std::vector<double> stops;
  for (const double share : draw.pauses) stops.push_back((share + jitter(random)) * length);
  ArcPath::Builder builder(draw.scale * 2.5e-4);
  double t = 0;
  std::size_t stop = 0;
  for (double s = 0;; t += 1e-3) {
    const double place = std::min(s, length);
    Vec3 p = task.curve.at(place) + Vec3(draw.sigma * x.at(place), draw.sigma * y.at(place), draw.depth * z.at(place));
    if (draw.white > 0) p += draw.white * Vec3(sensor(another), sensor(another), sensor(another));
    if (draw.tremor > 0)
      p += Vec3::Constant(draw.tremor * std::sqrt(2.0 / 3.0) * std::sin(2 * std::numbers::pi * 5 * t + seed));
    builder.add(t, draw.scale * p, draw.force(place / length));
    if (place >= length) break;
    if (stop < stops.size() && place >= stops[stop]) {
      t += rest(random);
      builder.add(t, draw.scale * p, draw.force(place / length));
      ++stop;
    }
    s += 1e-3 * speed * std::pow(2.0, std::clamp(pace.at(place), -1.0, 1.0));
  }
  return {fmt::format("{}-{}.h5", task.name, seed), std::make_shared<const ArcPath>(builder.finish(1e-3))};
}

std::vector<PathCopy> experts(const Intended& task, std::size_t count, const ExpertDraw& draw = {}, unsigned seed = 1) {
  std::vector<PathCopy> copies;
  for (unsigned i = 0; i < count; ++i) copies.push_back(expert(task, seed + i, draw));
  return copies;
}

/// Returns the rms distance of the average from the intended curve [m].
double bias(const AveragedPath& average, const Polyline& truth) {
  double squares = 0;
  for (std::size_t i = 0; i < average.position.size(); ++i) {
    const double s = average.arc[i] / average.arc.back() * truth.length();
    const Vec3& p = average.position[i];
    squares += (p - truth.at(truth.nearest(p, s - 0.03, s + 0.03))).squaredNorm();
  }
  return std::sqrt(squares / static_cast<double>(average.position.size()));
}

TEST(AveragedPaths, LieNearTheIntendedPathAndKeepItsLengthWhateverTheSpeedsAndPauses) {
  const std::vector<double> two{0.3, 0.7};
  struct Row {
    Intended task;
    std::vector<double> pauses;
  };
  for (const Row& row : {Row{intended("square"), {}}, Row{zigzag(), {}}, Row{intended("script"), two},
                         Row{intended("line"), two}, Row{intended("circle", 3), two}}) {
    double squares = 0, ratio = 0;
    constexpr unsigned kDraws = 6;
    for (unsigned draw = 0; draw < kDraws; ++draw) {
      SCOPED_TRACE(fmt::format("{}, draw {}", row.task.name, draw));
      const AveragedPath average = average_paths(experts(row.task, 6, {.pauses = row.pauses}, 100 * draw + 1));
      const double off = bias(average, row.task.curve);
      squares += off * off / kDraws;
      ratio += average.arc.back() / row.task.curve.length() / kDraws;
      EXPECT_LT(off, 1.6e-3);
    }
    RecordProperty(row.task.name + "_bias_mm", fmt::format("{:.2f}", 1e3 * std::sqrt(squares)));
    RecordProperty(row.task.name + "_length", fmt::format("{:.3f}", ratio));
    EXPECT_LT(std::sqrt(squares), 1.1e-3) << row.task.name << ": the mean of six keeps 0.82 mm of the noise";
    EXPECT_GT(ratio, 0.93) << row.task.name;
    EXPECT_LT(ratio, 1.02) << row.task.name;
  }
}

/// Returns three rounds of a helix, 80 mm wide and 60 mm high.
Intended helix() {
  std::vector<Vec3> points;
  for (int i = 0; i <= 3000; ++i) {
    const double turn = 2 * std::numbers::pi * i / 1000;
    points.emplace_back(0.04 * std::cos(turn), 0.04 * std::sin(turn), 2e-5 * i);
  }
  return {"helix", Polyline(points)};
}

/// Returns a trefoil knot, 90 mm wide and 30 mm high.
Intended knot() {
  std::vector<Vec3> points;
  for (int i = 0; i <= 3000; ++i) {
    const double q = 2 * std::numbers::pi * i / 3000;
    points.emplace_back(0.015 * (std::sin(q) + 2 * std::sin(2 * q)), 0.015 * (std::cos(q) - 2 * std::cos(2 * q)),
                        -0.015 * std::sin(3 * q));
  }
  return {"knot", Polyline(points)};
}

TEST(AveragedPaths, AreAsLongAsTheIntendedPathInSpace) {
  constexpr unsigned kDraws = 12;
  for (const Intended& task : {helix(), knot()})
    for (const double sigma : {5e-4, 1e-3, 2e-3}) {
      double ratio = 0;
      for (unsigned draw = 0; draw < kDraws; ++draw)
        ratio += average_paths(experts(task, 5, {.sigma = sigma, .depth = sigma}, 100 * draw + 1)).arc.back() /
                 task.curve.length() / kDraws;
      RecordProperty(fmt::format("{}_{}_length", task.name, 1e3 * sigma), fmt::format("{:.4f}", ratio));
      EXPECT_NEAR(ratio, 1, 5e-3) << task.name << " with a noise of " << sigma << " m";
    }
}

TEST(AveragedPaths, AcceptACopyWhoseNoiseMakesItMuchLongerAndKeepTheirLength) {
  struct Row {
    const char* name;
    ExpertDraw draw;
    double longer;   ///< than the intended path, at least
    double of_five;  ///< largest error of the length of five such copies
  };
  for (const Intended& task : {helix(), knot()})
    for (const Row& row : {Row{"white noise of 1 mm", {.sigma = 0, .white = 1e-3}, 10, 0.01},
                           Row{"white noise of 0.2 mm", {.sigma = 0, .white = 2e-4}, 2, 0.005},
                           Row{"a tremor of 3 mm", {.sigma = 0, .tremor = 3e-3}, 1.4, 0.15}}) {
      SCOPED_TRACE(fmt::format("{} with {}", task.name, row.name));
      std::vector<PathCopy> copies = experts(task, 2, {.sigma = 0});
      copies.push_back(expert(task, 3, row.draw));
      EXPECT_GT(copies.back().path->length(), row.longer * task.curve.length());
      AveragedPath average;
      ASSERT_EQ(error_of([&] { average = average_paths(copies); }), "no error");
      RecordProperty(fmt::format("{} {} one", task.name, row.name),
                     fmt::format("{:.4f}", average.arc.back() / task.curve.length()));
      EXPECT_NEAR(average.arc.back() / task.curve.length(), 1, 0.03);
      ASSERT_EQ(error_of([&] { average = average_paths(experts(task, 5, row.draw)); }), "no error");
      RecordProperty(fmt::format("{} {} five", task.name, row.name),
                     fmt::format("{:.4f}", average.arc.back() / task.curve.length()));
      EXPECT_NEAR(average.arc.back() / task.curve.length(), 1, row.of_five);
      EXPECT_LT(bias(average, task.curve), 2e-3);
      EXPECT_EQ(error_of([&] { require_same_movement(copies[0], std::span(copies).subspan(2)); }), "no error");
    }
}

TEST(AveragedPaths, KnowWhetherTheCopiesDifferInAPlaneOrInSpaceAndHoldTheNextOneInBoth) {
  for (const double depth : {0.0, kSigma}) {
    double inside = 0, places = 0;
    for (unsigned draw = 0; draw < 20; ++draw) {
      std::vector<PathCopy> copies = experts(intended("square"), 6, {.depth = depth}, 100 * draw + 1);
      const AveragedPath average = average_paths(std::span(copies).first(5));
      if (depth > 0)
        EXPECT_GT(average.directions, 1.6);
      else
        EXPECT_LT(average.directions, 1.01);
      const double radius = prediction_factor(5, average.directions) * average.overall_spread;
      const Polyline mean(average.position);
      for (const double share : {0.2, 0.4, 0.6, 0.8}) {
        const Vec3 p = copies[5].path->position_at(share * copies[5].path->length());
        if ((p - mean.at(mean.nearest(p, 0, mean.length()))).norm() <= radius) ++inside;
        ++places;
      }
    }
    RecordProperty(fmt::format("inside_{}", depth > 0), fmt::format("{:.3f}", inside / places));
    EXPECT_GT(inside / places, 0.88);
  }
}

TEST(AveragedPaths, StateTheTrueSpreadAcrossThePath) {
  for (const Intended& task : {intended("square"), zigzag(), intended("script"), intended("line")}) {
    double squares = 0;
    constexpr unsigned kDraws = 6;
    for (unsigned draw = 0; draw < kDraws; ++draw) {
      const double spread = average_paths(experts(task, 6, {}, 100 * draw + 1)).overall_spread;
      squares += spread * spread / kDraws;
    }
    RecordProperty(task.name + "_spread_mm", fmt::format("{:.2f}", 1e3 * std::sqrt(squares)));
    EXPECT_NEAR(std::sqrt(squares), kSigma, 0.1 * kSigma) << task.name;
  }
}

TEST(AveragedPaths, TakeTheMedianTimeWithoutPausesAndKeepThePausesByPlace) {
  const Intended task = intended("circle");
  const AveragedPath with = average_paths(experts(task, 6, {.pauses = {0.25, 0.6}}));
  const AveragedPath without = average_paths(experts(task, 6));
  EXPECT_TRUE(without.pauses.empty());
  ASSERT_EQ(with.pauses.size(), 2U);
  EXPECT_NEAR(with.pauses[0].arc / with.arc.back(), 0.25, 0.02);
  EXPECT_NEAR(with.pauses[1].arc / with.arc.back(), 0.6, 0.02);
  for (const AveragedPath::Pause& pause : with.pauses) {
    EXPECT_EQ(pause.copies, 6U);
    EXPECT_GT(pause.duration, 0.5);
    EXPECT_LT(pause.duration, 1.5);
  }
  // The draws of the speeds are the same, and those of the pauses lie between 0.5 and 1.5 s.
  EXPECT_NEAR(with.time.back(), without.time.back(), 0.15 * without.time.back());
  EXPECT_TRUE(std::is_sorted(with.time.begin(), with.time.end(), std::less_equal<>()));
}

TEST(AveragedPaths, AverageTheForceAtThePlaceAndNotAtTheTime) {
  ExpertDraw draw{.pauses = {0.4}};
  draw.force = [](double share) { return Vec3(std::sin(6 * share), 1, 0); };
  const AveragedPath average = average_paths(experts(intended("circle"), 6, draw));
  double squares = 0;
  for (std::size_t i = 0; i < average.arc.size(); ++i)
    squares += (average.force[i] - draw.force(average.arc[i] / average.arc.back())).squaredNorm();
  EXPECT_LT(std::sqrt(squares / static_cast<double>(average.arc.size())), 0.05);
}

TEST(AveragedPaths, EqualTheCopiesWhereTheseAreIdentical) {
  const PathCopy one = expert(intended("script"), 3);
  const AveragedPath average = average_paths(std::vector<PathCopy>(20, one));
  EXPECT_LT(bias(average, intended("script").curve), 4e-3);
  for (std::size_t i = 0; i < average.arc.size(); ++i)
    ASSERT_LT(
        (average.position[i] - one.path->position_at(average.arc[i] / average.arc.back() * one.path->length())).norm(),
        0.3e-3);
  EXPECT_LT(average.overall_spread, 0.05e-3);
  EXPECT_NEAR(average.time.back(), one.path->time_at(one.path->length()), 0.02 * average.time.back());
}

TEST(AveragedPaths, OfTwoCopiesLieBetweenThem) {
  const Intended task = intended("circle");
  std::vector<PathCopy> copies;
  for (const double z : {-1e-3, 1e-3}) {
    ArcPath::Builder builder(2.5e-4);
    for (int i = 0; i <= 4000; ++i)
      builder.add(1e-3 * i, task.curve.at(task.curve.length() * i / 4000) + Vec3(0, 0, z), Vec3::Zero());
    copies.push_back({fmt::format("{}", z), std::make_shared<const ArcPath>(builder.finish(0))});
  }
  const AveragedPath average = average_paths(copies);
  for (const Vec3& p : average.position) ASSERT_NEAR(p.z(), 0, 1e-6);
  EXPECT_NEAR(average.overall_spread, std::sqrt(2) * 1e-3, 1e-5);
}

TEST(AveragedPaths, GrowWithTheirCopies) {
  const AveragedPath small = average_paths(experts(zigzag(), 4)),
                     large = average_paths(experts(zigzag(), 4, {.scale = 10}));
  EXPECT_NEAR(large.arc.back(), 10 * small.arc.back(), 0.01 * large.arc.back());
  EXPECT_NEAR(large.overall_spread, 10 * small.overall_spread, 0.02 * large.overall_spread);
}

/// Returns `copy` backwards.
PathCopy reversed(const PathCopy& copy) {
  ArcPath::Builder builder(copy.path->spacing());
  const double length = copy.path->length();
  for (int i = 0; i <= 4000; ++i) builder.add(1e-3 * i, copy.path->position_at(length * (1 - i / 4e3)), Vec3::Zero());
  return {"reversed.h5", std::make_shared<const ArcPath>(builder.finish(1e-3))};
}

TEST(AveragedPaths, RefuseACopyOfAnotherMovementAndNameIt) {
  const auto error = [](std::vector<PathCopy> copies, PathCopy other, std::size_t at) {
    other.name = "other.h5";
    copies.insert(copies.begin() + static_cast<std::ptrdiff_t>(at), std::move(other));
    return error_of([&] { (void)average_paths(copies); });
  };
  for (unsigned seed = 1; seed < 100; seed += 50) {
    const Intended square = intended("square"), circle = intended("circle", 3);
    for (const std::size_t at : {0, 2}) {
      const auto copies = [&](const Intended& task) { return experts(task, 4, {}, seed); };
      const std::string backwards = error(copies(square), reversed(expert(square, seed + 20)), at);
      EXPECT_THAT(backwards, HasSubstr("other.h5: shows another movement"));
      EXPECT_THAT(backwards, HasSubstr("runs in the opposite direction"));
      EXPECT_THAT(error(copies(circle), reversed(expert(circle, seed + 20)), at), HasSubstr("other.h5"));
      EXPECT_THAT(error(copies(circle), expert(intended("circle", 4), seed + 20), at), HasSubstr("other.h5"));
      EXPECT_THAT(error(copies(intended("circle", 5)), expert(intended("circle", 6), seed + 20), at),
                  HasSubstr("other.h5"));
      EXPECT_THAT(error(copies(circle), expert(intended("circle", 2), seed + 20), at), HasSubstr("number of laps"));
      EXPECT_THAT(error(copies(square), expert(intended("figure8"), seed + 20), at), HasSubstr("other.h5"));
      EXPECT_THAT(error(copies(zigzag()), expert(intended("script"), seed + 20), at), HasSubstr("other.h5"));
    }
    // With two, neither can be in the majority, but they still cannot be averaged.
    for (const Intended& task : {square, circle})
      EXPECT_THAT(error(experts(task, 1, {}, seed), reversed(expert(task, seed + 20)), 1),
                  HasSubstr("shows another movement"));
    EXPECT_THAT(error(experts(circle, 1, {}, seed), expert(intended("circle", 4), seed + 20), 1),
                HasSubstr("shows another movement"));
  }
}

TEST(AveragedPaths, AcceptEveryOrdinaryExpert) {
  for (unsigned seed = 1; seed <= 4; ++seed)
    for (const Intended& task : {intended("square"), zigzag(), intended("script"), intended("line")})
      for (const std::size_t count : {2, 6})
        EXPECT_EQ(error_of([&] { (void)average_paths(experts(task, count, {.pauses = {0.5}}, 7 * seed)); }), "no error")
            << task.name;
}

TEST(AveragedPaths, RefuseWhatHasNoAverage) {
  const PathCopy circle = expert(intended("circle"), 1);
  ArcPath::Builder still(2.5e-4);
  still.add(0, Vec3(0.01, 0, 0), Vec3::Zero());
  const PathCopy point{"point.h5", std::make_shared<const ArcPath>(still.finish(0))};
  const auto error = [](const std::vector<PathCopy>& copies) { return error_of([&] { (void)average_paths(copies); }); };
  EXPECT_THAT(error({}), HasSubstr("at least two recordings"));
  EXPECT_THAT(error({circle}), HasSubstr("at least two recordings"));
  EXPECT_THAT(error({circle, point}), HasSubstr("point.h5: does not move"));
  EXPECT_THAT(error({point, point}), HasSubstr("point.h5: does not move"));
  // Hours of handwork: 400 rounds of a circle.
  ArcPath::Builder long_path(2.5e-4);
  for (int i = 0; i <= 400 * 360; ++i) {
    const double q = i * std::numbers::pi / 180;
    long_path.add(0.1 * i, 0.04 * Vec3(std::cos(q), std::sin(q), 0), Vec3::Zero());
  }
  const PathCopy hours{"hours.h5", std::make_shared<const ArcPath>(long_path.finish(0))};
  EXPECT_THAT(error({hours, hours}), HasSubstr("hours.h5: its path of 100.5 m is more than 360 times as long"));
}

TEST(AveragedPaths, DoNotDependOnHoursOfRest) {
  const Intended task = intended("circle");
  std::vector<PathCopy> copies = experts(task, 2);
  ArcPath::Builder builder(2.5e-4);
  for (int i = 0; i <= 4000; ++i)
    builder.add(1e-3 * i + (i > 2000 ? 36'000 : 0), task.curve.at(task.curve.length() * i / 4000), Vec3::Zero());
  copies.push_back({"rested.h5", std::make_shared<const ArcPath>(builder.finish(0))});
  const AveragedPath average = average_paths(copies);
  EXPECT_LT(average.time.back(), 10);
  EXPECT_TRUE(average.pauses.empty()) << "one of three rested";
}

TEST(PredictionFactor, HoldsTheNextRepetitionWith95PercentInOneDirectionAndInTwo) {
  EXPECT_NEAR(prediction_factor(2, 1), 15.6, 0.05);
  EXPECT_NEAR(prediction_factor(3, 1), 5.0, 0.05);
  EXPECT_NEAR(prediction_factor(6, 1), 2.8, 0.05);
  // A simulation with a fixed seed: 6 draws state the interval, and the seventh lies in it 95 times in 100.
  std::mt19937 random(1);
  std::normal_distribution<double> draw;
  constexpr int kRuns = 20'000;
  for (const int directions : {1, 2}) {
    int inside = 0;
    for (int run = 0; run < kRuns; ++run) {
      const auto one = [&] { return Eigen::Vector2d(draw(random), directions == 2 ? draw(random) : 0); };
      std::array<Eigen::Vector2d, 6> values;
      Eigen::Vector2d mean(0, 0);
      for (Eigen::Vector2d& value : values) mean += (value = one()) / 6;
      double squares = 0;
      for (const Eigen::Vector2d& value : values) squares += (value - mean).squaredNorm() / 5;
      if ((one() - mean).norm() <= prediction_factor(6, directions) * std::sqrt(squares)) ++inside;
    }
    EXPECT_NEAR(static_cast<double>(inside) / kRuns, 0.95, 0.006) << directions;
  }
  EXPECT_THAT(error_of([] { (void)prediction_factor(1, 1); }), HasSubstr("at least two"));
}

}  // namespace
}  // namespace haptrace
