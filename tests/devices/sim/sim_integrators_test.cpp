// Tests of the simulated plant with every integrator.
#include "devices/sim/linear_step.h"
#include "tests/devices/support.h"

#include <array>
#include <gmock/gmock.h>

namespace haptrace::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

constexpr std::array kEveryIntegrator{Integrator::semi_implicit, Integrator::euler,    Integrator::verlet,
                                      Integrator::rk4,           Integrator::implicit, Integrator::exact};

/// The linear parts: motors, link, handle, grip, hand and arm.
const char* const kLinear = R"({
  "mass": [0.4, 0.5, 0.3], "viscous": 1, "gravity_bias": [0.5, -1, 1], "max_force": 9,
  "structural_mode": {"frequency_hz": 60, "damping_ratio": 0.05, "handle_fraction": 0.3},
  "workspace": {"min": -9, "max": 9},
  "hand": {"mass": 0.15, "grip_stiffness": 800, "grip_damping": 4, "arm_damping": 2}})";

/// Forces that depend smoothly on the position, the actuators' lag and the arm's spring.
const char* const kSmooth = R"({
  "gravity_gradient": {"x": [-80, 40, 0], "y": [40, -80, 0], "z": [0, 0, -60]}, "actuator_bandwidth_hz": 80,
  "cogging": {"amplitude": 0.2, "period": 0.006}, "actuator_rotation": [0.3, -0.5, 0.4],
  "hand": {"arm_stiffness": 60, "arm_relaxation_s": 0.1}})";

/// The parts that are not smooth.
const char* const kRough = R"({
  "coulomb": 0.7, "stribeck": {"static_ratio": 1.25, "velocity": 0.01}, "presliding": {"distance": 8e-5},
  "backlash": 5e-5, "workspace": {"min": -0.03, "max": 0.03}})";

SimSpec spec_with(std::initializer_list<const char*> parts) {
  json spec = json::object();
  for (const char* part : parts) spec.merge_patch(json::parse(part));
  return read_sim_spec(spec, "test");
}

SimOptions by(Integrator integrator, double step) {
  SimOptions options;
  options.integrator = integrator;
  options.longest_step = step;
  return options;
}

/// Returns the position of the handle at every tick for 1 s, under the same forces for every integrator.
std::vector<Vec3> movement(const SimSpec& spec, Integrator integrator, double step) {
  SimDevice device(spec, by(integrator, step));
  std::vector<Vec3> positions;
  for (int k = 0; k < 1000; ++k) {
    exchange(device, Vec3(2 * std::sin(0.02 * k), std::cos(0.013 * k), k < 500 ? 1.5 : -1), 1e-3);
    positions.push_back(device.true_position());
  }
  return positions;
}

/// Returns the rms difference relative to the rms of the true movement.
double off(const std::vector<Vec3>& movement, const std::vector<Vec3>& truth) {
  double between = 0, moved = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    between += (movement[i] - truth[i]).squaredNorm();
    moved += truth[i].squaredNorm();
  }
  return std::sqrt(between / moved);
}

double order(const SimSpec& spec, Integrator integrator, double step, const std::vector<Vec3>& truth) {
  return std::log2(off(movement(spec, integrator, step), truth) / off(movement(spec, integrator, step / 2), truth));
}

TEST(SimIntegrators, HaveTheirOrdersOnALinearMechanism) {
  const SimSpec spec = spec_with({kLinear});
  const std::vector<Vec3> truth = movement(spec, Integrator::exact, 1e-3);
  EXPECT_NEAR(order(spec, Integrator::semi_implicit, 2e-5, truth), 1, 0.05);
  EXPECT_NEAR(order(spec, Integrator::euler, 1e-5, truth), 1, 0.05);
  EXPECT_NEAR(order(spec, Integrator::implicit, 2e-5, truth), 1, 0.05);
  EXPECT_NEAR(order(spec, Integrator::verlet, 1e-4, truth), 2, 0.05);
  EXPECT_NEAR(order(spec, Integrator::rk4, 5e-4, truth), 4, 0.2);
  EXPECT_LT(off(movement(spec, Integrator::exact, 5e-5), truth), 1e-12);
}

TEST(SimIntegrators, KeepThemUpToTwoWhereForcesBendSmoothly) {
  const SimSpec spec = spec_with({kLinear, kSmooth});
  const std::vector<Vec3> truth = movement(spec, Integrator::rk4, 2e-6);
  EXPECT_NEAR(order(spec, Integrator::semi_implicit, 5e-5, truth), 1, 0.05);
  EXPECT_NEAR(order(spec, Integrator::euler, 1e-5, truth), 1, 0.05);
  EXPECT_NEAR(order(spec, Integrator::implicit, 5e-5, truth), 1, 0.05);
  for (const Integrator integrator : {Integrator::verlet, Integrator::rk4, Integrator::exact})
    EXPECT_NEAR(order(spec, integrator, 1e-4, truth), 2, 0.05) << to_string(integrator);
}

