// A simulated device in real time: what an emulated device puts its encoders and motors on.
#pragma once

#include "devices/sim/sim_device.h"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace haptrace {

/// Threads: one at a time.
class LivePlant {
 public:
  explicit LivePlant(std::unique_ptr<SimDevice> plant) : plant_(std::move(plant)) {}

  /// Moves on to `now_ns` of any clock that does not go back, under the force applied last. The first call only says
  /// what time it is; time beyond a tenth of a second, as after a suspend, passes without motion.
  void advance_to(std::int64_t now_ns) noexcept;

  /// Force of the motors on the hand from now on, in W [N].
  void apply(const Vec3& force) noexcept { force_ = force; }

  [[nodiscard]] const DeviceInfo& info() const noexcept { return plant_->info(); }
  [[nodiscard]] Vec3 position() const noexcept { return plant_->true_position(); }  ///< of the handle, in W [m]
  [[nodiscard]] Vec3 velocity() const noexcept { return plant_->true_velocity(); }  ///< [m/s]

 private:
  std::unique_ptr<SimDevice> plant_;
  Vec3 force_ = Vec3::Zero();
  std::int64_t now_ns_ = -1;
};

/// Whether `device` has emulated=true. Throws Error(input) when it has anything but true or false, or has options of
/// the plant without being emulated.
bool is_emulated(const DeviceSpec& device);

/// The plant of an emulated device: `preset` unless the options of `sim` that `device` has say otherwise.
/// Throws Error(input).
LivePlant open_live_plant(const DeviceSpec& device, const std::string& preset);

/// `emulated`, and the options of `sim`: what a backend that can be emulated understands besides its own.
std::vector<DeviceBackend::Option> emulated_options();

}  // namespace haptrace
