// Box, cylinder, cone, torus, ellipsoid: against closed forms, and against a god object moved by brute force.
#include "tests/scene/alone.h"
#include "tests/scene/solid_cases.h"
#include "tests/support/errors.h"

#include <cstdlib>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

using test::Alone;
using test::error_of;
using test::every_solid;
using test::GodObject;
using test::gradient_of;
using test::shape_of;
using test::SolidCase;
using testing::HasSubstr;

constexpr double kBallRadii[] = {0, 2e-3, 8e-3};  // of the tool [m]

class Solids : public testing::TestWithParam<SolidCase> {
 protected:
  [[nodiscard]] static const SolidCase& solid() { return GetParam(); }
  [[nodiscard]] Vec3 anywhere(double share = 1.5) {
    std::uniform_real_distribution<double> side(-1, 1);
    return share * solid().wide * Vec3(side(random_), side(random_), side(random_));
  }
  /// Returns a place at a distance from the surface, along its normal.
  [[nodiscard]] Vec3 at_distance(double distance) {
    for (;;) {
      Vec3 p = anywhere();
      double off = 0;
      for (int i = 0; i < 60; ++i) {
        off = solid().distance(p) - distance;
        if (std::abs(off) < 1e-13) return p;
        p -= off * gradient_of(solid().distance, p, 1e-8).stableNormalized();
      }
    }
  }
  std::mt19937 random_{1};
};

TEST_P(Solids, PushWithStiffnessTimesDepthAlongTheNormal) {
  const auto shape = shape_of(solid().json);
  int tried = 0;
  for (const double radius : kBallRadii)
    for (int i = 0; i < 300; ++i) {
      // From outside to a shallow depth, along the normal, so that the closest point is the one that was entered.
      const double share = std::uniform_real_distribution<double>(0.01, 0.2)(random_);
      const Vec3 place = at_distance(radius - share * solid().thin);
      const double depth = radius - solid().distance(place);
      const Vec3 normal = gradient_of(solid().distance, place, 1e-7).normalized();
      // Not where two points are equally near, and not in a hole that is too narrow for the ball.
      if (std::abs(solid().distance(place + depth * normal) - radius) > 1e-7) continue;
      ++tried;
      Proxy proxy;
      ToolStep step{.from = nan3(), .to = place + (depth + 1e-3) * normal, .radius = radius};
      if (solid().distance(step.to) < radius) continue;  // on the other side of a narrow hole
      shape->follow(step, proxy);
      ASSERT_FALSE(proxy.touching);
      step.from = step.to;
      step.to = place;
      shape->follow(step, proxy);
      ASSERT_TRUE(proxy.touching);
      ASSERT_FALSE(proxy.began_inside);
      ASSERT_NEAR(proxy.depth, depth, 1e-12) << place.transpose();
      ASSERT_NEAR(solid().distance(proxy.position), radius, 1e-12);
      ASSERT_LT((place + depth * proxy.normal - proxy.position).norm(), 1e-12);
    }
  EXPECT_GT(tried, 300);
}

TEST_P(Solids, KnowTheirNearestPointWithItsSign) {
  const auto shape = shape_of(solid().json);
  for (int i = 0; i < 3000; ++i) {
    const Vec3 place = anywhere();
    const SurfacePoint point = shape->nearest(place);
    ASSERT_NEAR(point.distance, solid().distance(place), 1e-14) << place.transpose();
    ASSERT_NEAR(solid().distance(point.position), 0, 1e-14);
    ASSERT_NEAR(point.normal.norm(), 1, 1e-14);
    ASSERT_LT((point.position + point.distance * point.normal - place).norm(), 1e-13);
  }
}

