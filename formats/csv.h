// Paths as comma-separated values. Private to formats: load_path and save_path are the way in.
#pragma once

#include "control/path.h"

#include <string>

namespace haptrace {

/// Reads a path from CSV. The header names t,x,y,z and optionally vx,vy,vz and fx,fy,fz (s, m, m/s, N) in any order and
/// case; columns are separated by comma, semicolon or tab, whichever the header has. Other columns are left out with a
/// note. Comment lines (#) may stand before the header and blank lines at the end.
///
/// Throws Error(input) as "file:line: ...": no header or one that lacks a column, a row with too few or too many
/// columns, a field that is not a finite number, time that does not increase, no rows. Reads in blocks: memory is the
/// path's.
Path read_csv(const std::string& file);

/// Writes a path with as many digits as bring every number back exactly. Throws Error(input) like OutputFile, and when
/// the disk refuses.
void write_csv(const Path& path, const std::string& file, bool overwrite);

}  // namespace haptrace
