#include "studies/stability_map.h"

#include "control/velocity_estimator.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

namespace haptrace {
namespace {

/// Returns the reference device, without the effects that a PlantModel lacks.
PlantModel reference_plant() {
  PlantModel plant;
  plant.mass = Vec3(0.4, 0.4, 0.3);
  plant.viscous = Vec3::Constant(1.8);
  plant.coulomb = Vec3::Constant(0.7);
  plant.delay = 1.5e-3;
  plant.position_resolution = 5e-5;
  return plant;
}

PdGains gains(double kp, double kd) {
  return {Vec3::Constant(kp), Vec3::Constant(kd)};
}

StabilityOptions small_map() {
  StabilityOptions options;
  options.lag = 0.5e-3;
  options.axis = 0;
  options.kp_cells = 8;
  options.kd_cells = 7;
  return options;
}

StabilityMap map_of(const PlantModel& plant, const PdGains& gains, const StabilityOptions& options) {
  const auto map = stability_map(plant, gains, options, StopRequest());
  EXPECT_TRUE(map);
  return map.value_or(StabilityMap{});
}

/// A random linear plant in the ranges of the supported devices, and the settings of its loop.
struct RandomPlant {
  RandomPlant(unsigned seed, bool observed) {
    std::mt19937 engine(seed);
    const auto even = [&](double low, double high) {
      return low + (high - low) * static_cast<double>(engine()) / 4294967296.0;
    };
    const auto ratio = [&](double low, double high) { return low * std::pow(high / low, even(0, 1)); };
    const auto names = velocity_estimator_names();
    options.velocity = names[seed % names.size()];
    options.rate_hz = std::round(ratio(500, 4000));
    options.lag = engine() % 3 == 0 ? 0 : even(0, 1e-3);
    plant.mass = Vec3::Constant(ratio(0.05, 1));
    plant.viscous = Vec3::Constant(ratio(0.1, 3));
    plant.delay = options.lag + even(0, 3e-3);
    plant.position_resolution = 5e-5;
    if (observed) options.observer = {ratio(3, 30), plant.mass.x() * ratio(0.4, 2)};
    LoopModel loop = loop_of(plant, 0, options.rate_hz, options.velocity, options.lag);
    loop.observer = options.observer;
    const LoopAnalysis analysis(loop);
    const double most = analysis.most_damped(1e-6 * loop.mass * loop.rate_hz * loop.rate_hz);
    for (AxisGains& pair : boundary) {
      pair.kd = most * ratio(0.005, 0.95);
      pair.kp = analysis.stiffest(pair.kd);
    }
  }

