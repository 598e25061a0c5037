// Tests of tuning a running playback through its socket, its file and keys.
#include "formats/recording/recording.h"
#include "tests/cli/command.h"

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/local/stream_protocol.hpp>
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

  /// Returns the arguments of a playback on the real clock that loops until it is stopped.
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
  const std::string socket = folder / "tune.sock";
  Command command(endless({"--tune-socket", socket, "--record", folder / "a.h5"}), Command::Input::pipe);
  ASSERT_TRUE(command.says("tune on socket " + socket));
  boost::asio::local::stream_protocol::iostream client{boost::asio::local::stream_protocol::endpoint(socket)};
  ASSERT_TRUE(client);
  std::string answer;
  client << "kp 1500\nkd 9000\nobserver off\nget\n" << std::flush;
  std::getline(client, answer);
  EXPECT_EQ(answer, "ok kp 1500 1500 1500");
  std::getline(client, answer);
  EXPECT_THAT(answer,
              AllOf(HasSubstr("clamped from 9000: "), HasSubstr("is the limit without a calibration or --expert")));
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
  EXPECT_FALSE(std::filesystem::exists(socket));
}

TEST_F(Tuning, ThroughTheSocketWithoutAPathIsInTheRuntimeFolderOfThisUser) {
  const std::vector<std::string> runtime{"XDG_RUNTIME_DIR=" + folder.path()};
  Command command(endless({"--tune-socket"}), Command::Input::pipe, runtime);
  const std::string socket = folder / "haptrace/tune.sock";
  ASSERT_TRUE(command.says("tune on socket " + socket));
  EXPECT_EQ(std::filesystem::status(folder / "haptrace").permissions(), std::filesystem::perms::owner_all);
  const Answer second = Command(endless({"--tune-socket"}), Command::Input::pipe, runtime).wait();
  EXPECT_EQ(second.exit_code, 2);
  EXPECT_THAT(second.err, AllOf(HasSubstr("--tune-socket"), HasSubstr("another session listens")));
  kill(command.pid(), SIGINT);
  EXPECT_EQ(command.wait().exit_code, 130);
}

TEST_F(Tuning, ThroughThePortNeedsTheTokenThatTheSessionPrints) {
  const std::vector<std::string> runtime{"XDG_RUNTIME_DIR=" + folder.path()};
  Command command(endless({"--tune-port", "0"}), Command::Input::pipe, runtime);
  ASSERT_TRUE(command.says("| nc"));
  const std::string port = command.word_after("tune on port "), file = command.word_after("token in ");
  EXPECT_EQ(test::read_bytes(file).substr(0, 6), "token ");
  EXPECT_THAT(command.word_after("printf '"), "token");

  tcp::iostream client("127.0.0.1", port);
  client << test::read_bytes(file) << "kp\nquit\n" << std::flush;
  std::string answer;
  std::getline(client, answer);
  EXPECT_EQ(answer, "ok kp 500 500 500");
  kill(command.pid(), SIGINT);
  EXPECT_EQ(command.wait().json()["tuning"]["changed"], 0);
  EXPECT_FALSE(std::filesystem::exists(file)) << "a token ends with its session";
}

TEST_F(Tuning, ThroughThePortRejectsTheRequestsOfABrowser) {
  if (!std::filesystem::exists(CURL)) GTEST_SKIP() << "needs curl, an independent web client";
  Command command(endless({"--tune-port", "0"}), Command::Input::pipe, {"XDG_RUNTIME_DIR=" + folder.path()});
  ASSERT_TRUE(command.says("| nc"));
  const std::string url = "http://127.0.0.1:" + command.word_after("tune on port ") + "/";
  // The request bodies are commands, after first lines of different lengths.
  for (const std::string& path : {std::string(), std::string(300, 'a'), std::string(6000, 'a')}) {
    const Answer page =
        Command({"--silent", "--http0.9", "--max-time", "20", "--data-binary", "kp 1500\nkp 1500\n", url + path},
                Command::Input::none, {}, CURL)
            .wait();
    EXPECT_NE(page.exit_code, 0);
    EXPECT_EQ(page.out, "");
  }
  kill(command.pid(), SIGINT);
  EXPECT_EQ(command.wait().json()["tuning"]["changed"], 0);
}

TEST_F(Tuning, ThroughThePortAcceptsAStoredToken) {
  const std::string file = folder / "token";
  std::string first;
  for (int session = 0; session < 2; ++session) {
    Command command(endless({"--tune-port", "0", "--tune-token-file", file}), Command::Input::pipe);
    ASSERT_TRUE(command.says("token in " + file));
    if (first.empty()) first = test::read_bytes(file);
    EXPECT_EQ(test::read_bytes(file), first);
    kill(command.pid(), SIGINT);
    EXPECT_EQ(command.wait().exit_code, 130);
  }
  std::filesystem::permissions(file, std::filesystem::perms(0644));
  const Answer open = haptrace("play", circle, "--device", kFalcon, "--tune-port", "0", "--tune-token-file", file);
  EXPECT_EQ(open.exit_code, 2);
  EXPECT_THAT(open.err, HasSubstr("chmod 600"));
  EXPECT_THAT(haptrace("play", circle, "--device", kFalcon, "--tune-token-file", file).err, HasSubstr("--tune-port"));
}