TEST_P(Solids, SlideAsTheDifferenceQuotientOfTheirProxy) {
  const auto shape = shape_of(solid().json);
  int tried = 0;
  for (const double radius : kBallRadii)
    for (int i = 0; i < 200; ++i) {
      const double share = std::uniform_real_distribution<double>(0.02, 0.2)(random_);
      const Vec3 place = at_distance(radius - share * solid().thin);
      Proxy proxy;
      shape->follow({.from = nan3(), .to = place, .radius = radius}, proxy);
      ASSERT_TRUE(proxy.touching);
      const Eigen::Matrix3d slide = shape->slide(proxy);
      constexpr double kStep = 1e-7;
      Eigen::Matrix3d quotient;
      double bend = 0;  // the surface of a ball's centre has edges of its own, where the quotient is not unique
      for (int axis = 0; axis < 3; ++axis) {
        Vec3 moved[3];
        for (const int side : {-1, 1}) {
          Proxy there = proxy;
          shape->follow({.from = place, .to = place + side * kStep * Vec3::Unit(axis), .radius = radius}, there);
          moved[side + 1] = there.position;
        }
        quotient.col(axis) = (moved[2] - moved[0]) / (2 * kStep);
        bend = std::max(bend, (moved[2] + moved[0] - 2 * proxy.position).norm() / kStep);
      }
      if (bend > 1e-3) continue;
      ++tried;
      ASSERT_LT((slide - quotient).norm(), 1e-5 * (1 + slide.norm())) << radius << '\n'
                                                                      << slide << "\n\n"
                                                                      << quotient << '\n'
                                                                      << place.transpose();
    }
  EXPECT_GT(tried, 500);
}

TEST_P(Solids, AreInsideTheirBoxAndFillIt) {
  const auto shape = shape_of(solid().json);
  const TriangleMesh mesh = shape->tessellated(1e-5, {});
  Box seen;
  for (const Vec3& vertex : mesh.vertices) seen.include(vertex);
  const Box box = shape->bounds();
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(box.min[axis], seen.min[axis], 2e-5);
    EXPECT_NEAR(box.max[axis], seen.max[axis], 2e-5);
    EXPECT_LE(box.min[axis], seen.min[axis] + 1e-15);
    EXPECT_GE(box.max[axis], seen.max[axis] - 1e-15);
  }
}

TEST_P(Solids, KnowWhetherTheyMeetABox) {
  const auto shape = shape_of(solid().json);
  int met = 0, apart = 0;
  for (int i = 0; i < 300; ++i) {
    Box box;
    const Vec3 half = 0.2 * anywhere().cwiseAbs(),
               middle = at_distance(0) + half.cwiseProduct(anywhere(1)).normalized() * half.norm();
    box.include(middle - half);
    box.include(middle + half);
    // The distance changes by at most 1 m a metre. A box that touches the surface within rounding is not decided.
    double least = 1;
    int left = 2000;
    std::function<void(const Vec3&, const Vec3&)> search = [&](const Vec3& at, const Vec3& size) {
      const double here = solid().distance(at);
      least = std::min(least, here);
      if (least < -1e-9 || here > size.norm() || --left < 0) return;
      for (int k = 0; k < 8; ++k)
        search(at + 0.5 * size.cwiseProduct(Vec3(k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 : -1)), 0.5 * size);
    };
    search(middle, half);
    if (least > -1e-9 && left < 0) continue;
    EXPECT_EQ(shape->meets(box), least < 0) << box.min.transpose() << " to " << box.max.transpose();
    ++(least < 0 ? met : apart);
  }
  EXPECT_GT(met, 20);
  EXPECT_GT(apart, 15);
}

TEST_P(Solids, AreClosedMeshesWithinTheTolerance) {
  const auto shape = shape_of(solid().json);
  for (const double tolerance : {1e-3, 1e-4, 1e-5}) {
    const TriangleMesh mesh = shape->tessellated(tolerance, {});
    EXPECT_TRUE(test::closed(mesh));
    EXPECT_GT(test::volume(mesh), 0);
    double worst = 0;
    for (const auto& t : mesh.triangles)
      for (const Vec3& w :
           {Vec3(1, 0, 0), Vec3(0.5, 0.5, 0), Vec3(0, 0.5, 0.5), Vec3(0.5, 0, 0.5), Vec3(1.0 / 3, 1.0 / 3, 1.0 / 3)})
        worst = std::max(worst, std::abs(solid().distance(w[0] * mesh.vertices[t[0]] + w[1] * mesh.vertices[t[1]] +
                                                          w[2] * mesh.vertices[t[2]])));
    EXPECT_LE(worst, tolerance * (1 + 1e-9));
  }
}

