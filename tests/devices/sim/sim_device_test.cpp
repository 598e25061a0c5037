// Tests of the simulated device's options and of its hand's intent.
#include "control/path/min_jerk.h"
#include "tests/devices/support.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

namespace haptrace::test {
namespace {

using testing::AllOf;
using testing::HasSubstr;

/// Returns a minimum-jerk reach of 60 mm along x in 1.2 s from (-0.03, 0.01, 0) m, sampled unevenly.
Path reach() {
  Path path;
  path.name = "reach";
  for (double t = 0; t <= 1.2; t += 0.004 + 0.003 * std::sin(40 * t)) {
    path.time.push_back(t);
    path.position.emplace_back(-0.03 + 0.06 * MinJerk::at(t / 1.2).s, 0.01, 0);
  }
  return path;
}

std::string csv(const Path& path, const Vec3& offset = Vec3::Zero()) {
  std::string text = "t,x,y,z\n";
  for (std::size_t i = 0; i < path.size(); ++i) {
    const Vec3 p = path.position[i] + offset;
    text += fmt::format("{},{},{},{}\n", path.time[i], p.x(), p.y(), p.z());
  }
  return text;
}

SimSpec with_hand(const char* device, const char* hand) {
  nlohmann::json spec = nlohmann::json::parse(device);
  spec["hand"] = nlohmann::json::parse(hand);
  return read_sim_spec(spec, "test");
}

double worst_error(SimDevice& device, double duration, double dt) {
  const Path path = reach();
  const Trajectory intended(path, Interpolation::cubic);
  double worst = 0, t = 0;
  for (; t < duration; t += dt) {
    worst = std::max(worst, (device.true_position() - intended.sample(t).position).norm());
    exchange(device, Vec3::Zero(), dt);
  }
  return worst;
}

TEST(SimIntent, StartsAtRestWhereTheHandIntendsToBegin) {
  const SimSpec spec =
      with_hand(R"({"mass": 0.1, "max_force": 5, "actuator_rotation": [0.3, 0.1, -0.2]})", R"("relaxed")");
  SimDevice device(spec, {.intent = Trajectory(reach(), Interpolation::cubic)});
  EXPECT_NEAR((device.true_position() - Vec3(-0.03, 0.01, 0)).norm(), 0, 1e-15);
  EXPECT_EQ(device.true_velocity(), Vec3(0, 0, 0));
}

TEST(SimIntent, IsFollowedAtItsTimeStamps) {
  const char* steady = R"({"mass": 0.1, "grip_stiffness": 2000, "grip_damping": 20, "intent_stiffness": 2000,
                           "intent_damping": 60})";
  for (const double dt : {1e-3, 0.37e-3, 0.01}) {
    SimDevice device(with_hand(R"({"mass": 0.05, "max_force": 5, "actuator_rotation": [0.3, 0.1, -0.2]})", steady),
                     {.intent = Trajectory(reach(), Interpolation::cubic)});
    EXPECT_LT(worst_error(device, 2, dt), 0.3e-3) << dt;
    EXPECT_NEAR((device.true_position() - Vec3(0.03, 0.01, 0)).norm(), 0, 2e-5) << dt;
  }
}

TEST(SimIntent, IsFollowedWithoutLagAtConstantSpeed) {
  Path ramp;
  ramp.name = "ramp";
  ramp.time = {0, 2};
  ramp.position = {Vec3(-0.1, 0, 0), Vec3(0.1, 0, 0)};
  const char* steady = R"({"mass": 0.1, "grip_stiffness": 2000, "grip_damping": 20, "intent_stiffness": 2000,
                           "intent_damping": 60})";
  for (const double dt : {1e-3, 0.3e-3, 1.5}) {
    SimDevice device(with_hand(R"({"mass": 0.05, "max_force": 5})", steady),
                     {.intent = Trajectory(ramp, Interpolation::linear)});
    for (int k = 0; k < std::lround(1.5 / dt); ++k) exchange(device, Vec3::Zero(), dt);
    EXPECT_NEAR(device.true_position().x(), -0.1 + 0.1 * 1.5, 5e-6) << dt;
    EXPECT_NEAR(device.true_velocity().x(), 0.1, 1e-5) << dt;
  }
}

