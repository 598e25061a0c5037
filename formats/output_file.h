// Making a file without harming another.
#pragma once

#include <string>

namespace haptrace {

/// Where a new file is made, and what becomes of it. It is made under a name of its own beside the final one: whatever
/// happens before commit(), a file that is to be replaced stays as it was, and a new one is not there by half.
class OutputFile {
 public:
  /// Throws Error(input): the folder is missing, the file exists (unless `overwrite`) or is not a regular file.
  OutputFile(const std::string& file, bool overwrite);
  ~OutputFile();  ///< removes what was created but not committed
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  /// Where to create it, exclusively.
  [[nodiscard]] const std::string& path() const noexcept { return path_; }

  /// The file at path() is ours from now on.
  void created() noexcept { created_ = true; }

  /// Gives the file its final name. Throws Error(input).
  void commit();

 private:
  std::string target_, path_;
  bool replaces_ = false, created_ = false;
};

/// Before the work whose result the file is to hold. Throws what OutputFile would; an empty name is no file.
void check_output(const std::string& file, bool overwrite);

}  // namespace haptrace
