#include "formats/convert/xdf_file.h"

#include "base/error.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fmt/format.h>
#include <pugixml.hpp>

namespace haptrace::xdf {
namespace {

constexpr std::uint64_t kLargestChunk = 1ULL << 30;  // [bytes]
constexpr std::uint64_t kMostChannels = 10'000;
constexpr unsigned char kBoundary[] = {0x43, 0xA5, 0x46, 0xDC, 0xCB, 0xF5, 0x41, 0x0F,
                                       0xB3, 0x0E, 0xD5, 0x46, 0x73, 0x83, 0xCB, 0xE4};

bool of_stream(Tag tag) {
  return tag == Tag::stream_header || tag == Tag::samples || tag == Tag::clock_offset || tag == Tag::stream_footer;
}

std::string text_of(const pugi::xml_node& node, const char* key) {
  return node.child(key).text().get();
}

}  // namespace

ChunkWalk::ChunkWalk(const std::string& file) : file_(file), stream_of_bytes_(file, std::ios::binary) {
  if (!stream_of_bytes_) throw input_error(fmt::format("{}: cannot be read: {}", file, std::strerror(errno)));
  std::array<char, 4> magic{};
  stream_of_bytes_.read(magic.data(), magic.size());
  const std::string_view begin(magic.data(), magic.size());
  if (begin.starts_with("\x1F\x8B"))
    throw input_error(file + ": is compressed; unpack it first: gunzip < FILE.xdfz > FILE.xdf");
  if (begin != "XDF:") throw input_error(file + ": is not XDF: it does not begin with 'XDF:'");
  size_ = std::filesystem::file_size(file);
}

bool ChunkWalk::read_head() {
  const auto bytes = [&](std::uint64_t at, std::size_t count) {
    std::uint64_t value = 0;
    stream_of_bytes_.clear();
    stream_of_bytes_.seekg(static_cast<std::streamoff>(at));
    stream_of_bytes_.read(reinterpret_cast<char*>(&value), static_cast<std::streamsize>(count));
    return value;
  };
  const std::uint64_t width = bytes(position_, 1);
  if (width != 1 && width != 4 && width != 8) return false;
  const std::uint64_t begin = position_ + 1 + width;
  if (begin + 2 > size_) return false;
  const std::uint64_t length = bytes(position_ + 1, width), tag = bytes(begin, 2);
  if (length < 2 || tag == 0) return false;
  tag_ = static_cast<Tag>(tag);
  content_ = begin + 2;
  content_end_ = length <= size_ - begin ? begin + length : size_;
  stream_ = 0;
  if (of_stream(tag_)) {
    if (length < 6 || content_ + 4 > size_) return false;
    stream_ = static_cast<std::uint32_t>(bytes(content_, 4));
    content_ += 4;
  }
  cut_off_ = length > size_ - begin;
  return true;
}

bool ChunkWalk::next() {
  while (position_ < size_) {
    const std::uint64_t begin = position_;
    const bool known = read_head();
    if (known && !cut_off_) {
      position_ = content_end_;
      return true;
    }
    // If other chunks follow, a length beyond the end of the file is damage. Otherwise the last chunk is cut off.
    if (find_boundary()) {
      note(fmt::format("damaged at byte {}: reading continued at the next boundary, at byte {}", begin, position_));
      continue;
    }
    position_ = size_;
    note(known ? fmt::format("ends within a chunk, at byte {}: the file was cut off", size_)
               : fmt::format("damaged at byte {}; only the data before it were read", begin));
    return known;
  }
  return false;
}

void ChunkWalk::note(std::string text) {
  constexpr std::size_t kMost = 10;
  if (notes_.size() < kMost) notes_.push_back(std::move(text));
}

/// Moves to the end of the next boundary chunk. Returns false if there is none.
bool ChunkWalk::find_boundary() {
  // The blocks grow, since a file may be damaged in many places with a boundary close after each.
  constexpr std::size_t kFirst = 1 << 10, kLargest = 1 << 20, kMark = sizeof kBoundary;
  const std::string_view mark(reinterpret_cast<const char*>(kBoundary), kMark);
  std::string block;
  std::size_t step = kFirst;
  for (std::uint64_t at = position_ + 1; at < size_; at += step, step = std::min(2 * step, kLargest)) {
    block.resize(step + kMark);
    stream_of_bytes_.clear();
    stream_of_bytes_.seekg(static_cast<std::streamoff>(at));
    stream_of_bytes_.read(block.data(), static_cast<std::streamsize>(block.size()));
    block.resize(static_cast<std::size_t>(stream_of_bytes_.gcount()));
    if (const std::size_t found = block.find(mark); found != std::string::npos) {
      position_ = at + found + kMark;
      return true;
    }
  }
  return false;
}

std::string ChunkWalk::content() {
  const std::uint64_t length = content_end_ - content_;
  if (length > kLargestChunk)
    throw input_error(
        fmt::format("{}: the chunk at byte {} has {} bytes, over 1 GiB; it is damaged", file_, content_, length));
  std::string content(length, '\0');
  stream_of_bytes_.clear();
  stream_of_bytes_.seekg(static_cast<std::streamoff>(content_));
  stream_of_bytes_.read(content.data(), static_cast<std::streamsize>(length));
  content.resize(static_cast<std::size_t>(stream_of_bytes_.gcount()));
  return content;
}

double ChunkWalk::fraction() const noexcept {
  return static_cast<double>(position_) / static_cast<double>(size_);
}

StreamInfo parse_stream_header(std::uint32_t id, const std::string& xml) {
  pugi::xml_document document;
  const pugi::xml_parse_result parsed = document.load_buffer(xml.data(), xml.size());
  if (!parsed)
    throw input_error(
        fmt::format("the header of stream {} is not XML: {} at byte {}", id, parsed.description(), parsed.offset));
  const pugi::xml_node node = document.child("info");
  StreamInfo info;
  info.id = id;
  info.name = text_of(node, "name");
  info.type = text_of(node, "type");
  info.nominal_rate = node.child("nominal_srate").text().as_double();
  if (!(info.nominal_rate >= 0 && std::isfinite(info.nominal_rate))) info.nominal_rate = 0;
  const std::uint64_t count = node.child("channel_count").text().as_ullong();
  if (count == 0 || count > kMostChannels)
    throw input_error(fmt::format("stream {} ('{}') has an invalid number of channels: {}", id, info.name,
                                  text_of(node, "channel_count")));
  info.channel_count = count;

  constexpr std::array<std::string_view, 7> kFormats{"float32", "double64", "int8",  "int16",
                                                     "int32",   "int64",    "string"};
  const std::string format = text_of(node, "channel_format");
  const auto found = std::find(kFormats.begin(), kFormats.end(), format);
  if (found == kFormats.end())
    throw input_error(fmt::format("stream {} ('{}') has values of the unknown format '{}'", id, info.name, format));
  info.format = static_cast<Format>(found - kFormats.begin());
  for (const pugi::xml_node channel : node.child("desc").child("channels").children("channel"))
    info.channels.push_back({text_of(channel, "label"), text_of(channel, "unit")});
  info.channels.resize(count);
  return info;
}

std::string file_header_text(const std::string& xml, const char* key) {
  pugi::xml_document document;
  return document.load_buffer(xml.data(), xml.size()) ? text_of(document.child("info"), key) : std::string();
}

SampleWalk::SampleWalk(const StreamInfo* info, std::string content) : info_(info), content_(std::move(content)) {
  complete_ = take_length(left_);
  if (!complete_) left_ = 0;
}

template <class Value>
bool SampleWalk::take(Value& value) {
  if (content_.size() - at_ < sizeof value) return false;
  std::memcpy(&value, content_.data() + at_, sizeof value);
  at_ += sizeof value;
  return true;
}

bool SampleWalk::take_length(std::uint64_t& length) {
  std::uint8_t width = 0;
  if (!take(width) || (width != 1 && width != 4 && width != 8) || content_.size() - at_ < width) return false;
  length = 0;
  std::memcpy(&length, content_.data() + at_, width);
  at_ += width;
  return true;
}

bool SampleWalk::take_value(double& value) {
  const auto as = [&](auto typed) {
    if (!take(typed)) return false;
    value = static_cast<double>(typed);
    return true;
  };
  switch (info_->format) {
    case Format::float32:
      return as(0.0F);
    case Format::double64:
      return as(0.0);
    case Format::int8:
      return as(std::int8_t{});
    case Format::int16:
      return as(std::int16_t{});
    case Format::int32:
      return as(std::int32_t{});
    case Format::int64:
      return as(std::int64_t{});
    case Format::text:
      break;
  }
  return false;
}

bool SampleWalk::take_text(std::string& text) {
  std::uint64_t length = 0;
  if (!take_length(length) || content_.size() - at_ < length) return false;
  text = content_.substr(at_, length);
  at_ += length;
  return true;
}

bool SampleWalk::next(std::optional<double>& time, std::vector<double>& values, std::vector<std::string>& texts) {
  if (left_ == 0) return false;
  --left_;
  complete_ = false;
  std::uint8_t stamp_bytes = 0;
  time.reset();
  if (!take(stamp_bytes) || (stamp_bytes != 0 && stamp_bytes != 8)) return left_ = 0, false;
  if (stamp_bytes == 8) {
    double stamp = 0;
    if (!take(stamp)) return left_ = 0, false;
    time = stamp;
  }
  if (info_->format == Format::text) {
    texts.resize(info_->channel_count);
    for (std::string& text : texts)
      if (!take_text(text)) return left_ = 0, false;
  } else {
    values.resize(info_->channel_count);
    for (double& value : values)
      if (!take_value(value)) return left_ = 0, false;
  }
  complete_ = true;
  return true;
}

void ClockMap::add(double time, double offset) {
  constexpr double kReset = 1;  // [s]
  if (!std::isfinite(time) || !std::isfinite(offset)) return;
  if (parts_.empty() || std::abs(offset - parts_.back().offsets.back()) > kReset) parts_.emplace_back();
  parts_.back().times.push_back(time);
  parts_.back().offsets.push_back(offset);
}

void ClockMap::fit() {
  constexpr double kFull = 1e-4;  // [s]
  constexpr int kRounds = 20;
  for (Part& part : parts_) {
    const std::size_t n = part.times.size();
    std::vector<double> weight(n, 1);
    for (int round = 0; round < kRounds; ++round) {
      double w = 0, t = 0, o = 0, tt = 0, to = 0;
      for (std::size_t i = 0; i < n; ++i) {
        w += weight[i];
        t += weight[i] * part.times[i];
        o += weight[i] * part.offsets[i];
      }
      part.t0 = t / w;
      part.a = o / w;
      for (std::size_t i = 0; i < n; ++i) {
        const double dt = part.times[i] - part.t0;
        tt += weight[i] * dt * dt;
        to += weight[i] * dt * (part.offsets[i] - part.a);
      }
      part.b = tt > 0 ? to / tt : 0;
      for (std::size_t i = 0; i < n; ++i) {
        const double residual = std::abs(part.offsets[i] - part.a - part.b * (part.times[i] - part.t0));
        weight[i] = residual > kFull ? kFull / residual : 1;
      }
    }
  }
}

double ClockMap::to_recorder(double time) const {
  if (parts_.empty()) return time;
  const auto distance = [&](const Part& part) {
    const auto [first, last] = std::minmax_element(part.times.begin(), part.times.end());
    return std::max({0.0, *first - time, time - *last});
  };
  const Part* nearest = &parts_.front();
  if (parts_.size() > 1)
    nearest = &*std::min_element(parts_.begin(), parts_.end(),
                                 [&](const Part& a, const Part& b) { return distance(a) < distance(b); });
  return time + nearest->a + nearest->b * (time - nearest->t0);
}

}  // namespace haptrace::xdf
