// Tests of the motors' force after a Falcon's host dies or stops.
#include "devices/falcon/driver.h"
#include "devices/falcon/firmware.h"
#include "devices/falcon/usb_link.h"
#include "devices/loop/clock.h"
#include "devices/registry.h"
#include "tests/devices/falcon/usb_support.h"
#include "tests/devices/support.h"
#include "tests/support/real_time.h"

#include <atomic>
#include <cerrno>
#include <csignal>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <gmock/gmock.h>
#include <spawn.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

namespace haptrace::test {

using namespace std::chrono_literals;

int hold_force() {
  const auto device = open_device("falcon");
  DeviceState state;
  while (device->exchange({Vec3(0, 3, 0), Vec3::Zero()}, 1e-3, state) == Device::Status::ok)
    std::this_thread::sleep_for(1ms);
  return 1;
}

namespace {

/// Waits at most 10 s until `condition` holds; returns whether it does.
template <class Condition>
bool comes_true(const Condition& condition) {
  for (int k = 0; k < 50'000; ++k) {
    if (condition()) return true;
    std::this_thread::sleep_for(200us);
  }
  return false;
}

bool rests() {
  return !pushes();
}

/// Returns whether the motors push for 0.4 s without a break.
bool keeps_pushing() {
  for (int k = 0; k < 400; ++k) {
    if (!pushes()) return false;
    std::this_thread::sleep_for(1ms);
  }
  return true;
}

std::vector<pid_t> children_of(pid_t parent) {
  std::vector<pid_t> children;
  for (const auto& task : std::filesystem::directory_iterator(fmt::format("/proc/{}/task", parent))) {
    std::ifstream file(task.path() / "children");
    for (pid_t child = 0; file >> child;) children.push_back(child);
  }
  return children;
}

class FalconHost : public testing::Test {
 protected:
  FalconHost() { in_real_time(); }

  void SetUp() override {
    prctl(PR_SET_CHILD_SUBREAPER, 1);  // this program waits for guardians whose host is gone
    plug_in(Start::homed);
    std::string program = "/proc/self/exe", hold(kHoldForce);
    char* const arguments[] = {program.data(), hold.data(), nullptr};
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);  // like a command of a shell
    ASSERT_EQ(posix_spawn(&host_, program.c_str(), nullptr, &attributes, arguments, environ), 0);
    posix_spawnattr_destroy(&attributes);
    ASSERT_TRUE(comes_true(pushes));
    const auto children = children_of(host_);
    ASSERT_EQ(children.size(), 1U);
    guardian_ = children[0];
  }

  void TearDown() override {
    if (guardian_ > 0) kill(guardian_, SIGCONT);
    if (host_ > 0) kill(host_, SIGKILL);
    if (host_ > 0) waitpid(host_, nullptr, 0);
    EXPECT_TRUE(comes_true([this] { return waitpid(guardian_, nullptr, WNOHANG) != 0; }))
        << "the guardian goes with its host";
    EXPECT_TRUE(comes_true([] { return bus().open_handles() == 0; }));
  }

  void signal_and_wait_for_rest(int signal) {
    kill(host_, signal);
    const std::int64_t begin = monotonic_ns();
    EXPECT_TRUE(comes_true(rests));
    RecordProperty("rest_after_ms", fmt::format("{:.1f}", 1e-6 * static_cast<double>(monotonic_ns() - begin)));
  }

  pid_t host_ = -1, guardian_ = -1;
};

TEST_F(FalconHost, LeavesNoForceWhenItIsKilledAndTheFalconIsFree) {
  signal_and_wait_for_rest(SIGKILL);
  EXPECT_TRUE(comes_true([] { return bus().open_handles() == 0; }));
  const auto device = open_device("falcon");
  DeviceState state;
  EXPECT_EQ(device->exchange({}, 1e-3, state), Device::Status::ok);
}

TEST_F(FalconHost, LeavesItsForceWhenItIsKilledWithoutAGuardian) {
  kill(guardian_, SIGSTOP);
  kill(host_, SIGKILL);
  EXPECT_TRUE(keeps_pushing());
  kill(guardian_, SIGCONT);
  EXPECT_TRUE(comes_true(rests));
}

TEST_F(FalconHost, LeavesNoForceWhenItIsStoppedAndContinuesAfterwards) {
  for (int stops = 0; stops < 3; ++stops) {
    signal_and_wait_for_rest(SIGSTOP);
    std::this_thread::sleep_for(100ms);
    EXPECT_FALSE(pushes());
    kill(host_, SIGCONT);
    EXPECT_TRUE(comes_true(pushes));
    EXPECT_TRUE(keeps_pushing());
  }
}

TEST_F(FalconHost, LeavesItsForceWhenItIsStoppedWithoutAGuardian) {
  kill(guardian_, SIGSTOP);
  kill(host_, SIGSTOP);
  EXPECT_TRUE(keeps_pushing());
}

TEST_F(FalconHost, LeavesNoForceWhenItsTerminalInterruptsIt) {
  kill(-host_, SIGINT);
  EXPECT_TRUE(comes_true(rests));
}

TEST_F(FalconHost, LeavesNoForceWhereTheEndpointHasStalled) {
  kill(guardian_, SIGSTOP);
  kill(host_, SIGSTOP);
  set_faults("stall:0");
  EXPECT_TRUE(pushes());
  kill(guardian_, SIGCONT);
  EXPECT_TRUE(comes_true(rests));
}

TEST_F(FalconHost, KnowsWhenNothingWouldStopTheMotors) {
  kill(guardian_, SIGKILL);
  EXPECT_TRUE(comes_true(rests));
  int status = 0;
  EXPECT_EQ(waitpid(host_, &status, 0), host_);
  EXPECT_EQ(WEXITSTATUS(status), 1) << "its device is lost";
  host_ = -1;
}

class GuardedFalcon : public testing::Test {
 protected:
  GuardedFalcon() { in_real_time(); }
};

TEST_F(GuardedFalcon, DismissesItsGuardianWhenItIsClosed) {
  plug_in(Start::homed);
  for (int k = 0; k < 100; ++k) {
    const auto device = open_device("falcon");
    EXPECT_THAT(device->info().notes, testing::IsEmpty());
    ASSERT_EQ(children_of(getpid()).size(), 1U);
    device->close();
    ASSERT_THAT(children_of(getpid()), testing::IsEmpty());
  }
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1);
  EXPECT_EQ(errno, ECHILD) << "a zombie";
  EXPECT_THAT(bus().heard_from_guardians(), testing::IsEmpty());
  EXPECT_TRUE(comes_true([] { return bus().open_handles() == 0; }));
}

