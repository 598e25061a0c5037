// Meshes: their files, the search for contacts, and the proxies of a point and a ball.
#include "scene/shape/mesh.h"

#include "formats/mesh/mesh_file.h"
#include "scene/shape/constraint_planes.h"
#include "tests/scene/meshes.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"
#include "tests/support/temp_folder.h"

#include <cmath>
#include <cstring>
#include <fmt/format.h>
#include <fstream>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <map>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

using test::box_mesh;
using test::bumpy_sphere;
using test::error_of;
using test::mesh_of;
using test::obj_of;
using test::TempFolder;
using testing::HasSubstr;

/// A tool that touches a mesh.
struct MeshHand {
  explicit MeshHand(const Mesh& touched, double ball = 0) : mesh(touched), radius(ball) {}
  const Proxy& to(const Vec3& place) {
    mesh.follow({.from = at, .to = place, .radius = radius}, proxy);
    at = place;
    return proxy;
  }
  const Mesh& mesh;
  double radius;
  Vec3 at = nan3();
  Proxy proxy;
};

/// Returns the signed volume seen from a place, over 4 pi: 1 inside of a closed mesh, 0 outside.
double winding_number(const TriangleMesh& mesh, const Vec3& place) {
  double sum = 0;
  for (const auto& t : mesh.triangles) {
    const Vec3 a = mesh.vertices[t[0]] - place, b = mesh.vertices[t[1]] - place, c = mesh.vertices[t[2]] - place;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    sum += 2 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
  }
  return sum / (4 * std::numbers::pi);
}

// --- Search ---

TEST(TriangleTree, FindsTheCrossingsAndTheClosestPointsThatASearchThroughAllFinds) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> side(-0.06, 0.06);
  TriangleMesh mesh = bumpy_sphere(0.05, 0.002, 3000);
  const TriangleTree tree(mesh);
  int crossed = 0;
  for (int i = 0; i < 2000; ++i) {
    const Vec3 from(side(random), side(random), side(random)), to(side(random), side(random), side(random));
    const Segment segment(from, to);
    double first = 2, least = 1;
    for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
      first = std::min(first, segment.crossing(tree.corner(t, 0), tree.corner(t, 1), tree.corner(t, 2)));
      least = std::min(least, (closest_on(tree.face(t), from).position - from).squaredNorm());
    }
    const TriangleTree::Hit hit = tree.sweep(from, to);
    ASSERT_EQ(static_cast<bool>(hit), first <= 1);
    if (hit) {
      ASSERT_EQ(hit.share, first);
      // From its front: the way goes against the triangle's normal.
      const Vec3 normal = (tree.corner(hit.triangle, 1) - tree.corner(hit.triangle, 0))
                              .cross(tree.corner(hit.triangle, 2) - tree.corner(hit.triangle, 0));
      ASSERT_LT(normal.dot(to - from), 0);
      ++crossed;
    }
    ASSERT_EQ(tree.nearest(from).distance2, least);
  }
  EXPECT_GT(crossed, 300);
}

TEST(TriangleTree, WindsOnceAroundPlacesInsideAndNeverAroundThoseOutside) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> side(-0.06, 0.06);
  for (TriangleMesh mesh : {bumpy_sphere(0.05, 0.002, 2000), box_mesh(Vec3(0.08, 0.06, 0.05), 4)}) {
    const TriangleTree tree(mesh);
    int inside = 0;
    for (int i = 0; i < 1000; ++i) {
      Vec3 place(side(random), side(random), side(random));
      if (i % 4 == 1) place.head<2>() = mesh.vertices[random() % mesh.vertices.size()].head<2>();  // below a vertex
      if (i % 4 == 2) place.x() = 0;                                                               // below edges
      if (tree.nearest(place).distance2 < 1e-24) continue;                                         // on the surface
      const long expected = std::lround(winding_number(mesh, place));
      ASSERT_EQ(tree.winding(place), expected) << place.transpose();
      inside += static_cast<int>(expected);
    }
    EXPECT_GT(inside, 100);
  }
}

TEST(TriangleTree, FindsTheClosestPointOfSliversToSomeRoundings) {
  std::mt19937 random(9);
  std::normal_distribution<double> number;
  const auto any = [&] { return Vec3(number(random), number(random), number(random)); };
  for (int i = 0; i < 20'000; ++i) {
    // Triangles of any length, and up to a million times longer than wide; the place is near or far.
    const double length = std::pow(10.0, -6 + i % 7), width = length * std::pow(10.0, -(i % 6));
    const Vec3 along = any().normalized(), across = along.cross(any()).normalized();
    const Vec3 a = 0.01 * any(), b = a + length * along, c = a + 0.3 * length * along + width * across;
    const Face face = make_face(a, b, c);
    const Vec3 p = a + length * any() + std::pow(10.0, -(i % 5)) * face.normal;
    const TrianglePoint found = closest_on(face, p);
    const double distance = (p - found.position).norm(), rounding = 1e-14 * (distance + length + a.norm());
    // Within the triangle, and no other place of it is nearer: this holds for one in a plane that is at right angles.
    const Vec3 out = (p - found.position) / std::max(distance, 1e-300);
    for (const Vec3& corner : face.corners) ASSERT_LE(out.dot(corner - found.position), rounding) << i;
    ASSERT_LE(std::abs(face.normal.dot(found.position - a)), rounding) << i;
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3 edge = (face.corners[(k + 1) % 3] - face.corners[k]).normalized();
      ASSERT_GE(face.normal.cross(edge).dot(found.position - face.corners[k]), -rounding) << i;
    }
  }
}

