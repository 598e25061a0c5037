// Shaded pictures of triangles.
#pragma once

#include "base/triangle_mesh.h"

#include <string>
#include <vector>

namespace haptrace {

/// Triangles in one colour of the palette of figure.h.
struct ShadedObject {
  TriangleMesh mesh;
  int color = 0;
};

/// Draws objects in parallel projection, seen from the front, the right and above (z up), with their common box filling
/// the picture, and a scale bar. `file` is a .png of 1920 x 1440 pixels, which appears under its name only when it is
/// complete. Throws Error(input) when the ending is another, the file exists (unless `overwrite`) or cannot be written,
/// or there is no triangle.
void draw_shaded(const std::vector<ShadedObject>& objects, const std::string& title, const std::string& file,
                 bool overwrite);

}  // namespace haptrace
