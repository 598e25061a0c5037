// Patches of NURBS: evaluation, proxies, edges, poles, trimming, and what is refused.
#include "scene/shape/nurbs.h"

#include "tests/scene/alone.h"
#include "tests/scene/nurbs_patches.h"
#include "tests/scene/solid_cases.h"
#include "tests/support/errors.h"
#include "tests/support/temp_folder.h"

#include <fmt/format.h>
#include <fstream>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

namespace haptrace {
namespace {

using nlohmann::json;
using test::Alone;
using test::error_of;
using test::nurbs_object;
using test::shape_of;
using test::TempFolder;
using testing::AllOf;
using testing::HasSubstr;

std::vector<NurbsData> patches_of(const std::vector<json>& patches) {
  const json object{{"patches", patches}};
  JsonReader reader(object, "test");
  return read_nurbs_patches(reader);
}

/// A tool that touches patches.
struct NurbsHand {
  explicit NurbsHand(const std::string& object, double ball = 0) : shape(shape_of(object)), radius(ball) {
    shape->prepare(radius);
  }
  const Proxy& to(const Vec3& place) {
    shape->follow({.from = at, .to = place, .radius = radius}, proxy);
    at = place;
    return proxy;
  }
  void set(const std::string& knob, double level) {
    shape->set(knob, level);
    shape->prepare(radius);
  }
  std::unique_ptr<Shape> shape;
  double radius;
  Vec3 at = nan3();
  Proxy proxy;
};

// --- Evaluation ---

TEST(NurbsPatch, IsTheSphereThatItsPointsSayToTheLastDigit) {
  for (const double radius : {0.05, 1.0}) {
    const NurbsPatch patch(patches_of({test::sphere_patch(radius)})[0]);
    for (int i = 0; i <= 80; ++i)
      for (int j = 0; j <= 40; ++j) {
        const SurfaceJet jet = patch.jet(4 * i / 80.0, 2 * j / 40.0);
        ASSERT_NEAR(jet.s.norm(), radius, 1e-15) << i << ' ' << j;
      }
  }
}

TEST(NurbsPatch, HasTheDerivativesThatDifferencesShow) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> side(-0.05, 0.05), weight(0.3, 3), inner(0, 1);
  for (int degree_u = 1; degree_u <= 5; ++degree_u)
    for (int degree_v = 1; degree_v <= 5; ++degree_v) {
      NurbsData data;
      data.degree = {degree_u, degree_v};
      data.count = {degree_u + 4, degree_v + 3};
      for (std::size_t s = 0; s < 2; ++s) {
        std::vector<double>& knots = data.knots[s];
        knots.assign(static_cast<std::size_t>(data.degree[s]) + 1, 0);
        for (int i = data.degree[s] + 1; i < data.count[s]; ++i) knots.push_back(inner(random));
        std::sort(knots.begin(), knots.end());
        knots.insert(knots.end(), static_cast<std::size_t>(data.degree[s]) + 1, 1);
      }
      for (int i = 0; i < data.count[0] * data.count[1]; ++i)
        data.points.emplace_back(side(random), side(random), side(random), weight(random));
      check_nurbs(data, "test");
      const NurbsPatch patch(data);
      constexpr double kStep = 1e-6;
      for (int i = 0; i < 40; ++i) {
        const double u = inner(random), v = inner(random);
        const auto near_knot = [&](std::size_t s, double x) {
          return std::any_of(data.knots[s].begin(), data.knots[s].end(),
                             [&](double k) { return std::abs(k - x) < 2 * kStep; });
        };
        if (near_knot(0, u) || near_knot(1, v)) continue;
        const SurfaceJet jet = patch.jet(u, v), a = patch.jet(u - kStep, v), b = patch.jet(u + kStep, v),
                         c = patch.jet(u, v - kStep), d = patch.jet(u, v + kStep);
        const auto near = [&](const Vec3& exact, const Vec3& after, const Vec3& before) {
          const Vec3 quotient = (after - before) / (2 * kStep);
          return (quotient - exact).norm() < 1e-5 * (1 + exact.norm());
        };
        EXPECT_TRUE(near(jet.u, b.s, a.s) && near(jet.v, d.s, c.s)) << degree_u << degree_v;
        EXPECT_TRUE(near(jet.uu, b.u, a.u) && near(jet.vv, d.v, c.v)) << degree_u << degree_v;
        EXPECT_TRUE(near(jet.uv, d.u, c.u) && near(jet.uv, b.v, a.v)) << degree_u << degree_v;
      }
    }
}

TEST(NurbsPatch, IsTheSameSurfaceWhenItIsSplitAtItsCreases) {
  const NurbsData whole = patches_of({test::sphere_patch(0.05)})[0];
  const std::vector<NurbsData> parts = split_at_creases(whole);
  ASSERT_EQ(parts.size(), 8U);
  const NurbsPatch patch(whole);
  for (const NurbsData& part : parts) {
    check_nurbs(part, "part");
    const NurbsPatch piece(part);
    for (int i = 0; i <= 10; ++i)
      for (int j = 0; j <= 10; ++j) {
        const Vec2 at = piece.least() + (piece.most() - piece.least()).cwiseProduct(Vec2(i, j) / 10.0);
        ASSERT_LT((piece.jet(at.x(), at.y()).s - patch.jet(at.x(), at.y()).s).norm(), 1e-16);
      }
  }
}

// --- The proxy ---

TEST(NurbsSphere, PushesAsTheSphereDoes) {
  for (const double radius : {0.0, 4e-3}) {
    NurbsHand nurbs(nurbs_object({test::sphere_patch(0.05)}), radius);
    NurbsHand sphere(R"({"kind": "sphere", "radius": 0.05})", radius);
    std::mt19937 random(2);
    std::normal_distribution<double> push(0, 1);
    Vec3 place(0, 0.01, 0.07);
    Vec3 velocity = Vec3::Zero();
    int touched = 0, outside = 0;
    for (int tick = 0; tick < 60'000; ++tick) {
      const double over = place.norm() - 0.05 - radius;
      velocity += 0.02 * Vec3(push(random), push(random), push(random)) - 0.3 * (over + 1e-3) * 40 * place.normalized();
      velocity *= 0.98;
      if (place.norm() < 0.04) velocity += 0.1 * place.normalized();
      place += 1e-3 * velocity;
      const Proxy &own = nurbs.to(place), &exact = sphere.to(place);
      const double depth = 0.05 + radius - place.norm();
      if (std::abs(depth) < 1e-12) continue;
      ASSERT_EQ(own.touching, depth > 0) << tick << ' ' << depth;
      if (!own.touching) {
        ++outside;
        continue;
      }
      ++touched;
      // Force for 1000 N/m.
      ASSERT_LT(1000 * (own.depth * own.normal - exact.depth * exact.normal).norm(), 1e-9)
          << tick << ' ' << place.transpose();
      ASSERT_LT((own.position - exact.position).norm(), 1e-12);
    }
    EXPECT_GT(touched, 15'000);
    EXPECT_GT(outside, 1000);
  }
}

TEST(NurbsSphere, IsTouchedAtItsPolesAndAcrossThem) {
  for (const double side : {1.0, -1.0})
    for (const double miss : {0.0, 1e-9, 1e-6, 1e-4, 3e-3}) {
      NurbsHand hand(nurbs_object({test::sphere_patch(0.05)}));
      for (int turn = 0; turn < 7; ++turn) {
        const double angle = 0.3 + 0.9 * turn;
        const Vec3 way(std::cos(angle), std::sin(angle), 0), off(-way.y(), way.x(), 0);
        hand.to(side * Vec3(0, 0, 0.08));
        hand.proxy = {};
        hand.to(-0.02 * way + miss * off + Vec3(0, 0, side * 0.06));
        for (int i = -200; i <= 200; ++i) {
          const Vec3 place = 1e-4 * i * way + miss * off + Vec3(0, 0, side * 0.044);
          const Proxy& proxy = hand.to(place);
          ASSERT_TRUE(proxy.touching);
          ASSERT_NEAR(proxy.depth, 0.05 - place.norm(), 1e-12) << miss << ' ' << i << ' ' << turn;
          ASSERT_LT((proxy.normal - place.normalized()).norm(), 1e-9 + (miss > 0 ? 1e-16 / miss : 0))
              << "the surface itself is rounded" << miss << ' ' << i << ' ' << turn;
        }
      }
    }
}

TEST(NurbsSphere, IsEnteredAtAnySpeedFromAnywhere) {
  NurbsHand hand(nurbs_object({test::sphere_patch(0.05)}));
  std::mt19937 random(3);
  std::normal_distribution<double> push(0, 1);
  for (int i = 0; i < 20'000; ++i) {
    const Vec3 from =
        (0.0501 + 0.01 * std::abs(push(random))) * Vec3(push(random), push(random), push(random)).normalized();
    const Vec3 to = (0.05 - std::pow(10, -1.5 + 3 * push(random)) * 1e-3) *
                    Vec3(from + 0.01 * Vec3(push(random), push(random), push(random))).normalized();
    hand.proxy = {};
    hand.at = from;
    const Proxy& proxy = hand.to(to);
    if (to.norm() < 0.02) continue;
    ASSERT_EQ(proxy.touching, to.norm() < 0.05) << from.transpose() << " to " << to.transpose();
    ASSERT_FALSE(proxy.began_inside);
    if (proxy.touching) {
      ASSERT_NEAR(proxy.depth, 0.05 - to.norm(), 1e-12);
    }
  }
}

TEST(NurbsSphere, SlidesAsTheDifferenceQuotientOfItsProxy) {
  for (const double radius : {0.0, 5e-3}) {
    NurbsHand hand(nurbs_object({test::sphere_patch(0.05)}), radius);
    NurbsHand saddle(nurbs_object({test::monkey_patch(-0.1, 0.1, -0.1, 0.1, 30)}), radius);
    std::mt19937 random(4);
    std::uniform_real_distribution<double> side(-1, 1);
    for (int i = 0; i < 200; ++i)
      for (NurbsHand* one : {&hand, &saddle}) {
        const Vec3 out = Vec3(side(random), side(random), 0.9).normalized();
        const double x = 0.05 * side(random), y = 0.05 * side(random);
        const Vec3 place =
            one == &hand ? Vec3((0.045 + radius) * out) : Vec3(x, y, 30 * (x * x * x - 3 * x * y * y) + radius - 1e-3);
        one->proxy = {};
        one->at = place + Vec3(0, 0, 0.02);
        const Proxy proxy = one->to(place);
        ASSERT_TRUE(proxy.touching);
        const Eigen::Matrix3d slide = one->shape->slide(proxy);
        constexpr double kStep = 1e-7;
        Eigen::Matrix3d quotient;
        for (int axis = 0; axis < 3; ++axis) {
          Vec3 moved[2];
          for (const int way : {0, 1}) {
            Proxy there = proxy;
            one->shape->follow(
                {.from = place, .to = place + (2 * way - 1) * kStep * Vec3::Unit(axis), .radius = radius}, there);
            moved[way] = there.position;
          }
          quotient.col(axis) = (moved[1] - moved[0]) / (2 * kStep);
        }
        ASSERT_LT((slide - quotient).norm(), 1e-5 * (1 + slide.norm())) << slide << "\n\n"
                                                                        << quotient << "\n"
                                                                        << place.transpose();
      }
  }
}

TEST(NurbsSeam, IsCrossedWithoutAJumpOfTheForce) {
  // The same saddle, in one patch and in four of different sizes with different parameters.
  json turned = test::monkey_patch(0.02, 0.1, -0.1, 0.01, 20);
  turned["knots_u"] = {5, 5, 5, 5, 9, 9, 9, 9};
  const std::vector<json> four{test::monkey_patch(-0.1, 0.02, -0.1, 0.01, 20), turned,
                               test::monkey_patch(-0.1, 0.02, 0.01, 0.1, 20),
                               test::monkey_patch(0.02, 0.1, 0.01, 0.1, 20)};
  for (const double radius : {0.0, 3e-3}) {
    NurbsHand whole(nurbs_object({test::monkey_patch(-0.1, 0.1, -0.1, 0.1, 20)}), radius);
    NurbsHand parts(nurbs_object(four), radius);
    for (int path = 0; path < 6; ++path) {
      const double angle = path;
      whole.proxy = parts.proxy = {};
      whole.at = parts.at = nan3();
      Vec3 before = Vec3::Zero();
      for (int i = -400; i <= 400; ++i) {
        const Vec3 place(0.02 + 1e-4 * i * std::cos(angle), 0.01 + 1e-4 * i * std::sin(angle),
                         i == -400 ? 0.05 : -1e-3 + radius);
        const Vec3 at(place.x(), place.y(),
                      place.z() + 20 * (std::pow(place.x(), 3) - 3 * place.x() * place.y() * place.y()));
        const Proxy &a = whole.to(at), &b = parts.to(at);
        ASSERT_EQ(a.touching, b.touching) << path << ' ' << i;
        if (i == -400) continue;
        const Vec3 force = 1000 * b.depth * b.normal;
        ASSERT_LT((1000 * a.depth * a.normal - force).norm(), 1e-9) << path << ' ' << i;
        if (i > -399) {
          ASSERT_LT((force - before).norm(), 0.02) << "1 m/s at 1 kHz, on radii of curvature above 10 mm";
        }
        before = force;
      }
    }
  }
}

TEST(NurbsSteps, ErrLessWithEveryStepOfNewton) {
  // Sliding at 2 m/s over a saddle with a radius of curvature of about 10 mm.
  double before = 1;
  for (const double steps : {1.0, 2.0, 3.0}) {
    NurbsHand coarse(nurbs_object({test::monkey_patch(-0.05, 0.05, -0.05, 0.05, 300)})),
        exact(nurbs_object({test::monkey_patch(-0.05, 0.05, -0.05, 0.05, 300)}));
    coarse.set("steps", steps);
    exact.set("steps", 6);
    double worst = 0;
    for (int i = -12; i <= 12; ++i) {
      const double x = 2e-3 * i, y = 0.01;
      const Vec3 place(x, y, 300 * (x * x * x - 3 * x * y * y) + (i == -12 ? 0.01 : -3e-3));
      coarse.to(place);
      exact.to(place);
      exact.to(place);
      if (i > -12)
        worst = std::max(
            worst, 1000 * (coarse.proxy.depth * coarse.proxy.normal - exact.proxy.depth * exact.proxy.normal).norm());
    }
    EXPECT_LT(worst, 0.2 * before) << steps;
    before = std::max(worst, 1e-12);
  }
  EXPECT_LT(before, 1e-4);
}

// --- Edges ---

TEST(NurbsEdge, LetsTheToolOffWhereNothingIsJoined) {
  NurbsHand hand(nurbs_object({test::plate_patch({-0.05, -0.05}, {0.05, 0.05}, 0)}));
  hand.to({0.03, 0, 0.01});
  for (int i = 0; i < 300; ++i) {
    const double x = 0.03 + 1e-4 * i;
    const Proxy& proxy = hand.to({x, 0.001, -0.002});
    if (std::abs(x - 0.05) < 1.1e-4) continue;
    ASSERT_EQ(proxy.touching, x < 0.05) << x;
    if (proxy.touching) {
      ASSERT_NEAR(proxy.depth, 0.002, 1e-15);
    }
  }
  // From behind, it passes.
  EXPECT_FALSE(hand.to({0.02, 0, -0.002}).touching);
  EXPECT_FALSE(hand.to({0.02, 0, -0.00001}).touching);
  EXPECT_FALSE(hand.to({0.02, 0, 0.00001}).touching);
  EXPECT_FALSE(hand.to({0.02, 0, 0.004}).touching);
  EXPECT_TRUE(hand.to({0.02, 0, -0.00001}).touching) << "and from the front again";
}

TEST(NurbsEdge, LetsABallRollOverAnOpenEdge) {
  constexpr double kRadius = 5e-3;
  NurbsHand hand(nurbs_object({test::plate_patch({-0.05, -0.05}, {0.05, 0.05}, 0)}), kRadius);
  hand.to({0.03, 0, 0.01});
  int over = 0;
  for (int i = 0; i < 300; ++i) {
    const Vec3 place(0.03 + 1e-4 * i, 0.001, 0.004);
    const Proxy& proxy = hand.to(place);
    const double beyond = std::max(0.0, place.x() - 0.05), depth = kRadius - std::hypot(beyond, 0.004);
    ASSERT_EQ(proxy.touching, depth > 0) << i;
    if (!proxy.touching) continue;
    ASSERT_NEAR(proxy.depth, depth, 1e-12);
    if (beyond == 0) continue;
    ++over;
    ASSERT_LT((proxy.normal - Vec3(beyond, 0, 0.004).normalized()).norm(), 1e-9);
  }
  EXPECT_GT(over, 20);
}

/// The six sides of a cube as patches; one of them turned over.
std::vector<json> cube_patches(double half) {
  std::vector<json> sides;
  for (int axis = 0; axis < 3; ++axis)
    for (const double sign : {-1.0, 1.0}) {
      json rows = json::array();
      for (const double a : {-half, half}) {
        json row = json::array();
        for (const double b : {-half, half}) {
          Vec3 p;
          p[axis] = sign * half;
          p[(axis + 1) % 3] = a * (axis == 1 ? -sign : sign);
          p[(axis + 2) % 3] = b;
          row.push_back({p.x(), p.y(), p.z()});
        }
        rows.push_back(row);
      }
      sides.push_back({{"degree", 1}, {"knots_u", {0, 0, 1, 1}}, {"knots_v", {0, 0, 1, 1}}, {"points", rows}});
    }
  return sides;
}

TEST(NurbsEdge, LetsTheToolRoundTheEdgesOfACube) {
  // The sides do not agree where they look; the first one decides, so that it has to be flipped.
  const std::string object = nurbs_object(cube_patches(0.02));
  const auto shape = shape_of(object);
  EXPECT_THAT(shape->remarks(), testing::Contains(HasSubstr("looked the other way")));
  const bool outside_in = shape->nearest({0, 0, 0.03}).distance < 0;
  json turned = json::parse(object);
  turned["flip"] = outside_in;
  for (const double radius : {0.0, 3e-3}) {
    NurbsHand hand(turned.dump(), radius);
    NurbsHand box(R"({"kind": "box", "size": 0.04})", radius);
    std::mt19937 random(5);
    std::normal_distribution<double> push(0, 1);
    Vec3 place(0.01, 0, 0.03), velocity = Vec3::Zero();
    const auto distance = test::box_distance(Vec3::Constant(0.02));
    int touched = 0, edges = 0;
    for (int tick = 0; tick < 40'000; ++tick) {
      velocity += 0.03 * Vec3(push(random), push(random), push(random)) -
                  4 * (place - 0.022 * place.normalized() * std::sqrt(1.5));
      velocity *= 0.97;
      place += 1e-3 * velocity;
      // A point inside the cube, at a place that several sides are equally far from, is not compared.
      const Proxy &own = hand.to(place), &exact = box.to(place);
      if (std::abs(distance(place) - radius) < 1e-9) continue;
      ASSERT_EQ(own.touching, exact.touching) << tick << ' ' << place.transpose() << ' ' << distance(place);
      if (!own.touching) continue;
      ++touched;
      if (std::abs(own.normal.cwiseAbs().maxCoeff() - 1) > 1e-6) ++edges;
      ASSERT_NEAR(own.depth, exact.depth, 1e-10) << tick << ' ' << place.transpose();
      ASSERT_LT((own.normal - exact.normal).norm(), 1e-7) << tick;
    }
    EXPECT_GT(touched, 2000);
    if (radius > 0) {
      EXPECT_GT(edges, 100);
    }
  }
}

// --- Trimming ---

TEST(NurbsTrim, LetsTheToolFallIntoAHole) {
  // A round hole of radius 0.01 m, as a rational curve in (u, v).
  json plate = test::plate_patch({-0.05, -0.05}, {0.05, 0.05}, 0);
  json circle = json::array();
  for (const Vec3& p : test::arc_points(4)) circle.push_back({0.5 + 0.1 * p.x(), 0.5 + 0.1 * p.y(), p.z()});
  plate["trim"] = {{"holes", {{{{"degree", 2}, {"knots", test::arc_knots(4)}, {"points", circle}}}}}};
  NurbsHand hand(nurbs_object({plate}));
  for (int turn = 0; turn < 12; ++turn) {
    const double angle = 0.1 + turn;
    const Vec3 way(std::cos(angle), std::sin(angle), 0);
    hand.proxy = {};
    hand.to(-0.03 * way + Vec3(0, 0, 0.01));
    for (int i = 0; i <= 250; ++i) {
      const Vec3 place = (-0.03 + 1e-4 * i) * way - Vec3(0, 0, 0.002);
      const Proxy& proxy = hand.to(place);
      const double rho = place.head<2>().norm();
      if (std::abs(rho - 0.01) < 2e-4) continue;
      ASSERT_EQ(proxy.touching, rho > 0.01) << turn << ' ' << i;
    }
  }
  // Nothing is in the hole, at any speed, and everything is around it.
  std::mt19937 random(6);
  std::uniform_real_distribution<double> side(-0.045, 0.045);
  for (int i = 0; i < 3000; ++i) {
    const Vec3 place(side(random), side(random), 0.003);
    if (std::abs(place.head<2>().norm() - 0.01) < 1e-4) continue;
    hand.proxy = {};
    hand.at = place;
    ASSERT_EQ(hand.to(place - Vec3(0, 0, 0.005)).touching, place.head<2>().norm() > 0.01) << place.transpose();
  }
  // The tessellation has the hole, too: its area says so.
  const TriangleMesh mesh = hand.shape->tessellated(1e-5, {});
  double area = 0;
  for (const auto& t : mesh.triangles)
    area += 0.5 * (mesh.vertices[t[1]] - mesh.vertices[t[0]]).cross(mesh.vertices[t[2]] - mesh.vertices[t[0]]).norm();
  EXPECT_NEAR(area, 0.01 - std::numbers::pi * 1e-4, 2e-7);
}

TEST(NurbsTrim, KeepsTheToolWithinItsOuterLoop) {
  json plate = test::plate_patch({-0.05, -0.05}, {0.05, 0.05}, 0);
  plate["trim"] = {{"outer", {{{0.2, 0.2}, {0.9, 0.3}, {0.4, 0.8}}}}};
  NurbsHand hand(nurbs_object({plate}));
  std::mt19937 random(7);
  std::uniform_real_distribution<double> side(0, 1);
  for (int i = 0; i < 3000; ++i) {
    const Vec2 at(side(random), side(random));
    const auto left = [&](const Vec2& a, const Vec2& b) {
      return ((b - a).x() * (at - a).y() - (b - a).y() * (at - a).x()) / (b - a).norm();
    };
    const double in =
        std::min({left({0.2, 0.2}, {0.9, 0.3}), left({0.9, 0.3}, {0.4, 0.8}), left({0.4, 0.8}, {0.2, 0.2})});
    if (std::abs(in) < 1e-3) continue;
    const Vec3 place(0.1 * at.x() - 0.05, 0.1 * at.y() - 0.05, 0.003);
    hand.proxy = {};
    hand.at = place;
    ASSERT_EQ(hand.to(place - Vec3(0, 0, 0.005)).touching, in > 0) << at.transpose();
  }
}

// --- A ball in a bowl ---

TEST(NurbsBowl, HoldsABallThatFitsAndRefusesOneThatDoesNot) {
  const std::string bowl = nurbs_object({test::half_sphere_patch(0.05)}, {{"flip", true}});
  NurbsHand hand(bowl, 0.01);
  hand.to({0, 0, -0.03});
  for (int i = 0; i < 500; ++i) {
    const double a = 2e-3 * i;
    const Vec3 place = 0.041 * Vec3(std::sin(a), 0.1, -std::cos(a)).normalized();
    const Proxy& proxy = hand.to(place);
    ASSERT_TRUE(proxy.touching);
    ASSERT_NEAR(proxy.depth, 0.001, 1e-12);
    ASSERT_LT((proxy.normal + place.normalized()).norm(), 1e-9);
  }
  const auto shape = shape_of(bowl);
  shape->prepare(0.0499);
  EXPECT_THAT(error_of([&] { shape->prepare(0.051); }),
              AllOf(HasSubstr("concave radius of curvature is 0.05 m"), HasSubstr("smaller tool")));
  EXPECT_THAT(error_of([&] {
                json walls = test::plate_patch({-0.05, -0.05}, {0, 0.05}, 0), up = walls;
                up["points"] = {{{0, -0.05, 0}, {0, 0.05, 0}}, {{0, -0.05, 0.05}, {0, 0.05, 0.05}}};
                shape_of(nurbs_object({walls, up}))->prepare(0.001);
              }),
              HasSubstr("concave edge at (0, "));
}

TEST(NurbsShape, IsAClosedMeshWithinTheTolerance) {
  const auto shape = shape_of(nurbs_object({test::sphere_patch(0.05)}));
  for (const double tolerance : {1e-3, 1e-4, 1e-5}) {
    const TriangleMesh mesh = shape->tessellated(tolerance, {});
    EXPECT_TRUE(test::closed(mesh));
    EXPECT_GT(test::volume(mesh), 0);
    double worst = 0;
    for (const auto& t : mesh.triangles)
      for (const Vec3& w : {Vec3(0.5, 0.5, 0), Vec3(0, 0.5, 0.5), Vec3(0.5, 0, 0.5), Vec3(1.0 / 3, 1.0 / 3, 1.0 / 3)})
        worst = std::max(
            worst,
            std::abs((w[0] * mesh.vertices[t[0]] + w[1] * mesh.vertices[t[1]] + w[2] * mesh.vertices[t[2]]).norm() -
                     0.05));
    EXPECT_LE(worst, tolerance);
    EXPECT_GT(worst, 0.02 * tolerance);
  }
}

TEST(NurbsShape, PushesOutAToolThatBeginsInside) {
  NurbsHand hand(nurbs_object({test::sphere_patch(0.05)}));
  const Proxy& proxy = hand.to({0.01, 0.03, 0.02});
  EXPECT_TRUE(proxy.touching);
  EXPECT_TRUE(proxy.began_inside);
  EXPECT_NEAR(proxy.depth, 0.05 - Vec3(0.01, 0.03, 0.02).norm(), 1e-12);
}

// --- Bad input ---

TEST(NurbsInput, RefusesWhatIsNoSurfaceWithItsPlace) {
  const json good = test::plate_patch({-0.05, -0.05}, {0.05, 0.05}, 0);
  const auto refusal = [&](const std::function<void(json&)>& change) {
    json patch = good;
    change(patch);
    return error_of([&] { (void)shape_of(nurbs_object({good, patch})); });
  };
  EXPECT_EQ(refusal([](json&) {}), "no error");
  struct Case {
    std::function<void(json&)> change;
    std::vector<std::string> words;
  };
  const std::vector<Case> cases{
      {[](json& p) { p["degree"] = 6; }, {"patches[1].degree", "from 1 to 5"}},
      {[](json& p) { p["degree"] = 0; }, {"patches[1].degree", "from 1 to 5"}},
      {[](json& p) { p["degree"] = 1.5; }, {"patches[1].degree", "whole number"}},
      {[](json& p) {
         p["degree"] = {1, 1, 1};
       },
       {"patches[1].degree", "[of u, of v]"}},
      {[](json& p) {
         p["degree"] = {1, 2};
       },
       {"patches[1].knots_v", "degree 2 needs at least 3 points"}},
      {[](json& p) {
         p["knots_u"] = {0, 0, 1};
       },
       {"patches[1].knots_u", "there are 3 knots", "need 4"}},
      {[](json& p) {
         p["knots_v"] = {0, 0, 1, 1, 1};
       },
       {"patches[1].knots_v", "there are 5 knots", "need 4"}},
      {[](json& p) {
         p["knots_v"] = {0, 1, 0.5, 1};
       },
       {"patches[1].knots_v[2]", "must not decrease"}},
      {[](json& p) {
         p["knots_u"] = {0, 0, 0, 1};
       },
       {"patches[1].knots_u"}},
      {[](json& p) {
         p["knots_u"] = {1, 1, 1, 1};
       },
       {"patches[1].knots_u", "no range"}},
      {[](json& p) {
         p["knots_u"] = {0, "a", 1, 1};
       },
       {"patches[1].knots_u[1]", "expected a number"}},
      {[](json& p) {
         p["points"][1][0] = {0, 0, 0, 0};
       },
       {"patches[1].points[1][0]", "weight is 0"}},
      {[](json& p) {
         p["points"][0][1] = {0, 0, 0, -1};
       },
       {"patches[1].points[0][1]", "weight is -1"}},
      {[](json& p) {
         p["points"][0][1] = {0, 0};
       },
       {"patches[1].points[0][1]", "[x, y, z, weight]"}},
      {[](json& p) {
         p["points"][0][1] = {0, 1e300, 0};
       },
       {"patches[1].points[0][1]", "beyond 1000 m"}},
      {[](json& p) {
         p["points"][1].push_back({0, 0, 0});
       },
       {"patches[1].points[1]", "the first row has 2"}},
      {[](json& p) {
         p["points"] = {{{0, 0, 0}, {1, 0, 0}}, {{2, 0, 0}, {3, 0, 0}}};
       },
       {"patch 2", "no area"}},
      {[](json& p) {
         p["points"] = {{{0, 0, 0}, {0, 0, 0}}, {{0, 0, 0}, {0, 0, 0}}};
       },
       {"patch 2", "no area"}},
      {[](json& p) {
         p["points"] = {{{0, 0, 0}, {1, 0, 0}}, {{1, 1, 0}, {0, 1, 0}}};
       },
       {"patch 2", "no normal"}},
      {[](json& p) {
         p["trim"] = {{"holes", {{{0.1, 0.1}, {0.2, 0.2}}}}};
       },
       {"trim.holes[0]", "no area"}},
      {[](json& p) {
         p["trim"] = {{"holes", {{{0.1, 0.1}, {0.2, 0.2}, {3, 0.1}}}}};
       },
       {"trim.holes[0]", "outside the patch"}},
      {[](json& p) {
         p["trim"] = {{"holes", {{{{"degree", 2}, {"knots", {0, 1}}, {"points", {{0, 0}}}}}}}};
       },
       {"trim.holes[0][0].knots"}},
      {[](json& p) {
         p["trim"] = {{"hole", json::array()}};
       },
       {"trim", "did you mean 'holes'?"}},
      {[](json& p) { p.erase("knots_u"); }, {"patches[1]", "knots_u"}},
      {[](json& p) { p["knotsu"] = 1; }, {"patches[1]", "knotsu"}},
  };
  for (const Case& one : cases) {
    const std::string text = refusal(one.change);
    for (const std::string& word : one.words) EXPECT_THAT(text, HasSubstr(word));
  }
  EXPECT_THAT(error_of([] { (void)shape_of(R"({"kind": "nurbs"})"); }), HasSubstr("give `patches`, or a `file`"));
  EXPECT_THAT(error_of([] { (void)shape_of(R"({"kind": "nurbs", "patches": []})"); }), HasSubstr("there are none"));
  EXPECT_THAT(error_of([&] {
                (void)shape_of(nurbs_object({good}, {{"file", "a.json"}}));
              }),
              HasSubstr("give one of them"));
  EXPECT_THAT(error_of([&] {
                (void)shape_of(nurbs_object({good}, {{"unit", "kg"}}));
              }),
              HasSubstr("'kg' is no length"));
}

TEST(NurbsInput, RefusesASurfaceWithOnlyOneSide) {
  // A strip that turns by half a turn on its way round.
  std::vector<json> ring;
  constexpr int kPatches = 12;
  const auto at = [](int i, double side) {
    const double a = 2 * std::numbers::pi * i / kPatches, rho = 0.05 + side * std::cos(a / 2);
    return json{rho * std::cos(a), rho * std::sin(a), side * std::sin(a / 2)};
  };
  for (int i = 0; i < kPatches; ++i) {
    json patch = test::plate_patch({0, 0}, {1, 1}, 0);
    patch["points"] = {{at(i, -0.01), at(i, 0.01)}, {at(i + 1, -0.01), at(i + 1, 0.01)}};
    ring.push_back(patch);
  }
  EXPECT_THAT(error_of([&] { (void)shape_of(nurbs_object(ring)); }), HasSubstr("only one side"));
}

TEST(NurbsFile, IsReadAsTheScenesOwnPatchesAre) {
  const TempFolder folder;
  json patches{{"unit", "mm"}, {"patches", {test::sphere_patch(50)}}};
  const std::string file = folder.write("ball.json", patches.dump());
  const auto shape = shape_of(json{{"kind", "nurbs"}, {"file", file}}.dump());
  EXPECT_NEAR(shape->nearest({0, 0, 0.08}).distance, 0.03, 1e-15);
}

TEST(NurbsFile, IsRefusedWithItsNameAndThePlaceInIt) {
  const TempFolder folder;
  const auto refusal = [&](const std::string& name, const std::string& text) {
    const std::string file = folder.write(name, text);
    return error_of([&] { (void)shape_of(json{{"kind", "nurbs"}, {"file", file}}.dump()); });
  };
  json broken{{"patches", {test::sphere_patch(50)}}};
  broken["patches"][0]["knots_u"][4] = 9;
  EXPECT_THAT(refusal("a.json", broken.dump()),
              AllOf(HasSubstr("a.json: patches[0].knots_u[5]"), HasSubstr("must not decrease")));
  EXPECT_THAT(refusal("b.json", "{\"patches\": ["), AllOf(HasSubstr("b.json"), HasSubstr("line 1")));
  EXPECT_THAT(refusal("c.obj", "v 0 0 0"), AllOf(HasSubstr("c.obj"), HasSubstr(".step")));
  EXPECT_THAT(error_of([] { (void)shape_of(R"({"kind": "nurbs", "file": "/nowhere/x.json"})"); }),
              HasSubstr("no such file"));
  if (!reads_step_files()) {
    EXPECT_THAT(refusal("d.step", "ISO-10303-21;"), AllOf(HasSubstr("d.step"), HasSubstr("libocct-data-exchange-dev")));
  }
}

// --- Files of CAD programs ---

/// Tests of STEP and IGES files. They need a build with OCCT.
class NurbsCad : public testing::Test {
 protected:
  void SetUp() override {
    if (!reads_step_files())
      GTEST_SKIP() << "this build reads no STEP and IGES files: install libocct-data-exchange-dev and "
                      "libocct-modeling-algorithms-dev";
  }
  [[nodiscard]] static std::string cad(const std::string& name) {
    return json{{"kind", "nurbs"}, {"file", std::string(HAPTRACE_CAD) + "/" + name}}.dump();
  }
};

TEST_F(NurbsCad, TouchesTheBallOfAStepFileAsASphere) {
  NurbsHand hand(cad("ball.step"));
  std::mt19937 random(8);
  std::normal_distribution<double> push(0, 1);
  EXPECT_TRUE(hand.shape->remarks().empty()) << "closed";
  for (int i = 0; i < 3000; ++i) {
    const Vec3 out = Vec3(push(random), push(random), push(random)).normalized();
    hand.proxy = {};
    hand.at = 0.033 * out;
    const Proxy& proxy = hand.to(0.028 * out);
    ASSERT_TRUE(proxy.touching) << out.transpose();
    ASSERT_NEAR(proxy.depth, 0.002, 1e-12) << out.transpose();
    ASSERT_LT((proxy.normal - out).norm(), 1e-8);
  }
}

TEST_F(NurbsCad, TouchesAPlateWithAHoleOnAllItsSides) {
  // 100 x 60 x 10 mm below z = 0, with a hole of radius 10 mm along z.
  const auto distance = [](const Vec3& p) {
    return std::max(test::box_distance({0.05, 0.03, 0.005})(p + Vec3(0, 0, 0.005)), 0.01 - p.head<2>().norm());
  };
  for (const char* file : {"plate.step", "plate.igs"}) {
    NurbsHand hand(cad(file));
    EXPECT_TRUE(hand.shape->remarks().empty()) << "closed, and all faces agree where the outside is";
    std::mt19937 random(9);
    std::normal_distribution<double> push(0, 1);
    std::uniform_real_distribution<double> side(-1, 1);
    Vec3 place(0.03, 0.01, 0.005), velocity = Vec3::Zero(), goal = Vec3::Zero();
    int touched = 0, outside = 0, in_hole = 0;
    for (int tick = 0; tick < 60'000; ++tick) {
      if (tick % 200 == 0) goal = Vec3(0.055 * side(random), 0.035 * side(random), -0.005 + 0.009 * side(random));
      velocity += 0.02 * Vec3(push(random), push(random), push(random)) + 0.5 * (goal - place);
      velocity *= 0.98;
      place += 1e-3 * velocity;
      const Proxy& proxy = hand.to(place);
      const double off = distance(place);
      // The edge of the hole is a polyline.
      if (std::abs(off) < 2e-5) continue;
      // A tool that was pushed through to the other side is still held by the side that it entered.
      if (off > 0 && proxy.touching && proxy.depth > 0.005) continue;
      ASSERT_EQ(proxy.touching, off < 0) << file << ' ' << tick << ' ' << place.transpose() << ' ' << off;
      ++(off < 0 ? touched : outside);
      if (off > 0 && off < 0.01 && place.head<2>().norm() < 0.01) ++in_hole;
      if (off < 0) {
        ASSERT_NEAR(distance(proxy.position), 0, 1e-5) << tick;
        ASSERT_GE(proxy.depth, -off - 1e-5);
      }
    }
    EXPECT_GT(touched, 5000);
    EXPECT_GT(outside, 5000);
    EXPECT_GT(in_hole, 200);
  }
}

TEST_F(NurbsCad, RefusesBrokenFilesWithTheirName) {
  const TempFolder folder;
  std::ifstream stream(std::string(HAPTRACE_CAD) + "/plate.step");
  const std::string whole((std::istreambuf_iterator<char>(stream)), std::istreambuf_iterator<char>());
  ASSERT_GT(whole.size(), 1000U);
  const auto result = [&](const std::string& name, const std::string& text) {
    const std::string file = folder.write(name, text);
    return error_of([&] { (void)shape_of(json{{"kind", "nurbs"}, {"file", file}}.dump()); });
  };
  EXPECT_THAT(result("empty.step", ""), HasSubstr("empty.step"));
  EXPECT_THAT(result("text.step", "a recipe"), HasSubstr("text.step"));
  EXPECT_THAT(result("text.igs", "a recipe"), HasSubstr("text.igs"));
  EXPECT_THAT(result("half.step", whole.substr(0, whole.size() / 2)), HasSubstr("half.step"));
  // Numbers and references that are wrong: an error with the name, or a surface, but no end of the program.
  std::mt19937 random(10);
  for (int i = 0; i < 12; ++i) {
    std::string changed = whole;
    for (int k = 0; k < 20; ++k)
      changed[changed.find("DATA;") + random() % (changed.size() - changed.find("DATA;"))] =
          "0123456789#,()."[random() % 15];
    const std::string text = result(fmt::format("changed{}.step", i), changed);
    if (text != "no error") {
      EXPECT_THAT(text, HasSubstr(fmt::format("changed{}.step", i)));
    }
  }
}

}  // namespace
}  // namespace haptrace
