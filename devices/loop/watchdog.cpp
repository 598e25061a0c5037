#include "devices/loop/watchdog.h"

#include "devices/loop/loose_thread.h"
#include "devices/loop/realtime.h"

#include <array>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fmt/format.h>
#include <semaphore>
#include <thread>
#include <unistd.h>

namespace haptrace {
namespace {

constexpr std::chrono::milliseconds kWakeUp{50};
constexpr int wake_ups_in(double seconds) {
  return static_cast<int>(1e3 * seconds / static_cast<double>(kWakeUp.count()));
}
constexpr double kLongestStop = 0.3;   // longest stop of a device [s]
constexpr double kLongestEnd = 3;      // longest end of a session whose ticks continue [s]
constexpr double kLongestKeep = 5;     // longest completion of a recording [s]
constexpr double kLongestTelling = 1;  // longest report of the last words [s]
constexpr std::size_t kSignalStack = 64 * 1024;
constexpr int kExitStopped = 1, kExitNoDevice = 3;  // exit codes of the command

// State that a signal handler leaves for a watchdog: plain atomics, which a handler may use.
constexpr int kExited = -1;
std::atomic<int> crash_signal{0};  // kExited: exit() was called
std::atomic<const char*> crash_in{nullptr};
std::atomic<int> sessions{0};  // number of watched sessions
std::atomic<bool> watches_crashes{false};
std::atomic<pid_t> watched_process{0};
thread_local const char* foreign_code = nullptr;
thread_local bool can_be_left = false;  // the thread may be held for ever where it is
thread_local bool is_watchdog = false;

TellLastWords& last_words() {
  static TellLastWords tell = [](const std::string& words, ZeroForce, int) {
    std::fprintf(stderr, "haptrace: %s\n", words.c_str());
  };
  return tell;
}

const char* crash_name(int signal) noexcept {
  switch (signal) {
    case SIGSEGV:
      return "crashed (SIGSEGV)";
    case SIGBUS:
      return "crashed (SIGBUS)";
    case SIGFPE:
      return "crashed (SIGFPE)";
    case SIGILL:
      return "crashed (SIGILL)";
    case SIGABRT:
      return "was aborted (SIGABRT), for example by an uncaught exception";
    default:
      return "called exit()";
  }
}

/// Holds the calling thread for ever and leaves the rest to a watchdog. Returns if there is none.
void hold_for_watchdog(int what) noexcept {
  if (is_watchdog || sessions.load() == 0) return;
  int none = 0;
  if (crash_signal.compare_exchange_strong(none, what)) crash_in = foreign_code;
  while (true) ::pause();
}

/// Reports foreign code when there is no session. Uses only calls that are safe in a signal handler.
void say_of_foreign_code(int what) noexcept {
  if (foreign_code == nullptr) return;
  for (const char* part : {"haptrace: ", foreign_code, " ", crash_name(what), "\n"})
    if (::write(STDERR_FILENO, part, std::strlen(part)) < 0) return;
}

/// Holds a loose thread for ever: the session ends as if the call had not returned.
void leave_thread() noexcept {
  while (can_be_left) ::pause();
}

void on_crash(int signal) {
  hold_for_watchdog(signal);
  say_of_foreign_code(signal);
  leave_thread();
  ::signal(signal, SIG_DFL);
  ::raise(signal);
}

void on_exit_call() {
  if (!watches_crashes) return;
  hold_for_watchdog(kExited);
  if (foreign_code == nullptr) return;
  say_of_foreign_code(kExited);
  leave_thread();
  foreign_code = nullptr;
  std::_Exit(kExitNoDevice);
}

}  // namespace

class Watchdog::Thread {
 public:
  explicit Thread(Session session)
      : session_(std::move(session)),
        patience_(session_.virtual_time ? kVirtualPatience : kPatience),
        thread_([this] { run(); }) {}
  ~Thread() {
    ending_.release();
    thread_.join();
  }

 private:
  void run() {
    is_watchdog = true;
    if (session_.realtime) (void)request_realtime(kServoPriority + 1);
    std::uint64_t last = session_.pulse.beat();
    for (int still = 0; !ending_.try_acquire_for(kWakeUp);) {
      if (crash_signal != 0) return end_for_crash();
      const std::uint64_t beat = session_.pulse.beat();
      const bool hangs = beat == last && TickPulse::place_of(beat) != TickPulse::Place::outside;
      still = hangs ? still + 1 : 0;
      last = beat;
      if (still >= wake_ups_in(patience_)) return end_for_hang(TickPulse::place_of(beat));
    }
  }

