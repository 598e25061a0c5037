#include "base/system_files.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <memory>
#include <zlib.h>

namespace haptrace::system_files {

namespace fs = std::filesystem;

std::optional<std::string> read_text(const fs::path& file) {
  const std::unique_ptr<gzFile_s, int (*)(gzFile)> stream(gzopen(file.c_str(), "rb"), gzclose);
  if (!stream) return {};
  constexpr std::size_t kMost = 16U << 20U;
  std::string text;
  std::array<char, 4096> buffer{};
  int count = 0;
  while ((count = gzread(stream.get(), buffer.data(), buffer.size())) > 0 && text.size() < kMost)
    text.append(buffer.data(), static_cast<std::size_t>(count));
  if (count < 0) return {};
  while (!text.empty() && std::isspace(static_cast<unsigned char>(text.back())) != 0) text.pop_back();
  return text;
}

std::vector<fs::path> entries(const fs::path& folder) {
  std::vector<fs::path> found;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error))
    found.push_back(entry->path());
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace haptrace::system_files