  PlantModel plant;
  StabilityOptions options;
  std::array<AxisGains, 3> boundary;  ///< Stability limits by analysis.
};

class RandomPlants : public testing::TestWithParam<bool> {};

TEST_P(RandomPlants, AreStableInSimulationUpToTheAnalysedBoundaryWithinFivePerCent) {
  for (unsigned seed = 1; seed <= 40; ++seed) {
    const RandomPlant random(seed, GetParam());
    const auto simulated = [&](double factor) {
      auto pairs = random.boundary;
      for (AxisGains& pair : pairs) pair.kp *= factor;
      return simulate_stability(random.plant, 0, pairs, random.options, false);
    };
    const auto below = simulated(0.95), above = simulated(1.05);
    for (std::size_t i = 0; i < 3; ++i) {
      ASSERT_GT(random.boundary[i].kp, 0) << seed;
      EXPECT_TRUE(below[i]) << "plant " << seed << ", kd " << random.boundary[i].kd;
      EXPECT_FALSE(above[i]) << "plant " << seed << ", kd " << random.boundary[i].kd;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, RandomPlants, testing::Bool());

TEST(StabilityMap, BoundariesOfAnalysisAndSimulationAgreeAndSeparateTheCells) {
  const StabilityMap map = map_of(reference_plant(), gains(500, 6), small_map());
  ASSERT_EQ(map.kd.size(), 7U);
  ASSERT_EQ(map.kp.size(), 8U);
  ASSERT_EQ(map.cells.size(), 56U);
  int stable = 0, passive = 0;
  for (std::size_t column = 0; column < 7; ++column) {
    const StabilityBoundary& boundary = map.boundaries[column];
    const double expected = boundary.stable > map.kp.front() ? boundary.stable : 0;
    EXPECT_NEAR(boundary.simulated, expected, 0.05 * expected) << column;
    EXPECT_LE(boundary.passive, boundary.stable);
    for (std::size_t row = 0; row < 8; ++row) {
      const StabilityCell& cell = map.cells[8 * column + row];
      EXPECT_EQ(cell.stable, map.kp[row] < boundary.stable) << column << " " << row;
      EXPECT_EQ(cell.simulated, map.kp[row] <= boundary.simulated) << column << " " << row;
      EXPECT_EQ(cell.passive, map.kp[row] <= boundary.passive) << column << " " << row;
      EXPECT_TRUE(cell.stable || !cell.passive);
      stable += cell.stable;
      passive += cell.passive;
    }
  }
  EXPECT_GT(stable, 10);
  EXPECT_GT(passive, 2);
  EXPECT_TRUE(map.at_present.stable && map.at_present.simulated && map.at_present.simulated_fully);
  EXPECT_GT(map.margins.modulus, 0.4);
  EXPECT_GT(map.suggested.kp, 1000);
}

TEST(StabilityMap, IsTheSameOnAnyNumberOfThreads) {
  StabilityOptions options = small_map();
  options.observer = {10, 0.4};
  options.threads = 1;
  const std::string one = to_json(map_of(reference_plant(), gains(500, 6), options)).dump();
  options.threads = 5;
  EXPECT_EQ(to_json(map_of(reference_plant(), gains(500, 6), options)).dump(), one);
}

TEST(StabilityMap, FrictionCalmsAnUnstableLoopAndACoarseResolutionMakesItBuzz) {
  PlantModel plant = reference_plant();
  const LoopAnalysis analysis(loop_of(plant, 0, 1000, "difference", 0.5e-3));
  StabilityOptions options = small_map();
  options.velocity = "difference";
  const AxisGains beyond{1.5 * analysis.stiffest(2), 2};
  const auto calm = [&] { return simulate_stability(plant, 0, {beyond, beyond, beyond}, options, true)[1]; };
  EXPECT_FALSE(simulate_stability(plant, 0, {beyond, beyond, beyond}, options, false)[0]);
  EXPECT_TRUE(calm());
  plant.coulomb.setZero();
  EXPECT_FALSE(calm());
  // Abbott and Okamura 2005: a kp above 2 F_c / resolution makes the device buzz, whatever its damping.
  plant.viscous.setConstant(100);
  plant.coulomb.setConstant(0.1);
  EXPECT_TRUE(calm());
  plant.position_resolution = 5e-3;
  options.kick = 20e-3;
  EXPECT_TRUE(simulate_stability(plant, 0, {beyond, beyond, beyond}, options, false)[0]);
}

TEST(StabilityMap, OneAxisThatDivergesLeavesTheOthersAlone) {
  const PlantModel plant = reference_plant();
  const AxisGains good{500, 6}, wild{1e5, 1e3};
  const AxisGains growing{1.02 * LoopAnalysis(loop_of(plant, 0, 1000, "lowpass:100", 0.5e-3)).stiffest(6), 6};
  EXPECT_THAT(simulate_stability(plant, 0, {good, wild, growing}, small_map(), false),
              testing::ElementsAre(true, false, false));
  EXPECT_THAT(simulate_stability(plant, 0, {good, wild, good}, small_map(), true),
              testing::ElementsAre(true, false, true));
}

TEST(StabilityMap, ChoosesTheAxisWithTheSmallestMargin) {
  StabilityOptions options = small_map();
  options.axis.reset();
  options.kp_cells = options.kd_cells = 2;
  PlantModel plant = reference_plant();
  plant.mass = Vec3(0.4, 0.4, 0.04);
  EXPECT_EQ(map_of(plant, gains(3000, 25), options).axis, 2);
  plant.viscous = Vec3(1.8, 0.01, 1.8);
  plant.mass = Vec3::Constant(0.4);
  EXPECT_EQ(map_of(plant, gains(500, 0.5), options).axis, 1);
}

TEST(StabilityMap, ContainsThePresentGainsWhereverTheyAre) {
  StabilityOptions options = small_map();
  options.kp_cells = options.kd_cells = 3;
  for (const auto& present : {gains(1, 1e-3), gains(9e4, 900), gains(0, 0)}) {
    const StabilityMap map = map_of(reference_plant(), present, options);
    EXPECT_GE(map.kp.back(), map.present.kp);
    EXPECT_GE(map.kd.back(), map.present.kd);
    if (map.present.kp > 0) {
      EXPECT_LE(map.kp.front(), map.present.kp);
    } else {
      EXPECT_FALSE(map.at_present.stable || map.at_present.simulated);
    }
  }
}

TEST(StabilityMap, ReportsItsProgressAndCanBeStopped) {
  double last = 0;
  StopRequest stop;
  const auto map = stability_map(reference_plant(), gains(500, 6), small_map(), stop, [&](double part) {
    EXPECT_GE(part, last);
    EXPECT_LE(part, 1);
    last = part;
  });
  EXPECT_TRUE(map);
  EXPECT_GT(last, 0.99);
  stop.raise();
  EXPECT_FALSE(stability_map(reference_plant(), gains(500, 6), small_map(), stop));
}

TEST(StabilityMap, IsWrittenAsJsonAndDrawn) {
  const StabilityMap map = map_of(reference_plant(), gains(500, 6), small_map());
  const nlohmann::json json = to_json(map);
  EXPECT_EQ(json["axis"], "x");
  EXPECT_EQ(json["cells"]["stable"].size(), 7U);
  EXPECT_EQ(json["cells"]["stable"][0].size(), 8U);
  EXPECT_EQ(json["largest_kp"]["simulated_fully"].size(), 7U);
  EXPECT_EQ(json["present"]["kp"], 500);
  EXPECT_EQ(json["present"]["stable"], true);
  EXPECT_NEAR(json["present"]["margins"]["modulus"], map.margins.modulus, 1e-12);

  const Figure figure = figure_of(map);
  ASSERT_EQ(figure.rows.size(), 1U);
  ASSERT_EQ(figure.rows[0].size(), 2U);
  std::vector<std::string> labels;
  for (const Series& series : figure.rows[0][0].series) labels.push_back(series.label);
  EXPECT_THAT(labels, testing::IsSupersetOf({"stable", "simulated", "passive", "present", "suggested"}));
}

TEST(StabilityMap, NamesTheOptionThatIsOutOfItsRange) {
  const auto error_of = [](const StabilityOptions& options, const PdGains& present) {
    return test::error_of([&] { (void)stability_map(reference_plant(), present, options, StopRequest()); });
  };
  StabilityOptions options = small_map();
  EXPECT_THAT(error_of(options, gains(-1, 0)), testing::HasSubstr("kp of the x axis is -1"));
  options.kd_cells = 1;
  EXPECT_THAT(error_of(options, gains(500, 6)), testing::HasSubstr("1 cells"));
  options = small_map();
  options.axis = 3;
  EXPECT_THAT(error_of(options, gains(500, 6)), testing::HasSubstr("axis is 3"));
  options = small_map();
  options.rate_hz = 5;
  EXPECT_THAT(error_of(options, gains(500, 6)), testing::HasSubstr("rate is 5 Hz"));
  options = small_map();
  options.kick = 0;
  EXPECT_THAT(error_of(options, gains(500, 6)), testing::HasSubstr("kick is 0 m"));
}

}  // namespace
}  // namespace haptrace
