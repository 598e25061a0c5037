#include "studies/trade/workbench.h"

#include "base/json_reader.h"
#include "scene/scene_file.h"
#include "scene/scene_files.h"
#include "studies/trade/instruction_count.h"
#include "studies/trade/scene_trade.h"
#include "studies/trade/side_trades.h"
#include "tests/scene/meshes.h"
#include "tests/studies/trade/support.h"
#include "tests/support/errors.h"
#include "tests/support/temp_folder.h"

#include <csignal>
#include <gmock/gmock.h>
#include <thread>

namespace haptrace {
namespace {

using test::full_configuration;
using test::small_workplace;
using testing::HasSubstr;

TEST(InstructionCount, CountsTheInstructionsOfALoop) {
  volatile double sink = 0;
  const std::vector<std::uint64_t> counted = count_instructions(
      [&](const std::function<void()>& mark) {
        mark();
        for (const int times : {0, 1000, 3000}) {
          for (int i = 0; i < times; ++i) sink = sink + 1;
          mark();
        }
      },
      3);
  if (counted.empty()) GTEST_SKIP() << "neither a counter nor single steps are allowed here";
  ASSERT_EQ(counted.size(), 3U);
  EXPECT_LT(counted[0], 2000U);
  // Every iteration of the loop takes the same number of instructions.
  const double one = static_cast<double>(counted[2] - counted[1]) / 2000;
  EXPECT_GE(one, 3);
  EXPECT_LE(one, 20);
  EXPECT_NEAR(static_cast<double>(counted[1] - counted[0]), 1000 * one, 100);
}

TEST(InstructionCount, ReturnsNothingWhenThereAreTooFewMarks) {
  EXPECT_TRUE(count_instructions([](const std::function<void()>& mark) { mark(); }).empty());
  EXPECT_TRUE(count_instructions([](const std::function<void()>&) {}).empty());
}

TEST(InstructionCount, ContinuesThroughSignalsThatTheWorkIgnores) {
  const auto before = std::signal(SIGWINCH, SIG_IGN);
  const auto counted = count_instructions([](const std::function<void()>& mark) {
    mark();
    (void)raise(SIGWINCH);
    mark();
  });
  std::signal(SIGWINCH, before);
  if (count_instructions([](const std::function<void()>& mark) { mark(), mark(); }).empty())
    GTEST_SKIP() << "neither a counter nor single steps are allowed here";
  EXPECT_EQ(counted.size(), 1U);
}

TEST(Workbench, GivesTheSameToTheLastBitWhateverTheThread) {
  Workbench bench(small_workplace());
  bench.measure_forces_against(full_configuration(), 2, StopRequest{});
  const Configuration plain{.rate_hz = 500};
  const Outcome here = bench.judge(plain, 2);
  ASSERT_TRUE(here.ran()) << here.refused;
  Outcome there;
  std::jthread([&] { there = Workbench(small_workplace()).judge(plain, 2); }).join();
  EXPECT_EQ(here.error.mean, there.error.mean);
  EXPECT_EQ(here.error.half_width, there.error.half_width);
  EXPECT_EQ(here.peak.mean, there.peak.mean);
  EXPECT_EQ(here.ripple.mean, there.ripple.mean);
  EXPECT_GT(here.error.half_width, 0);  // hands differ by the seed
  EXPECT_GT(here.force.mean, 0);
  EXPECT_NEAR(bench.judge(full_configuration(), 2).force.mean, 0, 1e-12);
}

TEST(Workbench, MatchesTheMetricsOfPlay) {
  Workplace place = small_workplace();
  Workbench bench(place);
  const Configuration configuration = full_configuration();
  const Outcome outcome = bench.judge(configuration, 1);
  const auto device = place.open(place.seed);
  const PlayOptions options = bench.options_for(configuration);
  const PlayResult played = play(*device, plan_playback(device->info(), place.path, options), options, StopRequest{});
  EXPECT_EQ(outcome.rms_error.mean, played.last.rms_error);
  EXPECT_EQ(outcome.peak_error.mean, played.last.peak_error);
  EXPECT_EQ(outcome.ripple.mean, played.last.force_ripple);
  // Without noise in the path, the reference equals the path.
  EXPECT_NEAR(outcome.error.mean, played.last.rms_error, 1e-9);
}

TEST(Workbench, WidensIntervalsByTheModelErrorAndHasNoneForOneRun) {
  Workplace place = small_workplace();
  const Outcome sure = Workbench(place).judge(full_configuration(), 2);
  EXPECT_EQ(Workbench(place).judge(full_configuration(), 1).error.half_width, std::numeric_limits<double>::infinity());
  place.model_error = 0.3;
  const Outcome unsure = Workbench(place).judge(full_configuration(), 2);
  ASSERT_TRUE(unsure.ran());
  EXPECT_EQ(unsure.error.mean, sure.error.mean);
  EXPECT_DOUBLE_EQ(unsure.error.half_width, std::hypot(sure.error.half_width, 0.3 * sure.error.mean));
  // If every run is the same, only the model's error remains.
  place.varies = false;
  const Outcome one = Workbench(place).judge(full_configuration(), 1);
  EXPECT_DOUBLE_EQ(one.error.half_width, 0.3 * one.error.mean);
}

TEST(Workbench, JudgesByThePathThatWasGivenAndNotByTheReferenceThatIsFollowed) {
  const Workbench bench(small_workplace());
  Configuration coarse = full_configuration();
  coarse.thin = 100;
  coarse.interpolation = Interpolation::linear;  // a polygon of ten sides
  const Outcome exact = bench.judge(full_configuration(), 1), polygon = bench.judge(coarse, 1);
  ASSERT_TRUE(polygon.ran()) << polygon.refused;
  EXPECT_GT(polygon.error.mean, 1.5 * polygon.rms_error.mean);
  EXPECT_GT(polygon.error.mean, 3 * exact.error.mean);
}

TEST(Workbench, ReportsWhyAConfigurationCannotRun) {
  const Workbench bench(small_workplace());
  Configuration fast = full_configuration();
  fast.speed = 100;
  const Outcome refused = bench.judge(fast, 1);
  EXPECT_FALSE(refused.ran());
  EXPECT_THAT(refused.refused, HasSubstr("off the path"));

  Workplace coarse = small_workplace();
  coarse.profile->coarse = true;
  const Workbench held(coarse);
  EXPECT_TRUE(held.judge(full_configuration(), 1).ran());
  Configuration other = full_configuration();
  other.rate_hz = 500;
  EXPECT_THAT(held.judge(other, 1).refused, HasSubstr("1000 Hz"));
}

TEST(Workbench, FindsLessMarginForStifferGains) {
  Workplace place = small_workplace();
  place.profile.reset();
  place.play.gains = PdGains{Vec3::Constant(500), Vec3::Constant(6)};
  const auto margin_of = [&](double kp, double kd) {
    Workplace one = place;
    one.play.gains = PdGains{Vec3::Constant(kp), Vec3::Constant(kd)};
    const Workbench bench(one);
    Outcome outcome = bench.judge({}, 1);
    bench.find_margin(outcome);
    return outcome.margin;
  };
  EXPECT_EQ(margin_of(500, 6), 4);
  EXPECT_LT(margin_of(9000, 30), 4);
}

TEST(Workbench, ChargesEachTermItsCostAndNothingForAbsentTerms) {
  const Workbench bench(small_workplace());
  const Configuration plain;
  const double base = bench.count_ticks(plain);
  if (!std::isfinite(base)) GTEST_SKIP() << "instructions cannot be counted here";
  EXPECT_NEAR(bench.count_ticks(plain), base, 0.02 * base);  // another clock reading takes 1.4 %
  const auto with = [&](bool Compensations::*member) {
    Configuration configuration;
    configuration.with.*member = true;
    return bench.count_ticks(configuration) - base;
  };
  const double inertia = with(&Compensations::inertia), observer = with(&Compensations::observer);
  EXPECT_GT(inertia, 20);
  EXPECT_GT(observer, inertia);
  // The costs of the terms add up; an absent term costs nothing. The vibration monitor takes a quarter more for a noisy
  // force, and either of these terms makes the force noisy.
  Configuration both;
  both.with.inertia = both.with.observer = true;
  EXPECT_NEAR(bench.count_ticks(both), base + inertia + observer, 0.05 * base);

  Outcome outcome = bench.judge(plain, 1);
  bench.time_ticks(outcome);
  EXPECT_GT(outcome.control, 0);
  EXPECT_GE(outcome.tick, outcome.control);
  EXPECT_GT(outcome.start, 0);
}

TEST(SideTrades, StoreLessForMoreTimeAndKeepTheirBounds) {
  const Workbench bench(small_workplace());
  const SideTrade trade = trade_of_storage(bench, full_configuration(), StopRequest{});
  ASSERT_EQ(trade.levels.size(), storage_levels().size());
  const double plain = trade.levels[0].values[0];
  for (std::size_t i = 0; i < trade.levels.size(); ++i) {
    const SideTrade::Level& level = trade.levels[i];
    ASSERT_EQ(level.refused, "");
    const Precision& precision = storage_levels()[i].storage.precision;
    EXPECT_LE(level.values[1], precision.position) << level.level;
    EXPECT_LE(level.values[2], precision.force) << level.level;
    if (i > 0) {
      EXPECT_LT(level.values[0], plain) << level.level;
    }
  }
}

TEST(SideTrades, CompareASceneWithItselfInContinuousTime) {
  const Workbench bench(small_workplace());
  const auto load = [] {
    return read_scene({{"objects",
                        {{{"kind", "wall"},
                          {"name", "floor"},
                          {"point", {0, 0.005, 0}},
                          {"normal", {0, 1, 0}},
                          {"stiffness", 800},
                          {"damping", 3}}}}},
                      "the test's scene");
  };
  const SideTrade trade = SceneBench(bench, 1000, load, false).trade();
  const auto error_of_level = [&](const std::string& name) {
    for (const SideTrade::Level& level : trade.levels)
      if (level.level.starts_with(name)) return level.values[0];
    ADD_FAILURE() << name;
    return kNaN;
  };
  // Half a tick at 0.1 m/s is 0.04 N of the spring; the true force includes the damper's 0.3 N as well.
  EXPECT_LT(error_of_level("as it is"), 0.04);
  EXPECT_LT(error_of_level("floor.lead 0.5"), 0.2 * error_of_level("floor.lead 0 "));
  EXPECT_LT(error_of_level("at 100 Hz, model"), error_of_level("at 100 Hz, hold"));
  EXPECT_LT(error_of_level("at 100 Hz, hold"), error_of_level("at 50 Hz, hold"));

  const auto away = [] {
    return read_scene({{"objects", {{{"kind", "sphere"}, {"centre", {1, 1, 1}}, {"radius", 0.01}, {"stiffness", 1}}}}},
                      "far away");
  };
  EXPECT_FALSE(SceneBench(bench, 1000, away, false).touches());
  EXPECT_TRUE(SceneBench(bench, 1000, away, false).trade().levels.empty());
}

/// A wall with a texture of four octaves, across the path of small_workplace().
nlohmann::json textured_wall() {
  return parse_json(R"({"objects": [{"kind": "wall", "name": "floor", "point": [0, 0.005, 0], "normal": [0, 1, 0],
    "surface": {"stiffness": 800, "texture": {"kind": "fractal", "amplitude": 2e-4, "wavelength": 4e-3, "octaves": 4}}}]})",
                    "the test's scene");
}

