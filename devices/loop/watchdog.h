// A watchdog that ends a session if a tick does not return or the process crashes.
#pragma once

#include "devices/loop/servo_loop.h"

#include <csignal>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace haptrace {

/// Watches a session from its own thread. It acts if a tick has not returned for kPatience (kVirtualPatience), or if
/// the process crashed or was asked to exit during the session (CrashWatch). It stops the device
/// (Device::emergency_stop), completes the recording, reports the cause, and ends the process: a thread that hangs
/// cannot be ended, and its resources cannot be released. If only another thread crashed, the session's own end takes
/// the force away first.
///
/// Patience is counted in the watchdog's own wake-ups: time in which the whole process was stopped does not count.
///
/// Threads: constructed and destroyed in one thread. No part of it runs in the tick.
class Watchdog {
 public:
  static constexpr double kPatience = 0.5;  ///< [s]
  /// In virtual time no motor waits for the tick, and a busy machine may keep a thread from running for long [s].
  static constexpr double kVirtualPatience = 20;

  struct Session {
    const TickPulse& pulse;
    Device& device;
    StopRequest& stop;
    /// Completes the recording and stores these words in it; empty if there is no recording. Called in another thread
    /// while the session's thread may be anywhere. Everything it needs must live as long as the process.
    std::function<void(const std::string& words)> keep;
    bool realtime = false;      ///< request a priority above the servo thread's
    bool virtual_time = false;  ///< wait for kVirtualPatience
  };

  explicit Watchdog(Session session);
  ~Watchdog();
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

 private:
  class Thread;
  std::unique_ptr<Thread> thread_;
};

/// Prints the last words of the process before such an end, given the state of the force and the command's exit code.
/// The default prints a line on standard error. Called once, in its own thread.
using TellLastWords = std::function<void(const std::string& words, ZeroForce zero, int exit_code)>;
void tell_last_words_with(TellLastWords tell);

/// Catches a crash (SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT) or a call of exit() during its lifetime, so that no force
/// stays in the motors. During a session, it holds the thread where it is, and a Watchdog ends the session. Without a
/// session, the process ends as usual, after a message if foreign code caused the end. Only one may exist at a time.
class CrashWatch {
 public:
  CrashWatch();
  ~CrashWatch();
  CrashWatch(const CrashWatch&) = delete;
  CrashWatch& operator=(const CrashWatch&) = delete;

 private:
  std::vector<std::pair<int, struct sigaction>> before_;  ///< handlers to restore
};

/// Does for _exit() and _Exit() what CrashWatch does for exit(): a program that defines them calls this first. Acts
/// only in foreign code (ForeignCall); returns elsewhere, and in forked processes.
void end_foreign_exit() noexcept;

/// Gives the thread that constructs it an alternate signal stack, so that a stack overflow can still be reported.
class SignalStack {
 public:
  SignalStack();
  ~SignalStack();
  SignalStack(const SignalStack&) = delete;
  SignalStack& operator=(const SignalStack&) = delete;

 private:
  std::unique_ptr<char[]> memory_;
};

/// Marks this thread as running foreign code during its lifetime. The report of a crash contains `name`, which must
/// outlive it.
///
/// Real-time: four stores.
class ForeignCall {
 public:
  /// The caller waits for a loose thread (LooseThread) with a time limit. A crash or exit() in it outside a session is
  /// reported and holds the thread; it does not end the process.
  enum class Thread { waited_for, loose };

  explicit ForeignCall(const char* name, Thread thread = Thread::waited_for) noexcept;
  ~ForeignCall();
  ForeignCall(const ForeignCall&) = delete;
  ForeignCall& operator=(const ForeignCall&) = delete;
};

}  // namespace haptrace
