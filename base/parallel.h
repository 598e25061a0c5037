// Parallel execution of jobs on all cores.
#pragma once

#include "base/stop_request.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace haptrace {

/// Runs work(0) to work(count - 1), each once, on `threads` threads (0: one per core). Starts the jobs in order until
/// `stop` is raised. Calls `told(done)` in the calling thread with the number of finished jobs, about ten times a
/// second and at the end. If a job throws, no further jobs start, and the function throws the first exception. Returns
/// false if `stop` was raised before all jobs were done.
template <class Work, class Told>
bool run_parallel(std::size_t count, std::size_t threads, const StopRequest& stop, const Work& work, const Told& told) {
  if (threads == 0) threads = std::max(std::thread::hardware_concurrency(), 1U);
  threads = std::min(threads, count);
  std::atomic<std::size_t> next{0}, done{0};
  std::mutex mutex;
  std::condition_variable ended;
  std::size_t running = threads;  // guarded by the mutex, like the error
  std::exception_ptr error;

  const auto worker = [&] {
    std::exception_ptr mine;
    try {
      for (std::size_t job = next++; job < count && stop.count() == 0; job = next++) {
        work(job);
        ++done;
      }
    } catch (...) {
      mine = std::current_exception();
      next = count;
    }
    const std::lock_guard lock(mutex);
    if (mine && !error) error = mine;
    if (--running == 0) ended.notify_one();
  };
  {
    std::vector<std::jthread> pool;
    for (std::size_t i = 0; i < threads; ++i) pool.emplace_back(worker);
    std::unique_lock lock(mutex);
    while (!ended.wait_for(lock, std::chrono::milliseconds(100), [&] { return running == 0; })) {
      lock.unlock();
      told(done.load());
      lock.lock();
    }
  }
  if (error) std::rethrow_exception(error);
  told(done.load());
  return done == count;
}

}  // namespace haptrace
