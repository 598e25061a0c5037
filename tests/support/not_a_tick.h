// A scope within a tick in which a test acts for another thread.
#pragma once

#ifdef HAPTRACE_RTSAN
extern "C" {
void __rtsan_off();
void __rtsan_on();
}
#endif

namespace haptrace::test {

/// Tells clang's real-time sanitizer that what follows would run in another thread. A test that gives a command within
/// a tick does so at an exact time, which no other thread could.
class NotATick {
 public:
#ifdef HAPTRACE_RTSAN
  NotATick() noexcept {
    __rtsan_off();
  }
  ~NotATick() {
    __rtsan_on();
  }
#else
  NotATick() noexcept {}  // NOLINT(modernize-use-equals-default): a trivial one would warn as unused
  ~NotATick() {}          // NOLINT(modernize-use-equals-default)
#endif
  NotATick(const NotATick&) = delete;
  NotATick& operator=(const NotATick&) = delete;
};

}  // namespace haptrace::test
