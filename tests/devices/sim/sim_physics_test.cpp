// Tests of the simulated plant against closed-form solutions.
#include "control/path/min_jerk.h"
#include "devices/sim/presets.h"
#include "tests/devices/support.h"

#include <complex>
#include <numbers>

namespace haptrace::test {
namespace {

using nlohmann::json;

/// Returns the spec of a mass of 1 kg with at most 100 N, with `changes` applied.
SimSpec spec_of(const char* changes) {
  json spec = json::parse(R"({"mass": 1, "max_force": 100})");
  spec.merge_patch(json::parse(changes));
  return read_sim_spec(spec, "test");
}

SimDevice device_of(const char* changes) {
  return SimDevice(spec_of(changes));
}

void run(SimDevice& device, const Vec3& force, double duration) {
  for (int k = 0; k < std::lround(duration * 1000); ++k) exchange(device, force, 1e-3);
}

double true_x(const SimDevice& device) {
  return device.true_position().x();
}
double true_vx(const SimDevice& device) {
  return device.true_velocity().x();
}

TEST(SimPhysics, AFreeMassFollowsTheParabola) {
  SimDevice device = device_of(R"({"mass": [0.5, 1, 2]})");
  run(device, Vec3(2, 2, 2), 0.5);
  for (int axis = 0; axis < 3; ++axis) {
    const double acceleration = 2 / (axis == 0 ? 0.5 : axis);
    EXPECT_NEAR(device.true_position()[axis], 0.5 * acceleration * 0.25, 1e-3 * acceleration * 0.125);
    EXPECT_NEAR(device.true_velocity()[axis], acceleration * 0.5, 1e-9);
  }
}

TEST(SimPhysics, AViscousMassReachesItsTerminalVelocity) {
  SimDevice device = device_of(R"({"mass": 0.2, "viscous": 4, "workspace": {"min": -9, "max": 9}})");
  run(device, Vec3(2, 0, 0), 0.05);
  EXPECT_NEAR(true_vx(device), 0.5 * (1 - std::exp(-1)), 1e-3);  // one time constant m / b
  run(device, Vec3(2, 0, 0), 2);
  EXPECT_NEAR(true_vx(device), 0.5, 1e-12);
}

TEST(SimPhysics, RigidFrictionSticksUpToItsLimit) {
  SimDevice device = device_of(R"({"coulomb": 2})");
  run(device, Vec3(1.99, 0, 0), 0.5);
  EXPECT_EQ(true_x(device), 0);
  run(device, Vec3(-1.99, 1.99, 0), 0.5);
  EXPECT_EQ(device.true_position(), Vec3(0, 0, 0));
  run(device, Vec3(2.5, 0, 0), 0.5);
  EXPECT_NEAR(true_vx(device), 0.25, 1e-9);  // (F - F_c) t / m
  run(device, Vec3::Zero(), 0.1);
  EXPECT_NEAR(true_vx(device), 0.05, 1e-9);  // - F_c t / m
  run(device, Vec3::Zero(), 0.1);
  const double rest = true_x(device);
  EXPECT_EQ(true_vx(device), 0);
  run(device, Vec3::Zero(), 0.1);
  EXPECT_EQ(true_x(device), rest);
}

TEST(SimPhysics, StaticFrictionIsHigherThanSliding) {
  SimDevice device = device_of(R"({"coulomb": 2, "stribeck": {"static_ratio": 1.5, "velocity": 0.01}})");
  run(device, Vec3(2.9, 0, 0), 0.5);
  EXPECT_EQ(true_x(device), 0);
  run(device, Vec3(3.1, 0, 0), 0.5);
  const double speed = true_vx(device);
  EXPECT_GT(speed, 0.3);
  run(device, Vec3(2.9, 0, 0), 0.1);
  EXPECT_NEAR(true_vx(device) - speed, 0.09, 1e-6);  // once it slides, F_c decelerates it
}

/// Increases the force slowly to `force` and returns the displacement of the mass [m].
double presliding(SimDevice& device, double force) {
  constexpr int kTicks = 2000;
  for (int k = 1; k <= kTicks; ++k) exchange(device, Vec3(force * k / kTicks, 0, 0), 1e-3);
  return true_x(device);
}

TEST(SimPhysics, PreslidingFollowsLuGre) {
  for (const double part : {0.1, 0.5, 0.8}) {
    SimDevice device = device_of(R"({"mass": 0.4, "viscous": 20, "coulomb": 0.7,
                                     "presliding": {"distance": 8e-5, "damping": 5}})");
    // At very low speed z' = v (1 - sigma_0 z / F_c), hence F = F_c (1 - exp(-x sigma_0 / F_c)).
    EXPECT_NEAR(presliding(device, 0.7 * part), -8e-5 * std::log(1 - part), 2.5e-6) << part;
  }
}

TEST(SimPhysics, PreslidingCanBeGivenByItsStiffness) {
  SimDevice a = device_of(R"({"coulomb": 0.7, "viscous": 20, "presliding": {"stiffness": 8750}})");
  SimDevice b = device_of(R"({"coulomb": 0.7, "viscous": 20, "presliding": {"distance": 8e-5}})");
  EXPECT_NEAR(presliding(a, 0.3), presliding(b, 0.3), 1e-15);
}

TEST(SimPhysics, LuGreSlidesWithCoulombsForce) {
  SimDevice device = device_of(R"({"coulomb": 2, "presliding": {"distance": 1e-5}})");
  run(device, Vec3(5, 0, 0), 0.1);
  const double speed = true_vx(device);
  EXPECT_NEAR(speed, 0.3, 0.01);
  run(device, Vec3(5, 0, 0), 0.1);
  EXPECT_NEAR(true_vx(device) - speed, 0.3, 1e-6);
}

TEST(SimPhysics, AVeryStiffBristleLetsGoAtOnce) {
  // The implicit spring does not hold back a push beyond the friction limit.
  SimDevice device = device_of(R"({"mass": 1e-3, "coulomb": 0.7, "presliding": {"stiffness": 1e8}})");
  exchange(device, Vec3(1, 0, 0), 1e-3);
  EXPECT_NEAR(true_vx(device), 0.3, 0.02);
}

class DelayedBy : public testing::TestWithParam<double> {};

TEST_P(DelayedBy, TheForceArrivesExactlyAfterTheDelay) {
  const double delay = GetParam();
  SimSpec spec = spec_of("{}");
  spec.delay = delay;
  SimDevice device(spec);
  exchange(device, Vec3(1, 0, 0), 0);
  exchange(device, Vec3(1, 0, 0), delay);
  EXPECT_EQ(true_vx(device), 0);
  exchange(device, Vec3(1, 0, 0), 1e-6);
  EXPECT_NEAR(true_vx(device), 1e-6, 1e-15);
}

TEST_P(DelayedBy, UnevenTicksSeeTheSameForceLater) {
  const double delay = GetParam();
  SimSpec spec = spec_of(R"({"workspace": {"min": -9, "max": 9}})");
  spec.delay = delay;
  SimDevice device(spec);
  double time = 0, impulse = 0, impulse_late = 0;
  std::vector<std::pair<double, double>> sent;  // start [s], force [N]
  for (int k = 0; k < 300; ++k) {
    const double dt = 1e-9 * std::round(1e6 * (1 + 0.9 * std::sin(k))), force = std::cos(3 * k);
    sent.emplace_back(time, force);
    exchange(device, Vec3(force, 0, 0), dt);
    time += dt;
    impulse += force * dt;
  }
  for (std::size_t i = 0; i < sent.size(); ++i) {
    const double from = sent[i].first + delay, to = i + 1 < sent.size() ? sent[i + 1].first + delay : time + delay;
    impulse_late += sent[i].second * (std::min(to, time) - std::min(from, time));
  }
  EXPECT_NEAR(true_vx(device), impulse_late, 1e-9);
  EXPECT_GT(std::abs(impulse - impulse_late), 1e-6);
}

INSTANTIATE_TEST_SUITE_P(Delays, DelayedBy, testing::Values(0.3e-3, 1e-3, 1.7e-3, 2e-3, 16e-3, 0.1234567));

TEST(SimPhysics, TheActuatorLagsByItsTimeConstant) {
  SimDevice device = device_of(R"({"actuator_bandwidth_hz": 100, "workspace": {"min": -9, "max": 9}})");
  const double tau = 1 / (2 * std::numbers::pi * 100);
  for (int k = 1; k <= 20; ++k) {
    exchange(device, Vec3(3, 0, 0), 1e-3);
    const double t = 1e-3 * k;
    EXPECT_NEAR(true_vx(device), 3 * (t - tau * (1 - std::exp(-t / tau))), 1e-12);
  }
}

TEST(SimPhysics, MotorsSaturateAtTheirLargestForce) {
  SimDevice device = device_of(R"({"max_force": 5})");
  run(device, Vec3(30, 40, 0), 0.1);
  EXPECT_NEAR(true_vx(device), 0.3, 1e-9);
  EXPECT_NEAR(device.true_velocity().y(), 0.4, 1e-9);
  SimDevice huge = device_of(R"({"max_force": 5})");
  run(huge, Vec3(1e308, 1e308, 0), 0.1);
  EXPECT_NEAR(true_vx(huge), 0.5 / std::numbers::sqrt2, 1e-9);
}

TEST(SimPhysics, MotorsMaySaturateBelowTheForceThatTheyState) {
  SimDevice device = device_of(R"({"max_force": 5, "motor_limit": 2})");
  EXPECT_EQ(device.info().max_force, 5);
  run(device, Vec3(3, 4, 0), 0.1);
  EXPECT_NEAR(true_vx(device), 0.12, 1e-9);
  EXPECT_NEAR(device.true_velocity().y(), 0.16, 1e-9);
}

TEST(SimPhysics, AMassThatVariesOverTheWorkspaceCoastsWithItsEnergy) {
  SimDevice device =
      device_of(R"({"mass": 0.5, "inertia": {"variation": 0.5, "length": 0.1}, "workspace": {"min": -1, "max": 1}})");
  run(device, Vec3(30, 40, 0), 0.01);
  const auto scale = [&] { return 1 + 0.5 * std::cos(std::numbers::pi * device.true_position().norm() / 0.1); };
  const auto energy = [&] { return 0.25 * scale() * device.true_velocity().squaredNorm(); };
  const double start = energy(), fast = device.true_velocity().norm();
  double least = 2, fastest = fast;
  while (device.true_position().norm() < 0.15) {
    run(device, Vec3::Zero(), 1e-3);
    ASSERT_NEAR(energy(), start, 0.01 * start);
    ASSERT_NEAR(device.plant().energy(), energy(), 1e-12);
    least = std::min(least, scale());
    fastest = std::max(fastest, device.true_velocity().norm());
  }
  EXPECT_LT(least, 0.51);
  EXPECT_GT(fastest, 1.6 * fast);
}

TEST(SimPhysics, ForcesComeInSteps) {
  SimDevice device = device_of(R"({"force_resolution": 0.1})");
  run(device, Vec3(0.04, 0.06, 0), 0.1);
  EXPECT_EQ(true_vx(device), 0);
  EXPECT_NEAR(device.true_velocity().y(), 0.01, 1e-12);
}

TEST(SimPhysics, AHandOnItsGripRingsLikeASpringAndAMass) {
  // The heavy hand acts as a wall, so only the device moves: x = F / k (1 - e^(-s t) (cos w t + s / w sin w t)).
  SimDevice device = device_of(R"({"mass": 0.4, "hand": {"mass": 1e4, "grip_stiffness": 1000, "grip_damping": 4}})");
  const double k = 1000, s = 4 / (2 * 0.4), w = std::sqrt(k / 0.4 - s * s);
  for (int tick = 1; tick <= 300; ++tick) {
    exchange(device, Vec3(2, 0, 0), 1e-3);
    const double t = 1e-3 * tick, e = std::exp(-s * t);
    EXPECT_NEAR(true_x(device), 2 / k * (1 - e * (std::cos(w * t) + s / w * std::sin(w * t))), 0.01 * 2 / k) << t;
  }
}

TEST(SimPhysics, AnArmThatRelaxesForgetsWhereItWas) {
  // Device and hand move as one mass here. The arm's force relaxes, so the hand ends up creeping.
  const char* spec = R"({"mass": 0.1, "workspace": {"min": -9, "max": 9},
                         "hand": {"mass": 0.1, "grip_stiffness": 1e4, "grip_damping": 20,
                                  "arm_stiffness": 200, "arm_relaxation_s": 0.5, "arm_damping": 1}})";
  SimDevice device = device_of(spec);
  run(device, Vec3(2, 0, 0), 5);
  EXPECT_NEAR(true_vx(device), 2.0 / (200 * 0.5 + 1), 2e-5);  // F / (k tau + b)
}

