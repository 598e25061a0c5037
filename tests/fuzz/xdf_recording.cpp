// Fuzz target: an XDF file with streams of the Lab Streaming Layer.
#include "tests/fuzz/source.h"

using namespace haptrace;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::read_to_end(data, size, [](const std::string& file, bool any_order) {
    return open_xdf(file, {.any_order = any_order, .dejitter = any_order});
  });
  return 0;
}