TEST_F(GuardedFalcon, LetsItsGuardianSendTheLastWordsWhenNothingAnswers) {
  plug_in(Start::homed);
  const auto device = open_device("falcon");
  DeviceState state;
  ASSERT_TRUE(comes_true([&] {
    (void)device->exchange({Vec3(0, 3, 0), Vec3::Zero()}, 1e-3, state);
    return pushes();
  }));
  set_faults("silent:0");
  EXPECT_TRUE(comes_true([&] { return device->exchange({}, 1e-3, state) == Device::Status::lost; }));
  device->close();
  EXPECT_EQ(device->zero_force(), ZeroForce::failed) << "its chip took it, but its firmware says nothing";
  EXPECT_FALSE(pushes());
  const LastWords words = falcon_last_words({});
  const auto heard = bus().heard_from_guardians();
  ASSERT_GE(heard.size(), words.when_dead.size());
  EXPECT_TRUE(std::equal(words.when_dead.rbegin(), words.when_dead.rend(), heard.rbegin()));
}

TEST_F(GuardedFalcon, MayHoldItsForceWhenNeitherItNorItsGuardianReachesTheMotors) {
  for (const bool unplugged : {false, true}) {
    plug_in(Start::homed);
    const auto device = open_device("falcon");
    DeviceState state;
    ASSERT_TRUE(comes_true([&] {
      (void)device->exchange({Vec3(0, 3, 0), Vec3::Zero()}, 1e-3, state);
      return pushes();
    }));
    unplugged ? bus().unplug() : set_faults("hang:0");
    EXPECT_TRUE(comes_true([&] { return device->exchange({}, 1e-3, state) == Device::Status::lost; }));
    EXPECT_EQ(device->zero_force(), ZeroForce::failed) << unplugged;
  }
}

/// A link whose writes do not return, as if its kernel driver hangs.
class HangingLink final : public FalconLink {
 public:
  explicit HangingLink(const std::atomic<bool>& hangs) : hangs_(hangs) {}
  void control(Request request, std::uint16_t value) override { link_->control(request, value); }
  bool write(std::span<const std::uint8_t> bytes, double timeout) override {
    while (hangs_) std::this_thread::sleep_for(1ms);
    return link_->write(bytes, timeout);
  }
  std::size_t read(std::span<std::uint8_t> bytes, double timeout) override { return link_->read(bytes, timeout); }
  [[nodiscard]] std::optional<GuardedPort> guarded_port() const noexcept override { return link_->guarded_port(); }
  void close() noexcept override { link_->close(); }

 private:
  const std::atomic<bool>& hangs_;
  std::unique_ptr<FalconLink> link_ = open_usb_falcon_link(choose_falcon_port(find_falcon_ports(), "", ""));
};

TEST_F(GuardedFalcon, IsStoppedByItsGuardianWhileARoundDoesNotReturn) {
  plug_in(Start::homed);
  std::atomic<bool> hangs = false;
  ThreadedDevice device(
      std::make_unique<FalconDriver>(start_falcon([&] { return std::make_unique<HangingLink>(hangs); }, std::nullopt),
                                     FalconCalibration(), falcon_info(FalconCalibration())));
  DeviceState state;
  ASSERT_TRUE(comes_true([&] {
    (void)device.exchange({Vec3(0, 3, 0), Vec3::Zero()}, 1e-3, state);
    return pushes();
  }));
  hangs = true;
  EXPECT_EQ(device.emergency_stop(), ZeroForce::sent);
  EXPECT_FALSE(pushes());
  hangs = false;
  device.close();
  EXPECT_FALSE(pushes()) << "and it stays so when the round returns";
}

TEST_F(GuardedFalcon, GivesItsFileToNoOtherProcess) {
  plug_in(Start::homed);
  const auto link = open_usb_falcon_link(choose_falcon_port(find_falcon_ports(), "", ""));
  const auto port = link->guarded_port();
  ASSERT_TRUE(port);
  EXPECT_EQ(fcntl(port->descriptor, F_GETFD) & FD_CLOEXEC, FD_CLOEXEC);
  EXPECT_EQ(port->endpoint, 2);
  link->close();
  EXPECT_FALSE(link->guarded_port());
}

}  // namespace
}  // namespace haptrace::test
