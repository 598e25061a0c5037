// A simulated device in real time, as the mechanism of an emulated device.
#pragma once

#include "devices/device_spec.h"
#include "devices/sim/sim_device.h"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace haptrace {

/// The mechanism that an emulated device connects its encoders and motors to.
///
/// Threads: one at a time.
class LivePlant {
 public:
  explicit LivePlant(std::unique_ptr<SimDevice> plant) : plant_(std::move(plant)) {}

  /// Advances to `now_ns` of any clock that does not go back, under the force applied last. The first call only sets
  /// the time. At most 0.1 s passes per call; the rest, as after a suspend, passes without motion.
  void advance_to(std::int64_t now_ns) noexcept;

  /// Sets the force of the motors on the hand from now on, in W [N].
  void apply(const Vec3& force) noexcept { force_ = force; }

  [[nodiscard]] const DeviceInfo& info() const noexcept { return plant_->info(); }
  [[nodiscard]] Vec3 position() const noexcept { return plant_->true_position(); }  ///< of the handle, in W [m]
  [[nodiscard]] Vec3 velocity() const noexcept { return plant_->true_velocity(); }  ///< [m/s]

 private:
  std::unique_ptr<SimDevice> plant_;
  Vec3 force_ = Vec3::Zero();
  std::int64_t now_ns_ = -1;
};

/// Returns true if `device` has emulated=true. Throws Error(input) if the value is neither true nor false, or if the
/// device has options of the plant without being emulated.
bool is_emulated(const DeviceSpec& device);

/// Opens the plant of an emulated device: `preset`, modified by the options of `sim` that `device` has. Throws
/// Error(input).
LivePlant open_live_plant(const DeviceSpec& device, const std::string& preset);

/// Returns `emulated` and the options of `sim`, for a backend that can be emulated.
std::vector<DeviceBackend::Option> emulated_options();

}  // namespace haptrace
