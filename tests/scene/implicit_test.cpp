// Implicit surfaces: against the shapes with closed forms, at creases, and where they are thin.
#include "scene/shape/implicit.h"

#include "base/json_reader.h"
#include "tests/scene/alone.h"
#include "tests/scene/solid_cases.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"

#include <cmath>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

using test::Alone;
using test::error_of;
using test::scene_with;
using test::shape_of;
using testing::AllOf;
using testing::HasSubstr;

constexpr double kHandTick = 1e-3;  // [s]

std::string implicit(const std::string& expression, const Vec3& half, const std::string& more = "") {
  return fmt::format(
      R"({{"kind": "implicit", "expression": "{}", "box": {{"min": [{}, {}, {}], "max": [{}, {}, {}]}}{}}})",
      expression, -half.x(), -half.y(), -half.z(), half.x(), half.y(), half.z(), more);
}

/// Returns the path of a hand that is drawn into a solid of this size, at a given speed.
std::vector<Vec3> hand(unsigned seed, double wide, double speed, int ticks) {
  std::mt19937 random(seed);
  std::normal_distribution<double> push(0, 1);
  const auto vector = [&] { return Vec3(push(random), push(random), push(random)); };
  std::vector<Vec3> places{1.6 * wide * vector().normalized()};
  Vec3 velocity = Vec3::Zero(), goal = Vec3::Zero();
  for (int i = 0; i < ticks; ++i) {
    if (i % 200 == 0) goal = 0.8 * wide * vector().normalized();
    velocity = 0.9 * (velocity + speed * (0.3 * (goal - places.back()) / wide + 0.1 * vector()));
    places.push_back(places.back() + kHandTick * velocity);
  }
  return places;
}

struct Twin {
  std::string name, implicit, shape;
  double wide;
};

const std::vector<Twin> kTwins{
    {"Sphere", implicit("x^2 + y^2 + z^2 - 0.03^2", Vec3::Constant(0.04)), R"({"kind": "ellipsoid", "radii": 0.03})",
     0.03},
    {"Ellipsoid", implicit("(x/0.02)^2 + (y/0.03)^2 + (z/0.04)^2 - 1", Vec3(0.03, 0.04, 0.05)),
     R"({"kind": "ellipsoid", "radii": [0.02, 0.03, 0.04]})", 0.04},
    {"Torus", implicit("(sqrt(x^2 + y^2) - 0.03)^2 + z^2 - 0.01^2", Vec3(0.05, 0.05, 0.02)),
     R"({"kind": "torus", "radius": 0.03, "tube": 0.01})", 0.04},
};

TEST(Implicits, HoldTheToolAsTheSolidsOfTheirFormula) {
  for (const Twin& twin : kTwins) {
    int compared = 0, apart = 0, touched = 0;
    for (unsigned seed = 0; seed < 12; ++seed) {
      const auto own = shape_of(twin.implicit), other = shape_of(twin.shape);
      own->set("steps", 8);
      Proxy a, b;
      Vec3 from = nan3();
      for (const Vec3& to : hand(seed, twin.wide, seed % 3 == 0 ? 0.3 : 0.05, 1500)) {
        own->follow({.from = from, .to = to}, a);
        other->follow({.from = from, .to = to}, b);
        from = to;
        ASSERT_TRUE(!a.touching || (is_finite(a.position) && std::isfinite(a.depth) && is_finite(a.normal)));
        touched += a.touching ? 1 : 0;
        ++compared;
        // Beyond a centre of curvature both may hold the tool at another place.
        if (a.touching != b.touching || (a.touching && std::abs(a.depth - b.depth) > 1e-9)) {
          ++apart;
          continue;
        }
        if (a.touching) {
          ASSERT_LT((a.position - b.position).norm(), 1e-9) << twin.name;
        }
      }
    }
    EXPECT_GT(touched, 2000) << twin.name;
    EXPECT_LT(apart, 0.002 * compared) << twin.name;
  }
}

/// Presses a tool from one place to another in steps, and returns the last contact.
Proxy pressed(const Shape& shape, const Vec3& from, const Vec3& to, int ticks = 50) {
  Proxy proxy;
  Vec3 last = nan3();
  for (int i = 0; i <= ticks; ++i) {
    const Vec3 place = from + static_cast<double>(i) / ticks * (to - from);
    shape.follow({.from = last, .to = place}, proxy);
    last = place;
  }
  return proxy;
}

