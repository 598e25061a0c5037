#include "devices/loop/threaded_device.h"

#include "base/error.h"
#include "base/mailbox.h"
#include "devices/loop/clock.h"
#include "devices/loop/realtime.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <exception>
#include <fmt/format.h>
#include <mutex>
#include <optional>
#include <semaphore>
#include <thread>

namespace haptrace {
namespace {

constexpr double kFirstAnswer = 1;                   // longest wait for the first answer [s]
constexpr double kLongestWatch = 1;                  // [s]
constexpr std::chrono::milliseconds kOwnRounds{10};  // time between rounds without an exchange
constexpr double kLongestRound = 0.04;               // a longer round means that the process stood still [s]
constexpr int kDoubtful = 2;  // answers to discard after such a round: they may have been on their way before it
constexpr double kLongestGoodbye = 2;          // longest wait for a driver's release [s]
constexpr double kZeroAnswer = 0.2;            // longest wait for the answer to zero force [s]
constexpr double kEmergencyRelease = 0.1;      // a driver that still runs its rounds ends within this time [s]
constexpr std::chrono::milliseconds kLook{1};  // polling interval for another thread's state

double since(std::int64_t ns) {
  return 1e-9 * static_cast<double>(monotonic_ns() - ns);
}

}  // namespace

/// The driver, and the state that its thread shares with the tick.
class ThreadedDevice::Rounds {
 public:
  explicit Rounds(std::unique_ptr<DeviceDriver> driver) : driver_(std::move(driver)) {}

  [[nodiscard]] DeviceDriver& driver() noexcept { return *driver_; }
  [[nodiscard]] bool is_lost() const noexcept { return lost_.load(std::memory_order_relaxed); }

  void first_answer();
  void run() noexcept;  ///< runs until end() or a loss, then releases the driver
  void end() noexcept;

  void order(const Wrench& wrench, std::int64_t until_ns) noexcept;
  void take(DeviceState& state) noexcept;

  /// Returns the result of the release, once it is done.
  [[nodiscard]] std::optional<ZeroForce> released() const noexcept {
    return released_.load(std::memory_order_acquire) ? std::optional(release_) : std::nullopt;
  }
  /// Requests a round now and waits until the device answers it or the driver is released.
  [[nodiscard]] ZeroForce await_zero() noexcept;
  /// Waits at most `seconds` for the release.
  [[nodiscard]] std::optional<ZeroForce> await_release(double seconds) const noexcept;

  [[nodiscard]] std::string why_lost() const {
    const std::scoped_lock lock(reason_);
    return why_;
  }

  RealtimeStatus realtime;  ///< written before `started` is released
  std::binary_semaphore started{0};

 private:
  struct Order {
    Wrench wrench;
    std::int64_t until_ns = 0;  ///< the wrench is void after this time
  };
  struct Answer {
    DeviceState state;
    std::int64_t taken_ns = 0;  ///< arrival of the answer, on the monotonic clock
  };

  void post(Answer& answer);
  void lose(const std::string& why) noexcept;

