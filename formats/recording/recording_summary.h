// Summary statistics of recordings.
#pragma once

#include "control/path/path.h"
#include "control/sample.h"

#include <cstdint>
#include <functional>
#include <span>

namespace haptrace {

/// Statistics of consecutive rows of a recording. Joining those of all blocks in order gives those of the recording:
/// join() is associative, and the summary of no rows changes nothing. The overview alone thus summarises a recording of
/// any length.
struct RecordingSummary {
  std::uint64_t rows = 0;
  std::int64_t first_ns = 0, last_ns = 0;  ///< time of the first and the last row
  std::uint64_t first_tick = 0, last_tick = 0;
  Vec3 first_position = nan3(), last_position = nan3();  ///< [m]

  std::uint64_t gaps = 0;       ///< number of jumps of the tick
  std::uint64_t missed = 0;     ///< missed ticks
  double longest_interval = 0;  ///< between two rows [s]
  Box bounds;                   ///< of the positions [m]; inverted if there are none
  double path_length = 0;       ///< of the recorded positions, including their noise [m]
  double peak_speed = 0;        ///< over 10 ms, as a hand would feel it: a single noisy row has no effect [m/s]
  double max_force = 0;         ///< largest magnitude sent [N]
  std::uint64_t with_velocity = 0, with_force = 0;  ///< rows with a value
  std::uint64_t without_position = 0;

  std::uint64_t runs = 0;      ///< stretches of phase run
  std::uint64_t run_rows = 0;  ///< rows of phase run
  bool begins_in_run = false, ends_in_run = false;
  Box run_bounds;             ///< of the positions in phase run [m]
  double run_peak_speed = 0;  ///< [m/s]

  std::uint64_t tracked = 0;  ///< rows of phase run with a reference
  double error2_sum = 0;      ///< sum of their squared deviations [m^2]
  double error2_peak = 0;     ///< [m^2]

  /// Adds the statistics of the rows that follow these.
  void join(const RecordingSummary& next);

  [[nodiscard]] double duration() const noexcept;    ///< from the first to the last row [s]
  [[nodiscard]] double mean_rate() const noexcept;   ///< [Hz]; 0 for fewer than two rows
  [[nodiscard]] double rms_error() const noexcept;   ///< 3-D [m]; NaN without a reference
  [[nodiscard]] double peak_error() const noexcept;  ///< [m]; NaN without a reference
};

/// Computes summaries of consecutive blocks of rows. Costs a few nanoseconds per row.
class Summariser {
 public:
  void add(std::span<const Sample> samples);

  /// Returns the statistics of the rows since the last take(). A speed measured across two blocks belongs to the later
  /// one.
  RecordingSummary take();

  [[nodiscard]] std::uint64_t rows() const noexcept { return summary_.rows; }

 private:
  /// Window for a speed: where and when it began, and whether it is entirely in phase run.
  struct Window {
    std::int64_t time_ns = 0;
    Vec3 position = nan3();
    bool known = false;  ///< the position is known
    bool in_run = false;
  };
  void begin(const Sample& first);
  /// Adds rows that are all of phase run, or none of them. Returns the bounds of their positions.
  Box add_stretch(std::span<const Sample> samples, bool run);
  void add_error(const Sample& sample);
  void measure_speed(const Sample& sample);

  RecordingSummary summary_;     ///< without the next two members
  double max_force2_ = 0;        ///< [N^2]
  std::int64_t longest_ns_ = 0;  ///< longest interval
  Window window_;
};

class RecordingReader;

/// Summarises a whole recording from its overview. Blocks without one are read, and `progress` receives the rows done.
RecordingSummary summarise(const RecordingReader& reader, const std::function<void(std::uint64_t)>& progress = {});

}  // namespace haptrace