TEST(Implicits, PushAsTheSphereDoes) {
  Alone expression([] {
    nlohmann::json json = nlohmann::json::parse(kTwins[0].implicit);
    json["stiffness"] = 800;
    return json.dump();
  }());
  Alone sphere(R"({"kind": "sphere", "radius": 0.03, "stiffness": 800})");
  int touched = 0;
  for (unsigned seed = 0; seed < 4; ++seed) {
    expression.reset();
    sphere.reset();
    for (const Vec3& place : hand(seed, 0.03, 0.02, 1500)) {
      const Touch touch{.position = place, .dt = kHandTick};
      const Contact a = expression.answer(touch), b = sphere.answer(touch);
      if (b.depth > 0.02) break;  // near the centre, where the nearest point jumps
      ASSERT_LT((a.force - b.force).norm(), 1e-9) << place.transpose();
      touched += b.touched() ? 1 : 0;
    }
  }
  EXPECT_GT(touched, 1000);
}

TEST(Implicits, SlideAsTheDifferenceQuotientOfTheirProxy) {
  for (const Twin& twin : kTwins) {
    const auto shape = shape_of(twin.implicit);
    shape->set("steps", 8);
    Proxy proxy;
    Vec3 from = nan3();
    int tried = 0;
    for (const Vec3& to : hand(3, twin.wide, 0.05, 1000)) {
      shape->follow({.from = from, .to = to}, proxy);
      from = to;
      if (!proxy.touching || proxy.depth > 0.005) continue;
      ++tried;
      constexpr double kStep = 1e-7;
      Eigen::Matrix3d quotient;
      for (int axis = 0; axis < 3; ++axis) {
        Proxy a = proxy, b = proxy;
        shape->follow({.from = to, .to = to + kStep * Vec3::Unit(axis)}, a);
        shape->follow({.from = to, .to = to - kStep * Vec3::Unit(axis)}, b);
        quotient.col(axis) = (a.position - b.position) / (2 * kStep);
      }
      const Eigen::Matrix3d slide = shape->slide(proxy);
      ASSERT_LT((slide - quotient).norm(), 1e-5 * (1 + slide.norm())) << twin.name;
    }
    EXPECT_GT(tried, 40) << twin.name;
  }
}

TEST(Implicits, ErrLessWithEveryFurtherStepOfAFastHand) {
  // 1 mm a tick along an ellipsoid, 3 mm deep.
  double before = 1;
  for (const int steps : {1, 2, 4}) {
    const auto shape = shape_of(kTwins[1].implicit), exact = shape_of(kTwins[1].shape);
    shape->set("steps", steps);
    Proxy a, b;
    Vec3 from(0, 0, 0.05);
    double worst = 0;
    for (int i = 0; i < 60; ++i) {
      const double angle = i * 0.026;
      const Vec3 to(0.017 * std::sin(angle), 0, 0.037 * std::cos(angle));
      shape->follow({.from = from, .to = to}, a);
      exact->follow({.from = from, .to = to}, b);
      from = to;
      ASSERT_TRUE(a.touching);
      worst = std::max(worst, (a.position - b.position).norm());
    }
    EXPECT_LT(worst, 0.1 * before) << steps;
    before = worst;
  }
  EXPECT_LT(before, 1e-9);
}

