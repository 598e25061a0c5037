// What the laws of devices are tried with: a device that is watched, and the forces that are tried on it.
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
  double time = 0;            ///< of the session, the sum of all dt [s]
  double dt = 0;              ///< [s]
  std::int64_t taken_ns = 0;  ///< when its state was taken, on the monotonic clock
  Vec3 force = Vec3::Zero();  ///< that was sent [N]
  DeviceState state;
};

/// Passes everything on and remembers it.
///
/// Real-time: exchange as far as the device's own is.
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

  /// Before a session: forgets the one before and has room for `exchanges`; what comes beyond is not kept.
  void observe(std::size_t exchanges);
  /// Of this session, from its first tick on.
  [[nodiscard]] const std::vector<Exchanged>& rows() const noexcept { return rows_; }
  /// Of all sessions, on the monotonic clock.
  [[nodiscard]] const DurationHistogram& exchange_time() const noexcept { return exchange_time_; }

  /// Of its exchanges, in sessions and without.
  [[nodiscard]] const TickPulse& pulse() const noexcept { return pulse_; }

  /// While it is, every wrench that is sent is not a number, except for the zero that ends a session.
  void spoil(bool spoilt) noexcept { spoilt_ = spoilt; }

 private:
  std::unique_ptr<Device> device_;
  std::vector<Exchanged> rows_;
  double time_ = 0;
  DurationHistogram exchange_time_;
  TickPulse pulse_;
  bool spoilt_ = false;
};

/// No force for a while. From `spoil_at` on, for 20 ms, none that is a number.
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

/// A force that changes no faster than its limit, and ends when the handle is too far from where it was, or outside its
/// workspace.
class ProbeController : public Controller {
 public:
  static constexpr double kTooFar = 0.02;  ///< [m]
  static constexpr double kLead = 0.1;     ///< without force, before and after each [s]

  /// `max_force` [N] is reached in 20 ms at the fastest.
  ProbeController(const DeviceInfo& device, double max_force)
      : max_force_(max_force), workspace_min_(device.workspace_min), workspace_max_(device.workspace_max) {}

  void start(const State& first) noexcept override { start_ = first.position; }
  [[nodiscard]] Command update(const State& state) noexcept final;

  [[nodiscard]] bool went_too_far() const noexcept { return too_far_; }
  [[nodiscard]] double farthest() const noexcept { return farthest_; }  ///< from the start [m]

 protected:
  /// The force that is wanted [N], or nothing when all is done.
  virtual std::optional<Vec3> wanted(const State& state) noexcept = 0;

  const double max_force_;
  Vec3 start_ = Vec3::Zero();

 private:
  Vec3 workspace_min_, workspace_max_;
  bool too_far_ = false;
  double farthest_ = 0;
  Vec3 force_ = Vec3::Zero();
};

/// A force that grew until the handle had moved by kReach, or could not grow on. Times are the session's [s].
struct Stroke {
  double begin = 0;          ///< of the force
  double moves = kNaN;       ///< when motion began, as told from when it showed
  double turned = kNaN;      ///< when the force was turned round
  double stopped = kNaN;     ///< when that had stopped the motion, or should have
  Vec3 path = Vec3::Zero();  ///< from the beginning to the turn [m]
  bool reached = false;
};

/// Pushes forth and back along one axis. Each force grows linearly from nothing. Once the handle is kReach away, what
/// was done since it began to move is done against it, mirrored in time, which stops a mass; it ends when the handle
/// stops before that, as friction makes it. No force follows the motion, so nothing becomes unstable when the device's
/// forces have the wrong sign.
class PushController final : public ProbeController {
 public:
  static constexpr double kReach = 0.002;  ///< [m]

  /// `least_motion` [m] is what cannot be noise.
  PushController(const DeviceInfo& device, int axis, double max_force, double least_motion)
      : ProbeController(device, max_force),
        axis_(axis),
        growth_(std::min(max_force / kGrowth, kFastestGrowth)),
        least_motion_(least_motion) {}

  [[nodiscard]] const std::array<Stroke, 2>& strokes() const noexcept { return strokes_; }
  /// How fast forces grow [N/s].
  [[nodiscard]] double growth() const noexcept { return growth_; }
  /// At most [s].
  [[nodiscard]] double duration() const noexcept { return kLead + 2 * (2 * longest() + kLead); }

 private:
  enum class Stage : std::uint8_t { rest, grow, brake };
  static constexpr double kGrowth = 0.25;      ///< [s]
  static constexpr double kFastestGrowth = 4;  ///< [N/s]
  static constexpr double kHold = 0.1;         ///< at the largest force [s]

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
  double seen_at_ = kNaN, seen_ = 0;  ///< when a motion first showed, and how far it was [s, m]
  Vec3 from_ = Vec3::Zero();
};

/// A constant force for as long as told, or until the handle has gone kFar, and then the force against it until the
/// handle stops, for at most as long. May pause the host while the force acts, for all the time that it is told.
class HoldController final : public ProbeController {
 public:
  /// Many times as long as a watchdog may take: what was moving when it let go, in a hand that damps, has come to rest
  /// long before.
  static constexpr double kLongest = 0.2;  ///< [s]
  static constexpr double kFar = 0.005;    ///< [m]
  enum class Host : std::uint8_t { goes_on, pauses };

  HoldController(const DeviceInfo& device, const Vec3& force, double seconds, Host host)
      : ProbeController(device, force.norm()), hold_(force), seconds_(seconds), host_(host) {}
  void between_ticks(bool may_wait) noexcept override;

  /// How far the handle went along the force while it was held [m], and how long that was [s]; NaN when it did not come
  /// so far.
  [[nodiscard]] double path() const noexcept { return path_; }
  [[nodiscard]] double held() const noexcept { return turned_ - full_since_; }

 private:
  std::optional<Vec3> wanted(const State& state) noexcept override;

  Vec3 hold_;
  double seconds_;
  Host host_;
  /// When the whole force was there, when it was turned round and when the handle stood still [s].
  double full_since_ = kNaN, turned_ = kNaN, stopped_ = kNaN;
  Vec3 from_ = Vec3::Zero();
  double path_ = kNaN;
};

/// A soft spring to where the handle was, with some damping.
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

/// What a stroke does to the handle beyond what it does by itself: half of what differs between forth and back [m].
Vec3 response(const std::array<Stroke, 2>& strokes) noexcept;

/// How long it takes from sending a force to seeing it in the answers [s], NaN when the rows do not tell.
///
/// The position along `axis` round a turn of the force is fitted by least squares with a line, a parabola (friction)
/// and the double integral of the force that was sent, delayed by the delay for which it fits best.
double latency_of(std::span<const Exchanged> rows, const Stroke& stroke, int axis, bool virtual_time);

/// The smallest distance between positions of successive rows that differ [m], 0 when there is none; and how many do.
struct SmallestStep {
  double distance = 0;
  std::size_t steps = 0;
  void add(std::span<const Exchanged> rows) noexcept;
};

/// RMS per axis of what is left when motion is taken away, by second differences [m].
double noise_of(std::span<const Exchanged> rows) noexcept;

}  // namespace haptrace
