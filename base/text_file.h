// Text files, line by line, with memory flat in their length. Private to formats.
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

/// `text` without blanks at its ends.
std::string_view trim(std::string_view text);

/// A text of a file, fit for one line of a message.
std::string shown(std::string_view text);

/// Returns the ending of a file's name with its point, in lower case.
std::string file_ending(const std::string& file);

/// A number as a text writes it: all of `field`, with a point, perhaps with an exponent or a sign. False when it is
/// none; "nan" and "inf" are.
bool parse_number(std::string_view field, double& value);

/// The lines of a file, read in blocks.
class LineReader {
 public:
  /// Throws Error(input) when the file cannot be read. `what` names the expected content in the
  /// error about a file without line ends; `name`, unless it is empty, is the file's name in messages.
  LineReader(const std::string& file, std::string what, const std::string& name = "");

  /// False at the end. `line` stays valid until the next call. Throws Error(input) on a line of more than 1 MiB.
  bool next(std::string_view& line);

  [[nodiscard]] std::size_t number() const noexcept { return number_; }
  /// The file's name in messages.
  [[nodiscard]] const std::string& file() const noexcept { return file_; }

  /// How much of the file's bytes has been read, 0 to 1.
  [[nodiscard]] double fraction() const noexcept;

  /// An error in the present line.
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

/// A text file that is made, as OutputFile makes one: nothing is left behind unless it is committed.
class TextWriter {
 public:
  /// Throws Error(input) like OutputFile, and when the file cannot be created.
  TextWriter(const std::string& file, bool overwrite);

  /// Writes to standard output, where what is out stays out.
  static std::unique_ptr<TextWriter> to_standard_output();

  /// The text that the next save() writes.
  [[nodiscard]] std::string& text() noexcept { return text_; }

  /// Writes what has gathered, if it is much. Throws Error(input) when the disk refuses.
  void save() {
    if (text_.size() > 1 << 20) write();
  }

  /// Writes the rest and gives the file its name. Throws like save().
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
