#include "formats/output_file.h"

#include "control/error.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <random>
#include <sys/stat.h>
#include <unistd.h>

namespace haptrace {
namespace fs = std::filesystem;
namespace {

/// False when the disk refuses; errno says why.
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

}  // namespace

OutputFile::OutputFile(const std::string& file, bool overwrite) : name_(file), target_(file), path_(file) {
  std::error_code error;
  const fs::path folder = fs::path(file).has_parent_path() ? fs::path(file).parent_path() : fs::path(".");
  if (!fs::is_directory(folder, error))
    throw input_error(fmt::format("{}: folder {} does not exist; create it first", file, folder.string()));
  const fs::file_status status = fs::status(file, error);
  replaces_ = fs::exists(status);
  if (replaces_ && !fs::is_regular_file(status)) throw input_error(file + ": exists and is not a regular file");
  if (replaces_ && !overwrite)
    throw input_error(file + ": exists already; choose another name or allow it to be replaced (--overwrite)");
  if (replaces_) target_ = fs::canonical(file, error).string();  // a link stays a link
  folder_ = replaces_ ? fs::path(target_).parent_path().string() : folder.string();
  if (replaces_)
    mode_ = static_cast<unsigned>(status.permissions()) & kPermissions;
  else if ((static_cast<unsigned>(fs::status(folder, error).permissions()) & kOfOthers) == 0)
    mode_ = 0600;
  path_ = fmt::format("{}.{:08x}", target_, std::random_device{}());
}

void OutputFile::create() {
  // The mode that open() is given loses what the process keeps from others; that of a replaced file must not change.
  const int descriptor =
      open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, replaces_ ? 0600 : mode_);
  created_ = descriptor >= 0;
  const bool done = created_ && (!replaces_ || fchmod(descriptor, mode_) == 0);
  const int reason = errno;
  if (created_) close(descriptor);
  if (!done) throw input_error(fmt::format("{}: cannot be created: {}", name_, std::strerror(reason)));
}

void create_private_folders(const std::string& folder) {
  fs::path made;
  for (const fs::path& part : fs::path(folder)) {
    made /= part;
    if (mkdir(made.c_str(), 0700) != 0 && !fs::is_directory(made))
      throw input_error(fmt::format("{}: cannot be made: {}", folder, std::strerror(errno)));
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
    throw input_error(fmt::format("{}: cannot be forced to the disk: {}", name_, std::strerror(errno)));
  commit_without_waiting();
  (void)force_to_disk(folder_);  // not every file system can; the file has its name by now
}

void OutputFile::commit_without_waiting() {
  const auto rename = [&](unsigned flags) {
    return renameat2(AT_FDCWD, path_.c_str(), AT_FDCWD, target_.c_str(), flags) == 0;
  };
  bool renamed = rename(replaces_ ? 0 : RENAME_NOREPLACE);
  // Some file systems do not know how not to replace.
  if (!renamed && errno == EINVAL && !fs::exists(target_)) renamed = rename(0);
  if (!renamed)
    throw input_error(
        fmt::format("{}: cannot be {}: {}", target_, replaces_ ? "replaced" : "created", std::strerror(errno)));
  created_ = false;
}

}  // namespace haptrace
