#include "formats/output_file.h"

#include "control/error.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <random>

namespace haptrace {
namespace fs = std::filesystem;

OutputFile::OutputFile(const std::string& file, bool overwrite) : target_(file), path_(file) {
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
  path_ = fmt::format("{}.{:08x}", target_, std::random_device{}());
}

void check_output(const std::string& file, bool overwrite) {
  if (!file.empty()) (void)OutputFile(file, overwrite);
}

OutputFile::~OutputFile() {
  std::error_code ignored;
  if (created_) fs::remove(path_, ignored);
}

void OutputFile::commit() {
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
