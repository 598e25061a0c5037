// The input of a verb: options for CSV files, and standard input or a pipe in place of a file.
#pragma once

#include "base/descriptor.h"
#include "formats/path/csv_options.h"

#include <CLI/CLI.hpp>
#include <string>

namespace haptrace::cli {

/// Adds --columns and --units, in their own group.
void add_input_options(CLI::App& app, CsvOptions& options);

/// The input of a verb under its given name: a file, "-" for standard input, or a pipe.
///
/// Standard input and pipes are read to their end into a temporary file that lives as long as this object, so HDF5 and
/// XDF can come through them as well. That file has no name, so nothing stays behind after a kill; only HDF5 needs a
/// name. Construct this object before Signals, so that Ctrl+C ends a read that waits.
/// before Signals, so that Ctrl+C ends a read that waits.
class InputFile {
 public:
  /// Throws Error(input) if the file cannot be read, has no room, or has no line end within 1 MiB.
  InputFile(const std::string& given, CsvOptions csv);
  ~InputFile();
  InputFile(const InputFile&) = delete;
  InputFile& operator=(const InputFile&) = delete;

  /// Returns the path to open.
  [[nodiscard]] const std::string& path() const noexcept { return path_; }
  /// Returns the name for messages.
  [[nodiscard]] const std::string& name() const noexcept { return csv_.name; }
  /// Returns true if the input was standard input or a pipe.
  [[nodiscard]] bool passed_through() const noexcept { return static_cast<bool>(descriptor_); }
  /// Returns the given options, with the name.
  [[nodiscard]] const CsvOptions& csv() const noexcept { return csv_; }

 private:
  void spool(int from);
  void give_name(const std::string& folder);

  std::string path_, to_remove_;
  CsvOptions csv_;
  Descriptor descriptor_;
};

/// Returns `text` with the names of temporary files replaced by the user's names. `json`: the text is JSON.
std::string with_input_names(std::string text, bool json = false);

}  // namespace haptrace::cli
