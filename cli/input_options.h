// The file that a verb reads: what a user says about a CSV file, and standard input or a pipe in place of a file.
#pragma once

#include "base/descriptor.h"
#include "formats/path/csv_options.h"

#include <CLI/CLI.hpp>
#include <string>

namespace haptrace::cli {

/// Adds --columns and --units, in a group of their own.
void add_input_options(CLI::App& app, CsvOptions& options);

/// A file by the name that was given: a file, "-" for standard input, or a pipe.
///
/// Standard input and pipes are read to their end into a temporary file, which is gone with this: so HDF5 and XDF may
/// come through them as well. It has no name, so that nothing stays behind after a kill; only HDF5 needs one. Make it
/// before Signals, so that Ctrl+C ends a read that waits.
class InputFile {
 public:
  /// Throws Error(input): it cannot be read; there is no room for it; 1 MiB without the end of a line.
  InputFile(const std::string& given, CsvOptions csv);
  ~InputFile();
  InputFile(const InputFile&) = delete;
  InputFile& operator=(const InputFile&) = delete;

  /// The path to open.
  [[nodiscard]] const std::string& path() const noexcept { return path_; }
  /// The name for messages.
  [[nodiscard]] const std::string& name() const noexcept { return csv_.name; }
  /// It was standard input or a pipe.
  [[nodiscard]] bool passed_through() const noexcept { return static_cast<bool>(descriptor_); }
  /// The options that were given, with the name.
  [[nodiscard]] const CsvOptions& csv() const noexcept { return csv_; }

 private:
  void spool(int from);
  void give_name(const std::string& folder);

  std::string path_, to_remove_;
  CsvOptions csv_;
  Descriptor descriptor_;
};

/// Returns `text` with names of temporary files replaced by those that people know. `json`: it is JSON.
std::string with_input_names(std::string text, bool json = false);

}  // namespace haptrace::cli
