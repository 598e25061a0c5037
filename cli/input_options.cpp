#include "cli/input_options.h"

#include "base/error.h"
#include "formats/recording/recording.h"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <unistd.h>
#include <vector>

namespace haptrace::cli {
namespace {

namespace fs = std::filesystem;

/// The user's names of files that came through a pipe, by their paths.
std::map<std::string, std::string>& input_names() {
  static std::map<std::string, std::string> names;
  return names;
}

bool is_pipe(const std::string& file) {
  std::error_code error;
  const fs::file_status status = fs::status(file, error);
  return fs::is_fifo(status) || fs::is_socket(status) || fs::is_character_file(status);
}

/// Opens a file that no other process can open and that disappears when it is closed.
int open_unnamed(const std::string& folder) {
  const int descriptor = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (descriptor >= 0) return descriptor;
  std::string pattern = folder + "/haptrace-XXXXXX";  // for a file system without O_TMPFILE
  const int named = ::mkostemp(pattern.data(), O_CLOEXEC);
  if (named >= 0) ::unlink(pattern.c_str());
  return named;
}

}  // namespace

void add_input_options(CLI::App& app, CsvOptions& options) {
  app.add_option_function<std::vector<std::string>>(
         "--columns",
         [&options](const std::vector<std::string>& given) {
           options.columns.clear();
           for (const std::string& text : given) add_columns(options.columns, text);
         },
         "CSV: names of the columns in the file, as in t=time,x=Pos X (default: recognised)")
      ->take_all()
      ->expected(1)
      ->type_name("COLUMN=NAME,...")
      ->group("CSV of other programs");
  app.add_option("--units", options.units, "CSV: units of the file, as in mm,ms (default: from its header, or m and s)")
      ->type_name("UNIT,...")
      ->group("CSV of other programs");
}

InputFile::InputFile(const std::string& given, CsvOptions csv) : path_(given), csv_(std::move(csv)) {
  const bool standard = given == "-";
  csv_.name = standard ? "standard input" : given;
  check(csv_);
  if (standard) {
    spool(STDIN_FILENO);
    return;
  }
  if (!is_pipe(given)) return;
  const Descriptor from(::open(given.c_str(), O_RDONLY | O_CLOEXEC));
  if (!from) throw input_error(fmt::format("{}: cannot be read: {}", given, std::strerror(errno)));
  spool(from.get());
}

InputFile::~InputFile() {
  if (!to_remove_.empty()) ::unlink(to_remove_.c_str());  // the user's name stays: an error may be printed later
}

void InputFile::spool(int from) {
  constexpr std::size_t kBlock = 1 << 20;
  constexpr std::uintmax_t kLeast = 256 << 20;  // bytes that must stay free
  std::error_code error;
  const fs::path temporary = fs::temp_directory_path(error);
  const std::string folder = error ? "/tmp" : temporary.string();
  Descriptor to(open_unnamed(folder));
  if (!to)
    throw input_error(fmt::format("{} cannot be stored temporarily in {}: {}", name(), folder, std::strerror(errno)));
  std::vector<char> block(kBlock);
  std::size_t total = 0;
  bool line_ended = false;
  const auto refuse = [&](const std::string& what) { throw input_error(fmt::format("{}: {}", name(), what)); };
  for (;;) {
    const ssize_t count = ::read(from, block.data(), block.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) refuse(fmt::format("cannot be read: {}", std::strerror(errno)));
    if (count == 0) break;
    const std::string_view bytes(block.data(), static_cast<std::size_t>(count));
    line_ended = line_ended || (total == 0 && bytes.starts_with("XDF:")) || bytes.find('\n') != std::string_view::npos;
    if (fs::space(folder, error).available < kLeast && !error)
      refuse(fmt::format("there is not enough space for it in {}; set TMPDIR to a folder with more space", folder));
    for (std::size_t written = 0; written < bytes.size();) {
      const ssize_t done = ::write(to.get(), bytes.data() + written, bytes.size() - written);
      if (done < 0 && errno == EINTR) continue;
      if (done < 0) refuse(fmt::format("cannot be stored temporarily in {}: {}", folder, std::strerror(errno)));
      written += static_cast<std::size_t>(done);
    }
    total += bytes.size();
    if (!line_ended && total > kBlock) refuse("no line ends in its first 1 MiB; is this CSV, HDF5 or XDF?");
  }
  descriptor_ = std::move(to);
  path_ = fmt::format("/proc/self/fd/{}", descriptor_.get());
  if (is_hdf5(path_)) give_name(folder);
  input_names()[path_] = name();
}

/// Gives the file a name, because HDF5 asks for the real path of a file.
void InputFile::give_name(const std::string& folder) {
  std::string named =
      fmt::format("{}/haptrace-{:08x}{:08x}.h5", folder, std::random_device{}(), std::random_device{}());
  if (::linkat(AT_FDCWD, path_.c_str(), AT_FDCWD, named.c_str(), AT_SYMLINK_FOLLOW) != 0)
    throw input_error(
        fmt::format("{} is HDF5, which cannot be read through a pipe with temporary files in {}: {}. Give the name of "
                    "the file instead",
                    name(), folder, std::strerror(errno)));
  path_ = to_remove_ = std::move(named);
}

std::string with_input_names(std::string text, bool json) {
  for (const auto& [path, name] : input_names()) {
    std::string shown = name;
    if (json) {
      const std::string quoted = nlohmann::json(name).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
      shown = quoted.substr(1, quoted.size() - 2);
    }
    for (std::size_t at = text.find(path); at != std::string::npos; at = text.find(path, at + shown.size()))
      text.replace(at, path.size(), shown);
  }
  return text;
}

}  // namespace haptrace::cli
