// The servo loop: recording, playback, guidance and programmes differ only in their controller.
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
#include "devices/loop/realtime.h"
#include "devices/loop/tick_pulse.h"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace haptrace {

class ServoClock;

inline constexpr double kLowestRate = 10;      // [Hz]
inline constexpr double kHighestRate = 20000;  // [Hz]

/// Cause of the end of a session.
enum class StopCause {
  finished,           ///< the controller was done
  interrupted,        ///< StopRequest
  deviation,          ///< the tracking error passed its limit
  resistance,         ///< the hand resisted more than the force limits allow, for longer than the controller's patience
  oscillation,        ///< the loop oscillated although its force was softened
  no_path,            ///< the controller could not get the rest of the path
  velocity,           ///< the tool was faster than its limit, or its position jumped
  not_finite,         ///< the device's position or the controller's force was not finite
  outside_workspace,  ///< the device reported a position beyond the reach of a hand
  device_not_ready,   ///< the device did not allow forces, or stopped allowing them
  device_lost,
};

const char* to_string(StopCause cause) noexcept;

/// Report of one session of the loop.
struct ServoReport {
  StopCause cause = StopCause::finished;
  std::string detail;                          ///< why the session stopped, in words; empty if finished
  StopSource stopped_from = StopSource::user;  ///< what asked for an interruption
  std::uint64_t samples = 0;    ///< fresh states that the controller answered: the samples of a recording
  std::uint64_t stale = 0;      ///< ticks without a fresh state; they give no sample
  std::uint64_t gaps = 0;       ///< times without a fresh state that lasted longer than stale_after_ns()
  std::uint64_t missed = 0;     ///< ticks that did not run because an earlier tick was late
  std::uint64_t overruns = 0;   ///< number of times that ticks were missed
  std::uint64_t returns = 0;    ///< number of times that the device was lost and found again
  double duration = 0;          ///< time from the first to the last sample, by the session's clock [s]
  double away = 0;              ///< part of duration in gaps and without the device [s]
  double asked_rate = 0;        ///< [Hz]
  double max_force = 0;         ///< largest magnitude sent [N]
  DurationHistogram latency;    ///< wake-up minus deadline
  DurationHistogram tick_time;  ///< wake-up to end of tick, always on the monotonic clock
  RealtimeStatus realtime;
  VibrationSummary vibration;         ///< vibration that ForceGuard detected, and its reaction
  std::vector<Sample> flight_record;  ///< the last 200 ms before a limit or a fault stopped the session; else empty

  /// Returns the fresh states per second of the session's clock, while the device was present [Hz].
  [[nodiscard]] double achieved_rate() const noexcept { return rate_of(samples); }
  /// Returns the exchanges per second in the same time, with a fresh state or without [Hz].
  [[nodiscard]] double exchange_rate() const noexcept { return rate_of(samples + stale); }
  /// Returns true if the device delivers fewer fresh states than requested: in less than 0.9 of the exchanges.
  [[nodiscard]] bool lacks_states() const noexcept { return samples > 0 && stale > (samples + stale) / 10; }
  /// Returns true if a limit or a fault ended the session, and not the controller or a request.
  [[nodiscard]] bool stopped_by_fault() const noexcept {
    return cause != StopCause::finished && cause != StopCause::interrupted;
  }

 private:
  [[nodiscard]] double rate_of(std::uint64_t count) const noexcept {
    return duration > away && count > 0 ? static_cast<double>(count - 1) / (duration - away) : 0;
  }
};

/// Returns the age beyond which a state is stale [ns]: 20 ms, or three periods (at most 1 s) if these are longer.
[[nodiscard]] std::int64_t stale_after_ns(double rate_hz) noexcept;

/// Drives one device with one controller at a fixed rate.
///
/// The loop protects the user in every session, whatever the controller. It rejects positions and forces that are not
/// finite. It limits the peak force, the continuous force and the tool's speed. It softens a force that vibrates, and
/// ends the session if the vibration stays (ForceGuard). It fades forces in and out, and sends zero force however a
/// session ends. The continuous limit is the device's; if neither the device nor the session states one, it is a
/// cautious one (kCautiousShare). It accounts for the time for which each force really acted. If a hand resists more
/// than this limit allows, the session ends after Command::patience. The loop counts late ticks as missed and never
/// catches up with them: they leave a gap in tick and time, and an event.
///
/// A state that the device only repeats (DeviceState::sequence) is not a sample. The loop stores nothing, estimates no
/// velocity, does not call the controller, and holds the last force. The velocity estimate uses the time between the
/// samples, not between the ticks that saw them. After stale_after_ns() without a fresh state, the force fades to zero
/// within kStaleFade; after kSilence the device counts as away. When fresh states return, the loop continues as after a
/// device's return: it computes nothing from earlier states, and forces fade in from zero. The same holds when no tick
/// ran for as long, for example because the process was stopped. If more time passes in such gaps than between them, a
/// force would never fade in. A session that asks for a force then ends after 1 s of that; a session that asks for none
/// continues.
///
/// A position farther from the centre of the workspace than ten of its diagonals plus one metre ends the session: no
/// hand reaches that far. After a limit or a fault stops a session, the loop stops calling the controller and logs one
/// event.
///
/// The loop can wait for a device that is away (Device::Status). Ticks and time continue, without samples: the loop
/// does not invent positions. It sends zero force until the device is back and ready. Then it restarts the velocity
/// estimate, the controller resumes, and forces fade in from zero. The continuous limit does not count this time as
/// cooling of the motors, because the force that acted is unknown.
class ServoLoop {
 public:
  static constexpr double kStaleFade = 0.01;  ///< [s]
  static constexpr double kSilence = 0.25;    ///< time without a fresh state, and at least five periods [s]

  struct Options {
    double rate_hz = 1000;
    bool virtual_time = false;  ///< run as fast as the machine allows; else on the monotonic clock
    bool realtime = true;       ///< request a real-time thread (monotonic clock only)
    SafetyLimits limits;  ///< force limits never exceed the device's own; 0 selects the device's own (see the class)
    bool watch_vibration = true;  ///< use ForceGuard on devices with a force limit; false only for experiments
    double ready_timeout = 30;    ///< longest wait for a device that is not ready, or not at rest after that [s]
    double away_timeout = 0;      ///< longest wait for a device that is away [s]; 0: it is lost at once
    ServoClock* clock = nullptr;  ///< borrowed; replaces both clocks, for studies of timing
  };

  /// Throws Error(input) if an option is out of range, or if virtual time is requested for a device in real time.
  static void validate(const DeviceInfo& device, const Options& options);

  /// Borrows all arguments; they must outlive run(). Throws what validate throws.
  ServoLoop(Device& device, Controller& controller, VelocityEstimator& estimator, std::span<SampleSink* const> sinks,
            const Options& options);

  /// Runs one session in the calling thread until the controller is finished, `stop` is raised or a limit stops the
  /// session. Sends zero force before it returns. Does not throw.
  ServoReport run(const StopRequest& stop) noexcept;

  /// Returns the pulse of the thread that runs the session, for a Watchdog.
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
  double assumed_continuous_force_ = 0;  ///< used if neither the device nor the session states one [N]
};

}  // namespace haptrace
