#include "player/calibration/calibration.h"

#include "control/path/shapes.h"
#include "devices/registry.h"
#include "devices/sim/presets.h"
#include "devices/sim/sim_device.h"
#include "formats/path/path_file.h"
#include "player/calibration/calibration_plan.h"
#include "studies/ensemble_draw.h"
#include "tests/support/allocations.h"
#include "tests/support/blind_device.h"
#include "tests/support/errors.h"
#include "tests/support/point_mass.h"
#include "tests/support/temp_folder.h"

#include <algorithm>
#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>

namespace haptrace {
namespace {

using test::error_of;
using test::PointMass;
using testing::HasSubstr;

SimSpec preset(const std::string& device, const std::string& hand) {
  nlohmann::json json = device_preset(device, "test");
  json["hand"] = hand == "none" ? nlohmann::json(hand) : hand_preset(hand, "test");
  return read_sim_spec(json, "test");
}

/// Only the measurement in the middle of the workspace.
CalibrationOptions options() {
  CalibrationOptions result{.places = false, .laws = false};
  result.session.loop.limits.max_velocity = 1.5;
  return result;
}

/// With places around the middle, and laws that are tried there.
CalibrationOptions whole() {
  CalibrationOptions result = options();
  result.places = result.laws = true;
  return result;
}

CalibrationResult calibrated(Device& device, const CalibrationOptions& chosen = options()) {
  return calibrate(device, chosen, StopRequest{});
}

/// A device that does not move, whatever the force, and keeps the last force.
class Rock final : public Device {
 public:
  Rock() {
    info_.name = "rock";
    info_.virtual_time = true;
    info_.max_force = 8;
    info_.workspace_min = Vec3::Constant(-0.1);
    info_.workspace_max = Vec3::Constant(0.1);
  }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double, DeviceState& state) noexcept override {
    last = wrench.force;
    state = {};
    return Status::ok;
  }
  void close() noexcept override {}
  Vec3 last = Vec3::Constant(kNaN);

 private:
  DeviceInfo info_;
};

TEST(Calibration, FindsAFalconThatAHandHolds) {
  SimDevice device(preset("falcon", "relaxed"));
  const CalibrationResult result = calibrated(device);
  ASSERT_TRUE(result.succeeded()) << result.reason;
  const PlantModel& plant = result.identification.plant;
  const SimSpec spec = preset("falcon", "relaxed");
  const Eigen::Matrix3d turn = device.plant().rotation();
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(plant.mass[axis], 0.4, 0.06);
    const double felt = turn.col(axis).cwiseAbs().dot(spec.coulomb);
    EXPECT_NEAR(plant.coulomb[axis], felt, 0.2 * felt);
    EXPECT_GT(result.identification.half_width.mass[axis], 0);
    EXPECT_GT(result.identification.half_width.coulomb[axis], 0);
  }
  EXPECT_NEAR(plant.delay, 1.5e-3, 0.5e-3);  // transport delay plus a lag of 0.5 ms
  EXPECT_NEAR(plant.position_resolution, 5e-5, 1e-6);
  EXPECT_GT(result.design->gains.kp.minCoeff(), 0);
}

TEST(Calibration, FindsTheAxesOfTheActuatorsInANoisyHandOnlyWhereTheyAreTurned) {
  CalibrationOptions chosen = options();
  chosen.laws = false;
  for (const std::uint64_t index : {0U, 1U, 2U, 17U}) {
    EnsembleDraw draw = draw_device(7, index);
    ASSERT_TRUE(draw.spec.hand);
    SimDevice turned(draw.spec, {.seed = draw.noise_seed});
    const CalibrationResult result = calibrated(turned, chosen);
    ASSERT_TRUE(result.succeeded()) << index << ": " << result.reason;
    ASSERT_TRUE(result.identification.plant.actuators) << index;
    // Each axis of the actuators lies along one that was found.
    const Eigen::Matrix3d same =
        (result.identification.plant.actuators->axes * turned.plant().rotation().transpose()).cwiseAbs();
    for (int axis = 0; axis < 3; ++axis) EXPECT_GT(same.row(axis).maxCoeff(), std::cos(0.15)) << index;

    draw.spec.rotation.setZero();
    SimDevice aligned(draw.spec, {.seed = draw.noise_seed});
    EXPECT_FALSE(calibrated(aligned, chosen).identification.plant.actuators) << index;
  }
}

TEST(Calibration, FindsTheCablesOfADeviceInAHandOnlyWhereThereAreSome) {
  CalibrationOptions chosen = options();
  chosen.places = true;
  for (const EnsembleKind kind : {EnsembleKind::cables, EnsembleKind::late}) {
    const EnsembleDraw draw = draw_device(1, 1, kind);
    SimDevice device(draw.spec, {.seed = draw.noise_seed});
    const CalibrationResult result = calibrated(device, chosen);
    ASSERT_TRUE(result.succeeded()) << result.reason;
    const auto& cogging = result.identification.plant.cogging;
    ASSERT_EQ(cogging.has_value(), kind == EnsembleKind::cables) << to_string(kind);
    if (!cogging) continue;
    EXPECT_EQ(cogging->waves.size(), 3U);
    for (const CoggingWave& wave : cogging->waves) {
      EXPECT_NEAR(wave.amplitude(), 1, 0.2);
      EXPECT_NEAR(2 * std::numbers::pi / wave.wave_number.norm(), 3e-3, 1e-5);
    }
  }
}

