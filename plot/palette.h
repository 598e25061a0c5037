// Colours of pictures. Private to plot.
#pragma once

#include <array>
#include <cstddef>

namespace haptrace {

struct Rgb {
  double r, g, b;
};

/// Okabe and Ito, Color Universal Design, 2008.
inline constexpr std::array<Rgb, 8> kPalette{{{0.000, 0.447, 0.698},
                                              {0.835, 0.369, 0.000},
                                              {0.000, 0.620, 0.451},
                                              {0.800, 0.475, 0.655},
                                              {0.337, 0.706, 0.914},
                                              {0.902, 0.624, 0.000},
                                              {0.941, 0.894, 0.259},
                                              {0.000, 0.000, 0.000}}};

/// Returns a colour of the palette, which repeats.
inline const Rgb& palette(int color) {
  constexpr int n = static_cast<int>(kPalette.size());
  return kPalette[static_cast<std::size_t>((color % n + n) % n)];
}

}  // namespace haptrace
