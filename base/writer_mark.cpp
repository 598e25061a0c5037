#include "base/writer_mark.h"

#include <fcntl.h>
#include <limits>
#include <sys/file.h>
#include <unistd.h>

namespace haptrace {
namespace {

/// Returns a lock on a byte that no file reaches. Only haptrace uses this lock; HDF5 does not know it.
struct flock far_byte(short type) {
  struct flock lock {};
  lock.l_type = type;
  lock.l_whence = SEEK_SET;
  lock.l_start = std::numeric_limits<off_t>::max() - 1;
  lock.l_len = 1;
  return lock;
}

}  // namespace

void mark_as_writer(int descriptor) noexcept {
  struct flock lock = far_byte(F_WRLCK);
  (void)fcntl(descriptor, F_OFD_SETLK, &lock);
  // HDF5 releases its own lock when it admits live readers. This shared lock keeps out other writers, and only them.
  (void)::flock(descriptor, LOCK_SH | LOCK_NB);
}

bool has_writer(const std::string& file) noexcept {
  const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return false;
  struct flock lock = far_byte(F_RDLCK);
  const bool locked = fcntl(descriptor, F_OFD_GETLK, &lock) == 0 && lock.l_type != F_UNLCK;
  ::close(descriptor);
  return locked;
}

}  // namespace haptrace
