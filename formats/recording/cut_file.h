// Files that lost their end, for example by an interrupted copy or a full USB stick. Private to formats.
#pragma once

#include "formats/recording/hdf5_support.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

namespace haptrace {

/// A copy of a truncated HDF5 file, with zeros for the missing bytes, so that HDF5 can open it. The copy loses its name
/// as soon as it is open, and disappears when it is closed.
class CutFile {
 public:
  /// Copies the file. Returns nothing if it is as long as its superblock states. Throws Error(input) if the copy fails.
  static std::optional<CutFile> of(const std::string& file);

  [[nodiscard]] hdf5::File open();  ///< call once; throws like hdf5::open_to_read
  [[nodiscard]] std::uint64_t present() const noexcept { return present_; }  ///< [bytes]
  [[nodiscard]] std::uint64_t whole() const noexcept { return whole_; }      ///< [bytes]

  /// Returns true if the file has the bytes of rows [first, first + count) of a dataset with chunks of `chunk_rows`
  /// rows.
  [[nodiscard]] bool holds(const hdf5::Dataset& dataset, std::uint64_t first, std::uint64_t count,
                           std::uint64_t chunk_rows, std::size_t row_bytes) const;

 private:
  struct Remove {
    void operator()(std::string* name) const noexcept;
  };

  CutFile(std::string copy, std::uint64_t present, std::uint64_t whole);

  std::unique_ptr<std::string, Remove> copy_;  ///< name of the copy until it is open
  std::uint64_t present_, whole_;
};

}  // namespace haptrace
