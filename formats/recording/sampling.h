// Analysis of the sampling of a log: its true rate, the pattern of its steps, its gaps, sensors that are slower than
// its rows, dead channels, and the agreement of time stamps and movement.
#pragma once

#include "control/sample.h"

#include <array>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace haptrace {

/// Result of the analysis. Times in s, rates in Hz; 0 or empty if there is nothing to report.
struct Sampling {
  std::uint64_t rows = 0;
  double duration = 0;     ///< first to last stamp
  double mean_rate = 0;    ///< (rows - 1) / duration
  double median_step = 0;  ///< of increasing stamps
  bool even = true;        ///< longest and shortest step differ by at most 1 % of the median
  bool steady = true;      ///< one step per tick of a jittering clock: 99 % within half the median, no gap, no pattern

  /// Steps and their shares of all, the most frequent first; steps within 3 % of the most frequent one are merged.
  std::vector<std::pair<double, double>> commonest;

  /// Repeating steps, as in 1, 2, 1, 2, 1, 1, 2 ms, and the share of the steps that repeat.
  std::vector<double> pattern;
  double pattern_share = 0;

  /// Clock period of which all steps are whole multiples, and the share of its ticks without a row.
  double clock_period = 0;
  double missing = 0;

  std::uint64_t gaps = 0;  ///< steps longer than 5 medians
  double longest_step = 0;
  std::uint64_t longest_at = 0;  ///< row after it, from 1
  std::uint64_t duplicates = 0;  ///< stamps equal to the one before
  std::uint64_t backward = 0;    ///< stamps before the one before

  /// A vector that keeps its value in `share` of the steps in which the position moves, over a fifth. Its sensor
  /// provides `rate` new values per second.
  struct Held {
    std::string name;
    double share = 0, rate = 0;
  };
  std::vector<Held> held;

  std::vector<std::string> constant;  ///< channels that never change while others do, by their CSV names

  /// A channel that changes with most rows, but stays constant for a while in which others change. A smooth rest is not
  /// reported, since a movement along another axis causes it: the channel is noisy, or jumps where the while begins or
  /// ends. A position is stuck, too, if it then jumps by what its velocity said.
  struct Stuck {
    std::string name;
    double from = 0, duration = 0;
  };
  std::vector<Stuck> stuck;

  /// Ratio of the position's movement to the movement that velocity and time stamps predict: sum dp.u / sum u.u with u
  /// = v dt, v the mean of both ends. Example: 1.43 for a log of 700 Hz that is labelled 1 kHz. NaN for too little
  /// movement or correlation.
  double motion_ratio = kNaN;
};

/// Returns one line per anomaly for the user; nothing for a regular log. Omits constant channels: planar movements have
/// one. `kept`: the stamps stay as they are.
std::vector<std::string> notes(const Sampling& sampling, bool kept = true);

nlohmann::json json_of(const Sampling& sampling);

/// Computes a Sampling row by row. Memory does not grow with their number.
class SamplingReport {
 public:
  void add(const Sample& sample);
  [[nodiscard]] Sampling result() const;

 private:
  static constexpr std::size_t kLongestPattern = 32, kRecent = 64, kChannels = 12, kVectors = 3;

  void add_step(std::int64_t step_ns);
  void add_to_pattern(std::int64_t step_ns);
  void add_values(const Sample& sample, double dt);
  void follow_stops(const Vec3& said, const Vec3& moved);
  void find_steps(Sampling& result) const;
  void find_commonest(Sampling& result) const;
  void find_pattern(Sampling& result) const;
  static void find_clock(Sampling& result);
  [[nodiscard]] bool is_steady(const Sampling& result) const;
  void find_held(Sampling& result) const;
  void find_stuck(Sampling& result) const;

  struct Bin {
    std::uint64_t count = 0;
    double sum = 0;  // [ns]
  };
  struct Vector {
    std::uint64_t moved = 0, held = 0;
    double time = 0;  ///< duration of the steps in which the position moved [s]
  };
  struct Channel {
    std::uint64_t changes = 0, steps = 0;  ///< steps: steps in which this channel or others changed
    std::uint64_t run = 0, longest_run = 0;
    std::int64_t run_start = 0, longest_start = 0, longest_end = 0;  // [ns]
    double last_change = 0, change_sum = 0;                          ///< last_change: with sign; change_sum: of squares
    std::uint64_t turns = 0;                                         ///< changes of opposite sign to the one before
    double longest_jump = 0;  ///< larger change at the two ends of the longest run
    bool finite = false;
  };

  /// A while in which a position stays although its velocity does not, and the jump after it, which makes up for it.
  struct Stop {
    std::uint64_t steps = 0;
    std::int64_t start = 0, longest_start = 0, longest_end = 0;  // [ns]
    double said = 0, longest_jump = 0;                           ///< by the velocity, and of the largest stop [m]
  };
  /// Returns true if no movement makes a `change` of this size from row to row.
  [[nodiscard]] static bool jumps(const Channel& channel, double change);

  std::uint64_t rows_ = 0;
  Sample before_;
  std::int64_t first_ns_ = 0, last_ns_ = 0;
  std::uint64_t duplicates_ = 0, backward_ = 0;
  std::int64_t shortest_ns_ = 0, longest_ns_ = 0;
  std::uint64_t longest_at_ = 0;
  std::map<std::int64_t, Bin> steps_;  ///< by length in units of 5 us, finer than any pattern and coarser than noise
  std::uint64_t step_count_ = 0;

  std::array<std::int64_t, kRecent> recent_{};  ///< ring of steps [ns]
  std::uint64_t uneven_ = 0;                    ///< steps whose neighbours differ
  std::array<std::uint64_t, kLongestPattern + 1> matches_{}, run_{};
  std::array<std::vector<std::int64_t>, kLongestPattern + 1> seen_;

  std::array<Vector, kVectors> vectors_;
  std::array<Channel, kChannels> channels_;
  std::array<Stop, 3> stops_;
  std::uint64_t motion_rows_ = 0;
  double moved_moved_ = 0, moved_said_ = 0, said_said_ = 0;  // [m^2]
};

}  // namespace haptrace
