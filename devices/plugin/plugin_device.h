// Devices that a lab brings along in a shared library (devices/plugin.h).
#pragma once

#include "devices/plugin.h"
#include "devices/registry.h"
#include "devices/vendor/shared_library.h"

#include <array>
#include <atomic>
#include <memory>
#include <string>

namespace haptrace {

/// A loaded plug-in with its device open. Passes positions and forces on as they are: judging them is the loop's part.
/// What it throws is the device's loss; what it does to the process is said with its name (ForeignCall).
///
/// Real-time: as far as the plug-in's own exchange is.
class PluginDevice final : public Device {
 public:
  /// `options` is a JSON object as text. Throws Error(device): the library cannot be loaded, lacks a symbol, speaks
  /// another ABI, refuses to open, or describes itself impossibly.
  PluginDevice(const std::string& library, const std::string& options, const std::string& name,
               SharedLibrary::Symbols symbols = SharedLibrary::Symbols::local);
  ~PluginDevice() override;

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override;
  void close() noexcept override;
  /// Confirmed when the last exchange that took a force took zero: the plug-in's word.
  [[nodiscard]] ZeroForce zero_force() noexcept override;
  [[nodiscard]] ZeroForce emergency_stop() noexcept override;
  [[nodiscard]] std::string lost_reason() const override;

 private:
  void remember_thrown(const char* what) noexcept;

  std::shared_ptr<SharedLibrary> library_;  ///< shared with a close that does not return
  std::string words_;                       ///< for a crash in it
  DeviceInfo info_;
  void* device_ = nullptr;
  decltype(&haptrace_plugin_exchange) exchange_ = nullptr;
  decltype(&haptrace_plugin_sample) sample_ = nullptr;  ///< null: it does not say
  decltype(&haptrace_plugin_stop) stop_ = nullptr;      ///< null: it cannot
  decltype(&haptrace_plugin_close) close_ = nullptr;
  std::atomic<ZeroForce> zero_{ZeroForce::confirmed};  ///< no force before there was an exchange
  int failure_ = 0;                                    ///< what exchange returned when the device was lost
  std::array<char, 256> thrown_{};                     ///< what it threw, instead
};

/// `plugin`, with the options path and options.
DeviceBackend plugin_backend();

}  // namespace haptrace
