// Fuzz target: bytes on a Hapkit's line, in both directions. The decoder finds complete packets and no others. The
// board's motor is off unless the board has received a hello.
#include "devices/hapkit/hapkit_board.h"
#include "tests/fuzz/fuzz.h"

#include <algorithm>
#include <array>

using namespace haptrace;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  hapkit_decoder decoder{};
  hapkit_board board{};
  bool greeted = false;
  for (std::size_t i = 0; i < size; ++i) {
    hapkit_packet packet{};
    const bool found = hapkit_decode(&decoder, data[i], &packet) != 0;
    std::array<std::uint8_t, HAPKIT_PACKET_SIZE> bytes{};
    const bool answered = hapkit_receive(&board, data[i], static_cast<std::uint32_t>(i), 0, bytes.data()) != 0;
    fuzz::require(found || !answered);
    if (found) {
      hapkit_encode(&packet, bytes.data());
      // The decoder's initial zeros belong to no packet, since the kind of a packet is not zero.
      fuzz::require(i + 1 >= bytes.size() && std::equal(bytes.begin(), bytes.end(), data + i + 1 - bytes.size()));
      if (packet.kind == HAPKIT_HELLO) greeted = packet.version == HAPKIT_VERSION;
    }
    fuzz::require(greeted || hapkit_duty(&board, static_cast<std::uint32_t>(i)) == 0);
  }
  fuzz::require(hapkit_duty(&board, static_cast<std::uint32_t>(size + HAPKIT_WATCHDOG_MS)) == 0);
  return 0;
}
