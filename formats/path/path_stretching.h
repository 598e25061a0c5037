// Paths whose time is stretched in places.
#pragma once

#include "formats/path/path_source.h"

#include <memory>
#include <vector>

namespace haptrace {

/// A stretch of time: at time t from a path's start, time passes `factor(t)` times as slowly. The new time is the
/// integral of the factor, which is linear between nodes at equal steps and constant beyond them.
class TimeStretch {
 public:
  TimeStretch() : TimeStretch(1, {1}) {}

  /// `factors`, each at least 1, are those at 0, `step`, 2 `step`, ... [s].
  TimeStretch(double step, std::vector<double> factors);

  [[nodiscard]] bool is_identity() const noexcept;
  [[nodiscard]] double factor(double t) const noexcept;  ///< at an old time [s]
  [[nodiscard]] double later(double t) const noexcept;   ///< the new time of an old one [s]
  [[nodiscard]] double before(double t) const noexcept;  ///< the old time of a new one [s]

  struct Place {
    double begin = 0, end = 0;  ///< old time [s]
    double factor = 1;          ///< the largest
  };
  /// Returns the places in which time is stretched.
  [[nodiscard]] std::vector<Place> places() const;

 private:
  double step_;
  std::vector<double> factors_, times_;  ///< at the nodes: factors, and new times
};

/// Returns `path` with stretched stamps, from the same first stamp on. Velocities are divided by the factor; forces and
/// orientations stay. Reads the whole path once for its statistics. Without a stretch, returns the path itself.
std::shared_ptr<const PathSource> stretched(std::shared_ptr<const PathSource> path, TimeStretch stretch);

}  // namespace haptrace
