// A shared object for LD_PRELOAD: a disk that misbehaves, beneath HDF5 and everything else. It looks only at files
// whose path holds FAULT_PATH, and does what these variables say:
//   FAULT_ERRNO=E        the error of calls that fail (a number)
//   FAULT_ROOM=BYTES     the disk is full: nothing reaches beyond this offset, written or claimed; a write up to there
//   is
//                        cut short
//   FAULT_AFTER=BYTES    the disk is broken: once so many bytes were written, every call fails
//   FAULT_SYNC=1         it cannot be waited for: fsync and fdatasync fail
//   FAULT_CREATE=1       files cannot be created
//   FAULT_NO_CLAIM=1     room cannot be claimed (fallocate: EOPNOTSUPP)
//   FAULT_SHORT=BYTES    no write is longer than this
//   FAULT_INTERRUPT=1    every other write, claim and sync is interrupted (EINTR)
//   FAULT_DELAY_MS=MS    every write takes this long
//   FAULT_STALL_MS=MS    one write takes this long: the first after FAULT_STALL_AFTER bytes
#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <dlfcn.h>
#include <fcntl.h>
#include <unistd.h>

namespace {

std::int64_t number(const char* variable, std::int64_t otherwise) {
  const char* text = std::getenv(variable);
  return text == nullptr ? otherwise : std::atoll(text);
}

const char* const kPath = std::getenv("FAULT_PATH");
const int kError = static_cast<int>(number("FAULT_ERRNO", EIO));
const std::int64_t kRoom = number("FAULT_ROOM", INT64_MAX), kAfter = number("FAULT_AFTER", INT64_MAX),
                   kShort = number("FAULT_SHORT", INT64_MAX), kDelay = number("FAULT_DELAY_MS", 0),
                   kStall = number("FAULT_STALL_MS", 0), kStallAfter = number("FAULT_STALL_AFTER", 0);
const bool kSync = number("FAULT_SYNC", 0) != 0, kCreate = number("FAULT_CREATE", 0) != 0,
           kNoClaim = number("FAULT_NO_CLAIM", 0) != 0, kInterrupt = number("FAULT_INTERRUPT", 0) != 0;

std::atomic<std::int64_t> written{0}, calls{0};
std::atomic<bool> stalled{false};

template <class Function>
Function* next(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

bool ours(const char* path) {
  return kPath != nullptr && path != nullptr && std::strstr(path, kPath) != nullptr;
}

bool ours(int descriptor) {
  if (kPath == nullptr) return false;
  char link[64], path[4096];
  std::snprintf(link, sizeof link, "/proc/self/fd/%d", descriptor);
  const ssize_t length = readlink(link, path, sizeof path - 1);
  if (length < 0) return false;
  path[length] = '\0';
  return ours(path);
}

void wait(std::int64_t milliseconds) {
  timespec rest{.tv_sec = milliseconds / 1000, .tv_nsec = milliseconds % 1000 * 1'000'000};
  while (nanosleep(&rest, &rest) != 0 && errno == EINTR) {
  }
}

/// True when the call fails; errno says why.
bool fails(bool fault, bool may_be_interrupted = true) {
  if (kInterrupt && may_be_interrupted && calls.fetch_add(1) % 2 == 0) {
    errno = EINTR;
    return true;
  }
  if (fault || written.load() >= kAfter) {
    errno = kError;
    return true;
  }
  return false;
}

/// How much of a write of `count` bytes at `offset` may be done; -1: none, errno says why.
ssize_t allowed(std::int64_t count, std::int64_t offset) {
  if (kDelay > 0) wait(kDelay);
  if (kStall > 0 && written.load() >= kStallAfter && !stalled.exchange(true)) wait(kStall);
  if (fails(count > 0 && offset >= kRoom)) return -1;
  return std::min({count, kShort, kRoom - offset});
}

int claim(const char* call, int descriptor, int mode, off_t offset, off_t length) {
  if (ours(descriptor)) {
    if (kNoClaim) {
      errno = EOPNOTSUPP;
      return -1;
    }
    if (fails(offset + length > kRoom)) return -1;
  }
  return next<int(int, int, off_t, off_t)>(call)(descriptor, mode, offset, length);
}

int force(const char* call, int descriptor) {
  if (ours(descriptor) && fails(kSync)) return -1;
  return next<int(int)>(call)(descriptor);
}

int open_at(const char* call, const char* path, int flags, mode_t mode) {
  if ((flags & O_CREAT) != 0 && ours(path) && kCreate) {
    errno = kError;
    return -1;
  }
  return next<int(const char*, int, ...)>(call)(path, flags, mode);
}

ssize_t write_at(const char* call, int descriptor, const void* bytes, size_t count, off_t offset) {
  if (ours(descriptor)) {
    const ssize_t some = allowed(static_cast<std::int64_t>(count), offset);
    if (some < 0) return -1;
    written += some;
    count = static_cast<size_t>(some);
  }
  return next<ssize_t(int, const void*, size_t, off_t)>(call)(descriptor, bytes, count, offset);
}

mode_t mode_of(int flags, va_list arguments) {
  return (flags & (O_CREAT | O_TMPFILE)) != 0 ? static_cast<mode_t>(va_arg(arguments, int)) : 0;
}

}  // namespace

extern "C" {

ssize_t pwrite(int descriptor, const void* bytes, size_t count, off_t offset) {
  return write_at("pwrite", descriptor, bytes, count, offset);
}

ssize_t pwrite64(int descriptor, const void* bytes, size_t count, off_t offset) {
  return write_at("pwrite64", descriptor, bytes, count, offset);
}

ssize_t write(int descriptor, const void* bytes, size_t count) {
  if (ours(descriptor)) {
    const ssize_t some = allowed(static_cast<std::int64_t>(count), lseek(descriptor, 0, SEEK_CUR));
    if (some < 0) return -1;
    written += some;
    count = static_cast<size_t>(some);
  }
  return next<ssize_t(int, const void*, size_t)>("write")(descriptor, bytes, count);
}

int fallocate(int descriptor, int mode, off_t offset, off_t length) {
  return claim("fallocate", descriptor, mode, offset, length);
}

int fallocate64(int descriptor, int mode, off_t offset, off_t length) {
  return claim("fallocate64", descriptor, mode, offset, length);
}

int ftruncate(int descriptor, off_t length) noexcept {
  if (ours(descriptor) && fails(length > kRoom, false)) return -1;
  return next<int(int, off_t)>("ftruncate")(descriptor, length);
}

int fsync(int descriptor) {
  return force("fsync", descriptor);
}

int fdatasync(int descriptor) {
  return force("fdatasync", descriptor);
}

int open(const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = mode_of(flags, arguments);
  va_end(arguments);
  return open_at("open", path, flags, mode);
}

int open64(const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = mode_of(flags, arguments);
  va_end(arguments);
  return open_at("open64", path, flags, mode);
}

}  // extern "C"
