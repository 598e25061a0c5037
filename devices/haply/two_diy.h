// The Haply 2DIY and its kin: planar devices of two motors on a board that speaks hAPI's serial protocol.
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
  bool homed = false;  ///< the arms are in their stops while it is opened
};

/// Asks the board once a round, and believes an answer only when it is whole and the arms can have come there.
///
/// The board keeps its last torques for ever, so zero ones are the last on every way out; a guardian process sends them
/// when this one dies or is stopped. Without an answer that makes sense the board is calmed first: zero torques in
/// bytes that leave an intact board its encoders. If it still answers nonsense it was reset, and is set up anew. What
/// its encoders say is then counted from anywhere: the device is not ready, and without force, until its arms were led
/// into their stops again (StopHoming).
class TwoDiyDriver final : public DeviceDriver {
 public:
  /// `company` is let go of after the device. Throws Error(device).
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
  /// The newest of answers that are all whole.
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
  std::size_t answer_bytes_ = 0;  ///< of this board's answers; 0: not known yet
  std::optional<Vec2> counted_;   ///< the arms as last believed [rad]
  std::int64_t counted_ns_ = 0;
  std::optional<PantographPose> pose_;  ///< of the arms, once they are homed
  Vec3 position_ = Vec3::Zero();        ///< last known [m]
  bool in_doubt_ = true;                ///< what comes next has to be calmed for
  int silences_ = 0;                    ///< in a row
  int nonsense_ = 0;                    ///< answers in a row that made no sense although the board was calm
  std::optional<ZeroForce> released_;
};

/// `haply2diy`, with the options port, generation, calibration, homed and emulated.
DeviceBackend two_diy_backend();

}  // namespace haptrace
