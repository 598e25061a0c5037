// Fuzz target: gains as JSON.
#include "base/json_reader.h"
#include "base/types.h"
#include "player/playback/playback.h"
#include "tests/fuzz/fuzz.h"

using namespace haptrace;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::answer([&] {
    const PdGains gains = gains_from_json(parse_json(std::string(fuzz::text_of(data, size)), "input"), "input");
    fuzz::require(is_finite(gains.kp) && is_finite(gains.kd));
  });
  return 0;
}
