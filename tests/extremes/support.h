// Common parts of the rows, the tests of extremes.
#pragma once

#include "control/design/tracking_design.h"
#include "control/path/shapes.h"
#include "control/velocity_estimator.h"
#include "devices/loop/servo_loop.h"
#include "devices/sim/noise.h"
#include "devices/sim/presets.h"
#include "devices/sim/sim_device.h"
#include "player/playback/playback_controller.h"
#include "tests/support/errors.h"
#include "tests/support/point_mass.h"
#include "tests/support/scripted.h"

#include <functional>
#include <gtest/gtest.h>
#include <string>

namespace haptrace::test {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Wraps a device and checks every force: it must be finite and within the device's limit, and the last one zero.
class Watched final : public Device {
 public:
  /// Changes a state; exchanges are counted from 0.
  using Disturb = std::function<void(std::uint64_t exchange, DeviceState&)>;

  explicit Watched(Device& device, Disturb disturb = {}) : device_(device), disturb_(std::move(disturb)) {}

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return device_.info(); }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
    last_ = wrench;
    finite_ = finite_ && is_finite(wrench.force) && is_finite(wrench.torque);
    largest_ = std::max(largest_, wrench.force.stableNorm());
    const Status status = device_.exchange(wrench, dt, state);
    if (disturb_) disturb_(count_, state);
    ++count_;
    return status;
  }
  void close() noexcept override { device_.close(); }

  /// Checks the forces after a session, whatever ended it.
  void expect_safe() const {
    EXPECT_TRUE(finite_);
    EXPECT_LE(largest_, info().max_force * (1 + 1e-12));
    EXPECT_TRUE(last_.force.isZero(0) && last_.torque.isZero(0));
  }
  [[nodiscard]] std::uint64_t count() const { return count_; }

 private:
  Device& device_;
  Disturb disturb_;
  Wrench last_;
  bool finite_ = true;
  double largest_ = 0;
  std::uint64_t count_ = 0;
};

/// Runs one session in virtual time and expects safe forces and finite rows.
inline ServoReport run(Watched& device, Controller& controller, Log& log, ServoOptions options = {},
                       const std::string& estimator = "lowpass") {
  options.virtual_time = true;
  const auto velocity = make_velocity_estimator(estimator, options.rate_hz, device.info().position_resolution);
  SampleSink* const sinks[] = {&log};
  ServoLoop loop(device, controller, *velocity, sinks, options);
  const StopRequest never;
  ServoReport report = loop.run(never);
  device.expect_safe();
  for (const Sample& row : log.samples)
    if (!is_finite(row.position) || !is_finite(row.velocity) || !is_finite(row.force)) {
      ADD_FAILURE() << "row of tick " << row.tick << " is not finite";
      break;
    }
  return report;
}

inline SimSpec sim_spec(const std::string& json) {
  return read_sim_spec(nlohmann::json::parse(json), "test");
}

inline Path circle(double size = 0.06, double duration = 1) {
  return make_shape("circle", {.size = size, .duration = duration});
}

template <class... Terms>
ForceTerms terms_of(std::unique_ptr<Terms>... terms) {
  ForceTerms sum;
  (sum.push_back(std::move(terms)), ...);
  return sum;
}

/// Returns the distance of the tool from the reference in the last row of `phase` [m]; NaN if there is no such row.
inline double error_at_the_end_of(const Log& log, Phase phase) {
  double error = kNaN;
  for (const Sample& row : log.samples)
    if (row.phase == phase) error = (row.position - row.reference_position).norm();
  return error;
}

}  // namespace haptrace::test
