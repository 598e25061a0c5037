#include "formats/documents/device_profile.h"
#include "formats/recording/recording.h"
#include "tests/cli/command.h"

#include <csignal>
#include <filesystem>

namespace haptrace {
namespace {

Answer calibrate_into(const TempFolder& folder, std::vector<std::string> words) {
  words.insert(words.begin(), "calibrate");
  return Command(words, Command::Input::none, {"HAPTRACE_PROFILES=" + folder.path() + "/profiles"}).wait();
}

TEST(Calibrate, WritesAProfileThatIsFoundByTheDeviceAndARecordingOfTheSession) {
  const TempFolder folder;
  const Answer answer = calibrate_into(folder, {"--device", kFalcon, "--record", folder / "c.h5", "--json"});
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_THAT(answer.err,
              AllOf(HasSubstr("visits 6 places around it"), HasSubstr("at most 40 mm"), HasSubstr("Ctrl+C")));
  const nlohmann::json json = answer.json();
  EXPECT_EQ(json["stopped_by"], "finished");
  const DeviceProfile profile = load_profile(json["profile_file"]);
  EXPECT_EQ(profile.device.model, "Novint Falcon");
  EXPECT_NEAR(profile.plant.mass.x(), 0.4, 0.06);
  EXPECT_EQ(to_json(profile), json["profile"]);
  EXPECT_EQ(std::filesystem::path(json["profile_file"].get<std::string>()).parent_path(), folder / "profiles");
  EXPECT_TRUE(RecordingReader(folder / "c.h5").header().complete);
  ASSERT_TRUE(profile.held);
  EXPECT_TRUE(profile.held->design(Firmness::normal).verdict.tried);

  // Calibrating the same device again replaces its profile, here without what was found around the middle.
  const Answer again = calibrate_into(folder, {"--device", kFalcon, "--quick"});
  ASSERT_EQ(again.exit_code, 0) << again.err;
  EXPECT_THAT(again.err, HasSubstr("at most 20 mm"));
  EXPECT_THAT(again.out,
              AllOf(HasSubstr("hand: "), HasSubstr("--firmness exact: predicted error"), HasSubstr("not tried")));
  EXPECT_THAT(again.out, AllOf(HasSubstr("mass"), HasSubstr("friction"), HasSubstr("delay"), HasSubstr("gains"),
                               HasSubstr("the profile is in " + json["profile_file"].get<std::string>())));
  EXPECT_EQ(load_profile(json["profile_file"]).plant.mass, profile.plant.mass);
}

TEST(Calibrate, CalibratesAPlugInDevice) {
  const TempFolder folder;
  const std::string device = "plugin:path=" MASS_PLUGIN R"(,options={"mass":0.35,"viscous":1})";
  const Answer answer = calibrate_into(folder, {"--device", device, "-o", folder / "own.json"});
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  const DeviceProfile profile = load_profile(folder / "own.json");
  for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(profile.plant.mass[axis], 0.35, 0.007);
  EXPECT_EQ(profile.device.serial, "0.35 kg");

  const Answer refused = calibrate_into(folder, {"--device", device, "-o", folder / "own.json"});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("--overwrite"));
}

TEST(Calibrate, CalibratesADeviceWithBacklashCoarselyAndReportsIt) {
  const TempFolder folder;
  const std::string device =
      "plugin:path=" AWKWARD_PLUGIN R"(,options={"backlash":1e-4,"handle":0.3,"quantum":5e-5,"gravity":1})";
  const Answer answer = calibrate_into(folder, {"--device", device, "-o", folder / "play.json"});
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_THAT(answer.out, AllOf(HasSubstr("coarse: "), HasSubstr("trial on a small circle was stable"),
                                HasSubstr("100 % of its bandwidth")));
  EXPECT_THAT(answer.err, HasSubstr("small circle"));
  const DeviceProfile profile = load_profile(folder / "play.json");
  EXPECT_TRUE(profile.coarse);
  EXPECT_TRUE(profile.fits);
  EXPECT_THAT(profile.reason, HasSubstr("not that of a mass"));
  for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(profile.plant.mass[axis], 0.3, 0.06);
  EXPECT_FALSE(
      load_profile(calibrate_into(folder, {"--device", kFalcon, "--quick", "--json"}).json()["profile_file"]).coarse);
}

TEST(Calibrate, RejectsInvalidRequestsAndWritesNothing) {
  const TempFolder folder;
  EXPECT_THAT(calibrate_into(folder, {"--device", kFalcon, "--quick", "--full"}).err, HasSubstr("--full"));
  EXPECT_EQ(calibrate_into(folder, {}).exit_code, 2);
  const std::string kept = folder.write("kept.json", "{}");
  EXPECT_THAT(calibrate_into(folder, {"--device", kFalcon, "-o", kept}).err, HasSubstr("--overwrite"));
  const Answer nowhere = calibrate_into(folder, {"--device", kFalcon, "-o", folder / "none/p.json"});
  EXPECT_EQ(nowhere.exit_code, 2);
  EXPECT_THAT(nowhere.err, AllOf(HasSubstr("create it first"), Not(HasSubstr("mm from the centre"))));
  EXPECT_EQ(test::read_bytes(kept), "{}");
  const Answer slow = calibrate_into(folder, {"--device", kFalcon, "--max-velocity", "0.01"});
  EXPECT_EQ(slow.exit_code, 1);
  EXPECT_THAT(slow.err, HasSubstr("no profile was written"));
  EXPECT_FALSE(std::filesystem::exists(folder / "profiles"));
}

TEST(Calibrate, RejectsAnUnwritableProfileBeforeAnythingMoves) {
  const TempFolder folder;
  const Answer answer =
      calibrate_into(folder, {"--device", kFalcon, "-o", "/proc/profile.json", "--record", folder / "c.h5"});
  EXPECT_EQ(answer.exit_code, 2);
  EXPECT_THAT(answer.err, AllOf(HasSubstr("/proc/profile.json"), HasSubstr("cannot be created")));
  EXPECT_FALSE(std::filesystem::exists(folder / "c.h5"));

  const Answer found = Command({"calibrate", "--device", kFalcon, "--record", folder / "c.h5"}, Command::Input::none,
                               {"HAPTRACE_PROFILES=/proc/profiles"})
                           .wait();
  EXPECT_EQ(found.exit_code, 2);
  EXPECT_THAT(found.err, HasSubstr("/proc/profiles"));
  EXPECT_FALSE(std::filesystem::exists(folder / "c.h5"));
}

TEST(Calibrate, CountsDownOnTheRealClockAndCanBeStoppedThere) {
  const TempFolder folder;
  Command command({"calibrate", "--device", kFalcon, "--clock", "real"}, Command::Input::none,
                  {"HAPTRACE_PROFILES=" + folder.path() + "/profiles"});
  ASSERT_TRUE(command.says("starts in 3 s"));
  kill(command.pid(), SIGINT);
  const Answer answer = command.wait();
  EXPECT_EQ(answer.exit_code, 130);
  EXPECT_THAT(answer.err, HasSubstr("before anything moved"));
  EXPECT_FALSE(std::filesystem::exists(folder / "profiles"));
}

}  // namespace
}  // namespace haptrace
