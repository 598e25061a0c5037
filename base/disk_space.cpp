#include "base/disk_space.h"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

namespace haptrace {

DiskSpace disk_space(const std::string& path) noexcept {
  struct statvfs status {};
  if (statvfs(path.c_str(), &status) != 0) return {};
  return {.free = std::uint64_t{status.f_bavail} * status.f_frsize,
          .total = std::uint64_t{status.f_blocks} * status.f_frsize};
}

Reserve::Reserve(int descriptor, std::uint64_t largest)
    : descriptor_(fcntl(descriptor, F_DUPFD_CLOEXEC, 0)), ahead_(2 * (kBookkeeping + largest)) {}

Reserve::~Reserve() {
  struct stat status {};
  if (fstat(descriptor_, &status) == 0 && ftruncate(descriptor_, status.st_size) != 0) errno = 0;
  ::close(descriptor_);
}

std::string Reserve::claim(std::uint64_t end) {
  if (end + ahead_ / 2 <= claimed_) return {};
  if (std::string refusal = process_limit(end + ahead_); !refusal.empty()) return refusal;
  while (fallocate(descriptor_, FALLOC_FL_KEEP_SIZE, static_cast<off_t>(end), static_cast<off_t>(ahead_)) != 0) {
    if (errno == EINTR) continue;
    // Some file systems cannot reserve space. On these, HDF5 itself finds that the disk is full.
    if (errno != ENOSPC && errno != EDQUOT && errno != EFBIG && errno != EIO) break;
    return std::strerror(errno);
  }
  claimed_ = end + ahead_;
  return {};
}

std::string Reserve::process_limit(std::uint64_t bytes) {
  rlimit limit{};
  if (getrlimit(RLIMIT_FSIZE, &limit) != 0 || bytes <= limit.rlim_cur) return {};
  return fmt::format("files of this process may have {} bytes at most (ulimit -f)", limit.rlim_cur);
}

}  // namespace haptrace
