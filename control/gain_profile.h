// Gains that change along a path.
#pragma once

#include "base/types.h"
#include "control/tuning.h"

#include <vector>

namespace haptrace {

/// Gains over the time of a path as it is played, at equal steps from its start.
struct GainTable {
  double step = 0.01;          ///< [s]
  std::vector<PdGains> gains;  ///< not empty

  /// Returns the gains at `time` [s] by linear interpolation, the first or the last ones beyond the table. NaN gives
  /// the first ones.
  ///
  /// Real-time.
  [[nodiscard]] PdGains at(double time) const noexcept;

  /// Returns the largest gains of each axis.
  [[nodiscard]] PdGains largest() const noexcept;
};

/// Follows the shares of the largest gains that a table states along a path. Each share approaches the table's by all
/// but 2 % of the difference in 0.2 s, like a change of the tuning, so that a jump of the table or of the path's time
/// makes no step in the force.
///
/// Real-time: all but the constructor.
class GainSchedule {
 public:
  explicit GainSchedule(GainTable table);

  /// Restarts at `time` [s] of the path.
  void reset(double time) noexcept { now_ = shares_at(time); }

  /// Advances by `dt` [s] towards the shares at `time` [s] of the path. Returns `gains` times the shares.
  [[nodiscard]] PdGains advance(const PdGains& gains, double time, double dt) noexcept;

 private:
  [[nodiscard]] PdGains shares_at(double time) const noexcept;

  GainTable table_;
  PdGains largest_;
  PdGains now_;  ///< shares, from 0 to 1
};

}  // namespace haptrace
