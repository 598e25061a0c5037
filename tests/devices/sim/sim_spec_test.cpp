#include "base/json_reader.h"
#include "control/design/lqg_search.h"
#include "devices/sim/presets.h"
#include "devices/sim/spec.h"
#include "tests/devices/support.h"

#include <gmock/gmock.h>

namespace haptrace::test {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

/// Returns the error from reading the spec of a device of 1 kg and 10 N with `changes`.
std::string refused_spec(const char* changes) {
  json spec = json::parse(R"({"mass": 1, "max_force": 10})");
  spec.merge_patch(json::parse(changes));
  return error_of([&] { (void)read_sim_spec(spec, "my.json"); });
}

TEST(SimSpec, LeavesOutPropertiesThatAreNotNamed) {
  const SimSpec spec = read_sim_spec(json::parse(R"({"mass": 1, "max_force": 10})"), "my.json");
  EXPECT_EQ(spec.mass, Vec3(1, 1, 1));
  EXPECT_EQ(spec.max_force, 10);
  EXPECT_TRUE(spec.viscous.isZero(0) && spec.coulomb.isZero(0) && spec.presliding_stiffness.isZero(0));
  EXPECT_TRUE(spec.gravity_bias.isZero(0) && spec.gravity_gradient.isZero(0) && spec.cogging.isZero(0));
  EXPECT_EQ(spec.delay, 0);
  EXPECT_EQ(spec.position_resolution, 0);
  EXPECT_FALSE(spec.structural_mode || spec.hand || spec.force_sensor);
}

TEST(SimSpec, RefusesAKeyItDoesNotKnowWithTheNearest) {
  EXPECT_THAT(refused_spec(R"({"colomb": 1})"), AllOf(HasSubstr("my.json"), HasSubstr("did you mean 'coulomb'?")));
  EXPECT_THAT(refused_spec(R"({"hand": {"mass": 1, "tremr": 1}})"), HasSubstr("did you mean 'tremor'?"));
  EXPECT_THAT(refused_spec(R"({"coulomb": 1, "presliding": {"distnce": 1}})"), HasSubstr("presliding"));
}

TEST(SimSpec, RefusesADeviceWithoutMassOrForce) {
  EXPECT_THAT(refused_spec(R"({"mass": 0})"), HasSubstr("mass: 0 is too small"));
  EXPECT_THAT(refused_spec(R"({"mass": [1, 1, -1]})"), HasSubstr("mass[2]: -1 is too small"));
  EXPECT_THAT(refused_spec(R"({"mass": null})"), HasSubstr("'mass' is missing"));
  EXPECT_THAT(refused_spec(R"({"max_force": null})"), HasSubstr("'max_force' is missing"));
  EXPECT_THAT(refused_spec(R"({"max_force": 0})"), HasSubstr("max_force: 0 is too small"));
}

TEST(SimSpec, RejectsInvalidValues) {
  EXPECT_THAT(refused_spec(R"({"delay_s": -0.001})"), HasSubstr("delay_s: -0.001 is too small"));
  EXPECT_THAT(refused_spec(R"({"stribeck": {"static_ratio": 1.2}})"),
              HasSubstr("it needs 'coulomb', which is missing"));
  EXPECT_THAT(refused_spec(R"({"presliding": {"distance": 1e-4}})"), HasSubstr("it needs 'coulomb', which is missing"));
  EXPECT_THAT(refused_spec(R"({"coulomb": 1, "presliding": {}})"),
              HasSubstr("either 'distance' (m) or 'stiffness' (N/m)"));
  EXPECT_THAT(refused_spec(R"({"coulomb": 1, "presliding": {"distance": 1e-4, "stiffness": 1e4}})"),
              HasSubstr("either"));
  EXPECT_THAT(refused_spec(R"({"backlash": 1e-4})"), HasSubstr("needs a 'structural_mode'"));
  EXPECT_THAT(refused_spec(R"({"inertia": {"variation": 1}})"), HasSubstr("variation: 1 is too large"));
  EXPECT_THAT(refused_spec(R"({"motor_limit": 11})"), HasSubstr("motor_limit: 11 is too large"));
  EXPECT_THAT(refused_spec(R"({"hand": {"mass": 0.1, "drift_hz": 0.01}})"), HasSubstr("drift_hz: 0.01 Hz is too slow"));
  EXPECT_THAT(refused_spec(R"({"structural_mode": {}})"), HasSubstr("'frequency_hz' is missing"));
  EXPECT_THAT(refused_spec(R"({"workspace": {"min": 0.1, "max": -0.1}})"), HasSubstr("'min' must lie below 'max'"));
  EXPECT_THAT(refused_spec(R"({"gravity_gradient": {"x": [0, 1, 0]}})"), HasSubstr("not symmetric"));
  EXPECT_THAT(refused_spec(R"({"max_continuous_force": 11})"), HasSubstr("max_continuous_force: 11 is too large"));
  EXPECT_THAT(refused_spec(R"({"axes": "xyy"})"), HasSubstr("'xyy' is not a selection of x, y and z"));
  EXPECT_THAT(refused_spec(R"({"axes": ""})"), HasSubstr("needs at least one axis"));
  EXPECT_THAT(refused_spec(R"({"axes": "xy", "actuator_rotation": [0.1, 0, 1]})"), HasSubstr("can only turn about it"));
  EXPECT_THAT(refused_spec(R"({"axes": "xy", "workspace": {"min": 0.1, "max": 0.2}})"), HasSubstr("z is held at 0"));
}

TEST(SimSpec, TakesAHandByNameOrInParts) {
  json spec = json::parse(R"({"mass": 1, "max_force": 10, "hand": "firm"})");
  EXPECT_EQ(read_sim_spec(spec, "my.json").hand->grip_stiffness, 2000);
  spec["hand"] = json::parse(R"({"preset": "firm", "tremor": 0})");
  EXPECT_EQ(read_sim_spec(spec, "my.json").hand->grip_stiffness, 2000);
  EXPECT_EQ(read_sim_spec(spec, "my.json").hand->tremor, 0);
  spec["hand"] = json::parse(R"({"mass": 0.3})");
  EXPECT_EQ(read_sim_spec(spec, "my.json").hand->grip_stiffness, 0);
  spec["hand"] = "none";
  EXPECT_FALSE(read_sim_spec(spec, "my.json").hand);

  EXPECT_THAT(refused_spec(R"({"hand": "frim"})"),
              HasSubstr("my.json: hand: there is no hand preset 'frim'; did you mean 'firm'?"));
  EXPECT_THAT(refused_spec(R"({"hand": {"preset": "frim"}})"), HasSubstr("did you mean 'firm'?"));
  EXPECT_THAT(refused_spec(R"({"hand": {"tremor": 1}})"), HasSubstr("'mass' is missing"));
  EXPECT_THAT(refused_spec(R"({"hand": 3})"), HasSubstr("hand"));
}

TEST(SimSpec, FindsAnIntentBesideTheFile) {
  const json spec = json::parse(R"({"mass": 1, "max_force": 10, "hand": {"preset": "firm", "intent": "stroke.csv"}})");
  EXPECT_EQ(read_sim_spec(spec, "my.json", "lab/arm").hand->intent, "lab/arm/stroke.csv");
  EXPECT_EQ(read_sim_spec(spec, "my.json").hand->intent, "stroke.csv");
}

TEST(SimSpec, ReadsTheSampleThatNamesEveryKey) {
  const json sample = load_json(SAMPLE_DEVICES "/example.json");
  const SimSpec spec = read_sim_spec(sample, "example.json");
  EXPECT_EQ(spec.gravity_gradient(0, 1), 1);
  EXPECT_EQ(spec.presliding_damping, 1);
  EXPECT_NEAR(spec.presliding_stiffness.x(), 8750, 1e-9);
  EXPECT_TRUE(spec.force_sensor);
  EXPECT_EQ(spec.structural_mode->handle_fraction, 0.3);
  EXPECT_EQ(spec.hand->tremor, 0.04);
  EXPECT_EQ(spec.hand->tremor_hz, 9);
  EXPECT_EQ(spec.hand->drift_hz, 0.7);
  EXPECT_EQ(spec.inertia_variation, 0.1);
  EXPECT_EQ(spec.inertia_length, 0.08);
  EXPECT_EQ(spec.strongest(), 8);
}

TEST(SimPresets, AreSuggestedWhenMistyped) {
  EXPECT_THAT(open_error("sim:preset=omga3"), HasSubstr("there is no device preset 'omga3'; did you mean 'omega3'?"));
  EXPECT_THAT(open_error("sim:hand=relaxd"), HasSubstr("there is no hand preset 'relaxd'; did you mean 'relaxed'?"));
}

TEST(SimPresets, KnowTheOmniByBothItsNames) {
  EXPECT_EQ(device_preset("omni", "test"), device_preset("touch", "test"));
}

TEST(SimPresets, HaveCompleteHands) {
  for (const std::string& name : hand_preset_names()) {
    if (name == "none") continue;
    const json spec{{"mass", 1}, {"max_force", 10}, {"hand", name}};
    const HandSpec hand = *read_sim_spec(spec, name).hand;
    EXPECT_GT(hand.grip_stiffness, 0) << name;
    EXPECT_GT(hand.intent_stiffness, 0) << name;
  }
}

TEST(SimSpec, MovesLikeThePlantModelThatItWasMadeFrom) {
  PlantModel plant;
  plant.mass = Vec3(0.2, 0.4, 0.4);
  plant.viscous = Vec3(4, 0, 0);
  plant.coulomb = Vec3(0, 2, 0);
  plant.gravity = Vec3(0, 0, -2);
  plant.delay = 5e-3;
  plant.position_resolution = 1e-4;
  SimDevice device(sim_spec_of(plant, 50, 2e-3));
  Vec3 measured;
  for (int k = 0; k < 100; ++k) measured = exchange(device, Vec3(2, 1.9, 0), 1e-3).position;
  // The delay and the lag each delay the velocity by their own length.
  const double time_constant = 0.05, since = 0.1 - 5e-3;
  EXPECT_NEAR(device.true_velocity().x(), 0.5 * (1 - std::exp(-since / time_constant)), 1e-3);
  EXPECT_EQ(device.true_velocity().y(), 0);
  EXPECT_NEAR(device.true_velocity().z(), -0.5, 1e-9);
  EXPECT_NEAR(std::remainder(measured.z(), 1e-4), 0, 1e-12);

  EXPECT_THAT(error_of([&] { (void)sim_spec_of(plant, 50, 6e-3); }), HasSubstr("lag of 0.006 s"));
  plant.gravity_gradient(0, 1) = 1;
  EXPECT_THAT(error_of([&] { (void)sim_spec_of(plant, 50); }), HasSubstr("not symmetric"));
  plant.mass.y() = 0;
  EXPECT_THAT(error_of([&] { (void)sim_spec_of(plant, 50); }), HasSubstr("mass above zero"));
}

TEST(HandPreset, IsTheHandOfTheLqgSearch) {
  struct Hand {
    const char* name;
    HandModel model;
    bool arm;  // is the same, too
  };
  for (const Hand& hand :
       {Hand{"relaxed", kRelaxedHand, false}, {"loose", kLooseHand, true}, {"firm", kFirmHand, true}}) {
    SCOPED_TRACE(hand.name);
    const json preset = hand_preset(hand.name, "");
    EXPECT_EQ(preset["mass"], hand.model.mass);
    EXPECT_EQ(preset["grip_stiffness"], hand.model.grip_stiffness);
    EXPECT_EQ(preset["grip_damping"], hand.model.grip_damping);
    if (!hand.arm) continue;
    EXPECT_EQ(preset["arm_stiffness"], hand.model.arm_stiffness);
    EXPECT_EQ(preset["arm_damping"], hand.model.arm_damping);
    EXPECT_EQ(preset["arm_relaxation_s"], hand.model.arm_relaxation_s);
  }
}

class DevicePreset : public testing::TestWithParam<std::string> {};

TEST_P(DevicePreset, HeldByAHandStaysWithinItsWalls) {
  const auto device = open_device("sim:hand=relaxed,preset=" + GetParam());
  const DeviceInfo& info = device->info();
  RandomForce force(31, info.max_force);
  for (int k = 0; k < 10000; ++k) {
    const Vec3 p = exchange(*device, force(1e-3), 1e-3).position;
    ASSERT_TRUE(is_finite(p));
    ASSERT_LT((p - p.cwiseMax(info.workspace_min).cwiseMin(info.workspace_max)).norm(), 0.02) << "tick " << k;
  }
}

INSTANTIATE_TEST_SUITE_P(Devices, DevicePreset, testing::ValuesIn(device_preset_names()), [](const auto& preset) {
  std::string name = preset.param;
  std::replace(name.begin(), name.end(), '.', '_');
  return name;
});

}  // namespace
}  // namespace haptrace::test
