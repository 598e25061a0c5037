// What makes a thread fit for a servo loop, and what was actually obtained.
#pragma once

#include <string>

namespace haptrace {

/// Of a servo thread, among SCHED_FIFO's 1 to 99: above the kernel's threads for interrupts (50).
inline constexpr int kServoPriority = 80;

/// What the operating system granted. Reported with every session, never assumed.
struct RealtimeStatus {
  std::string scheduler = "SCHED_OTHER";  ///< for example "SCHED_FIFO 80"
  bool realtime = false;                  ///< a real-time class was granted
  bool memory_locked = false;
  std::string reason;  ///< what was refused and how to mend it; empty when everything was granted
};

/// Asks for SCHED_FIFO for the calling thread, locked memory for the process, and the finest timer slack; touches its
/// stack so that no page is missing later. The scheduling class ends with the thread.
RealtimeStatus request_realtime(int priority = kServoPriority);

/// Flushes denormals to zero in the calling thread while it exists: the tails of filters at rest cost a hundred times
/// an ordinary multiplication otherwise.
class FlushDenormals {
 public:
  FlushDenormals() noexcept;
  ~FlushDenormals();
  FlushDenormals(const FlushDenormals&) = delete;
  FlushDenormals& operator=(const FlushDenormals&) = delete;

 private:
  unsigned saved_;
};

/// Marks the scope of a tick for clang's real-time sanitizer, which aborts on malloc, locks and I/O inside it.
/// Costs nothing unless built with HAPTRACE_RTSAN.
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
