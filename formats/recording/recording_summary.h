// What is in a recording, in figures.
#pragma once

#include "control/path/path.h"
#include "control/sample.h"

#include <cstdint>
#include <functional>
#include <span>

namespace haptrace {

/// Figures of consecutive rows of a recording. Those of a whole recording are its blocks' joined one after the other:
/// join() is associative and the summary of no rows changes nothing, so that a recording of any length can be told in
/// figures from its overview alone.
struct RecordingSummary {
  std::uint64_t rows = 0;
  std::int64_t first_ns = 0, last_ns = 0;  ///< time of the first and the last row
  std::uint64_t first_tick = 0, last_tick = 0;
  Vec3 first_position = nan3(), last_position = nan3();  ///< [m]

  std::uint64_t gaps = 0;       ///< places where the tick jumps
  std::uint64_t missed = 0;     ///< ticks that are not there
  double longest_interval = 0;  ///< between two rows [s]
  Box bounds;                   ///< of the positions [m]; inside out when there are none
  double path_length = 0;       ///< of the positions as recorded, their noise included [m]
  double peak_speed = 0;        ///< over 10 ms: what a hand would feel, not what one noisy row says [m/s]
  double max_force = 0;         ///< largest magnitude sent [N]
  std::uint64_t with_velocity = 0, with_force = 0;  ///< rows in which they are known
  std::uint64_t without_position = 0;

  std::uint64_t runs = 0;      ///< stretches of phase run
  std::uint64_t run_rows = 0;  ///< rows in them
  bool begins_in_run = false, ends_in_run = false;
  Box run_bounds;             ///< of their positions [m]
  double run_peak_speed = 0;  ///< [m/s]

  std::uint64_t tracked = 0;  ///< rows of phase run that have a reference
  double error2_sum = 0;      ///< over those, of the squared deviation [m^2]
  double error2_peak = 0;     ///< [m^2]

  /// Adds the figures of the rows that follow these.
  void join(const RecordingSummary& next);

  [[nodiscard]] double duration() const noexcept;    ///< first to last row [s]
  [[nodiscard]] double mean_rate() const noexcept;   ///< [Hz]; 0 for fewer than two rows
  [[nodiscard]] double rms_error() const noexcept;   ///< 3-D [m]; NaN without a reference
  [[nodiscard]] double peak_error() const noexcept;  ///< [m]; NaN without a reference
};

/// Makes summaries of consecutive blocks of rows. Costs a few nanoseconds a row.
class Summariser {
 public:
  void add(std::span<const Sample> samples);

  /// The figures of what was added since the last take(). A speed that is measured across two blocks is the later's.
  RecordingSummary take();

  [[nodiscard]] std::uint64_t rows() const noexcept { return summary_.rows; }

 private:
  /// Of speed: where and when it began, and whether all of it was of phase run.
  struct Window {
    std::int64_t time_ns = 0;
    Vec3 position = nan3();
    bool known = false;  ///< the position
    bool in_run = false;
  };
  void begin(const Sample& first);
  /// Rows that are all of phase run, or none. Answers the bounds of their positions.
  Box add_stretch(std::span<const Sample> samples, bool run);
  void add_error(const Sample& sample);
  void measure_speed(const Sample& sample);

  RecordingSummary summary_;     ///< without these two
  double max_force2_ = 0;        ///< [N^2]
  std::int64_t longest_ns_ = 0;  ///< interval
  Window window_;
};

class RecordingReader;

/// Of a whole recording: from its overview, and from its rows where it has none, told to `progress` as rows done.
RecordingSummary summarise(const RecordingReader& reader, const std::function<void(std::uint64_t)>& progress = {});

}  // namespace haptrace
