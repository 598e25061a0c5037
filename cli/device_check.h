// haptrace devices --test: tests a device against the laws of devices.
#pragma once

#include "cli/verb.h"

#include <memory>
#include <string>

namespace haptrace::cli {

/// The option --test and its companions, as options of the verb devices.
class DeviceCheck {
 public:
  explicit DeviceCheck(CLI::App& devices);

  [[nodiscard]] bool wanted() const;
  /// Returns 0 if the device keeps every law that was tested, 1 if it breaks one, and kInterrupted if the test was
  /// stopped. Returns kNoDevice if the force could not be set to zero.
  [[nodiscard]] int run(const std::string& device, const Output& output) const;

 private:
  struct Arguments;
  std::shared_ptr<Arguments> arguments_;
};

}  // namespace haptrace::cli
