// Real-time setup of a servo thread, and the settings that the operating system granted.
#pragma once

namespace haptrace {

/// Priority of a servo thread in SCHED_FIFO (1 to 99): above the kernel's interrupt threads (50).
inline constexpr int kServoPriority = 80;

struct RealtimeStatus;

/// Requests SCHED_FIFO for the calling thread, locked memory for the process and the finest timer slack. Touches the
/// thread's stack to avoid page faults later. The scheduling class ends with the thread.
RealtimeStatus request_realtime(int priority = kServoPriority);

/// Flushes denormals to zero in the calling thread during its lifetime. Without it, the decaying tails of filters at
/// rest make a multiplication about a hundred times slower.
class FlushDenormals {
 public:
  FlushDenormals() noexcept;
  ~FlushDenormals();
  FlushDenormals(const FlushDenormals&) = delete;
  FlushDenormals& operator=(const FlushDenormals&) = delete;

 private:
  unsigned saved_;
};

/// Marks a tick for clang's real-time sanitizer, which aborts on malloc, locks and I/O in this scope. Costs nothing
/// unless built with HAPTRACE_RTSAN.
class TickScope {
 public:
#ifdef HAPTRACE_RTSAN
  TickScope() noexcept;
  ~TickScope();
#else
  TickScope() noexcept {}  // NOLINT(modernize-use-equals-default): a trivial one would warn as unused
  ~TickScope() {}          // NOLINT(modernize-use-equals-default)
#endif
  TickScope(const TickScope&) = delete;
  TickScope& operator=(const TickScope&) = delete;
};

}  // namespace haptrace
