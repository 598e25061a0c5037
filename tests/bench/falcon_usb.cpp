// Duration of an exchange with a Falcon over USB, with an emulated chip at the other end (tests/bench/falcon_usb).
#include "control/velocity_estimator.h"
#include "devices/falcon/driver.h"
#include "devices/falcon/firmware.h"
#include "devices/falcon/usb_link.h"
#include "devices/loop/clock.h"
#include "devices/loop/servo_loop.h"
#include "tests/devices/falcon/usb_bus.h"

#include <algorithm>
#include <cstdlib>
#include <exception>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr double kRate = 1000;  // [Hz]

/// Forwards to a driver and records the duration of its rounds [s].
class RoundWatch final : public DeviceDriver {
 public:
  RoundWatch(std::unique_ptr<DeviceDriver> driver, std::vector<double>& rounds)
      : driver_(std::move(driver)), rounds_(rounds) {}
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return driver_->info(); }
  [[nodiscard]] bool round(const Wrench& wrench, DeviceState& state) override {
    const std::int64_t begin = monotonic_ns();
    const bool answered = driver_->round(wrench, state);
    if (rounds_.size() < rounds_.capacity()) rounds_.push_back(1e-9 * static_cast<double>(monotonic_ns() - begin));
    return answered;
  }
  ZeroForce release() noexcept override { return driver_->release(); }

 private:
  std::unique_ptr<DeviceDriver> driver_;
  std::vector<double>& rounds_;
};

/// Forwards to a device and records the age of its states [s].
class AgeWatch final : public Device {
 public:
  AgeWatch(Device& device, std::size_t ticks) : device_(device) { ages_.reserve(ticks); }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return device_.info(); }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
    const Status status = device_.exchange(wrench, dt, state);
    if (status == Status::ok && ages_.size() < ages_.capacity()) ages_.push_back(state.age);
    return status;
  }
  void close() noexcept override { device_.close(); }
  [[nodiscard]] std::string lost_reason() const override { return device_.lost_reason(); }

  [[nodiscard]] std::vector<double>& ages() { return ages_; }

 private:
  Device& device_;
  std::vector<double> ages_;
};

/// A weak spring to the origin.
class WeakSpring final : public Controller {
 public:
  explicit WeakSpring(std::uint64_t ticks) : ticks_(ticks) {}
  [[nodiscard]] Command update(const State& state) noexcept override {
    Command command;
    command.phase = Phase::run;
    command.wrench.force = -50 * state.position;
    if (state.tick >= ticks_) command.status = Command::Status::finished;
    return command;
  }

 private:
  std::uint64_t ticks_;
};

double quantile(std::vector<double>& values, double q) {
  const auto place = values.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), place, values.end());
  return *place;
}

void run(double seconds) {
  test::UsbBus bus;
  const DeviceSpec plant = DeviceSpec::parse("falcon:hand=relaxed");
  bus.plug_in(std::make_unique<EmulatedFalcon>(FalconCalibration(), open_live_plant(plant, "falcon"),
                                               EmulatedFalcon::Start::homed));
  const auto ticks = static_cast<std::uint64_t>(seconds * kRate);
  std::vector<double> rounds;
  rounds.reserve(2 * ticks + 10'000);
  const FalconCalibration calibration;
  auto link = start_falcon([] { return open_usb_falcon_link(choose_falcon_port(find_falcon_ports(), "", "")); }, {});
  auto driver = std::make_unique<FalconDriver>(std::move(link), calibration, falcon_info(calibration));
  const auto device = std::make_unique<ThreadedDevice>(std::make_unique<RoundWatch>(std::move(driver), rounds));
  AgeWatch watched(*device, ticks + 10'000);
  WeakSpring spring(ticks);
  const auto estimator = make_velocity_estimator("lowpass", kRate, device->info().position_resolution);

  const std::uint64_t packets = bus.falcon([](const EmulatedFalcon& falcon) { return falcon.packets(); });
  const ServoReport report = ServoLoop(watched, spring, *estimator, {}, {.rate_hz = kRate}).run(StopRequest());
  const std::uint64_t exchanged = bus.falcon([](const EmulatedFalcon& falcon) { return falcon.packets(); }) - packets;
  device->close();
  fmt::print("{}{}\n", to_string(report.cause), report.detail.empty() ? "" : ": " + report.detail);
  fmt::print("{} ticks in {:.1f} s, {} missed in {} overruns; {} packets received\n", report.samples, report.duration,
             report.missed, report.overruns, exchanged);
  fmt::print("round of the driver: median {:.0f} us, p99 {:.0f} us\n", 1e6 * quantile(rounds, 0.5),
             1e6 * quantile(rounds, 0.99));
  fmt::print("age of a state at its use: median {:.0f} us, p99 {:.0f} us\n", 1e6 * quantile(watched.ages(), 0.5),
             1e6 * quantile(watched.ages(), 0.99));
}

}  // namespace
}  // namespace haptrace

int main(int argc, char** argv) {
  try {
    haptrace::run(argc > 1 ? std::atof(argv[1]) : 60);
    return 0;
  } catch (const std::exception& error) {
    fmt::print(stderr, "falcon_usb: {}\n", error.what());
    return 1;
  }
}