TEST(Calibration, FindsADeviceThatNowAndThenRepeatsAState) {
  class Repeating final : public Device {
   public:
    explicit Repeating(Device& device) : device_(device) {}
    [[nodiscard]] const DeviceInfo& info() const noexcept override { return device_.info(); }
    Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
      DeviceState newest;
      const Status status = device_.exchange(wrench, dt, newest);
      if (++calls_ % 25 != 0) {
        last_ = newest;
        last_.sequence = calls_;
      }
      state = last_;
      return status;
    }
    void close() noexcept override { device_.close(); }

   private:
    Device& device_;
    DeviceState last_;
    std::uint64_t calls_ = 0;
  };
  SimDevice device(preset("falcon", "relaxed"));
  Repeating repeating(device);
  const CalibrationResult result = calibrated(repeating);
  ASSERT_TRUE(result.succeeded()) << result.reason;
  EXPECT_GT(result.session.servo.stale, 300U);
  for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(result.identification.plant.mass[axis], 0.4, 0.06);
  EXPECT_NEAR(result.identification.plant.delay, 1.5e-3, 0.5e-3);
}

TEST(Calibration, FindsAnIdealMassExactly) {
  SimDevice device(preset("ideal", "none"));
  const CalibrationResult result = calibrated(device);
  ASSERT_TRUE(result.succeeded()) << result.reason;
  for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(result.identification.plant.mass[axis], 0.1, 0.002);
  EXPECT_LT(result.identification.plant.coulomb.maxCoeff(), 0.01);
  EXPECT_LT(result.identification.plant.delay, 0.1e-3);
}

TEST(Calibration, FindsMassesInAnArmThatTakesMostOfTheForceToDragAlong) {
  // The worst of an ensemble's first thousand draws when the device swung over its whole allowed range.
  for (const std::uint64_t index : {271U, 417U, 612U}) {
    const EnsembleDraw draw = draw_device(1, index);
    SimDevice device(draw.spec, {.seed = draw.noise_seed});
    const CalibrationResult result = calibrated(device);
    ASSERT_TRUE(result.succeeded()) << index << ": " << result.reason;
    const Eigen::Matrix3d turn = device.plant().rotation();
    const Eigen::Matrix3d mobility = turn.transpose() * draw.spec.mass.cwiseInverse().asDiagonal() * turn;
    for (int axis = 0; axis < 3; ++axis) {
      const double mass = 1 / mobility(axis, axis);
      EXPECT_NEAR(result.identification.plant.mass[axis], mass, 0.25 * mass) << index << ", "
                                                                             << "xyz"[axis];
    }
  }
}

TEST(Calibration, MeasuresAroundTheMiddleAndTriesItsLawsThere) {
  SimDevice device(preset("falcon", "relaxed"));
  double done = 0;
  CalibrationOptions chosen = whole();
  chosen.searching = [&](double share) { done = share; };
  const CalibrationResult result = calibrated(device, chosen);
  ASSERT_TRUE(result.succeeded()) << result.reason;
  EXPECT_EQ(done, 1);
  ASSERT_TRUE(result.held);
  EXPECT_FALSE(result.held->inertia) << "its mass is the same everywhere";
  EXPECT_FALSE(result.held->one_mass);
  const LawVerdict& normal = result.held->design(Firmness::normal).verdict;
  EXPECT_TRUE(normal.tried);
  EXPECT_EQ(normal.refused, "");
  EXPECT_GT(normal.improvement, 1.5);
  EXPECT_FALSE(result.held->design(Firmness::exact).verdict.tried) << "that is left to a full calibration";
  EXPECT_TRUE(result.identified().held);
}

TEST(Calibration, ReachesPlacesWhereTheDeviceHasAFifthOfItsMass) {
  // Gains for the middle would make it oscillate there.
  const EnsembleDraw draw = draw_device(1, 1, EnsembleKind::inertia_70);
  SimDevice device(draw.spec, {.seed = draw.noise_seed});
  const CalibrationResult result = calibrated(device, whole());
  ASSERT_TRUE(result.succeeded()) << result.reason;
  ASSERT_TRUE(result.held && result.held->inertia);
  EXPECT_NEAR(result.held->inertia->reach.minCoeff(), 1.1 * 0.06, 1e-9) << "it was at the farthest places";
  for (const double away : {0.02, 0.03, 0.04, 0.05, 0.06}) {
    const double truth =
        (1 + draw.spec.inertia_variation * std::cos(std::numbers::pi * away / draw.spec.inertia_length)) /
        (1 + draw.spec.inertia_variation);
    for (const Vec3& way : {Vec3(1, 0, 0), Vec3(0, -1, 0), Vec3(0, 0, 1)})
      EXPECT_LT((result.held->inertia->at(away * way) - Vec3::Constant(truth)).cwiseAbs().maxCoeff(), 0.15)
          << (away * way).transpose();
  }
}

