// Trials of configurations: their accuracy in simulation and their cost on this machine.
#pragma once

#include "devices/device.h"
#include "formats/documents/device_profile.h"
#include "formats/path/path_source.h"
#include "studies/trade/outcome.h"

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// Device, path and playback options of the trials, except those in a Configuration.
struct Workplace {
  /// Opens a new device in virtual time, at rest, whose noise and hand follow the seed. Called from any thread.
  std::function<std::unique_ptr<Device>(std::uint64_t seed)> open;
  std::shared_ptr<const PathSource> path;  ///< read by one thread at a time; the Workbench loads it once
  std::optional<DeviceProfile> profile;    ///< profile of the device; without it, only the PD law is available
  PlayOptions play;                        ///< limits, fit and smoothing; no recording, sinks or tuning
  std::uint64_t seed = 1;                  ///< seed of the first run; further runs count up
  bool varies = true;                      ///< runs of different seeds differ; else one run suffices
  double model_error = 0;                  ///< relative error of the device from `open`; widens every interval
  bool device_in_tick = true;              ///< tick times include the device's exchange
};

/// Tries configurations of a playback. Equal workplaces and configurations give bit-identical accuracy results,
/// whatever the threads; times vary with the machine.
///
/// Threads: judge() from any; the others from one thread, while no judge() runs.
class Workbench {
 public:
  /// Loads the path and plans the base. Throws Error(input) when the device does not advance in virtual time, and what
  /// plan_playback throws.
  explicit Workbench(Workplace place);

  /// Measures the accuracy of `configuration` over `runs` runs. If it cannot be run or a limit ends its session, sets
  /// Outcome::refused and does not throw.
  [[nodiscard]] Outcome judge(const Configuration& configuration, std::size_t runs) const;

  /// Sets the reference for force errors: the forces of `finest`, for the seeds of `runs` runs. Without this call,
  /// force errors are not measured.
  void measure_forces_against(const Configuration& finest, std::size_t runs, const StopRequest& stop);

  /// Sets the margin: the factor up to 4, in steps of a quarter octave, by which the gains can be raised before the
  /// oscillation monitor reports or a limit ends the session.
  void find_margin(Outcome& outcome) const;

  /// Sets the times of a tick and of a start.
  void time_ticks(Outcome& outcome) const;

  /// Returns the instructions of a tick on a device without computing cost: the lower quartile of kCountedTicks ticks
  /// of phase run. NaN if they cannot be counted.
  [[nodiscard]] double count_ticks(const Configuration& configuration) const;
  static constexpr int kCountedTicks = 9;

  /// Size of an hour of recording, and the largest storage error of a position [m] and a force [N]. record() makes
  /// temporary files and removes them.
  struct Stored {
    double bytes_per_hour = kNaN, position_error = 0, force_error = 0;
    double row_time = kNaN;  ///< CPU time per sample, beyond the session's own [s]
  };
  [[nodiscard]] Stored record(const Configuration& configuration, const Storage& storage) const;

  /// Returns the options that play `configuration`. Throws Error(input) when it cannot be played.
  [[nodiscard]] PlayOptions options_for(const Configuration& configuration) const;

  [[nodiscard]] bool calibrated() const noexcept { return place_.profile.has_value(); }
  [[nodiscard]] const Workplace& place() const noexcept { return place_; }
  [[nodiscard]] const DeviceInfo& device() const noexcept { return info_; }
  [[nodiscard]] const Trajectory& exact() const noexcept { return exact_; }     ///< the original path
  [[nodiscard]] double duration() const noexcept { return exact_.duration(); }  ///< duration of the path [s]
  [[nodiscard]] std::uint64_t rows() const noexcept { return place_.path->facts().rows; }

  /// Returns the profile with a design for another servo rate, or nothing if that is not possible: a coarse model's
  /// design holds only for the rate of its trial, and a device with a long delay has no design at high rates.
  [[nodiscard]] std::optional<DeviceProfile> profile_at(double rate_hz) const;
  /// Returns whether the profile has LQG laws for this rate.
  [[nodiscard]] bool has_laws(double rate_hz) const;

 private:
  class RunLog;
  class Rehearsal;

  /// Returns the rms difference; NaN if there is nothing to compare.
  static double force_difference(const std::vector<Vec3>& forces, const std::vector<Vec3>& finest);

  [[nodiscard]] PlayOptions tick_options(const Configuration& configuration) const;

  Workplace place_;
  DeviceInfo info_;
  Trajectory exact_;                                         ///< the original path
  std::map<std::uint64_t, std::vector<Vec3>> finest_force_;  ///< by seed: means over 20 ms
};

}  // namespace haptrace
