// Making a file without harming another.
#pragma once

#include <string>
#include <vector>

namespace haptrace {

/// A new file, made under a name of its own beside the final one: whatever happens before commit(), a file that is to
/// be replaced stays as it was, and a new one is not there by half.
///
/// A recording that is being written is not replaced. The unfinished file of a process that was killed stays under a
/// name like FILE.1a2b3c4d-1234-5e6f.unfinished until remove_leftovers().
///
/// A file that replaces another has its permissions from the first byte on. A new file in a folder that is closed to
/// others (as a session's is) is closed to them too; any other is as the process makes files.
class OutputFile {
 public:
  /// Throws Error(input): the name is empty, the folder is missing, the file exists (unless `overwrite`), is not a
  /// regular file, or is a recording that is being written.
  OutputFile(const std::string& file, bool overwrite);
  ~OutputFile();  ///< removes what was created but not committed
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  /// Makes the empty file at path(). Throws Error(input): the system refuses.
  void create();

  /// Where the file is until commit().
  [[nodiscard]] const std::string& path() const noexcept { return path_; }

  /// Gives the file its final name. Its content is on the disk before it replaces another, and its name after, so that
  /// a power cut leaves the old file or the new one. Throws Error(input).
  void commit();

  /// Gives the file its final name, whose content is yet to come: nothing is forced to the disk. Throws Error(input).
  void commit_without_waiting();

 private:
  std::string name_, target_, path_, folder_;
  bool replaces_ = false, created_ = false;
  unsigned mode_ = 0666;
};

/// Removes what processes that are gone have left behind while they made `file`, and answers the names. Those of
/// processes that live, of other machines and of other containers stay. Never throws: what cannot be removed stays.
std::vector<std::string> remove_leftovers(const std::string& file);

/// Creates folders that nobody but this user can enter, as far as they are missing. Throws Error(input).
void create_private_folders(const std::string& folder);

/// Before the work whose result the file is to hold: makes a file beside it and removes that again. Throws what
/// OutputFile would; an empty name is no file.
void check_output(const std::string& file, bool overwrite);

/// The same for a file whose folders are made when it is: tries the nearest folder that is there, and makes none.
void check_output_in_new_folders(const std::string& file, bool overwrite);

}  // namespace haptrace
