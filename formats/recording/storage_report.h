// What storage costs and what rounding loses, measured on a file that was written.
#pragma once

#include "formats/recording/recording_stream.h"

namespace haptrace {

/// A dataset of /samples on the disk.
struct StoredColumn {
  std::string name, units;
  std::uint64_t raw_bytes = 0;     ///< of its values
  std::uint64_t stored_bytes = 0;  ///< on the disk
  double bytes_per_hour = 0;       ///< stored, of the recording's duration
  double rms_loss = 0;             ///< from the original's values, in `units`, component by component
  double max_loss = 0;
};

/// Reads `file` (HDF5) back beside `original`, whose samples were written to it, from the first on. Columns of whole
/// numbers have no loss. Throws Error(input): damaged, other rows than the original.
std::vector<StoredColumn> report_storage(const std::string& file, RecordingSource& original);

}  // namespace haptrace