TEST(SimIntegrators, ComeToTheSameMovementThroughFrictionBacklashAndWalls) {
  const SimSpec spec = spec_with({kLinear, kSmooth, kRough});
  const std::vector<Vec3> truth = movement(spec, Integrator::semi_implicit, 2e-6);
  for (const Integrator integrator : kEveryIntegrator) {
    const double coarse = off(movement(spec, integrator, 4e-5), truth),
                 fine = off(movement(spec, integrator, 1e-5), truth);
    EXPECT_LT(coarse, 0.005) << to_string(integrator);
    EXPECT_LT(fine, 0.35 * coarse) << to_string(integrator);  // order 1
  }
}

/// Returns the largest and the smallest surplus of energy over the motors' work, relative to the absolute work.
std::pair<double, double> energy_balance(const SimSpec& spec, Integrator integrator) {
  SimDevice device(spec, by(integrator, 50e-6));
  RandomForce push(17, 4);
  const double start = device.plant().energy();
  double given = 1e-6, before = 0, most = 0, least = 0;
  for (int k = 0; k < 4000; ++k) {
    exchange(device, k < 2000 ? push(1e-3) : Vec3::Zero(), 1e-3);
    const double work = device.plant().motor_work();
    given += std::abs(work - before);
    before = work;
    const double surplus = (device.plant().energy() - start - work) / given;
    most = std::max(most, surplus);
    least = std::min(least, surplus);
  }
  return {most, least};
}

TEST(SimIntegrators, CreateNoEnergyExceptForEuler) {
  const SimSpec conservative = spec_with({kLinear, kSmooth, R"({"viscous": 0,
      "structural_mode": {"damping_ratio": 0}, "hand": {"grip_damping": 0, "arm_damping": 0, "arm_stiffness": 0}})"}),
                everything = spec_with({kLinear, kSmooth, kRough});
  for (const Integrator integrator :
       {Integrator::semi_implicit, Integrator::verlet, Integrator::rk4, Integrator::implicit, Integrator::exact}) {
    const auto [surplus, lack] = energy_balance(conservative, integrator);
    EXPECT_LT(surplus, 0.01) << to_string(integrator);
    // Semi-implicit steps conserve a modified energy, off by the ratio of step to period. Implicit steps damp.
    if (integrator != Integrator::implicit) {
      EXPECT_GT(lack, integrator == Integrator::semi_implicit ? -0.1 : -0.01) << to_string(integrator);
    }
    EXPECT_LT(energy_balance(everything, integrator).first, 0.005) << to_string(integrator);
  }
}

TEST(SimIntegrators, RigidFrictionSticksByEachOfThem) {
  for (const Integrator integrator : kEveryIntegrator) {
    SimDevice device(spec_with({R"({"mass": 1, "max_force": 9, "coulomb": 2, "viscous": 1})"}), by(integrator, 1e-3));
    for (int k = 0; k < 500; ++k) exchange(device, Vec3(1.99, 0, -1.99), 1e-3);
    EXPECT_LT(device.true_position().norm(), 1e-15) << to_string(integrator);
    for (int k = 0; k < 500; ++k) exchange(device, Vec3(2.5, 0, 0), 1e-3);
    EXPECT_NEAR(device.true_velocity().x(), 0.5 * (1 - std::exp(-0.5)), 2e-4) << to_string(integrator);
    for (int k = 0; k < 500; ++k) exchange(device, Vec3::Zero(), 1e-3);
    EXPECT_EQ(device.true_velocity().x(), 0) << to_string(integrator);
  }
}

TEST(SimIntegrators, StayFiniteAndInsideUnderAnyForce) {
  const std::array specs{
      R"({"mass": 1e-4, "coulomb": 0.7, "viscous": 1, "presliding": {"stiffness": 1e8, "damping": 100}})",
      R"({"mass": 1e-5, "viscous": 1, "coulomb": 0.1, "hand": "loose"})",
      R"({"mass": 1000, "coulomb": 0.7, "viscous": 1, "presliding": {"stiffness": 1e8}, "hand": "finger"})",
      R"({"mass": 0.02, "viscous": 1, "axes": "xz", "cogging": {"amplitude": 0.5, "period": 0.001},
          "structural_mode": {"frequency_hz": 2000, "damping_ratio": 0.1, "handle_fraction": 0.02}, "hand": "tense"})",
      R"({"mass": 0.3, "viscous": 1, "backlash": 1e-3, "gravity_gradient": [5000, -5000, 200],
          "structural_mode": {"frequency_hz": 300, "damping_ratio": 0.1}, "hand": "firm"})"};
  for (const char* spec : specs)
    for (const Integrator integrator : kEveryIntegrator)
      for (const double step : {50e-6, 10e-3}) {
        SimOptions options = by(integrator, step);
        options.lets_go_at = 0.2;
        SimDevice device(spec_with({R"({"max_force": 8, "workspace": {"min": -0.1, "max": 0.1}})", spec}), options);
        RandomForce force(29, 8);
        Gaussian jitter(4, 4);
        for (int k = 0; k < 400; ++k) {
          const double dt = 1e-3 * std::abs(1 + 0.3 * jitter());
          const Vec3 position = exchange(device, force(dt), dt).position;
          ASSERT_TRUE(is_finite(position) && position.cwiseAbs().maxCoeff() < 0.2)
              << spec << " by " << to_string(integrator) << ", tick " << k << ", at " << position.transpose();
        }
      }
}

