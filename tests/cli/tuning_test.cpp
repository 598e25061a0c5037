// A playback that is tuned while it runs: through its socket, its file, and keys.
#include "formats/recording.h"
#include "tests/cli/command.h"

#include <boost/asio/ip/tcp.hpp>
#include <csignal>
#include <filesystem>
#include <fstream>

namespace haptrace {
namespace {

using boost::asio::ip::tcp;
using testing::Contains;
using testing::StartsWith;

std::vector<std::string> texts_of_changes(const nlohmann::json& answer) {
  std::vector<std::string> texts;
  for (const auto& change : answer["tuning"]["changes"]) texts.push_back(change["text"]);
  return texts;
}

std::vector<std::string> marks_of(const std::string& file) {
  std::vector<std::string> texts;
  for (const StoredEvent& event : RecordingReader(file).events())
    if (event.code == static_cast<int>(EventCode::mark)) texts.push_back(event.text);
  return texts;
}

class Tuning : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(haptrace("shape", "circle", "--size", "0.05", "--duration", "2", "-o", circle).exit_code, 0);
  }

  /// A playback on the real clock that ends when it is asked to.
  [[nodiscard]] std::vector<std::string> endless(std::vector<std::string> more) const {
    std::vector<std::string> words{"play",   circle, "--device", kFalcon, "--clock", "real",
                                   "--loop", "--kp", "500",      "--kd",  "6",       "--json"};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }

  const TempFolder folder;
  const std::string circle = folder / "circle.h5";
};

TEST_F(Tuning, ThroughTheSocketChangesTheSessionAndStaysInItsRecording) {
  Command command(endless({"--tune-port", "0", "--record", folder / "a.h5"}), Command::Input::pipe);
  ASSERT_TRUE(command.says(" of this machine"));
  tcp::iostream client("127.0.0.1", command.word_after("tune on port "));
  ASSERT_TRUE(client);
  std::string answer;
  client << "kp 1500\nkd 9000\nobserver off\nget\n" << std::flush;
  std::getline(client, answer);
  EXPECT_EQ(answer, "ok kp 1500 1500 1500");
  std::getline(client, answer);
  EXPECT_THAT(answer, HasSubstr("clamped from 9000: without --expert"));
  std::getline(client, answer);
  EXPECT_THAT(answer, AllOf(StartsWith("error observer"), HasSubstr("haptrace calibrate")));
  std::getline(client, answer);
  EXPECT_EQ(nlohmann::json::parse(answer)["kp"][0], 1500);
  client << "reset\nquit\n" << std::flush;
  std::getline(client, answer);
  EXPECT_THAT(answer, StartsWith("ok reset to kp 500"));

  ASSERT_TRUE(command.says("tuned: reset"));
  kill(command.pid(), SIGINT);
  const Answer ended = command.wait();
  EXPECT_EQ(ended.exit_code, 130);
  const nlohmann::json json = ended.json();
  EXPECT_EQ(json["tuning"]["kp"][0], 500);
  EXPECT_EQ(texts_of_changes(json).front(), "kp 1500");
  EXPECT_THAT(marks_of(folder / "a.h5"), AllOf(Contains("tuned: kp 1500"), Contains("tuned: reset to kp 500 kd 6")));
  EXPECT_EQ(haptrace("check", folder / "a.h5").exit_code, 0);
}

TEST_F(Tuning, ThroughAFileThatIsThereAppliesBeforeTheSessionStarts) {
  const std::string file = folder.write("tune", "kp 2500\nkd 25\nkq 1\n");
  const Answer soft = haptrace("play", circle, "--device", kFalcon, "--kp", "300", "--kd", "4", "--json");
  const Answer stiff =
      haptrace("play", circle, "--device", kFalcon, "--kp", "300", "--kd", "4", "--tune-file", file, "--json");
  ASSERT_EQ(stiff.exit_code, 0) << stiff.err;
  EXPECT_LT(stiff.json()["rms_error_m"], 0.5 * soft.json()["rms_error_m"].get<double>());
  EXPECT_THAT(stiff.err, AllOf(HasSubstr("tuned: kp 2500"), HasSubstr(file + ": line 3: error unknown command 'kq'")));
  EXPECT_EQ(soft.json()["tuning"]["changed"], 0);
}

