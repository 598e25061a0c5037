// A file that lost its end: an interrupted copy, a full stick. Private to formats.
#pragma once

#include "formats/recording/hdf5_support.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

namespace haptrace {

/// A copy of an HDF5 file that was cut off, with zeros in the place of what is missing, so that HDF5 opens it. The copy
/// loses its name as soon as it is open, and is gone with whoever has it open.
class CutFile {
 public:
  /// Nothing when the file is as long as its superblock says. Throws Error(input) when no copy can be made.
  static std::optional<CutFile> of(const std::string& file);

  [[nodiscard]] hdf5::File open();  ///< once. Throws what hdf5::open_to_read does
  [[nodiscard]] std::uint64_t present() const noexcept { return present_; }  ///< [bytes]
  [[nodiscard]] std::uint64_t whole() const noexcept { return whole_; }      ///< [bytes]

  /// Whether the bytes are there of rows [first, first + count) of a dataset in chunks of `chunk_rows`.
  [[nodiscard]] bool holds(const hdf5::Dataset& dataset, std::uint64_t first, std::uint64_t count,
                           std::uint64_t chunk_rows, std::size_t row_bytes) const;

 private:
  struct Remove {
    void operator()(std::string* name) const noexcept;
  };

  CutFile(std::string copy, std::uint64_t present, std::uint64_t whole);

  std::unique_ptr<std::string, Remove> copy_;  ///< its name, while it has one
  std::uint64_t present_, whole_;
};

}  // namespace haptrace
