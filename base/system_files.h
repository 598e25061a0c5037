// Reading of system files that may be absent: /sys, /proc, configuration files.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace haptrace::system_files {

/// Returns the text of a small file, plain or compressed by gzip, without the white space at its end. Returns nothing
/// if the file cannot be read.
std::optional<std::string> read_text(const std::filesystem::path& file);

/// Returns the entries of a folder, sorted by name; none if the folder cannot be read.
std::vector<std::filesystem::path> entries(const std::filesystem::path& folder);

}  // namespace haptrace::system_files