TEST(Calibration, KeepsStiffPdControlAsTheLastResortOfADeviceThatIsStableUnderIt) {
  SimDevice strong(preset("falcon", "relaxed")), light(preset("touch", "relaxed"));
  const CalibrationResult stable = calibrated(strong, whole()), unstable = calibrated(light, whole());
  ASSERT_TRUE(stable.succeeded()) << stable.reason;
  EXPECT_EQ(stable.design->plain.kp, stiff_gains().kp);
  EXPECT_EQ(stable.design->plain.kd, stiff_gains().kd);
  ASSERT_TRUE(unstable.succeeded()) << "its link swings, but it goes where it is pulled: " << unstable.reason;
  EXPECT_LT(unstable.design->plain.kp.maxCoeff(), 1000);
}

/// States a larger workspace than it has, and counts how often it comes near to a place.
class Obstructed final : public Device {
 public:
  Obstructed(Device& device, const Vec3& place) : device_(device), info_(device.info()), place_(place) {
    info_.workspace_min = Vec3::Constant(-0.1);
    info_.workspace_max = Vec3::Constant(0.1);
  }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
    const Status status = device_.exchange(wrench, dt, state);
    const double away = (state.position - place_).norm();
    if (!there_ && away < 0.015) ++visits;
    if (away < 0.015 || away > 0.03) there_ = away < 0.015;
    return status;
  }
  void close() noexcept override { device_.close(); }
  int visits = 0;

 private:
  Device& device_;
  DeviceInfo info_;
  Vec3 place_;
  bool there_ = false;
};

/// A device with backlash and cables. It is late, and its mass varies over the workspace.
SimSpec slack_device() {
  SimSpec spec;
  spec.model = "slack device";
  spec.max_force = spec.max_continuous_force = 9;
  spec.delay = 3e-3;
  spec.actuator_bandwidth_hz = 300;
  spec.mass = Vec3::Constant(0.4);
  spec.inertia_variation = 0.4;
  spec.inertia_length = 0.06;
  spec.viscous = Vec3::Constant(2);
  spec.coulomb = Vec3::Constant(0.5);
  spec.gravity_bias = Vec3(0, 0, 1);
  spec.cogging = Vec3::Constant(1);
  spec.cogging_period = 3e-3;
  spec.workspace = {Vec3::Constant(-0.1), Vec3::Constant(0.1)};
  spec.structural_mode = {.frequency_hz = 150, .damping_ratio = 0.05, .handle_fraction = 0.3};
  spec.backlash = 2e-4;
  spec.position_resolution = 5e-5;
  spec.force_resolution = 5e-3;
  spec.hand = preset("falcon", "relaxed").hand;
  return spec;
}

/// Calibrates a device of the ensemble that has every hard property.
CalibrationResult calibrated_draw(std::uint64_t index, const CalibrationOptions& chosen = whole()) {
  const EnsembleDraw draw = draw_device(1, index, EnsembleKind::everything);
  SimDevice device(draw.spec, {.seed = draw.noise_seed});
  return calibrated(device, chosen);
}

TEST(Calibration, FindsMassAndCablesBehindABacklash) {
  const SimSpec spec = slack_device();
  SimDevice device(spec);
  CalibrationOptions chosen = whole();
  chosen.laws = false;
  const CalibrationResult result = calibrated(device, chosen);
  ASSERT_TRUE(result.succeeded()) << result.reason;
  ASSERT_TRUE(result.identification.coarse);
  const PlantModel& plant = result.identification.plant;
  const double mass = spec.mass.x() * (0.7 * (1 + spec.inertia_variation) + 0.3);
  for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(plant.mass[axis], mass, 0.25 * mass) << axis;
  ASSERT_TRUE(plant.cogging);
  ASSERT_EQ(plant.cogging->waves.size(), 3U);
  for (const CoggingWave& wave : plant.cogging->waves) {
    EXPECT_NEAR(wave.wave_number.norm(), 2 * std::numbers::pi / spec.cogging_period, 20);
    EXPECT_NEAR(wave.amplitude(), 1, 0.4);
  }
  EXPECT_FALSE(result.held) << "no laws were asked for";
}

