// Gains along a path, as a file.
#pragma once

#include "control/tuning.h"

#include <string>
#include <vector>

namespace haptrace {

/// Gains over the place or the time on a path: linear between the points, and constant before the first and after the
/// last.
struct ImpedanceProfile {
  bool by_place = false;       ///< `at` holds arc lengths from the path's start [m]; otherwise its own time [s]
  std::vector<double> at;      ///< strictly increasing
  std::vector<PdGains> gains;  ///< one for each

  [[nodiscard]] PdGains gains_at(double place) const;
};

/// Reads JSON, {"s": [...], "kp": [...], "kd": [...]}, or CSV (.csv) with columns of these names. `s` is the arc length
/// from the path's start [m]; `t` in its place is the path's own time, from its start [s]. A gain kp [N/m] or kd
/// [N s/m] is a number, or one per axis: [x, y, z], or the columns kpx,kpy,kpz and kdx,kdy,kdz. Without kd, kd = 12 ms
/// kp, as in cautious gains. In CSV, other columns are skipped, and rows without a gain.
///
/// Throws Error(input) naming the file and the key, row or column if a value is missing or not finite, a gain is
/// negative or beyond the largest (control/tuning.h), or s or t does not increase.
ImpedanceProfile load_impedance_profile(const std::string& file);

}  // namespace haptrace
