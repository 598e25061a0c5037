// A short name for the content of a file.
#pragma once

#include <string>

namespace haptrace {

/// Returns the XXH3 (64 bits) of a file's bytes, as "xxh3:" and 16 hexadecimal digits. It tells versions of a file
/// apart; it is no protection against forgery. Throws Error(input) if the file cannot be read.
std::string file_hash(const std::string& file);

}  // namespace haptrace
