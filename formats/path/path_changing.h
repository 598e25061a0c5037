// Paths in another place.
#pragma once

#include "control/path/path_change.h"
#include "formats/path/path_source.h"

#include <memory>

namespace haptrace {

/// Returns the similarity of `change` for a path. Throws Error(input) like PathChange::of and PathSource::read.
Similarity similarity_of(const PathChange& change, const PathSource& path);

/// Returns `path` after the change: positions, velocities, forces and orientations. The identity returns the path
/// itself. Reads the whole path once for its bounds, unless every axis becomes an axis again.
std::shared_ptr<const PathSource> changed(std::shared_ptr<const PathSource> path, const Similarity& change);

}  // namespace haptrace