TEST(Calibration, TriesLqgLawsForACoarseModelAndKeepsWhatIsClosest) {
  SimDevice device(slack_device());
  const CalibrationResult result = calibrated(device, whole());
  ASSERT_TRUE(result.succeeded()) << result.reason;
  ASSERT_TRUE(result.identification.coarse);
  ASSERT_TRUE(result.held);
  EXPECT_EQ(result.held->hand, HandKnown::assumed);
  const double delay = result.held->model.delay + result.held->model.lag;
  EXPECT_GE(delay, 3e-3);
  EXPECT_LE(delay, 4.5e-3);
  const LawVerdict &lqg = result.held->design(Firmness::normal).verdict, &observer = result.design->verdict;
  EXPECT_TRUE(lqg.tried);
  EXPECT_FALSE(result.held->design(Firmness::quiet).verdict.tried) << "too soft for what the model leaves unknown";
  if (lqg.refused.empty()) {
    EXPECT_TRUE(lqg.improvement == 0 || lqg.improvement >= 1) << lqg.improvement;
  }
  if (observer.refused.empty()) {
    EXPECT_TRUE(observer.improvement == 0 || observer.improvement >= 2) << observer.improvement;
  }
  EXPECT_TRUE(result.design->plain_calm);

  CalibrationOptions in_the_middle = whole();
  in_the_middle.places = false;
  const CalibrationResult quick = calibrated_draw(4, in_the_middle);
  ASSERT_TRUE(quick.succeeded()) << quick.reason;
  ASSERT_TRUE(quick.identification.coarse);
  EXPECT_FALSE(quick.held) << "nothing tried an LQG law";
  EXPECT_FALSE(quick.design->verdict.tried);
}

TEST(Calibration, TakesStiffPdControlForCalmThatOscillatesWithinABacklashOnly) {
  const CalibrationResult result = calibrated_draw(4);
  ASSERT_TRUE(result.succeeded()) << result.reason;
  ASSERT_TRUE(result.identification.coarse);
  EXPECT_TRUE(result.design->plain_calm);
  EXPECT_EQ(result.design->plain.kp, stiff_gains().kp);
  EXPECT_EQ(result.design->stiff_error, 0) << "it is what playbacks may choose";
}

TEST(Calibration, MakesACoarseModelOfADeviceWhoseFullOneFitsOnlyByChance) {
  const CalibrationResult result = calibrated_draw(17);
  ASSERT_TRUE(result.succeeded()) << result.reason;
  EXPECT_TRUE(result.identification.coarse);
  EXPECT_THAT(result.doubt, HasSubstr("forces that repeat over the place"));
  EXPECT_TRUE(result.identification.plant.cogging);
}

TEST(Calibration, LeavesPlainPdControlToACoarseModelOfWhichNoLawIsStable) {
  CalibrationOptions without_lqg = whole();
  without_lqg.laws = false;
  const CalibrationResult result = calibrated_draw(22, without_lqg);
  ASSERT_TRUE(result.succeeded()) << result.reason;
  EXPECT_EQ(result.bandwidth, 0);
  EXPECT_EQ(result.trials, 4);
  EXPECT_NE(result.design->verdict.refused, "");
  EXPECT_TRUE(result.design->plain_calm);

  CalibrationOptions in_the_middle = whole();
  in_the_middle.places = false;
  const CalibrationResult untried = calibrated_draw(22, in_the_middle);
  EXPECT_FALSE(untried.succeeded()) << "nothing tried plain PD control";
  EXPECT_THAT(untried.reason, HasSubstr("a control law for a coarse model failed"));
}

TEST(Calibration, FindsALinkThatSwingsInALooseHandAndNoDelayInItsPlace) {
  SimDevice device(preset("touch", "loose"));
  const CalibrationResult result = calibrated(device, whole());
  ASSERT_TRUE(result.succeeded()) << result.reason;
  EXPECT_NEAR(result.identification.plant.delay, 1.5e-3, 0.5e-3) << "to a rigid mass it seems to be 13 ms";
  ASSERT_TRUE(result.held);
  EXPECT_EQ(result.held->hand, HandKnown::identified);
  const LawVerdict& verdict = result.held->design(Firmness::normal).verdict;
  EXPECT_EQ(verdict.refused, "");
  EXPECT_GT(verdict.improvement, 5);
  EXPECT_GT(verdict.force, 0.1);
  EXPECT_LT(verdict.force, 1);
}

TEST(Calibration, FindsALawForAWeakDeviceWithACoarseEncoder) {
  SimDevice device(preset("haply2diy", "loose"));
  const CalibrationResult result = calibrated(device, whole());
  ASSERT_TRUE(result.succeeded()) << result.reason;
  const LqgDesign& design = result.held->design(Firmness::normal);
  EXPECT_LE(design.figures.ripple, kMostLawRipple * 1.6) << "else it chatters between two counts";
  EXPECT_EQ(design.verdict.refused, "");
  EXPECT_GT(design.verdict.improvement, 4.5);
}

TEST(Calibration, RefusesNoLawBecauseItsMotorsAreHotOrItsHandSwings) {
  SimDevice device(preset("touch", "relaxed"));
  const CalibrationResult result = calibrated(device, whole());
  ASSERT_TRUE(result.succeeded()) << result.reason;
  // The arm's spring takes more force at the places than the motors can hold.
  EXPECT_EQ(result.held->design(Firmness::quiet).verdict.refused, "");
  EXPECT_GT(result.held->design(Firmness::quiet).verdict.improvement, 5);
}

