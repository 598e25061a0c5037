// A trial at even steps, low-passed without lag, with the onset and the end of its movement.
#pragma once

#include "metrics/movement.h"

#include <optional>
#include <vector>

namespace haptrace {

/// The columns of a trial as movement_figures() uses them. Columns have the same length.
struct EvenTrial {
  double step = 0;                                   ///< [s]
  std::size_t first = 0, last = 0;                   ///< rows of the onset and the end
  double onset = 0, end = 0;                         ///< after the trial's first position, between rows [s]
  double duration = 0;                               ///< [s]
  double slow = 0;                                   ///< speed below which the hand dwells [m/s]
  double peak = 0;                                   ///< largest speed [m/s]
  std::vector<Vec3> position, velocity;              ///< [m], [m/s]
  std::vector<double> speed;                         ///< [m/s]
  std::optional<std::vector<Vec3>> force, measured;  ///< [N]; nothing if they are missing for too long
};

/// Resamples and low-passes a trial. Returns nothing, and throws, as movement_figures() does.
std::optional<EvenTrial> even_trial(const Trial& trial, const MovementOptions& options);

/// Returns the row of the first maximum of the speed from the onset on that is followed by a fall of `prominence`
/// [m/s]; that of the largest speed if there is none.
std::size_t first_speed_peak(const EvenTrial& trial, double prominence);

}  // namespace haptrace
