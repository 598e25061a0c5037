// Mark on a recording that is being written. Internal to haptrace.
#pragma once

#include <string>

namespace haptrace {

/// Marks the open file as being written, until its last descriptor is closed or the process dies. Live readers can
/// still open it; a program whose HDF5 would write to it cannot. A file system without such locks has no mark.
void mark_as_writer(int descriptor) noexcept;

/// Returns true if a running process has marked the file.
bool has_writer(const std::string& file) noexcept;

}  // namespace haptrace