TEST(TriangleTree, LeavesNoGapAtEdgesAndCorners) {
  const TriangleMesh mesh = box_mesh(Vec3(0.02, 0.02, 0.02), 4);
  const Mesh box = mesh_of(mesh);
  TriangleMesh sorted = box.triangles();
  const TriangleTree tree(sorted);
  // Straight at every vertex and at points of every edge, from outside.
  for (const auto& t : box.triangles().triangles)
    for (std::size_t i = 0; i < 3; ++i)
      for (const double share : {0.0, 0.1, 0.5, 0.77}) {
        const Vec3 a = box.triangles().vertices[t[i]], b = box.triangles().vertices[t[(i + 1) % 3]];
        const Vec3 place = a + share * (b - a);
        ASSERT_TRUE(tree.sweep(3 * place, 0.5 * place)) << place.transpose();
      }
}

// --- Point ---

TEST(MeshPoint, FindsACornerOfACubeExactly) {
  const Mesh box = mesh_of(box_mesh(Vec3::Constant(0.02)));
  MeshHand hand(box);
  hand.to({0.012, 0.001, 0.002});
  hand.to({0.0095, 0.0093, 0.0092});
  const Proxy& proxy = hand.to({0.0095, 0.0093, 0.0092});
  ASSERT_TRUE(proxy.touching);
  EXPECT_NEAR(proxy.position.x(), 0.01, 1e-15) << "the face through which it came";
  // Pulled beyond the corner from inside, the proxy waits at the corner's nearest place.
  hand.to({0.0095, 0.0105, 0.0092});
  hand.to({0.0095, 0.0105, 0.0105});
  EXPECT_FALSE(hand.proxy.touching) << "outside of the box, the tool is free";
}