TEST_P(Solids, HoldTheToolAsAGodObjectMovedByBruteForceDoes) {
  const char* more = std::getenv("HAPTRACE_TEST_WALKS");
  const int walks = more != nullptr ? std::atoi(more) : 6;
  int held = 0, compared = 0, wrong = 0;
  for (int walk = 0; walk < walks; ++walk)
    for (const double radius : kBallRadii) {
      std::mt19937 random(static_cast<unsigned>(walk));
      std::normal_distribution<double> push(0, 1);
      const auto shape = shape_of(solid().json);
      const test::Distance offset = [&](const Vec3& p) { return solid().distance(p) - radius; };
      GodObject god(offset, std::min(0.2 * (solid().thin + 2 * radius), 2e-4));
      Proxy proxy;
      int early = 0;
      Vec3 place = 1.6 * solid().wide * Vec3(push(random), push(random), push(random)).normalized();
      place += radius * place.normalized();
      // Hands of every speed, drawn to a place inside that wanders.
      Vec3 velocity = Vec3::Zero(), goal = Vec3::Zero();
      const double speed = std::pow(10, std::uniform_real_distribution<double>(-1.5, 0.7)(random));
      for (int i = 0; i < 400; ++i) {
        if (i % 50 == 0)
          goal = 0.7 * solid().wide * Vec3(push(random), push(random), push(random)).cwiseMax(-1.5).cwiseMin(1.5);
        velocity +=
            speed * (0.3 * (goal - place) / solid().wide + 0.1 * Vec3(push(random), push(random), push(random)));
        velocity *= 0.9;
        const Vec3 to = place + 1e-3 * velocity;
        shape->follow({.from = i == 0 ? nan3() : place, .to = to, .radius = radius}, proxy);
        ASSERT_TRUE(is_finite(proxy.position) && is_finite(proxy.normal) && std::isfinite(proxy.depth));
        ASSERT_NEAR(proxy.normal.norm(), 1, 1e-12);
        ASSERT_FALSE(proxy.began_inside);
        const Vec3 expected = god.follow(place, to);
        place = to;
        held += proxy.touching ? 1 : 0;
        if (proxy.touching) {
          ASSERT_NEAR(offset(proxy.position), 0, 1e-11) << "the proxy is on the surface";
        }
        if (!god.settled()) continue;
        ++compared;
        // Where two points are equally near, both are right; so the distance is compared.
        const double depth = (expected - to).norm(), own = proxy.touching ? proxy.depth : 0;
        if (std::abs(depth - own) < 2e-5) continue;
        // Moves of finite length leave a place a little before it ceases to hold the tool.
        GodObject careful(offset, 1e-6);
        careful.put(proxy.position);
        if (proxy.touching && (careful.follow(to, to) - proxy.position).norm() < 1e-5 && ++early < 20) continue;
        ++wrong;
        EXPECT_NEAR(own, depth, 2e-5) << "radius " << radius << " walk " << walk << " tick " << i << " place "
                                      << to.transpose() << " god " << expected.transpose() << " proxy "
                                      << proxy.position.transpose() << " face " << proxy.memory.index[0];
        if (wrong > 5) FAIL();
      }
    }
  EXPECT_GT(held, 100);
  EXPECT_GT(compared, 2000);
}

INSTANTIATE_TEST_SUITE_P(All, Solids, testing::ValuesIn(every_solid()));