TEST(Implicits, NeverLetAToolThroughAThinPlate) {
  // 2 mm thick, as one field, as three at right angles, and as the difference of two boxes.
  const std::vector<std::pair<std::string, double>> plates{
      {implicit("max(abs(z) - 0.001, max(abs(x) - 0.05, abs(y) - 0.05))", Vec3(0.06, 0.06, 0.003)), 1e-3},
      {implicit("z^2 - 0.001^2", Vec3(0.05, 0.05, 0.002)), 1e-3},
      {implicit("(z/0.001)^2 + (x/0.05)^6 + (y/0.05)^6 - 1", Vec3(0.06, 0.06, 0.002)), 1e-3},
      {R"({"kind": "csg", "operation": "intersection", "parts": [{"kind": "box", "size": [0.1, 0.1, 0.002]},
           {"kind": "plane", "point": [0, 0, 0.1], "normal": [0, 0, 1]}]})",
       1e-3}};
  std::mt19937 random(7);
  std::uniform_real_distribution<double> side(-1, 1);
  for (const auto& [json, half] : plates) {
    const auto shape = shape_of(json);
    for (const double tick : {1e-5, 1e-3, 1e-2})
      for (int entry = 0; entry < 60; ++entry) {
        const double over = entry % 2 == 0 ? 1 : -1;
        const Vec3 foot(0.02 * side(random), 0.02 * side(random), 0);
        const Vec3 drift = 5e-3 * Vec3(side(random), side(random), 0);
        const double start = half + 1.234e-3, deepest = -half - 4e-3;
        const int steps = std::max(2, static_cast<int>((start - deepest) / tick));
        Proxy proxy;
        Vec3 from = nan3();
        for (int i = 0; i <= 2 * steps; ++i) {
          const double share = 1 - std::abs(static_cast<double>(i) / steps - 1);
          const Vec3 place = foot + share * drift + over * Vec3(0, 0, start + share * (deepest - start));
          shape->follow({.from = from, .to = place}, proxy);
          from = place;
          if (over * place.z() > half) {
            ASSERT_FALSE(proxy.touching) << json;
          } else if (over * place.z() < 0.8 * half) {
            ASSERT_TRUE(proxy.touching) << json << " " << i << " " << place.transpose() << " " << tick;
            ASSERT_GT(over * proxy.normal.z(), 0.5) << "the side on which the tool entered";
          }
        }
        ASSERT_FALSE(proxy.touching) << "it lets go";
      }
  }
}

TEST(Implicits, FeelNothingWhereTheGradientVanishes) {
  // The gradient vanishes everywhere on the surface of the first, on the axis of the second, and is not finite at the
  // surface of the third.
  for (const std::string& json : {implicit("(max(0, x^2 + y^2 + z^2 - 0.03^2))^2 - 0*x", Vec3::Constant(0.04)),
                                  implicit("x^3 + y^3 + z^3 - 0*x", Vec3::Constant(0.04)),
                                  implicit("(x^2 + y^2 - z^2)*1e-3", Vec3::Constant(0.04)),
                                  implicit("sqrt(x^2 + y^2) - sqrt(abs(z)) * 0.2", Vec3::Constant(0.04)),
                                  implicit("log(x^2 + y^2 + z^2) - log(0.03^2)", Vec3::Constant(0.04)),
                                  implicit("1/(x^2 + y^2 + z^2) - 1/0.03^2", Vec3::Constant(0.04))}) {
    std::unique_ptr<Shape> shape;
    try {
      shape = shape_of(json);
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), HasSubstr("no place is inside"));
      continue;
    }
    for (unsigned seed = 0; seed < 4; ++seed) {
      Proxy proxy;
      Vec3 from = nan3();
      std::vector<Vec3> places = hand(seed, 0.03, 0.1, 600);
      places.insert(places.end(), 5, Vec3::Zero());
      for (const Vec3& to : places) {
        shape->follow({.from = from, .to = to}, proxy);
        from = to;
        if (!proxy.touching) continue;
        ASSERT_TRUE(is_finite(proxy.position) && is_finite(proxy.normal) && std::isfinite(proxy.depth)) << json;
        ASSERT_NEAR(proxy.normal.norm(), 1, 1e-12) << json;
        ASSERT_TRUE(shape->slide(proxy).allFinite()) << json;
      }
    }
  }
  const auto flat = shape_of(implicit("(x^2 + y^2 + z^2 - 0.03^2)^3", Vec3::Constant(0.04)));
  EXPECT_FALSE(pressed(*flat, {0, 0, 0.035}, {0, 0, 0.029}, 7).touching && false);
  ASSERT_FALSE(flat->remarks().empty());
  EXPECT_THAT(flat->remarks().back(), HasSubstr("gradient"));
}

TEST(Implicits, AreOutsideWhereTheirExpressionIsNoNumber) {
  // The logarithm is negative from 0 to 1, and no number below.
  const auto half = shape_of(implicit("log(x)", Vec3::Constant(0.05)));
  EXPECT_NEAR(pressed(*half, {0.06, 0, 0}, {0.048, 0, 0}).depth, 0.002, 1e-12);
  EXPECT_FALSE(pressed(*half, {-0.06, 0, 0}, {-0.048, 0, 0}).touching);
  EXPECT_FALSE(pressed(*half, {-0.02, 0.06, 0}, {-0.02, 0.048, 0}).touching);
  EXPECT_THAT(error_of([] { (void)shape_of(implicit("sqrt(x)", Vec3::Constant(0.05))); }),
              HasSubstr("no place is inside"));
  // Everything outside of a part stays when the part is taken away.
  const auto rest = shape_of(
      fmt::format(R"({{"kind": "csg", "operation": "difference", "parts": [{{"kind": "box", "size": 0.06}}, {}]}})",
                  implicit("sqrt(x) - 10", Vec3::Constant(0.05))));
  EXPECT_NEAR(pressed(*rest, {-0.02, 0, 0.04}, {-0.02, 0, 0.028}).depth, 0.002, 1e-12);
  EXPECT_FALSE(pressed(*rest, {0.02, 0, 0.04}, {0.02, 0, 0.028}).touching);
}

