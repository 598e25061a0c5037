// Fuzz target: a path as CSV.
#include "formats/path/path_file.h"
#include "tests/fuzz/fuzz.h"

using namespace haptrace;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string file = fuzz::file_of(fuzz::text_of(data, size));
  fuzz::answer([&] {
    const Path path = load_path(file);
    validate(path);
  });
  return 0;
}
