#include "devices/recovering_device.h"

#include <exception>
#include <fmt/format.h>

namespace haptrace {
namespace {

bool is_same(const DeviceInfo& one, const DeviceInfo& other) {
  return one.backend == other.backend && one.model == other.model && one.serial == other.serial;
}

std::string identity(const DeviceInfo& info) {
  return fmt::format("{} {}{}{}", info.backend, info.model, info.serial.empty() ? "" : ", serial number ", info.serial);
}

}  // namespace

RecoveringDevice::RecoveringDevice(Open open)
    : open_(std::move(open)), device_(open_()), info_(device_->info()), thread_([this] { seek_when_asked(); }) {}

RecoveringDevice::~RecoveringDevice() {
  close();
}

Device::Status RecoveringDevice::exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept {
  if (closed_) return Status::lost;
  if (dt > 0) until_retry_ -= dt;
  Status status = Status::away;
  switch (place_.load(std::memory_order_acquire)) {
    case Place::here:
      status = device_->exchange(wrench, dt, state);
      break;
    case Place::found:
      status = device_->exchange({}, 0, state);
      place_.store(Place::here, std::memory_order_relaxed);
      break;
    case Place::gone:
    case Place::sought:
      return Status::away;
    case Place::replaced:
      return Status::lost;
  }
  if (status != Status::lost || info_.natural_duration > 0) return status;
  place_.store(Place::gone, std::memory_order_relaxed);
  return Status::away;
}

void RecoveringDevice::between_ticks(bool may_wait) noexcept {
  if (closed_) return;
  const Place place = place_.load(std::memory_order_acquire);
  if (place == Place::here) device_->between_ticks(may_wait);
  if (place != Place::gone || until_retry_ > 0) return;
  until_retry_ = kRetry;
  place_.store(Place::sought, std::memory_order_release);
  wake_.release();
  if (may_wait) place_.wait(Place::sought, std::memory_order_acquire);
}

void RecoveringDevice::seek_when_asked() noexcept {
  while (true) {
    wake_.acquire();
    if (ending_) return;
    place_.store(seek(), std::memory_order_release);
    place_.notify_one();
  }
}

RecoveringDevice::Place RecoveringDevice::seek() noexcept {
  const auto note = [this](std::string& reason, const std::string& text) {
    const std::scoped_lock lock(reasons_);
    reason = text;
  };
  if (device_ != nullptr) {
    note(lost_why_, device_->lost_reason());
    device_.reset();
  }
  try {
    std::unique_ptr<Device> opened = open_();
    if (is_same(opened->info(), info_)) {
      note(found_not_, "");
      device_ = std::move(opened);
      return Place::found;
    }
    note(found_not_, fmt::format("another device answers in its place, {}, where {} was; it is refused",
                                 identity(opened->info()), identity(info_)));
    return Place::replaced;
  } catch (const std::exception& error) {
    note(found_not_, fmt::format("opening it again: {}", error.what()));
    return Place::gone;
  }
}

void RecoveringDevice::close() noexcept {
  closed_ = true;
  if (thread_.joinable()) {
    ending_ = true;
    wake_.release();
    thread_.join();
  }
  if (device_ != nullptr) device_->close();
}

std::string RecoveringDevice::lost_reason() const {
  if (closed_) return "the device is closed";
  const Place place = place_.load(std::memory_order_acquire);
  // The device itself may be asked as long as it was not given to the thread.
  const std::scoped_lock lock(reasons_);
  if (place != Place::sought && device_ != nullptr) return device_->lost_reason();
  return found_not_.empty() ? lost_why_ : fmt::format("{}; {}", lost_why_, found_not_);
}

std::string RecoveringDevice::not_ready_reason() const {
  const Place place = place_.load(std::memory_order_acquire);
  return place != Place::sought && device_ != nullptr ? device_->not_ready_reason() : "";
}

}  // namespace haptrace