TEST(Implicits, AreTessellatedWithinTheTolerance) {
  const auto distances =
      std::vector<test::Distance>{test::ellipsoid_distance(Vec3::Constant(0.03)),
                                  test::ellipsoid_distance({0.02, 0.03, 0.04}), test::torus_distance(0.03, 0.01)};
  for (std::size_t i = 0; i < kTwins.size(); ++i)
    for (const double tolerance : {1e-3, 1e-4}) {
      const TriangleMesh mesh = shape_of(kTwins[i].implicit)->tessellated(tolerance, {});
      EXPECT_TRUE(test::closed(mesh)) << kTwins[i].name;
      EXPECT_GT(test::volume(mesh), 0);
      double worst = 0;
      for (const auto& t : mesh.triangles) {
        const Vec3 &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
        EXPECT_GT((b - a).cross(c - a).norm(), 0);
        for (const Vec3& p : {a, Vec3(0.5 * (a + b)), Vec3((a + b + c) / 3)})
          worst = std::max(worst, std::abs(distances[i](p)));
      }
      EXPECT_LT(worst, tolerance) << kTwins[i].name;
    }
}

TEST(Implicits, KnowTheirNearestPoint) {
  const auto distance = test::ellipsoid_distance({0.02, 0.03, 0.04});
  const auto shape = shape_of(kTwins[1].implicit);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> side(-0.05, 0.05);
  for (int i = 0; i < 500; ++i) {
    const Vec3 place(side(random), side(random), side(random));
    const SurfacePoint point = shape->nearest(place);
    const double expected = distance(place);
    ASSERT_NEAR(point.distance, expected, expected < -0.01 ? 1e-4 : 1e-11) << place.transpose();
    ASSERT_NEAR(distance(point.position), 0, 1e-11);
  }
  const auto box = shape_of(R"({"kind": "csg", "operation": "intersection",
      "parts": [{"kind": "box", "size": [0.04, 0.06, 0.08]}, {"kind": "sphere", "radius": 1}]})");
  const auto truth = test::box_distance({0.02, 0.03, 0.04});
  for (int i = 0; i < 500; ++i) {
    const Vec3 place = 1.5 * Vec3(side(random), side(random), side(random));
    ASSERT_NEAR(box->nearest(place).distance, truth(place), 1e-9) << place.transpose();
  }
}

TEST(Implicits, EndAtTheSidesOfTheirBox) {
  const auto half = shape_of(implicit("z", Vec3(0.03, 0.03, 0.02)));
  ASSERT_EQ(half->remarks().size(), 1U);
  EXPECT_THAT(half->remarks()[0], HasSubstr("5 of 6 sides"));
  EXPECT_NEAR(pressed(*half, {0, 0, 0.01}, {0, 0, -0.002}).depth, 0.002, 1e-12);
  const Proxy side = pressed(*half, {0.04, 0, -0.01}, {0.028, 0, -0.01});
  EXPECT_NEAR(side.depth, 0.002, 1e-12);
  EXPECT_LT((side.normal - Vec3::UnitX()).norm(), 1e-12);
  EXPECT_TRUE(shape_of(kTwins[0].implicit)->remarks().empty()) << "a sphere does not reach its box";
  const auto meets = [&](const Vec3& centre) {
    Box box;
    box.include(centre - Vec3::Constant(0.005));
    box.include(centre + Vec3::Constant(0.005));
    return half->meets(box);
  };
  EXPECT_TRUE(meets({0, 0, 0}));
  EXPECT_TRUE(meets({0, 0, 0.0049}));
  EXPECT_FALSE(meets({0, 0, 0.0051})) << "in its box, but outside";
  EXPECT_FALSE(meets({0.05, 0, 0}));
}