TEST(Calibration, TriesItsLawsAtAllFarthestPlacesThatItReachedAlsoIfItMissedANearerOne) {
  // A wall in front of the first of the nearer places.
  SimSpec spec = draw_device(1, 1, EnsembleKind::late).spec;
  spec.hand.reset();
  spec.workspace.max.x() = 0.015;
  SimDevice device(spec, {.seed = 1});
  Obstructed obstructed(device, Vec3(0, 0.06, 0));
  const CalibrationResult result = calibrated(obstructed, whole());
  ASSERT_TRUE(result.succeeded()) << result.reason;
  ASSERT_TRUE(result.held);
  EXPECT_TRUE(result.held->one_mass) << "it missed places";
  EXPECT_TRUE(result.held->design(Firmness::normal).verdict.tried);
  EXPECT_GE(obstructed.visits, 3) << "to measure, and under PD control and a law";
}

TEST(Calibration, LeavesOutThePlacesFromWhichAHandKeepsTheDevice) {
  // Its hand pulls back with more than the permitted force 30 mm from the centre.
  const EnsembleDraw draw = draw_device(1, 5);
  SimDevice device(draw.spec, {.seed = draw.noise_seed});
  const CalibrationResult result = calibrated(device, whole());
  ASSERT_TRUE(result.succeeded()) << result.reason;
  ASSERT_TRUE(result.held);
  EXPECT_TRUE(result.held->one_mass);
  EXPECT_TRUE(result.held->design(Firmness::normal).verdict.tried) << "at the places that it reached";
}

TEST(Calibration, RefusesAHandThatMovesOnPurposeOrStaysElsewhere) {
  // The hand's pull would become a gravity of the device, which playbacks cancel.
  const test::TempFolder folder;
  const std::string intent = folder / "intent.csv";
  for (const double size : {0.008, 0.02, 0.05}) {
    SCOPED_TRACE(size);
    save_path(make_shape("circle", {.size = size, .duration = 4}), intent, "intent", true);
    const auto device = open_device("sim:preset=falcon,hand=relaxed,intent=" + intent);
    const CalibrationResult result = calibrated(*device, whole());
    EXPECT_FALSE(result.succeeded());
    EXPECT_THAT(result.reason, HasSubstr("the motors bear 2.7 N for long: the hand moved"));
    EXPECT_FALSE(result.held);
  }
}

TEST(Calibration, DesignsForOtherMassesWhatItMeasuredInTheMiddleAlone) {
  SimDevice device(preset("falcon", "relaxed"));
  CalibrationOptions chosen = options();
  chosen.laws = true;
  const CalibrationResult result = calibrated(device, chosen);
  ASSERT_TRUE(result.held) << result.reason;
  EXPECT_TRUE(result.held->one_mass);
  EXPECT_FALSE(result.held->design(Firmness::normal).verdict.tried);
}

TEST(Calibration, LastsTenSecondsOrHalfAMinute) {
  SimDevice device(preset("falcon", "none"));
  CalibrationOptions chosen = options();
  EXPECT_NEAR(plan_calibration(device.info(), chosen).duration, 10, 0.5);
  chosen.full = true;
  EXPECT_NEAR(plan_calibration(device.info(), chosen).duration, 33, 3);
  EXPECT_NEAR(plan_calibration(device.info(), whole()).duration, 32, 2);
  EXPECT_EQ(plan_calibration(device.info(), whole()).places.size(), 6U);
}

TEST(Calibration, UsesOnlyTheMeasurementsOfASimulatedDevice) {
  const SimSpec spec = preset("falcon", "firm");
  SimDevice known(spec), same(spec);
  test::BlindDevice unknown(same);
  const CalibrationResult a = calibrated(known), b = calibrated(unknown);
  ASSERT_TRUE(a.succeeded()) << a.reason;
  ASSERT_TRUE(b.succeeded()) << b.reason;
  const PlantModel &p = a.identification.plant, &q = b.identification.plant;
  EXPECT_EQ(p.mass, q.mass);
  EXPECT_EQ(p.viscous, q.viscous);
  EXPECT_EQ(p.coulomb, q.coulomb);
  EXPECT_EQ(p.gravity, q.gravity);
  EXPECT_EQ(p.gravity_gradient, q.gravity_gradient);
  EXPECT_EQ(p.delay, q.delay);
  EXPECT_EQ(p.position_resolution, q.position_resolution);
  EXPECT_EQ(p.position_noise, q.position_noise);
  EXPECT_EQ(a.design->gains.kp, b.design->gains.kp);
}

TEST(Calibration, LeavesTheAxisOfAPlanarRobotThatHasNoMotorOut) {
  SimDevice device(preset("planar", "relaxed"));
  const CalibrationResult result = calibrated(device);
  ASSERT_TRUE(result.succeeded()) << result.reason;
  EXPECT_NEAR(result.identification.plant.mass.x(), 1, 0.15);
  EXPECT_NEAR(result.identification.plant.mass.y(), 1, 0.15);
  EXPECT_EQ(result.identification.plant.mass.z(), 0);
}

