// A thread for calls that may never return: into a vendor's library, a plug-in or a kernel driver.
#pragma once

#include <functional>
#include <memory>
#include <thread>

namespace haptrace {

/// A thread that its owner joins with a time limit.
///
/// Threads: one at a time, never the thread itself. Not real-time.
class LooseThread {
 public:
  LooseThread() = default;
  /// `body` owns everything it uses, because it may outlive all else. An exception from it ends the process.
  explicit LooseThread(std::function<void()> body);
  /// Waits without a time limit, unless join_within gave the thread up.
  ~LooseThread();
  LooseThread(const LooseThread&) = delete;
  LooseThread& operator=(const LooseThread&) = delete;
  LooseThread(LooseThread&&) = default;
  LooseThread& operator=(LooseThread&& other) noexcept;  ///< `this` must be joined or without a thread

  /// Waits at most `seconds` for the thread to return. Returns false if it did not: it then runs on, detached. Returns
  /// true if there is no thread.
  bool join_within(double seconds) noexcept;

  /// Returns true if this process gave up a thread. It must then end by std::_Exit: the destructors of static objects
  /// must not run while such a thread uses them.
  [[nodiscard]] static bool any_given_up() noexcept;

 private:
  struct Done;
  std::shared_ptr<Done> done_;
  std::thread thread_;
};

/// Runs `call`, which owns everything it uses, in its own thread and waits at most `seconds` for it. Returns false if
/// the call runs on.
bool call_within(double seconds, std::function<void()> call);

}  // namespace haptrace
