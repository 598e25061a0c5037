#include "formats/documents/device_profile.h"

#include "base/error.h"
#include "base/rfc3339.h"
#include "tests/formats/support.h"
#include "tests/support/errors.h"

#include <Eigen/Geometry>

#include <cstdlib>
#include <gmock/gmock.h>
#include <set>

namespace haptrace {
namespace {

using nlohmann::json;

const std::chrono::system_clock::time_point kMade = std::chrono::system_clock::from_time_t(1'770'000'000);

DeviceProfile example() {
  DeviceProfile profile;
  profile.device = {"sim", "Novint Falcon", "0a1b"};
  profile.facts = {8.9, 5e-5, {Vec3(-0.1, -0.1, -0.05), Vec3(0.1, 0.1, 0.05)}};
  profile.created = rfc3339(kMade);
  profile.software = "haptrace 0.1";
  profile.plant = {Vec3(0.4, 0.41, 0.1 + 0.2),
                   Vec3(1, 2, 3),
                   Vec3(0.7, 0.8, 0.9),
                   Vec3(-1, 0.5, 1),
                   Eigen::Matrix3d::Identity() * -7,
                   1.0 / 3000,
                   5e-5,
                   1e-7};
  profile.plant.gravity_gradient(0, 2) = 4;
  profile.half_width.mass = Vec3(0.01, 0.02, 0.03);
  profile.line_residual = 0.12;
  profile.sweep_residual = 0.09;
  profile.design.gains = {Vec3(3000, 3100, 3200), Vec3(25, 26, 27)};
  profile.design.largest = {Vec3(6000, 6100, 6200), Vec3(50, 51, 52)};
  profile.design.mass = Vec3(0.44, 0.45, 0.46);
  profile.design.observer_hz = 40;
  profile.design.verdict = {true, 2, "its error is large", "2026-01-31T12:00:00Z", 0.47};
  profile.design.plain_calm = true;
  profile.design.stiff_error = 0.6;
  profile.design.stiff_ripple = 0.8;
  profile.design.plain_bare = true;
  profile.design.tremor = 2.5;
  return profile;
}

DeviceProfile with_turned_actuators() {
  DeviceProfile profile = example();
  profile.plant.actuators = ActuatorFriction{.axes = Eigen::AngleAxisd(1.0 / 3, Vec3::UnitY()).toRotationMatrix(),
                                             .coulomb = Vec3(0.1 + 0.2, 0.8, 0.9),
                                             .angle_half = 1.0 / 30,
                                             .coulomb_half = Vec3(0.1, 0.1 + 0.02, 0.3)};
  return profile;
}

HeldDevice in_a_hand() {
  HeldDevice held;
  held.model = held_model(example().plant, {.mass = 0.1 + 0.2, .grip_stiffness = 640, .grip_damping = 3.5}, 0.1e-3);
  held.model.viscous = Vec3(1, 2, 3);
  held.model.link[1] = {.mass = 0.02, .stiffness = 1100, .damping = 0.1};
  held.model.noise = {.drift = 0.1, .drift_hz = 0.7, .tremor = 0.03, .tremor_hz = 8.5};
  held.half_width.hand[2].grip_damping = 0.4;
  held.half_width.noise = {.drift = 0, .drift_hz = 0, .tremor = 0.01, .tremor_hz = 0.2};
  held.hand = HandKnown::identified;
  held.margin = 1.0 / 3;
  held.position_noise = 1.4e-5;
  held.ripple = 0.11;
  for (LqgDesign& design : held.designs) {
    design.numbers[0] = LqgNumbers{.drift = 0.21};
    design.numbers[1] = LqgNumbers{.ripple_weight = 1.0 / 3e7, .hand_share = 0.3};
    design.figures = {.error = 5e-5, .ripple = 0.2};
  }
  held.inertia =
      InertiaMap{.centre = Vec3(0, 0.01, 0.1 + 0.2), .reach = Vec3::Constant(0.06), .least = Vec3(0.5, 0.6, 0.7)};
  held.inertia->slope(0, 2) = 1.0 / 3;
  held.inertia->bend(2, 1) = -4;
  held.inertia->curve(1, 1) = 1.0 / 7;
  held.one_mass = false;
  held.designed_for = Vec3(0.5, 1.0 / 3, 1);
  held.designs[0].verdict = {true, 10.0 / 3, "it oscillates"};
  held.designs[1].verdict = {true, 4, "it vibrated at 30 Hz", "2026-01-31T12:00:00Z"};
  held.designs[2].unmet = {"in x, its sensitivity is too large"};
  return held;
}

std::string verdict(const DeviceProfile& profile, double rate = 1000, double days = 1) {
  const auto later = kMade + std::chrono::seconds(std::llround(86400 * days));
  return check_profile(profile, example().device, example().facts, rate, later);
}

class DeviceProfiles : public testing::Test {
 protected:
  DeviceProfiles() { setenv("HAPTRACE_PROFILES", (folder_ / "own/profiles").c_str(), 1); }
  ~DeviceProfiles() override { unsetenv("HAPTRACE_PROFILES"); }
  TempFolder folder_;
};

TEST_F(DeviceProfiles, AreReadBackToTheBitWithTheAxesOfTheActuators) {
  const DeviceProfile profile = with_turned_actuators();
  save_profile(profile, folder_ / "p.json", false);
  const DeviceProfile read = load_profile(folder_ / "p.json");
  ASSERT_TRUE(read.plant.actuators);
  EXPECT_EQ(read.plant.actuators->axes, profile.plant.actuators->axes);
  EXPECT_EQ(read.plant.actuators->coulomb, profile.plant.actuators->coulomb);
  EXPECT_EQ(read.plant.actuators->angle_half, profile.plant.actuators->angle_half);
  EXPECT_EQ(read.plant.actuators->coulomb_half, profile.plant.actuators->coulomb_half);
}

TEST_F(DeviceProfiles, KeepTheLargestForceOfTheMotorsAndAreValidWithoutIt) {
  DeviceProfile profile = example();
  EXPECT_FALSE(to_json(profile)["plant"].contains("motor_limit_n"));
  EXPECT_EQ(profile_from_json(to_json(profile), "old").plant.motor_limit, 0);
  profile.plant.motor_limit = 10.0 / 3;
  profile.half_width.motor_limit = 0.1 + 0.2;
  save_profile(profile, folder_ / "p.json", false);
  const DeviceProfile read = load_profile(folder_ / "p.json");
  EXPECT_EQ(read.plant.motor_limit, profile.plant.motor_limit);
  EXPECT_EQ(read.half_width.motor_limit, profile.half_width.motor_limit);
  json negative = to_json(profile);
  negative["plant"]["motor_limit_n"] = -1;
  EXPECT_THROW((void)profile_from_json(negative, "negative"), Error);
}

TEST_F(DeviceProfiles, AreValidWithoutTheAxesOfTheActuatorsAndRejectAxesThatAreNotAtRightAngles) {
  json object = to_json(with_turned_actuators());
  object["plant"]["actuators"]["axes"]["x"] = {1, 0, 0};
  EXPECT_THROW((void)profile_from_json(object, "bent"), Error);
  object["plant"].erase("actuators");
  EXPECT_FALSE(profile_from_json(object, "old").plant.actuators);
}

DeviceProfile with_cogging() {
  DeviceProfile profile = example();
  profile.plant.cogging = Cogging{.centre = Vec3(0.1 + 0.2, 0, -0.3),
                                  .waves = {{.wave_number = Vec3(2000.0 / 3, -1, 0),
                                             .cosine = -1.0 / 3,
                                             .sine = 0.7,
                                             .wave_number_half = Vec3(0.1, 0.2, 1.0 / 3),
                                             .amplitude_half = 1.0 / 30},
                                            {.wave_number = Vec3(0, 0, 2100), .cosine = 1, .sine = 0}}};
  return profile;
}

TEST_F(DeviceProfiles, AreReadBackToTheBitWithTheCogging) {
  const Cogging cogging = *with_cogging().plant.cogging;
  save_profile(with_cogging(), folder_ / "p.json", false);
  const DeviceProfile read = load_profile(folder_ / "p.json");
  ASSERT_TRUE(read.plant.cogging);
  EXPECT_EQ(read.plant.cogging->centre, cogging.centre);
  ASSERT_EQ(read.plant.cogging->waves.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    const CoggingWave &found = read.plant.cogging->waves[i], &wave = cogging.waves[i];
    EXPECT_EQ(found.wave_number, wave.wave_number);
    EXPECT_EQ(found.cosine, wave.cosine);
    EXPECT_EQ(found.sine, wave.sine);
    EXPECT_EQ(found.wave_number_half, wave.wave_number_half);
    EXPECT_EQ(found.amplitude_half, wave.amplitude_half);
  }
}

TEST_F(DeviceProfiles, AreValidWithoutCoggingAndRejectAWaveWithoutDirection) {
  json object = to_json(with_cogging());
  object["plant"]["cogging"]["waves"][1]["wave_number_rad_per_m"] = {0, 0, 0};
  EXPECT_THROW((void)profile_from_json(object, "flat"), Error);
  object["plant"]["cogging"]["waves"] = json::array();
  EXPECT_THROW((void)profile_from_json(object, "empty"), Error);
  object["plant"].erase("cogging");
  EXPECT_FALSE(profile_from_json(object, "old").plant.cogging);
}

TEST_F(DeviceProfiles, AreReadBackToTheBit) {
  save_profile(example(), folder_ / "p.json", false);
  const DeviceProfile read = load_profile(folder_ / "p.json");
  EXPECT_EQ(to_json(read), to_json(example()));
  EXPECT_EQ(read.plant.mass, example().plant.mass);
  EXPECT_EQ(read.plant.gravity_gradient, example().plant.gravity_gradient);
  EXPECT_EQ(read.plant.delay, example().plant.delay);
  EXPECT_EQ(read.facts.workspace.min, example().facts.workspace.min);
  EXPECT_EQ(read.design.largest.kd, example().design.largest.kd);
}

TEST_F(DeviceProfiles, KeepTheHandAndTheLawsToTheBit) {
  DeviceProfile profile = example();
  profile.held = in_a_hand();
  save_profile(profile, folder_ / "p.json", false);
  const DeviceProfile read = load_profile(folder_ / "p.json");
  ASSERT_TRUE(read.held);
  EXPECT_EQ(to_json(read), to_json(profile));
  EXPECT_EQ(read.held->model.hand[0].mass, 0.1 + 0.2);
  EXPECT_EQ(read.held->model.link[1].stiffness, 1100);
  EXPECT_EQ(read.held->half_width.hand[2].grip_damping, 0.4);
  EXPECT_EQ(read.held->hand, HandKnown::identified);
  EXPECT_EQ(read.held->design(Firmness::normal).numbers[1]->ripple_weight, 1.0 / 3e7);
  EXPECT_FALSE(read.held->design(Firmness::normal).numbers[2]);
  EXPECT_EQ(read.held->design(Firmness::exact).unmet, in_a_hand().designs[2].unmet);
  EXPECT_TRUE(read.identified().held);
  EXPECT_EQ(read.held->inertia->centre.z(), 0.1 + 0.2);
  EXPECT_EQ(read.held->inertia->slope, in_a_hand().inertia->slope);
  EXPECT_EQ(read.held->inertia->curve, in_a_hand().inertia->curve);
  EXPECT_EQ(read.held->inertia->bend, in_a_hand().inertia->bend);
  EXPECT_EQ(read.held->inertia->least, in_a_hand().inertia->least);
  EXPECT_EQ(read.held->design(Firmness::quiet).verdict.improvement, 10.0 / 3);
  EXPECT_EQ(read.held->design(Firmness::quiet).verdict.refused, "it oscillates");
  EXPECT_EQ(read.held->design(Firmness::normal).verdict.since, "2026-01-31T12:00:00Z");
  EXPECT_EQ(read.held->design(Firmness::exact).verdict.since, "");
  EXPECT_EQ(read.held->designed_for, Vec3(0.5, 1.0 / 3, 1));
}

TEST_F(DeviceProfiles, RefuseATremorThatNoHandHas) {
  DeviceProfile profile = example();
  profile.held = in_a_hand();
  const auto refused = [&](const char* key, double value) {
    json object = to_json(profile);
    object["held"]["model"]["noise"][key] = value;
    expect_error([&] { (void)profile_from_json(object, "p.json"); }, Error::Kind::input, {"p.json", key});
  };
  refused("tremor_n", 100);
  refused("tremor_n", -0.1);
  refused("tremor_hz", 1000);
  refused("tremor_hz", 0);
  profile.held->model.noise.tremor = 0;
  profile.held->model.noise.tremor_hz = 0;
  EXPECT_EQ(profile_from_json(to_json(profile), "p.json").held->model.noise.tremor, 0) << "none was found";
}

TEST_F(DeviceProfiles, KeepWhatTheTrialOfTheLawWithAnObserverFound) {
  const TrackingDesign read = profile_from_json(to_json(example()), "p").design;
  EXPECT_TRUE(read.verdict.tried);
  EXPECT_EQ(read.verdict.improvement, 2);
  EXPECT_EQ(read.verdict.force, 0.47);
  EXPECT_EQ(read.verdict.refused, "its error is large");
  EXPECT_EQ(read.verdict.since, "2026-01-31T12:00:00Z");
  EXPECT_TRUE(read.plain_calm);
  EXPECT_EQ(read.stiff_error, 0.6);
  EXPECT_EQ(read.stiff_ripple, 0.8);
  EXPECT_TRUE(read.plain_bare);
  EXPECT_EQ(read.tremor, 2.5);

  nlohmann::json older = to_json(example());
  older["design"].erase("trial");
  older["design"].erase("plain_calm");
  older["design"].erase("stiff_error");
  older["design"].erase("stiff_ripple_n");
  older["design"].erase("plain_bare");
  older["design"].erase("tremor_answer_n");
  EXPECT_FALSE(profile_from_json(older, "p").design.verdict.tried);
  EXPECT_FALSE(profile_from_json(older, "p").design.plain_calm);

  DeviceProfile held = example();
  held.held = in_a_hand();
  older["held"] = to_json(held)["held"];
  older["held"]["observer_trial"] = {{"tried", true}, {"improvement", 3.0}, {"refused", "it oscillates"}};
  older["held"]["plain_calm"] = true;
  EXPECT_EQ(profile_from_json(older, "p").design.verdict.refused, "it oscillates");
  EXPECT_TRUE(profile_from_json(older, "p").design.plain_calm);
}

TEST_F(DeviceProfiles, AreReadWithoutAHandAsOlderVersionsWroteThem) {
  EXPECT_FALSE(to_json(example()).contains("held"));
  EXPECT_FALSE(profile_from_json(to_json(example()), "p").held);
}

TEST_F(DeviceProfiles, NameTheKeyOfAHandThatIsWrong) {
  DeviceProfile profile = example();
  profile.held = in_a_hand();
  const auto error = [&](const char* pointer, const json& value) {
    json changed = to_json(profile);
    changed[json::json_pointer(pointer)] = value;
    return test::error_of([&] { (void)profile_from_json(changed, "p"); });
  };
  EXPECT_THAT(error("/held/hand_is", "unknown"), testing::HasSubstr("unknown"));
  EXPECT_THAT(error("/held/model/hand/mass_kg", -1), testing::HasSubstr("held.model.hand.mass_kg"));
  EXPECT_THAT(error("/held/laws/quiet/x/drift_n", 0), testing::HasSubstr("held.laws.quiet.x.drift_n"));
  EXPECT_THAT(error("/held/laws/quiet/x/mass_factor", 50), testing::HasSubstr("held.laws.quiet.x.mass_factor"));
  EXPECT_THAT(error("/held/model/lag_s", 0.5), testing::HasSubstr("lag_s"));
  EXPECT_THAT(error("/held/laws/exact/unmet", json::array({1})), testing::HasSubstr("held.laws.exact"));
  EXPECT_THAT(error("/held/laws/firm", 1), testing::HasSubstr("firm"));
}

TEST_F(DeviceProfiles, AreFoundByTheIdentityOfTheirDeviceAndNoOther) {
  EXPECT_FALSE(find_profile(example().device));
  save_profile(example(), profile_file(example().device), true);
  ASSERT_TRUE(find_profile(example().device));
  EXPECT_EQ(find_profile(example().device)->plant.mass, example().plant.mass);
  EXPECT_FALSE(find_profile({"sim", "Novint Falcon", "0a1c"}));
  EXPECT_FALSE(find_profile({"sim", "Novint_Falcon", "0a1b"}));
}

TEST(DeviceInWords, HasModelAndSerialNumberAsFarAsTheyAreKnown) {
  EXPECT_EQ(device_in_words({"sim", "Novint Falcon", "0a1b"}), "Novint Falcon 0a1b");
  EXPECT_EQ(device_in_words({"sim", "Novint Falcon", ""}), "Novint Falcon");
  EXPECT_EQ(device_in_words({"sim", "", "0a1b"}), "a device without a name");
}

TEST_F(DeviceProfiles, HaveFileNamesThatEveryFileSystemTakes) {
  const DeviceIdentity wild{"../../etc", std::string(300, 'x') + "/\n", "a b:\xC3\xA9"};
  const std::string name = std::filesystem::path(profile_file(wild)).filename().string();
  EXPECT_EQ(std::filesystem::path(profile_file(wild)).parent_path(), profile_folder());
  EXPECT_LT(name.size(), 200U);
  EXPECT_EQ(name.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_."),
            std::string::npos);
  EXPECT_NE(profile_file({"a", "b-c", ""}), profile_file({"a-b", "c", ""}));
}

TEST_F(DeviceProfiles, AreStoredWhereTheEnvironmentSpecifies) {
  unsetenv("HAPTRACE_PROFILES");
  setenv("XDG_DATA_HOME", "/data", 1);
  EXPECT_EQ(profile_folder(), "/data/haptrace/profiles");
  setenv("XDG_DATA_HOME", "data", 1);
  EXPECT_EQ(profile_folder().find("data"), std::string::npos) << "a folder that depends on the working folder";
  unsetenv("XDG_DATA_HOME");
  EXPECT_NE(profile_folder().find("/.local/share/haptrace/profiles"), std::string::npos);
}

TEST_F(DeviceProfiles, AreNotStoredInTheWorkingFolder) {
  const std::string home = getenv("HOME") != nullptr ? getenv("HOME") : "";
  unsetenv("HAPTRACE_PROFILES");
  unsetenv("XDG_DATA_HOME");
  for (const char* given : {static_cast<const char*>(nullptr), "", "relative"}) {
    if (given == nullptr)
      unsetenv("HOME");
    else
      setenv("HOME", given, 1);
    try {
      EXPECT_TRUE(std::filesystem::path(profile_folder()).is_absolute());
    } catch (const Error& error) {  // if the system knows no home folder either
      EXPECT_NE(std::string_view(error.what()).find("set HOME or HAPTRACE_PROFILES"), std::string_view::npos);
    }
  }
  if (home.empty())
    unsetenv("HOME");
  else
    setenv("HOME", home.c_str(), 1);
}

TEST_F(DeviceProfiles, AreNotReplacedUnasked) {
  save_profile(example(), folder_ / "p.json", false);
  expect_error([&] { save_profile(example(), folder_ / "p.json", false); }, Error::Kind::input, {"exists already"});
  EXPECT_NO_THROW(save_profile(example(), folder_ / "p.json", true));
  expect_error([&] { save_profile(example(), folder_ / "no/p.json", false); }, Error::Kind::input, {"folder"});
}

TEST_F(DeviceProfiles, StateThatTheyAreCoarseAndAreReadWithoutThatKey) {
  DeviceProfile profile = example();
  profile.coarse = true;
  nlohmann::json written = to_json(profile);
  EXPECT_TRUE(profile_from_json(written, "test").coarse);
  written.erase("coarse");
  EXPECT_FALSE(profile_from_json(written, "test").coarse);
}

TEST(CheckProfile, AcceptsTheDeviceOfTheProfile) {
  EXPECT_EQ(verdict(example()), "");
  EXPECT_EQ(verdict(example(), 1090), "");
  EXPECT_EQ(verdict(example(), 1000, 179), "");
}

TEST(CheckProfile, SaysWhyAProfileMustNotBeUsed) {
  const auto expect = [](const std::string& found, const std::string& part) {
    EXPECT_NE(found.find(part), std::string::npos) << found;
  };
  DeviceProfile profile = example();
  profile.device.serial = "other";
  expect(verdict(profile), "belongs to another device");
  profile = example();
  profile.device.model = "omega.3";
  expect(verdict(profile), "omega.3");
  profile = example();
  profile.fits = false;
  profile.reason = "it rattles";
  expect(verdict(profile), "does not fit the device (it rattles)");
  profile = example();
  profile.facts.max_force = 4;
  expect(verdict(profile), "largest force changed");
  profile = example();
  profile.facts.position_resolution = 1e-5;
  expect(verdict(profile), "position resolution changed");
  profile = example();
  profile.facts.workspace.max.y() = 0.2;
  expect(verdict(profile), "workspace changed");
  expect(verdict(example(), 1150), "servo rate of 1000 Hz, but the rate is 1150 Hz");
  expect(verdict(example(), 850), "850 Hz");
  expect(verdict(example(), 1000, -3), "in the future");
  EXPECT_EQ(verdict(example(), 1000, -1), "") << "two clocks may differ";
  profile = example();
  profile.plant.cogging = Cogging{.centre = Vec3::Zero(), .waves = {{.wave_number = Vec3(2000, 0, 0), .cosine = 5}}};
  profile.plant.cogging->waves.push_back(profile.plant.cogging->waves.front());
  profile.facts.max_force = 11;
  EXPECT_EQ(check_profile(profile, profile.device, profile.facts, 1000, kMade), "");
  profile.facts.max_force = 9;
  expect(check_profile(profile, profile.device, profile.facts, 1000, kMade), "cogging of 10.0 N is beyond");
  const auto expect_beyond = [&](const auto& change, const char* reason) {
    DeviceProfile absurd = example();
    change(absurd.plant);
    expect(verdict(absurd), reason);
  };
  expect_beyond([](PlantModel& plant) { plant.coulomb.y() = 50; }, "friction of 50.0 N is beyond");
  expect_beyond([](PlantModel& plant) { plant.gravity.z() = -30; }, "gravity of 30");
  expect_beyond([](PlantModel& plant) { plant.gravity_gradient(0, 0) = -1e5; }, "within 10 mm of 1000.0 N");
  expect_beyond([](PlantModel& plant) { plant.viscous.x() = 1000; }, "damping at 0.1 m/s of 100.0 N");
  expect_beyond([](PlantModel& plant) { plant.mass.x() = 400; }, "inertia at 0.5 m/s^2 of 200.0 N");
  profile = example();
  profile.held = in_a_hand();
  profile.held->inertia = InertiaMap{.reach = Vec3::Constant(0.05), .most = Vec3::Constant(1000)};
  EXPECT_EQ(verdict(profile), "");
  profile.held->inertia->slope(1, 0) = 1e4;  // 500 times the mass at the reach
  expect(verdict(profile), "inertia at 0.5 m/s^2 of 102.7 N");
  expect(verdict(example(), 1000, 181), "181 days old, but it is valid for 180 days only");
  profile = example();
  profile.created = "yesterday";
  EXPECT_NE(verdict(profile), "");
}

TEST(ProfileFromJson, NamesAKeyThatIsMissingUnknownOrWrong) {
  const auto refused = [](const std::function<void(json&)>& change, const std::string& part) {
    json object = to_json(example());
    change(object);
    expect_error([&] { (void)profile_from_json(object, "p.json"); }, Error::Kind::input, {"p.json", part});
  };
  const std::set<std::string> newer{"trial",          "plain_calm", "stiff_error",
                                    "stiff_ripple_n", "plain_bare", "tremor_answer_n"};  // older profiles have none
  const json whole = to_json(example());
  for (const auto& [key, value] : whole.items())
    refused([&key = key](json& object) { object.erase(key); }, "'" + key + "' is missing");
  for (const char* part : {"device", "plant", "half_width", "design"}) {
    const json inner = to_json(example())[part];
    for (const auto& [key, value] : inner.items()) {
      if (!std::set<std::string>{"trial", "plain_calm", "stiff_error", "stiff_ripple_n", "plain_bare",
                                 "tremor_answer_n"}
               .contains(key))  // older profiles have none
        refused([&, &key = key](json& object) { object[part].erase(key); }, "'" + key + "' is missing");
      refused([&, &key = key](json& object) { object[part][key] = nullptr; }, key);
    }
    refused([&](json& object) { object[part]["surplus"] = 1; }, "surplus");
  }
  refused([](json& object) { object["format"] = "haptrace-recording"; }, "is not a device profile");
  refused([](json& object) { object["format_version"] = "2.0"; }, "format version '2.0'");
  refused([](json& object) { object["surplus"] = 1; }, "surplus");
  refused([](json& object) { object["created"] = "2026-31-31"; }, "created");
  refused([](json& object) { object["plant"]["mass_kg"][1] = -0.1; }, "mass_kg");
  refused([](json& object) { object["plant"]["delay_s"] = "soon"; }, "delay_s");
  refused([](json& object) { object["plant"]["delay_s"] = 0.5; }, "delay_s");
  refused([](json& object) { object["design"]["observer_hz"] = 501; }, "observer_hz");  // of 1000 Hz
  refused([](json& object) { object["plant"]["gravity_gradient_n_per_m"]["y"] = {1, 2}; }, "y");
  refused([](json& object) { object["design"]["kp"] = {1, 2, 1e9}; }, "kp");
  expect_error([] { (void)profile_from_json(json::array(), "p.json"); }, Error::Kind::input, {"p.json"});
}

TEST_F(DeviceProfiles, ThatAreGarbageAreRefusedByNameWhateverByteIsBroken) {
  save_profile(example(), folder_ / "p.json", false);
  const std::string text = read_bytes(folder_ / "p.json");
  for (std::size_t cut = 0; cut + 2 < text.size(); cut += 97) {
    std::ofstream(folder_ / "cut.json", std::ios::trunc) << text.substr(0, cut);
    expect_error([&] { (void)load_profile(folder_ / "cut.json"); }, Error::Kind::input, {"cut.json"});
  }
  expect_error([&] { (void)load_profile(folder_ / "none.json"); }, Error::Kind::input, {"none.json"});
}

}  // namespace
}  // namespace haptrace
