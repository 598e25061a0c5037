// Tests of sessions that cannot end by themselves: plug-ins that hang, crash, exit or throw, with the real command.
#include "formats/recording/recording.h"
#include "tests/cli/command.h"
#include "tests/support/real_time.h"

#include <chrono>
#include <csignal>
#include <filesystem>
#include <fmt/format.h>
#include <sys/wait.h>
#include <thread>

namespace haptrace {
namespace {

std::string deadly(const std::string& fault, int tick = 300) {
  return fmt::format(R"(plugin:path={},options={{"fault":"{}","tick":{}}})", DEADLY_PLUGIN, fault, tick);
}

struct Death {
  const char* fault;
  const char* words;
  const char* force;
};

class DeadlyPlugin : public testing::TestWithParam<Death> {};

TEST_P(DeadlyPlugin, EndsTheSessionWithAMessageAndACompleteFile) {
  const TempFolder folder;
  const std::string path = folder / "square.h5", file = folder / "out.h5";
  ASSERT_EQ(test::haptrace("shape", "square", "--duration", "60", "-o", path).exit_code, 0);
  const Answer answer = test::haptrace("play", path, "--record", file, "--device", deadly(GetParam().fault),
                                       "--no-profile", "--no-realtime", "--json");
  EXPECT_EQ(answer.exit_code, 3) << answer.err;
  EXPECT_THAT(answer.err, AllOf(HasSubstr(GetParam().words), HasSubstr(GetParam().force)));
  EXPECT_THAT(answer.err, HasSubstr("recording keeps what"));
  EXPECT_EQ(answer.json()["zero_force"] == "failed", std::string_view(GetParam().force) == "switch the device off");
  EXPECT_FALSE(answer.json()["warnings"].empty());
  const Answer checked = test::haptrace("check", file);
  EXPECT_EQ(checked.exit_code, 0) << checked.out << checked.err;
  EXPECT_EQ(RecordingReader(file).rows(), 299U + 1) << "all samples before the fault, and the first state";
}

INSTANTIATE_TEST_SUITE_P(
    EveryKind, DeadlyPlugin,
    testing::Values(Death{"hangs", "has not returned from an exchange for 0.5 s", "switch the device off"},
                    Death{"stoppable", "has not returned from an exchange for 0.5 s", "the force is zero"},
                    Death{"crashes", "crashed (SIGSEGV)", "switch the device off"},
                    Death{"overflows", "crashed (SIGSEGV)", "switch the device off"},
                    Death{"aborts", "was aborted (SIGABRT)", "switch the device off"},
                    Death{"exits", "called exit()", "switch the device off"},
                    Death{"leaves", "called exit()", "switch the device off"},
                    Death{"throws", "the plug-in threw an exception in exchange: the bus is on fire",
                          "switch the device off"},
                    Death{"throws_number", "the plug-in threw an exception in exchange", "switch the device off"}),
    [](const auto& tested) { return std::string(tested.param.fault); });

TEST(DeadlyPlugins, ThatReceivedNoForceAreReportedWithZeroForce) {
  const TempFolder folder;
  for (const char* fault : {"hangs", "crashes", "throws"}) {
    const Answer answer = test::haptrace("record", folder / fmt::format("{}.h5", fault), "--device", deadly(fault),
                                         "--no-realtime", "--duration", "60");
    EXPECT_EQ(answer.exit_code, 3);
    EXPECT_THAT(answer.err, AllOf(HasSubstr("the force is zero"), Not(HasSubstr("switch the device off"))));
  }
}

TEST(DeadlyPlugins, AreNamedWhenTheyFailDuringOpening) {
  const TempFolder folder;
  const auto record = [&](const char* fault) {
    return test::haptrace("record", folder / "out.h5", "--device", deadly(fault), "--duration", "1");
  };
  const Answer thrown = record("open_throws");
  EXPECT_EQ(thrown.exit_code, 3);
  EXPECT_THAT(thrown.err, AllOf(HasSubstr(DEADLY_PLUGIN), HasSubstr("there is no interpreter")));
  const Answer left = record("open_exits");
  EXPECT_EQ(left.exit_code, 3);
  EXPECT_THAT(left.err, AllOf(HasSubstr(DEADLY_PLUGIN), HasSubstr("called exit()")));
  const Answer crashed = record("open_crashes");
  EXPECT_EQ(crashed.exit_code, -SIGSEGV);
  EXPECT_THAT(crashed.err, AllOf(HasSubstr(DEADLY_PLUGIN), HasSubstr("crashed (SIGSEGV)")));
}

TEST(DeadlyPlugins, ThatDoNotCloseLetTheSessionEnd) {
  const TempFolder folder;
  const std::pair<const char*, const char*> faults[] = {{"close_hangs", ""},
                                                        {"close_throws", ""},
                                                        {"close_crashes", "crashed (SIGSEGV)"},
                                                        {"close_exits", "called exit()"}};
  for (const auto& [fault, words] : faults) {
    const std::string file = folder / fmt::format("{}.h5", fault);
    const Answer answer =
        test::haptrace("record", file, "--device", deadly(fault), "--duration", "0.2", "--no-realtime");
    EXPECT_EQ(answer.exit_code, 0) << fault << ": " << answer.err;
    EXPECT_THAT(answer.err, HasSubstr(words)) << fault;
    EXPECT_EQ(test::haptrace("check", file).exit_code, 0);
  }
}

TEST(DeadlyPlugins, AreNotMistakenForAProcessThatWasStopped) {
  const TempFolder folder;
  const std::string file = folder / "out.h5";
  test::Command command({"record", file, "--device", deadly("none"), "--no-realtime", "--json"});
  for (int k = 0; k < 6000 && !std::filesystem::exists(file); ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  // Stop the process anywhere, in a tick or between two, for longer than the watchdog's time-out.
  for (int times = 0; times < 3; ++times) {
    kill(command.pid(), SIGSTOP);
    std::this_thread::sleep_for(std::chrono::milliseconds(800));
    kill(command.pid(), SIGCONT);
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  kill(command.pid(), SIGINT);
  const Answer answer = command.wait();
  EXPECT_EQ(answer.exit_code, 130) << answer.err;
  EXPECT_GE(answer.json()["gaps"], 2) << "a stall is a gap; the first may have come before the first tick";
}

TEST(Terminals, ThatAcceptNoOutputLetTheSessionEnd) {
  const TempFolder folder;
  test::Command command({"record", folder / "out.h5", "--device", kFalcon, "--clock", "real", "--no-realtime"},
                        test::Command::Input::terminal);
  ASSERT_TRUE(command.says("force"));
  command.type("\x13");  // Ctrl+S
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  kill(command.pid(), SIGINT);
  bool ended = false;
  for (int k = 0; k < 3000 && !ended; ++k) {
    siginfo_t info{};
    waitid(P_PID, static_cast<id_t>(command.pid()), &info, WEXITED | WNOHANG | WNOWAIT);
    ended = info.si_pid != 0;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_TRUE(ended);
  command.type("\x11");  // Ctrl+Q; without it, wait() would never return
  EXPECT_EQ(command.wait().exit_code, 130);
}

TEST(LostDevices, MustBeSwitchedOffIfTheirForceMayRemain) {
  test::in_real_time();
  const TempFolder folder;
  const std::string path = folder / "square.h5";
  ASSERT_EQ(test::haptrace("shape", "square", "--duration", "10", "-o", path).exit_code, 0);
  for (const std::string fault : {"silent", "hang", "unplug"}) {
    const std::string file = folder / (fault + ".h5");
    const Answer answer = test::haptrace("play", path, "--record", file, "--device",
                                         fmt::format("falcon:emulated=true,hand=relaxed,fault={}:2.5", fault),
                                         "--no-profile", "--no-realtime", "--json",
                                         // Not the limits of a loop that a busy machine holds up.
                                         "--max-deviation", "0.3", "--max-velocity", "0");
    EXPECT_EQ(answer.exit_code, 3) << answer.err;
    EXPECT_THAT(answer.err, AllOf(HasSubstr("the force could not be set to zero: switch the device off"),
                                  Not(HasSubstr("the force is zero"))));
    EXPECT_EQ(answer.json()["zero_force"], "failed") << fault;
    EXPECT_THAT(test::haptrace("info", file).out, HasSubstr("switch the device off"))
        << "the file contains the message as well";
  }
}

TEST(ZeroForce, IsReportedAsConfirmedWhenTheDeviceConfirmsIt) {
  test::in_real_time();
  const TempFolder folder;
  const Answer answer = test::haptrace("record", folder / "out.h5", "--device", "falcon:emulated=true,hand=relaxed",
                                       "--duration", "0.5", "--no-realtime", "--json");
  EXPECT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_EQ(answer.json()["zero_force"], "confirmed");
}

}  // namespace
}  // namespace haptrace