TEST(SimPhysics, ASensorFeelsWhatTheHandFeels) {
  SimDevice device = device_of(R"({"force_sensor": true, "viscous": 5, "hand": {"mass": 0.2, "grip_stiffness": 800,
                                   "grip_damping": 8, "arm_stiffness": 500, "arm_damping": 20}})");
  run(device, Vec3(1.5, -0.5, 0), 5);
  const DeviceState state = exchange(device, Vec3(1.5, -0.5, 0), 1e-3);
  EXPECT_NEAR(state.force.x(), 1.5, 1e-4);
  EXPECT_NEAR(state.force.y(), -0.5, 1e-4);
  EXPECT_NEAR(true_x(device), 1.5 * (1.0 / 800 + 1.0 / 500), 1e-6);
}

TEST(SimPhysics, AnUnheldSensorFeelsNothing) {
  SimDevice device = device_of(R"({"force_sensor": true})");
  EXPECT_EQ(exchange(device, Vec3(5, 0, 0), 1e-3).force, Vec3(0, 0, 0));
}

TEST(SimPhysics, GravityPullsAndItsGradientMakesASpring) {
  SimDevice falling = device_of(R"({"mass": 0.4, "gravity_bias": [0, -2, 0]})");
  run(falling, Vec3::Zero(), 0.2);
  EXPECT_NEAR(falling.true_velocity().y(), -1, 1e-9);

  SimDevice swinging = device_of(R"({"mass": 0.4, "gravity_bias": [1, 0, 0], "gravity_gradient": [-100, 0, 0]})");
  run(swinging, Vec3::Zero(), 0.2);
  const double w = std::sqrt(100 / 0.4);
  EXPECT_NEAR(true_x(swinging), 0.01 * (1 - std::cos(w * 0.2)), 1e-5);
}