TEST(SceneBudgets, ChooseTheCheapestSettingsWhoseErrorIsSmallEnough) {
  const Workbench bench(small_workplace());
  const SceneBench scene(
      bench, 1000, [] { return read_scene(textured_wall(), "the test's scene"); }, true);
  const SceneChoice exact = scene.choose(parse_scene_budget("time<=1s"), StopRequest{});
  EXPECT_TRUE(exact.kept);
  const SceneChoice cheap = scene.choose(parse_scene_budget("error<=10N"), StopRequest{});
  EXPECT_TRUE(cheap.kept);
  EXPECT_LT(cheap.levels.at("floor.octaves"), exact.levels.at("floor.octaves"));
  EXPECT_GT(cheap.error, exact.error);
  const SceneChoice between = scene.choose({.error = 0.5 * (cheap.error + exact.error)}, StopRequest{});
  EXPECT_TRUE(between.kept);
  EXPECT_LE(between.error, 0.5 * (cheap.error + exact.error));
  const SceneChoice nearest = scene.choose({.error = 1e-3 * exact.error}, StopRequest{});
  EXPECT_FALSE(nearest.kept);
  EXPECT_DOUBLE_EQ(nearest.error, exact.error);
}

TEST(SceneBudgets, WriteTheSettingsWhereTheSceneFileHasThem) {
  const nlohmann::json changed = scene_with(textured_wall(), "", {{"floor.octaves", 2}, {"floor.lead", 0.5}});
  EXPECT_EQ(changed["objects"][0]["surface"]["texture"]["octaves"], 2);
  EXPECT_EQ(changed["objects"][0]["surface"]["lead"], 0.5);
  EXPECT_EQ(scene_with(textured_wall(), "", {{"floor.octaves", 4}}), textured_wall()) << "it has that level already";
  EXPECT_THAT(test::error_of([] {
                (void)scene_with(textured_wall(), "", {{"floor.teeth", 2}});
              }),
              testing::HasSubstr("'floor.teeth'"));
}

