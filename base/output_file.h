// Creation of files without damage to existing ones.
#pragma once

#include <string>
#include <vector>

namespace haptrace {

/// Writes a new file under a temporary name beside the final one. Until commit(), an existing file stays unchanged, and
/// no incomplete file appears under the final name.
///
/// A recording that is being written is not replaced. If the process is killed, its unfinished file stays under a name
/// like FILE.1a2b3c4d-1234-5e6f.unfinished until remove_leftovers() removes it.
///
/// A file that replaces another has its permissions from the first byte on. A new file in a folder that is closed to
/// others (such as a session folder) is closed to them too. Any other file has the default permissions of the process.
class OutputFile {
 public:
  /// Throws Error(input) if the name is empty, the folder is missing, or the file exists (unless `overwrite`), is not a
  /// regular file, or is a recording that is being written.
  OutputFile(const std::string& file, bool overwrite);
  ~OutputFile();  ///< removes a file that was created but not committed
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  /// Creates the empty file at path(). Throws Error(input) if the system refuses.
  void create();

  /// Returns the path of the file until commit().
  [[nodiscard]] const std::string& path() const noexcept { return path_; }

  /// Gives the file its final name. Forces the content to the disk before the file replaces another, and the name after
  /// that, so that a power cut leaves the old file or the new one. Throws Error(input).
  void commit();

  /// Gives the file its final name before its content is written. Forces nothing to the disk. Throws Error(input).
  void commit_without_waiting();

 private:
  std::string name_, target_, path_, folder_;
  bool replaces_ = false, created_ = false;
  unsigned mode_ = 0666;
};

/// Removes the unfinished files of `file` that terminated processes left behind, and returns their names. Keeps the
/// files of running processes, of other machines and of other containers. Never throws: a file that cannot be removed
/// stays.
std::vector<std::string> remove_leftovers(const std::string& file);

/// Creates the missing folders of a path, so that only this user can enter them. Throws Error(input).
void create_private_folders(const std::string& folder);

/// Checks before a long computation that its result can be written to `file`: creates a file beside it and removes it
/// again. Throws the errors of OutputFile. An empty name means no file.
void check_output(const std::string& file, bool overwrite);

/// Does the same for a file whose folders may not exist yet: tests the nearest existing folder, and creates none.
void check_output_in_new_folders(const std::string& file, bool overwrite);

}  // namespace haptrace