TEST(SimPhysics, AGradientOffTheDiagonalPushesSideways) {
  SimDevice device = device_of(R"({"gravity_gradient": {"x": [0, -50, 0], "y": [-50, 0, 0]}})");
  run(device, Vec3(1, 0, 0), 0.05);
  EXPECT_LT(device.true_position().y(), -1e-7);
}

TEST(SimPhysics, WeightStaysInWHoweverTheActuatorsAreTurned) {
  const char* weight =
      R"({"gravity_bias": [1, -2, 3], "gravity_gradient": {"x": [-9, 4, 0], "y": [4, -5, 2], "z": [0, 2, 6]},
                           "actuator_rotation": [0, 0, 0]})";
  SimSpec spec = spec_of(weight);
  SimDevice straight(spec);
  spec.rotation = Vec3(0.5, -1.2, 0.8);
  SimDevice turned(spec);
  run(straight, Vec3(1, 1, 1), 0.4);
  run(turned, Vec3(1, 1, 1), 0.4);
  EXPECT_NEAR((straight.true_position() - turned.true_position()).norm(), 0, 1e-13);
}

TEST(SimPhysics, CoggingIsASpringInItsWells) {
  SimDevice device = device_of(R"({"mass": 0.4, "cogging": {"amplitude": 0.5, "period": 0.01}})");
  const double k = 0.5 * 2 * std::numbers::pi / 0.01, w = std::sqrt(k / 0.4);
  run(device, Vec3(0.01, 0, 0), 0.2);
  EXPECT_NEAR(true_x(device), 0.01 / k * (1 - std::cos(w * 0.2)), 0.02 * 0.01 / k);
}

