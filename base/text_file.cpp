#include "base/text_file.h"

#include "base/printable.h"

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <charconv>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fmt/format.h>

namespace haptrace {

std::string_view trim(std::string_view text) {
  const auto first = text.find_first_not_of(" \t");
  return first == std::string_view::npos ? std::string_view{}
                                         : text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

std::string file_ending(const std::string& file) {
  std::string ending = std::filesystem::path(file).extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(), [](unsigned char c) { return std::tolower(c); });
  return ending;
}

std::string shown(std::string_view text) {
  constexpr std::size_t kLongest = 40;
  const std::string result = printable(utf8_prefix(text, kLongest));
  return text.size() > kLongest ? result + "..." : result;
}

bool parse_number(std::string_view field, double& value) {
  if (field.starts_with('+')) field.remove_prefix(1);
  const char* end = field.data() + field.size();
  const auto result = std::from_chars(field.data(), end, value);
  // Beyond the range of double, strtod returns infinity or a number close to zero.
  if (result.ec == std::errc::result_out_of_range) value = std::strtod(std::string(field).c_str(), nullptr);
  return result.ec != std::errc::invalid_argument && result.ptr == end;
}

LineReader::LineReader(const std::string& file, std::string what, const std::string& name)
    : file_(name.empty() ? file : name), what_(std::move(what)), stream_(file, std::ios::binary) {
  if (!stream_) throw input_error(fmt::format("{}: cannot be read: {}", file_, std::strerror(errno)));
  std::error_code ignored;
  size_ = std::filesystem::file_size(file, ignored);
}

bool LineReader::next(std::string_view& line) {
  for (;;) {
    const char* begin = buffer_.data() + begin_;
    const auto* end = static_cast<const char*>(std::memchr(begin, '\n', end_ - begin_));
    if (end == nullptr && refill()) continue;
    if (end == nullptr && begin_ == end_) return false;
    begin = buffer_.data() + begin_;
    const std::size_t length = end != nullptr ? static_cast<std::size_t>(end - begin) : end_ - begin_;
    begin_ += length + (end != nullptr ? 1 : 0);
    line = std::string_view(begin, length);
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (++number_ == 1 && line.starts_with("\xEF\xBB\xBF")) line.remove_prefix(3);
    return true;
  }
}

double LineReader::fraction() const noexcept {
  return size_ > 0 ? std::min(1.0, static_cast<double>(read_ - (end_ - begin_)) / static_cast<double>(size_)) : 0;
}

Error LineReader::error(const std::string& what) const {
  return input_error(fmt::format("{}:{}: {}", file_, number_, what));
}

/// Reads another block after the unfinished line. Returns false at the end of the file.
bool LineReader::refill() {
  constexpr std::size_t kBlock = 1 << 20, kLongestLine = 1 << 20;
  if (end_ - begin_ > kLongestLine)
    throw input_error(fmt::format("{}:{}: the line is longer than 1 MiB; is this {}?", file_, number_ + 1, what_));
  std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
  end_ -= begin_;
  begin_ = 0;
  buffer_.resize(end_ + kBlock);
  stream_.read(buffer_.data() + end_, kBlock);
  const auto count = static_cast<std::size_t>(stream_.gcount());
  if (stream_.bad()) throw input_error(fmt::format("{}: cannot be read: {}", file_, std::strerror(errno)));
  end_ += count;
  read_ += count;
  return count > 0;
}

TextWriter::TextWriter(const std::string& file, bool overwrite) : file_(file), stream_(nullptr, &std::fclose) {
  output_.emplace(file, overwrite).create();
  stream_.reset(std::fopen(output_->path().c_str(), "wb"));
  if (!stream_) throw refused();
}

std::unique_ptr<TextWriter> TextWriter::to_standard_output() {
  return std::unique_ptr<TextWriter>(new TextWriter);
}

Error TextWriter::refused() const {
  return input_error(fmt::format("{}: cannot be written: {}", file_, std::strerror(errno)));
}

void TextWriter::write() {
  if (std::fwrite(text_.data(), 1, text_.size(), stream_.get()) != text_.size()) throw refused();
  text_.clear();
}

void TextWriter::commit() {
  write();
  if (std::fflush(stream_.get()) != 0) throw refused();
  if (output_) output_->commit();
}

}  // namespace haptrace
