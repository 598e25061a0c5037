// Files of the page, embedded by the build. Private to view.
#pragma once

#include <span>
#include <string_view>

namespace haptrace {

/// A file that the server serves.
struct PageAsset {
  std::string_view path;  ///< "/app.js"; "/" for the page itself
  std::string_view type;  ///< value of Content-Type
  std::string_view content;
  bool compressed = false;  ///< `content` is gzip
};

/// Returns the files of the page; none in a build without it.
std::span<const PageAsset> page_assets() noexcept;

}  // namespace haptrace
