#include "formats/reader_process.h"

#include "base/error.h"

#include <cerrno>
#include <csignal>
#include <cstdint>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <new>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace haptrace {
namespace {

/// Writes or reads all bytes. Returns false if that fails.
bool pass(int descriptor, char* bytes, std::size_t count, bool writes) {
  while (count > 0) {
    const ssize_t done = writes ? ::write(descriptor, bytes, count) : ::read(descriptor, bytes, count);
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) return false;
    bytes += done;
    count -= static_cast<std::size_t>(done);
  }
  return true;
}

/// Header of the answer: the size of the bytes that follow, and whether they are an error message.
struct Announcement {
  std::uint64_t bytes = 0;
  std::uint64_t failed = 0;
};

bool pass(int descriptor, Announcement& said, bool writes) {
  return pass(descriptor, reinterpret_cast<char*>(&said), sizeof said, writes);  // NOLINT(*-reinterpret-cast)
}

/// Returns the address space that the process has taken so far [bytes]; 0 if that is unknown.
rlim_t taken_space() {
  std::ifstream statm("/proc/self/statm");
  rlim_t pages = 0;
  statm >> pages;
  return statm ? pages * static_cast<rlim_t>(sysconf(_SC_PAGESIZE)) : 0;
}

[[noreturn]] void serve(const std::string& file, int out, const ReaderLimits& limits,
                        const std::function<std::string()>& read) {
  std::error_code ignored;
  const rlim_t bytes = std::filesystem::file_size(file, ignored);
  // The limit counts what the process inherited, which under a sanitizer is terabytes.
  const rlim_t space = taken_space() + limits.memory + limits.memory_per_byte * bytes;
  const rlim_t time = limits.seconds + bytes / limits.bytes_per_second;
  const rlimit memory{space, space}, seconds{time, time}, none{0, 0};
  (void)setrlimit(RLIMIT_AS, &memory);
  (void)setrlimit(RLIMIT_CPU, &seconds);
  (void)setrlimit(RLIMIT_CORE, &none);
  const int nowhere = open("/dev/null", O_WRONLY);
  // Libraries print what they think of a file.
  if (nowhere >= 0) (void)dup2(nowhere, STDERR_FILENO);
  if (nowhere >= 0) (void)dup2(nowhere, STDOUT_FILENO);
  for (const int signal : {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGXCPU}) (void)::signal(signal, SIG_DFL);
  std::string answer;
  Announcement said;
  try {
    answer = read();
  } catch (const std::bad_alloc&) {
    said.failed = 1;
    answer = file + ": does not fit into memory";
  } catch (const std::exception& thrown) {
    said.failed = 1;
    answer = thrown.what();
  }
  said.bytes = answer.size();
  _exit(pass(out, said, true) && pass(out, answer.data(), answer.size(), true) ? 0 : 1);
}

}  // namespace

std::string read_in_process(const std::string& file, const std::string& what, const ReaderLimits& limits,
                            const std::function<std::string()>& read) {
  int ends[2] = {-1, -1};  // NOLINT(*-avoid-c-arrays)
  if (pipe2(ends, O_CLOEXEC) != 0)
    throw input_error(fmt::format("{}: no pipe to read it through: {}", file, std::strerror(errno)));
  const pid_t child = fork();
  if (child == 0) serve(file, ends[1], limits, read);
  (void)close(ends[1]);
  Announcement said;
  std::string answer;
  bool whole = child > 0 && pass(ends[0], said, false);
  if (whole) {
    answer.resize(said.bytes);
    whole = pass(ends[0], answer.data(), answer.size(), false);
  }
  (void)close(ends[0]);
  int status = 0;
  while (child > 0 && waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  if (!whole) {
    const int signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
    throw input_error(fmt::format("{}: cannot be read as {}: the program that reads such files {}", file, what,
                                  signal == SIGKILL || signal == SIGXCPU
                                      ? "took longer or more memory than a file of this size needs"
                                  : signal != 0 ? fmt::format("ended with signal {}", signal)
                                                : std::string("ended early")));
  }
  if (said.failed != 0) throw input_error(answer);
  return answer;
}

}  // namespace haptrace
