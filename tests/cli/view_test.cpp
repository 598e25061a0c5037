// Tests of haptrace view, and of --view on the verbs that run sessions.
#include "formats/recording/recording.h"
#include "tests/cli/command.h"
#include "tests/view/page_client.h"

#include <csignal>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>

namespace haptrace {
namespace {

using test::BinaryMessage;
using test::PageClient;
using test::port_of;
using test::token_of;

/// Records a playback of a square to look at.
std::string a_recording(const TempFolder& folder) {
  const std::string file = folder / "played.h5";
  EXPECT_EQ(haptrace("shape", "square", "--size", "40mm", "--duration", "2", "-o", folder / "square.h5").exit_code, 0);
  EXPECT_EQ(haptrace("play", folder / "square.h5", "-d", kFalcon, "--no-profile", "--record", file).exit_code, 0);
  return file;
}

TEST(View, ShowsARecordingToAPageWithItsToken) {
  const TempFolder folder;
  const std::string file = a_recording(folder);
  Command command({"view", file, "--no-browser"});
  ASSERT_TRUE(command.says("(Ctrl+C ends it)"));
  const std::string address = command.word_after("view: ");
  EXPECT_THAT(address, testing::MatchesRegex("http://127\\.0\\.0\\.1:[0-9]+/#[0-9a-f]{32}"));

  PageClient page(port_of(address));
  page.hello(token_of(address));
  const nlohmann::json hello = page.wait_for("hello");
  EXPECT_EQ(hello.at("role"), "viewer");
  EXPECT_EQ(hello.at("live"), false);
  EXPECT_EQ(hello.at("control"), false);
  const nlohmann::json recording = page.wait_for("recording");
  EXPECT_EQ(recording.at("rate_hz"), 1000);

  // Rows as the file has them, in single precision.
  const RecordingReader reader(file);
  page.send({{"type", "rows"}, {"id", 7}, {"t0", 0.5}, {"t1", 0.6}});
  const BinaryMessage rows = page.wait_for_answer(7);
  const std::vector<Sample> samples = reader.read(0, reader.rows());
  const std::vector<float> time = rows.plane(0), x = rows.plane(1);
  ASSERT_GE(rows.rows, 100U);
  for (std::size_t i = 0; i < rows.rows; ++i) {
    const auto row = static_cast<std::size_t>(std::lround(1000 * (rows.t0 + static_cast<double>(time[i]))));
    ASSERT_EQ(x[i], static_cast<float>(samples.at(row).position.x()));
  }
  kill(command.pid(), SIGINT);
  EXPECT_EQ(command.wait().exit_code, 0);
}

TEST(View, PrintsItsAddressAndFilesAsJson) {
  const TempFolder folder;
  const std::string file = a_recording(folder);
  Command command({"view", file, "--no-browser", "--json"});
  ASSERT_TRUE(command.says("(Ctrl+C ends it)"));
  const std::string address = command.word_after("view: ");
  kill(command.pid(), SIGTERM);
  const nlohmann::json json = command.wait().json();
  EXPECT_EQ(json.at("address"), address);
  EXPECT_EQ(json.at("files"), nlohmann::json::array({file}));
}

TEST(View, SaysWhatIsWrongWithAFile) {
  const TempFolder folder;
  const Answer missing = haptrace("view", folder / "none.h5");
  EXPECT_EQ(missing.exit_code, 2);
  EXPECT_THAT(missing.err, HasSubstr("none.h5"));
  const Answer nothing = haptrace("view");
  EXPECT_EQ(nothing.exit_code, 2);
  EXPECT_THAT(nothing.err, HasSubstr("needs FILE"));
}

TEST(View, RejectsOptionsThatNeedIt) {
  const Answer control = haptrace("record", "x.h5", "-d", kFalcon, "--duration", "1", "--control");
  EXPECT_EQ(control.exit_code, 2);
  EXPECT_THAT(control.err, HasSubstr("give --view as well"));
  const Answer lost =
      haptrace("record", "x.h5", "-d", kFalcon, "--duration", "1", "--view", "--on-page-lost", "sopften");
  EXPECT_EQ(lost.exit_code, 2);
  EXPECT_THAT(lost.err, HasSubstr("did you mean 'soften'?"));
  const Answer port = haptrace("view", "x.h5", "--port", "99999");
  EXPECT_EQ(port.exit_code, 2);
  EXPECT_THAT(port.err, HasSubstr("--port is 99999; it must be from 0 to 65535"));
}

TEST(View, StopsASessionForAPageThatMayOnlyWatch) {
  const TempFolder folder;
  const std::string file = folder / "stopped.h5";
  ASSERT_EQ(haptrace("shape", "circle", "--size", "40mm", "--duration", "30", "-o", folder / "circle.h5").exit_code, 0);
  Command command({"play", folder / "circle.h5", "-d", kFalcon, "--no-profile", "--view", "--no-browser", "--record",
                   file, "--release", "2"});
  ASSERT_TRUE(command.says("disk has room"));  // a line after the address
  const std::string address = command.word_after("view for the trainee: ");
  PageClient page(port_of(address));
  page.hello(token_of(address));
  EXPECT_EQ(page.wait_for("hello").at("role"), "trainee");
  page.wait_for("status", [](const nlohmann::json& status) {
    return status.at("force").is_number() && status.at("force").get<double>() > 0.05;
  });
  page.send({{"type", "command"}, {"id", 1}, {"line", "kp 100"}});
  EXPECT_THAT(page.wait_for("answer").at("text").get<std::string>(), HasSubstr("error"));
  page.send({{"type", "stop"}});
  const nlohmann::json ended =
      page.wait_for("status", [](const nlohmann::json& status) { return status.at("ended").get<bool>(); });
  EXPECT_EQ(ended.at("zero_force"), "confirmed");
  EXPECT_EQ(command.wait().exit_code, 130);

  // The force was zero at once: no row fades out, although --release asks for two seconds of it.
  const RecordingReader reader(file);
  const std::vector<Sample> samples = reader.read(reader.rows() - 3, 3);
  EXPECT_EQ(samples.back().force, Vec3::Zero());
  EXPECT_GT(samples.front().force.norm(), 0);
}

TEST(View, LetsTheTherapistTuneAPlaybackWithinTheLimitsOfTheDevice) {
  const TempFolder folder;
  ASSERT_EQ(haptrace("shape", "circle", "--size", "40mm", "--duration", "30", "-o", folder / "circle.h5").exit_code, 0);
  Command command({"play", folder / "circle.h5", "-d", kFalcon, "--no-profile", "--view", "--no-browser", "--control"});
  ASSERT_TRUE(command.says("view for the trainee: "));
  const std::string address = command.word_after("view: ");
  PageClient page(port_of(address));
  page.hello(token_of(address));
  EXPECT_EQ(page.wait_for("hello").at("control"), true);
  const nlohmann::json controls =
      page.wait_for("controls", [](const nlohmann::json& message) { return !message.at("list").empty(); });
  EXPECT_EQ(controls.at("list").at(0).at("name"), "kp");
  page.send({{"type", "command"}, {"id", 1}, {"line", "kp 400"}});
  EXPECT_EQ(page.wait_for("answer").at("text"), "ok kp 400 400 400");
  page.send({{"type", "command"}, {"id", 2}, {"line", "kp 90000"}});
  EXPECT_THAT(page.wait_for("answer").at("text").get<std::string>(), HasSubstr("clamped from 90000"));
  page.send({{"type", "stop"}});
  EXPECT_EQ(command.wait().exit_code, 130);
}

TEST(View, ShowsAProgrammeToTherapistAndTraineeAndStopsItInARest) {
  const TempFolder folder;
  std::ofstream(folder / "short.json")
      << R"({"haptrace_programme": 1, "title": "Short", "exercises": [{"name": "Line", "shape": {"kind": "line",
      "size": 0.03, "duration": 1}, "mode": "passive", "repetitions": 3, "rest": 60}]})";
  Command command({"run", folder / "short.json", "-d", kFalcon, "--no-profile", "--view", "--no-browser", "-o",
                   folder / "session"});
  ASSERT_TRUE(command.says("1 of 3: "));  // a line after the addresses
  PageClient therapist(port_of(command.word_after("view: ")));
  therapist.hello(token_of(command.word_after("view: ")));
  PageClient trainee(port_of(command.word_after("view for the trainee: ")));
  trainee.hello(token_of(command.word_after("view for the trainee: ")));

  const nlohmann::json programme = therapist.wait_for("programme");
  EXPECT_EQ(programme.at("title"), "Short");
  EXPECT_EQ(programme.at("exercises").at(0).at("repetitions"), 3);
  // The states in their order, until the rest.
  std::vector<std::string> states;
  const nlohmann::json rest = trainee.wait_for("training", [&](const nlohmann::json& message) {
    const auto state = message.at("state").get<std::string>();
    if (states.empty() || states.back() != state) states.push_back(state);
    return state == "rest";
  });
  EXPECT_THAT(states, testing::IsSupersetOf({"moving", "done", "rest"})) << testing::PrintToString(states);
  EXPECT_GT(rest.at("rest_s"), 10);
  EXPECT_EQ(rest.at("trial"), 1);
  const nlohmann::json after =
      therapist.wait_for("programme", [](const nlohmann::json& message) { return message.at("trials").size() == 1; });
  EXPECT_EQ(after.at("exercises").at(0).at("done"), 1);

  // A rest is no end, for neither of them, and the commands still work.
  EXPECT_EQ(trainee.wait_for("status").at("ended"), false);
  therapist.send({{"type", "ping"}, {"id", 5}, {"sent", 0}});
  therapist.wait_for("pong");

  trainee.send({{"type", "stop"}});
  EXPECT_EQ(command.wait().exit_code, 130);
}

