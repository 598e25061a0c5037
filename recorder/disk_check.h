// Check whether a folder's disk is fast enough for a recording.
#pragma once

#include "base/histogram.h"
#include "devices/check/doctor.h"

#include <string>
#include <vector>

namespace haptrace {

/// Speed and free space of a folder's disk, measured with the recorder's writer.
struct DiskMeasurement {
  std::string folder;
  double flush_period = 0.1;               ///< session time in every write [s]
  DurationHistogram write;                 ///< time to write the samples of a flush period
  DurationHistogram sync;                  ///< time to force them to the disk afterwards (fdatasync)
  double write_total = 0, sync_total = 0;  ///< [s]
  double bytes_per_hour = 0;
  double free_bytes = 0;  ///< for this user

  [[nodiscard]] double hours() const noexcept { return bytes_per_hour > 0 ? free_bytes / bytes_per_hour : 0; }
};

/// Writes 20 s of a recording at `rate_hz` into `folder` with the recorder's own writer, as fast as possible but for at
/// most 5 s. Flushes the file and forces it to the disk after every 0.1 s of samples. Removes the file afterwards.
/// Throws Error(input) if the file cannot be created, Error(fault) if it cannot be written.
DiskMeasurement measure_disk(const std::string& folder, double rate_hz);

/// Judges a measurement. `patience` is the time for which the recorder's ring bridges a disk that stalls [s].
std::vector<Diagnosis> examine_disk(const DiskMeasurement& disk, double patience);

}  // namespace haptrace
