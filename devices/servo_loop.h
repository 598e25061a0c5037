// The one servo loop: recording, playback, guidance and programmes differ only in the controller plugged in.
//
//     device.exchange(force) -> State -> controller.update(State) -> Force -> limits -> device.exchange(force)
//                                  \-> Sample -> sinks
#pragma once

#include "control/controller.h"
#include "control/force_guard.h"
#include "control/histogram.h"
#include "control/limits.h"
#include "control/sample.h"
#include "control/velocity_estimator.h"
#include "devices/clock.h"
#include "devices/device.h"
#include "devices/realtime.h"

#include <atomic>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace haptrace {

inline constexpr double kLowestRate = 10;      // [Hz]
inline constexpr double kHighestRate = 20000;  // [Hz]

/// How a session is asked to stop from outside. May be raised in a signal handler.
class StopRequest {
 public:
  StopRequest() noexcept : StopRequest(nullptr) {}
  /// What is raised of `also` counts as well; it must outlive this.
  explicit StopRequest(const StopRequest* also) noexcept : also_(also) {}

  /// Once: the force fades out and the session ends. Twice: it ends at this tick.
  void raise() noexcept { count_.fetch_add(1, std::memory_order_relaxed); }
  [[nodiscard]] int count() const noexcept {
    return count_.load(std::memory_order_relaxed) + (also_ != nullptr ? also_->count() : 0);
  }

 private:
  const StopRequest* also_;
  std::atomic<int> count_{0};
  static_assert(std::atomic<int>::is_always_lock_free);
};

/// Why a session ended.
enum class StopCause {
  finished,          ///< the controller was done
  interrupted,       ///< StopRequest
  deviation,         ///< the tracking error passed its limit
  oscillation,       ///< the loop oscillated and softening it did not help
  no_path,           ///< the rest of the path could not be had
  velocity,          ///< the tool was faster than its limit, or its position jumped
  not_finite,        ///< the device's position or the controller's force was not a number
  device_not_ready,  ///< the device did not allow forces, or stopped allowing them
  device_lost,
};

const char* to_string(StopCause cause) noexcept;

/// What one session of the loop was like.
struct ServoReport {
  StopCause cause = StopCause::finished;
  std::string detail;           ///< what stopped it, in words; empty when finished
  std::uint64_t samples = 0;    ///< ticks that ran
  std::uint64_t missed = 0;     ///< ticks that did not, because one before them was late
  std::uint64_t overruns = 0;   ///< how many times that happened
  std::uint64_t returns = 0;    ///< how often the device was lost and found again
  double duration = 0;          ///< first to last sample, by the session's clock [s]
  double away = 0;              ///< how much of it the device was away [s]
  double asked_rate = 0;        ///< [Hz]
  double max_force = 0;         ///< largest magnitude sent [N]
  DurationHistogram latency;    ///< wake-up minus deadline
  DurationHistogram tick_time;  ///< wake-up to end of tick, on the monotonic clock whichever clock drives the loop
  RealtimeStatus realtime;
  VibrationSummary vibration;         ///< what ForceGuard saw and did
  std::vector<Sample> flight_record;  ///< the last 200 ms before a limit or a fault stopped it; empty otherwise

  /// Ticks per second of the session's clock, while the device was there [Hz].
  [[nodiscard]] double achieved_rate() const noexcept {
    return duration > away ? static_cast<double>(samples - 1) / (duration - away) : 0;
  }
  /// True when a limit or a fault ended the session, rather than its end or a request.
  [[nodiscard]] bool stopped_by_fault() const noexcept {
    return cause != StopCause::finished && cause != StopCause::interrupted;
  }
};

/// Drives one device with one controller at a fixed rate.
///
/// Every session, whatever its controller: positions and forces are checked to be finite, forces are limited in
/// magnitude and for long, the tool's speed is limited, a force that vibrates is softened and, if it stays, ends the
/// session (ForceGuard), forces fade in and fade out, and zero force is sent on every way out. Ticks that come too late
/// are missed and counted, never caught up with: a gap in tick and time, and an event.
///
/// A device that is away (Device::Status) may be waited for. Ticks and time go on, without rows: a position that was
/// not taken is not invented. It is sent zero force until it is back and ready; then the velocity is estimated anew,
/// the controller resumes, and forces fade in from zero. The motors are not credited with having cooled meanwhile:
/// nobody saw what force acted.
class ServoLoop {
 public:
  struct Options {
    double rate_hz = 1000;
    bool virtual_time = false;    ///< advance as fast as the machine allows; else the monotonic clock
    bool realtime = true;         ///< ask for a real-time thread (monotonic clock only)
    SafetyLimits limits;          ///< forces: never more than the device's own, which 0 takes
    bool watch_vibration = true;  ///< ForceGuard, for devices with a force limit; false: for experiments only
    double ready_timeout = 30;    ///< how long to wait for a device that is not ready yet [s]
    double away_timeout = 0;      ///< how long to wait for a device that is away [s]; 0: it is lost at once
    ServoClock* clock = nullptr;  ///< borrowed, in place of either; for those who study time itself
  };

  /// Throws Error(input) when an option is out of range, or when virtual time is asked of a device that lives in real
  /// time.
  static void validate(const DeviceInfo& device, const Options& options);

  /// Everything is borrowed and must outlive run(). Throws what validate throws.
  ServoLoop(Device& device, Controller& controller, VelocityEstimator& estimator, std::span<SampleSink* const> sinks,
            const Options& options);

  /// Runs one session in the calling thread until the controller is finished, `stop` is raised or a limit stops it.
  /// Sends zero force before it returns. Does not throw.
  ServoReport run(const StopRequest& stop) noexcept;

 private:
  class Session;

  [[nodiscard]] std::string not_ready_hint() const;  ///< the end of a sentence

  Device& device_;
  Controller& controller_;
  VelocityEstimator& estimator_;
  std::vector<SampleSink*> sinks_;
  Options options_;
};

}  // namespace haptrace