  void end_for_hang(TickPulse::Place place) {
    const std::string& name = session_.device.info().name;
    std::string what;
    switch (place) {
      case TickPulse::Place::device:
        what = fmt::format("the device {} has not returned from an exchange for {} s", name, patience_);
        break;
      case TickPulse::Place::controller:
        what = fmt::format("the controller has not returned for {} s", patience_);
        break;
      case TickPulse::Place::sinks:
      case TickPulse::Place::outside:
        what = fmt::format("the recorder, or another receiver of the samples, has not returned for {} s", patience_);
        break;
    }
    end(what, stop_device(), place == TickPulse::Place::device ? kExitNoDevice : kExitStopped);
  }

  void end_for_crash() {
    const char* foreign = crash_in;
    const std::string what = fmt::format("{} {}", foreign != nullptr ? foreign : "haptrace", crash_name(crash_signal));
    const int code = foreign != nullptr ? kExitNoDevice : kExitStopped;
    end(what, session_ends() ? zero_force() : stop_device(), code);
  }

  /// Asks the session to stop. Returns true if its ticks continue and it ends soon.
  [[nodiscard]] bool session_ends() {
    session_.stop.raise();
    const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(kLongestEnd);
    std::uint64_t last = session_.pulse.beat();
    for (int still = 0; std::chrono::steady_clock::now() < until;) {
      std::this_thread::sleep_for(kWakeUp);
      const std::uint64_t beat = session_.pulse.beat();
      still = beat == last ? still + 1 : 0;
      last = beat;
      if (still >= wake_ups_in(kPatience)) return TickPulse::place_of(beat) == TickPulse::Place::outside;
    }
    return false;
  }

  [[nodiscard]] ZeroForce stop_device() {
    return ask([](Device& device) { return device.emergency_stop(); });
  }
  [[nodiscard]] ZeroForce zero_force() {
    return ask([](Device& device) { return device.zero_force(); });
  }
  template <class Question>
  [[nodiscard]] ZeroForce ask(Question question) {
    const auto answer = std::make_shared<std::atomic<ZeroForce>>(ZeroForce::failed);
    (void)call_within(kLongestStop, [answer, question, &device = session_.device] { *answer = question(device); });
    return *answer;
  }

  [[noreturn]] void end(const std::string& what, ZeroForce zero, int exit_code) {
    const std::string words = fmt::format("{}; {}", what, describe(zero));
    bool kept = session_.keep == nullptr;
    const auto whole = std::make_shared<std::atomic<bool>>(false);
    if (!kept)
      kept = call_within(kLongestKeep, [&keep = session_.keep, words, whole] {
        keep(words);
        *whole = true;
      });
    const std::string all = session_.keep == nullptr ? words
                            : kept && *whole
                                ? words + "; the recording keeps what happened before"
                                : words + "; the recording is not finished: repair it with haptrace recover";
    (void)call_within(kLongestTelling, [all, zero, exit_code] { last_words()(all, zero, exit_code); });
    std::_Exit(exit_code);
  }

  const Session session_;
  const double patience_;  ///< [s]
  std::binary_semaphore ending_{0};
  std::thread thread_;
};

Watchdog::Watchdog(Session session) : thread_(std::make_unique<Thread>(std::move(session))) {
  ++sessions;
}

Watchdog::~Watchdog() {
  thread_.reset();
  --sessions;
}

void tell_last_words_with(TellLastWords tell) {
  last_words() = std::move(tell);
}

CrashWatch::CrashWatch() {
  [[maybe_unused]] static const bool registered = [] {
    return std::atexit(on_exit_call) == 0 && std::at_quick_exit(on_exit_call) == 0;
  }();
  watched_process = getpid();
  watches_crashes = true;
  for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT}) {
    struct sigaction action {};
    action.sa_handler = on_crash;
    action.sa_flags = SA_ONSTACK;
    struct sigaction old {};
    if (sigaction(signal, &action, &old) == 0) before_.emplace_back(signal, old);
  }
}

CrashWatch::~CrashWatch() {
  watches_crashes = false;
  for (const auto& [signal, old] : before_) sigaction(signal, &old, nullptr);
}

void end_foreign_exit() noexcept {
  if (foreign_code != nullptr && getpid() == watched_process) on_exit_call();
}

SignalStack::SignalStack() : memory_(std::make_unique<char[]>(kSignalStack)) {
  stack_t stack{};
  stack.ss_sp = memory_.get();
  stack.ss_size = kSignalStack;
  sigaltstack(&stack, nullptr);
}

SignalStack::~SignalStack() {
  stack_t stack{};
  stack.ss_flags = SS_DISABLE;
  sigaltstack(&stack, nullptr);
}

ForeignCall::ForeignCall(const char* name, Thread thread) noexcept {
  foreign_code = name;
  can_be_left = thread == Thread::loose;
}

ForeignCall::~ForeignCall() {
  foreign_code = nullptr;
  can_be_left = false;
}

}  // namespace haptrace
