// Can this machine hold a servo rate? What was found, and the command that mends it.
//
// It holds the rate when, in a measurement of the real servo loop, at most one tick in a thousand is missed and p99.9
// of the wake-up latency is at most half a period: beyond that a session has a gap every second, and forces that are
// older than they are stable for.
#pragma once

#include "base/histogram.h"
#include "devices/loop/realtime.h"
#include "devices/loop/servo_loop.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// One thing that was looked at.
struct Diagnosis {
  enum class Severity {
    ok,
    note,     ///< worth knowing, or what could not be found out: `measured` then begins with "unknown"
    warning,  ///< costs latency, or samples on a bad day
    problem,  ///< the rate cannot be held, its recording cannot be kept, or a device that is plugged in cannot be
              ///< opened
  };
  Severity severity = Severity::ok;
  std::string check;     ///< what was looked at, for example "cpu governor"
  std::string measured;  ///< what was found
  std::string remedy;    ///< the command that mends it; empty when there is nothing to mend
};

const char* to_string(Diagnosis::Severity severity) noexcept;

/// "p50 12 us, p99 40 us, p99.9 88 us, max 12 ms".
std::string quantiles_text(const DurationHistogram& durations);

/// What the kernel says about itself and its devices: CPU governor, preemption, USB autosuspend, latency timers of USB
/// serial ports, whether known devices that are plugged in may be opened, udev rules. Reads below `root` ("/"); what
/// cannot be read is a note, never an error.
std::vector<Diagnosis> examine_system(const std::string& root = "/");

/// Time that the hypervisor gave to others when this machine wanted it, all processors together, since it started [s].
/// Nothing when it cannot be read.
std::optional<double> stolen_time(const std::string& root = "/");

/// The servo loop in several turns.
struct LoopMeasurement {
  double rate_hz = 1000;
  double duration = 0;  ///< of all turns [s]
  std::uint64_t samples = 0, missed = 0, overruns = 0;
  DurationHistogram latency;          ///< wake-up minus deadline
  std::vector<double> p999_of_turns;  ///< p99.9 of the latency in each turn [s]
  RealtimeStatus realtime;            ///< of the last turn
  std::int64_t timer_slack_ns = 0;
  std::optional<double> stolen;  ///< by the hypervisor meanwhile, all processors together [s]

  [[nodiscard]] double missed_fraction() const noexcept {
    const auto due = static_cast<double>(samples + missed);
    return due > 0 ? static_cast<double>(missed) / due : 0;
  }
  /// The criterion above. False when nothing was measured.
  [[nodiscard]] bool holds_rate() const noexcept;
};

inline constexpr double kMostMissed = 1e-3;   ///< of the ticks
inline constexpr double kLatestWakeUp = 0.5;  ///< p99.9 of the latency, in periods

/// Runs the servo loop for `duration` [s] of real time on a simulated device, with no force, in a thread of its own
/// that asks for real-time scheduling, and adds what it was like to `sum`, at sum.rate_hz. Ends early when `stop` is
/// raised. Throws Error(input) when the rate is out of range. Locks the memory of the process.
void measure_loop(LoopMeasurement& sum, double duration, const StopRequest& stop);

/// Scheduling class, memory lock, timer slack, the loop itself, and what the hypervisor had to do with it. Limits and
/// their configuration are read below `root`.
std::vector<Diagnosis> examine_loop(const LoopMeasurement& loop, const std::string& root = "/");

/// Reads what `cyclictest --quiet --histogram=US` printed: the histogram of its first thread. Wake-ups that passed the
/// histogram's end count as the longest. Nothing when there is no histogram.
std::optional<DurationHistogram> parse_cyclictest(const std::string& output);

/// The wake-up latency that Debian's cyclictest finds in `duration` [s]: SCHED_FIFO of our loop's priority, our loop's
/// interval, memory locked. Throws Error(fault) when it is not installed or not permitted, with the command that mends
/// it.
DurationHistogram measure_cyclictest(double rate_hz, double duration);

}  // namespace haptrace