TEST(SceneBudgets, ChooseTheNumberOfTrianglesOfAMesh) {
  const Workbench bench(small_workplace());
  const test::TempFolder folder;
  TriangleMesh ball;
  test::join(ball, test::bumpy_sphere(0.05, 0.0015, 10'000), Vec3(0, -0.045, 0));
  (void)folder.write("ball.obj", test::obj_of(ball));
  const nlohmann::json described = parse_json(R"({"objects": [{"name": "ball",
    "shape": {"kind": "mesh", "file": "ball.obj"}, "surface": {"stiffness": 800}}]})",
                                              "the test's scene");
  const auto load = [&] {
    SceneFiles files(folder.path());
    return read_scene(described, "the test's scene", files);
  };
  const SceneBench scene(bench, 1000, load, false);
  ASSERT_TRUE(scene.touches());
  std::vector<double> errors;
  for (const SideTrade::Level& level : scene.trade().levels)
    if (level.level.starts_with("ball.triangles ")) errors.push_back(level.values[0]);
  ASSERT_EQ(errors.size(), 4U);
  EXPECT_LT(errors[1], errors[0]);
  EXPECT_LT(errors[2], errors[1]);
  EXPECT_LT(errors[3], errors[2]);

  const SceneChoice cheap = scene.choose({.error = 1.1 * errors[2], .time = 1}, StopRequest{});
  EXPECT_TRUE(cheap.kept);
  const SceneChoice exact = scene.choose(parse_scene_budget("time<=1s"), StopRequest{});
  EXPECT_EQ(exact.levels.at("ball.triangles"), 9800);
  // The scene's file takes everything that the budget can choose.
  const nlohmann::json changed =
      scene_with(described, folder.path(), {{"ball.triangles", 2450}, {"ball.verify", 1}, {"ball.rounds", 2}});
  const nlohmann::json& shape = changed["objects"][0]["shape"];
  EXPECT_EQ(shape["triangles"], 2450);
  EXPECT_TRUE(shape["triangles"].is_number_integer());
  EXPECT_EQ(shape["verify"], true);
  EXPECT_EQ(shape["rounds"], 2);
  SceneChoice many{.levels = {{"ball.triangles", 1'234'567}}};
  EXPECT_THAT(text_of(many, {.error = 1}), HasSubstr("ball.triangles 1234567\n"));
}