TEST(SimPhysics, TheStructureRingsAtItsFrequency) {
  SimDevice device = device_of(R"({"mass": 0.4, "workspace": {"min": -9, "max": 9},
      "structural_mode": {"frequency_hz": 40, "damping_ratio": 0, "handle_fraction": 0.25}})");
  // The stretch between motor and handle oscillates about F / (m w^2), at which the link accelerates the handle with
  // the motor. m = 0.3 kg is the motor's mass.
  const double w = 2 * std::numbers::pi * 40, mean = 3 / (0.3 * w * w);
  for (int k = 1; k <= 250; ++k) {
    exchange(device, Vec3(3, 0, 0), 1e-3);
    const double stretch = device.plant().motor_position().x() - true_x(device);
    EXPECT_NEAR(stretch, mean * (1 - std::cos(w * 1e-3 * k)), 0.05 * mean) << k;
  }
  const double momentum = 0.1 * true_vx(device) + 0.3 * device.plant().motor_velocity().x();
  EXPECT_NEAR(momentum, 3 * 0.25, 1e-9);
}

TEST(SimPhysics, BacklashLetsTheMotorMoveAlone) {
  SimDevice device = device_of(R"({"mass": 0.4, "backlash": 1e-3, "structural_mode": {"frequency_hz": 80}})");
  while (device.plant().motor_position().x() < 0.49e-3) {
    exchange(device, Vec3(1, 0, 0), 1e-4);
    EXPECT_EQ(true_x(device), 0);
  }
  run(device, Vec3(1, 0, 0), 0.02);
  EXPECT_GT(true_x(device), 1e-5);
}

