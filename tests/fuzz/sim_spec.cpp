// Fuzz target: a simulated device as JSON. Every valid spec makes a device that moves.
#include "base/json_reader.h"
#include "devices/sim/sim_device.h"
#include "devices/sim/spec.h"
#include "tests/fuzz/fuzz.h"

using namespace haptrace;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::answer([&] {
    const nlohmann::json json = parse_json(std::string(fuzz::text_of(data, size)), "input");
    SimDevice device(read_sim_spec(json, "input"));
    for (int tick = 0; tick < 3; ++tick) {
      DeviceState state;
      (void)device.exchange({.force = Vec3(1, -2, 0.5)}, 1e-3, state);
      fuzz::require(is_finite(state.position));
    }
  });
  return 0;
}