TEST(SceneBudgets, NameThePartThatIsWrong) {
  for (const auto& [text, part] : std::vector<std::pair<std::string, std::string>>{{"error<=20", "error<=20"},
                                                                                   {"error<=20mNs", "error<=20mNs"},
                                                                                   {"error>=1N", "error>=1N"},
                                                                                   {"eror<=1N", "error"},
                                                                                   {"error<=0N", "error<=0N"},
                                                                                   {"error<=1N,", "''"},
                                                                                   {"time<=2N", "time<=2N"}})
    EXPECT_THAT(test::error_of([&] { (void)parse_scene_budget(text); }), testing::HasSubstr(part)) << text;
  EXPECT_EQ(to_string(parse_scene_budget("error<=20mN,time <= 500ns")), "error<=0.02N, time<=500ns");
}

TEST(Workbench, CountsNoTicksOfAPathThatAThreadReads) {
  Workplace place = small_workplace();
  Path dense = make_shape("circle", {.size = 0.02, .duration = 1});
  const Trajectory smooth(dense, Interpolation::cubic);
  Path long_path{.name = "dense"};
  for (int i = 0; i < 70'000; ++i) {
    long_path.time.push_back(i / 70'000.0);
    long_path.position.push_back(smooth.sample(long_path.time.back()).position);
  }
  place.path = source_of(std::move(long_path));
  EXPECT_TRUE(std::isnan(Workbench(place).count_ticks({})));
}

TEST(SideTrades, LocateTheTraineeLessExactlyOnACoarserPath) {
  const Workbench bench(small_workplace());
  const SideTrade trade = trade_of_projection(bench, true, StopRequest{});
  ASSERT_GE(trade.levels.size(), 3U);
  EXPECT_LT(trade.levels.front().values[0], 1e-4);
  EXPECT_GT(trade.levels.back().values[0], 3 * trade.levels.front().values[0]);
}

}  // namespace
}  // namespace haptrace
