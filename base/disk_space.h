// Room on a disk: how much there is, and claiming it ahead. Private to formats and recorder.
#pragma once

#include <cstdint>
#include <string>

namespace haptrace {

/// Room in the file system that holds `path`.
struct DiskSpace {
  std::uint64_t free = 0;   ///< for this user [bytes]
  std::uint64_t total = 0;  ///< [bytes]
};

/// All zero when the file system does not say. Costs a microsecond; any thread.
DiskSpace disk_space(const std::string& path) noexcept;

/// Disk space claimed beyond the end of a file. A disk that fills up refuses the claim, and no write of HDF5's: the
/// recording ends in good order with everything in it.
class Reserve {
 public:
  /// Keeps a descriptor of its own for the open file. `largest` is the most that is written between two claims, without
  /// HDF5's own bookkeeping [bytes].
  Reserve(int descriptor, std::uint64_t largest);
  ~Reserve();  ///< what was claimed in vain goes back to the disk
  Reserve(const Reserve&) = delete;
  Reserve& operator=(const Reserve&) = delete;

  /// Sees to it that the file, now `end` bytes long, can grow. The reason why not, or empty.
  std::string claim(std::uint64_t end);

  [[nodiscard]] int descriptor() const noexcept { return descriptor_; }

  /// Why this process may not have a file of `bytes`, or empty.
  static std::string process_limit(std::uint64_t bytes);

  static constexpr std::uint64_t kBookkeeping = 1 << 20;  ///< room for HDF5's own [bytes]

 private:
  int descriptor_;
  std::uint64_t ahead_;  ///< claimed at once; half of it always remains
  std::uint64_t claimed_ = 0;
};

}  // namespace haptrace
