// Reading and writing paths: CSV and HDF5, told apart by their content.
#pragma once

#include "control/path.h"
#include "formats/path_source.h"

#include <string>

namespace haptrace {

/// Opens a recording (HDF5), or reads a CSV with a header naming at least t,x,y,z (s, m; optionally vx,vy,vz,fx,fy,fz).
/// See source_of() for what is taken of either, and what it costs.
///
/// Throws Error(input) naming the file and the row: missing, empty, not numeric, not finite, time that does not
/// increase, a size that can only be a unit mistake. Never changes the file.
std::shared_ptr<const PathSource> open_path(const std::string& file, const PathSelection& selection = {},
                                            const RowsDone& progress = {});

/// The whole of it in memory. Throws like open_path and PathSource::read.
Path load_path(const std::string& file);

/// Writes a path as CSV (`.csv`) or as a recording (`.h5`) with `title` and `rate_hz` = its mean rate.
/// Refuses to replace a file unless `overwrite`.
void save_path(const Path& path, const std::string& file, const std::string& title, bool overwrite);

}  // namespace haptrace
