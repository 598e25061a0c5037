#include "devices/loop/realtime.h"

#include "devices/loop/servo_session.h"

#include <cerrno>
#include <cstring>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>

#if defined(__SSE2__)
#include <immintrin.h>
#endif

#ifdef HAPTRACE_RTSAN
extern "C" {
void __rtsan_realtime_enter();
void __rtsan_realtime_exit();
}
#endif

namespace haptrace {
namespace {

void touch_stack() {
  volatile unsigned char page[64 * 1024];
  for (std::size_t i = 0; i < sizeof page; i += 1024) page[i] = 0;
}

}  // namespace

RealtimeStatus request_realtime(int priority) {
  RealtimeStatus status;
  prctl(PR_SET_TIMERSLACK, 1UL, 0UL, 0UL, 0UL);

  const sched_param parameter{.sched_priority = priority};
  if (sched_setscheduler(0, SCHED_FIFO, &parameter) == 0) {
    status.scheduler = "SCHED_FIFO " + std::to_string(priority);
    status.realtime = true;
  } else {
    status.reason = std::string("SCHED_FIFO refused (") + std::strerror(errno) +
                    "): allow it with 'rtprio 80' in /etc/security/limits.d or run with CAP_SYS_NICE";
  }

  // A tick allocates nothing, so locking the current mappings covers all memory that it touches.
  if (mlockall(MCL_CURRENT) == 0) {
    status.memory_locked = true;
  } else {
    if (!status.reason.empty()) status.reason += "; ";
    status.reason += std::string("memory lock refused (") + std::strerror(errno) +
                     "): allow it with 'memlock unlimited' in /etc/security/limits.d";
  }
  touch_stack();
  return status;
}

#if defined(__SSE2__)
FlushDenormals::FlushDenormals() noexcept : saved_(_mm_getcsr()) {
  constexpr unsigned kFlushToZero = 0x8000, kDenormalsAreZero = 0x0040;
  _mm_setcsr(saved_ | kFlushToZero | kDenormalsAreZero);
}
FlushDenormals::~FlushDenormals() {
  _mm_setcsr(saved_);
}
#elif defined(__aarch64__)
FlushDenormals::FlushDenormals() noexcept {
  unsigned long fpcr;
  asm volatile("mrs %0, fpcr" : "=r"(fpcr));
  saved_ = static_cast<unsigned>(fpcr);
  constexpr unsigned long kFlushToZero = 1UL << 24;
  asm volatile("msr fpcr, %0" ::"r"(fpcr | kFlushToZero));
}
FlushDenormals::~FlushDenormals() {
  asm volatile("msr fpcr, %0" ::"r"(static_cast<unsigned long>(saved_)));
}
#else
FlushDenormals::FlushDenormals() noexcept : saved_(0) {}
FlushDenormals::~FlushDenormals() = default;
#endif

#ifdef HAPTRACE_RTSAN
TickScope::TickScope() noexcept {
  __rtsan_realtime_enter();
}
TickScope::~TickScope() {
  __rtsan_realtime_exit();
}
#endif

}  // namespace haptrace
