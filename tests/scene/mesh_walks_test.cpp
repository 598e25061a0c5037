// Long random walks around closed meshes, watched by a referee: no leak, no proxy inside, no contact that stays.
//
// The walks of a million ticks are disabled, because they take minutes:
//
//     build/release/tests/scene/test_scene --gtest_also_run_disabled_tests --gtest_filter='*MillionTicks*'
#include "formats/mesh/mesh_file.h"
#include "tests/scene/mesh_referee.h"
#include "tests/scene/meshes.h"

#include <bit>
#include <cmath>
#include <cstdio>
#include <fmt/format.h>
#include <functional>
#include <gtest/gtest.h>
#include <string>

namespace haptrace {
namespace {

struct WalkCase {
  std::string name;
  std::function<TriangleMesh(int)> make;  ///< from the number of triangles
  bool pinched = false;  ///< parts of it touch: they hold a tool that came between them, though it sees the other side
  int times = 1;         ///< it is made with so many times the triangles, and simplified
};

std::vector<WalkCase> walk_cases() {
  return {{"Bumpy", [](int triangles) { return test::bumpy_sphere(0.05, 0.0015, triangles); }},
          {"Toothed", [](int triangles) { return test::toothed_sphere(0.05, 0.003, triangles); }},
          {"Slivers", [](int triangles) { return test::sphere_with_slivers(0.05, 0.0015, triangles, 1e-6); }},
          // Edges of four triangles, vertices at which parts meet only in this point, coincident faces.
          {"TouchingParts",
           [](int triangles) {
             // Powers of two, so that what touches is at the same place to the last digit.
             constexpr double kSide = 1.0 / 64;
             const auto parts = std::bit_floor(static_cast<unsigned>(std::sqrt(triangles / 60.0)));
             const TriangleMesh box = test::box_mesh(Vec3::Constant(kSide), static_cast<int>(parts));
             TriangleMesh mesh = box;
             for (const Vec3& shift : {Vec3(1, 1, 0), Vec3(0, 0, 1), Vec3(-1, -1, -1), Vec3(1, 0, -1)})
               test::join(mesh, box, kSide * shift);
             return mesh;
           },
           true},
          // From edges of a micrometre to edges of metres.
          {"TipsOnABlock",
           [](int) {
             TriangleMesh mesh = test::box_mesh(Vec3(10, 10, 1));
             test::join(mesh, test::box_mesh(Vec3::Constant(1e-6)), Vec3(0.3, 0.2, 0.5 + 1e-6));
             test::join(mesh, test::box_mesh(Vec3(1e-3, 1e-6, 0.1), 3), Vec3(0.1, 0.2, 0.6));
             test::join(mesh, test::toothed_sphere(0.02, 0.004, 1000), Vec3(-0.1, 0, 0.7));
             return mesh;
           }},
          {"SimplifiedBumpy", [](int triangles) { return test::bumpy_sphere(0.05, 0.0015, triangles); }, false, 4},
          {"SimplifiedTeeth", [](int triangles) { return test::toothed_sphere(0.05, 0.003, triangles); }, false, 8},
          {"SimplifiedBlock",
           [](int triangles) {
             const auto parts = std::bit_floor(static_cast<unsigned>(std::sqrt(triangles / 12.0)));
             return test::box_mesh(Vec3(1.0 / 16, 1.0 / 8, 1.0 / 32), static_cast<int>(parts));
           },
           false, 16}};
}

struct Tool {
  std::string name;
  double radius;
  bool verify;
};

void expect_no_fault(const WalkCase& shape, int triangles, const Tool& tool, std::int64_t ticks, unsigned seed) {
  MeshLoad load = clean_mesh(shape.make(shape.times * triangles), shape.name);
  ASSERT_EQ(load.report.open_edges, 0U);
  Mesh mesh(std::move(load.mesh), {});
  mesh.set("verify", tool.verify ? 1 : 0);
  if (shape.times > 1) mesh.set("triangles", triangles);
  mesh.prepare(tool.radius);
  const test::WalkFaults faults = test::walk_around(mesh, tool.radius, ticks, seed);
  const std::string what =
      fmt::format("{} of {} triangles, {}", shape.name, mesh.triangles().triangles.size(), tool.name);
  EXPECT_EQ(faults.leaked, 0) << what;
  EXPECT_EQ(faults.sunk, 0) << what;
  EXPECT_EQ(faults.astray, 0) << what;
  EXPECT_TRUE(shape.pinched || faults.stuck == 0) << faults.stuck << what;
  EXPECT_GT(faults.touched, ticks / 10) << what;
  EXPECT_GT(faults.released, ticks / 1000) << what;
  if (ticks >= 100'000)
    fmt::print("{}: {} ticks, {} touched, {} begun, {} released; leaked {}, sunk {}, astray {}, stuck {}\n", what,
               faults.ticks, faults.touched, faults.begun, faults.released, faults.leaked, faults.sunk, faults.astray,
               faults.stuck);
  (void)std::fflush(stdout);
}

class MeshWalks : public testing::TestWithParam<std::tuple<WalkCase, Tool>> {};

TEST_P(MeshWalks, HaveNoLeakAndNoContactThatStays) {
  const auto& [shape, tool] = GetParam();
  expect_no_fault(shape, 3000, tool, tool.radius > 0 ? 20'000 : 60'000, 1);
}

TEST_P(MeshWalks, DISABLED_OfAMillionTicksHaveNoLeakAndNoContactThatStays) {
  const auto& [shape, tool] = GetParam();
  for (const int triangles : {10'000, 100'000}) expect_no_fault(shape, triangles, tool, 1'000'000, 2);
}

INSTANTIATE_TEST_SUITE_P(
    AllMeshes, MeshWalks,
    testing::Combine(testing::ValuesIn(walk_cases()),
                     testing::Values(Tool{"Point", 0, false}, Tool{"PointVerified", 0, true},
                                     Tool{"BallOf0p2mm", 2e-4, false}, Tool{"BallOf2mm", 2e-3, false})),
    [](const auto& instance) { return std::get<0>(instance.param).name + std::get<1>(instance.param).name; });

}  // namespace
}  // namespace haptrace