TEST(SimPhysics, AHeldAxisStaysExactlyAtZero) {
  SimDevice device = device_of(R"({"axes": "xz", "actuator_rotation": [0, 0.4, 0], "coulomb": 0.1, "hand": "firm"})");
  for (int k = 0; k < 500; ++k) EXPECT_EQ(exchange(device, Vec3(1, 5, 0), 1e-3).position.y(), 0);
  EXPECT_GT(true_x(device), 1e-4);
}

TEST(SimPhysics, EncodersCountInActuatorAxes) {
  SimDevice device = device_of(R"({"position_resolution": 1e-3, "actuator_rotation": [0.2, -0.4, 0.7], "viscous": 1})");
  RandomForce force(3, 5);
  for (int k = 0; k < 500; ++k) {
    const Vec3 measured = exchange(device, force(1e-3), 1e-3).position;
    const Vec3 counts = device.plant().rotation() * measured / 1e-3;
    EXPECT_NEAR((counts - counts.array().round().matrix()).norm(), 0, 1e-9);
    EXPECT_LE((device.plant().rotation() * (measured - device.true_position())).cwiseAbs().maxCoeff(), 0.5001e-3);
  }
}

TEST(SimPhysics, FrictionActsInActuatorAxes) {
  // A quarter turn about z maps W's x axis to the second actuator.
  SimDevice device = device_of(R"({"coulomb": [0, 3, 0], "actuator_rotation": [0, 0, 1.5707963267948966]})");
  run(device, Vec3(2, 2, 0), 0.1);
  EXPECT_NEAR(true_vx(device), 0, 1e-12);
  EXPECT_NEAR(device.true_velocity().y(), 0.2, 1e-9);
}

TEST(SimPhysics, SensorNoiseHasItsRms) {
  SimDevice device = device_of(R"({"coulomb": 1, "force_sensor": true, "noise": {"position": 2e-5, "force": 0.03}})");
  Vec3 positions = Vec3::Zero(), forces = Vec3::Zero();
  constexpr int kTicks = 20000;
  for (int k = 0; k < kTicks; ++k) {
    const DeviceState state = exchange(device, Vec3::Zero(), 1e-4);
    positions += state.position.cwiseAbs2();
    forces += state.force.cwiseAbs2();
  }
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(std::sqrt(positions[axis] / kTicks), 2e-5, 4e-7);
    EXPECT_NEAR(std::sqrt(forces[axis] / kTicks), 0.03, 6e-4);
  }
}

