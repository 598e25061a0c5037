// Tools to test the laws of devices: a device that records its exchanges, and the test forces.
#pragma once

#include "base/histogram.h"
#include "control/controller.h"
#include "devices/device.h"
#include "devices/loop/tick_pulse.h"

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <span>
#include <vector>

namespace haptrace {

/// One exchange of a session.
struct Exchanged {
  double time = 0;            ///< time of the session, the sum of all dt [s]
  double dt = 0;              ///< [s]
  std::int64_t taken_ns = 0;  ///< time at which its state was taken, on the monotonic clock
  Vec3 force = Vec3::Zero();  ///< force that was sent [N]
  DeviceState state;
};

/// Forwards every call to a device and records the exchanges.
///
/// Real-time: exchange, if the device's own is.
class ObservedDevice final : public Device {
 public:
  explicit ObservedDevice(std::unique_ptr<Device> device) : device_(std::move(device)) {}

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return device_->info(); }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override;
  void between_ticks(bool may_wait) noexcept override { device_->between_ticks(may_wait); }
  void close() noexcept override { device_->close(); }
  [[nodiscard]] ZeroForce zero_force() noexcept override { return device_->zero_force(); }
  [[nodiscard]] ZeroForce emergency_stop() noexcept override { return device_->emergency_stop(); }
  [[nodiscard]] std::string lost_reason() const override { return device_->lost_reason(); }
  [[nodiscard]] std::string not_ready_reason() const override { return device_->not_ready_reason(); }

  /// Prepares a session: discards the previous one and reserves room for `exchanges`. Exchanges beyond that are not
  /// kept.
  void observe(std::size_t exchanges);
  /// Returns the exchanges of this session, from its first tick on.
  [[nodiscard]] const std::vector<Exchanged>& rows() const noexcept { return rows_; }
  /// Returns the durations of the exchanges of all sessions, on the monotonic clock.
  [[nodiscard]] const DurationHistogram& exchange_time() const noexcept { return exchange_time_; }

  /// Returns the pulse of all exchanges, within sessions and outside.
  [[nodiscard]] const TickPulse& pulse() const noexcept { return pulse_; }

  /// While set, replaces every wrench with NaN, except for the zero force that ends a session.
  void spoil(bool spoilt) noexcept { spoilt_ = spoilt; }

 private:
  std::unique_ptr<Device> device_;
  std::vector<Exchanged> rows_;
  double time_ = 0;
  DurationHistogram exchange_time_;
  TickPulse pulse_;
  bool spoilt_ = false;
};

/// Sends no force for a while; from `spoil_at` on, sends NaN for 20 ms.
class RestController final : public Controller {
 public:
  static constexpr double kSpoilt = 0.02;  ///< [s]

  explicit RestController(double duration) : duration_(duration) {}
  RestController(double duration, double spoil_at, ObservedDevice& device)
      : duration_(duration), spoil_at_(spoil_at), device_(&device) {}

  [[nodiscard]] Command update(const State& state) noexcept override;

 private:
  double duration_, spoil_at_ = 0;  ///< [s]
  ObservedDevice* device_ = nullptr;
};

/// Sends a force with a limited rate of change. Ends if the handle is too far from its start or outside its workspace.
class ProbeController : public Controller {
 public:
  static constexpr double kTooFar = 0.02;  ///< [m]
  static constexpr double kLead = 0.1;     ///< time without force before and after each force [s]

  /// The force reaches `max_force` [N] in 20 ms at the fastest.
  ProbeController(const DeviceInfo& device, double max_force)
      : max_force_(max_force), workspace_min_(device.workspace_min), workspace_max_(device.workspace_max) {}

  void start(const State& first) noexcept override { start_ = first.position; }
  [[nodiscard]] Command update(const State& state) noexcept final;

  [[nodiscard]] bool went_too_far() const noexcept { return too_far_; }
  [[nodiscard]] double farthest() const noexcept { return farthest_; }  ///< from the start [m]

 protected:
  /// Returns the wanted force [N], or nothing at the end.
  virtual std::optional<Vec3> wanted(const State& state) noexcept = 0;

  const double max_force_;
  Vec3 start_ = Vec3::Zero();

 private:
  Vec3 workspace_min_, workspace_max_;
  bool too_far_ = false;
  double farthest_ = 0;
  Vec3 force_ = Vec3::Zero();
};

/// A force that grew until the handle had moved by kReach, or until its time limit. Times are the session's [s].
struct Stroke {
  double begin = 0;          ///< start of the force
  double moves = kNaN;       ///< start of the motion, estimated from when it was first visible
  double turned = kNaN;      ///< reversal of the force
  double stopped = kNaN;     ///< end of the reversed force
  Vec3 path = Vec3::Zero();  ///< from the start to the reversal [m]
  bool reached = false;
};

