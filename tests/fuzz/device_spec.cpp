// Fuzz target: the value of --device.
#include "devices/device_spec.h"

#include "tests/fuzz/fuzz.h"

using namespace haptrace;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::answer([&] {
    const DeviceSpec spec = DeviceSpec::parse(fuzz::text_of(data, size));
    fuzz::require(!spec.name.empty() && spec.text == fuzz::text_of(data, size));
  });
  return 0;
}