TEST(SimIntegrators, ShortenAnUnstableStepAndNoteIt) {
  const SimSpec spring = spec_with({R"({"mass": 0.1, "max_force": 9, "hand": {"mass": 1e4, "grip_stiffness": 1e5,
                                       "grip_damping": 20}})"});
  const auto step = [&](Integrator integrator) {
    return SimDevice(spring, by(integrator, 10e-3)).plant().longest_step();
  };
  EXPECT_NEAR(step(Integrator::euler), 0.8 * 20 / 1e5, 1e-8);
  EXPECT_NEAR(step(Integrator::verlet), 0.8 * (std::sqrt(20 * 20 + 4 * 0.1 * 1e5) - 20) / 1e5, 1e-8);
  EXPECT_NEAR(step(Integrator::exact), 0.8 * 2 / 1e3, 1e-8);
  EXPECT_GT(step(Integrator::rk4), step(Integrator::verlet));
  EXPECT_EQ(step(Integrator::implicit), 10e-3);
  EXPECT_LT(step(Integrator::semi_implicit), step(Integrator::verlet));
  const SimDevice shortened(spring, by(Integrator::exact, 10e-3));
  EXPECT_THAT(shortened.info().notes, testing::Contains(HasSubstr("0.0016 s at most, not of 0.01 s")));
  EXPECT_THAT(SimDevice(spring, by(Integrator::implicit, 10e-3)).info().notes, testing::IsEmpty());
}

TEST(SimIntegrators, EulerIsRefusedWhereNoStepIsStable) {
  const SimSpec ringing = spec_with({R"({"mass": 0.1, "max_force": 9, "hand": {"mass": 1, "grip_stiffness": 1e5}})"});
  EXPECT_THAT(error_of([&] { SimDevice(ringing, by(Integrator::euler, 50e-6)); }),
              testing::AllOf(HasSubstr("integrator euler: no step is stable for the simulated device"),
                             HasSubstr("use another integrator")));
  const SimDevice taken(ringing, by(Integrator::verlet, 50e-6));
  EXPECT_EQ(taken.plant().longest_step(), 50e-6);
}

TEST(SimIntegrators, OfOneMassAreRefusedWhereTheMassVaries) {
  const SimSpec varying = spec_with({R"({"mass": 0.1, "max_force": 9, "inertia": {"variation": 0.5}})"});
  for (const Integrator integrator : {Integrator::euler, Integrator::verlet, Integrator::rk4, Integrator::exact})
    EXPECT_THAT(error_of([&] { SimDevice(varying, by(integrator, 50e-6)); }),
                testing::AllOf(HasSubstr("varies with the place"), HasSubstr("use semi-implicit")));
  EXPECT_NO_THROW(SimDevice(varying, by(Integrator::semi_implicit, 50e-6)));
}

TEST(SimIntegrators, AreOptionsOfTheDevice) {
  const auto of = [](const std::string& options) {
    return open_sim_device(DeviceSpec::parse("sim:preset=falcon,hand=relaxed" + options));
  };
  std::vector<Vec3> at;
  for (const char* options : {"", ",integrator=semi-implicit,step=5e-5", ",step=2e-5", ",integrator=verlet"}) {
    const auto device = of(options);
    for (int k = 0; k < 200; ++k) exchange(*device, Vec3(1, 2, 0), 1e-3);
    at.push_back(device->true_position());
  }
  EXPECT_EQ(at[0], at[1]);
  EXPECT_NE(at[0], at[2]);
  EXPECT_NE(at[0], at[3]);
  EXPECT_LT((at[0] - at[3]).norm(), 0.01 * at[0].norm());
  EXPECT_THAT(open_error("sim:integrator=leapfrog"), HasSubstr("'leapfrog'"));
  EXPECT_THAT(open_error("sim:step=1"), HasSubstr("step"));
}

}  // namespace
}  // namespace haptrace::test
