// Tests of the simulated mechanism with extreme specs: masses, stiffnesses, friction, steps.
#include "tests/extremes/support.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <memory>

namespace haptrace {
namespace {

using test::error_of, test::sim_spec;
using testing::HasSubstr;

/// Pushes a device for `ticks` of 1 ms and expects it to stay finite and near its walls. A mass of 1 mg hits them at
/// kilometres per second.
void push_about(const SimSpec& spec, int ticks, double longest_step = SimOptions{}.longest_step) {
  SimDevice device(spec, {.longest_step = longest_step});
  Gaussian random(5, 5);
  for (int k = 0; k < ticks; ++k) {
    DeviceState state;
    const Vec3 force = 0.5 * spec.max_force * random.vector();
    ASSERT_EQ(device.exchange({force, Vec3::Zero()}, 1e-3, state), Device::Status::ok);
    ASSERT_TRUE(is_finite(state.position) && is_finite(device.true_velocity())) << "tick " << k;
    ASSERT_LT(device.true_position().cwiseAbs().maxCoeff(), 1.5) << "tick " << k;
    if (spec.force_sensor) {
      ASSERT_TRUE(is_finite(state.force)) << "tick " << k;
    }
  }
}

TEST(Plant, WithstandsMassesFromAMilligramToTenTonnes) {
  for (const char* mass : {"1e-6", "1e-3", "1", "1000", "1e4"})
    for (const char* hand : {"none", "finger", "tense"}) {
      SCOPED_TRACE(fmt::format("{} kg held by {}", mass, hand));
      push_about(sim_spec(fmt::format(R"({{"mass": {}, "max_force": 8, "viscous": 0.1, "coulomb": 0.2, "hand": "{}",
                                           "force_sensor": true}})",
                                      mass, hand)),
                 200);
    }
  for (const char* mass : {"0", "-1", "9e-7", "1.1e4"})
    EXPECT_THAT(error_of([&] { (void)sim_spec(fmt::format(R"({{"mass": {}, "max_force": 8}})", mass)); }),
                HasSubstr("mass"));
}

TEST(Plant, WithstandsStiffnessesUpToABillion) {
  for (const char* stiffness : {"1e-6", "1", "1e5", "1e9"}) {
    SCOPED_TRACE(fmt::format("{} N/m", stiffness));
    // A stiff grip on a heavy hand, a stiff arm behind a soft grip, and a field that pulls back.
    const std::string body = R"({"mass": 1, "max_force": 8, "force_sensor": true, )";
    push_about(sim_spec(fmt::format(R"({}"hand": {{"mass": 1, "grip_stiffness": {}, "grip_damping": 10}}}})", body,
                                    stiffness)),
               20);
    push_about(sim_spec(fmt::format(
                   R"({}"hand": {{"mass": 1, "grip_stiffness": 100, "arm_stiffness": {}, "arm_relaxation_s": 0.1}}}})",
                   body, stiffness)),
               20);
    push_about(sim_spec(fmt::format(R"({}"gravity_gradient": -{}}})", body, stiffness)), 20);
    EXPECT_THAT(error_of([&] { (void)sim_spec(body + R"("hand": {"mass": 1, "grip_stiffness": 1.1e9}})"); }),
                HasSubstr("grip_stiffness"));
  }
  push_about(sim_spec(R"({"mass": 0.02, "max_force": 8, "backlash": 1e-3,
                          "structural_mode": {"frequency_hz": 5000, "handle_fraction": 0.01}})"),
             100);
}

TEST(Plant, WithstandsDampingUpToAHundredThousand) {
  for (const char* mass : {"1e-6", "0.4"})
    for (const char* viscous : {"0", "1e-6", "1e5"}) {
      SCOPED_TRACE(fmt::format("{} kg, {} N s/m", mass, viscous));
      push_about(sim_spec(fmt::format(R"({{"mass": {}, "max_force": 8, "viscous": {}}})", mass, viscous)), 200);
    }
}

