// Packets between a running Novint Falcon and its host.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

namespace haptrace {

/// Content of one packet, in either direction. The host sends motor counts; the device answers every packet with
/// encoder counts.
///
/// On the wire it has 16 bytes (as libnifalcon's FalconFirmwareNovintSDK sends them):
///
///     '<'   3 words of 4 nibbles, the least significant first   flags   unknown   '>'
///
/// Every value is sent as 'A' + value, so that neither bracket occurs inside. There is no check sum: a bit error that
/// turns one letter into another goes unnoticed here. It has to be detected in the encoder counts.
struct FalconPacket {
  static constexpr std::uint8_t kAllFlags = 0x7f;

  std::array<std::int16_t, 3> words{};  ///< one per leg
  std::uint8_t flags = 0;               ///< within kAllFlags; FalconCalibration has the host's flags

  bool operator==(const FalconPacket&) const = default;
};

using FalconBytes = std::array<std::uint8_t, 16>;

/// Encodes a packet for the wire, without flags outside kAllFlags. Real-time safe.
FalconBytes encode(const FalconPacket& packet) noexcept;

/// Rounds motor counts to a word of at most 32767 in magnitude, so that a force that is too large never changes its
/// sign. NaN gives 0. Real-time safe.
std::int16_t falcon_word(double counts) noexcept;

/// Finds packets in a stream of arbitrary bytes. It recognises a packet by its last 16 bytes alone, so that no earlier
/// byte can hide it.
///
/// Threads: one at a time. Real-time safe.
class FalconDecoder {
 public:
  /// Takes a byte. Returns the packet that ends with it, if any. The unknown byte may have any value.
  std::optional<FalconPacket> push(std::uint8_t byte) noexcept;

  /// Discards a partial packet, for example after the connection was purged or reopened.
  void reset() noexcept;

  /// Returns the number of bytes outside of packets, as known when the last packet was found.
  [[nodiscard]] std::uint64_t skipped() const noexcept { return skipped_; }

 private:
  [[nodiscard]] std::uint8_t at(std::size_t place) const noexcept { return last_[(next_ + place) % last_.size()]; }

  FalconBytes last_{};  ///< ring buffer; the oldest byte is replaced next
  std::size_t next_ = 0;
  std::uint64_t since_ = 0;  ///< bytes since the last packet
  std::uint64_t skipped_ = 0;
};

/// Content of the device's answer.
struct FalconReport {
  enum Button : std::uint8_t { kPlus = 1, kForward = 2, kCentre = 4, kMinus = 8 };  ///< buttons of the grip

  std::array<std::int16_t, 3> encoders{};  ///< [counts]; they jump when a leg is homed
  std::uint8_t buttons = 0;                ///< Buttons that are down
  std::array<bool, 3> homed{};

  [[nodiscard]] bool is_homed() const noexcept { return homed[0] && homed[1] && homed[2]; }
};

/// Decodes an answer. Real-time safe.
FalconReport falcon_report(const FalconPacket& packet) noexcept;

}  // namespace haptrace
