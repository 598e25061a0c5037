// Reading and writing paths: CSV and HDF5, told apart by their content.
#pragma once

#include "control/path/path.h"
#include "formats/path/csv_options.h"
#include "formats/path/path_source.h"

#include <string>

namespace haptrace {

/// Opens a recording (HDF5), or reads a CSV whose header names time and position (optionally velocity, force and
/// orientation): in s and m, or as `csv` or the file say (docs/file-format.md). What was assumed is among the notes.
/// See source_of() for what is taken of either, and what it costs.
///
/// Throws Error(input) naming the file and the row: missing, empty, not numeric, not finite, time that does not
/// increase, a size that can only be a unit mistake; `csv` that is not empty for a recording. Never changes the file.
std::shared_ptr<const PathSource> open_path(const std::string& file, const PathSelection& selection = {},
                                            const RowsDone& progress = {}, const CsvOptions& csv = {});

/// The whole of it in memory. Throws like open_path and PathSource::read.
Path load_path(const std::string& file, const CsvOptions& csv = {});

/// Writes a path as CSV (`.csv`) or as a recording (`.h5`) with `title` and `rate_hz` = its mean rate.
/// Refuses to replace a file unless `overwrite`.
void save_path(const Path& path, const std::string& file, const std::string& title, bool overwrite);

}  // namespace haptrace