TEST_F(Tuning, ThroughAnExistingFileAppliesBeforeTheSessionStarts) {
  const std::string file = folder.write("tune", "kp 2500\nkd 25\nkq 1\n");
  const Answer soft = haptrace("play", circle, "--device", kFalcon, "--kp", "300", "--kd", "4", "--json");
  const Answer stiff =
      haptrace("play", circle, "--device", kFalcon, "--kp", "300", "--kd", "4", "--tune-file", file, "--json");
  ASSERT_EQ(stiff.exit_code, 0) << stiff.err;
  EXPECT_LT(stiff.json()["rms_error_m"], 0.5 * soft.json()["rms_error_m"].get<double>());
  EXPECT_THAT(stiff.err, AllOf(HasSubstr("tuned: kp 2500"), HasSubstr(file + ": line 3: error unknown command 'kq'")));
  EXPECT_EQ(soft.json()["tuning"]["changed"], 0);
}

TEST_F(Tuning, ThroughAFileFollowsItsCreationAndChanges) {
  const std::string file = folder / "tune";
  Command command(endless({"--tune-file", file}), Command::Input::pipe);
  (void)folder.write("tune", "kp 700\n");
  ASSERT_TRUE(command.says("tuned: kp 700"));
  (void)folder.write("tune", "kp 800\n");
  ASSERT_TRUE(command.says("tuned: kp 800"));
  kill(command.pid(), SIGINT);
  EXPECT_EQ(texts_of_changes(command.wait().json()), (std::vector<std::string>{"kp 700", "kp 800"}));
}

TEST_F(Tuning, ByKeysWorksBesideMarksAndIsShown) {
  Command command(endless({"--record", folder / "a.h5"}), Command::Input::terminal, {"COLUMNS=200"});
  ASSERT_TRUE(command.says("kp 500 kd 6  [+-olfr]"));
  command.type("+");
  ASSERT_TRUE(command.says("kp 550 kd 6.6  [+-olfr]"));
  command.type("m]tr+o\n--");
  ASSERT_TRUE(command.says("tuned: kp 500 kd 6"));
  command.type("o");
  ASSERT_TRUE(command.says("key o: error observer"));
  command.type("-");
  ASSERT_TRUE(command.says("kp 454.545 kd 5.45455  [+-olfr]"));
  command.type("r");
  ASSERT_TRUE(command.says("tuned: reset to kp 500 kd 6"));
  command.type("q");
  EXPECT_EQ(command.wait().exit_code, 130);
  EXPECT_EQ(marks_of(folder / "a.h5"),
            (std::vector<std::string>{"tuned: kp 550 kd 6.6", "mark 1", "tuned: kp 605 kd 7.26", "r+o",
                                      "tuned: kp 550 kd 6.6", "tuned: kp 500 kd 6", "tuned: kp 454.545 kd 5.45455",
                                      "tuned: reset to kp 500 kd 6"}));
}

TEST_F(Tuning, ByKeysWorksWithoutARecording) {
  Command command(endless({}), Command::Input::terminal, {"COLUMNS=200"});
  ASSERT_TRUE(command.says("kp 500 kd 6  [+-olfr]"));
  command.type("m1tp+");
  ASSERT_TRUE(command.says("kp 550 kd 6.6  [+-olfr]")) << "without a recording there are no marks, so t starts no text";
  command.type("q");
  EXPECT_EQ(command.wait().exit_code, 130);
}

TEST_F(Tuning, ByKeysNeedsATerminal) {
  Command command({"play", circle, "--device", kFalcon, "--clock", "real", "--json"}, Command::Input::pipe);
  command.type("+++");
  EXPECT_EQ(command.wait().json()["tuning"]["changed"], 0);
}

TEST_F(Tuning, WithExpertAllowsAnyGains) {
  const std::string file = folder.write("tune", "kp 9000\nkd 2\ngains * 0.1");
  const Answer expert = haptrace("play", circle, "--device", kFalcon, "--tune-file", file, "--expert", "--json");
  EXPECT_EQ(texts_of_changes(expert.json()).front(), "kp 9000");
  EXPECT_THAT(expert.err, Not(HasSubstr("clamped")));
}

TEST_F(Tuning, RejectsAPortThatOthersCanReachOrUse) {
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
