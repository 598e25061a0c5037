// Text files, read and written piece by piece, so that memory does not grow with their length. Internal to haptrace.
#pragma once

#include "base/error.h"
#include "base/output_file.h"

#include <cstdint>
#include <cstdio>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

namespace haptrace {

/// Returns `text` without blanks at its ends.
std::string_view trim(std::string_view text);

/// Returns text from a file, escaped and shortened to fit one line of a message.
std::string shown(std::string_view text);

/// Returns the extension of a file's name with its dot, in lower case.
std::string file_ending(const std::string& file);

/// Parses the whole of `field` as a number with a decimal point, and perhaps a sign or an exponent. Accepts "nan" and
/// "inf". Returns false if `field` is not a number. Unlike number_of(), which reads options, it accepts what other
/// programs write: a leading "+", and numbers beyond the range of double, which become infinity or close to zero.
bool parse_number(std::string_view field, double& value);

/// Reads a file in blocks and returns its lines.
class LineReader {
 public:
  /// Throws Error(input) if the file cannot be read. `what` names the expected content in the error about a file
  /// without line ends; `name`, unless it is empty, is the file's name in messages.
  LineReader(const std::string& file, std::string what, const std::string& name = "");

  /// Reads the next line; returns false at the end of the file. `line` stays valid until the next call. Throws
  /// Error(input) if a line is longer than 1 MiB.
  bool next(std::string_view& line);

  [[nodiscard]] std::size_t number() const noexcept { return number_; }
  /// Returns the file's name in messages.
  [[nodiscard]] const std::string& file() const noexcept { return file_; }

  /// Returns the share of the file's bytes that has been read, 0 to 1.
  [[nodiscard]] double fraction() const noexcept;

  /// Returns an error that names the current line.
  [[nodiscard]] Error error(const std::string& what) const;

 private:
  bool refill();

  std::string file_, what_;
  std::ifstream stream_;
  std::uintmax_t size_ = 0, read_ = 0;  // [bytes]
  std::string buffer_;
  std::size_t begin_ = 0, end_ = 0;
  std::size_t number_ = 0;
};

/// Writes a text file through an OutputFile: without commit(), no file remains.
class TextWriter {
 public:
  /// Throws Error(input) like OutputFile, and if the file cannot be created.
  TextWriter(const std::string& file, bool overwrite);

  /// Writes to standard output, where written text cannot be withdrawn.
  static std::unique_ptr<TextWriter> to_standard_output();

  /// Returns the text that is still to be written, for the caller to append to.
  [[nodiscard]] std::string& text() noexcept { return text_; }

  /// Writes the pending text if it is longer than 1 MiB. Throws Error(input) if the disk refuses.
  void save() {
    if (text_.size() > 1 << 20) write();
  }

  /// Writes the remaining text and gives the file its name. Throws like save().
  void commit();

 private:
  TextWriter() : file_("standard output"), stream_(stdout, [](std::FILE*) { return 0; }) {}
  [[nodiscard]] Error refused() const;
  void write();

  std::string file_;
  std::optional<OutputFile> output_;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> stream_;
  std::string text_;
};

}  // namespace haptrace