TEST(Plant, WithstandsStepsFromANanosecondToAnHour) {
  const SimSpec spec = sim_spec(R"({"mass": 0.4, "viscous": 2, "coulomb": 0.3, "max_force": 8, "hand": "relaxed",
                                    "delay_s": 0.016, "actuator_bandwidth_hz": 1e5})");
  for (const double dt : {1e-9, 1e-6, 0.3, 10.}) {
    SCOPED_TRACE(fmt::format("{} s", dt));
    SimDevice device(spec);
    for (int k = 0; k < 20; ++k) {
      DeviceState state;
      ASSERT_EQ(device.exchange({Vec3(2, -1, 3), Vec3::Zero()}, dt, state), Device::Status::ok);
      ASSERT_TRUE(is_finite(state.position));
      ASSERT_LT(device.true_position().cwiseAbs().maxCoeff(), 1.1);
    }
  }
  // The step is far too long for friction and walls; they withstand it, since they are implicit.
  const SimSpec free = sim_spec(R"({"mass": 0.4, "viscous": 2, "coulomb": 0.3, "max_force": 8,
                                    "presliding": {"stiffness": 1e9}})");
  SimDevice device(free, {.longest_step = 3600});
  DeviceState state;
  for (const double dt : {1e-3, 1., 3600.}) {
    ASSERT_EQ(device.exchange({Vec3(2, -1, 3), Vec3::Zero()}, dt, state), Device::Status::ok);
    EXPECT_TRUE(is_finite(state.position));
  }
}

TEST(Plant, EndsTheSessionInAFieldThatThrowsItOut) {
  // The spec itself is unstable, not its integration: the device leaves through its walls, and the force ends.
  SimDevice sim(sim_spec(R"({"mass": 1, "max_force": 8, "gravity_gradient": 1e9, "gravity_bias": 1e-3})"));
  test::Watched device(sim);
  test::Log log;
  test::Scripted controller([](const State& state) {
    Command command;
    command.wrench.force = -100 * state.position;
    return command;
  });
  EXPECT_EQ(test::run(device, controller, log).cause, StopCause::outside_workspace);
  EXPECT_TRUE(log.has(EventCode::outside_workspace));
}

TEST(Friction, IsStableAndPassiveAtAnyStiffness) {
  for (const double stiffness : {1e-3, 1., 1e3, 1e6, 1e9, 1e12})
    for (const double damping : {0., 1., 1e5})
      for (const double mass : {1e-6, 0.4, 1e3}) {
        SCOPED_TRACE(fmt::format("{} N/m, {} N s/m, {} kg", stiffness, damping, mass));
        SimDevice device(sim_spec(fmt::format(
            R"({{"mass": {}, "max_force": 8, "coulomb": 0.7, "presliding": {{"stiffness": {}, "damping": {}}},
                 "stribeck": {{"static_ratio": 2, "velocity": 1e-3}}}})",
            mass, stiffness, damping)));
        DeviceState state;
        const double heaviest = std::min(8.0, 10 * mass);  // keeps it within its walls
        for (int k = 0; k < 20; ++k)
          ASSERT_EQ(device.exchange({Vec3(heaviest, 0, 0), Vec3::Zero()}, 1e-3, state), Device::Status::ok);
        // Without force it only loses energy, except for the ripple of a soft bristle's energy in symplectic steps.
        const double energy = device.plant().energy();
        for (int k = 0; k < 200; ++k) {
          ASSERT_EQ(device.exchange({}, 1e-3, state), Device::Status::ok);
          ASSERT_TRUE(is_finite(state.position));
          ASSERT_LE(device.plant().energy(), 1.1 * energy + 1e-15) << "tick " << k;
        }
      }
}

TEST(Friction, HoldsForcesUpToItsLimitAtAnyStiffness) {
  // Rigid friction does not move. A bristle yields and then creeps by a few of its lengths (LuGre).
  for (const auto& [presliding, allowed] : {std::pair{"", 0.0},
                                            {R"("presliding": {"stiffness": 1e5, "damping": 20},)", 20 * 0.7 / 1e5},
                                            {R"("presliding": {"stiffness": 1e9},)", 20 * 0.7 / 1e9},
                                            {R"("presliding": {"stiffness": 1e12},)", 20 * 0.7 / 1e12}})
    for (const char* mass : {"1e-6", "0.4", "1000"}) {
      SCOPED_TRACE(fmt::format("{} kg, {}", mass, presliding));
      SimDevice device(sim_spec(fmt::format(R"({{"mass": {}, "max_force": 8, {} "coulomb": 0.7}})", mass, presliding)));
      DeviceState state;
      for (int k = 0; k < 1000; ++k)
        ASSERT_EQ(device.exchange({Vec3(0.6, 0, 0), Vec3::Zero()}, 1e-3, state), Device::Status::ok);
      EXPECT_LE(device.true_position().norm(), allowed);
    }
}

}  // namespace
}  // namespace haptrace
