// Reduction of a path's samples.
#pragma once

#include "formats/path/path_source.h"

#include <memory>

namespace haptrace {

inline constexpr int kMostThinning = 1'000'000;

/// Returns every `every`-th row of `path`, from the first on, and the last one. Memory and preparation time fall by
/// that factor; interpolation fills in between the remaining rows. 1 returns the path itself. Velocities, forces and
/// orientations are those of the remaining rows. Reads the path once for its statistics, and again on request. Throws
/// Error(input) unless `every` is 1 to kMostThinning.
std::shared_ptr<const PathSource> thinned(std::shared_ptr<const PathSource> path, int every);

}  // namespace haptrace