  std::unique_ptr<DeviceDriver> driver_;  ///< owned by the thread while it runs
  Mailbox<Order> order_;
  Mailbox<Answer> answer_;
  std::counting_semaphore<> wake_{0};  ///< released by every exchange
  std::atomic<bool> ending_{false}, lost_{false}, released_{false};
  std::atomic<bool> holds_{false};          ///< a force was sent, and no zero force was answered since
  std::atomic<std::int64_t> zeroed_ns_{0};  ///< start of the last answered round with zero force
  ZeroForce release_ = ZeroForce::failed;   ///< written before released_
  mutable std::mutex reason_;               ///< guards why_; never taken in exchange
  std::string why_ = "the device stopped answering";
  std::uint64_t answers_ = 0;
};

void ThreadedDevice::Rounds::first_answer() {
  Answer answer;
  const std::int64_t begin = monotonic_ns();
  while (!driver_->round({}, answer.state)) {
    if (since(begin) < kFirstAnswer) continue;
    (void)driver_->release();
    throw device_error(fmt::format("{}: it was opened, but does not answer", driver_->info().name));
  }
  post(answer);
}

void ThreadedDevice::Rounds::post(Answer& answer) {
  answer.taken_ns = monotonic_ns();
  Answer numbered = answer;
  ++answers_;
  if (numbered.state.sequence == 0) numbered.state.sequence = answers_;
  answer_.post(numbered);
}

void ThreadedDevice::Rounds::order(const Wrench& wrench, std::int64_t until_ns) noexcept {
  order_.post({wrench, until_ns});
  wake_.release();
}

void ThreadedDevice::Rounds::take(DeviceState& state) noexcept {
  const Answer& newest = answer_.latest();
  state = newest.state;
  state.age += since(newest.taken_ns);
}

void ThreadedDevice::Rounds::run() noexcept {
  const FlushDenormals flush;
  Answer answer;
  double silence = 0;  // time without an answer [s]
  int doubtful = 0;    // number of the next answers to discard
  std::int64_t round_ns = monotonic_ns();
  try {
    while (!ending_) {
      (void)wake_.try_acquire_for(kOwnRounds);
      while (wake_.try_acquire()) {
        // Ticks during a round are answered by the next round, with the newest wrench.
      }
      const Order& order = order_.latest();
      const std::int64_t began_ns = monotonic_ns();
      const Wrench wrench = began_ns < order.until_ns ? order.wrench : Wrench{};
      const bool zero = wrench.force.isZero(0) && wrench.torque.isZero(0);
      if (!zero) holds_ = true;
      const bool answered = driver_->round(wrench, answer.state);
      if (since(began_ns) > kLongestRound || 1e-9 * static_cast<double>(began_ns - round_ns) > kLongestRound)
        doubtful = kDoubtful;
      if (answered) {
        if (doubtful > 0)
          --doubtful;
        else
          post(answer);
        silence = 0;
        if (zero) {
          holds_ = false;
          zeroed_ns_ = began_ns;
        }
      } else {
        silence += std::min(since(round_ns), kLongestRound);
        if (silence > kPatience)
          throw device_error(
              fmt::format("it did not answer for {:.0f} ms; check its cable and its power", 1e3 * silence));
      }
      round_ns = monotonic_ns();
    }
  } catch (const std::exception& error) {
    lose(error.what());
  }
  release_ = driver_->release();
  if (!holds_) release_ = ZeroForce::confirmed;
  released_.store(true, std::memory_order_release);
}

void ThreadedDevice::Rounds::lose(const std::string& why) noexcept {
  const std::scoped_lock lock(reason_);
  why_ = why;
  lost_ = true;
}

void ThreadedDevice::Rounds::end() noexcept {
  ending_ = true;
  wake_.release();
}

std::optional<ZeroForce> ThreadedDevice::Rounds::await_release(double seconds) const noexcept {
  const std::int64_t begin = monotonic_ns();
  while (!released() && since(begin) < seconds) std::this_thread::sleep_for(kLook);
  return released();
}

ZeroForce ThreadedDevice::Rounds::await_zero() noexcept {
  const std::int64_t begin = monotonic_ns();
  while (!is_lost() && !released() && since(begin) < kZeroAnswer) {
    if (zeroed_ns_ >= begin) return ZeroForce::confirmed;
    wake_.release();
    std::this_thread::sleep_for(kLook);
  }
  const auto released = is_lost() ? await_release(kLongestGoodbye) : this->released();
  return released.value_or(holds_ ? ZeroForce::failed : ZeroForce::confirmed);
}

ThreadedDevice::ThreadedDevice(std::unique_ptr<DeviceDriver> driver)
    : rounds_(std::make_shared<Rounds>(std::move(driver))), info_(rounds_->driver().info()) {
  rounds_->first_answer();
  thread_ = LooseThread([rounds = rounds_] {
    rounds->realtime = request_realtime();
    rounds->started.release();
    rounds->run();
  });
  rounds_->started.acquire();
}

ThreadedDevice::~ThreadedDevice() {
  close();
}

std::int64_t ThreadedDevice::watched_ns(double dt) noexcept {
  const double watched = std::max(kWatchdog, std::min(kWatchedTicks * dt, kLongestWatch));  // also when dt is NaN
  return static_cast<std::int64_t>(1e9 * watched);
}

Device::Status ThreadedDevice::exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept {
  if (closed_ || rounds_->is_lost()) return Status::lost;
  rounds_->order(sendable(wrench), monotonic_ns() + watched_ns(dt));
  rounds_->take(state);
  return Status::ok;
}

void ThreadedDevice::close() noexcept {
  closed_ = true;
  rounds_->end();
  (void)thread_.join_within(kLongestGoodbye);
}

ZeroForce ThreadedDevice::zero_force() noexcept {
  return rounds_->await_zero();
}

ZeroForce ThreadedDevice::emergency_stop() noexcept {
  rounds_->end();
  const auto released = rounds_->await_release(kEmergencyRelease);
  return released ? *released : rounds_->driver().emergency_stop();
}

const RealtimeStatus& ThreadedDevice::realtime() const noexcept {
  return rounds_->realtime;
}

std::string ThreadedDevice::not_ready_reason() const {
  return rounds_->driver().not_ready_reason();
}

std::string ThreadedDevice::lost_reason() const {
  return closed_ ? "the device is closed" : rounds_->why_lost();
}

}  // namespace haptrace
