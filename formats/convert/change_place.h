// Recordings in another place: mirrored, rotated, scaled and moved.
#pragma once

#include "control/path/path_change.h"
#include "formats/recording/recording_stream.h"

#include <memory>
#include <string>

namespace haptrace {

/// Changes every column that is expressed in W: positions, velocities, forces, torques, orientations, references and
/// contacts. Lengths (progress, radius, depth) are scaled. A scene in the header is left out, since it stays where it
/// was. `description` is stored as metadata, after that of an earlier change. The result has its own uuid.
std::unique_ptr<RecordingSource> change_place(std::unique_ptr<RecordingSource> source, const Similarity& change,
                                              const std::string& description);

}  // namespace haptrace
