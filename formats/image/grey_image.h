// Grey images as numbers, for textures.
#pragma once

#include <string>
#include <vector>

namespace haptrace {

/// Grey values, row by row from the top.
struct GreyImage {
  int columns = 0, rows = 0;
  std::vector<float> values;  ///< 0 black to 1 white, as stored: no gamma is applied
};

/// Reads a PNG (1 to 16 bits, grey or colour, which becomes its luminance) or a PGM (text or binary, 8 or 16 bits); the
/// content tells the format. Throws Error(input) naming the file and what is wrong in it, also above 64 million pixels.
GreyImage load_grey_image(const std::string& file);

}  // namespace haptrace