/// Presses through a plate whose flat side looks along `up`, to `beyond` its far side, and returns.
void press_through(const std::string& json, const Vec3& up, double thickness, double wide, double tick, double radius) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> side(-1, 1);
  const auto shape = shape_of(json);
  int ticks = 0;
  for (int entry = 0; entry < 200; ++entry) {
    const double over = entry % 2 == 0 ? 1 : -1;
    const Vec3 across = up.unitOrthogonal(), along = up.cross(across);
    const Vec3 foot = 0.5 * wide * (side(random) * across + side(random) * along);
    const Vec3 drift = 5e-3 * (side(random) * across + side(random) * along);
    const double top = thickness / 2 + radius, deepest = -thickness / 2 - 4e-3, start = top + 1.234e-3;
    Proxy proxy;
    Vec3 from = nan3();
    const int steps = std::max(2, static_cast<int>((start - deepest) / tick));
    for (int i = 0; i <= 2 * steps; ++i) {
      const double share = 1 - std::abs(static_cast<double>(i) / steps - 1);
      const Vec3 place = foot + share * drift + over * (start + share * (deepest - start)) * up;
      shape->follow({.from = from, .to = place, .radius = radius}, proxy);
      from = place;
      const double height = over * place.dot(up);
      if (height > top) {
        ASSERT_FALSE(proxy.touching);
      } else if (height < thickness / 4) {
        ++ticks;
        ASSERT_TRUE(proxy.touching);
        ASSERT_GT(over * proxy.normal.dot(up), 0.5) << "the side on which the tool entered";
        ASSERT_GE(proxy.depth, 0);
      }
    }
    ASSERT_FALSE(proxy.touching) << "it lets go";
  }
  EXPECT_GT(ticks, 200);
}

TEST(ThinSolids, NeverPushToTheWrongSide) {
  const Vec3 x = Vec3::UnitX(), z = Vec3::UnitZ();
  for (const double tick : {1e-5, 1e-3, 1e-2})
    for (const double radius : {0.0, 1e-4, 2e-3}) {
      press_through(R"({"kind": "box", "size": [0.1, 0.1, 0.001]})", z, 1e-3, 0.08, tick, radius);
      press_through(R"({"kind": "box", "size": [0.0005, 0.1, 0.1]})", x, 5e-4, 0.08, tick, radius);
      press_through(R"({"kind": "cylinder", "radius": 0.06, "height": 0.001})", z, 1e-3, 0.06, tick, radius);
      press_through(R"({"kind": "ellipsoid", "radii": [0.1, 0.09, 0.0005]})", z, 1e-3, 0.05, tick, radius);
      press_through(R"({"kind": "ellipsoid", "radii": [0.0005, 0.1, 0.1]})", x, 1e-3, 0.05, tick, radius);
    }
}

TEST(ThinSolids, HoldTheToolOnTheFlankOfAFlatConeBelowItsBase) {
  const auto cone = shape_of(R"({"kind": "cone", "radius": 0.1, "height": 0.002})");
  for (const double tick : {1e-4, 6e-3}) {
    Proxy proxy;
    Vec3 from(0.03, 0.01, 0.0035);
    for (double z = 0.0035 - tick; z > -0.0041; z -= tick) {
      const Vec3 place(0.03, 0.01, z);
      cone->follow({.from = from, .to = place}, proxy);
      from = place;
      if (z < 0.001) {
        ASSERT_TRUE(proxy.touching);
        ASSERT_GT(proxy.normal.z(), 0.99);
      }
    }
    // And from below, beyond the apex.
    Proxy other;
    from = Vec3(0.03, 0.01, -0.0035);
    for (double z = -0.0035 + tick; z < 0.0061; z += tick) {
      const Vec3 place(0.03, 0.01, z);
      cone->follow({.from = from, .to = place}, other);
      from = place;
      if (z > 0.0005) {
        ASSERT_TRUE(other.touching);
        ASSERT_EQ(other.normal, -Vec3::UnitZ());
      }
    }
  }
}

TEST(ThinSolids, StopAToolThatIsFasterThanThePlateIsThick) {
  // 10 m/s at 1 kHz: 10 mm a tick, through a plate of 0.5 mm.
  Alone plate(R"({"kind": "box", "size": [0.1, 0.1, 0.0005], "stiffness": 1000})", Vec3(0, 0, 0.0072));
  const Contact contact = plate.answer({.position = Vec3(0.001, 0, -0.0028), .velocity = Vec3(1, 0, -10), .dt = 1e-3});
  EXPECT_LT((contact.force - Vec3(0, 0, 1000 * (0.0028 + 0.00025))).norm(), 1e-12);
  EXPECT_LT((contact.proxy - Vec3(0.001, 0, 0.00025)).norm(), 1e-15);
}

