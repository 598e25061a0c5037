// The Novint Falcon as a device.
#pragma once

#include "devices/falcon/dialogue.h"
#include "devices/falcon/tracker.h"
#include "devices/guardian/guardian.h"
#include "devices/loop/threaded_device.h"
#include "devices/registry.h"

namespace haptrace {

/// What a Falcon of this calibration can do; its name and serial number are the caller's to add.
DeviceInfo falcon_info(const FalconCalibration& calibration);

/// What a guardian sends to the firmware: zero counts and dark lights, in three whole packets. Firmware that counts
/// bytes instead of looking for brackets finds the begin of the second, should the host's last packet have broken off.
/// Homing stays asked for as long as the host may come back.
LastWords falcon_last_words(const FalconCalibration& calibration);

/// A round is one packet and its answer. Until all three legs are homed no force is sent, the state is not ready, and
/// its position stands still; then it is p = FK(encoders), and the motors bring up tau = J^T F.
///
/// Counts stay in the motors until the next packet, so zero ones are the last on every way out. Where the link lets
/// another process reach the firmware, a guardian sends them for a host that is dead or stands still.
///
/// Its logo is red while it is not ready, green once it is, and blue as well while it pushes.
class FalconDriver final : public DeviceDriver {
 public:
  /// `link` is one to running firmware. Plays the first rounds, after which a Falcon that is homed is ready. `info` is
  /// that of falcon_info, completed.
  FalconDriver(std::unique_ptr<FalconLink> link, const FalconCalibration& calibration, DeviceInfo info);
  ~FalconDriver() override { (void)release(); }

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  [[nodiscard]] bool round(const Wrench& wrench, DeviceState& state) override;
  ZeroForce release() noexcept override;
  [[nodiscard]] ZeroForce emergency_stop() noexcept override;

 private:
  [[nodiscard]] std::array<std::int16_t, 3> motors(const Vec3& force) const noexcept;

  FalconCalibration calibration_;
  DeviceInfo info_;
  std::unique_ptr<FalconLink> link_;  ///< null once it is released
  ZeroForce farewell_ = ZeroForce::failed;
  FalconDialogue dialogue_;
  std::optional<Guardian> guardian_;  ///< where another process can reach the firmware
  FalconTracker tracker_;
  FalconEncoderWatch watch_;
  FalconTracker::Verdict verdict_ = FalconTracker::Verdict::unhomed;
  Vec3 position_ = Vec3::Zero();  ///< p_WT, the last that was believed [m]
};

DeviceBackend falcon_backend();  ///< in backend.cpp

}  // namespace haptrace
