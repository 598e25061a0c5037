#include "devices/registry.h"
#include "devices/serial/emulated_line.h"
#include "devices/serial/serial_port.h"
#include "tests/devices/device_laws.h"
#include "tests/devices/guardian_laws.h"

#include <mutex>

namespace haptrace::test {
namespace {

/// Records the bytes that it receives.
class Listener final : public EmulatedBoard {
 public:
  void advance(std::int64_t) override {}
  void receive(std::uint8_t byte, std::vector<std::uint8_t>&) override {
    const std::scoped_lock lock(mutex_);
    heard_.push_back(byte);
  }
  void power_cycle() override {}

  [[nodiscard]] std::vector<std::uint8_t> heard() {
    const std::scoped_lock lock(mutex_);
    return heard_;
  }

 private:
  std::mutex mutex_;
  std::vector<std::uint8_t> heard_;
};

class SerialBench final : public GuardedBench {
 public:
  GuardedPort port() override { return {.descriptor = port_.descriptor()}; }
  std::vector<std::uint8_t> heard() override { return listener_->heard(); }

 private:
  Listener* listener_ = new Listener;
  EmulatedLine line_{std::unique_ptr<EmulatedBoard>(listener_)};
  SerialPort port_{line_.path(), 115200};
};

}  // namespace

std::vector<ListedPort> listed_ports() {
  return {{"serial", [] { return std::make_unique<SerialBench>(); }}};
}

std::vector<Listed> listed_devices() {
  const auto emulated = [](const std::string& spec) { return [spec] { return open_device(spec); }; };
  return {{"haply2diy", emulated("haply2diy:emulated=true"), true, true, false},
          {"haply2diy_held", emulated("haply2diy:emulated=true,hand=relaxed"), true, false, false},
          {"hapkit", emulated("hapkit:emulated=true"), true, true, false},
          {"hapkit_held", emulated("hapkit:emulated=true,hand=relaxed"), true, false, false}};
}

}  // namespace haptrace::test
