// What is in a recording, in figures.
#pragma once

#include "control/path.h"
#include "formats/recording.h"

#include <functional>

namespace haptrace {

/// Figures of a whole recording, gathered in one pass.
struct RecordingSummary {
  std::uint64_t rows = 0;
  double duration = 0;          ///< first to last sample [s]
  double mean_rate = 0;         ///< [Hz]
  std::uint64_t gaps = 0;       ///< places where the tick jumps
  std::uint64_t missed = 0;     ///< ticks that are not there
  double longest_interval = 0;  ///< between two samples [s]
  Box bounds;                   ///< of the positions [m]
  double path_length = 0;       ///< of the positions as recorded, their noise included [m]
  double max_force = 0;         ///< largest magnitude sent [N]
  std::uint64_t tracked = 0;    ///< rows of phase run that have a reference
  double rms_error = kNaN;      ///< over those, 3-D [m]
  double peak_error = kNaN;     ///< [m]
};

/// Calls `visit` with consecutive blocks of rows: memory stays flat in the length of the recording.
void for_each_block(const RecordingReader& reader, const std::function<void(std::span<const Sample>)>& visit);

RecordingSummary summarise(const RecordingReader& reader);

}  // namespace haptrace
