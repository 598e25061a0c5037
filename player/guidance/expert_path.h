// Expert's paths as guidance follows them.
#pragma once

#include "control/path/arc_path.h"
#include "formats/path/path_source.h"

#include <functional>
#include <memory>
#include <optional>

namespace haptrace {

/// Receives the time since the start of a path [s], the position [m] and the force [N], zero if the path has none.
using PathVisitor = std::function<void(double time, const Vec3& position, const Vec3& force)>;

/// Visits a path at every millisecond and at its end, smoothed like the reference of a playback. `smoothing`: time
/// constant [s]; absent: chosen from the path's noise. Reads the path piece by piece. Throws like TrajectoryPieces.
void visit_path(const std::shared_ptr<const PathSource>& source, std::optional<double> smoothing,
                const PathVisitor& visit);

/// Returns a path by arc length, smoothed like visit_path(), with the same tunnel radius [m] everywhere. `spacing`:
/// spacing of its knots [m]; absent: ArcPath::spacing_for. Throws like visit_path().
ArcPath expert_path(const std::shared_ptr<const PathSource>& source, std::optional<double> smoothing,
                    std::optional<double> spacing, double radius);

}  // namespace haptrace
