#include "base/rfc3339.h"
#include "control/design/tracking_design.h"
#include "devices/registry.h"
#include "formats/documents/device_profile.h"
#include "tests/cli/command.h"

#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>

namespace haptrace {
namespace {

TEST(TradeoffCommand, ChoosesAConfigurationThatKeepsItsPredictionInUse) {
  const TempFolder folder;
  const std::string path = folder / "circle.h5", played = folder / "played.h5";
  ASSERT_EQ(haptrace("shape", "circle", "--size", "0.04", "--duration", "2", "-o", path).exit_code, 0);
  const auto scene = folder.write(
      "scene.json", R"({"objects": [{"kind": "sphere", "name": "ball", "radius": 0.03, "stiffness": 500}]})");
  const Answer answer = haptrace("tradeoff", path, "--device", kFalcon, "--budget", "error<=0.3mm, bytes<=300MB/h",
                                 "--rates", "500,1000", "--learn", "0", "--runs", "2", "--no-instructions", "--scene",
                                 scene, "--scene-budget", "error<=50mN", "-o", folder / "t.json", "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  const nlohmann::json json = answer.json();
  EXPECT_EQ(json, nlohmann::json::parse(std::ifstream(folder / "t.json")));
  EXPECT_EQ(json["choice"]["kept"], true);
  EXPECT_EQ(json["config_file"], folder / "t-config.json");
  EXPECT_GT(std::filesystem::file_size(folder / "t.png"), 10'000U);
  std::vector<std::string> sides;
  for (const nlohmann::json& side : json["sides"]) sides.push_back(side["knob"]);
  EXPECT_THAT(sides, testing::ElementsAre("storage", "spacing", "scene", "simulation"));

  EXPECT_EQ(json["scene_choice"]["kept"], true);
  EXPECT_EQ(json["scene_choice"]["file"], folder / "t-scene.json");
  EXPECT_EQ(haptrace("scene", folder / "t-scene.json").exit_code, 0);

  const Answer used = haptrace("play", path, "--device", "sim:preset=falcon,hand=relaxed,seed=77", "--config",
                               folder / "t-config.json", "--record", played, "--json");
  ASSERT_EQ(used.exit_code, 0) << used.err;
  for (const char* figure : {"rms_error_m", "force_ripple_n"}) {
    const double predicted = json["predicted"][figure], measured = used.json()[figure];
    EXPECT_NEAR(measured, predicted, 0.2 * predicted) << figure;
  }
  // The same file configures the other verbs too.
  EXPECT_EQ(haptrace("record", folder / "r.h5", "--device", kFalcon, "--duration", "0.5", "--config",
                     folder / "t-config.json")
                .exit_code,
            0);
  EXPECT_EQ(haptrace("guide", path, "--device", "sim:preset=falcon,hand=relaxed,intent=" + path, "--config",
                     folder / "t-config.json", "--time-limit", "3", "-q")
                .exit_code,
            0);
}

/// Writes a profile like calibration's, for a device in real time.
std::string write_profile(const std::string& device, const PlantModel& plant, const std::string& file) {
  const auto opened = open_device(device);
  const DeviceInfo& info = opened->info();
  EXPECT_FALSE(info.virtual_time);
  save_profile({.device = {.backend = info.backend, .model = info.model, .serial = info.serial},
                .facts = {.max_force = info.max_force,
                          .position_resolution = info.position_resolution,
                          .workspace = {info.workspace_min, info.workspace_max}},
                .created = rfc3339(std::chrono::system_clock::now()),
                .software = "test",
                .plant = plant,
                .half_width = {},
                .reason = {},
                .design = design_tracking(plant, {.max_force = info.max_force})},
               file, true);
  return file;
}

PlantModel falcon_like_plant() {
  PlantModel plant;
  plant.mass = Vec3::Constant(0.4);
  plant.viscous = Vec3::Constant(1.8);
  plant.coulomb = Vec3::Constant(0.7);
  plant.delay = 1.5e-3;
  plant.position_resolution = 5e-5;
  return plant;
}

void expect_a_choice(const std::string& device, const PlantModel& plant, const char* shape) {
  const TempFolder folder;
  const std::string path = folder / "path.h5";
  ASSERT_EQ(haptrace("shape", shape, "--size", "0.02", "--duration", "1", "-o", path).exit_code, 0);
  const std::string profile = write_profile(device, plant, folder / "profile.json");
  const Answer answer = haptrace("tradeoff", path, "--device", device, "--profile", profile, "--budget",
                                 "error<=5mm, margin>=0.5", "--rates", "1000", "--learn", "0", "--runs", "1",
                                 "--no-instructions", "-o", folder / "t.json", "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  const nlohmann::json json = answer.json(), outcome = json["choice"]["outcome"];
  EXPECT_EQ(json["choice"]["kept"], true);
  // Nothing was measured on the device: the interval includes the model's uncertainty, even for a single run.
  ASSERT_TRUE(outcome["error_m"]["half_width"].is_number());
  EXPECT_GT(outcome["error_m"]["half_width"], 0.2 * outcome["error_m"]["mean"].get<double>());
  EXPECT_GE(outcome["runs"], 4);
  EXPECT_EQ(json["predicted"]["confidence"], 0.95);
  EXPECT_EQ(json["predicted"]["half_width"]["rms_error_m"], outcome["rms_error_m"]["half_width"]);
  EXPECT_THAT(answer.err, HasSubstr("for effects that the model leaves out"));
}

TEST(TradeoffCommand, SimulatesTheProfileOfADeviceThatIsNotVirtual) {
  expect_a_choice("falcon:emulated=true,hand=relaxed", falcon_like_plant(), "circle");
}

TEST(TradeoffCommand, SimulatesADeviceWithOneAxis) {
  PlantModel plant = falcon_like_plant();
  plant.mass = Vec3(0.2, 0, 0);
  plant.viscous = Vec3(1, 0, 0);
  plant.coulomb = Vec3(0.1, 0, 0);
  expect_a_choice("plugin:path=" SLIDE_PLUGIN, plant, "line");
}

TEST(TradeoffCommand, RejectsInvalidOptionsBeforeItStarts) {
  const TempFolder folder;
  EXPECT_THAT(haptrace("tradeoff").err, HasSubstr("needs PATH"));
  EXPECT_THAT(haptrace("tradeoff", "no.csv", "--device", kFalcon, "--budget", "error<=1").err, HasSubstr("its unit"));
  const std::string kept = folder.write("kept.json", "{}");
  const Answer answer = haptrace("tradeoff", "no.csv", "--device", kFalcon, "-o", kept);
  EXPECT_EQ(answer.exit_code, 2);
  EXPECT_THAT(answer.err, AllOf(HasSubstr("kept.json"), HasSubstr("--overwrite")));
  EXPECT_THAT(haptrace("tradeoff", "no.csv", "--device", kFalcon, "-o", folder / "none/t.json").err,
              HasSubstr("none does not exist; create it first"));
  EXPECT_THAT(
      haptrace("tradeoff", "no.csv", "--device", kFalcon, "-o", folder / "t.json", "--save", folder / "t.json").err,
      HasSubstr("two output files have this name"));
  EXPECT_THAT(haptrace("tradeoff", "no.csv", "--device", kFalcon, "--speed", "0").err, HasSubstr("--speed"));
  // A verb's own section takes precedence over the settings for all verbs.
  const auto sections = folder.write("s.json", R"({"duration": 5, "record": {"duration": 0.2}, "play": {"speed": 2}})");
  EXPECT_EQ(haptrace("record", folder / "s.h5", "--device", kFalcon, "--config", sections, "--json").json()["samples"],
            201);
  const auto config = folder.write("c.json", R"({"play": {"sped": 2}, "record": {"rate": 500}})");
  EXPECT_THAT(haptrace("play", "no.csv", "--device", kFalcon, "--config", config).err,
              AllOf(HasSubstr("play: unknown key 'sped'"), HasSubstr("speed")));
}

}  // namespace
}  // namespace haptrace