TEST(BoxOfAScene, LetsTheBallRollOverItsEdgeFromFaceToFace) {
  const auto box = shape_of(R"({"kind": "box", "size": 0.1})");
  constexpr double kRadius = 4e-3, kDepth = 1e-3;
  Proxy proxy;
  Vec3 from = nan3(), normal = Vec3::UnitZ();
  double turned = 0;
  // Round the edge at x = z = 50 mm, 1 mm deep.
  for (int i = 0; i <= 3000; ++i) {
    const double s = std::clamp((i - 1000) * 1e-3, 0.0, 1.0) * std::numbers::pi / 2;
    const Vec3 out(std::sin(s), 0, std::cos(s));
    const Vec3 place = Vec3(0.05, 0, 0.05) + (kRadius - kDepth) * out +
                       1e-5 * (i < 1000 ? Vec3(i - 1000.0, 0, 0) : Vec3(0, 0, std::min(0.0, 2000.0 - i)));
    box->follow({.from = from, .to = place, .radius = kRadius}, proxy);
    from = place;
    ASSERT_NEAR(proxy.depth, kDepth, 1e-15);
    ASSERT_LT((proxy.normal - out).norm(), 1e-12);
    ASSERT_LT((proxy.normal - normal).norm(), 2e-3) << "without a jump";
    turned += (proxy.normal - normal).norm();
    normal = proxy.normal;
  }
  EXPECT_NEAR(turned, std::numbers::pi / 2, 1e-3);
}

TEST(BoxOfAScene, LetsAPointGoOverItsEdge) {
  const auto box = shape_of(R"({"kind": "box", "size": 0.1})");
  Proxy proxy;
  box->follow({.from = Vec3(0, 0, 0.06), .to = Vec3(0.049, 0, 0.047)}, proxy);
  EXPECT_EQ(proxy.normal, Vec3::UnitZ());
  box->follow({.from = Vec3(0.049, 0, 0.047), .to = Vec3(0.04999, 0, 0.02)}, proxy);
  EXPECT_EQ(proxy.normal, Vec3::UnitZ()) << "the side is nearer, but the proxy is on top";
  box->follow({.from = Vec3(0.04999, 0, 0.02), .to = Vec3(0.0501, 0, 0.02)}, proxy);
  EXPECT_FALSE(proxy.touching);
  box->follow({.from = Vec3(0.0501, 0, 0.02), .to = Vec3(0.0499, 0, 0.02)}, proxy);
  EXPECT_EQ(proxy.normal, Vec3::UnitX());
}

TEST(RoundSolids, KeepTheLastNormalWhereTheyHaveNone) {
  struct Case {
    std::string json;
    Vec3 from, middle;
  };
  for (const Case& c :
       {Case{R"({"kind": "cylinder", "radius": 0.02, "height": 1})", Vec3(0, 0.03, 0.1), Vec3(0, 0, 0.1)},
        Case{R"({"kind": "torus", "radius": 0.04, "tube": 0.01})", Vec3(0.04, 0, -0.02), Vec3(0.04, 0, 0)},
        Case{R"({"kind": "ellipsoid", "radii": 0.02})", Vec3(0, -0.03, 0), Vec3(0, 0, 0)},
        Case{R"({"kind": "ellipsoid", "radii": [0.02, 0.05, 0.02]})", Vec3(0.03, 0, 0), Vec3(0, 0, 0)},
        Case{R"({"kind": "ellipsoid", "radii": [0.05, 0.05, 0.02]})", Vec3(0, 0, -0.03), Vec3(0, 0, 0)}}) {
    const auto shape = shape_of(c.json);
    const Vec3 out = (c.from - c.middle).normalized();
    for (const double near : {0.0, 1e-14, 1e-160, 5e-324}) {
      Proxy proxy;
      const Vec3 half = c.middle + 0.005 * out;
      shape->follow({.from = c.from, .to = half}, proxy);
      ASSERT_LT((proxy.normal - out).norm(), 1e-12);
      shape->follow({.from = half, .to = c.middle + near * out}, proxy);
      ASSERT_TRUE(proxy.touching);
      EXPECT_LT((proxy.normal - out).norm(), 1e-9) << c.json << near;
    }
    Proxy fresh;
    shape->follow({.to = c.middle}, fresh);
    EXPECT_TRUE(fresh.touching && fresh.began_inside);
    EXPECT_NEAR(fresh.normal.norm(), 1, 1e-12);
    EXPECT_TRUE(is_finite(fresh.position));
  }
  const auto cone = shape_of(R"({"kind": "cone", "radius": 0.02, "height": 0.04})");
  Proxy proxy;
  cone->follow({.from = Vec3(0, 0.03, 0.02), .to = Vec3(0, 0.001, 0.02)}, proxy);
  const Vec3 flank = proxy.normal;
  EXPECT_GT(flank.y(), 0.5);
  cone->follow({.from = Vec3(0, 0.001, 0.02), .to = Vec3(0, 0, 0.02)}, proxy);
  EXPECT_LT((proxy.normal - flank).norm(), 1e-12);
}

