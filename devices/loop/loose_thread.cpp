#include "devices/loop/loose_thread.h"

#include <atomic>
#include <chrono>
#include <semaphore>
#include <utility>

namespace haptrace {
namespace {

std::atomic<bool> given_up{false};

}  // namespace

/// Semaphore that the thread releases as its last action.
struct LooseThread::Done {
  std::binary_semaphore semaphore{0};
};

LooseThread::LooseThread(std::function<void()> body)
    : done_(std::make_shared<Done>()), thread_([done = done_, body = std::move(body)]() mutable {
        body();
        body = nullptr;
        done->semaphore.release();
      }) {}

LooseThread::~LooseThread() {
  if (thread_.joinable()) thread_.join();
}

LooseThread& LooseThread::operator=(LooseThread&& other) noexcept = default;

bool LooseThread::join_within(double seconds) noexcept {
  if (!thread_.joinable()) return done_ == nullptr;
  if (done_->semaphore.try_acquire_for(std::chrono::duration<double>(seconds))) {
    thread_.join();
    done_.reset();
    return true;
  }
  given_up = true;
  thread_.detach();
  return false;
}

bool LooseThread::any_given_up() noexcept {
  return given_up;
}

bool call_within(double seconds, std::function<void()> call) {
  return LooseThread(std::move(call)).join_within(seconds);
}

}  // namespace haptrace