TEST(Calibration, StaysWithinTheAnnouncedForceAndReach) {
  class Watch final : public Device {
   public:
    explicit Watch(Device& device) : device_(device) {}
    [[nodiscard]] const DeviceInfo& info() const noexcept override { return device_.info(); }
    Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
      force = std::max(force, wrench.force.norm());
      last = wrench.force;
      const Status status = device_.exchange(wrench, dt, state);
      far = far.cwiseMax(state.position.cwiseAbs());
      return status;
    }
    void close() noexcept override { device_.close(); }
    double force = 0;
    Vec3 far = Vec3::Zero(), last = nan3();

   private:
    Device& device_;
  };
  const auto watched = [](const std::string& name, const CalibrationOptions& chosen) {
    SimDevice device(preset(name, "relaxed"));
    Watch watch(device);
    const CalibrationPlan plan = plan_calibration(watch.info(), chosen);
    const CalibrationResult result = calibrated(watch, chosen);
    EXPECT_EQ(result.session.servo.cause, StopCause::finished) << name << ": " << result.reason;
    EXPECT_LE(watch.force, plan.max_force * (1 + 1e-9)) << name;
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_LE(watch.far[axis], farthest_place(plan) + 1.6 * plan.reach[axis]) << name;
    EXPECT_EQ(watch.last, Vec3::Zero()) << name;
  };
  for (const char* name : {"falcon", "premium1.5", "omega3", "inverse3"}) watched(name, options());
  watched("falcon", whole());
}

TEST(Calibration, FindsMotorsThatSaturateBelowTheStatedForceAndBoundsAllThatFollowsByIt) {
  CalibrationOptions chosen = options();
  chosen.places = true;
  for (const double motors : {3.2, 4.5}) {
    SimSpec spec = preset("falcon", "relaxed");
    spec.motor_limit = motors;
    SimDevice device(spec);
    const CalibrationResult result = calibrated(device, chosen);
    ASSERT_TRUE(result.succeeded()) << result.reason;
    EXPECT_NEAR(result.motors.force, motors, result.motors.half_width);
    EXPECT_LT(result.motors.half_width, 0.15 * motors);
    EXPECT_EQ(result.identification.plant.motor_limit, result.motors.force);
    EXPECT_EQ(result.identification.half_width.motor_limit, result.motors.half_width);
    EXPECT_LT(result.design->authority, motors) << "of the disturbance observer";
    EXPECT_THAT(result.session.warnings, testing::Contains(testing::Field(&Warning::code, "motor_limit")));
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_NEAR(result.identification.plant.mass[axis], 0.4, 0.08) << "the model is that of the force that acted";
  }
}

TEST(Calibration, FindsNoLimitOfMotorsThatGiveAllTheirForceNorWhereItTriesNone) {
  CalibrationOptions chosen = options();
  chosen.places = true;
  for (const auto& [name, hand] : {std::pair{"falcon", "relaxed"}, {"falcon", "none"}, {"premium1.5", "firm"}}) {
    SimDevice device(preset(name, hand));
    const CalibrationResult result = calibrated(device, chosen);
    EXPECT_GT(result.motors.tried, 0) << name << ' ' << hand;
    EXPECT_EQ(result.motors.force, 0) << name << ' ' << hand;
    EXPECT_EQ(result.identification.plant.motor_limit, 0) << name << ' ' << hand;
  }
  SimSpec spec = preset("falcon", "relaxed");
  spec.motor_limit = 3.2;
  SimDevice device(spec);
  EXPECT_EQ(calibrated(device).motors.tried, 0) << "a quick calibration has no pulses";
}

TEST(Calibration, EndsWithoutAModelWhenNothingMoves) {
  Rock rock;
  const CalibrationResult result = calibrated(rock);
  EXPECT_FALSE(result.succeeded());
  EXPECT_EQ(result.session.servo.cause, StopCause::deviation);
  EXPECT_THAT(result.reason, HasSubstr("blocks"));
  EXPECT_EQ(rock.last, Vec3::Zero());
}

TEST(Calibration, EndsWhenTheDeviceMovesAgainstItsForce) {
  PointMass device(0.5, 2, {.pushes_back = true});
  device.place(Vec3(0.01, 0, 0));
  const CalibrationResult result = calibrated(device);
  EXPECT_FALSE(result.succeeded());
  EXPECT_NE(result.session.servo.cause, StopCause::finished);
  EXPECT_THAT(result.reason, HasSubstr("sign"));
  EXPECT_EQ(device.forces().back(), Vec3::Zero());
}

