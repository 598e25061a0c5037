#include "devices/serial/guardian.h"

#include "control/error.h"
#include "devices/clock.h"

#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <span>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

namespace haptrace {
namespace {

constexpr double kLongestFarewell = 5;  // for which its end is waited for; a port that is stuck may hold it longer [s]

/// A child with the socket as its standard input and the port as its standard output, and nothing else of ours; in a
/// session of its own, so that no signal of our terminal reaches it. Not a fork: this process may have threads.
pid_t spawn_guardian(const std::string& program, int line, int port) {
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_adddup2(&files, line, STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&files, port, STDOUT_FILENO);
  posix_spawn_file_actions_addclosefrom_np(&files, STDERR_FILENO);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  sigset_t none;
  sigemptyset(&none);
  posix_spawnattr_setsigmask(&attributes, &none);
  // Not with the servo thread's priority either: whoever speaks for a dead host is in no hurry of a tick's kind.
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
  if (refused != 0) throw device_error(fmt::format("{}: cannot be run: {}", program, std::strerror(refused)));
  return child;
}

void append_words(std::vector<std::uint8_t>& message, const std::vector<std::uint8_t>& words) {
  message.push_back(static_cast<std::uint8_t>(words.size() & 0xff));
  message.push_back(static_cast<std::uint8_t>(words.size() >> 8));
  message.insert(message.end(), words.begin(), words.end());
}

}  // namespace

std::string guardian_program() {
  namespace fs = std::filesystem;
  std::error_code error;
  const fs::path self = fs::read_symlink("/proc/self/exe", error);
  for (const fs::path& program : {self.parent_path().parent_path() / HAPTRACE_GUARDIAN_BESIDE,
                                  fs::path(HAPTRACE_GUARDIAN_BUILT), fs::path(HAPTRACE_GUARDIAN_INSTALLED)})
    if (access(program.c_str(), X_OK) == 0) return program;
  return "";
}

Guardian::Guardian(int port, const LastWords& words) {
  const std::string program = guardian_program();
  if (program.empty())
    throw device_error(
        fmt::format("haptrace-guardian, which stops the motors when this program dies, is missing: install haptrace "
                    "whole (it belongs to {})",
                    HAPTRACE_GUARDIAN_INSTALLED));
  int ends[2];
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0)
    throw device_error(fmt::format("no socket for the guardian: {}", std::strerror(errno)));
  line_ = ends[0];
  try {
    process_ = spawn_guardian(program, ends[1], port);
    ::close(ends[1]);
  } catch (...) {
    ::close(ends[0]);
    ::close(ends[1]);
    throw;
  }
  std::vector<std::uint8_t> message;
  append_words(message, words.when_silent);
  append_words(message, words.when_dead);
  // A socket's buffer holds more than that.
  if (send(line_, message.data(), message.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(message.size())) {
    const int cause = errno;
    leave();
    throw device_error(fmt::format("{}: ended at once: {}", program, std::strerror(cause)));
  }
  fcntl(line_, F_SETFL, O_NONBLOCK);
}

void Guardian::beat() {
  const std::int64_t now = monotonic_ns();
  if (now - beaten_ns_ < std::llround(1e9 * kHeartbeat)) return;
  beaten_ns_ = now;
  const char alive = '.';
  if (send(line_, &alive, 1, MSG_NOSIGNAL) == 1 || errno == EAGAIN) return;
  throw device_error(
      "the process that stops its motors when this one dies was ended itself (haptrace-guardian); open the device "
      "anew");
}

void Guardian::dismiss() noexcept {
  if (line_ < 0) return;
  const char go = 'q';
  (void)!send(line_, &go, 1, MSG_NOSIGNAL);
  leave();
}

void Guardian::speak_and_go() noexcept {
  leave();
}

void Guardian::leave() noexcept {
  if (line_ < 0) return;
  ::close(line_);
  line_ = -1;
  const std::int64_t end = monotonic_ns() + std::llround(1e9 * kLongestFarewell);
  while (waitpid(process_, nullptr, WNOHANG) == 0 && monotonic_ns() < end) usleep(300);
}

}  // namespace haptrace