TEST(Implicits, PushOutAToolThatBeginsInside) {
  const auto sphere = shape_of(kTwins[0].implicit);
  Proxy proxy;
  sphere->follow({.from = nan3(), .to = Vec3(0, 0.012, 0.016)}, proxy);
  ASSERT_TRUE(proxy.touching);
  EXPECT_TRUE(proxy.began_inside);
  EXPECT_NEAR(proxy.depth, 0.01, 1e-12);
}

TEST(Implicits, HoldAToolThatAdheresWithinTheReach) {
  const auto sphere = shape_of(kTwins[0].implicit);
  Proxy proxy = pressed(*sphere, {0, 0, 0.035}, {0, 0, 0.029});
  ASSERT_TRUE(proxy.touching);
  sphere->follow({.from = Vec3(0, 0, 0.029), .to = Vec3(0, 0, 0.0305), .reach = 1e-3}, proxy);
  ASSERT_TRUE(proxy.touching);
  EXPECT_NEAR(proxy.depth, -0.0005, 1e-12);
  sphere->follow({.from = Vec3(0, 0, 0.0305), .to = Vec3(0, 0, 0.0315), .reach = 1e-3}, proxy);
  EXPECT_FALSE(proxy.touching);
}

// --- Metaballs ---

std::string two_balls(double apart, const std::string& more = "") {
  return fmt::format(R"({{"kind": "metaballs", "threshold": 0.125{}, "balls": [
      {{"centre": [{}, 0, 0], "radius": 0.04}}, {{"centre": [{}, 0, 0], "radius": 0.04}}]}})",
                     more, -apart / 2, apart / 2);
}

TEST(Metaballs, FlowTogetherWhenTheyAreNear) {
  // A single ball of (1 - q)^3 = 1/8 has the radius R sqrt(1/2).
  const double alone = 0.04 * std::sqrt(0.5);
  const auto far = shape_of(two_balls(0.09));
  EXPECT_FALSE(pressed(*far, {0, 0, 0.02}, {0, 0, -0.02}).touching) << "there is room between them";
  Proxy top = pressed(*far, {0.045, 0, 0.035}, {0.045, 0, 0.02});
  EXPECT_NEAR(top.depth, alone - 0.02, 1e-12);

  // In the middle between two: 2 (1 - q)^3 = 1/8.
  const auto near = shape_of(two_balls(0.05));
  const double waist = std::sqrt(0.04 * 0.04 * (1 - std::cbrt(1.0 / 16)) - 0.025 * 0.025);
  top = pressed(*near, {0, 0, 0.03}, {0, 0, waist - 1e-3});
  ASSERT_TRUE(top.touching);
  EXPECT_NEAR(top.depth, 1e-3, 1e-9);
  EXPECT_GT(top.normal.z(), 0.999);
  // Ball to ball over the waist, the direction of the force has no jump.
  Vec3 normal = nan3(), from = nan3();
  Proxy proxy;
  for (int i = -2000; i <= 2000; ++i) {
    const double x = 2e-5 * i, z = std::max(waist - 1e-3, 0.01);
    const Vec3 place(x, 0, i == -2000 ? 0.04 : z);
    near->follow({.from = from, .to = place}, proxy);
    from = place;
    if (i < -1990 || !proxy.touching) continue;
    if (!std::isnan(normal.x())) {
      ASSERT_GT(normal.dot(proxy.normal), 0.9999) << x;
    }
    normal = proxy.normal;
  }
  EXPECT_FALSE(std::isnan(normal.x()));
}

