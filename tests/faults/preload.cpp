// Library for LD_PRELOAD that simulates a faulty disk below HDF5 and all other code. It affects only files whose path
// contains FAULT_PATH. Variables:
//   FAULT_ERRNO=E        error number of failing calls
//   FAULT_ROOM=BYTES     the disk is full: no write or reservation goes beyond this offset; a write across it is cut
//                        short. Once one file has reached it, there is no room for any other
//   FAULT_AFTER=BYTES    the disk is broken: after this many bytes written, every call fails
//   FAULT_BACK_MS=MS     the two faults above end this long after they first occurred
//   FAULT_SYNC=1         fsync and fdatasync fail
//   FAULT_CREATE=1       files cannot be created
//   FAULT_NO_CLAIM=1     space cannot be reserved (fallocate: EOPNOTSUPP)
//   FAULT_SHORT=BYTES    no write is longer than this
//   FAULT_INTERRUPT=1    every second write, reservation and sync is interrupted (EINTR)
//   FAULT_DELAY_MS=MS    every write takes this long
//   FAULT_STALL_MS=MS    one write takes this long: the first after FAULT_STALL_AFTER bytes
//   FAULT_TORN=N         the process is killed (SIGKILL) within a write: the N-th write that spans two pages of memory
//                        ends at the end of the first page, as the kernel does it
//   FAULT_COPY=FILE      another program copies FILE over the file, like cp, before the first read after
//                        FAULT_COPY_AFTER bytes. A writer reads before a series of writes, not within one
#include <algorithm>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

namespace {

constexpr size_t kPage = 4096;

std::int64_t number(const char* variable, std::int64_t otherwise) {
  const char* text = std::getenv(variable);
  return text == nullptr ? otherwise : std::atoll(text);
}

const char* const kPath = std::getenv("FAULT_PATH");
const int kError = static_cast<int>(number("FAULT_ERRNO", EIO));
const std::int64_t kRoom = number("FAULT_ROOM", INT64_MAX), kAfter = number("FAULT_AFTER", INT64_MAX),
                   kShort = number("FAULT_SHORT", INT64_MAX), kDelay = number("FAULT_DELAY_MS", 0),
                   kBack = number("FAULT_BACK_MS", INT64_MAX), kStall = number("FAULT_STALL_MS", 0),
                   kStallAfter = number("FAULT_STALL_AFTER", 0), kCopyAfter = number("FAULT_COPY_AFTER", 0);
const std::int64_t kTorn = number("FAULT_TORN", 0);
const char* const kCopy = std::getenv("FAULT_COPY");
const bool kSync = number("FAULT_SYNC", 0) != 0, kCreate = number("FAULT_CREATE", 0) != 0,
           kNoClaim = number("FAULT_NO_CLAIM", 0) != 0, kInterrupt = number("FAULT_INTERRUPT", 0) != 0;

std::atomic<std::int64_t> written{0}, calls{0}, in_two_pages{0};
std::atomic<bool> stalled{false}, copied{false};
std::atomic<ino_t> full{0};        ///< file that reached FAULT_ROOM
std::atomic<std::int64_t> met{0};  ///< time of the first fault that may end [ms]

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

/// Returns whether a fault continues; the first call marks its start.
bool goes_on() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  const std::int64_t ms = std::int64_t{1000} * now.tv_sec + now.tv_nsec / 1'000'000;
  std::int64_t none = 0;
  met.compare_exchange_strong(none, ms);
  return ms - met.load() < kBack;
}

/// Returns the largest allowed size of this file [bytes].
std::int64_t room_of(int descriptor, std::int64_t end) {
  if (kRoom == INT64_MAX) return kRoom;
  struct stat status {};
  if (fstat(descriptor, &status) != 0) return kRoom;
  ino_t none = 0;
  if (end > kRoom) full.compare_exchange_strong(none, status.st_ino);
  const ino_t met_by = full.load();
  if (met_by == 0 || !goes_on()) return met_by == 0 ? kRoom : INT64_MAX;
  return met_by == status.st_ino ? kRoom : 0;
}

/// Returns true and sets errno if the call fails.
bool fails(bool fault, bool may_be_interrupted = true) {
  if (kInterrupt && may_be_interrupted && calls.fetch_add(1) % 2 == 0) {
    errno = EINTR;
    return true;
  }
  if (fault || (written.load() >= kAfter && goes_on())) {
    errno = kError;
    return true;
  }
  return false;
}

/// Returns how many of `count` bytes may be written at `offset`, or -1 with errno set.
ssize_t allowed(int descriptor, std::int64_t count, std::int64_t offset) {
  if (kDelay > 0) wait(kDelay);
  if (kStall > 0 && written.load() >= kStallAfter && !stalled.exchange(true)) wait(kStall);
  const std::int64_t room = room_of(descriptor, offset + count);
  if (fails(count > 0 && offset >= room)) return -1;
  return std::min({count, kShort, room - offset});
}

int claim(const char* call, int descriptor, int mode, off_t offset, off_t length) {
  if (ours(descriptor)) {
    if (kNoClaim) {
      errno = EOPNOTSUPP;
      return -1;
    }
    if (fails(offset + length > room_of(descriptor, offset + length))) return -1;
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
    const ssize_t some = allowed(descriptor, static_cast<std::int64_t>(count), offset);
    if (some < 0) return -1;
    written += some;
    count = static_cast<size_t>(some);
    const size_t first = kPage - static_cast<size_t>(offset) % kPage;
    if (kTorn > 0 && count > first && in_two_pages.fetch_add(1) + 1 == kTorn) {
      if (next<ssize_t(int, const void*, size_t, off_t)>(call)(descriptor, bytes, first, offset) >= 0)
        std::raise(SIGKILL);
    }
  }
  return next<ssize_t(int, const void*, size_t, off_t)>(call)(descriptor, bytes, count, offset);
}

void copy_over(int descriptor) {
  char link[64], bytes[4096];
  std::snprintf(link, sizeof link, "/proc/self/fd/%d", descriptor);
  const int to = next<int(const char*, int, ...)>("open")(link, O_WRONLY | O_TRUNC);
  const int from = next<int(const char*, int, ...)>("open")(kCopy, O_RDONLY);
  for (ssize_t count; (count = read(from, bytes, sizeof bytes)) > 0;)
    if (next<ssize_t(int, const void*, size_t)>("write")(to, bytes, static_cast<size_t>(count)) != count) std::abort();
  close(from);
  close(to);
}

ssize_t read_at(const char* call, int descriptor, void* bytes, size_t count, off_t offset) {
  if (kCopy != nullptr && written.load() >= kCopyAfter && ours(descriptor) && !copied.exchange(true))
    copy_over(descriptor);
  return next<ssize_t(int, void*, size_t, off_t)>(call)(descriptor, bytes, count, offset);
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

ssize_t pread(int descriptor, void* bytes, size_t count, off_t offset) {
  return read_at("pread", descriptor, bytes, count, offset);
}

ssize_t pread64(int descriptor, void* bytes, size_t count, off_t offset) {
  return read_at("pread64", descriptor, bytes, count, offset);
}

ssize_t write(int descriptor, const void* bytes, size_t count) {
  if (ours(descriptor)) {
    const ssize_t some = allowed(descriptor, static_cast<std::int64_t>(count), lseek(descriptor, 0, SEEK_CUR));
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
  if (ours(descriptor) && fails(length > room_of(descriptor, length), false)) return -1;
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
