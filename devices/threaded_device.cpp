#include "devices/threaded_device.h"

#include "control/error.h"
#include "devices/clock.h"

#include <algorithm>
#include <chrono>
#include <exception>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr double kFirstAnswer = 1;                   // how long to wait for it [s]
constexpr double kLongestWatch = 1;                  // [s]
constexpr std::chrono::milliseconds kOwnRounds{10};  // apart, while nobody exchanges
constexpr double kLongestRound = 0.04;               // what lasts longer is a process that stood still [s]

double since(std::int64_t ns) {
  return 1e-9 * static_cast<double>(monotonic_ns() - ns);
}

}  // namespace

ThreadedDevice::ThreadedDevice(std::unique_ptr<DeviceDriver> driver)
    : driver_(std::move(driver)), info_(driver_->info()) {
  first_answer();
  std::binary_semaphore started{0};
  thread_ = std::thread([this, &started] {
    realtime_ = request_realtime();
    started.release();
    run();
  });
  started.acquire();
}

ThreadedDevice::~ThreadedDevice() {
  close();
}

void ThreadedDevice::first_answer() {
  Answer answer;
  const std::int64_t begin = monotonic_ns();
  while (!driver_->round({}, answer.state)) {
    if (since(begin) < kFirstAnswer) continue;
    driver_->release();
    throw device_error(fmt::format("{}: it was opened, but does not answer", info_.name));
  }
  post(answer);
}

void ThreadedDevice::post(Answer& answer) {
  answer.taken_ns = monotonic_ns();
  Answer numbered = answer;
  ++answers_;
  if (numbered.state.sequence == 0) numbered.state.sequence = answers_;
  answer_.post(numbered);
}

std::int64_t ThreadedDevice::watched_ns(double dt) noexcept {
  const double watched = std::max(kWatchdog, std::min(kWatchedTicks * dt, kLongestWatch));  // also when dt is NaN
  return static_cast<std::int64_t>(1e9 * watched);
}

Device::Status ThreadedDevice::exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept {
  if (closed_ || lost_.load(std::memory_order_relaxed)) return Status::lost;
  order_.post({sendable(wrench), monotonic_ns() + watched_ns(dt)});
  wake_.release();
  const Answer& newest = answer_.latest();
  state = newest.state;
  state.age += since(newest.taken_ns);
  return Status::ok;
}

void ThreadedDevice::run() noexcept {
  const FlushDenormals flush;
  Answer answer;
  double silence = 0;  // without an answer [s]
  std::int64_t round_ns = monotonic_ns();
  try {
    while (!ending_) {
      (void)wake_.try_acquire_for(kOwnRounds);
      while (wake_.try_acquire()) {
        // Ticks that came while a round lasted are answered by the next, with the newest wrench.
      }
      const Order& order = order_.latest();
      if (driver_->round(monotonic_ns() < order.until_ns ? order.wrench : Wrench{}, answer.state)) {
        post(answer);
        silence = 0;
      } else {
        silence += std::min(since(round_ns), kLongestRound);
        if (silence > kPatience)
          throw device_error(
              fmt::format("it gave no answer for {:.0f} ms; look at its cable and its power", 1e3 * silence));
      }
      round_ns = monotonic_ns();
    }
  } catch (const std::exception& error) {
    lose(error.what());
  }
  driver_->release();
}

void ThreadedDevice::lose(const std::string& why) noexcept {
  const std::scoped_lock lock(reason_);
  why_ = why;
  lost_ = true;
}

void ThreadedDevice::close() noexcept {
  closed_ = true;
  if (!thread_.joinable()) return;
  ending_ = true;
  wake_.release();
  thread_.join();
}

std::string ThreadedDevice::lost_reason() const {
  if (closed_) return "the device is closed";
  const std::scoped_lock lock(reason_);
  return why_;
}

}  // namespace haptrace
