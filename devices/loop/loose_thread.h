// A thread for calls that may never return: into a vendor's library, a plug-in, a driver of the kernel.
#pragma once

#include <functional>
#include <memory>
#include <thread>

namespace haptrace {

/// A thread that is waited for no longer than one wants.
///
/// Threads: one at a time, not the thread itself. Not real-time.
class LooseThread {
 public:
  LooseThread() = default;
  /// `body` owns what it uses, since it may outlive everything else. What it throws ends the process.
  explicit LooseThread(std::function<void()> body);
  /// Waits as long as it lasts, unless join_within gave it up.
  ~LooseThread();
  LooseThread(const LooseThread&) = delete;
  LooseThread& operator=(const LooseThread&) = delete;
  LooseThread(LooseThread&&) = default;
  LooseThread& operator=(LooseThread&& other) noexcept;  ///< of one that is joined, or none

  /// Waits until it returned, `seconds` at most. False when it did not: then it goes on alone. True when there is none.
  bool join_within(double seconds) noexcept;

  /// Whether this process has threads that were given up. It must not run destructors of static objects under them: it
  /// ends by std::_Exit.
  [[nodiscard]] static bool any_given_up() noexcept;

 private:
  struct Done;
  std::shared_ptr<Done> done_;
  std::thread thread_;
};

/// Runs `call`, which owns what it uses, in a thread of its own, and waits for it `seconds` at most. False when it goes
/// on alone.
bool call_within(double seconds, std::function<void()> call);

}  // namespace haptrace
