// Driver of the Haply 2DIY and similar devices: planar, with two motors on a board with hAPI's serial protocol.
#pragma once

#include "devices/guardian/guardian.h"
#include "devices/haply/calibration.h"
#include "devices/haply/homing.h"
#include "devices/haply/protocol.h"
#include "devices/loop/threaded_device.h"
#include "devices/registry.h"
#include "devices/serial/serial_port.h"

#include <memory>
#include <optional>
#include <string>

namespace haptrace {

struct TwoDiyOptions {
  std::string name = "haply2diy";
  std::string port;
  std::string serial;
  bool homed = false;  ///< the arms are in their stops while the device is opened
};

/// Asks the board once per round. Believes an answer only if it is complete and the arms can have moved there.
///
/// The board keeps its last torques for ever, so the driver always sends zero torques last; a guardian process sends
/// them if this process dies or is stopped. After a missing or implausible answer the driver first calms the board: it
/// sends zero torques in bytes that leave an intact board its encoders. If the answers are still implausible, the board
/// was reset, and the driver sets it up again. The encoders then count from an unknown position: the device is not
/// ready, and has no force, until the user moves the arms into their stops again (StopHoming).
class TwoDiyDriver final : public DeviceDriver {
 public:
  /// `company` is released after the device. Throws Error(device).
  TwoDiyDriver(const TwoDiyCalibration& calibration, const TwoDiyOptions& options,
               std::shared_ptr<void> company = nullptr);
  ~TwoDiyDriver() override { (void)release(); }

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  [[nodiscard]] bool round(const Wrench& wrench, DeviceState& state) override;
  ZeroForce release() noexcept override;
  [[nodiscard]] ZeroForce emergency_stop() noexcept override;

 private:
  [[nodiscard]] std::optional<Vec2> ask(const Vec2& torques);
  [[nodiscard]] std::optional<Vec2> calm();
  /// Returns the newest of `answers` if all are complete.
  [[nodiscard]] std::optional<Vec2> newest_of(std::span<const std::uint8_t> answers);
  void restart();
  [[nodiscard]] bool is_plausible(const Vec2& counted, std::int64_t now_ns) const noexcept;
  void believe(const Vec2& counted, std::int64_t now_ns);

  std::shared_ptr<void> company_;
  TwoDiyCalibration calibration_;
  PantographKinematics kinematics_;
  DeviceInfo info_;
  SerialPort port_;
  std::optional<Guardian> guardian_;

  StopHoming homing_;
  std::size_t answer_bytes_ = 0;  ///< length of this board's answers; 0: not known yet
  std::optional<Vec2> counted_;   ///< last believed counted angles [rad]
  std::int64_t counted_ns_ = 0;
  std::optional<PantographPose> pose_;  ///< pose of the arms, once homed
  Vec3 position_ = Vec3::Zero();        ///< last known [m]
  bool in_doubt_ = true;                ///< the board must be calmed first
  int silences_ = 0;                    ///< consecutive calms without an answer
  int nonsense_ = 0;                    ///< consecutive implausible answers although the board was calmed
  std::optional<ZeroForce> released_;
};

/// Returns the backend `haply2diy`, with the options port, generation, calibration, homed and emulated.
DeviceBackend two_diy_backend();

}  // namespace haptrace