TEST(SimIntent, MeetsTheResistanceOfTheDevice) {
  SimDevice device(with_hand(R"({"mass": 0.4, "max_force": 9, "coulomb": 0.7, "viscous": 1.8})", R"("relaxed")"),
                   {.intent = Trajectory(reach(), Interpolation::cubic)});
  const double worst = worst_error(device, 2, 1e-3);
  EXPECT_GT(worst, 0.3e-3);
  EXPECT_LT(worst, 10e-3);
}

TEST(SimIntent, NeedsAHand) {
  const SimSpec spec = read_sim_spec(nlohmann::json::parse(R"({"mass": 1, "max_force": 5})"), "test");
  SimDevice device(spec, {.intent = Trajectory(reach(), Interpolation::cubic)});
  EXPECT_EQ(device.true_position(), Vec3(0, 0, 0));
}

TEST(SimOptions, DefaultToTheReferenceDeviceInItsHand) {
  const auto device = open_device("sim");
  EXPECT_EQ(device->info().model, "reference device");
  EXPECT_EQ(device->info().position_resolution, 5e-5);
  EXPECT_EQ(device->info().max_force, 8.9);
}

TEST(SimOptions, ReadADeviceFromAFile) {
  const TempFolder folder;
  const std::string file = folder.write("my.json", R"({ // mine
    "model": "mine", "mass": 0.3, "max_force": 4})");
  EXPECT_EQ(open_device("sim:spec=" + file)->info().model, "mine");
  const auto changed = open_device("sim:preset=omega3,spec=" + file);
  EXPECT_EQ(changed->info().model, "mine");
  EXPECT_EQ(changed->info().position_resolution, 1e-5);
  EXPECT_THAT(open_error("sim:spec=/no/such.json"), HasSubstr("/no/such.json"));
  EXPECT_THAT(open_error("sim:spec=" + folder.write("bad.json", R"({"mass": 1, "max_force": 1, "mas": 2})")),
              AllOf(HasSubstr("bad.json"), HasSubstr("did you mean 'mass'?")));
}

TEST(SimOptions, SeedTheNoise) {
  const auto after = [](const std::string& options) {
    const auto device = open_device("sim:preset=ideal,hand=relaxed" + options);
    DeviceState state;
    for (int k = 0; k < 200; ++k) state = exchange(*device, Vec3::Zero(), 1e-3);
    return state.position;
  };
  EXPECT_EQ(after(",seed=7"), after(",seed=7"));
  EXPECT_NE(after(",seed=7"), after(",seed=8"));
  EXPECT_EQ(after(""), after(",seed=1"));
}

TEST(SimOptions, GiveEveryMechanismItsOwnSerialNumber) {
  const auto serial = [](const std::string& spec) { return open_device(spec)->info().serial; };
  EXPECT_THAT(serial("sim"), testing::MatchesRegex("[0-9a-f]{8}"));
  EXPECT_EQ(serial("sim"), serial("sim:hand=firm,seed=3"));
  EXPECT_NE(serial("sim"), serial("sim:preset=falcon"));
  const TempFolder folder;
  EXPECT_NE(serial("sim"), serial("sim:preset=reference,spec=" + folder.write("heavy.json", R"({"mass": 0.5})")));
}

TEST(SimOptions, AreCheckedOneByOne) {
  EXPECT_THAT(open_error("sim:seed=-1"), HasSubstr("seed: expected a whole number from 0, found '-1'"));
  EXPECT_THAT(open_error("sim:seed=1.5"), HasSubstr("seed: expected a whole number"));
  EXPECT_THAT(open_error("sim:hand=none,intent=a.csv"), HasSubstr("no hand holds the device (hand=none)"));
}

TEST(SimOptions, LetTheHandFollowAFile) {
  const TempFolder folder;
  const std::string file = folder.write("reach.csv", csv(reach()));
  const auto device = open_device("sim:preset=falcon,intent=" + file);
  EXPECT_NEAR((exchange(*device, Vec3::Zero(), 0).position - Vec3(-0.03, 0.01, 0)).norm(), 0, 1e-4);
  DeviceState state;
  for (int k = 0; k < 2000; ++k) state = exchange(*device, Vec3::Zero(), 1e-3);
  EXPECT_NEAR((state.position - Vec3(0.03, 0.01, 0)).norm(), 0, 5e-3);
  EXPECT_THAT(open_error("sim:intent=/no/such.csv"), HasSubstr("/no/such.csv"));
}

