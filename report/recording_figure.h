// A recording as a picture: the path in space, and what happened over time.
#pragma once

#include "control/path/path.h"
#include "formats/recording/recording.h"
#include "plot/figure.h"

#include <cstdint>
#include <functional>
#include <string>

namespace haptrace {

/// Panels: the path in the plane of its two largest extents (and a second plane when the third counts), with the
/// reference where there is one; deviation over time (position where there is no reference); force over time.
/// Memory is flat in the recording's length, and no extreme is lost, neither over time nor in space. All rows are read,
/// and told to `progress` as they are.
Figure figure_of(const RecordingReader& reader, const std::string& title,
                 const std::function<void(std::uint64_t)>& progress = {});

/// A path as a picture: in space, and position and speed over time.
Figure figure_of(const Path& path);

}  // namespace haptrace
