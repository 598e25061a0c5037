// Reading and writing of paths as CSV and HDF5.
#pragma once

#include "control/path/path.h"
#include "formats/documents/radius_profile.h"
#include "formats/path/csv_options.h"
#include "formats/path/path_source.h"

#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// Opens a recording (HDF5), or reads a CSV file whose header names time and position (optionally velocity, force and
/// orientation). Values are in s and m, unless `csv` or the file says otherwise (docs/file-format.md). The notes list
/// all assumptions. source_of() states which part of either is the path, and the cost.
///
/// Throws Error(input) naming the file and the row if the file is missing or empty, a value is not a number or not
/// finite, time does not increase, the size can only be a unit mistake, or `csv` is not empty for a recording. Never
/// changes the file.
std::shared_ptr<const PathSource> open_path(const std::string& file, const PathSelection& selection = {},
                                            const RowsDone& progress = {}, const CsvOptions& csv = {});

/// Reads a whole path into memory. Throws like open_path and PathSource::read.
Path load_path(const std::string& file, const CsvOptions& csv = {});

/// Columns and metadata that an average of several recordings adds to its path. Only a recording (`.h5`) can hold it.
struct AverageColumns {
  std::vector<double> radius;       ///< 95 % radius of the copies at each row [m]
  std::string copies;               ///< their names, for users
  std::vector<StoredEvent> events;  ///< the pauses of the copies
  RecordedScene scene;              ///< of the copies, if their forces hold its contacts
};

/// Writes a path as CSV (`.csv`) or as a recording (`.h5`) with `title` and `rate_hz` = its mean rate.
/// Refuses to replace a file unless `overwrite`. Throws Error(input) also if there is an `average` and the file is no
/// recording.
void save_path(const Path& path, const std::string& file, const std::string& title, bool overwrite,
               const AverageColumns* average = nullptr);

/// Returns the 95 % radius along the part of an averaged path that `facts` describe. Returns nothing if `file` is not
/// the average of several recordings: the tunnel of a guided session is not a spread. Throws like RecordingReader.
std::optional<RadiusProfile> averaged_radius(const std::string& file, const PathFacts& facts);

}  // namespace haptrace