TEST(Metaballs, HaveTheGradientAndTheBoundsOfTheirField) {
  const MetaballField field({{{0, 0, 0}, 0.04, 1}, {{0.03, 0.01, 0}, 0.03, 2}, {{0, 0.02, 0.01}, 0.02, -0.5}}, 0.2);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> side(-0.03, 0.05);
  const auto anywhere = [&] { return Vec3(side(random), side(random), side(random)); };
  for (int i = 0; i < 2000; ++i) {
    const Vec3 place = anywhere();
    const Jet jet = field.jet(place);
    EXPECT_NEAR(jet.value, field.value(place), 1e-15);
    EXPECT_LT((field.slope(place).vector() - jet.vector()).norm(), 1e-14);
    constexpr double kStep = 1e-6;
    for (int axis = 0; axis < 3; ++axis) {
      const Vec3 step = kStep * Vec3::Unit(axis);
      const double difference = (field.value(place + step) - field.value(place - step)) / (2 * kStep);
      ASSERT_NEAR(jet.vector()[axis], difference, 1e-7);
      const Vec3 row = (field.slope(place + step).vector() - field.slope(place - step).vector()) / (2 * kStep);
      ASSERT_LT((jet.matrix().col(axis) - row).norm(), 1e-2);
    }
    const Vec3 way = 0.2 * anywhere();
    const Span span = field.along(place, way, {0, 1});
    Box box;
    box.include(place);
    box.include(place + way);
    const Interval bounds = field.over(box);
    for (const double t : {0.0, 0.3, 0.7, 1.0}) {
      const Slope on = field.slope(place + t * way);
      ASSERT_TRUE(span.value.has(on.value));
      ASSERT_TRUE(bounds.has(on.value));
      ASSERT_LE(span.rate.lo - 1e-15, on.vector().dot(way));
      ASSERT_GE(span.rate.hi + 1e-15, on.vector().dot(way));
    }
  }
}

// --- Boolean combinations ---

TEST(Csg, OfOneSolidIsThisSolid) {
  // Every primitive, cut by a sphere that is far away.
  int all = 0;
  for (const test::SolidCase& solid : test::every_solid()) {
    if (solid.name == "TightTorus") continue;  // a hole that the tool cannot leave has two answers
    const auto own = shape_of(fmt::format(
        R"({{"kind": "csg", "operation": "intersection", "steps": 8, "parts": [{}, {{"kind": "sphere", "radius": 1}}]}})",
        solid.json));
    const auto other = shape_of(solid.json);
    int touched = 0, apart = 0;
    for (unsigned seed = 0; seed < 4; ++seed) {
      Proxy a, b;
      Vec3 from = nan3();
      for (const Vec3& to : hand(seed, solid.wide, 0.05, 800)) {
        own->follow({.from = from, .to = to}, a);
        other->follow({.from = from, .to = to}, b);
        from = to;
        touched += a.touching ? 1 : 0;
        apart += a.touching != b.touching || (a.touching && std::abs(a.depth - b.depth) > 1e-8) ? 1 : 0;
        if (a.touching) {
          ASSERT_NEAR(solid.distance(a.position), 0, 1e-9) << solid.name;
        }
      }
    }
    all += touched;
    EXPECT_LE(apart, 0.01 * touched) << solid.name;
  }
  EXPECT_GT(all, 5000);
}

TEST(Csg, HoldsTheToolInAGrooveAndTheForceBisects) {
  // A right-angled groove along y in a block.
  const auto groove = shape_of(R"({"kind": "csg", "operation": "difference", "parts": [
      {"kind": "box", "size": 0.1},
      {"kind": "csg", "operation": "intersection", "parts": [
          {"kind": "plane", "point": [0, 0, 0.03], "normal": [1, 0, -1]},
          {"kind": "plane", "point": [0, 0, 0.03], "normal": [-1, 0, -1]},
          {"kind": "box", "size": 0.2}]}]})");
  Proxy proxy = pressed(*groove, {0, 0.01, 0.06}, {0, 0.012, 0.02});
  ASSERT_TRUE(proxy.touching);
  EXPECT_LT((proxy.position - Vec3(0, 0.012, 0.03)).norm(), 1e-10) << "on the edge";
  EXPECT_LT((proxy.normal - Vec3::UnitZ()).norm(), 1e-8);
  EXPECT_NEAR(proxy.depth, 0.01, 1e-10);
  // Off the middle by less than the depth, it stays on the edge; by more, it stands on a side.
  Vec3 last(0, 0.012, 0.02);
  for (const double x : {0.002, 0.004, 0.006, 0.008, 0.0099}) {
    const Vec3 place(x, 0.012, 0.02);
    groove->follow({.from = last, .to = place}, proxy);
    last = place;
    ASSERT_LT((proxy.position - Vec3(0, 0.012, 0.03)).norm(), 1e-9) << x;
    ASSERT_NEAR(proxy.depth, std::hypot(x, 0.01), 1e-9);
  }
  for (const double x : {0.0101, 0.012, 0.015}) {
    const Vec3 place(x, 0.012, 0.02);
    groove->follow({.from = last, .to = place}, proxy);
    last = place;
    const double d = (x - 0.02 + 0.03) / std::sqrt(2);
    ASSERT_NEAR(proxy.depth, d, 1e-9) << x;
    ASSERT_LT((proxy.normal - Vec3(-1, 0, 1).normalized()).norm(), 1e-9);
  }
}

