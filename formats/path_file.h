// Reading and writing paths: CSV and HDF5, told apart by their content.
#pragma once

#include "control/path.h"

#include <string>

namespace haptrace {

/// Reads a path from a recording (HDF5) or from CSV with a header naming at least t,x,y,z (s, m; optionally
/// vx,vy,vz,fx,fy,fz). Of a recording that holds a played session, phase run only when any sample has it.
///
/// Throws Error(input) naming the file and the row: missing, empty, not numeric, not finite, time that does not
/// increase, a size that can only be a unit mistake. Never changes the file.
Path load_path(const std::string& file);

/// Writes a path as CSV (`.csv`) or as a recording (`.h5`) with `title` and `rate_hz` = its mean rate.
/// Refuses to replace a file unless `overwrite`.
void save_path(const Path& path, const std::string& file, const std::string& title, bool overwrite);

}  // namespace haptrace
