// Figures of a recording: its path in space, and its quantities over time.
#pragma once

#include "control/path/path.h"
#include "formats/recording/recording.h"
#include "plot/figure.h"

#include <cstdint>
#include <functional>
#include <string>

namespace haptrace {

/// Draws the path in the plane of its two largest extents (and in a second plane if the third extent is significant),
/// with the reference if there is one, and the proxy of contacts with virtual objects; deviation over time (without a
/// reference, position); force over time; and the depth of contacts. The memory does not grow with the length of the
/// recording, and thinning keeps every extreme, over time and in space. The function reads all rows and reports their
/// number to `progress`.
Figure figure_of(const RecordingReader& reader, const std::string& title,
                 const std::function<void(std::uint64_t)>& progress = {});

/// Draws a path in space, and its position and speed over time.
Figure figure_of(const Path& path);

}  // namespace haptrace