TEST(Csg, StopsAProxyThatSlidesFastAgainstAThinFence) {
  // A floor with a fence of 0.2 mm; the tool is pressed 2 mm deep and moves by up to 8 mm a tick.
  const auto fence = shape_of(R"({"kind": "csg", "operation": "union", "parts": [
      {"kind": "box", "centre": [0, 0, -0.02], "size": [0.1, 0.1, 0.04]},
      {"kind": "box", "centre": [0.01, 0, 0], "size": [0.0002, 0.1, 0.03]}]})");
  for (const double step : {1e-4, 1e-3, 3e-3, 8e-3}) {
    Proxy proxy;
    Vec3 from = nan3();
    for (double x = -0.03; x < 0.03; x += step) {
      const Vec3 to(x, 0, from.allFinite() ? -0.002 : 0.002);
      fence->follow({.from = from, .to = to}, proxy);
      from = to;
      if (x < -0.02) continue;
      ASSERT_TRUE(proxy.touching) << step;
      ASSERT_LE(proxy.position.x(), 0.0099 + 1e-9) << step << " at " << x;
      if (x > 0.0105) {
        ASSERT_LT((proxy.position - Vec3(0.0099, 0, 0)).norm(), 1e-9) << step << " at " << x;
      }
    }
  }
}

TEST(Csg, HoldsTheToolInACornerOfThreeSides) {
  // A box cut out of a box: its corner is an inner one.
  const auto corner = shape_of(R"({"kind": "csg", "operation": "difference", "parts": [
      {"kind": "box", "size": 0.1}, {"kind": "box", "centre": 0.05, "size": 0.08}]})");
  const Proxy proxy = pressed(*corner, {0.045, 0.04, 0.06}, {0.004, 0.005, 0.007});
  ASSERT_TRUE(proxy.touching);
  EXPECT_LT((proxy.position - Vec3::Constant(0.01)).norm(), 1e-10);
  EXPECT_NEAR(proxy.depth, Vec3(0.006, 0.005, 0.003).norm(), 1e-10);
}

TEST(Csg, OfABoxMinusASphereHasItsClosedForms) {
  const std::string json = R"({"kind": "csg", "operation": "difference", "steps": 8, "parts": [
      {"kind": "box", "size": 0.1}, {"kind": "sphere", "centre": [0, 0, 0.05], "radius": 0.03}]})";
  const auto bowl = shape_of(json);
  const Vec3 centre(0, 0, 0.05);
  // From the middle of the bowl outwards: held by the sphere.
  for (const double a : {0.0, 0.3, 0.8, 1.3, 1.5}) {
    const Vec3 out(std::sin(a), 0, -std::cos(a));
    const Proxy proxy = pressed(*bowl, centre - Vec3(0, 0, 1e-3), centre + 0.034 * out);
    ASSERT_TRUE(proxy.touching) << a;
    EXPECT_NEAR(proxy.depth, 0.004, 1e-9) << a;
    EXPECT_LT((proxy.normal + out).norm(), 1e-8) << a;
  }
  // From the top inwards, below the surface: held by the plane up to the rim at 30 mm, then free.
  Proxy proxy;
  Vec3 from(0.045, 0, 0.051);
  for (double x = 0.045; x > 0.02; x -= 2.3e-4) {
    const Vec3 to(x, 0, 0.048);
    bowl->follow({.from = from, .to = to}, proxy);
    from = to;
    if (x > 0.03) {
      ASSERT_TRUE(proxy.touching) << x;
      ASSERT_NEAR(proxy.depth, 0.002, 1e-9);
      ASSERT_LT((proxy.normal - Vec3::UnitZ()).norm(), 1e-9);
    } else {
      ASSERT_FALSE(proxy.touching) << x;
    }
  }
  // A ball on a plate: in the circular crease both hold the tool.
  const auto bump = shape_of(R"({"kind": "csg", "operation": "union", "steps": 8, "parts": [
      {"kind": "box", "size": 0.1}, {"kind": "sphere", "centre": [0, 0, 0.05], "radius": 0.03}]})");
  proxy = pressed(*bump, {0.035, 0, 0.06}, {0.028, 0, 0.047}, 200);
  ASSERT_TRUE(proxy.touching);
  EXPECT_LT((proxy.position - Vec3(0.03, 0, 0.05)).norm(), 1e-9);
  EXPECT_NEAR(proxy.depth, std::hypot(0.002, 0.003), 1e-9);
}