TEST(SimPhysics, TheWallsHold) {
  for (const char* mass : {"1e-4", "0.4", "1000"}) {
    json spec = json::parse(R"({"max_force": 10, "workspace": {"min": [-0.01, -0.02, -0.03], "max": 0.02},
                                "actuator_rotation": [0.1, 0.2, 0.3]})");
    spec["mass"] = json::parse(mass);
    SimDevice device(read_sim_spec(spec, "test"));
    for (const Vec3& force : {Vec3(9, -4, 0), Vec3(-9, 0, -4), Vec3(0, 9, 4)}) {
      run(device, force, 2);
      const Box& box = Box{Vec3(-0.01, -0.02, -0.03), Vec3::Constant(0.02)};
      const Vec3 p = device.true_position();
      EXPECT_LT((p - p.cwiseMax(box.min).cwiseMin(box.max)).norm(), 5e-3) << mass << " kg";
    }
  }
}

TEST(SimPhysics, TheWallsTakeEnergy) {
  SimDevice device = device_of(R"({"mass": 0.4, "workspace": {"min": -0.05, "max": 0.05}})");
  run(device, Vec3(4, 0, 0), 0.05);
  const double speed = true_vx(device);
  double rebound = 0;
  for (int k = 0; k < 300; ++k) {
    run(device, Vec3::Zero(), 0.001);
    rebound = std::min(rebound, true_vx(device));
  }
  EXPECT_LT(rebound, 0);
  EXPECT_GT(rebound, -0.3 * speed);
}

// Properties of the integration: energy, refinement, extremes.

const char* const kEverything = R"({
  "mass": [0.4, 0.5, 0.3], "viscous": 1, "coulomb": 0.7, "stribeck": {"static_ratio": 1.25, "velocity": 0.01},
  "presliding": {"distance": 8e-5}, "gravity_bias": [0.5, -1, 1], "gravity_gradient": [-8, -8, 6],
  "cogging": {"amplitude": 0.06, "period": 0.006}, "actuator_rotation": [0.3, -0.5, 0.4], "max_force": 9,
  "structural_mode": {"frequency_hz": 60, "damping_ratio": 0.02, "handle_fraction": 0.3}, "backlash": 5e-5,
  "workspace": {"min": -9, "max": 9},
  "hand": {"mass": 0.15, "grip_stiffness": 800, "grip_damping": 4, "arm_stiffness": 40, "arm_relaxation_s": 0.5,
           "arm_damping": 2}})";

class PassivePlant : public testing::TestWithParam<const char*> {};

TEST_P(PassivePlant, HasNeverMoreEnergyThanItWasGiven) {
  SimDevice device(read_sim_spec(json::parse(GetParam()), "test"));
  RandomForce push(17, 4);
  const double start = device.plant().energy();
  double work = 0, given = 0;
  for (int k = 0; k < 6000; ++k) {
    const Vec3 force = k < 3000 ? push(1e-3) : Vec3::Zero();
    const Vec3 before = device.plant().motor_position();
    exchange(device, force, 1e-3);
    const double dw = (device.plant().rotation() * force).dot(device.plant().motor_position() - before);
    work += dw;
    given += std::abs(dw);
    ASSERT_LE(device.plant().energy() - start, work + 0.005 * given + 1e-9) << "tick " << k;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Plants, PassivePlant,
    testing::Values(
        kEverything, R"({"mass": 1, "max_force": 10, "workspace": {"min": -50, "max": 50}})",
        R"({"mass": 0.05, "max_force": 10, "coulomb": 0.5, "hand": {"mass": 0.01, "grip_stiffness": 2000}})",
        R"({"mass": [0.4, 0.5, 0.3], "max_force": 9, "inertia": {"variation": 0.7, "length": 0.06}, "viscous": 2,
                        "workspace": {"min": -9, "max": 9}, "hand": "relaxed"})",
        R"({"mass": 0.2, "max_force": 10, "gravity_gradient": {"x": [-90, 40, 0], "y": [40, -60, 0], "z": [0, 0, -50]},
                        "workspace": {"min": -9, "max": 9}, "coulomb": 0.2, "presliding": {"stiffness": 1e7}})"));