TEST(View, StartsASteeredSessionWhenThePageIsOpenAndRecordsWhatTheHandDid) {
  const TempFolder folder;
  const std::string file = folder / "drawn.h5";
  Command command({"record", file, "-d", "sim:preset=falcon,hand=relaxed,intent=view", "--view", "--no-browser",
                   "--duration", "600"});
  ASSERT_TRUE(command.says("the session starts when the page is open"));
  const std::string address = command.word_after("view: ");
  PageClient page(port_of(address));
  page.hello(token_of(address));
  EXPECT_EQ(page.wait_for("hello").at("steer"), true);
  page.send({{"type", "want"}, {"data", "state"}});
  // The hand is taken to the side. A page that holds it says so all the time.
  for (bool moved = false; !moved;) {
    page.intend(0.03, 0, 0, 1);
    const BinaryMessage state = page.wait_for_binary(2);
    moved = state.plane(1).back() > 0.01;
  }
  page.send({{"type", "stop"}});
  const Answer answer = command.wait();
  EXPECT_EQ(answer.exit_code, 130) << answer.err;
  const RecordingReader reader(file);
  EXPECT_EQ(reader.header().meta.at("input"), "view");
  double farthest = 0;
  for (const Sample& sample : reader.read(0, reader.rows())) farthest = std::max(farthest, sample.position.x());
  EXPECT_GT(farthest, 0.01);
  std::vector<std::string> inputs;
  for (const StoredEvent& event : reader.events())
    if (event.code == static_cast<std::int32_t>(EventCode::input)) inputs.push_back(event.text);
  EXPECT_EQ(inputs, std::vector<std::string>{"input: mouse, depth from path"});  // once, although it came often
}

}  // namespace
}  // namespace haptrace
