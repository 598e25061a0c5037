// Fuzz target: an image of a texture.
#include "formats/image/grey_image.h"
#include "tests/fuzz/fuzz.h"

#include <cmath>

using namespace haptrace;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string file = fuzz::file_of(fuzz::text_of(data, size));
  fuzz::answer([&] {
    const GreyImage image = load_grey_image(file);
    fuzz::require(image.columns > 0 && image.rows > 0);
    fuzz::require(image.values.size() ==
                  static_cast<std::size_t>(image.columns) * static_cast<std::size_t>(image.rows));
    for (const float value : image.values) fuzz::require(value >= 0 && value <= 1);
  });
  return 0;
}
