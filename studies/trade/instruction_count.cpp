#include "studies/trade/instruction_count.h"

#include <cerrno>
#include <csignal>
#include <linux/perf_event.h>
#include <optional>
#include <sys/ioctl.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

namespace haptrace {
namespace {

constexpr std::uint64_t kMostSingleSteps = 5'000'000;

/// The processor's instruction counter for this thread.
class PerformanceCounter {
 public:
  PerformanceCounter() {
    perf_event_attr attributes{};
    attributes.size = sizeof attributes;
    attributes.type = PERF_TYPE_HARDWARE;
    attributes.config = PERF_COUNT_HW_INSTRUCTIONS;
    attributes.exclude_kernel = 1;
    attributes.exclude_hv = 1;
    file_ = static_cast<int>(syscall(SYS_perf_event_open, &attributes, 0, -1, -1, 0));
  }
  ~PerformanceCounter() {
    if (file_ >= 0) ::close(file_);
  }
  PerformanceCounter(const PerformanceCounter&) = delete;
  PerformanceCounter& operator=(const PerformanceCounter&) = delete;

  [[nodiscard]] bool works() const { return file_ >= 0 && read().has_value(); }
  [[nodiscard]] std::optional<std::uint64_t> read() const {
    std::uint64_t value = 0;
    return ::read(file_, &value, sizeof value) == sizeof value ? std::optional(value) : std::nullopt;
  }

 private:
  int file_;
};

/// Waits for the next stop of the child. Returns its signal, or nothing if the child ended.
std::optional<int> next_stop(pid_t child) {
  int status = 0;
  while (waitpid(child, &status, 0) < 0)
    if (errno != EINTR) return std::nullopt;
  return WIFSTOPPED(status) ? std::optional(WSTOPSIG(status)) : std::nullopt;
}

/// Runs the child to its first mark.
bool run_to_mark(pid_t child, bool& ended) {
  while (const std::optional<int> signal = next_stop(child)) {
    // If this process is killed, the child must not wait at a mark for ever.
    if (*signal == SIGSTOP) return ptrace(PTRACE_SETOPTIONS, child, nullptr, PTRACE_O_EXITKILL) == 0;
    if (ptrace(PTRACE_CONT, child, nullptr, static_cast<long>(*signal)) != 0) return false;
  }
  ended = true;
  return false;
}

/// Returns the number of steps between marks. Other signals are passed to the child; a signal that ends it ends the
/// count.
std::vector<std::uint64_t> steps_between_marks(pid_t child, std::size_t intervals, bool& ended) {
  std::vector<std::uint64_t> steps(1, 0);
  long hand_on = 0;
  for (std::uint64_t all = 0; all < kMostSingleSteps; ++all) {
    if (ptrace(PTRACE_SINGLESTEP, child, nullptr, hand_on) != 0) return {};
    const std::optional<int> signal = next_stop(child);
    if (!signal) {
      ended = true;
      return {};
    }
    ++steps.back();
    hand_on = *signal == SIGTRAP || *signal == SIGSTOP ? 0 : *signal;
    if (*signal != SIGSTOP) continue;
    if (steps.size() == intervals) return steps;
    steps.push_back(0);
  }
  return {};
}

std::vector<std::uint64_t> single_step(const std::function<void(const std::function<void()>&)>& work,
                                       std::size_t intervals) {
  const pid_t child = fork();
  if (child < 0) return {};
  if (child == 0) {
    // Without a tracer a mark would stop this copy for ever.
    if (ptrace(PTRACE_TRACEME, 0, nullptr, nullptr) == 0) work([] { (void)raise(SIGSTOP); });
    _exit(0);
  }
  std::vector<std::uint64_t> steps;
  bool ended = false;
  if (run_to_mark(child, ended)) steps = steps_between_marks(child, intervals, ended);
  if (ended) return steps;
  (void)kill(child, SIGKILL);
  int ignored = 0;
  while (waitpid(child, &ignored, 0) < 0 && errno == EINTR) {
  }
  return steps;
}

}  // namespace

std::vector<std::uint64_t> count_instructions(const std::function<void(const std::function<void()>&)>& work,
                                              std::size_t intervals) {
  const PerformanceCounter counter;
  if (!counter.works()) return single_step(work, intervals);
  std::vector<std::uint64_t> marks;
  marks.reserve(intervals + 1);
  work([&] {
    if (marks.size() <= intervals) marks.push_back(counter.read().value_or(0));
  });
  if (marks.size() <= intervals) return {};
  for (std::size_t i = 0; i < intervals; ++i) marks[i] = marks[i + 1] - marks[i];
  marks.pop_back();
  return marks;
}

}  // namespace haptrace
