// haptrace devices --test: does a device keep its laws?
#pragma once

#include "cli/verb.h"

#include <memory>
#include <string>

namespace haptrace::cli {

/// --test and what belongs to it, as options of the verb devices.
class DeviceCheck {
 public:
  explicit DeviceCheck(CLI::App& devices);

  [[nodiscard]] bool wanted() const;
  /// Exit code 0 when every law that was tested is kept, 1 when one is broken.
  [[nodiscard]] int run(const std::string& device, const Output& output) const;

 private:
  struct Arguments;
  std::shared_ptr<Arguments> arguments_;
};

}  // namespace haptrace::cli
