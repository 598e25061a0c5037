// Playback below a speed limit: time is stretched where a path is too fast.
#pragma once

#include "control/path/path.h"
#include "formats/path/path_stretching.h"

#include <string>

namespace haptrace {

class TrajectoryPieces;

/// Largest factor by which a playback stretches time. A path that needs more has the wrong unit or a jump.
inline constexpr double kMostStretch = 10;

/// Returns the stretch that keeps a trajectory below `limit` [m/s], in the trajectory's time. Beside a place that is
/// too fast, the factor falls over `ramp` [s], so that the reference slows down and speeds up softly. Reads the whole
/// path.
TimeStretch stretch_below(const TrajectoryPieces& pieces, double limit, double ramp);

/// Returns where and by how much time is stretched, for users: "from 1.20 to 1.52 s by up to 1.8"; empty for nowhere.
std::string describe(const TimeStretch& stretch);

}  // namespace haptrace
