// Measurement of a written file's storage size and of its rounding errors.
#pragma once

#include "formats/recording/recording_stream.h"

namespace haptrace {

/// A dataset of /samples on the disk.
struct StoredColumn {
  std::string name, units;
  std::uint64_t raw_bytes = 0;     ///< size of its values
  std::uint64_t stored_bytes = 0;  ///< size on the disk
  double bytes_per_hour = 0;       ///< stored bytes per hour of the recording
  double rms_loss = 0;             ///< RMS difference from the original's values, by component, in `units`
  double max_loss = 0;
};

/// Reads `file` (HDF5) and compares it with `original`, whose samples were written to it. Only float64 columns can have
/// a loss. Throws Error(input) if the file is damaged or has fewer rows than the original.
std::vector<StoredColumn> report_storage(const std::string& file, RecordingSource& original);

}  // namespace haptrace
