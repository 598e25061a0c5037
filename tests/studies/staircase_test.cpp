#include "studies/staircase.h"

#include "control/passivity_layer.h"
#include "devices/sim/sim_device.h"
#include "player/record.h"
#include "player/touching_controller.h"
#include "scene/scene_file.h"
#include "tests/support/errors.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using testing::AllOf;
using testing::HasSubstr;

StaircaseReport climbed(const StaircaseOptions& options) {
  const StopRequest stop;
  StaircaseReport report = staircase(options, stop);
  EXPECT_TRUE(report.complete);
  return report;
}

/// Returns a device of 0.2 kg with this damping and no other effects.
SimSpec bare_device(double viscous, double delay = 0) {
  SimSpec spec;
  spec.max_force = 1000;
  spec.mass.setConstant(0.2);
  spec.viscous.setConstant(viscous);
  spec.delay = delay;
  return spec;
}

const StaircaseTap& tap_of(const StaircaseReport& report, double rate_hz, double stiffness, bool supervised) {
  for (const StaircaseTap& tap : report.taps)
    if (tap.rate_hz == rate_hz && tap.stiffness == stiffness && !tap.friction && tap.supervised == supervised)
      return tap;
  throw std::out_of_range("no such tap");
}

TEST(Staircase, CreatesTheEnergyOfTheClosedForm) {
  const StaircaseReport report = climbed(
      {.rates = {100, 330, 1000, 5000, 20000}, .pressed = {300, 3000}, .phases = 16, .tapped = {100}, .watched = 1});
  ASSERT_EQ(report.presses.size(), 10U);
  for (const StaircasePress& press : report.presses) {
    SCOPED_TRACE(fmt::format("{} Hz, {} N/m", press.rate_hz, press.stiffness));
    EXPECT_NEAR(press.mean, press.expected, 3e-3 * press.expected);
    EXPECT_GE(press.least, press.expected - press.slack);
    EXPECT_LE(press.most, press.expected + press.slack);
    EXPECT_LT(press.least, press.most) << "the phase of the tick counts";
    // The expected energy is pi^2 / 4 times K T D^2 / t.
    EXPECT_NEAR(press.expected, 2.4674011 * press.stiffness / press.rate_hz * 5e-3 * 5e-3 / 0.2, 1e-6 * press.expected);
    EXPECT_LT(press.supervised, 0.25 * press.mean) << "the passivity layer takes it back while it comes about";
  }
  for (std::size_t i = 0; i + 1 < report.presses.size(); i += 2)
    EXPECT_NEAR(report.presses[i + 1].mean / report.presses[i].mean, 10, 1e-6) << "it grows with the stiffness";
  for (std::size_t i = 0; i + 2 < report.presses.size(); ++i)
    EXPECT_GT(report.presses[i].mean, report.presses[i + 2].mean) << "it grows with the period";
}

TEST(Staircase, IsAboveTheLineOnTheWayOutAndBelowItOnTheWayIn) {
  const StaircaseReport report =
      climbed({.rates = {200, 1000, 2000}, .pressed = {500}, .phases = 1, .tapped = {100}, .watched = 1});
  ASSERT_EQ(report.stairs.size(), 2U);
  EXPECT_EQ(report.stairs[1].rate_hz, 2000);
  for (const Stairs& stairs : report.stairs) {
    double area = 0;
    ASSERT_EQ(stairs.depth.size(), stairs.force.size());
    for (std::size_t i = 0; i + 1 < stairs.depth.size(); i += 2) {
      const double from = stairs.depth[i], to = stairs.depth[i + 1], line = 500 * std::max(to, 0.0);
      EXPECT_EQ(stairs.force[i], stairs.force[i + 1]) << "held";
      EXPECT_TRUE(to <= 0 || (to > from ? stairs.force[i] <= line + 1e-9 : stairs.force[i] >= line - 1e-9)) << i;
      area += stairs.force[i] * (from - to);
    }
    EXPECT_GT(area, 0);
  }
}

TEST(Staircase, BouncesWhereTheDeviceHasLessDampingThanTheWallNeeds) {
  // The wall needs damping of K T / 2 or, with a delay and for slow movements, K (T / 2 + delay).
  for (const double delay : {0.0, 1e-3}) {
    const double viscous = 2;
    StaircaseOptions options{
        .rates = {500, 2000}, .pressed = {1000}, .phases = 1, .device = bare_device(viscous, delay)};
    for (const double rate : options.rates) {
      const double stable_up_to = viscous / (0.5 / rate + delay);
      options.tapped = {0.75 * stable_up_to, 1.4 * stable_up_to};
      StaircaseOptions at_this = options;
      at_this.rates = {rate};
      const StaircaseReport report = climbed(at_this);
      SCOPED_TRACE(fmt::format("{} Hz, {} s late: stable up to {:.0f} N/m", rate, delay, stable_up_to));
      EXPECT_TRUE(tap_of(report, rate, options.tapped[0], false).calm);
      EXPECT_FALSE(tap_of(report, rate, options.tapped[1], false).calm);
      EXPECT_NEAR(report.passive_up_to(rate), stable_up_to, delay > 0 ? 0.3 * stable_up_to : 1e-3 * stable_up_to);
      EXPECT_EQ(report.calm_up_to(rate, false, false), options.tapped[0]);
    }
  }
}

