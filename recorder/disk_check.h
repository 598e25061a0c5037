// Is a folder's disk fast enough for a recording?
#pragma once

#include "base/histogram.h"
#include "devices/check/doctor.h"

#include <string>
#include <vector>

namespace haptrace {

/// A folder as the recorder's writer finds it.
struct DiskMeasurement {
  std::string folder;
  double flush_period = 0.1;               ///< of the session's time that every write holds [s]
  DurationHistogram write;                 ///< of the rows of a flush period
  DurationHistogram sync;                  ///< forcing them to the disk (fdatasync) afterwards
  double write_total = 0, sync_total = 0;  ///< [s]
  double bytes_per_hour = 0;
  double free_bytes = 0;  ///< for this user

  [[nodiscard]] double hours() const noexcept { return bytes_per_hour > 0 ? free_bytes / bytes_per_hour : 0; }
};

/// Writes 20 s of a recording at `rate_hz` into `folder` by the recorder's own writer, as fast as it goes but for 5 s
/// at most, flushed and then forced to the disk after every 0.1 s of samples. The file has no name and leaves nothing
/// behind. Throws Error(input) when it cannot be created, Error(fault) when it cannot be written.
DiskMeasurement measure_disk(const std::string& folder, double rate_hz);

/// `patience` is how long the recorder's ring bridges a disk that stalls [s].
std::vector<Diagnosis> examine_disk(const DiskMeasurement& disk, double patience);

}  // namespace haptrace
