// Driver of the Novint Falcon.
#pragma once

#include "devices/falcon/dialogue.h"
#include "devices/falcon/tracker.h"
#include "devices/guardian/guardian.h"
#include "devices/loop/threaded_device.h"
#include "devices/registry.h"

namespace haptrace {

/// Returns the DeviceInfo of a Falcon with this calibration. The caller adds its name and serial number.
DeviceInfo falcon_info(const FalconCalibration& calibration);

/// Returns the bytes that a guardian sends to the firmware: three complete packets with zero counts and dark lights. If
/// the host's last packet broke off, firmware that counts bytes instead of looking for brackets still finds the
/// beginning of the second packet. For a silent host, which may come back, the packets keep requesting homing.
LastWords falcon_last_words(const FalconCalibration& calibration);

/// Drives a Falcon; a round is one packet and its answer. Until all three legs are homed, the driver sends no force,
/// and the state is not ready and keeps its position. After that, the position is p = FK(encoders) and the motors
/// produce the torques tau = J^T F.
///
/// The motors keep their counts until the next packet, so the driver always sends zero counts last. If the link lets
/// another process reach the firmware, a guardian sends them for a host that is dead or stopped.
///
/// The logo is red while the device is not ready, green once it is, and also blue while the motors push.
class FalconDriver final : public DeviceDriver {
 public:
  /// `link` leads to running firmware; `info` is a completed falcon_info(). Runs the first rounds, after which a homed
  /// Falcon is ready.
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
  std::unique_ptr<FalconLink> link_;  ///< null once released
  ZeroForce farewell_ = ZeroForce::failed;
  FalconDialogue dialogue_;
  std::optional<Guardian> guardian_;  ///< only if another process can reach the firmware
  FalconTracker tracker_;
  FalconEncoderWatch watch_;
  FalconTracker::Verdict verdict_ = FalconTracker::Verdict::unhomed;
  Vec3 position_ = Vec3::Zero();  ///< last believed p_WT [m]
};

DeviceBackend falcon_backend();  ///< defined in backend.cpp

}  // namespace haptrace