double wander_apart(const SimSpec& spec, double coarse, double fine) {
  SimDevice a(spec, {.longest_step = coarse}), b(spec, {.longest_step = fine});
  RandomForce force(23, 4);
  double apart = 0, moved = 0;
  for (int k = 0; k < 3000; ++k) {
    const Vec3 f = force(1e-3) - 30 * a.true_position();
    exchange(a, f, 1e-3);
    exchange(b, f, 1e-3);
    apart += (a.true_position() - b.true_position()).squaredNorm();
    moved += a.true_position().squaredNorm();
  }
  return std::sqrt(apart / moved);
}

TEST(SimIntegration, FinerStepsChangeTheMovementByLessThanAPerCent) {
  EXPECT_LT(wander_apart(read_sim_spec(json::parse(kEverything), "test"), 50e-6, 5e-6), 0.01);
  EXPECT_LT(wander_apart(read_sim_spec(device_preset("reference", "test"), "test"), 50e-6, 5e-6), 0.01);
}

class Extreme : public testing::TestWithParam<const char*> {};

TEST_P(Extreme, StaysFiniteAndWithinItsWalls) {
  SimDevice device = device_of(GetParam());
  const double reach = device.info().workspace_max.maxCoeff();
  RandomForce force(29, device.info().max_force);
  Gaussian jitter(4, 4);
  for (int k = 0; k < 1000; ++k) {
    const double dt = 1e-3 * std::abs(1 + 0.3 * jitter());
    const DeviceState state = exchange(device, force(dt), dt);
    ASSERT_TRUE(is_finite(state.position)) << "tick " << k;
    ASSERT_LT(device.true_position().cwiseAbs().maxCoeff(), reach + 0.05) << "tick " << k;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Specs, Extreme,
    testing::Values(
        R"({"mass": 1e-4, "max_force": 8})", R"({"mass": 1000, "max_force": 8})",
        R"({"mass": 1e-4, "max_force": 8, "coulomb": 0.7, "presliding": {"stiffness": 1e8, "damping": 100}})",
        R"({"mass": 1e-4, "max_force": 8, "coulomb": 0.7, "viscous": 1000, "hand": "loose"})",
        R"({"mass": 1e-4, "max_force": 8, "hand": "tense"})",
        R"({"mass": 1000, "max_force": 8, "coulomb": 0.7, "presliding": {"stiffness": 1e8}, "hand": "finger"})",
        R"({"mass": 0.4, "delay_s": 0.016, "hand": "firm", "max_force": 20})",
        R"({"mass": 0.4, "position_resolution": 1e-3, "hand": "tremor", "max_force": 20})",
        R"({"mass": 0.02, "max_force": 8, "structural_mode": {"frequency_hz": 2000, "handle_fraction": 0.02},
                        "hand": "tense"})"));

TEST(SimIntegration, AStiffBristleHoldsStill) {
  for (const char* mass : {"1e-4", "0.4"}) {
    json spec = json::parse(R"({"max_force": 10, "coulomb": 0.7, "presliding": {"stiffness": 1e8}})");
    spec["mass"] = json::parse(mass);
    SimDevice device(read_sim_spec(spec, "test"));
    for (int k = 0; k < 1000; ++k) {
      exchange(device, Vec3(0.4, 0, 0), 1e-3);
      ASSERT_LT(std::abs(true_x(device)), 2 * 0.7 / 1e8) << mass << " kg, tick " << k;
    }
  }
}

TEST(SimIntegration, OneLongStepIsAsGoodAsManyShort) {
  SimDevice once(spec_of(R"({"mass": 0.4, "coulomb": 0.3, "hand": "tense", "delay_s": 0.0005})"));
  SimDevice often(spec_of(R"({"mass": 0.4, "coulomb": 0.3, "hand": "tense", "delay_s": 0.0005})"));
  exchange(once, Vec3(3, 0, 0), 0.5);
  run(often, Vec3(3, 0, 0), 0.5);
  EXPECT_NEAR((once.true_position() - often.true_position()).norm(), 0, 1e-6);
}

TEST(SimNoise, IsNormalAndItsStreamsAreIndependent) {
  Gaussian a(1, 1), b(1, 2), again(1, 1);
  double mean = 0, square = 0, fourth = 0, product = 0;
  constexpr int kDraws = 200000;
  for (int i = 0; i < kDraws; ++i) {
    const double x = a(), y = b();
    EXPECT_EQ(again(), x);
    mean += x, square += x * x, fourth += x * x * x * x, product += x * y;
  }
  EXPECT_NEAR(mean / kDraws, 0, 0.01);
  EXPECT_NEAR(square / kDraws, 1, 0.01);
  EXPECT_NEAR(fourth / kDraws, 3, 0.1);
  EXPECT_NEAR(product / kDraws, 0, 0.01);
}

TEST(SimNoise, KeepsTheBandAndRmsOfAHand) {
  Gaussian gaussian(6, 1);
  ColouredNoise tremor = ColouredNoise::band_pass(0.04, 6, 12, 1000), drift = ColouredNoise::low_pass(0.15, 1, 1000);
  double tremor_square = 0, drift_square = 0, before_tremor = 0, before_drift = 0;
  int tremor_crossings = 0, drift_crossings = 0;
  constexpr int kSeconds = 200;
  for (int i = 0; i < kSeconds * 1000; ++i) {
    const double t = tremor.next(gaussian).x(), d = drift.next(gaussian).x();
    tremor_square += t * t, drift_square += d * d;
    tremor_crossings += t * before_tremor < 0, drift_crossings += d * before_drift < 0;
    before_tremor = t, before_drift = d;
  }
  EXPECT_NEAR(std::sqrt(tremor_square / kSeconds / 1000), 0.04, 0.002);
  EXPECT_NEAR(std::sqrt(drift_square / kSeconds / 1000), 0.15, 0.015);
  EXPECT_NEAR(0.5 * tremor_crossings / kSeconds, 9, 1.5);  // [Hz]
  EXPECT_LT(0.5 * drift_crossings / kSeconds, 1);
}

TEST(SimNoise, DriftsWithOnePoleWhereItIsAsked) {
  constexpr double kCorner = 0.7, kLater = 0.1;
  constexpr int kSeconds = 600, kLag = static_cast<int>(1000 * kLater);
  Gaussian gaussian(6, 1);
  ColouredNoise drift = ColouredNoise::first_order(0.15, kCorner, 1000);
  std::vector<double> values;
  for (int i = 0; i < kSeconds * 1000; ++i) values.push_back(drift.next(gaussian).x());
  double square = 0, change = 0;
  for (std::size_t i = kLag; i < values.size(); ++i) {
    square += values[i] * values[i];
    change += std::pow(values[i] - values[i - kLag], 2);
  }
  EXPECT_NEAR(std::sqrt(square / static_cast<double>(values.size())), 0.15, 0.015);
  // An exponential autocorrelation: the change within a time grows with its root, not in proportion to it.
  EXPECT_NEAR(change / square, 2 * (1 - std::exp(-2 * std::numbers::pi * kCorner * kLater)), 0.08);
}

TEST(SimNoise, ShakesTheHandAtTheFrequencyThatIsAsked) {
  // The arm is stiff: the hand is where its force over the stiffness puts it.
  const auto mean_frequency = [](double asked) {
    json spec = json::parse(R"({"mass": 1e-3, "max_force": 1, "workspace": {"min": -1, "max": 1},
        "hand": {"mass": 0.1, "grip_stiffness": 5000, "grip_damping": 20, "arm_stiffness": 5e4, "arm_damping": 100,
                 "tremor": 1}})");
    spec["hand"]["tremor_hz"] = asked;
    SimDevice device(read_sim_spec(spec, "test"));
    std::vector<double> x;
    for (int i = 0; i < 20'000; ++i) {
      exchange(device, Vec3::Zero(), 1e-3);
      x.push_back(device.true_position().x());
    }
    double power = 0, moment = 0;
    for (double frequency = 1; frequency < 30; frequency += 0.05) {
      std::complex<double> sum = 0;
      for (std::size_t i = 0; i < x.size(); ++i)
        sum += x[i] * std::polar(1.0, -2 * std::numbers::pi * frequency * 1e-3 * static_cast<double>(i));
      power += std::norm(sum);
      moment += frequency * std::norm(sum);
    }
    return moment / power;
  };
  EXPECT_NEAR(mean_frequency(4), 4, 0.8);
  EXPECT_NEAR(mean_frequency(10), 10, 1.5);
}

}  // namespace
}  // namespace haptrace::test