TEST(TorusOfAScene, LetsAPointThroughItsHoleAndClosesItToABiggerBall) {
  const auto ring = shape_of(R"({"kind": "torus", "radius": 0.02, "tube": 0.01})");
  Proxy proxy;
  ring->follow({.from = Vec3(0, 0, 0.05), .to = Vec3(0, 0, -0.05)}, proxy);
  EXPECT_FALSE(proxy.touching);

  // A ball of 16 mm rests 16.6 mm above the middle, where it touches the ring all round.
  constexpr double kRadius = 0.016;
  const double mouth = std::sqrt(0.026 * 0.026 - 0.02 * 0.02);
  for (const double up : {1.0, -1.0})
    for (const double tick : {1e-4, 0.2}) {
      Proxy ball;
      Vec3 from = Vec3(0.001, 0, up * 0.1);
      for (double z = 0.1 - tick; z > -0.15; z -= tick) {
        const Vec3 place(0.001, 0, up * z);
        ring->follow({.from = from, .to = place, .radius = kRadius}, ball);
        from = place;
        if (z < mouth - 0.003) {
          ASSERT_TRUE(ball.touching);
          ASSERT_LT((ball.position - Vec3(0, 0, up * mouth)).norm(), 1e-15);
          ASSERT_NEAR(ball.depth, (ball.position - place).norm(), 1e-15);
        }
      }
    }
  // Past the rim, the ring lets the ball go on the other side.
  Proxy ball;
  ring->follow({.from = Vec3(0, 0, 0.1), .to = Vec3(0, 0, -0.02), .radius = kRadius}, ball);
  ring->follow({.from = Vec3(0, 0, -0.02), .to = Vec3(0.1, 0, -0.02), .radius = kRadius}, ball);
  EXPECT_FALSE(ball.touching);
  ring->follow({.from = Vec3(0.1, 0, -0.02), .to = Vec3(0, 0, -0.0155), .radius = kRadius}, ball);
  ASSERT_TRUE(ball.touching);
  EXPECT_LT(ball.position.z(), 0);
}

TEST(SolidsOfAScene, NameTheKeyThatIsWrong) {
  const auto read = [](const std::string& json) { return error_of([&] { (void)shape_of(json); }); };
  EXPECT_THAT(read(R"({"kind": "box"})"), HasSubstr("'size' is missing"));
  EXPECT_THAT(read(R"({"kind": "box", "size": [0.1, 0, 0.1]})"), HasSubstr("size[1]: 0 is too small"));
  EXPECT_THAT(read(R"({"kind": "cylinder", "radius": 0.1})"), HasSubstr("'height' is missing"));
  EXPECT_THAT(read(R"({"kind": "cone", "radius": 1000, "height": 1})"), HasSubstr("radius: 1000 is too large"));
  EXPECT_THAT(read(R"({"kind": "torus", "radius": 0.01, "tube": 0.01})"),
              HasSubstr("less than the radius of the ring"));
  EXPECT_THAT(read(R"({"kind": "ellipsoid", "radii": [1, 2]})"), HasSubstr("radii"));
  EXPECT_THAT(read(R"({"kind": "ellipsoid", "radius": 1, "radii": 1})"), HasSubstr("radius"));
}

}  // namespace
}  // namespace haptrace
