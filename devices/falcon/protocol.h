// The packets that a running Novint Falcon and its host exchange.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

namespace haptrace {

/// What one packet carries, either way. The host sends motor counts and is answered, once for each packet, with encoder
/// counts.
///
/// On the wire it has 16 bytes (as libnifalcon's FalconFirmwareNovintSDK sends them):
///
///     '<'   3 words of 4 nibbles, the least significant first   flags   unknown   '>'
///
/// Every value is sent as 'A' + value, so that neither bracket occurs inside. There is no check sum: a bit that turns
/// one letter into another goes unnoticed here, and has to be seen in what the encoders say.
struct FalconPacket {
  static constexpr std::uint8_t kAllFlags = 0x7f;

  std::array<std::int16_t, 3> words{};  ///< of the legs
  std::uint8_t flags = 0;               ///< within kAllFlags; the host's are in FalconCalibration

  bool operator==(const FalconPacket&) const = default;
};

using FalconBytes = std::array<std::uint8_t, 16>;

/// The packet on the wire; flags outside kAllFlags are left out. Real-time safe.
FalconBytes encode(const FalconPacket& packet) noexcept;

/// The nearest word to so many motor counts, at most 32767 either way: a force that is too large never turns round. Not
/// a number is 0. Real-time safe.
std::int16_t falcon_word(double counts) noexcept;

/// Finds the packets in a stream of bytes, whatever else is in it: a packet is found by its last 16 bytes alone, so
/// that nothing that came before can hide it.
///
/// Threads: one at a time. Real-time safe.
class FalconDecoder {
 public:
  /// The packet that ends with this byte, if one does. The unknown byte may be anything.
  std::optional<FalconPacket> push(std::uint8_t byte) noexcept;

  /// Forgets what came of a packet so far: after the connection was purged or made anew.
  void reset() noexcept;

  /// Bytes that belonged to no packet, known once the next packet is found.
  [[nodiscard]] std::uint64_t skipped() const noexcept { return skipped_; }

 private:
  [[nodiscard]] std::uint8_t at(std::size_t place) const noexcept { return last_[(next_ + place) % last_.size()]; }

  FalconBytes last_{};  ///< a ring: the oldest is the next to be replaced
  std::size_t next_ = 0;
  std::uint64_t since_ = 0;  ///< bytes since the last packet
  std::uint64_t skipped_ = 0;
};

/// What the device answers.
struct FalconReport {
  enum Button : std::uint8_t { kPlus = 1, kForward = 2, kCentre = 4, kMinus = 8 };  ///< of the grip

  std::array<std::int16_t, 3> encoders{};  ///< [counts]; they jump when a leg is homed
  std::uint8_t buttons = 0;                ///< Buttons that are down
  std::array<bool, 3> homed{};

  [[nodiscard]] bool is_homed() const noexcept { return homed[0] && homed[1] && homed[2]; }
};

/// Real-time safe.
FalconReport falcon_report(const FalconPacket& packet) noexcept;

}  // namespace haptrace
