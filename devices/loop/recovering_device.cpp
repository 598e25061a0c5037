#include "devices/loop/recovering_device.h"

#include <atomic>
#include <exception>
#include <fmt/format.h>
#include <mutex>
#include <semaphore>

namespace haptrace {
namespace {

constexpr double kLongestOpening = 2;  // longest time that close waits for `open` [s]

bool is_same(const DeviceInfo& one, const DeviceInfo& other) {
  return one.backend == other.backend && one.model == other.model && one.serial == other.serial;
}

std::string identity(const DeviceInfo& info) {
  return fmt::format("{} {}{}{}", info.backend, info.model, info.serial.empty() ? "" : ", serial number ", info.serial);
}

}  // namespace

/// The device, and the thread that searches for it.
class RecoveringDevice::Search {
 public:
  /// State of the device. It also decides which thread may use the device: the search thread while `sought`, else the
  /// caller.
  enum class Place : std::uint8_t {
    here,
    gone,     ///< lost; the search has not started
    sought,   ///< the thread searches for it
    found,    ///< found, before the first exchange
    replaced  ///< another device answered in its place
  };
  static_assert(std::atomic<Place>::is_always_lock_free);

  explicit Search(Open open) : open_(std::move(open)), device(open_()), info_(device->info()) {}

  void run() noexcept;
  void begin() noexcept {
    place.store(Place::sought, std::memory_order_release);
    wake_.release();
  }
  void end() noexcept {
    ending_ = true;
    wake_.release();
  }

  /// Returns null while the thread owns the device, and if the device was not found.
  [[nodiscard]] Device* ours() noexcept {
    return place.load(std::memory_order_acquire) != Place::sought ? device.get() : nullptr;
  }
  [[nodiscard]] std::string why_lost() const {
    const std::scoped_lock lock(reasons_);
    return found_not_.empty() ? lost_why_ : fmt::format("{}; {}", lost_why_, found_not_);
  }
  /// Returns the state of the force of the device that was lost.
  [[nodiscard]] ZeroForce zero_force() const noexcept { return zero_; }

  Open open_;
  std::unique_ptr<Device> device;  ///< may be null while `gone` or `sought`
  std::atomic<Place> place{Place::here};

 private:
  [[nodiscard]] Place seek() noexcept;

  const DeviceInfo info_;
  std::counting_semaphore<> wake_{0};
  std::atomic<bool> ending_{false};
  std::atomic<ZeroForce> zero_{ZeroForce::failed};
  mutable std::mutex reasons_;  ///< guards lost_why_ and found_not_; exchange never takes it
  std::string lost_why_ = "it stopped answering";
  std::string found_not_;  ///< why the last opening failed
};

void RecoveringDevice::Search::run() noexcept {
  while (true) {
    wake_.acquire();
    if (ending_) return;
    place.store(seek(), std::memory_order_release);
    place.notify_one();
  }
}

RecoveringDevice::Search::Place RecoveringDevice::Search::seek() noexcept {
  const auto note = [this](std::string& reason, const std::string& text) {
    const std::scoped_lock lock(reasons_);
    reason = text;
  };
  if (device != nullptr) {
    note(lost_why_, device->lost_reason());
    device->close();
    zero_ = device->zero_force();
    device.reset();
  }
  try {
    std::unique_ptr<Device> opened = open_();
    if (is_same(opened->info(), info_)) {
      note(found_not_, "");
      device = std::move(opened);
      return Place::found;
    }
    note(found_not_, fmt::format("another device answers in its place, {} instead of {}, and is rejected",
                                 identity(opened->info()), identity(info_)));
    return Place::replaced;
  } catch (const std::exception& error) {
    note(found_not_, fmt::format("it cannot be opened again: {}", error.what()));
    return Place::gone;
  }
}

RecoveringDevice::RecoveringDevice(Open open)
    : search_(std::make_shared<Search>(std::move(open))),
      info_(search_->device->info()),
      thread_([search = search_] { search->run(); }) {}

RecoveringDevice::~RecoveringDevice() {
  close();
}

Device::Status RecoveringDevice::exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept {
  using Place = Search::Place;
  if (closed_) return Status::lost;
  if (dt > 0) until_retry_ -= dt;
  Status status = Status::away;
  switch (search_->place.load(std::memory_order_acquire)) {
    case Place::here:
      status = search_->device->exchange(wrench, dt, state);
      break;
    case Place::found:
      status = search_->device->exchange({}, 0, state);
      search_->place.store(Place::here, std::memory_order_relaxed);
      break;
    case Place::gone:
    case Place::sought:
      return Status::away;
    case Place::replaced:
      return Status::lost;
  }
  if (status != Status::lost || info_.natural_duration > 0) return status;
  search_->place.store(Place::gone, std::memory_order_relaxed);
  return Status::away;
}

void RecoveringDevice::between_ticks(bool may_wait) noexcept {
  using Place = Search::Place;
  if (closed_) return;
  const Place place = search_->place.load(std::memory_order_acquire);
  if (place == Place::here) search_->device->between_ticks(may_wait);
  if (place != Place::gone || until_retry_ > 0) return;
  until_retry_ = kRetry;
  search_->begin();
  if (may_wait) search_->place.wait(Place::sought, std::memory_order_acquire);
}

void RecoveringDevice::close() noexcept {
  closed_ = true;
  search_->end();
  if (!thread_.join_within(kLongestOpening)) return;
  if (search_->device != nullptr) search_->device->close();
}

ZeroForce RecoveringDevice::zero_force() noexcept {
  Device* const device = search_->ours();
  return device != nullptr ? device->zero_force() : search_->zero_force();
}

ZeroForce RecoveringDevice::emergency_stop() noexcept {
  Device* const device = search_->ours();
  return device != nullptr ? device->emergency_stop() : search_->zero_force();
}

std::string RecoveringDevice::lost_reason() const {
  if (closed_) return "the device is closed";
  // The caller may use the device as long as the thread does not own it.
  Device* const device = search_->ours();
  return device != nullptr ? device->lost_reason() : search_->why_lost();
}

std::string RecoveringDevice::not_ready_reason() const {
  Device* const device = search_->ours();
  return device != nullptr ? device->not_ready_reason() : "";
}

}  // namespace haptrace
