// A session's options for the servo loop, and the loop's report of it.
#pragma once

#include "base/histogram.h"
#include "base/stop_request.h"
#include "control/safety_limits.h"
#include "control/sample.h"
#include "control/vibration_summary.h"

#include <cstdint>
#include <string>
#include <vector>

namespace haptrace {

class ServoClock;

inline constexpr double kLowestRate = 10;      // [Hz]
inline constexpr double kHighestRate = 20000;  // [Hz]

/// Heat that a session leaves in the motors of a device, for the next session on it.
struct MotorHeat {
  double force = 0, torque = 0;  ///< mean squares of what was sent, as ForceLimiter counts them [N^2, N^2 m^2]
  double rested = 0;             ///< time since the end of that session [s]
};

/// Settings of the servo loop (ServoLoop).
struct ServoOptions {
  double rate_hz = 1000;
  bool virtual_time = false;  ///< run as fast as the machine allows; else on the monotonic clock
  bool realtime = true;       ///< request a real-time thread (monotonic clock only)
  SafetyLimits limits;  ///< force limits never exceed the device's own; 0 selects the device's own (see ServoLoop)
  bool watch_vibration = true;  ///< use ForceGuard on devices with a force limit; false only for experiments
  double tremor = 0;            ///< answer of the feedback to the hand's tremor, see VibrationMonitorOptions [N]
  double ready_timeout = 30;    ///< longest wait for a device that is not ready, or not at rest after that [s]
  double away_timeout = 0;      ///< longest wait for a device that is away [s]; 0: it is lost at once
  MotorHeat* motors = nullptr;  ///< borrowed; from earlier sessions, and replaced at the end. Null: the motors are cold
  ServoClock* clock = nullptr;  ///< borrowed; replaces both clocks, for studies of timing
};

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

/// Settings that the operating system granted. Every session reports them.
struct RealtimeStatus {
  std::string scheduler = "SCHED_OTHER";  ///< for example "SCHED_FIFO 80"
  bool realtime = false;                  ///< the thread has a real-time scheduling class
  bool memory_locked = false;
  std::string reason;  ///< what was refused and how to fix it; empty if everything was granted
};

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

}  // namespace haptrace
