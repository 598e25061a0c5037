// Decompression of embedded files. Private to view.
#pragma once

#include <string>
#include <string_view>

namespace haptrace {

/// Returns the content of a gzip stream. Throws std::runtime_error if it is damaged.
std::string gunzip(std::string_view compressed);

}  // namespace haptrace
