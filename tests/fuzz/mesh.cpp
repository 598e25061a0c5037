// Fuzz target: a mesh in a file. The first byte names the format; what is read is touched.
#include "scene/shape/mesh.h"

#include "base/triangle_mesh.h"
#include "formats/mesh/mesh_file.h"
#include "tests/fuzz/fuzz.h"

#include <algorithm>
#include <array>

using namespace haptrace;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::array kEndings{"obj", "stl", "ply", "gltf", "glb", "off"};
  if (size == 0) return 0;
  static const test::TempFolder folder;
  const std::string name = std::string("input.") + kEndings[data[0] % kEndings.size()];
  const std::string file = folder.write(name, fuzz::text_of(data + 1, size - 1));
  fuzz::answer([&] {
    MeshLoad load = load_mesh(file, "mm");
    fuzz::require(!load.mesh.triangles.empty());
    for (const Vec3& vertex : load.mesh.vertices) fuzz::require(is_finite(vertex));
    for (const auto& triangle : load.mesh.triangles)
      for (const std::uint32_t corner : triangle) fuzz::require(corner < load.mesh.vertices.size());
    Mesh shape(std::move(load.mesh), std::move(load.remarks));
    for (const double radius : {0.0, 1e-3}) {
      shape.prepare(radius);
      Proxy proxy;
      const Box box = shape.bounds();
      Vec3 from = nan3();
      for (int i = 0; i <= 20; ++i) {
        const Vec3 to = box.min + 0.05 * i * box.size() + 1e-3 * Vec3(i % 3, i % 2, 1);
        shape.follow({.from = from, .to = to, .radius = radius}, proxy);
        fuzz::require(!proxy.known || (is_finite(proxy.position) && std::isfinite(proxy.depth)));
        from = to;
      }
    }
  });
  return 0;
}