TEST(Staircase, ABouncingWallComesToRestWithThePassivityLayer) {
  StaircaseOptions options{.rates = {250, 1000, 4000}, .pressed = {1000}, .phases = 1};
  for (const double delay : {0.0, 1e-3}) {
    options.device = bare_device(0.5, delay);
    for (const double rate : options.rates) {
      StaircaseOptions at_this = options;
      at_this.rates = {rate};
      const double wall = 5 * 0.5 / (0.5 / rate + delay);  // five times the stiffness that the device withstands
      at_this.tapped = {wall};
      const StaircaseReport report = climbed(at_this);
      const StaircaseTap &bare = tap_of(report, rate, wall, false), &kept = tap_of(report, rate, wall, true);
      SCOPED_TRACE(fmt::format("{} Hz, {} s late, {:.0f} N/m", rate, delay, wall));
      EXPECT_FALSE(bare.calm);
      EXPECT_TRUE(kept.calm);
      // The energy that arises within half a tick and the delay at the speed of the fall, sqrt(2 F h / m).
      const double tick = wall * std::pow(0.5 / rate + delay, 2) * 2 * 1.0 * 5e-3 / 0.2;
      EXPECT_LT(kept.created, 6 * tick);
      EXPECT_GT(bare.created, 10 * kept.created);
    }
  }
}

TEST(Staircase, PressesASceneFromAFile) {
  StaircaseOptions options{.rates = {500},
                           .scene = nlohmann::json::parse(R"({"objects": [
      {"kind": "wall", "point": [0, 0, -0.02], "normal": [0.6, 0, 0.8], "stiffness": 800}]})"),
                           .phases = 4,
                           .watched = 1};
  const StaircaseReport report = climbed(options);
  ASSERT_EQ(report.presses.size(), 1U);
  EXPECT_EQ(report.presses[0].stiffness, 800);
  EXPECT_NEAR(report.presses[0].mean, report.presses[0].expected, report.presses[0].slack);
  ASSERT_EQ(report.taps.size(), 4U);
  EXPECT_GT(report.taps[0].created, 0);

  options.scene = nlohmann::json::parse(R"({"objects": [{"kind": "wall", "point": [0, 0, 0]}]})");
  options.scene_name = "mine.json";
  EXPECT_THAT(test::error_of([&] { staircase(options, {}); }), AllOf(HasSubstr("mine.json"), HasSubstr("normal")));
  options.scene = nullptr;
  options.rates = {1};
  EXPECT_THAT(test::error_of([&] { staircase(options, {}); }), HasSubstr("the rate is 1 Hz"));
}

TEST(Staircase, IsTheSameOnAnyNumberOfThreadsAndEndsWhenAskedTo) {
  StaircaseOptions options{.rates = {100, 1000}, .pressed = {500}, .phases = 2, .tapped = {100, 1000}, .watched = 1};
  options.threads = 1;
  const StaircaseReport one = climbed(options);
  options.threads = 3;
  EXPECT_EQ(to_json(one), to_json(climbed(options)));
  EXPECT_THAT(text_of(one), AllOf(HasSubstr("closed form"), HasSubstr("layer on")));
  EXPECT_EQ(figure_of(one).rows.size(), 3U);
  StopRequest stop;
  stop.raise();
  EXPECT_FALSE(staircase(options, stop).complete);
}

TEST(SceneSession, IsSupervisedWhenTheSceneSaysSo) {
  // An uncalibrated device is assumed to be light and late; a calibrated one has its identified values.
  const PassivityLayer::Options unknown = passivity_for(std::nullopt, 1000, 0);
  EXPECT_EQ(unknown.delay, 5e-3);
  PlantModel plant{.mass = Vec3(0.4, 0.3, 0.5), .viscous = Vec3::Constant(1), .delay = 1e-3};
  const PassivityLayer::Options known = passivity_for(plant, 1000, 0);
  EXPECT_EQ(known.delay, 1e-3);
  EXPECT_GT(known.max_damping, 3 * unknown.max_damping);
  // An axis without a motor has no identified values, and the delay of a fast loop exceeds the range of the analysis.
  const PlantModel planar{.mass = Vec3(0.06, 0.06, 0), .viscous = Vec3(1, 1, 0), .delay = 1e-3};
  EXPECT_NEAR(passivity_for(planar, 1000, 0).max_damping,
              bearable_damping({.mass = 0.06, .viscous = 1, .delay = 1e-3, .rate_hz = 1000}), 1e-12);
  EXPECT_EQ(passivity_for(std::nullopt, 20000, 0).delay, 5e-3);
  EXPECT_NEAR(known.max_damping, bearable_damping({.mass = 0.3, .viscous = 1, .delay = 1e-3, .rate_hz = 1000}), 1e-12);

  // Gravity presses a device onto a wall that needs five times its damping: with the layer it stays there.
  SimSpec spec = bare_device(0.5);
  spec.gravity_bias = Vec3(0, 0, -1);
  const auto touched = [&](const char* scene) {
    SimDevice device(spec);
    RecordOptions options{.duration = 4};
    options.session.loop.watch_vibration = false;  // which would soften what the layer is to calm
    options.session.touch.scene = read_scene(nlohmann::json::parse(scene), "a scene");
    options.identified = [&](const DeviceInfo&) {
      return std::optional(PlantModel{.mass = spec.mass, .viscous = spec.viscous});
    };
    return record(device, options, {}).touches.at(0).seconds;
  };
  EXPECT_GT(touched(R"({"objects": [{"kind": "wall", "point": [0, 0, -0.005], "normal": [0, 0, 1], "stiffness": 5000}],
                        "passivity": true})"),
            3);
  EXPECT_LT(
      touched(R"({"objects": [{"kind": "wall", "point": [0, 0, -0.005], "normal": [0, 0, 1], "stiffness": 5000}]})"),
      2);
}

}  // namespace
}  // namespace haptrace
