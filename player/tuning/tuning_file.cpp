#include "player/tuning/tuning_file.h"

#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <mutex>
#include <sstream>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

namespace haptrace {
namespace {

constexpr auto kLookPeriod = std::chrono::milliseconds(100);
constexpr std::size_t kLargestFile = 64U << 10U;  // bytes

/// Reads the beginning of a file, at most kLargestFile + 1 bytes. Returns 0 or the errno of the failure; does not
/// throw.
int read_beginning(const std::string& file, std::string& text) {
  const int fd = open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) return errno;
  struct stat status {};
  int error = fstat(fd, &status) != 0 ? errno : S_ISREG(status.st_mode) ? 0 : EINVAL;
  // Any user who can write the file moves a motor.
  const bool others = (status.st_mode & S_IWOTH) != 0 || (status.st_uid != geteuid() && status.st_uid != 0) ||
                      ((status.st_mode & S_IWGRP) != 0 && status.st_gid != getegid());
  if (error == 0 && others) error = EPERM;
  text.resize(kLargestFile + 1);
  std::size_t size = 0;
  while (error == 0 && size < text.size()) {
    const ssize_t n = read(fd, text.data() + size, text.size() - size);
    if (n == 0) break;
    if (n > 0)
      size += static_cast<std::size_t>(n);
    else if (errno != EINTR)
      error = errno;
  }
  close(fd);
  text.resize(size);
  return error;
}

}  // namespace

TuningFile::TuningFile(Commands& commands, std::string file) : commands_(commands), file_(std::move(file)) {
  obeyed_ = look();
  obey();
  thread_ = std::jthread([this](const std::stop_token& stop) { watch(stop); });
}

TuningFile::Stamp TuningFile::look() const {
  struct stat status {};
  if (stat(file_.c_str(), &status) != 0) return {};
  return {status.st_ino, status.st_size, status.st_mtim.tv_sec, status.st_mtim.tv_nsec};
}

void TuningFile::obey() {
  if (obeyed_ == Stamp{}) return;
  std::string text;
  if (const int error = read_beginning(file_, text); error != 0)
    return commands_.tell(fmt::format("{}: {}", file_,
                                      error == EINVAL ? "is not a regular file; write the commands into a regular file"
                                      : error == EPERM
                                          ? "other users can write this file, which controls a motor; move "
                                            "it to a folder of your own and use chmod o-w"
                                          : std::strerror(error)));
  if (text.size() > kLargestFile)
    return commands_.tell(fmt::format("{}: is longer than {} bytes, the limit of a tuning file", file_, kLargestFile));

  std::istringstream lines(text);
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    line.resize(std::min(line.size(), line.find('#')));
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    const std::string answer = commands_.obey(line);
    if (answer.starts_with("error") || answer.find(" clamped ") != std::string::npos)
      commands_.tell(fmt::format("{}: line {}: {}", file_, number, answer));
  }
}

void TuningFile::watch(const std::stop_token& stop) {
  std::mutex mutex;
  std::condition_variable_any wake;
  std::unique_lock lock(mutex);
  Stamp before = obeyed_;
  while (!wake.wait_for(lock, stop, kLookPeriod, [] { return false; }) && !stop.stop_requested()) {
    const Stamp now = look();
    if (now == before && now != obeyed_) {
      obeyed_ = now;
      obey();
    }
    before = now;
  }
}

}  // namespace haptrace
