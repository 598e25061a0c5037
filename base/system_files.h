// Reading what the kernel says in files, which may not be there: /sys, /proc, configurations.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace haptrace::system_files {

/// A small file, plain or compressed by gzip, without the white space at its end. Nothing when it cannot be read.
std::optional<std::string> read_text(const std::filesystem::path& file);

/// What a folder holds, by name; nothing when it cannot be read.
std::vector<std::filesystem::path> entries(const std::filesystem::path& folder);

}  // namespace haptrace::system_files
