// Check whether this machine can sustain a servo rate, with the results and the commands that fix them.
//
// The machine sustains the rate if, in a measurement of the real servo loop, at most one tick in a thousand is missed
// and p99.9 of the wake-up latency is at most half a period. Beyond that, a session has a gap every second, and its
// forces are older than their stability allows.
#pragma once

#include "base/histogram.h"
#include "base/severity.h"
#include "base/stop_request.h"
#include "devices/loop/servo_session.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// Result of one check.
struct Diagnosis {
  Severity severity = Severity::ok;
  std::string check;     ///< name of the check, for example "cpu governor"
  std::string measured;  ///< result of the check
  std::string remedy;    ///< command that fixes it; empty if nothing is wrong
};

/// Returns, for example, "p50 12 us, p99 40 us, p99.9 88 us, max 12 ms".
std::string quantiles_text(const DurationHistogram& durations);

/// Examines the kernel's information about itself and its devices: CPU governor, preemption, USB autosuspend, latency
/// timers of USB serial ports, permission to open the known devices that are plugged in, udev rules. Reads below `root`
/// ("/"). A value that cannot be read gives a note, never an error.
std::vector<Diagnosis> examine_system(const std::string& root = "/");

/// Returns the time that the hypervisor took from this machine since its start, summed over all processors [s]. Returns
/// nothing if it cannot be read.
std::optional<double> stolen_time(const std::string& root = "/");

/// Measurement of the servo loop in several turns.
struct LoopMeasurement {
  double rate_hz = 1000;
  double duration = 0;  ///< sum over all turns [s]
  std::uint64_t samples = 0, missed = 0, overruns = 0;
  DurationHistogram latency;          ///< wake-up minus deadline
  std::vector<double> p999_of_turns;  ///< p99.9 of the latency in each turn [s]
  RealtimeStatus realtime;            ///< of the last turn
  std::int64_t timer_slack_ns = 0;
  std::optional<double> stolen;  ///< time that the hypervisor took meanwhile, summed over all processors [s]

  [[nodiscard]] double missed_fraction() const noexcept {
    const auto due = static_cast<double>(samples + missed);
    return due > 0 ? static_cast<double>(missed) / due : 0;
  }
  /// Returns true if the criterion above is met; false without a measurement.
  [[nodiscard]] bool holds_rate() const noexcept;
};

inline constexpr double kMostMissed = 1e-3;   ///< largest share of missed ticks
inline constexpr double kLatestWakeUp = 0.5;  ///< largest p99.9 of the latency, in periods

/// Runs the servo loop for `duration` [s] of real time on a simulated device without force, at sum.rate_hz, and adds
/// the result to `sum`. The loop runs in its own thread, which requests real-time scheduling. Ends early if `stop` is
/// raised. Throws Error(input) if the rate is out of range. Locks the memory of the process.
void measure_loop(LoopMeasurement& sum, double duration, const StopRequest& stop);

/// Examines the scheduling class, memory lock, timer slack, the loop itself, and the hypervisor's effect on it. Reads
/// limits and their configuration below `root`.
std::vector<Diagnosis> examine_loop(const LoopMeasurement& loop, const std::string& root = "/");

/// Parses the output of `cyclictest --quiet --histogram=US`: the histogram of its first thread. Wake-ups beyond the
/// histogram's end count as the longest. Returns nothing without a histogram.
std::optional<DurationHistogram> parse_cyclictest(const std::string& output);

/// Measures the wake-up latency with Debian's cyclictest for `duration` [s], with the loop's SCHED_FIFO priority and
/// interval, and with locked memory. If cyclictest is not installed or not permitted, throws Error(fault) with the
/// command that fixes this.
DurationHistogram measure_cyclictest(double rate_hz, double duration);

}  // namespace haptrace