/// Pushes back and forth along one axis. Each force grows linearly from zero. Once the handle has moved by kReach, the
/// force since the start of the motion is repeated against the motion, mirrored in time, which stops a mass. The force
/// ends earlier if friction stops the handle earlier. No force follows the motion, so a device whose forces have the
/// wrong sign cannot become unstable.
class PushController final : public ProbeController {
 public:
  static constexpr double kReach = 0.002;  ///< [m]

  /// `least_motion` [m] is the smallest motion that is not noise.
  PushController(const DeviceInfo& device, int axis, double max_force, double least_motion)
      : ProbeController(device, max_force),
        axis_(axis),
        growth_(std::min(max_force / kGrowth, kFastestGrowth)),
        least_motion_(least_motion) {}

  [[nodiscard]] const std::array<Stroke, 2>& strokes() const noexcept { return strokes_; }
  /// Returns the rate at which forces grow [N/s].
  [[nodiscard]] double growth() const noexcept { return growth_; }
  /// Returns the longest duration [s].
  [[nodiscard]] double duration() const noexcept { return kLead + 2 * (2 * longest() + kLead); }

 private:
  enum class Stage : std::uint8_t { rest, grow, brake };
  static constexpr double kGrowth = 0.25;      ///< [s]
  static constexpr double kFastestGrowth = 4;  ///< [N/s]
  static constexpr double kHold = 0.1;         ///< longest time at the largest force [s]

  std::optional<Vec3> wanted(const State& state) noexcept override;
  [[nodiscard]] double longest() const noexcept { return max_force_ / growth_ + kHold; }
  [[nodiscard]] double grown(double time) const noexcept { return std::clamp(growth_ * time, 0.0, max_force_); }
  [[nodiscard]] double onset(double way, double now) const noexcept;
  void turn(const Vec3& path, double now) noexcept;

  int axis_;
  double growth_, least_motion_;
  std::array<Stroke, 2> strokes_;
  std::size_t stroke_ = 0;
  Stage stage_ = Stage::rest;
  double since_ = 0;
  double seen_at_ = kNaN, seen_ = 0;  ///< time and distance at which a motion was first visible [s, m]
  Vec3 from_ = Vec3::Zero();
};

/// Sends a constant force for a given time or until the handle has moved by kFar. Then reverses the force until the
/// handle stops, for at most the same time. Can pause the host for the whole given time while the force acts.
class HoldController final : public ProbeController {
 public:
  /// Many times as long as a watchdog may take. If the watchdog cut the force, a handle that a hand damps comes to rest
  /// long before.
  static constexpr double kLongest = 0.2;  ///< [s]
  static constexpr double kFar = 0.005;    ///< [m]
  enum class Host : std::uint8_t { goes_on, pauses };

  HoldController(const DeviceInfo& device, const Vec3& force, double seconds, Host host)
      : ProbeController(device, force.norm()), hold_(force), seconds_(seconds), host_(host) {}
  void between_ticks(bool may_wait) noexcept override;

  /// Return the handle's path along the force while the force was held [m], and that time [s]; NaN if the hold was not
  /// completed.
  [[nodiscard]] double path() const noexcept { return path_; }
  [[nodiscard]] double held() const noexcept { return turned_ - full_since_; }

 private:
  std::optional<Vec3> wanted(const State& state) noexcept override;

  Vec3 hold_;
  double seconds_;
  Host host_;
  /// Times of the full force, of its reversal and of the handle's stop [s].
  double full_since_ = kNaN, turned_ = kNaN, stopped_ = kNaN;
  Vec3 from_ = Vec3::Zero();
  double path_ = kNaN;
};

/// Pulls the handle to its start with a soft, damped spring.
class SpringController final : public ProbeController {
 public:
  SpringController(const DeviceInfo& device, double max_force, double duration)
      : ProbeController(device, max_force), duration_(duration) {}

 private:
  static constexpr double kStiffness = 100;  ///< [N/m]
  static constexpr double kDamping = 2;      ///< [N s/m]
  std::optional<Vec3> wanted(const State& state) noexcept override;

  double duration_;
};

/// Returns the effect of the force without the handle's own motion: half the difference between both strokes [m].
Vec3 response(const std::array<Stroke, 2>& strokes) noexcept;

/// Returns the delay from sending a force to seeing its effect in the answers [s]; NaN if the rows do not show it.
///
/// Fits the position along `axis` around a reversal of the force by least squares with a line, a parabola (friction)
/// and the double integral of the sent force. The result is the delay of that force with the best fit.
double latency_of(std::span<const Exchanged> rows, const Stroke& stroke, int axis, bool virtual_time);

/// The smallest distance between different positions of successive rows [m] (0: none), and the number of such pairs.
struct SmallestStep {
  double distance = 0;
  std::size_t steps = 0;
  void add(std::span<const Exchanged> rows) noexcept;
};

/// Returns the RMS per axis of the noise, without motion, from second differences [m].
double noise_of(std::span<const Exchanged> rows) noexcept;

}  // namespace haptrace