/// Pushes a tool 200 times through a plate of 1 mm, 4 mm beyond its far side, and back.
void expect_right_side_of_a_plate(int parts, double radius, bool verify) {
  Mesh plate = mesh_of(box_mesh(Vec3(0.1, 0.1, 0.001), parts));
  plate.set("verify", verify ? 1 : 0);
  plate.prepare(radius);
  std::mt19937 random(3);
  std::uniform_real_distribution<double> side(-0.04, 0.04);
  int touched = 0;
  for (int entry = 0; entry < 200; ++entry) {
    MeshHand hand(plate, radius);
    const Vec3 over(side(random), side(random), 0.005 + radius);
    Vec3 slide(side(random), side(random), 0);
    slide = 0.1 * slide;
    hand.to(over);
    for (int tick = 0; tick <= 400; ++tick) {
      const double a = std::numbers::pi * tick / 400;
      const Proxy& proxy = hand.to(over + std::sin(a) * Vec3(0, 0, -0.0095 - radius) + tick / 400.0 * slide);
      if (!proxy.touching) continue;
      ++touched;
      ASSERT_GT(proxy.normal.z(), 1 - 1e-6) << "pushed the wrong way";
      ASSERT_NEAR(proxy.position.z(), 0.0005 + radius, radius > 0 ? 2e-7 * radius : 1e-12);
    }
    ASSERT_FALSE(hand.proxy.touching) << "released";
  }
  EXPECT_GT(touched, 30'000);
}

TEST(MeshPoint, NeverLeavesAThinPlateOnTheWrongSide) {
  for (const int parts : {1, 16}) {
    expect_right_side_of_a_plate(parts, 0, false);
    expect_right_side_of_a_plate(parts, 0, true);
  }
}

TEST(MeshPoint, IsHeldByAVGrooveInTheMiddle) {
  TriangleMesh groove;
  groove.vertices = {{-0.02, -0.05, 0.02}, {0, -0.05, 0}, {0.02, -0.05, 0.02},
                     {-0.02, 0.05, 0.02},  {0, 0.05, 0},  {0.02, 0.05, 0.02}};
  groove.triangles = {{0, 1, 4}, {0, 4, 3}, {1, 2, 5}, {1, 5, 4}};
  const Mesh mesh = mesh_of(groove);
  MeshHand hand(mesh);
  hand.to({0.001, 0, 0.01});
  hand.to({0.001, 0, -0.002});
  const Proxy& proxy = hand.to({0, 0, -0.005});
  ASSERT_TRUE(proxy.touching);
  EXPECT_LT(proxy.position.norm(), 1e-15) << "the bottom of the groove";
  EXPECT_LT((proxy.normal - Vec3::UnitZ()).norm(), 1e-12) << "both sides push alike";
}

TEST(MeshPoint, StaysOnAClosedMeshThroughoutARandomWalk) {
  for (const double relief : {0.0, 0.0015}) {
    const Mesh mesh = mesh_of(bumpy_sphere(0.05, relief, 10'000));
    std::mt19937 random(4);
    std::normal_distribution<double> push;
    MeshHand hand(mesh);
    Vec3 place(0, 0, 0.06), velocity = Vec3::Zero();
    hand.to(place);
    int inside = 0, checked = 0;
    const std::size_t allocated = test::allocations();
    std::vector<std::pair<Vec3, bool>> seen;
    seen.reserve(30'000);
    const std::size_t before = test::allocations();
    for (int tick = 0; tick < 30'000; ++tick) {
      velocity +=
          1e-3 * (Vec3(push(random), push(random), push(random)) * 30 - 400 * (place - 0.05 * place.normalized())) -
          0.01 * velocity;
      place += 1e-3 * velocity;
      const Proxy& proxy = hand.to(place);
      if (!proxy.touching) {
        if (tick % 23 == 0) seen.emplace_back(place, false);
        continue;
      }
      ++inside;
      ASSERT_TRUE(is_finite(proxy.position));
      ASSERT_NEAR(proxy.normal.norm(), 1, 1e-9);
      ASSERT_GE(proxy.depth, 0);
      // It is on the surface, and the tool behind it.
      ASSERT_LT((proxy.position - place - proxy.depth * proxy.normal).norm(), 1e-12);
    }
    EXPECT_EQ(test::allocations(), before);
    (void)allocated;
    for (const auto& [where, held] : seen) {
      ++checked;
      ASSERT_LT(std::abs(winding_number(mesh.triangles(), where)), 0.5) << "free, though it is inside: it leaked";
    }
    EXPECT_GT(inside, 3000);
    EXPECT_GT(checked, 100);
  }
}

TEST(MeshPoint, ConvergesToTheSphereThatTheTrianglesStandFor) {
  double before = 1;
  for (const int triangles : {500, 2000, 8000, 32'000}) {
    const Mesh mesh = mesh_of(bumpy_sphere(0.03, 0, triangles));
    double worst = 0;
    for (int i = 0; i < 400; ++i) {
      MeshHand hand(mesh);
      const double a = 0.1 + 0.015 * i, b = 1.1 * std::sin(3.1 * i);
      const Vec3 out(std::cos(a) * std::cos(b), std::sin(a) * std::cos(b), std::sin(b));
      hand.to(0.04 * out);
      const Proxy& proxy = hand.to(0.025 * out);
      ASSERT_TRUE(proxy.touching);
      worst = std::max(worst, std::abs(proxy.depth - 0.005));
    }
    EXPECT_LT(worst, 0.5 * before) << triangles;
    before = worst;
  }
  EXPECT_LT(before, 1.2e-5);
}

TEST(MeshPoint, IsStoppedByAThinWallAtAnySpeed) {
  const Mesh plate = mesh_of(box_mesh(Vec3(0.1, 0.1, 0.0005)));
  MeshHand hand(plate);
  hand.to({0.01, 0.01, 0.1});
  const Proxy& proxy = hand.to({0.012, 0.01, -0.9});
  ASSERT_TRUE(proxy.touching);
  EXPECT_NEAR(proxy.position.z(), 0.00025, 1e-12);
  EXPECT_GT(proxy.normal.z(), 0.999);
}

TEST(MeshPoint, TouchesEdgesFromAMicrometreToTenMetres) {
  // A floor of 10 m with a tip of 1 um on it.
  TriangleMesh mesh = box_mesh(Vec3(10, 10, 1));
  test::join(mesh, box_mesh(Vec3::Constant(1e-6)), Vec3(0.3, 0.2, 0.5 + 1e-6));
  const Mesh both = mesh_of(mesh);
  MeshHand far(both);
  far.to({-4, 3, 0.6});
  ASSERT_TRUE(far.to({-4, 3, 0.499}).touching);
  EXPECT_NEAR(far.proxy.depth, 0.001, 1e-12);
  MeshHand tip(both);
  tip.to({0.3, 0.2, 0.5001});
  ASSERT_TRUE(tip.to({0.3 + 1e-7, 0.2, 0.5 + 1.2e-6}).touching);
  EXPECT_NEAR(tip.proxy.position.z(), 0.5 + 1.5e-6, 1e-12);
}

TEST(MeshPoint, GoesOnWithTheOtherFlankOfACreaseThatItCrosses) {
  // A deep V: the tool jumps from one flank through the space into the other.
  TriangleMesh groove;
  groove.vertices = {{-0.01, -0.05, 0.02}, {0, -0.05, 0}, {0.01, -0.05, 0.02},
                     {-0.01, 0.05, 0.02},  {0, 0.05, 0},  {0.01, 0.05, 0.02}};
  groove.triangles = {{0, 1, 4}, {0, 4, 3}, {1, 2, 5}, {1, 5, 4}};
  const Mesh mesh = mesh_of(groove);
  MeshHand hand(mesh);
  hand.to({0, 0, 0.015});
  ASSERT_TRUE(hand.to({-0.009, 0, 0.015}).touching);
  EXPECT_GT(hand.proxy.normal.x(), 0.8) << "the left flank";
  ASSERT_TRUE(hand.to({0.009, 0, 0.015}).touching);
  EXPECT_LT(hand.proxy.normal.x(), -0.8) << "the right flank";
}

TEST(MeshPoint, SlidesOverAnEdgeAtWhichFourTrianglesMeet) {
  // Two cubes side by side: their tops meet where their sides meet.
  TriangleMesh mesh = box_mesh(Vec3::Constant(1.0 / 64));
  test::join(mesh, box_mesh(Vec3::Constant(1.0 / 64)), Vec3(1.0 / 64, 0, 0));
  const Mesh both = mesh_of(mesh);
  MeshHand hand(both);
  hand.to({0, 0, 0.02});
  for (int i = 0; i <= 100; ++i) {
    ASSERT_TRUE(hand.to({1.0 / 64 * i / 100, 0, 0.007}).touching) << i;
    ASSERT_NEAR(hand.proxy.position.z(), 0.5 / 64, 1e-15) << i;
    ASSERT_NEAR(hand.proxy.position.x(), 1.0 / 64 * i / 100, 1e-15) << "it does not wait at the seam";
  }
}

TEST(MeshPoint, SlidesOffAnOpenEdgeAndIsFree) {
  TriangleMesh sheet;
  sheet.vertices = {{0, 0, 0}, {0.02, 0, 0}, {0.02, 0.02, 0}, {0, 0.02, 0}};
  sheet.triangles = {{0, 1, 2}, {0, 2, 3}};
  const Mesh mesh = mesh_of(sheet);
  MeshHand hand(mesh);
  hand.to({0.01, 0.01, 0.001});
  ASSERT_TRUE(hand.to({0.01, 0.012, -0.001}).touching);
  ASSERT_TRUE(hand.to({0.019, 0.012, -0.001}).touching);
  EXPECT_FALSE(hand.to({0.021, 0.012, -0.001}).touching);
}

TEST(MeshPoint, IsStoppedByAnotherPartWhenAsked) {
  // A pillar stands on a floor: two parts, which no edge joins.
  TriangleMesh mesh = box_mesh(Vec3(0.1, 0.1, 0.01));
  test::join(mesh, box_mesh(Vec3(0.01, 0.01, 0.02)), Vec3(0.02, 0, 0.012));
  Mesh both = mesh_of(mesh);
  both.set("verify", 1);
  MeshHand hand(both);
  hand.to({0, 0, 0.007});
  Proxy proxy;
  for (int i = 0; i <= 200; ++i) proxy = hand.to({0.0001 * i, 0, 0.004});
  ASSERT_TRUE(proxy.touching);
  EXPECT_LE(proxy.position.x(), 0.015 + 1e-9) << "in front of the pillar";
  EXPECT_GT(proxy.position.x(), 0.0148);
  EXPECT_NEAR(proxy.position.z(), 0.005, 1e-6);
}

TEST(MeshPoint, BeginsAtTheNearestPlaceIfTheToolIsInsideAtFirst) {
  const Mesh box = mesh_of(box_mesh(Vec3(0.02, 0.04, 0.06)));
  MeshHand hand(box);
  const Proxy& proxy = hand.to({0.008, 0.001, 0.002});
  ASSERT_TRUE(proxy.touching);
  EXPECT_TRUE(proxy.began_inside);
  EXPECT_NEAR(proxy.position.x(), 0.01, 1e-15);
  MeshHand outside(box);
  EXPECT_FALSE(outside.to({0.03, 0, 0}).touching);
}

TEST(MeshPoint, KnowsHowItsProxyMovesWithTheTool) {
  const Mesh mesh = mesh_of(box_mesh(Vec3::Constant(0.02), 3));
  const auto expect_slide = [&](const Vec3& place) {
    MeshHand hand(mesh);
    hand.to(place * 3);
    hand.to(place);
    ASSERT_TRUE(hand.proxy.touching);
    const Proxy here = hand.proxy;
    const Eigen::Matrix3d slide = mesh.slide(here);
    for (int axis = 0; axis < 3; ++axis) {
      MeshHand moved = hand;
      const Vec3 step = 1e-7 * Vec3::Unit(axis);
      const Vec3 change = moved.to(place + step).position - here.position;
      EXPECT_LT((slide * step - change).norm(), 1e-12);
    }
  };
  expect_slide({0.009, 0.0011, 0.0023});
  expect_slide({0.0021, -0.0013, -0.009});
}

TEST(MeshPoint, TurnsItsShadedNormalContinuouslyOverEdgesButNotOverCreases) {
  const Mesh ball = mesh_of(bumpy_sphere(0.03, 0, 800));
  MeshHand hand(ball);
  hand.to({0.05, 0, 0.003});
  Vec3 before = Vec3::Zero(), flat_before = Vec3::Zero();
  double largest = 0, flat = 0;
  for (int i = 0; i < 3000; ++i) {
    const double a = 5e-4 * i;
    const Proxy& proxy = hand.to(0.028 * Vec3(std::cos(a), std::sin(a), 0.1));
    ASSERT_TRUE(proxy.touching);
    const Vec3 normal = ball.smooth(proxy, 0.8);
    if (i > 0) {
      largest = std::max(largest, (normal - before).norm());
      flat = std::max(flat, (proxy.normal - flat_before).norm());
    }
    before = normal;
    flat_before = proxy.normal;
  }
  EXPECT_GT(flat, 5 * largest) << "unshaded, the normal jumps from face to face";
  const Mesh box = mesh_of(box_mesh(Vec3::Constant(0.02)));
  MeshHand edge(box);
  edge.to({0.02, 0.009, 0});
  EXPECT_LT((box.smooth(edge.to({0.0095, 0.009, 0}), 0.8) - Vec3::UnitX()).norm(), 1e-12) << "a crease stays";
}

// --- Ball ---

TEST(MeshBall, StaysAtItsRadiusFromAPlate) {
  const Mesh plate = mesh_of(box_mesh(Vec3(0.1, 0.1, 0.001), 3));
  MeshHand hand(plate, 0.002);
  hand.to({0.001, 0.002, 0.01});
  for (int i = 0; i <= 300; ++i) {
    const Proxy& proxy = hand.to({0.001 + 1e-4 * i, 0.002, 0.01 - 5e-5 * i});
    if (0.01 - 5e-5 * i > 0.0026) {
      EXPECT_FALSE(proxy.touching);
    } else if (0.01 - 5e-5 * i < 0.0024) {
      ASSERT_TRUE(proxy.touching);
      EXPECT_NEAR(proxy.position.z(), 0.0025, 1e-8);
      EXPECT_GT(proxy.normal.z(), 1 - 1e-6);
    }
  }
}

TEST(MeshBall, NeverLeavesAThinPlateOnTheWrongSide) {
  for (const int parts : {1, 16})
    for (const double radius : {2e-4, 2e-3}) expect_right_side_of_a_plate(parts, radius, false);
}

TEST(MeshBall, RoundsAnEdgeAndFillsAGrooveByItsRadius) {
  const Mesh box = mesh_of(box_mesh(Vec3::Constant(0.02)));
  MeshHand hand(box, 0.003);
  hand.to({0.02, 0.02, 0});
  const Proxy& edge = hand.to({0.0105, 0.0105, 0});
  ASSERT_TRUE(edge.touching);
  EXPECT_NEAR((edge.position - Vec3(0.01, 0.01, 0)).norm(), 0.003, 1e-7) << "at its radius from the edge";
  EXPECT_NEAR(edge.normal.x(), std::sqrt(0.5), 1e-3);

  TriangleMesh groove;
  groove.vertices = {{-0.02, -0.05, 0.02}, {0, -0.05, 0}, {0.02, -0.05, 0.02},
                     {-0.02, 0.05, 0.02},  {0, 0.05, 0},  {0.02, 0.05, 0.02}};
  groove.triangles = {{0, 1, 4}, {0, 4, 3}, {1, 2, 5}, {1, 5, 4}};
  const Mesh valley = mesh_of(groove);
  MeshHand ball(valley, 0.003);
  ball.to({0.0002, 0, 0.012});
  const Proxy* proxy = nullptr;
  for (int i = 0; i < 40; ++i) proxy = &ball.to({0.0002 * std::cos(i), 0, 0.012 - 0.0004 * i});
  ASSERT_TRUE(proxy->touching);
  EXPECT_NEAR(proxy->position.x(), 0, 2e-5);
  EXPECT_NEAR(proxy->position.z(), 0.003 * std::sqrt(2), 2e-5) << "both sides hold it";
}

TEST(MeshBall, NeverComesNearerThanItsRadiusInARandomWalk) {
  const Mesh mesh = mesh_of(bumpy_sphere(0.05, 0.0015, 3000));
  std::mt19937 random(6);
  std::normal_distribution<double> push;
  MeshHand hand(mesh, 0.002);
  Vec3 place(0, 0, 0.06), velocity = Vec3::Zero();
  hand.to(place);
  int touched = 0;
  for (int tick = 0; tick < 15'000; ++tick) {
    velocity +=
        1e-3 * (Vec3(push(random), push(random), push(random)) * 30 - 400 * (place - 0.051 * place.normalized())) -
        0.01 * velocity;
    place += 1e-3 * velocity;
    const Proxy& proxy = hand.to(place);
    if (!proxy.touching) continue;
    ++touched;
    const SurfacePoint nearest = mesh.nearest(proxy.position);
    ASSERT_GT(nearest.distance, 0.002 * (1 - 1e-6));
    ASSERT_LT(nearest.distance, 0.002 * 1.01);
  }
  EXPECT_GT(touched, 2000);
}

TEST(ConstraintPlanes, GiveTheNearestPlaceThatAllAllow) {
  std::mt19937 random(7);
  std::normal_distribution<double> number;
  for (int i = 0; i < 2000; ++i) {
    ConstraintPlanes planes;
    planes.count = 1 + static_cast<std::size_t>(i) % 3;
    const Vec3 allowed(number(random), number(random), number(random));
    for (std::size_t k = 0; k < planes.count; ++k) {
      planes.normal[k] = Vec3(number(random), number(random), number(random)).normalized();
      planes.height[k] = planes.normal[k].dot(allowed) - std::abs(number(random));
    }
    const Vec3 goal = 3 * Vec3(number(random), number(random), number(random));
    const Vec3 found = nearest_in_front(goal, planes);
    for (std::size_t k = 0; k < planes.count; ++k) ASSERT_GT(planes.normal[k].dot(found), planes.height[k] - 1e-9);
    // No other place that is allowed is nearer: random ones around.
    for (int j = 0; j < 50; ++j) {
      const Vec3 other = found + 0.3 * Vec3(number(random), number(random), number(random));
      bool ok = true;
      for (std::size_t k = 0; k < planes.count; ++k) ok = ok && planes.normal[k].dot(other) >= planes.height[k];
      if (ok) {
        ASSERT_GE((other - goal).norm(), (found - goal).norm() - 1e-9);
      }
    }
  }
}

// --- Files ---

std::string stl_of(const TriangleMesh& mesh, bool binary) {
  std::string text = binary ? std::string(80, ' ') : "solid test\n";
  const auto put = [&](const auto& value) { text.append(reinterpret_cast<const char*>(&value), sizeof value); };
  if (binary) put(static_cast<std::uint32_t>(mesh.triangles.size()));
  for (const auto& t : mesh.triangles) {
    if (binary) {
      for (int i = 0; i < 3; ++i) put(0.0F);
    } else {
      text += "facet normal 0 0 0\nouter loop\n";
    }
    for (const std::uint32_t corner : t) {
      const Vec3& v = mesh.vertices[corner];
      if (binary)
        for (int i = 0; i < 3; ++i) put(static_cast<float>(v[i]));
      else
        text += fmt::format("vertex {} {} {}\n", static_cast<float>(v.x()), static_cast<float>(v.y()),
                            static_cast<float>(v.z()));
    }
    if (binary)
      put(std::uint16_t{0});
    else
      text += "endloop\nendfacet\n";
  }
  return binary ? text : text + "endsolid test\n";
}

std::string ply_of(const TriangleMesh& mesh) {
  std::string text = fmt::format(
      "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
      "element face {}\nproperty list uchar int vertex_indices\nend_header\n",
      mesh.vertices.size(), mesh.triangles.size());
  for (const Vec3& v : mesh.vertices) text += fmt::format("{} {} {}\n", v.x(), v.y(), v.z());
  for (const auto& t : mesh.triangles) text += fmt::format("3 {} {} {}\n", t[0], t[1], t[2]);
  return text;
}

TEST(MeshFiles, AreRefusedAtOnceIfAPlyIsShorterThanItsHeaderPromises) {
  const TempFolder folder;
  for (const char* format : {"ascii", "binary_little_endian"}) {
    const std::string header = fmt::format(
        "ply\nformat {} 1.0\nelement vertex 3000000\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n",
        format);
    EXPECT_THAT(error_of([&] { load_mesh(folder.write("short.ply", header + "0 0 0\n"), "mm"); }),
                testing::AllOf(HasSubstr("shorter than its header promises: 3000000 vertex, 1 face"),
                               HasSubstr("but 6 follow")));
  }
}

TEST(MeshFiles, AreReadAlikeFromObjStlAndPly) {
  const TempFolder folder;
  const TriangleMesh mesh = bumpy_sphere(32, 1, 400);
  const MeshLoad truth = clean_mesh(mesh, "truth");
  for (const auto& [name, content] : std::vector<std::pair<std::string, std::string>>{{"a.obj", obj_of(mesh)},
                                                                                      {"a.stl", stl_of(mesh, false)},
                                                                                      {"b.stl", stl_of(mesh, true)},
                                                                                      {"a.ply", ply_of(mesh)}}) {
    const MeshLoad load = load_mesh(folder.write(name, content), "mm");
    EXPECT_EQ(load.mesh.triangles.size(), truth.mesh.triangles.size()) << name;
    EXPECT_EQ(load.mesh.vertices.size(), truth.mesh.vertices.size()) << name << ": welded";
    EXPECT_EQ(load.report.open_edges, 0U) << name;
    EXPECT_NEAR(load.report.volume, 1e-9 * truth.report.volume, 1e-7 * load.report.volume) << name;
    EXPECT_THAT(load.remarks, testing::IsEmpty()) << name;
  }
}

/// Returns a prism of height 1 over a polygon as OBJ or PLY.
std::string prism_of(const std::vector<Vec3>& base, bool ply) {
  const std::size_t n = base.size(), first = ply ? 0 : 1;
  std::string vertices, faces;
  for (const double z : {0.0, 1.0})
    for (const Vec3& corner : base) vertices += fmt::format("{}{} {} {}\n", ply ? "" : "v ", corner.x(), corner.y(), z);
  const auto face = [&](const std::vector<std::size_t>& corners) {
    faces += ply ? fmt::format("{}", corners.size()) : "f";
    for (const std::size_t corner : corners) faces += fmt::format(" {}", corner + first);
    faces += '\n';
  };
  std::vector<std::size_t> top, bottom;
  for (std::size_t i = 0; i < n; ++i) {
    top.push_back(n + i);
    bottom.push_back(n - 1 - i);
    face({i, (i + 1) % n, n + (i + 1) % n, n + i});
  }
  face(top);
  face(bottom);
  if (!ply) return vertices + faces;
  return fmt::format(
             "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n"
             "element face {}\nproperty list int int vertex_indices\nend_header\n",
             2 * n, n + 2) +
         vertices + faces;
}

TEST(MeshFiles, StayClosedWhereTheirPolygonsAreHollow) {
  std::map<std::string, std::vector<Vec3>> polygons{
      {"square", {{0, 0, 0}, {4, 0, 0}, {4, 4, 0}, {0, 4, 0}}},
      {"arrow", {{0, 0, 0}, {4, 0, 0}, {1, 1, 0}, {0, 4, 0}}},
      {"dent", {{0, 0, 0}, {4, 0, 0}, {4, 4, 0}, {2, 1, 0}, {0, 4, 0}}},
      {"corners on a side", {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {4, 0, 0}, {4, 4, 0}, {0, 4, 0}, {0, 2, 0}}},
      {"C", {{0, 0, 0}, {4, 0, 0}, {4, 1, 0}, {1, 1, 0}, {1, 3, 0}, {4, 3, 0}, {4, 4, 0}, {0, 4, 0}}}};
  std::mt19937 random(1);
  std::uniform_real_distribution<double> radius(0.2, 2);
  for (const int corners : {10, 57, 300})
    for (int i = 0; i < corners; ++i) {
      const double angle = 2 * std::numbers::pi * i / corners;
      polygons[fmt::format("star of {}", corners)].push_back(radius(random) *
                                                             Vec3(std::cos(angle), std::sin(angle), 0));
    }
  const TempFolder folder;
  for (const auto& [name, base] : polygons) {
    double area = 0;
    for (std::size_t i = 0; i < base.size(); ++i) area += 0.5 * base[i].cross(base[(i + 1) % base.size()]).z();
    for (const bool ply : {false, true}) {
      const MeshLoad load = load_mesh(folder.write(ply ? "a.ply" : "a.obj", prism_of(base, ply)), "m");
      EXPECT_EQ(load.report.open_edges, 0U) << name << (ply ? " ply" : " obj");
      EXPECT_NEAR(load.report.volume, area, 1e-6 * area) << name;
      EXPECT_EQ(load.mesh.triangles.size(), 4 * base.size() - 4) << name << ": each covered once";
    }
  }
}

TEST(MeshFiles, OfObjGoOnInTheNextLineAndCountBackwards) {
  const TempFolder folder;
  const std::string cube =
      "# a cube\r\nv -1 -1 -1\r\nv 1 -1 -1 1.0\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\n\tv 1 -1 1\nv 1 1 1 0.1 0.2 0.3\n"
      "v -1 1 1\nvn 0 0 1\nvt 0 0\nmtllib none.mtl\nusemtl none\ng a b\ns 1\nl 1 2\n"
      "f 1/1/1 4/1/1 3//1 \\\n 2/1 # the bottom\nf -4 -3 -2 -1\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8";
  const MeshLoad load = load_mesh(folder.write("cube.obj", cube), "mm");
  EXPECT_THAT(load.remarks, testing::IsEmpty());
  EXPECT_NEAR(load.report.volume, 8e-9, 1e-20);
}

/// Returns the mesh with every triangle turned over.
TriangleMesh turned_over(TriangleMesh mesh) {
  for (auto& triangle : mesh.triangles) std::swap(triangle[1], triangle[2]);
  return mesh;
}

TEST(MeshFiles, HaveEveryPartThatIsInsideOutTurnedOver) {
  const TriangleMesh ball = bumpy_sphere(0.02, 0, 400), small = bumpy_sphere(0.01, 0, 100);
  const double whole = clean_mesh(ball, "m").report.volume, part = clean_mesh(small, "m").report.volume;
  const auto load_of = [](TriangleMesh first, const TriangleMesh& second, const Vec3& shift) {
    test::join(first, second, shift);
    return clean_mesh(std::move(first), "m");
  };
  // Two balls beside each other: each is judged by itself.
  const Vec3 beside(0.1, 0, 0);
  EXPECT_THAT(load_of(ball, small, beside).remarks, testing::IsEmpty());
  const MeshLoad one = load_of(ball, turned_over(small), beside);
  EXPECT_THAT(testing::PrintToString(one.remarks), HasSubstr("1 of 2 parts was inside out, and was turned over"));
  EXPECT_NEAR(one.report.volume, whole + part, 1e-9 * whole);
  const MeshLoad both = load_of(turned_over(ball), turned_over(small), beside);
  EXPECT_THAT(testing::PrintToString(both.remarks), HasSubstr("the mesh was inside out"));
  EXPECT_NEAR(both.report.volume, whole + part, 1e-9 * whole);
  // One within the other is a cavity if it is wound the other way round.
  const MeshLoad hollow = load_of(ball, turned_over(small), Vec3::Zero());
  EXPECT_THAT(hollow.remarks, testing::IsEmpty());
  EXPECT_NEAR(hollow.report.volume, whole - part, 1e-9 * whole);
  const MeshLoad hollow_turned = load_of(turned_over(ball), small, Vec3::Zero());
  EXPECT_THAT(testing::PrintToString(hollow_turned.remarks), HasSubstr("the mesh was inside out"));
  EXPECT_NEAR(hollow_turned.report.volume, whole - part, 1e-9 * whole);
  // A part that is open elsewhere does not hide one that is inside out.
  TriangleMesh open = ball;
  open.triangles.pop_back();
  EXPECT_THAT(testing::PrintToString(load_of(open, turned_over(small), beside).remarks),
              HasSubstr("1 of 2 parts was inside out"));
}

TEST(MeshFiles, WarnOfOpenPartsThatLookInwards) {
  const auto remarks_of = [](TriangleMesh mesh) {
    return testing::PrintToString(clean_mesh(std::move(mesh), "m").remarks);
  };
  TriangleMesh open = bumpy_sphere(0.02, 0, 400);
  open.triangles.pop_back();
  EXPECT_THAT(remarks_of(open), testing::Not(HasSubstr("looks inwards")));
  EXPECT_THAT(remarks_of(turned_over(open)), HasSubstr("1 part is open and looks inwards, the first at triangle 1:"));
  TriangleMesh second = bumpy_sphere(0.03, 0, 400);
  const std::size_t first = second.triangles.size();
  test::join(second, turned_over(open), Vec3(0.1, 0, 0));
  EXPECT_THAT(remarks_of(second), HasSubstr(fmt::format("the first at triangle {}:", first + 1)));
  // A sheet and a valley have no inside, whichever way they look.
  for (const double depth : {0.0, 0.02, -0.02}) {
    const TriangleMesh sheet = grid_mesh(8, 8, {}, [&](double u, double v) {
      return Vec3(0.1 * u, 0.1 * v, depth * (std::pow(2 * u - 1, 2) + std::pow(2 * v - 1, 2)));
    });
    EXPECT_THAT(remarks_of(sheet), testing::Not(HasSubstr("looks inwards"))) << depth;
  }
}

TEST(MeshFiles, KeepTheirOutsideWhereANodeOfGltfMirrorsThem) {
  const TempFolder folder;
  for (const char* scale : {"[1, 1, 1]", "[-1, 1, 1]", "[-1, -1, 1]", "[1, -3, 1]"}) {
    // One triangle in the plane z = 0 that looks along z, as three vertices of 32-bit floats.
    const std::string text = fmt::format(
        R"({{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [0]}}],
            "nodes": [{{"mesh": 0, "scale": {}}}], "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}}}]}}],
            "accessors": [{{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                            "min": [0, 0, 0], "max": [1, 1, 0]}}],
            "bufferViews": [{{"buffer": 0, "byteLength": 36}}],
            "buffers": [{{"byteLength": 36, "uri": "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}}]}})",
        scale);
    const TriangleMesh mesh = load_mesh(folder.write("a.gltf", text), "m").mesh;
    ASSERT_EQ(mesh.triangles.size(), 1U) << scale;
    const auto& t = mesh.triangles[0];
    const Vec3 facing = (mesh.vertices[t[1]] - mesh.vertices[t[0]]).cross(mesh.vertices[t[2]] - mesh.vertices[t[0]]);
    EXPECT_GT(facing.z(), 0) << scale;
  }
}

TEST(MeshFiles, AreRepairedWithANoteWhereThatIsPossible) {
  const auto remarks_of = [](TriangleMesh mesh) {
    return testing::PrintToString(clean_mesh(std::move(mesh), "m").remarks);
  };
  const TriangleMesh good = box_mesh(Vec3::Constant(0.02), 2);
  EXPECT_EQ(remarks_of(good), "{}");
  TriangleMesh mesh = good;
  std::swap(mesh.triangles[3][0], mesh.triangles[3][1]);
  EXPECT_THAT(remarks_of(mesh), HasSubstr("1 triangle was wound the other way round"));
  mesh = good;
  for (auto& t : mesh.triangles) std::swap(t[0], t[1]);
  EXPECT_THAT(remarks_of(mesh), HasSubstr("inside out"));
  EXPECT_GT(clean_mesh(mesh, "m").report.volume, 0);
  mesh = good;
  mesh.triangles.push_back({0, 0, 1});
  mesh.triangles.push_back(mesh.triangles[5]);
  EXPECT_THAT(remarks_of(mesh), testing::AllOf(HasSubstr("1 triangle has no area and was left out"),
                                               HasSubstr("1 triangle is there twice")));
  mesh = good;
  mesh.triangles.pop_back();
  EXPECT_THAT(remarks_of(mesh), HasSubstr("3 edges are open"));
  mesh = good;
  for (Vec3& v : mesh.vertices) v *= 1000;
  EXPECT_THAT(remarks_of(mesh), HasSubstr("is its unit right?"));
}

TEST(MeshFiles, AreRefusedWithTheReason) {
  const TempFolder folder;
  const auto error = [&](const std::string& name, const std::string& content) {
    return error_of([&] { load_mesh(folder.write(name, content), "mm"); });
  };
  EXPECT_THAT(error_of([&] { load_mesh(folder / "none.obj", "mm"); }), HasSubstr("none.obj: no such file"));
  EXPECT_THAT(error_of([&] { load_mesh(folder.write("a.obj", "v 0 0 0\n"), "parsec"); }),
              HasSubstr("unit 'parsec' is no length"));
  EXPECT_THAT(error("a.obj", "v 0 0 0\n"), HasSubstr("a.obj: has no triangles"));
  EXPECT_THAT(error("a.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 9\n"), HasSubstr("a.obj"));
  EXPECT_THAT(error("a.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\n\nf 1 2 9\n"),
              HasSubstr("a.obj:5: the face names vertex 9, but there are 3"));
  EXPECT_THAT(error("a.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 0 1 2\n"), HasSubstr("a.obj:4: '0' is no vertex of a face"));
  EXPECT_THAT(error("a.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3x\n"), HasSubstr("'3x' is no vertex of a face"));
  EXPECT_THAT(error("a.obj", "v 0 0 0\nf 1 1 \\"), HasSubstr("a.obj:2: the line continues"));
  EXPECT_THAT(error("a.obj", "v 0 0\n"), HasSubstr("a.obj:1: '' is no coordinate"));
  EXPECT_THAT(error("a.obj", "v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n"), HasSubstr("a.obj:3: 'nan' is no coordinate"));
  EXPECT_THAT(error("a.stl", "solid nothing"), HasSubstr("a.stl"));
  const std::string cut = std::string(80, ' ') + std::string({100, 0, 0, 0}) + std::string(3 * 50 + 20, '\0');
  EXPECT_THAT(error("cut.stl", cut), HasSubstr("cut.stl: promises 100 triangles, but ends after 3; is it complete?"));
  EXPECT_THAT(error("a.xyz", "hello"), HasSubstr("cannot be read as a mesh"));
  EXPECT_THAT(error("a.glb", "glTF rubbish"), HasSubstr("a.glb"));
  TriangleMesh flat;
  flat.vertices = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}};
  flat.triangles = {{0, 1, 2}};
  EXPECT_THAT(error_of([&] { clean_mesh(flat, "m"); }), HasSubstr("none of its triangles has an area"));
  // A Moebius strip.
  TriangleMesh strip;
  constexpr int kParts = 20;
  for (int i = 0; i < kParts; ++i)
    for (const double side : {-1.0, 1.0}) {
      const double a = 2 * std::numbers::pi * i / kParts;
      strip.vertices.emplace_back((2 + 0.5 * side * std::cos(a / 2)) * std::cos(a),
                                  (2 + 0.5 * side * std::cos(a / 2)) * std::sin(a), 0.5 * side * std::sin(a / 2));
    }
  for (std::uint32_t i = 0; i < kParts; ++i) {
    const std::uint32_t a = 2 * i, b = 2 * i + 1;
    const bool last = i + 1 == kParts;
    const std::uint32_t c = last ? 1 : a + 2, d = last ? 0 : b + 2;
    strip.triangles.push_back({a, c, b});
    strip.triangles.push_back({c, d, b});
  }
  EXPECT_THAT(error_of([&] { clean_mesh(strip, "m"); }), HasSubstr("only one side"));
}

TEST(MeshFiles, NeverCrashHoweverTheyAreBroken) {
  const TempFolder folder;
  std::mt19937 random(8);
  const TriangleMesh mesh = box_mesh(Vec3::Constant(20));
  int read = 0, refused = 0;
  for (const auto& [name, whole] : std::vector<std::pair<std::string, std::string>>{{"a.obj", obj_of(mesh)},
                                                                                    {"a.stl", stl_of(mesh, false)},
                                                                                    {"b.stl", stl_of(mesh, true)},
                                                                                    {"a.ply", ply_of(mesh)}})
    for (int i = 0; i < 24; ++i) {
      std::string content = whole;
      if (i % 3 == 0) content.resize(random() % whole.size());
      if (i % 3 == 1) content[random() % whole.size()] = static_cast<char>(random());
      if (i % 3 == 2) content.insert(random() % whole.size(), std::to_string(static_cast<std::int32_t>(random())));
      try {
        (void)load_mesh(folder.write(name, content), "mm");
        ++read;
      } catch (const Error& error) {
        ++refused;
        EXPECT_THAT(error.what(), HasSubstr(name));
      }
    }
  EXPECT_GT(read, 5);
  EXPECT_GT(refused, 10);
}

}  // namespace
}  // namespace haptrace
