#include "metrics/movement.h"

#include "tests/metrics/support.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <string>
#include <utility>

namespace haptrace {
namespace {

using test::error_of;
using test::Reach;
using test::reach;
using test::Sampled;
using test::sampled;
using test::Sampling;

PlantModel plant() {
  PlantModel plant;
  plant.mass = Vec3(0.4, 0.5, 0.6);
  plant.viscous = Vec3(1, 2, 3);
  plant.coulomb = Vec3(0.7, 0.7, 0.7);
  plant.gravity = Vec3(0, 0, -0.3);
  return plant;
}

MovementFigures figures_of(const Sampled& movement, MovementOptions options = {}) {
  if (!options.plant) options.plant = plant();
  if (!options.reference_length) options.reference_length = 0.2;
  const Trial trial{
      .time = movement.time, .position = movement.position, .force = movement.force, .measured = movement.force};
  const auto figures = movement_figures(trial, options);
  EXPECT_TRUE(figures);
  return figures.value_or(MovementFigures{});
}

using Named = std::vector<std::pair<std::string, double>>;

Named forces(const ForceFigures& force) {
  return {{"mean force", force.mean},
          {"peak force", force.peak},
          {"force across", force.mean_across},
          {"assist", force.assist},
          {"resist", force.resist}};
}

/// Returns the metrics that do not depend on the unit of length.
Named dimensionless(const MovementFigures& f) {
  return {
      {"duration", f.duration},     {"onset", f.onset},       {"end", f.end},      {"movement time", f.movement_time},
      {"dwell time", f.dwell_time}, {"peaks", f.speed_peaks}, {"sparc", *f.sparc}, {"log jerk", *f.log_jerk}};
}

Named lengths(const MovementFigures& f) {
  return {{"path length", f.path_length},
          {"normalised length", *f.normalised_length},
          {"mean speed", f.mean_speed},
          {"peak speed", f.peak_speed}};
}

Named all(const MovementFigures& f) {
  Named result = dimensionless(f);
  for (const Named& more : {lengths(f), forces(*f.force), Named{{"person's work", *f.person_work_estimate}}})
    result.insert(result.end(), more.begin(), more.end());
  return result;
}

void expect_near(const Named& a, const Named& b, double share, const std::string& where) {
  for (std::size_t i = 0; i < a.size(); ++i)
    EXPECT_NEAR(a[i].second, b[i].second, share * std::abs(b[i].second) + 1e-12) << where << ": " << a[i].first;
}

TEST(Movement, DoesNotDependOnTheSamplingRate) {
  const Named even = all(figures_of(reach()));
  for (const double rate : {250.0, 300.0, 333.0, 500.0, 2000.0, 4000.0})
    expect_near(all(figures_of(reach({.rate_hz = rate}))), even, 0.02, std::to_string(rate));
}

TEST(Movement, DoesNotDependOnUnevenStampsAndCounts) {
  const Named even = all(figures_of(reach()));
  for (const double rate : {250.0, 1000.0, 4000.0}) {
    expect_near(all(figures_of(reach({.rate_hz = rate, .jitter = 0.8}))), even, 0.02, "jitter");
    expect_near(all(figures_of(reach({.rate_hz = rate, .count = 5e-5}))), even, 0.02, "counts");
    expect_near(all(figures_of(reach({.rate_hz = rate, .jitter = 0.5, .count = 5e-5}))), even, 0.02, "both");
  }
}

TEST(Movement, DoesNotDependOnItsStartTime) {
  const Named now = all(figures_of(reach()));
  for (const double start : {-3.0, 1e5}) expect_near(all(figures_of(reach({.start = start}))), now, 1e-4, "later");
}

TEST(Movement, DoesNotDependOnPlaceAndDirection) {
  const Eigen::AngleAxisd turn(0.7, Vec3(1, 2, 3).normalized());
  Sampled moved = reach();
  for (Vec3& p : moved.position) p = turn * p + Vec3(0.1, -2, 0.4);
  for (Vec3& f : moved.force) f = turn * f;
  MovementOptions same_everywhere;
  same_everywhere.plant = PlantModel{};
  same_everywhere.plant->mass = Vec3::Constant(0.4);
  same_everywhere.plant->viscous = Vec3::Constant(2);
  expect_near(all(figures_of(moved, same_everywhere)), all(figures_of(reach(), same_everywhere)), 1e-6, "moved");
}

TEST(Movement, GrowsWithItsAmplitudeButNotInShape) {
  Sampled larger = reach();
  for (Vec3& p : larger.position) p *= 3;
  const MovementFigures one = figures_of(reach()), three = figures_of(larger, {.least_speed = 6e-3});
  expect_near(dimensionless(three), dimensionless(one), 1e-9, "shape");
  Named scaled = lengths(one);
  for (auto& figure : scaled) figure.second *= 3;
  expect_near(lengths(three), scaled, 1e-9, "length");
}

TEST(Movement, IsAsSmoothHoweverLongItTakes) {
  for (const double duration : {0.7, 1.5, 4.0}) {
    const auto stroke = [duration](double t) { return Vec3(0.2 * MinJerk::at((t - 0.5) / duration).s, 0, 0); };
    const MovementFigures f = figures_of(sampled(duration + 1, stroke, [](double) -> Vec3 { return Vec3::Zero(); }));
    EXPECT_NEAR(*f.sparc, -1.41, 0.03) << duration;
    EXPECT_NEAR(*f.log_jerk, -4.405, 0.02) << duration;  // value between the speed thresholds
    EXPECT_EQ(f.speed_peaks, 1);
  }
}

TEST(Movement, IsTheSameBackwards) {
  Sampled back = reach();
  std::reverse(back.position.begin(), back.position.end());
  const MovementFigures there = figures_of(reach()), f = figures_of(back);
  EXPECT_NEAR(f.path_length, there.path_length, 1e-4);
  EXPECT_NEAR(f.movement_time, there.movement_time, 2e-3);
  EXPECT_NEAR(f.onset, Reach::kDuration - there.end, 2e-3);
  EXPECT_NEAR(*f.sparc, *there.sparc, 1e-2);
  EXPECT_EQ(f.speed_peaks, there.speed_peaks);
}

/// Returns a stroke of 20 cm along x in a second, after half a second of rest.
Sampled stroke(const std::function<Vec3(double)>& force, const Sampling& sampling = {}) {
  return sampled(
      2, [](double t) { return Vec3(0.2 * MinJerk::at(t - 0.5).s, 0, 0); }, force, sampling);
}

TEST(Movement, MatchesTheClosedFormsOfAMinimumJerkStroke) {
  const MovementFigures f = figures_of(stroke([](double) { return Vec3(2, 0.3, -0.4); }));
  // 30 u^2 (1 - u)^2 = 0.05 * 1.875 at u = 0.05943; the low pass makes the ends a little softer.
  EXPECT_NEAR(f.onset, 0.5594, 4e-3);
  EXPECT_NEAR(f.end, 1.4406, 4e-3);
  EXPECT_NEAR(f.movement_time, 0.8811, 8e-3);
  EXPECT_NEAR(f.duration, 2, 1e-9);
  EXPECT_EQ(f.dwell_time, 0);
  EXPECT_NEAR(f.path_length, 0.2 * (1 - 2 * MinJerk::at(0.05943).s), 4e-4);
  EXPECT_NEAR(*f.normalised_length, f.path_length / 0.2, 1e-12);
  EXPECT_NEAR(f.peak_speed, 0.375, 1e-3);
  EXPECT_NEAR(f.mean_speed, f.path_length / f.movement_time, 1e-12);
  EXPECT_EQ(f.speed_peaks, 1);
  EXPECT_NEAR(f.force->mean, std::sqrt(4.25), 1e-9);
  EXPECT_NEAR(f.force->peak, std::sqrt(4.25), 1e-9);
  EXPECT_NEAR(f.force->mean_across, 0.5, 1e-9);
  EXPECT_NEAR(f.force->assist, 2 * f.path_length, 1e-5);
  EXPECT_NEAR(f.force->resist, 0, 1e-9);
  EXPECT_EQ(f.measured->assist, f.force->assist);
}

TEST(Movement, WorkIsSplitIntoAssistAndResist) {
  // The device pushes in the first half and holds back in the second.
  const MovementFigures f = figures_of(stroke([](double t) { return Vec3(t < 1 ? 3 : -1, 0, 0); }));
  EXPECT_NEAR(f.force->assist, 3 * f.path_length / 2, 6e-3);
  EXPECT_NEAR(f.force->resist, 1 * f.path_length / 2, 6e-3);
}

TEST(Movement, TheWorkOfTheParticipantExcludesThatOfTheDevice) {
  // `whole` is the force that moves this plant along the stroke, m a + b v + F_c; gravity has no component along it.
  // The device supplies or takes a third of this force.
  const PlantModel p = plant();
  const auto whole = [&](double t) {
    const MinJerk u = MinJerk::at(t - 0.5);
    const double v = 0.2 * u.ds;
    return p.mass.x() * 0.2 * u.dds + p.viscous.x() * v + (v > 0 ? p.coulomb.x() : 0);
  };
  for (const double share : {1.0 / 3, -1.0 / 3}) {
    const MovementFigures f = figures_of(stroke([&](double t) { return Vec3(share * whole(t), 0, 0); }));
    double work = 0;
    for (double t = f.onset; t < f.end; t += 1e-4) work += 1e-4 * whole(t) * 0.2 * MinJerk::at(t - 0.5).ds;
    EXPECT_NEAR(*f.person_work_estimate, work * (1 - share), 0.01 * work) << share;
  }

  // Lifting requires work against gravity.
  MovementOptions weight;
  weight.plant = PlantModel{};
  weight.plant->gravity = Vec3(-2, 0, 0);
  weight.plant->gravity_gradient(0, 0) = 1;
  const auto nothing = [](double) -> Vec3 { return Vec3::Zero(); };
  const MovementFigures lifted = figures_of(stroke(nothing), weight);
  EXPECT_NEAR(*lifted.person_work_estimate, 2 * lifted.path_length - 0.1 * lifted.path_length, 1e-4);
}

TEST(Movement, CountsPeaksOfTheRequestedProminence) {
  // Three strokes: the second follows a rest, and the third is a tenth of the first.
  const auto strokes = [](double t) {
    return Vec3(0.1 * MinJerk::at(t - 0.2).s + 0.1 * MinJerk::at(t - 1.7).s + 0.01 * MinJerk::at(t - 2.7).s, 0, 0);
  };
  const Sampled movement = sampled(4, strokes, [](double) { return Vec3::Zero().eval(); });
  EXPECT_EQ(figures_of(movement).speed_peaks, 3);
  EXPECT_EQ(figures_of(movement, {.prominence = 0.2}).speed_peaks, 2);
  EXPECT_EQ(figures_of(movement, {.least_speed = 0.03}).speed_peaks, 2);
  EXPECT_NEAR(figures_of(movement).dwell_time, 0.5 + 2 * 0.0593 + 0.0593 + 0.21, 0.03);
  EXPECT_NEAR(figures_of(movement, {.threshold = 0.2}).end, 2.7 - 0.1317, 0.01);
}

TEST(Movement, TimesAreFinerThanTheEvenSteps) {
  const auto figures_from = [](double start) {  // two strokes and a pause
    const auto strokes = [start](double t) {
      return Vec3(0.1 * MinJerk::at(t - start).s, 0.1 * MinJerk::at(t - start - 1.5).s, 0);
    };
    return figures_of(sampled(4, strokes, [](double) { return Vec3::Zero().eval(); }), {.cutoff_hz = 5});  // 2 ms steps
  };
  const MovementFigures first = figures_from(0.5);
  for (const double later : {0.4e-3, 0.9e-3, 1.3e-3, 1.8e-3}) {
    const MovementFigures f = figures_from(0.5 + later);
    EXPECT_NEAR(f.onset, first.onset + later, 2e-5) << later;
    EXPECT_NEAR(f.end, first.end + later, 2e-5) << later;
    EXPECT_NEAR(f.dwell_time, first.dwell_time, 4e-5) << later;
  }
}

TEST(Movement, IgnoresForcesAcrossTheMovementWhileTheHandDwells) {
  const auto strokes = [](double t) { return Vec3(0.1 * (MinJerk::at(t - 0.5).s + MinJerk::at(t - 2.5).s), 0, 0); };
  const auto force = [](double t) { return Vec3(0, t > 1.6 && t < 2.4 ? 10 : 1, 0); };
  const MovementFigures f = figures_of(sampled(4, strokes, force));
  EXPECT_NEAR(f.force->mean_across, 1, 0.05);
  EXPECT_GT(f.force->mean, 3);
}

TEST(Movement, ATrialThatIsCutDuringTheMovementExtendsToItsEnds) {
  const auto steady = [](double t) { return Vec3(0.1 * t, 0, 0); };
  const MovementFigures f = figures_of(sampled(2, steady, [](double) { return Vec3(0, 1, 0); }));
  EXPECT_EQ(f.onset, 0);
  EXPECT_NEAR(f.end, 2, 1e-12);
  EXPECT_NEAR(f.path_length, 0.2, 1e-9);
  EXPECT_NEAR(f.peak_speed, 0.1, 1e-9);
  EXPECT_EQ(f.speed_peaks, 0);
  EXPECT_NEAR(f.force->mean_across, 1, 1e-9);
}

TEST(Movement, TheLowPassIsTheOneStated) {
  for (const double cutoff : {5.0, 10.0}) {
    for (const double frequency : {0.5 * cutoff, cutoff, 2 * cutoff}) {
      const double omega = 2 * std::numbers::pi * frequency;
      const auto shake = [&](double t) { return Vec3(1e-2 * std::sin(omega * t), 0, 0); };
      const MovementFigures f =
          figures_of(sampled(5, shake, [](double) { return Vec3::Zero().eval(); }, {.rate_hz = 4000}),
                     {.cutoff_hz = cutoff, .threshold = 0.01});
      // The filter makes two passes of |H|^2 = 1 / (1 + (f / f_2)^4), with f_2 such that their product is 1 / sqrt(2)
      // at the cut-off.
      const double gain = 1 / (1 + (std::numbers::sqrt2 - 1) * std::pow(frequency / cutoff, 4));
      EXPECT_NEAR(f.mean_speed, 1e-2 * omega * gain * 2 / std::numbers::pi, 0.02 * f.mean_speed) << frequency;
    }
  }
}

TEST(Movement, ShortGapsAreBridgedAndLongOnesAreNot) {
  Sampled movement = reach();
  const MovementFigures whole = figures_of(movement);
  for (std::size_t i = 1000; i < 1040; ++i) movement.position[i] = nan3();
  for (std::size_t i = 1500; i < 1540; ++i) movement.force[i].z() = kNaN;
  MovementFigures bridged = figures_of(movement);
  EXPECT_NEAR(*bridged.log_jerk, *whole.log_jerk, 0.5);  // the bridge has corners
  bridged.log_jerk = whole.log_jerk;
  expect_near(all(bridged), all(whole), 0.02, "40 ms");

  for (std::size_t i = 1500; i < 1640; ++i) movement.force[i] = nan3();
  const MovementFigures f = figures_of(movement);
  EXPECT_FALSE(f.force);
  EXPECT_FALSE(f.person_work_estimate);
  EXPECT_TRUE(f.sparc);

  for (std::size_t i = 1000; i < 1140; ++i) movement.position[i] = nan3();
  EXPECT_FALSE(movement_figures({.time = movement.time, .position = movement.position}));
  EXPECT_TRUE(movement_figures({.time = movement.time, .position = movement.position}, {.max_gap = 0.2}));
}

TEST(Movement, WithoutForceOrReferenceTheirMetricsAreUndefined) {
  const Sampled movement = reach();
  const auto f = movement_figures({.time = movement.time, .position = movement.position}, {.plant = plant()});
  ASSERT_TRUE(f);
  EXPECT_FALSE(f->force);
  EXPECT_FALSE(f->measured);
  EXPECT_FALSE(f->normalised_length);
  EXPECT_FALSE(f->person_work_estimate);
  EXPECT_FALSE(movement_figures({.time = movement.time, .position = movement.position, .force = movement.force})
                   ->person_work_estimate);
}

TEST(Movement, IsUndefinedWhenNothingMoves) {
  const auto nothing = [](double) -> Vec3 { return Vec3::Zero(); };
  const auto figures = [](const Sampled& s) { return movement_figures({.time = s.time, .position = s.position}); };
  EXPECT_FALSE(figures({}));
  EXPECT_FALSE(figures(sampled(0, nothing, nothing)));
  EXPECT_FALSE(figures(sampled(
      0.001, [](double t) { return Vec3(t, 0, 0); }, nothing)));  // two samples
  EXPECT_FALSE(figures(sampled(5, nothing, nothing)));
  // A hand that rests on the edge of an encoder count.
  EXPECT_FALSE(figures(sampled(
      5, [](double t) { return Vec3(t > 2 ? 5e-5 : 0, 0, 0); }, nothing)));
  Sampled lost = reach();
  std::fill(lost.position.begin(), lost.position.end(), nan3());
  EXPECT_FALSE(figures(lost));
}

TEST(Movement, ThreeSamplesAreEnough) {
  const std::vector<double> time{0, 0.001, 0.003};
  const std::vector<Vec3> position{Vec3::Zero(), Vec3(1e-4, 0, 0), Vec3(3e-4, 0, 0)};
  const auto f = movement_figures({.time = time, .position = position});
  ASSERT_TRUE(f);
  EXPECT_NEAR(f->path_length, 3e-4, 1e-9);
  EXPECT_NEAR(f->mean_speed, 0.1, 1e-6);
}

TEST(Movement, ReportsInvalidTrialsAndOptions) {
  Sampled movement = reach();
  const auto message = [&](const MovementOptions& options = {}) {
    return error_of([&] {
      return movement_figures({.time = movement.time, .position = movement.position, .force = movement.force}, options);
    });
  };
  for (const MovementOptions& bad : {MovementOptions{.cutoff_hz = 0},
                                     {.threshold = 1},
                                     {.prominence = kNaN},
                                     {.max_gap = -1},
                                     {.reference_length = 0.0}})
    EXPECT_THAT(message(bad), testing::HasSubstr("movement metrics"));
  movement.time[41] = movement.time[40];
  EXPECT_THAT(message(), testing::HasSubstr("sample 42"));
  movement.time[41] = kNaN;
  EXPECT_THAT(message(), testing::HasSubstr("sample 42"));
  movement = reach();
  movement.force.pop_back();
  EXPECT_THAT(message(), testing::HasSubstr("columns"));
  movement = reach();
  for (double& t : movement.time) t *= 1e6;  // microseconds
  EXPECT_THAT(message({.max_gap = 1e9}), testing::HasSubstr("must be in seconds"));
}

TEST(Movement, TakesAMillionSamples) {
  const auto sway = [](double t) { return Vec3(0.1 * std::sin(t), 0, 0); };
  const Sampled movement = sampled(250, sway, [](double t) { return Vec3(std::cos(t), 0, 0); }, {.rate_hz = 4000});
  ASSERT_EQ(movement.time.size(), 1000001U);
  const MovementFigures f = figures_of(movement);
  EXPECT_NEAR(f.peak_speed, 0.1, 1e-4);
  EXPECT_NEAR(f.path_length, 250 * 0.2 / std::numbers::pi, 0.02);
  EXPECT_NEAR(f.force->assist, 250 * 0.05, 0.05);
  EXPECT_EQ(f.speed_peaks, 79);  // the last one before 250 s
}

}  // namespace
}  // namespace haptrace
