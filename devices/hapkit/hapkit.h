// Driver of Hapkit-class devices with one axis, on a board with the sketch of samples/hapkit.
#pragma once

#include "devices/hapkit/calibration.h"
#include "devices/loop/threaded_device.h"
#include "devices/registry.h"
#include "devices/serial/serial_port.h"

#include <memory>
#include <optional>
#include <string>

namespace haptrace {

struct HapkitOptions {
  std::string name = "hapkit";
  std::string port;
  std::string serial;
  double greeting_patience = 4;  ///< duration of the greetings [s]; boot loaders take up to 2 s
};

/// Sends a command and waits for the state with the same sequence number; skips damaged and late packets. The board
/// switches its motor off by itself if no commands come. A board that has restarted counts from another position, so
/// the device is then lost.
class HapkitDriver final : public DeviceDriver {
 public:
  /// Greets the board until it answers, because opening a port restarts many boards. `company` is released after the
  /// device. Throws Error(device) if there is no answer, or one of another version.
  HapkitDriver(const HapkitCalibration& calibration, const HapkitOptions& options,
               std::shared_ptr<void> company = nullptr);
  ~HapkitDriver() override;

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  [[nodiscard]] bool round(const Wrench& wrench, DeviceState& state) override;
  ZeroForce release() noexcept override;

 private:
  struct Line;

  void greet(double patience);

  std::shared_ptr<void> company_;
  HapkitCalibration calibration_;
  DeviceInfo info_;
  SerialPort port_;
  std::unique_ptr<Line> line_;
  int silences_ = 0;  ///< consecutive rounds without an answer
  std::optional<ZeroForce> released_;
};

/// Returns the backend `hapkit`, with the options port, calibration and emulated.
DeviceBackend hapkit_backend();

}  // namespace haptrace
