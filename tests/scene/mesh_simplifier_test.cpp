// The accuracy setting `triangles`: meshes with fewer triangles are as sound as before, and err by what is reported.
#include "scene/shape/mesh_simplifier.h"

#include "formats/mesh/mesh_file.h"
#include "scene/scene.h"
#include "scene/scene_file.h"
#include "scene/shape/mesh.h"
#include "tests/scene/mesh_referee.h"
#include "tests/scene/meshes.h"
#include "tests/support/errors.h"
#include "tests/support/temp_folder.h"

#include <fmt/format.h>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <map>
#include <nlohmann/json.hpp>
#include <random>

namespace haptrace {
namespace {

using test::box_mesh;
using test::bumpy_sphere;
using test::error_of;
using test::mesh_of;
using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;

Mesh simplified_to(int count, TriangleMesh triangles) {
  Mesh mesh = mesh_of(std::move(triangles));
  mesh.set("triangles", count);
  mesh.prepare(0);
  return mesh;
}

/// A ring around z.
TriangleMesh ring_mesh() {
  return grid_mesh(80, 40, {.wraps_u = true, .wraps_v = true}, [](double u, double v) -> Vec3 {
    const double a = 2 * std::numbers::pi * u, b = 2 * std::numbers::pi * v, out = 0.05 + 0.006 * std::cos(b);
    return {out * std::cos(a), out * std::sin(a), 0.006 * std::sin(b)};
  });
}

/// A sheet of waves whose edge is open.
TriangleMesh sheet_mesh() {
  return grid_mesh(60, 60, {}, [](double u, double v) -> Vec3 {
    return {0.1 * u, 0.1 * v, 0.003 * std::sin(20 * u) * std::cos(15 * v)};
  });
}

/// A large part, a small one in front of it, and one that overlaps it.
TriangleMesh three_parts() {
  TriangleMesh mesh = bumpy_sphere(0.05, 0.0015, 5000);
  test::join(mesh, bumpy_sphere(0.001, 0, 1000), Vec3(0, 0, 0.06));
  test::join(mesh, bumpy_sphere(0.02, 0.002, 3000), Vec3(0.049, 0.01, 0.03));
  return mesh;
}

/// Four boxes on a fifth: edges of four triangles, vertices at which parts meet, coincident faces.
TriangleMesh touching_parts() {
  constexpr double kSide = 1.0 / 64;
  const TriangleMesh box = box_mesh(Vec3::Constant(kSide), 8);
  TriangleMesh mesh = box;
  for (const Vec3& shift : {Vec3(1, 1, 0), Vec3(0, 0, 1), Vec3(-1, -1, -1), Vec3(1, 0, -1)})
    test::join(mesh, box, kSide * shift);
  return mesh;
}

struct Input {
  std::string name;
  std::function<TriangleMesh()> make;
  int fewest;        ///< triangles that the simplifier must reach
  bool flat = true;  ///< the whole is within 1e-9 m of a result of 30 triangles or more: all its faces are flat
};

void PrintTo(const Input& input, std::ostream* out) {
  *out << input.name;
}

std::vector<Input> closed_inputs() {
  return {{"Bumpy", [] { return bumpy_sphere(0.05, 0.0015, 10'000); }, 4, false},
          {"Toothed", [] { return test::toothed_sphere(0.05, 0.003, 10'000); }, 4, false},
          {"Slivers", [] { return test::sphere_with_slivers(0.05, 0.0015, 4000, 1e-6); }, 100, false},
          {"Ring", ring_mesh, 100, false},
          {"Plate", [] { return box_mesh(Vec3(0.125, 0.125, 1.0 / 1024), 16); }, 30},
          {"Cube", [] { return box_mesh(Vec3::Constant(0.1)); }, 4}};
}

class MeshSimplifierLaws : public testing::TestWithParam<Input> {};

TEST_P(MeshSimplifierLaws, AClosedMeshStaysClosedWithItsInsideInside) {
  const Input& input = GetParam();
  const Mesh whole = mesh_of(input.make());
  const auto count = static_cast<double>(whole.triangles().triangles.size());
  const test::MeshReferee before(whole.triangles());
  for (const double share : {0.5, 0.1, 0.02, 0.0}) {
    const int wanted = std::max(input.fewest, static_cast<int>(share * count));
    const Mesh mesh = simplified_to(wanted, input.make());
    const TriangleMesh& now = mesh.triangles();
    ASSERT_LE(now.triangles.size(), static_cast<std::size_t>(wanted));
    ASSERT_GE(now.triangles.size(), kFewestTriangles);
    // Every edge joins two triangles that run along it in opposite directions.
    std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
    for (const auto& t : now.triangles) {
      EXPECT_FALSE(is_flat(now, t));
      for (std::size_t i = 0; i < 3; ++i) ++edges[{t[i], t[(i + 1) % 3]}];
    }
    for (const auto& [edge, times] : edges) {
      ASSERT_EQ(times, 1);
      ASSERT_TRUE(edges.contains({edge.second, edge.first}));
    }
    const MeshLoad again = clean_mesh(now, "again");
    EXPECT_THAT(again.remarks, IsEmpty());
    EXPECT_GT(again.report.volume, 0);
    // Places further away than the surface moved are on the side on which they were.
    TriangleMesh one = whole.triangles(), other = now;
    const TriangleTree tree(one), fewer(other);
    const double moved = 1.5 * distance_between(tree, fewer).largest;
    const test::MeshReferee after(now);
    std::mt19937 random(1);
    std::uniform_real_distribution<double> side(-0.5, 0.5);
    for (int i = 0; i < 2000; ++i) {
      const Vec3 place =
          before.middle() + 1.1 * Vec3(side(random), side(random), side(random)).cwiseProduct(before.size());
      if (tree.nearest(place).distance2 < moved * moved) continue;
      ASSERT_EQ(after.inside(place), before.inside(place)) << place.transpose();
    }
    if (input.flat && wanted >= 30) {
      EXPECT_LT(moved, 1e-9);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(AllClosedMeshes, MeshSimplifierLaws, testing::ValuesIn(closed_inputs()),
                         [](const auto& instance) { return instance.param.name; });

TEST(MeshSimplifier, HalvesTheErrorWithFourTimesTheTriangles) {
  const Mesh whole = mesh_of(bumpy_sphere(0.05, 0.0015, 40'000));
  double before = 0;
  for (const int count : {600, 2400, 9600}) {
    const Mesh mesh = simplified_to(count, bumpy_sphere(0.05, 0.0015, 40'000));
    double squares = 0;
    constexpr int kPresses = 2000;
    for (int i = 0; i < kPresses; ++i) {
      const double along = 1.9 * i, up = 1.1 * std::sin(0.73 * i);
      const Vec3 out(std::cos(up) * std::cos(along), std::cos(up) * std::sin(along), std::sin(up));
      Proxy exact, proxy;
      whole.follow({.from = 0.06 * out, .to = 0.048 * out}, exact);
      mesh.follow({.from = 0.06 * out, .to = 0.048 * out}, proxy);
      ASSERT_TRUE(exact.touching && proxy.touching);
      squares += (exact.position - proxy.position).squaredNorm();
    }
    const double error = std::sqrt(squares / kPresses);
    if (before > 0) {
      EXPECT_LT(error, before / 1.4) << count;
      EXPECT_GT(error, before / 6) << count;
    }
    before = error;
  }
}

TEST(MeshSimplifier, MeasuresTheDistanceBetweenTwoSurfaces) {
  TriangleMesh inner = bumpy_sphere(0.05, 0, 20'000), outer = bumpy_sphere(0.051, 0, 20'000);
  const TriangleTree one(inner), other(outer);
  const SurfaceDistance distance = distance_between(one, other), back = distance_between(other, one);
  EXPECT_NEAR(distance.rms, 0.001, 2e-5);
  EXPECT_NEAR(distance.largest, 0.001, 5e-5);
  EXPECT_NEAR(back.rms, distance.rms, 1e-12) << "both ways";
  EXPECT_EQ(back.largest, distance.largest);
  // A spike is seen from one of both surfaces only.
  TriangleMesh flat = box_mesh(Vec3(0.1, 0.1, 0.01)), spiked = box_mesh(Vec3(0.1, 0.1, 0.01));
  test::join(spiked, box_mesh(Vec3(1e-4, 1e-4, 0.02)), Vec3(0, 0, 0.01));
  const TriangleTree plain(flat), spike(spiked);
  EXPECT_NEAR(distance_between(plain, spike).largest, 0.015, 1e-9);
  EXPECT_NEAR(distance_between(spike, plain).largest, 0.015, 1e-9);
}

TEST(MeshSimplifier, ReportsHowManyTrianglesAreLeftAndHowFarTheSurfaceMoved) {
  const Mesh mesh = simplified_to(1000, bumpy_sphere(0.05, 0.0015, 10'000));
  EXPECT_THAT(mesh.remarks(), testing::ElementsAre(AllOf(
                                  HasSubstr("simplified from 9800 to 1000 triangles, which moved the surface by 0."),
                                  HasSubstr(" mm rms, "), HasSubstr(" mm at most"), testing::Not(HasSubstr("asks")))));
}

TEST(MeshSimplifier, LeavesAMeshWithFewerTrianglesThanAskedForAsItIs) {
  const TriangleMesh made = bumpy_sphere(0.05, 0.0015, 1000);
  const Mesh whole = mesh_of(made);
  for (const int count : {static_cast<int>(whole.triangles().triangles.size()), 5000, 20'000'000}) {
    const Mesh mesh = simplified_to(count, made);
    EXPECT_EQ(mesh.triangles().triangles, whole.triangles().triangles);
    EXPECT_THAT(mesh.remarks(), IsEmpty());
  }
}

TEST(MeshSimplifier, KeepsTheBestSoundMeshAndSaysSoWhereFewerTrianglesWouldBreakIt) {
  // A hole stays, so does every part; an edge that parts share stays shared.
  for (const auto& [mesh, parts, holes] :
       std::vector<std::tuple<TriangleMesh, std::size_t, int>>{{ring_mesh(), 1, 1}, {three_parts(), 3, 0}}) {
    const Mesh fewest = simplified_to(4, mesh);
    const std::size_t count = fewest.triangles().triangles.size();
    EXPECT_GT(count, 4 * parts);
    EXPECT_LT(count, 100U);
    EXPECT_THAT(fewest.remarks(), testing::ElementsAre(AllOf(HasSubstr("`triangles` asks for 4, but"),
                                                             HasSubstr(fmt::format("no fewer than {}", count)))));
    const MeshReport report = clean_mesh(fewest.triangles(), "again").report;
    EXPECT_EQ(report.open_edges, 0U);
    EXPECT_EQ(report.parts, parts);
    // Euler: vertices - edges + triangles = 2 (parts - holes).
    EXPECT_EQ(static_cast<int>(fewest.triangles().vertices.size()) - static_cast<int>(count) / 2,
              2 * (static_cast<int>(parts) - holes));
  }
  const Mesh touching = simplified_to(1000, touching_parts());
  EXPECT_LE(touching.triangles().triangles.size(), 1000U);
  const MeshReport before = clean_mesh(touching_parts(), "before").report,
                   after = clean_mesh(touching.triangles(), "after").report;
  EXPECT_EQ(after.open_edges, 0U);
  EXPECT_EQ(after.shared_edges, before.shared_edges);
  EXPECT_NEAR(after.volume, before.volume, 1e-9 * before.volume);
}

TEST(MeshSimplifier, KeepsTheOpenEdgeOfASheetOpenAndOpensNoOther) {
  const MeshReport before = clean_mesh(sheet_mesh(), "before").report;
  for (const int count : {3600, 700, 200}) {
    const Mesh mesh = simplified_to(count, sheet_mesh());
    const TriangleMesh& now = mesh.triangles();
    EXPECT_LE(now.triangles.size(), static_cast<std::size_t>(count));
    const MeshReport after = clean_mesh(now, "after").report;
    EXPECT_LE(after.open_edges, before.open_edges);
    EXPECT_GT(after.open_edges, 3U);
    EXPECT_EQ(after.shared_edges, 0U);
    EXPECT_EQ(after.turned, 0U);
    EXPECT_EQ(after.parts, 1U);
    // One border: edges = (3 triangles + border) / 2, and vertices - edges + triangles = 1.
    EXPECT_EQ(2 * now.vertices.size(), now.triangles.size() + after.open_edges + 2);
    // Nothing is folded: every triangle faces the way of the waves beside it.
    for (const auto& t : now.triangles) {
      const Vec3 &a = now.vertices[t[0]], &b = now.vertices[t[1]], &c = now.vertices[t[2]], middle = (a + b + c) / 3;
      const double x = 200 * middle.x(), y = 150 * middle.y();
      const Vec3 up(-0.6 * std::cos(x) * std::cos(y), 0.45 * std::sin(x) * std::sin(y), 1);
      EXPECT_GT((b - a).cross(c - a).normalized().dot(up.normalized()), -0.1);
    }
  }
}

TEST(MeshSimplifier, GivesTheSameMeshToTheBitWheneverItIsPrepared) {
  const TriangleMesh made = three_parts();
  const Mesh direct = simplified_to(900, made);
  EXPECT_EQ(simplified_to(900, made).triangles().triangles, direct.triangles().triangles);
  Mesh again = mesh_of(made);
  for (const int count : {300, 8000, 900}) {
    again.set("triangles", count);
    again.prepare(0);
    again.prepare(0);
  }
  EXPECT_EQ(again.triangles().triangles, direct.triangles().triangles);
  EXPECT_EQ(again.triangles().vertices, direct.triangles().vertices);
  EXPECT_EQ(again.remarks(), direct.remarks());
  const Mesh whole = mesh_of(made);
  again.set("triangles", 20'000'000);
  again.prepare(0);
  EXPECT_EQ(again.triangles().vertices, whole.triangles().vertices);
  EXPECT_EQ(again.triangles().triangles, whole.triangles().triangles);
  EXPECT_THAT(again.remarks(), IsEmpty());
}

TEST(MeshSimplifier, IsASettingOfAMeshInASceneFile) {
  const test::TempFolder folder;
  const std::string file = folder.write("ball.obj", test::obj_of(bumpy_sphere(0.05, 0.0015, 10'000)));
  const auto scene_of = [&](const nlohmann::json& triangles) {
    return read_scene({{"objects",
                        {{{"name", "ball"},
                          {"shape", {{"kind", "mesh"}, {"file", file}, {"triangles", triangles}, {"rounds", 2}}},
                          {"surface", {{"stiffness", 500}}}}}}},
                      "scene.json");
  };
  const auto scene = scene_of(1000);
  scene->prepare({.rate_hz = 1000});
  EXPECT_EQ(scene->object(0).tessellated(1, {}).triangles.size(), 1000U);
  EXPECT_THAT(scene->notes(), testing::ElementsAre(HasSubstr("ball: simplified from 9800 to 1000 triangles")));
  for (const nlohmann::json& wrong : std::vector<nlohmann::json>{0, -1, 3, 20'000'001, 1e30, 1000.5, "1000", true})
    EXPECT_THAT(error_of([&] { (void)scene_of(wrong); }), HasSubstr("triangles")) << wrong;
  // Its levels are a quarter of each other, up to the whole mesh.
  const std::vector<Knob> knobs = scene_of(20'000)->knobs();
  EXPECT_EQ(knobs.at(0).name, "ball.triangles");
  EXPECT_EQ(knobs.at(2).level, 2) << knobs.at(2).name;
  EXPECT_EQ(knobs.at(0).levels, (std::vector<double>{153, 612, 2450, 9800}));
  EXPECT_EQ(knobs.at(0).level, 20'000);
  EXPECT_EQ(mesh_of(box_mesh(Vec3::Constant(0.1))).knobs().at(0).levels, std::vector<double>{12});
}

}  // namespace
}  // namespace haptrace