TEST(SimOptions, LetTheHandStartLaterAndMoveFasterThanItsPath) {
  const TempFolder folder;
  const std::string file = folder.write("reach.csv", csv(reach(), Vec3(0, 0.01, 0)));
  const std::string spec = "sim:preset=omega3,hand=firm,seed=2,intent=" + file;
  const auto plain = open_device(spec), later = open_device(spec + ",intent_after=0.5,intent_speed=2");
  const auto place = [](Device& device, double seconds) {
    Vec3 position = Vec3::Zero();
    for (int k = 0; k < std::lround(1000 * seconds); ++k) position = exchange(device, Vec3::Zero(), 1e-3).position;
    return position;
  };
  const Vec3 start = place(*plain, 0.001), before = place(*later, 0.49);
  EXPECT_NEAR((before - start).norm(), 0, 1e-3) << "it rests until then";
  const double half = 0.5 * reach().duration();
  EXPECT_NEAR((place(*later, 0.01 + 0.5 * half) - place(*plain, half)).norm(), 0, 6e-3) << "half-way in half the time";
  EXPECT_NEAR((place(*later, 0.5 * half + 1) - place(*plain, half + 1)).norm(), 0, 2e-3) << "both at the end";
  EXPECT_THAT(open_error(spec + ",intent_after=soon"),
              HasSubstr("intent_after: expected a number from 0 s, found 'soon'"));
  EXPECT_THAT(open_error(spec + ",intent_speed=0"),
              HasSubstr("intent_speed: expected a number from 0.01 to 100, found '0'"));
}

TEST(SimOptions, RefuseAnIntentOutsideTheWorkspaceUnlessItMayBeFitted) {
  const TempFolder folder;
  const std::string file = folder.write("far.csv", csv(reach(), Vec3(0.1, 0, 0)));
  EXPECT_THAT(open_error("sim:preset=falcon,intent=" + file),
              AllOf(HasSubstr("far.csv"), HasSubstr("Novint Falcon by 79.2 mm"), HasSubstr("fit=true")));
  const auto device = open_device("sim:preset=falcon,fit=true,intent=" + file);
  const double start = exchange(*device, Vec3::Zero(), 0).position.x();
  EXPECT_GT(start, device->info().workspace_min.x());
  EXPECT_LT(start, device->info().workspace_max.x());
  EXPECT_THAT(open_error("sim:preset=falcon,fit=yes,intent=" + file), HasSubstr("fit: expected true or false"));
}

TEST(SimCable, IsUnpluggedForTheConfiguredTimeAndTheHandDoesNotWait) {
  const auto device = open_device("sim:preset=falcon,hand=relaxed,seed=3,lost_at=0.2,lost_for=0.3");
  const auto twin = open_device("sim:preset=falcon,hand=relaxed,seed=3");
  DeviceState state;
  for (int k = 1; k <= 1000; ++k) {
    const Vec3 push(1, 0, 0);
    const bool out = k >= 200 && k < 500;
    // While the cable is out, no force arrives, and the last force before does not persist.
    const bool arrives = k < 201 || k > 500;
    const Vec3 position = exchange(*twin, arrives ? push : Vec3::Zero(), 1e-3).position;
    const Device::Status status = device->exchange({push, Vec3::Zero()}, 1e-3, state);
    ASSERT_EQ(status, out ? Device::Status::away : Device::Status::ok) << k;
    if (!out) {
      ASSERT_EQ(state.position, position) << k;
    } else {
      ASSERT_THAT(device->lost_reason(), HasSubstr("cable"));
    }
  }
}

TEST(SimCable, StaysUnpluggedWithoutAConfiguredTime) {
  const auto device = open_device("sim:lost_at=0.01");
  DeviceState state;
  for (int k = 1; k < 100; ++k)
    ASSERT_EQ(device->exchange({}, 1e-3, state), k < 10 ? Device::Status::ok : Device::Status::lost) << k;
}

TEST(SimCable, RejectsInvalidOptions) {
  EXPECT_THAT(open_error("sim:lost_at=-1"), HasSubstr("lost_at: expected a number from 0 s, found '-1'"));
  EXPECT_THAT(open_error("sim:lost_at=2kg"), HasSubstr("lost_at:"));
  EXPECT_THAT(open_error("sim:lost_at=nan"), HasSubstr("lost_at: expected a number"));
  EXPECT_THAT(open_error("sim:lost_for=1"), HasSubstr("set it with lost_at"));
}

}  // namespace
}  // namespace haptrace::test
