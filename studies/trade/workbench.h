// Where configurations are tried: what they give, in simulation, and what they cost, on this machine.
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

/// What is played, on what, and how, but for what a Configuration says.
struct Workplace {
  /// A device in virtual time, new and at rest, whose noise and hand follow the seed. Called from any thread.
  std::function<std::unique_ptr<Device>(std::uint64_t seed)> open;
  std::shared_ptr<const PathSource> path;  ///< read by one thread at a time: loaded here, once
  std::optional<DeviceProfile> profile;    ///< of the device: without it there is nothing but a PD law
  PlayOptions play;                        ///< limits, fit, smoothing; without recording, sinks and tuning
  std::uint64_t seed = 1;                  ///< of the first run; further runs count up
  bool varies = true;                      ///< runs of different seeds differ; else one run is all there is
  double model_error = 0;                  ///< share by which `open` may miss the device, which widens every interval
  bool device_in_tick = true;              ///< ticks are told with the device's exchange; else without
};

/// Tries configurations of a playback. Equal workplaces and configurations give outcomes that are bit-identical in what
/// they give, whatever the threads; what they cost in time varies with the machine.
///
/// Threads: judge() from any; the others from one, while nobody judges.
class Workbench {
 public:
  /// Loads the path and plans the base. Throws Error(input) when the device does not advance in virtual time, and what
  /// plan_playback throws.
  explicit Workbench(Workplace place);

  /// What `configuration` gives, over `runs` runs. A configuration that cannot be run, or whose session a limit ended,
  /// is refused in words, not thrown.
  [[nodiscard]] Outcome judge(const Configuration& configuration, std::size_t runs) const;

  /// The forces that force errors are measured against: those of `finest`, for the seeds of so many runs. Without it
  /// they are not measured.
  void measure_forces_against(const Configuration& finest, std::size_t runs, const StopRequest& stop);

  /// Fills in the margin: by how much the gains can be raised, in steps of a quarter octave up to 4, before the
  /// oscillation monitor speaks or a limit ends the session.
  void find_margin(Outcome& outcome) const;

  /// Fills in what a tick and a start cost, in time.
  void time_ticks(Outcome& outcome) const;

  /// Instructions of a tick, on a device that costs nothing: the lower quartile of kCountedTicks ticks of phase run.
  /// NaN where they cannot be counted.
  [[nodiscard]] double count_ticks(const Configuration& configuration) const;
  static constexpr int kCountedTicks = 9;

  /// Bytes that an hour of recording weighs, as it is stored, and the largest error of a position [m] and a force [N]
  /// that storing makes. Makes a file in the folder for temporary ones and removes it.
  struct Stored {
    double bytes_per_hour = kNaN, position_error = 0, force_error = 0;
    double row_time = kNaN;  ///< CPU time of a row, beyond the session's own [s]
  };
  [[nodiscard]] Stored record(const Configuration& configuration, const Storage& storage) const;

  /// As `configuration` is played. Throws Error(input) when it cannot be.
  [[nodiscard]] PlayOptions options_for(const Configuration& configuration) const;

  [[nodiscard]] bool calibrated() const noexcept { return place_.profile.has_value(); }
  [[nodiscard]] const Workplace& place() const noexcept { return place_; }
  [[nodiscard]] const DeviceInfo& device() const noexcept { return info_; }
  [[nodiscard]] const Trajectory& exact() const noexcept { return exact_; }     ///< the path as it was given
  [[nodiscard]] double duration() const noexcept { return exact_.duration(); }  ///< of the path [s]
  [[nodiscard]] std::uint64_t rows() const noexcept { return place_.path->facts().rows; }

  /// The profile with its design made for another servo rate; nothing when that cannot be done: a coarse model's design
  /// was tried out at its rate and holds for no other, and a late device bears none at high rates.
  [[nodiscard]] std::optional<DeviceProfile> profile_at(double rate_hz) const;

 private:
  class RunLog;
  class Rehearsal;

  /// Rms; NaN when there is nothing to compare.
  static double force_difference(const std::vector<Vec3>& forces, const std::vector<Vec3>& finest);

  [[nodiscard]] PlayOptions tick_options(const Configuration& configuration) const;

  Workplace place_;
  DeviceInfo info_;
  Trajectory exact_;                                         ///< the path as it was given
  std::map<std::uint64_t, std::vector<Vec3>> finest_force_;  ///< by seed: means over 20 ms of the path's own time
};

}  // namespace haptrace
