// Hapkit-class devices of one axis, on a board with the sketch of samples/hapkit.
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
  double greeting_patience = 4;  ///< boot loaders take up to two [s]
};

/// A command goes out, the state with its number comes back; what is damaged or late is passed over. The board switches
/// its motor off by itself when nobody talks to it. One that started anew counts from elsewhere, and is lost.
class HapkitDriver final : public DeviceDriver {
 public:
  /// Greets the board until it answers: opening a port starts many boards anew. `company` is let go of after the
  /// device. Throws Error(device): there is no answer, or one of another version.
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
  int silences_ = 0;  ///< in a row
  std::optional<ZeroForce> released_;
};

/// `hapkit`, with the options port, calibration and emulated.
DeviceBackend hapkit_backend();

}  // namespace haptrace
