// Free space on a disk, and its reservation ahead of writing. Private to formats and recorder.
#pragma once

#include <cstdint>
#include <string>

namespace haptrace {

/// Space in a file system.
struct DiskSpace {
  std::uint64_t free = 0;   ///< available to this user [bytes]
  std::uint64_t total = 0;  ///< [bytes]
};

/// Returns the space in the file system that holds `path`, or zeros if the file system does not report it. Takes a
/// microsecond; any thread may call it.
DiskSpace disk_space(const std::string& path) noexcept;

/// Reserves disk space beyond the end of a file. When the disk fills up, the reservation fails instead of a write by
/// HDF5, so that the recording ends in good order with all its samples.
class Reserve {
 public:
  /// Duplicates the descriptor of the open file. `largest` is the most data written between two claims, without HDF5's
  /// own bookkeeping [bytes].
  Reserve(int descriptor, std::uint64_t largest);
  ~Reserve();  ///< releases the space that was reserved but not used
  Reserve(const Reserve&) = delete;
  Reserve& operator=(const Reserve&) = delete;

  /// Makes sure that the file, now `end` bytes long, can grow. Returns the reason for a failure, or an empty text.
  std::string claim(std::uint64_t end);

  [[nodiscard]] int descriptor() const noexcept { return descriptor_; }

  /// Returns the reason why this process may not write a file of `bytes`, or an empty text.
  static std::string process_limit(std::uint64_t bytes);

  static constexpr std::uint64_t kBookkeeping = 1 << 20;  ///< space for HDF5's own bookkeeping [bytes]

 private:
  int descriptor_;
  std::uint64_t ahead_;  ///< space reserved at a time, of which half always remains [bytes]
  std::uint64_t claimed_ = 0;
};

}  // namespace haptrace
