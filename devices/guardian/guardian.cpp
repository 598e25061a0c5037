#include "devices/guardian/guardian.h"

#include "base/error.h"
#include "devices/loop/clock.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <poll.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

namespace haptrace {
namespace {

constexpr double kLongestStart = 5;     // [s]
constexpr double kLongestFarewell = 5;  // longest wait for the guardian's end; a stuck port may take longer [s]

/// A second descriptor of a file, above the standard ones. A program that was started without standard descriptors may
/// have their numbers on its own files. Setting up the child's standard input could then close the file meant for its
/// output.
class AboveStandard {
 public:
  explicit AboveStandard(int descriptor) : copy_(fcntl(descriptor, F_DUPFD_CLOEXEC, STDERR_FILENO + 1)) {
    if (copy_ < 0)
      throw device_error(fmt::format("no descriptor is available for the guardian: {}", std::strerror(errno)));
  }
  ~AboveStandard() { ::close(copy_); }
  AboveStandard(const AboveStandard&) = delete;
  AboveStandard& operator=(const AboveStandard&) = delete;

  [[nodiscard]] int get() const noexcept { return copy_; }

 private:
  int copy_;
};

/// Starts the guardian with the socket as its standard input, the port as its standard output, and no other file of
/// ours. It has its own session, so that no signal of our terminal reaches it. Does not fork, because this process may
/// have threads.
pid_t spawn_guardian(const std::string& program, const AboveStandard& line, const AboveStandard& port) {
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_adddup2(&files, line.get(), STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&files, port.get(), STDOUT_FILENO);
  posix_spawn_file_actions_addclosefrom_np(&files, STDERR_FILENO);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  sigset_t none;
  sigemptyset(&none);
  posix_spawnattr_setsigmask(&attributes, &none);
  // The guardian does not inherit the servo thread's priority: it need not act within a tick.
  const sched_param ordinary{};
  posix_spawnattr_setschedpolicy(&attributes, SCHED_OTHER);
  posix_spawnattr_setschedparam(&attributes, &ordinary);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSID | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSCHEDULER);
  std::string name = program;
  char* const arguments[] = {name.data(), nullptr};
  char* const environment[] = {nullptr};
  pid_t child = -1;
  const int refused = posix_spawn(&child, program.c_str(), &files, &attributes, arguments, environment);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&files);
  if (refused != 0)
    throw device_error(fmt::format("{}: the guardian cannot be run: {}", program, std::strerror(refused)));
  return child;
}

void append_words(std::vector<std::uint8_t>& message, const std::vector<std::uint8_t>& words) {
  message.push_back(static_cast<std::uint8_t>(words.size() & 0xff));
  message.push_back(static_cast<std::uint8_t>(words.size() >> 8));
  message.insert(message.end(), words.begin(), words.end());
}

/// Returns the guardian's answer; 0 if none comes within `seconds`.
char guardian_answer(int line, double seconds) noexcept {
  const std::int64_t end = monotonic_ns() + std::llround(1e9 * seconds);
  pollfd answer{.fd = line, .events = POLLIN, .revents = 0};
  while (poll(&answer, 1, static_cast<int>(std::max<std::int64_t>(0, end - monotonic_ns()) / 1'000'000)) < 0 &&
         errno == EINTR) {
  }
  char said = 0;
  return recv(line, &said, 1, MSG_DONTWAIT) == 1 ? said : '\0';
}

}  // namespace

std::vector<std::string> guardian_places(const std::string& self) {
  namespace fs = std::filesystem;
  const fs::path program(self), built(HAPTRACE_BUILD_FOLDER);
  const auto end = std::mismatch(built.begin(), built.end(), program.begin(), program.end()).first;
  std::vector<std::string> places{program.parent_path().parent_path() / HAPTRACE_GUARDIAN_BESIDE};
  if (end == built.end()) places.emplace_back(HAPTRACE_GUARDIAN_BUILT);
  places.emplace_back(HAPTRACE_GUARDIAN_INSTALLED);
  return places;
}

std::string guardian_program() {
  std::error_code error;
  for (const std::string& program : guardian_places(std::filesystem::read_symlink("/proc/self/exe", error)))
    if (access(program.c_str(), X_OK) == 0) return program;
  return "";
}

Guardian::Guardian(const GuardedPort& port, const LastWords& words) {
  const std::string program = guardian_program();
  if (program.empty())
    throw device_error(
        fmt::format("haptrace-guardian, which stops the motors if this program dies, is missing. Install haptrace "
                    "completely (the file belongs at {})",
                    HAPTRACE_GUARDIAN_INSTALLED));
  int ends[2];
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0)
    throw device_error(fmt::format("no socket is available for the guardian: {}", std::strerror(errno)));
  line_ = ends[0];
  try {
    process_ = spawn_guardian(program, AboveStandard(ends[1]), AboveStandard(port.descriptor));
    ::close(ends[1]);
  } catch (...) {
    ::close(ends[0]);
    ::close(ends[1]);
    throw;
  }
  std::vector<std::uint8_t> message{port.endpoint};
  append_words(message, words.when_silent);
  append_words(message, words.when_dead);
  // The socket's buffer is larger than this message.
  (void)!send(line_, message.data(), message.size(), MSG_NOSIGNAL);
  if (guardian_answer(line_, kLongestStart) != kGuardianReady) {
    (void)leave();
    ::close(line_);
    throw device_error(fmt::format(
        "{}: the guardian does not run, and would not stop the motors if this program died. Install haptrace again",
        program));
  }
  fcntl(line_, F_SETFL, O_NONBLOCK);
}

Guardian::~Guardian() {
  (void)speak_and_go();
  ::close(line_);
}

void Guardian::beat() {
  const std::int64_t now = monotonic_ns();
  if (now - beaten_ns_ < std::llround(1e9 * kHeartbeat)) return;
  beaten_ns_ = now;
  if (send(line_, &kGuardianBeat, 1, MSG_NOSIGNAL) == 1 || errno == EAGAIN) return;
  throw device_error(
      "haptrace-guardian, the process that stops the motors if this program dies, has ended; open the device again");
}

bool Guardian::speak() noexcept {
  return send(line_, &kGuardianSpeak, 1, MSG_NOSIGNAL) == 1 && guardian_answer(line_, kLongestSpeech) == kGuardianSpoke;
}

void Guardian::dismiss() noexcept {
  if (left_) return;
  (void)!send(line_, &kGuardianGo, 1, MSG_NOSIGNAL);
  (void)leave();
}

bool Guardian::speak_and_go() noexcept {
  return !left_ && leave();
}

/// Closes the stream to the guardian and waits for its end. Returns whether it ended with exit code 0.
bool Guardian::leave() noexcept {
  left_ = true;
  shutdown(line_, SHUT_WR);
  const std::int64_t end = monotonic_ns() + std::llround(1e9 * kLongestFarewell);
  int status = -1;
  pid_t ended = 0;
  while ((ended = waitpid(process_, &status, WNOHANG)) == 0 && monotonic_ns() < end) usleep(300);
  return ended == process_ && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

}  // namespace haptrace
