// Fewer samples of a path.
#pragma once

#include "formats/path/path_source.h"

#include <memory>

namespace haptrace {

inline constexpr int kMostThinning = 1'000'000;

/// Every `every`-th row of `path`, from the first on, and the last: what a path weighs and costs to prepare shrinks by
/// that much, what lies between the rows that stay is left to interpolation. 1 is the path itself. Velocities, forces
/// and orientations are those of the rows that stay. Reads the path once, for its figures, and again when it is asked.
/// Throws Error(input) unless `every` is 1 to kMostThinning.
std::shared_ptr<const PathSource> thinned(std::shared_ptr<const PathSource> path, int every);

}  // namespace haptrace