TEST_F(Tuning, ThroughAFileThatComesLaterAndChanges) {
  const std::string file = folder / "tune";
  Command command(endless({"--tune-file", file}), Command::Input::pipe);
  (void)folder.write("tune", "kp 700\n");
  ASSERT_TRUE(command.says("tuned: kp 700"));
  (void)folder.write("tune", "kp 800\n");
  ASSERT_TRUE(command.says("tuned: kp 800"));
  kill(command.pid(), SIGINT);
  EXPECT_EQ(texts_of_changes(command.wait().json()), (std::vector<std::string>{"kp 700", "kp 800"}));
}

TEST_F(Tuning, ByKeysLivesWithMarksAndIsShown) {
  Command command(endless({"--record", folder / "a.h5"}), Command::Input::terminal);
  ASSERT_TRUE(command.says("kp 500 kd 6 [+-olfr]"));
  command.type("+");
  ASSERT_TRUE(command.says("kp 550 kd 6.6 [+-olfr]"));
  command.type("m]tr+o\n--");
  ASSERT_TRUE(command.says("tuned: kp 500 kd 6"));
  command.type("o");
  ASSERT_TRUE(command.says("key o: error observer"));
  command.type("-");
  ASSERT_TRUE(command.says("kp 454.545 kd 5.45455 [+-olfr]"));
  command.type("r");
  ASSERT_TRUE(command.says("tuned: reset to kp 500 kd 6"));
  command.type("q");
  EXPECT_EQ(command.wait().exit_code, 130);
  EXPECT_EQ(marks_of(folder / "a.h5"),
            (std::vector<std::string>{"tuned: kp 550 kd 6.6", "mark 1", "tuned: kp 605 kd 7.26", "r+o",
                                      "tuned: kp 550 kd 6.6", "tuned: kp 500 kd 6", "tuned: kp 454.545 kd 5.45455",
                                      "tuned: reset to kp 500 kd 6"}));
}

TEST_F(Tuning, ByKeysAlsoWithoutARecording) {
  Command command(endless({}), Command::Input::terminal);
  ASSERT_TRUE(command.says("kp 500 kd 6 [+-olfr]"));
  command.type("m1tp+");
  ASSERT_TRUE(command.says("kp 550 kd 6.6 [+-olfr]")) << "marks have no place, so that t begins no text";
  command.type("q");
  EXPECT_EQ(command.wait().exit_code, 130);
}

TEST_F(Tuning, ByKeysWantsATerminal) {
  Command command({"play", circle, "--device", kFalcon, "--clock", "real", "--json"}, Command::Input::pipe);
  command.type("+++");
  EXPECT_EQ(command.wait().json()["tuning"]["changed"], 0);
}

TEST_F(Tuning, OfAnExpertIsTrustedWithMore) {
  const std::string file = folder.write("tune", "kp 9000\nkd 2\ngains * 0.1");
  const Answer expert = haptrace("play", circle, "--device", kFalcon, "--tune-file", file, "--expert", "--json");
  EXPECT_EQ(texts_of_changes(expert.json()).front(), "kp 9000");
  EXPECT_THAT(expert.err, Not(HasSubstr("clamped")));
}

TEST_F(Tuning, RefusesAPortThatOthersCouldReachOrHave) {
  const Answer open = haptrace("play", circle, "--device", kFalcon, "--tune-port", "0.0.0.0:5005");
  EXPECT_EQ(open.exit_code, 2);
  EXPECT_THAT(open.err, AllOf(HasSubstr("--tune-port"), HasSubstr("this machine alone"), HasSubstr("ssh -L")));

  boost::asio::io_context io;
  const tcp::acceptor taken(io, {boost::asio::ip::address_v4::loopback(), 0});
  const std::string port = std::to_string(taken.local_endpoint().port());
  const Answer busy = haptrace("play", circle, "--device", kFalcon, "--tune-port", port);
  EXPECT_EQ(busy.exit_code, 2);
  EXPECT_THAT(busy.err, AllOf(HasSubstr("--tune-port"), HasSubstr(port)));
}

}  // namespace
}  // namespace haptrace
