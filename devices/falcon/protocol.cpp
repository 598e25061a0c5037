#include "devices/falcon/protocol.h"

#include <algorithm>
#include <cmath>

namespace haptrace {
namespace {

constexpr std::uint8_t kPacketBegin = '<', kPacketEnd = '>', kZeroLetter = 'A';
constexpr std::size_t kNibbles = 4;  // per word
constexpr std::size_t kFlagsPlace = 13;

/// Returns the letter that stands for `bits`.
std::uint8_t letter(unsigned bits) noexcept {
  return static_cast<std::uint8_t>(kZeroLetter + bits);
}

}  // namespace

FalconBytes encode(const FalconPacket& packet) noexcept {
  FalconBytes bytes;
  bytes.fill(kZeroLetter);
  bytes.front() = kPacketBegin;
  bytes.back() = kPacketEnd;
  std::size_t place = 1;
  for (const std::int16_t word : packet.words)
    for (std::size_t nibble = 0; nibble < kNibbles; ++nibble)
      bytes[place++] = letter(static_cast<std::uint16_t>(word) >> (4 * nibble) & 0xfU);
  bytes[kFlagsPlace] = letter(packet.flags & FalconPacket::kAllFlags);
  return bytes;
}

std::int16_t falcon_word(double counts) noexcept {
  if (std::isnan(counts)) return 0;
  return static_cast<std::int16_t>(std::lround(std::clamp(counts, -32767.0, 32767.0)));
}

std::optional<FalconPacket> FalconDecoder::push(std::uint8_t byte) noexcept {
  last_[next_] = byte;
  next_ = (next_ + 1) % last_.size();
  ++since_;
  if (byte != kPacketEnd || at(0) != kPacketBegin || since_ < last_.size()) return std::nullopt;

  FalconPacket packet;
  for (std::size_t leg = 0; leg < packet.words.size(); ++leg) {
    unsigned word = 0;
    for (std::size_t nibble = kNibbles; nibble-- > 0;) {
      const unsigned value = at(1 + kNibbles * leg + nibble) - unsigned{kZeroLetter};
      if (value > 0xf) return std::nullopt;
      word = word << 4 | value;
    }
    packet.words[leg] = static_cast<std::int16_t>(word);
  }
  const unsigned flags = at(kFlagsPlace) - unsigned{kZeroLetter};
  if (flags > FalconPacket::kAllFlags) return std::nullopt;
  packet.flags = static_cast<std::uint8_t>(flags);
  skipped_ += since_ - last_.size();
  since_ = 0;
  return packet;
}

void FalconDecoder::reset() noexcept {
  skipped_ += since_;
  since_ = 0;
}

FalconReport falcon_report(const FalconPacket& packet) noexcept {
  FalconReport report{packet.words, static_cast<std::uint8_t>(packet.flags & 0xf), {}};
  for (std::size_t leg = 0; leg < report.homed.size(); ++leg) report.homed[leg] = (packet.flags >> (4 + leg) & 1) != 0;
  return report;
}

}  // namespace haptrace
