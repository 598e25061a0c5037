// Fuzz target: bytes on a Falcon's line. The decoder finds every packet and no other.
#include "devices/falcon/protocol.h"
#include "tests/fuzz/fuzz.h"

#include <algorithm>

using namespace haptrace;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  FalconDecoder decoder;
  std::size_t found = 0;
  for (std::size_t i = 0; i < size; ++i) {
    const auto packet = decoder.push(data[i]);
    if (!packet) continue;
    ++found;
    fuzz::require(i >= 15);
    FalconBytes bytes = encode(*packet);
    bytes[14] = data[i - 1];  // a byte without a known meaning
    fuzz::require(std::equal(bytes.begin(), bytes.end(), data + i - 15));
  }
  fuzz::require(decoder.skipped() + 16 * found <= size);
  const FalconPacket last{{1, -2, 3}, 0x7f};
  std::optional<FalconPacket> packet;
  for (const std::uint8_t byte : encode(last)) packet = decoder.push(byte);
  fuzz::require(packet == last);
  fuzz::require(decoder.skipped() + 16 * (found + 1) == size + 16);
  return 0;
}