TEST(Calibration, SaysThatTheEncoderIsTooCoarseAndNotThatTheAxesAreWrong) {
  for (const double step : {1e-3, 2e-3}) {
    SimSpec spec = preset("falcon", "relaxed");
    spec.position_resolution = step;
    SimDevice device(spec);
    const CalibrationResult result = calibrated(device);
    if (result.succeeded()) continue;
    EXPECT_THAT(result.reason, testing::Not(HasSubstr("the driver's axes have the wrong order"))) << step;
    EXPECT_THAT(result.reason, HasSubstr("coarse")) << step;
  }
}

TEST(Calibration, SaysThatATremorHidesTheDeviceAndNotThatTheAxesAreWrong) {
  for (const double tremor : {2.0, 4.0}) {
    SimSpec spec = preset("falcon", "relaxed");
    spec.hand->tremor = tremor;
    SimDevice device(spec);
    const CalibrationResult result = calibrated(device);
    if (result.succeeded()) continue;
    EXPECT_THAT(result.reason, testing::Not(HasSubstr("the driver's axes have the wrong order"))) << tremor;
  }
}

/// Counts the ticks without any force, as while a calibration listens, and remembers the largest force.
class Heard final : public Device {
 public:
  explicit Heard(Device& device) : device_(device) {}
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return device_.info(); }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
    silent_ = wrench.force == Vec3::Zero() ? silent_ + 1 : 0;
    longest = std::max(longest, silent_);
    largest = std::max(largest, wrench.force.norm());
    return device_.exchange(wrench, dt, state);
  }
  void close() noexcept override { device_.close(); }
  int longest = 0;
  double largest = 0;

 private:
  Device& device_;
  int silent_ = 0;
};

TEST(Calibration, FindsTheTremorOfTheHandAndTakesItForNoVibrationOfTheLoop) {
  const EnsembleDraw draw = draw_device(1, 2, EnsembleKind::tremor_half);
  SimDevice device(draw.spec, {.seed = draw.noise_seed});
  const CalibrationResult result = calibrated(device, whole());
  ASSERT_TRUE(result.held) << result.reason;
  const HandNoise& noise = result.held->model.noise;
  EXPECT_GT(noise.tremor, 0.15) << "of 0.5 N that it makes between 6 and 12 Hz";
  EXPECT_LT(noise.tremor, 0.8);
  EXPECT_GT(noise.tremor_hz, 6);
  EXPECT_LT(noise.tremor_hz, 13);
  EXPECT_GT(result.held->half_width.noise.tremor, 0);
  EXPECT_GT(answer_to_tremor(result.held->model), 0.25 * draw.spec.max_force) << "else it changed nothing";

  const EnsembleDraw healthy = draw_device(1, 2, EnsembleKind::late);
  SimDevice calm(healthy.spec, {.seed = healthy.noise_seed});
  const CalibrationResult without = calibrated(calm, whole());
  ASSERT_TRUE(without.held) << without.reason;
  EXPECT_EQ(without.held->model.noise.tremor, 0) << "a healthy hand's is not worth a number";
  EXPECT_EQ(answer_to_tremor(without.held->model), 0);
}

TEST(Calibration, ListensWithoutForceAndMeasuresAgainWhereATremorHidesTheDevice) {
  const EnsembleDraw draw = draw_device(1, 3, EnsembleKind::tremor_one);
  SimDevice device(draw.spec, {.seed = draw.noise_seed});
  Heard heard(device);
  const CalibrationResult result = calibrated(heard, whole());
  ASSERT_TRUE(result.succeeded()) << result.reason;
  EXPECT_FALSE(result.identification.coarse) << result.doubt;
  EXPECT_GE(heard.longest, 3000) << "ticks";
  EXPECT_LE(heard.largest, draw.spec.max_force);
  const auto told = std::ranges::find(result.session.warnings, "tremor", &Warning::code);
  ASSERT_NE(told, result.session.warnings.end());
  EXPECT_THAT(told->text, HasSubstr("the hand trembles with about"));
  EXPECT_EQ(told->severity, Severity::warning);

  // Without a tremor there is nothing to listen to, whatever else makes a model coarse.
  const EnsembleDraw loose = draw_device(1, 4, EnsembleKind::backlash);
  SimDevice rattles(loose.spec, {.seed = loose.noise_seed});
  Heard other(rattles);
  const CalibrationResult coarse = calibrated(other, whole());
  EXPECT_EQ(std::ranges::find(coarse.session.warnings, "tremor", &Warning::code), coarse.session.warnings.end());
}

TEST(Calibration, TakesNoForceOfAnArmThatYieldsForGravity) {
  SimSpec spec = preset("falcon", "relaxed");
  spec.hand->tremor = spec.hand->drift = 0;
  spec.hand->arm_stiffness = 0;
  spec.hand->arm_damping = 8;
  SimDevice device(spec);
  const CalibrationResult result = calibrated(device);
  ASSERT_TRUE(result.succeeded()) << result.reason;
  const Vec3 centre = 0.5 * (spec.workspace.min + spec.workspace.max);
  const PlantModel& found = result.identification.plant;
  const Vec3 gravity = found.gravity + found.gravity_gradient * centre;
  for (int axis = 0; axis < 3; ++axis)
    EXPECT_LT(std::abs(gravity[axis] - (spec.gravity_bias + spec.gravity_gradient * centre)[axis]),
              1.5 * result.identification.half_width.gravity[axis])
        << axis;
}

