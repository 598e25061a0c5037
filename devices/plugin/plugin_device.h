// Devices in the user's own shared libraries (devices/plugin.h).
#pragma once

#include "devices/plugin.h"
#include "devices/registry.h"
#include "devices/vendor/shared_library.h"

#include <array>
#include <atomic>
#include <memory>
#include <string>

namespace haptrace {

/// A loaded plug-in with an open device. Passes positions and forces on as they are: the loop checks them. If the
/// plug-in throws, the device is lost. If it crashes or ends the process, the message names the plug-in (ForeignCall).
///
/// Real-time: if the plug-in's exchange is.
class PluginDevice final : public Device {
 public:
  /// Loads the library and opens its device. `options` is a JSON object as text. Throws Error(device) if the library
  /// cannot be loaded, lacks a symbol, has another ABI version, refuses to open, or describes itself with invalid
  /// values.
  PluginDevice(const std::string& library, const std::string& options, const std::string& name,
               SharedLibrary::Symbols symbols = SharedLibrary::Symbols::local);
  ~PluginDevice() override;

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override;
  void close() noexcept override;
  /// Returns `confirmed` if the plug-in has taken zero force since any other force; this relies on the plug-in's
  /// result.
  [[nodiscard]] ZeroForce zero_force() noexcept override;
  [[nodiscard]] ZeroForce emergency_stop() noexcept override;
  [[nodiscard]] std::string lost_reason() const override;

 private:
  void remember_thrown(const char* what) noexcept;

  std::shared_ptr<SharedLibrary> library_;  ///< shared with a close() that may not return
  std::string words_;                       ///< name of the plug-in in messages about a crash
  DeviceInfo info_;
  void* device_ = nullptr;
  decltype(&haptrace_plugin_exchange) exchange_ = nullptr;
  decltype(&haptrace_plugin_sample) sample_ = nullptr;  ///< null: not exported
  decltype(&haptrace_plugin_stop) stop_ = nullptr;      ///< null: not exported
  decltype(&haptrace_plugin_close) close_ = nullptr;
  std::atomic<ZeroForce> zero_{ZeroForce::confirmed};  ///< there is no force before the first exchange
  int failure_ = 0;                                    ///< result of the exchange that lost the device
  std::array<char, 256> thrown_{};                     ///< text of the exception that lost the device
};

/// Returns the backend `plugin`, with the options path, global and options.
DeviceBackend plugin_backend();

}  // namespace haptrace
