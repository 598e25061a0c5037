// Who is writing a recording. Private to formats.
#pragma once

#include <string>

namespace haptrace {

/// Marks the open file as being written, until its last descriptor is closed or the process dies. Live readers are not
/// kept out; programs whose HDF5 would write to it are. File systems without such locks go without.
void mark_as_writer(int descriptor) noexcept;

/// True when a living process has marked the file.
bool has_writer(const std::string& file) noexcept;

}  // namespace haptrace