TEST(Calibration, SaysThatTwoAxesAreSwapped) {
  class Swapped final : public Device {
   public:
    explicit Swapped(Device& device) : device_(device) {}
    [[nodiscard]] const DeviceInfo& info() const noexcept override { return device_.info(); }
    Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
      Wrench swapped = wrench;
      std::swap(swapped.force.x(), swapped.force.y());
      return device_.exchange(swapped, dt, state);
    }
    void close() noexcept override { device_.close(); }

   private:
    Device& device_;
  };
  PointMass mass(0.3, 5);
  Swapped device(mass);
  const CalibrationResult result = calibrated(device);
  EXPECT_FALSE(result.succeeded());
  EXPECT_THAT(result.reason, testing::AnyOf(HasSubstr("axes have the wrong order or signs"),
                                            HasSubstr("check the signs of the driver's axes")));
}

TEST(Calibration, ExcitesTheDeviceWithinTheShareOfTheForceThatItMayUse) {
  PointMass device;
  const CalibrationPlan usual = plan_calibration(device.info(), options());
  for (const double share : {0.1, 0.3, 0.7, 1.0}) {
    CalibrationOptions chosen = options();
    chosen.force_share = share;
    const CalibrationPlan plan = plan_calibration(device.info(), chosen);
    EXPECT_LE(plan.max_dither, 0.18 * plan.max_force) << share;
    if (share >= 0.7) {
      EXPECT_DOUBLE_EQ(plan.max_dither, usual.max_dither) << share;
    }
    PointMass pushed;
    (void)calibrate(pushed, chosen, StopRequest{});
    double most = 0;
    for (const Vec3& force : pushed.forces()) most = std::max(most, force.norm());
    EXPECT_LE(most, plan.max_force * (1 + 1e-9)) << share;
  }
}

TEST(Calibration, StopsWhenAskedAtAnyMomentAndFindsNothing) {
  // Later on, the search for laws and their trials.
  for (const int at : {0, 300, 1500, 5000, 9000, 20000, 35000}) {
    SimDevice device(preset("falcon", "relaxed"));
    /// Raises the stop request at an exchange, like a signal.
    class Raiser final : public Device {
     public:
      Raiser(Device& device, int left) : device_(device), left_(left) {}
      [[nodiscard]] const DeviceInfo& info() const noexcept override { return device_.info(); }
      Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
        if (left_-- == 0) stop.raise();
        last = wrench.force;
        return device_.exchange(wrench, dt, state);
      }
      void close() noexcept override { device_.close(); }
      StopRequest stop;
      Vec3 last = nan3();

     private:
      Device& device_;
      int left_;
    } raiser(device, at);
    const CalibrationResult result = calibrate(raiser, at < 10000 ? options() : whole(), raiser.stop);
    EXPECT_FALSE(result.succeeded()) << at;
    EXPECT_FALSE(result.held) << at;
    EXPECT_EQ(result.session.servo.cause, StopCause::interrupted) << at;
    EXPECT_LE(result.session.servo.samples, static_cast<std::uint64_t>(at) + 260) << at;
    EXPECT_EQ(raiser.last, Vec3::Zero()) << at;
  }
}

TEST(Calibration, RejectsUnsuitableDevicesAndOptionsBeforeAnyForce) {
  PointMass device;
  device.mutable_info().force_axes = {false, false, false};
  EXPECT_THAT(error_of([&] { (void)calibrated(device); }), HasSubstr("takes no force"));
  device.mutable_info().force_axes = {true, true, true};
  device.mutable_info().max_force = 0;
  EXPECT_THAT(error_of([&] { (void)calibrated(device); }), HasSubstr("--max-force"));
  device.mutable_info().max_force = 10;
  device.mutable_info().workspace_max.y() = -0.195;
  EXPECT_THAT(error_of([&] { (void)calibrated(device); }), HasSubstr("5.0 mm wide in y"));
  device.mutable_info().workspace_max.y() = 0.2;
  CalibrationOptions slow = options();
  slow.session.loop.rate_hz = 100;
  EXPECT_THAT(error_of([&] { (void)calibrated(device, slow); }), HasSubstr("lines"));
  slow = options();
  slow.force_share = 2;
  EXPECT_THAT(error_of([&] { (void)calibrated(device, slow); }), HasSubstr("0.1 to 1"));
  EXPECT_TRUE(device.forces().empty());
}

TEST(Calibration, ReportsALostDevice) {
  PointMass device(0.5, 2, {.lost_at = 3000});
  const CalibrationResult result = calibrated(device);
  EXPECT_FALSE(result.succeeded());
  EXPECT_EQ(result.session.servo.cause, StopCause::device_lost);
  EXPECT_THAT(result.reason, HasSubstr("lost"));
}

}  // namespace
}  // namespace haptrace
