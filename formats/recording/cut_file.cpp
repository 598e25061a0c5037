#include "formats/recording/cut_file.h"

#include "base/descriptor.h"
#include "base/error.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <sys/sendfile.h>
#include <unistd.h>

namespace haptrace {
namespace {

namespace fs = std::filesystem;

/// Creates the copy beside the file if possible, since a disk that holds the file probably has room for it twice;
/// otherwise in the temporary folder. Sets `name` to its name.
int create_copy(const std::string& file, std::string& name) {
  std::error_code error;
  const fs::path folder = fs::path(file).has_parent_path() ? fs::path(file).parent_path() : fs::path(".");
  for (const fs::path& place : {folder, fs::temp_directory_path(error)}) {
    name = (place / ".haptrace-cut-XXXXXX").string();
    if (const int made = mkostemp(name.data(), O_CLOEXEC); made >= 0) return made;
  }
  return -1;
}

}  // namespace

void CutFile::Remove::operator()(std::string* name) const noexcept {
  unlink(name->c_str());
  delete name;
}

CutFile::CutFile(std::string copy, std::uint64_t present, std::uint64_t whole)
    : copy_(new std::string(std::move(copy))), present_(present), whole_(whole) {}

std::optional<CutFile> CutFile::of(const std::string& file) {
  std::error_code error;
  const std::uint64_t present = fs::file_size(file, error);
  const std::optional<std::uint64_t> whole = hdf5::stored_end(file);
  if (error || !whole || present >= *whole) return std::nullopt;
  const auto refuse = [&] {
    return input_error(
        fmt::format("{}: is cut off, and its remaining data cannot be copied: {}", file, strerror(errno)));
  };
  const Descriptor from(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  if (!from) throw refuse();
  std::string name;
  const Descriptor to(create_copy(file, name));
  if (!to) throw refuse();
  CutFile copy(name, present, *whole);
  for (std::uint64_t done = 0; done < present;) {
    const ssize_t count = sendfile(to.get(), from.get(), nullptr, present - done);
    if (count < 0) throw refuse();
    if (count == 0) break;
    done += static_cast<std::uint64_t>(count);
  }
  if (ftruncate(to.get(), static_cast<off_t>(*whole)) != 0) throw refuse();
  return copy;
}

hdf5::File CutFile::open() {
  hdf5::File file = hdf5::open_to_read(*copy_, false);
  copy_.reset();
  return file;
}

bool CutFile::holds(const hdf5::Dataset& dataset, std::uint64_t first, std::uint64_t count, std::uint64_t chunk_rows,
                    std::size_t row_bytes) const {
  const std::uint64_t end = first + count;
  for (std::uint64_t begin = first / chunk_rows * chunk_rows; begin < end; begin += chunk_rows) {
    const std::array<hsize_t, 2> offset{begin, 0};
    unsigned skipped = 0;
    haddr_t address = HADDR_UNDEF;
    hsize_t bytes = 0;
    if (H5Dget_chunk_info_by_coord(dataset.get(), offset.data(), &skipped, &address, &bytes) < 0) return false;
    if (address == HADDR_UNDEF) return false;
    // A compressed chunk is only useful as a whole.
    const std::uint64_t needed =
        bytes == chunk_rows * row_bytes ? (std::min(end, begin + chunk_rows) - begin) * row_bytes : bytes;
    if (address + needed > present_) return false;
  }
  return true;
}

}  // namespace haptrace