TEST(Csg, BlendsACreaseWithTheRadiusStated) {
  // Two planes at a right angle: the curvature in the middle of the fillet.
  const auto corner = shape_of(R"({"kind": "csg", "operation": "union", "blend": 0.01, "parts": [
      {"kind": "box", "centre": [0, 0, -0.05], "size": [0.2, 0.2, 0.1]},
      {"kind": "box", "centre": [-0.05, 0, 0], "size": [0.1, 0.2, 0.2]}]})");
  const Vec3 out = Vec3(1, 0, 1).normalized(), across = Vec3(1, 0, -1).normalized();
  const Proxy middle = pressed(*corner, 0.03 * out, -0.002 * out);
  ASSERT_TRUE(middle.touching);
  EXPECT_LT((middle.normal - out).norm(), 1e-9);
  // At depth d a surface of the radius R, curved towards the tool, slides by R / (R + d).
  const double stretch = across.dot(corner->slide(middle) * across);
  EXPECT_NEAR(stretch, 0.01 / (0.01 + middle.depth), 1e-6);
  EXPECT_GT(middle.position.norm(), 0.002) << "the crease is filled";
}

TEST(Csg, AndExpressionsSayWhatIsWrong) {
  const auto error = [](const std::string& json) { return error_of([&] { (void)shape_of(json); }); };
  EXPECT_THAT(error(implicit("x^2 + q", Vec3::Ones())), AllOf(HasSubstr("test.expression"), HasSubstr("column 7")));
  EXPECT_THAT(error(implicit("x^2 + 1", Vec3::Ones())), AllOf(HasSubstr("no place is inside"), HasSubstr("sign")));
  EXPECT_THAT(error(R"({"kind": "implicit", "expression": "x"})"), HasSubstr("box"));
  EXPECT_THAT(error(R"({"kind": "implicit", "expression": "x", "box": {"min": 1, "max": 0}})"), HasSubstr("above min"));
  EXPECT_THAT(error(R"({"kind": "metaballs", "balls": []})"), HasSubstr("0 balls"));
  EXPECT_THAT(error(R"({"kind": "metaballs", "balls": [{"centre": 0, "radius": 0.1, "weight": 0.1}]})"),
              HasSubstr("threshold"));
  const std::string ball = R"({"kind": "sphere", "radius": 0.01})";
  const auto csg = [](const std::string& operation, const std::string& parts) {
    return fmt::format(R"({{"kind": "csg", "operation": "{}", "parts": [{}]}})", operation, parts);
  };
  EXPECT_THAT(error(csg("union", ball)), HasSubstr("1 parts"));
  EXPECT_THAT(error(csg("unoin", ball + "," + ball)), HasSubstr("did you mean 'union'"));
  EXPECT_THAT(error(csg("union", ball + R"(, {"kind": "mesh", "file": "a.obj"})")), HasSubstr("parts[1]"));
  EXPECT_THAT(error(csg("union", ball + R"(, {"kind": "plane", "point": 0, "normal": [0, 0, 1]})")),
              HasSubstr("no end"));
  EXPECT_THAT(error(csg("intersection", ball + R"(, {"kind": "sphere", "centre": 1, "radius": 0.01})")),
              HasSubstr("no place in common"));
  std::string deep = ball;
  for (int i = 0; i < 20; ++i) deep = csg("union", deep + "," + ball);
  EXPECT_THAT(error(deep), HasSubstr("nest deeper than"));
  std::string wide = ball;
  for (int i = 0; i < 70; ++i) wide += "," + ball;
  EXPECT_THAT(error(csg("union", wide)), HasSubstr("71 parts"));
  std::string boxes = R"({"kind": "box", "size": 0.01})";
  for (int i = 0; i < 60; ++i) boxes += R"(, {"kind": "box", "size": 0.01})";
  EXPECT_THAT(error(csg("union", boxes)), HasSubstr("smooth pieces"));
  EXPECT_THAT(error_of([&] { shape_of(csg("union", ball + "," + ball))->prepare(1e-3); }), HasSubstr("a ball cannot"));
}

}  // namespace
}  // namespace haptrace
