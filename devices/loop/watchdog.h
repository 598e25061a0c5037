// Who ends a session whose tick does not return, or whose process crashes.
#pragma once

#include "devices/loop/servo_loop.h"

#include <csignal>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace haptrace {

/// Looks after a session from a thread of its own. When a tick has not returned for kPatience, or the process crashed
/// or was asked to exit in the middle of it (CrashWatch), it stops the device (Device::emergency_stop), lets the
/// recording be made whole, says what happened, and ends the process: the thread that hangs cannot be ended, and what
/// it uses cannot be let go of. Where only another thread crashed, the session's own end takes the force away first.
///
/// Patience is counted in its own wake-ups, so that time in which the whole process was stopped does not count.
///
/// Threads: made and destroyed in one thread. Nothing of it is in the tick.
class Watchdog {
 public:
  static constexpr double kPatience = 0.5;  ///< [s]

  struct Session {
    const TickPulse& pulse;
    Device& device;
    StopRequest& stop;
    /// Makes the recording whole and keeps these words in it; empty: there is none. Called in another thread while the
    /// session's own may be anywhere; what it needs lives as long as the process.
    std::function<void(const std::string& words)> keep;
    bool realtime = false;  ///< ask for a priority above the servo thread's
  };

  explicit Watchdog(Session session);
  ~Watchdog();
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

 private:
  class Thread;
  std::unique_ptr<Thread> thread_;
};

/// Prints the last words of the process before such an end, given the state of the force and the exit code of the
/// command. The default prints a line on standard error. Called once, in a thread of its own.
using TellLastWords = std::function<void(const std::string& words, ZeroForce zero, int exit_code)>;
void tell_last_words_with(TellLastWords tell);

/// From its construction to its end, a crash (SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT) or a call of exit() during a
/// session does not end the process with a force in the motors: the thread is held where it is, and a Watchdog ends the
/// session. Without a session it ends the process as ever, after words about code that is not ours. One at a time.
class CrashWatch {
 public:
  CrashWatch();
  ~CrashWatch();
  CrashWatch(const CrashWatch&) = delete;
  CrashWatch& operator=(const CrashWatch&) = delete;

 private:
  std::vector<std::pair<int, struct sigaction>> before_;  ///< to restore
};

/// For a program that has _exit() and _Exit() call it first: where code that is not ours (ForeignCall) asks for an end
/// without exit handlers, does what CrashWatch does for exit(). Returns elsewhere, and in processes that were forked.
void end_foreign_exit() noexcept;

/// A stack of its own for the signals of the thread that makes it: one whose stack is used up can say so.
class SignalStack {
 public:
  SignalStack();
  ~SignalStack();
  SignalStack(const SignalStack&) = delete;
  SignalStack& operator=(const SignalStack&) = delete;

 private:
  std::unique_ptr<char[]> memory_;
};

/// While it is, this thread runs code that is not ours: `name`, which outlives it, stands in the words about a crash.
///
/// Real-time: four stores.
class ForeignCall {
 public:
  /// A loose thread (LooseThread) is waited for with a bound. A crash or exit() in it outside a session is reported,
  /// and the thread is held; it does not end the process.
  enum class Thread { waited_for, loose };

  explicit ForeignCall(const char* name, Thread thread = Thread::waited_for) noexcept;
  ~ForeignCall();
  ForeignCall(const ForeignCall&) = delete;
  ForeignCall& operator=(const ForeignCall&) = delete;
};

}  // namespace haptrace
