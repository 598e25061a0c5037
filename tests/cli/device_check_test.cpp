#include "tests/cli/command.h"

namespace haptrace {
namespace {

const std::string kMass = "plugin:path=" MASS_PLUGIN;

nlohmann::json finding(const Answer& answer, const std::string& id) {
  const nlohmann::json json = answer.json();
  for (const auto& finding : json["findings"])
    if (finding["id"] == id) return finding;
  ADD_FAILURE() << "the report has no law " << id;
  return {};
}

TEST(DeviceCheck, PassesADeviceThatKeepsItsLaws) {
  const Answer answer = haptrace("devices", "--test", kMass, "--yes", "--json");
  EXPECT_EQ(answer.exit_code, 0) << answer.out;
  EXPECT_TRUE(answer.json()["kept"]);
  EXPECT_EQ(answer.json()["failed"], 0);
  EXPECT_EQ(answer.json()["device"], kMass);
  EXPECT_EQ(finding(answer, "force_z")["verdict"], "passed");
  EXPECT_THAT(answer.err, HasSubstr("a force along z"));
}

TEST(DeviceCheck, ReportsTheLawsThatADeviceBreaks) {
  const std::string backwards = "plugin:path=" FAULTY_PLUGIN R"(,options={"fault":"backwards"})";
  const Answer answer = haptrace("devices", backwards, "--test", "--yes");
  EXPECT_EQ(answer.exit_code, 1);
  EXPECT_THAT(answer.out, AllOf(HasSubstr("FAILED      force_x"), HasSubstr("FAILED      force_y"),
                                HasSubstr("FAILED      force_z"), HasSubstr("breaks a law")));
}

TEST(DeviceCheck, SendsNoForceWithoutATerminal) {
  const Answer answer = Command({"devices", "--test", kMass, "--json"}, Command::Input::pipe).wait();
  EXPECT_EQ(answer.exit_code, 0);
  for (const char* law : {"force_x", "force_y", "force_z", "gentle", "nan_force"}) {
    EXPECT_EQ(finding(answer, law)["verdict"], "not_tested");
    EXPECT_THAT(finding(answer, law)["detail"].get<std::string>(), HasSubstr("--yes"));
  }
  EXPECT_EQ(finding(answer, "repeats")["verdict"], "passed");
}

TEST(DeviceCheck, AsksForPermissionBeforeEveryForce) {
  Command command({"devices", "--test", kMass, "--json"}, Command::Input::terminal);
  ASSERT_TRUE(command.says("along x"));
  command.type("\n");
  ASSERT_TRUE(command.says("along y"));
  command.type("s\n");
  ASSERT_TRUE(command.says("along z"));
  command.type("q\n");
  const Answer answer = command.wait();
  EXPECT_EQ(answer.exit_code, 130);
  EXPECT_EQ(finding(answer, "force_x")["verdict"], "passed");
  EXPECT_EQ(finding(answer, "force_y")["detail"], "the user did not allow its force");
  EXPECT_EQ(finding(answer, "force_z")["detail"], "the test was stopped earlier");
}

TEST(DeviceCheck, RejectsInvalidDevicesAndOptions) {
  EXPECT_EQ(haptrace("devices", "--test", "plugin:path=/no/such.so").exit_code, 3);
  EXPECT_EQ(haptrace("devices", "--test").exit_code, 2);
  EXPECT_EQ(haptrace("devices", kMass, "--yes").exit_code, 2);
  EXPECT_THAT(haptrace("devices", "--test", kMass, "--max-force", "0").err, HasSubstr("--max-force"));
}

/// Runs the commands of docs/plugins.md.
TEST(DeviceCheck, TheTutorialsDeviceIsTestedRecordedAndPlayed) {
  const TempFolder folder;
  const std::string slide = "plugin:path=" SLIDE_PLUGIN, mine = folder / "mine.h5", played = folder / "played.h5";
  const Answer tested = haptrace("devices", "--test", slide, "--yes");
  EXPECT_EQ(tested.exit_code, 0) << tested.out;
  EXPECT_EQ(haptrace("record", mine, "--device", slide, "--duration", "0.5").exit_code, 0);
  const Answer play = haptrace("play", mine, "--device", slide, "--kp", "300", "--kd", "5", "--record", played);
  EXPECT_EQ(play.exit_code, 0) << play.err;
  const std::string loose = slide + R"(,options={"port":"loose"})";
  EXPECT_EQ(haptrace("record", folder / "loose.h5", "--device", loose, "--duration", "10").exit_code, 3);
}

}  // namespace
}  // namespace haptrace
