#include "base/output_file.h"

#include "base/error.h"
#include "base/number.h"
#include "base/writer_mark.h"

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <functional>
#include <random>
#include <sys/stat.h>
#include <unistd.h>

namespace haptrace {
namespace fs = std::filesystem;
namespace {

/// Returns false if the disk refuses; errno holds the reason.
bool force_to_disk(const std::string& path) {
  const int descriptor = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return false;
  int failed = 0;
  while ((failed = fsync(descriptor)) != 0 && errno == EINTR) {
  }
  const int reason = errno;
  close(descriptor);
  errno = reason;
  return failed == 0;
}

constexpr unsigned kPermissions = 0777, kOfOthers = 0077;
constexpr std::string_view kUnfinished = ".unfinished";

/// Returns a hash of the scope in which process numbers are unique: one boot of a machine, and a container on it.
std::uint32_t process_space() {
  std::ifstream boot("/proc/sys/kernel/random/boot_id");
  std::string text((std::istreambuf_iterator<char>(boot)), std::istreambuf_iterator<char>());
  struct stat space {};
  if (stat("/proc/self/ns/pid", &space) == 0) text += std::to_string(space.st_ino);
  return static_cast<std::uint32_t>(std::hash<std::string>{}(text));
}

/// Returns a name like FILE.1a2b3c4d-1234-5e6f.unfinished: process space, process, and a random number to distinguish
/// several files.
std::string unfinished_name(const std::string& target) {
  return fmt::format("{}.{:08x}-{}-{:04x}{}", target, process_space(), getpid(), std::random_device{}() & 0xFFFFU,
                     kUnfinished);
}

/// Returns true if `rest`, the part of a name after FILE, marks an unfinished file of a process that no longer exists.
bool is_leftover(std::string_view rest) {
  unsigned space = 0, number = 0;
  int process = 0;
  const auto read = [&rest](auto& value, int base, std::string_view end) {
    const auto found = take_number<std::remove_reference_t<decltype(value)>>(rest, base);
    if (!found || !rest.starts_with(end)) return false;
    rest.remove_prefix(end.size());
    value = *found;
    return true;
  };
  return rest.starts_with('.') && (rest.remove_prefix(1), read(space, 16, "-")) && read(process, 10, "-") &&
         read(number, 16, kUnfinished) && (rest.empty() || is_leftover(rest)) && space == process_space() &&
         process > 0 && kill(process, 0) != 0 && errno == ESRCH;
}

}  // namespace

OutputFile::OutputFile(const std::string& file, bool overwrite) : name_(file), target_(file), path_(file) {
  if (file.empty()) throw input_error("the name of the file to write is empty");
  std::error_code error;
  const fs::path folder = fs::path(file).has_parent_path() ? fs::path(file).parent_path() : fs::path(".");
  if (!fs::is_directory(folder, error))
    throw input_error(fmt::format("{}: folder {} does not exist; create it first", file, folder.string()));
  const fs::file_status status = fs::status(file, error);
  replaces_ = fs::exists(status);
  if (replaces_ && !fs::is_regular_file(status)) throw input_error(file + ": exists and is not a regular file");
  if (replaces_ && !overwrite)
    throw input_error(file + ": exists already; choose another name or allow it to be replaced (--overwrite)");
  if (replaces_ && has_writer(file))
    throw input_error(file + ": is a recording that is still being written; replace it after that session has ended");
  if (replaces_) target_ = fs::canonical(file, error).string();  // replaces the target of a link, not the link
  folder_ = replaces_ ? fs::path(target_).parent_path().string() : folder.string();
  if (replaces_)
    mode_ = static_cast<unsigned>(status.permissions()) & kPermissions;
  else if ((static_cast<unsigned>(fs::status(folder, error).permissions()) & kOfOthers) == 0)
    mode_ = 0600;
  path_ = unfinished_name(target_);
}

void OutputFile::create() {
  // The umask reduces the mode that is given to open(). A file that replaces another must have exactly its mode.
  const int descriptor =
      open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, replaces_ ? 0600 : mode_);
  created_ = descriptor >= 0;
  const bool done = created_ && (!replaces_ || fchmod(descriptor, mode_) == 0);
  const int reason = errno;
  if (created_) close(descriptor);
  if (!done) throw input_error(fmt::format("{}: cannot be created: {}", name_, std::strerror(reason)));
}

std::vector<std::string> remove_leftovers(const std::string& file) {
  std::error_code error;
  const fs::path target = fs::exists(file, error) ? fs::canonical(file, error) : fs::path(file);
  const std::string name = target.filename().string();
  std::vector<std::string> removed;
  const fs::directory_iterator folder(target.has_parent_path() ? target.parent_path() : fs::path("."), error);
  if (error || name.empty()) return removed;
  for (const fs::directory_entry& entry : folder) {
    const std::string other = entry.path().filename().string();
    if (!other.starts_with(name) || !is_leftover(std::string_view(other).substr(name.size()))) continue;
    if (entry.is_regular_file(error) && fs::remove(entry.path(), error)) removed.push_back(entry.path().string());
  }
  std::sort(removed.begin(), removed.end());
  return removed;
}

void create_private_folders(const std::string& folder) {
  fs::path made;
  for (const fs::path& part : fs::path(folder)) {
    made /= part;
    if (mkdir(made.c_str(), 0700) != 0 && !fs::is_directory(made))
      throw input_error(fmt::format("{}: cannot be created: {}", folder, std::strerror(errno)));
  }
}

void check_output(const std::string& file, bool overwrite) {
  if (!file.empty()) OutputFile(file, overwrite).create();
}

void check_output_in_new_folders(const std::string& file, bool overwrite) {
  std::error_code error;
  const fs::path folder = fs::absolute(file, error).parent_path();
  fs::path there = folder;
  while (!fs::exists(fs::symlink_status(there, error)) && there.has_relative_path()) there = there.parent_path();
  if (there == folder) return check_output(file, overwrite);
  try {
    check_output((there / fs::path(file).filename()).string() + ".new", true);
  } catch (const Error& refused) {
    throw input_error(fmt::format("{}: {}", file, refused.what()));
  }
}

OutputFile::~OutputFile() {
  std::error_code ignored;
  if (created_) fs::remove(path_, ignored);
}

void OutputFile::commit() {
  if (!force_to_disk(path_))
    throw input_error(fmt::format("{}: cannot be synced to the disk: {}", name_, std::strerror(errno)));
  commit_without_waiting();
  (void)force_to_disk(folder_);  // some file systems cannot; the file already has its name
}

void OutputFile::commit_without_waiting() {
  const auto rename = [&](unsigned flags) {
    return renameat2(AT_FDCWD, path_.c_str(), AT_FDCWD, target_.c_str(), flags) == 0;
  };
  bool renamed = rename(replaces_ ? 0 : RENAME_NOREPLACE);
  // Some file systems do not support RENAME_NOREPLACE.
  if (!renamed && errno == EINVAL && !fs::exists(target_)) renamed = rename(0);
  if (!renamed)
    throw input_error(
        fmt::format("{}: cannot be {}: {}", target_, replaces_ ? "replaced" : "created", std::strerror(errno)));
  created_ = false;
}

}  // namespace haptrace
