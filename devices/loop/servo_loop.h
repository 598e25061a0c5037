// The one servo loop: recording, playback, guidance and programmes differ only in the controller plugged in.
//
//     device.exchange(force) -> State -> controller.update(State) -> Force -> limits -> device.exchange(force)
//                                  \-> Sample -> sinks
#pragma once

#include "base/histogram.h"
#include "base/stop_request.h"
#include "control/controller.h"
#include "control/force_guard.h"
#include "control/limits.h"
#include "control/sample.h"
#include "control/velocity_estimator.h"
#include "devices/device.h"
#include "devices/loop/clock.h"
#include "devices/loop/realtime.h"
#include "devices/loop/tick_pulse.h"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace haptrace {

inline constexpr double kLowestRate = 10;      // [Hz]
inline constexpr double kHighestRate = 20000;  // [Hz]

/// Why a session ended.
enum class StopCause {
  finished,           ///< the controller was done
  interrupted,        ///< StopRequest
  deviation,          ///< the tracking error passed its limit
  resistance,         ///< the hand resisted more than the force limits allow, for longer than the controller bears
  oscillation,        ///< the loop oscillated and softening it did not help
  no_path,            ///< the rest of the path could not be had
  velocity,           ///< the tool was faster than its limit, or its position jumped
  not_finite,         ///< the device's position or the controller's force was not a number
  outside_workspace,  ///< the device stated a position that no hand can reach
  device_not_ready,   ///< the device did not allow forces, or stopped allowing them
  device_lost,
};

const char* to_string(StopCause cause) noexcept;

/// What one session of the loop was like.
struct ServoReport {
  StopCause cause = StopCause::finished;
  std::string detail;           ///< what stopped it, in words; empty when finished
  std::uint64_t samples = 0;    ///< fresh states that the controller answered: the rows of a recording
  std::uint64_t stale = 0;      ///< ticks at which the device had no new state; they are no samples
  std::uint64_t gaps = 0;       ///< how often there was no fresh state for longer than stale_after_ns()
  std::uint64_t missed = 0;     ///< ticks that did not, because one before them was late
  std::uint64_t overruns = 0;   ///< how many times that happened
  std::uint64_t returns = 0;    ///< how often the device was lost and found again
  double duration = 0;          ///< first to last sample, by the session's clock [s]
  double away = 0;              ///< how much of it the device was away, or gaps [s]
  double asked_rate = 0;        ///< [Hz]
  double max_force = 0;         ///< largest magnitude sent [N]
  DurationHistogram latency;    ///< wake-up minus deadline
  DurationHistogram tick_time;  ///< wake-up to end of tick, on the monotonic clock whichever clock drives the loop
  RealtimeStatus realtime;
  VibrationSummary vibration;         ///< what ForceGuard saw and did
  std::vector<Sample> flight_record;  ///< the last 200 ms before a limit or a fault stopped it; empty otherwise

  /// Fresh states per second of the session's clock, while the device was there [Hz].
  [[nodiscard]] double achieved_rate() const noexcept { return rate_of(samples); }
  /// Exchanges per second in the same time, with a new state or without [Hz].
  [[nodiscard]] double exchange_rate() const noexcept { return rate_of(samples + stale); }
  /// True when the device delivers fewer new states than the loop asks for: below 0.9 of the exchanges.
  [[nodiscard]] bool lacks_states() const noexcept { return samples > 0 && stale > (samples + stale) / 10; }
  /// True when a limit or a fault ended the session, rather than its end or a request.
  [[nodiscard]] bool stopped_by_fault() const noexcept {
    return cause != StopCause::finished && cause != StopCause::interrupted;
  }

 private:
  [[nodiscard]] double rate_of(std::uint64_t count) const noexcept {
    return duration > away && count > 0 ? static_cast<double>(count - 1) / (duration - away) : 0;
  }
};

/// The age from which a state counts as none [ns]: 20 ms, or three periods where they are longer, at most 1 s.
[[nodiscard]] std::int64_t stale_after_ns(double rate_hz) noexcept;

/// Drives one device with one controller at a fixed rate.
///
/// Every session, whatever its controller: positions and forces are checked to be finite, forces are limited in
/// magnitude and for long, the tool's speed is limited, a force that vibrates is softened and, if it stays, ends the
/// session (ForceGuard), forces fade in and fade out, and zero force is sent on every way out. The limit for long is
/// the device's, or a cautious one (kCautiousShare) where neither the device nor the session states any; it counts the
/// time for which forces really acted. Where a hand resists more than it allows, the session ends after
/// Command::patience. Ticks that come too late are missed and counted, never caught up with: a gap in tick and time,
/// and an event.
///
/// A state that the device only repeats (DeviceState::sequence) is no sample: no row, no velocity, and the controller
/// is not asked; the last force is held. The velocity is estimated over the time between the samples, not between the
/// ticks that saw them. After stale_after_ns() without a fresh state the force fades to zero within kStaleFade, and
/// after kSilence the device counts as away. When fresh states return, or when no tick ran for as long (a process that
/// was stopped), it is as after a device's return: nothing is computed from before, and forces fade in from zero.
/// Where more time passes in such gaps than between them, no force would ever arrive: a session that asks for one
/// ends after a second of that; one that asks for none goes on.
///
/// A position farther from the centre of the workspace than ten of its diagonals and one metre ends the session: no
/// hand reaches there. Once a limit or a fault stops a session, the controller is not asked again, and one event says
/// so.
///
/// A device that is away (Device::Status) may be waited for. Ticks and time go on, without rows: a position that was
/// not taken is not invented. It is sent zero force until it is back and ready; then the velocity is estimated anew,
/// the controller resumes, and forces fade in from zero. The motors are not credited with having cooled meanwhile:
/// nobody saw what force acted.
class ServoLoop {
 public:
  static constexpr double kStaleFade = 0.01;  ///< [s]
  static constexpr double kSilence = 0.25;    ///< without a fresh state, and at least five periods [s]

  struct Options {
    double rate_hz = 1000;
    bool virtual_time = false;    ///< advance as fast as the machine allows; else the monotonic clock
    bool realtime = true;         ///< ask for a real-time thread (monotonic clock only)
    SafetyLimits limits;          ///< forces: never more than the device's own, which 0 takes; see the class
    bool watch_vibration = true;  ///< ForceGuard, for devices with a force limit; false: for experiments only
    double ready_timeout = 30;    ///< how long to wait for a device that is not ready, or not at rest after that [s]
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

  /// Where the thread is that runs it, for a Watchdog.
  [[nodiscard]] const TickPulse& pulse() const noexcept { return pulse_; }

 private:
  class Session;

  [[nodiscard]] std::string not_ready_hint() const;  ///< the end of a sentence

  Device& device_;
  Controller& controller_;
  VelocityEstimator& estimator_;
  std::vector<SampleSink*> sinks_;
  Options options_;
  TickPulse pulse_;
  double assumed_continuous_force_ = 0;  ///< where nobody stated one [N]
};

}  // namespace haptrace
