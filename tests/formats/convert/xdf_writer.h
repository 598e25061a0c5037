// Writer of XDF files for tests. Chunks follow the specification of the format (formats/convert/xdf_file.h), or contain
// the damage that a test needs.
#pragma once

#include <cstdint>
#include <cstring>
#include <fmt/format.h>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace::test {

class XdfWriter {
 public:
  struct Channel {
    std::string label, unit;
  };

  explicit XdfWriter(const std::string& date = "2026-03-01T12:00:00Z") {
    chunk(1, fmt::format("<?xml version=\"1.0\"?><info><version>1.0</version><datetime>{}</datetime></info>", date));
  }

  /// Appends a stream header. A `rate` of 0 means irregular samples [Hz].
  void stream(std::uint32_t id, const std::string& name, const std::string& type, const std::string& format,
              double rate, const std::vector<Channel>& channels) {
    std::string list;
    for (const Channel& channel : channels)
      list += fmt::format("<channel><label>{}</label><unit>{}</unit></channel>", channel.label, channel.unit);
    chunk(2, bytes(id) + fmt::format("<?xml version=\"1.0\"?><info><name>{}</name><type>{}</type><channel_count>{}"
                                     "</channel_count><nominal_srate>{}</nominal_srate><channel_format>{}"
                                     "</channel_format><desc><channels>{}</channels></desc></info>",
                                     name, type, channels.size(), rate, format, list));
  }

  /// Returns one encoded sample. Without a stamp, it follows the previous sample by the nominal period.
  template <class Value>
  static std::string sample(std::optional<double> stamp, const std::vector<Value>& values) {
    std::string text = stamp ? std::string("\x08") + bytes(*stamp) : std::string(1, '\0');
    for (const Value& value : values) text += bytes(value);
    return text;
  }
  static std::string marker(double stamp, const std::vector<std::string>& texts) {
    std::string all = std::string("\x08") + bytes(stamp);
    for (const std::string& text : texts) all += length(text.size()) + text;
    return all;
  }

  void samples(std::uint32_t id, const std::vector<std::string>& list) {
    std::string content = bytes(id) + length(list.size());
    for (const std::string& each : list) content += each;
    chunk(3, content);
  }
  void clock_offset(std::uint32_t id, double time, double offset) { chunk(4, bytes(id) + bytes(time) + bytes(offset)); }
  void boundary() { chunk(5, std::string("\x43\xA5\x46\xDC\xCB\xF5\x41\x0F\xB3\x0E\xD5\x46\x73\x83\xCB\xE4", 16)); }
  void footer(std::uint32_t id) { chunk(6, bytes(id) + std::string("<?xml version=\"1.0\"?><info></info>")); }

  void chunk(std::uint16_t tag, const std::string& content) {
    file_ += length(content.size() + 2) + bytes(tag) + content;
  }
  void raw(std::string_view bytes) { file_ += bytes; }

  [[nodiscard]] const std::string& file() const { return file_; }

  template <class Value>
  static std::string bytes(Value value) {
    return {reinterpret_cast<const char*>(&value), sizeof value};
  }

 private:
  /// Encodes a length in as few bytes as possible.
  static std::string length(std::uint64_t value) {
    if (value < 256) return "\x01" + bytes(static_cast<std::uint8_t>(value));
    if (value < (1ULL << 32)) return "\x04" + bytes(static_cast<std::uint32_t>(value));
    return "\x08" + bytes(value);
  }

  std::string file_ = "XDF:";
};

}  // namespace haptrace::test
