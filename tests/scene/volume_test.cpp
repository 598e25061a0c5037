// Volumes: the field through their values, and the contact with their iso-surfaces.
#include "scene/shape/volume.h"

#include "scene/shape/sphere.h"
#include "tests/scene/alone.h"
#include "tests/scene/solid_cases.h"
#include "tests/scene/volumes.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

using test::error_of;
using test::volume_of;
using testing::HasSubstr;

ScalarField field_of(const VolumeData& data, int order) {
  const auto same = [](float value) { return value; };
  return {data, order, same, same};
}

Volume volume_with(const VolumeData& data, int order = 3, double iso = 0, bool above = false) {
  Volume volume(std::make_shared<const VolumeData>(data), {.iso = iso, .inside_above = above, .order = order});
  volume.prepare(0);
  return volume;
}

/// A tool that touches a volume.
struct VolumeHand {
  explicit VolumeHand(const Shape& touched, double ball = 0) : shape(touched), radius(ball) {}
  const Proxy& to(const Vec3& place) {
    shape.follow({.from = at, .to = place, .radius = radius}, proxy);
    at = place;
    return proxy;
  }
  const Shape& shape;
  double radius;
  Vec3 at = nan3();
  Proxy proxy;
};

// Axes of different spacing, skewed and with the other handedness.
Eigen::Matrix3d odd_steps() {
  Eigen::Matrix3d steps;
  steps << 0, 2e-3, 1e-4, 1e-3, 0, 0, 0, 2e-4, 3e-3;
  return steps;
}

// --- Field ---

TEST(ScalarField, IsExactOnALinearField) {
  const Vec3 slope(0.5, -2, 1);
  const VolumeData data = volume_of([&](const Vec3& p) { return slope.dot(p) + 0.25; }, {60, 50, 50}, odd_steps());
  std::mt19937 random(1);
  std::uniform_real_distribution<double> side(-0.012, 0.012);
  for (const int order : {1, 3}) {
    const ScalarField field = field_of(data, order);
    for (int i = 0; i < 2000; ++i) {
      const Vec3 place(side(random), 0.5 * side(random), side(random));
      const FieldPoint point = field.at(place);
      // In single precision the samples are within 3e-8 of the line.
      ASSERT_NEAR(point.value, slope.dot(place) + 0.25, 1e-7);
      ASSERT_LT((point.gradient - slope).norm(), 1e-4);
      ASSERT_LT(point.hessian.norm(), 0.2);
      ASSERT_EQ(field.slope_at(place).gradient, point.gradient);
    }
  }
}

TEST(ScalarField, PassesThroughItsSamplesAndHasTheDerivativesThatItStates) {
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  const VolumeData data = volume_of([&](const Vec3&) { return normal(random); }, {12, 11, 10}, odd_steps());
  for (const int order : {1, 3}) {
    const ScalarField field = field_of(data, order);
    for (std::size_t k = 0; k < 10; ++k)
      for (std::size_t j = 0; j < 11; ++j)
        for (std::size_t i = 0; i < 12; ++i)
          ASSERT_NEAR(
              field.at(data.place(Vec3(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)))).value,
              data.at(i, j, k), 2e-6);
    std::uniform_real_distribution<double> along(0, 9);
    double bent = 0;
    for (int i = 0; i < 500 && order == 3; ++i) {
      const Vec3 place = data.place(Vec3(along(random), along(random), along(random)));
      const FieldPoint point = field.at(place);
      for (int axis = 0; axis < 3; ++axis) {
        const Vec3 step = 1e-7 * Vec3::Unit(axis);
        const FieldPoint after = field.at(place + step), before = field.at(place - step);
        ASSERT_NEAR((after.value - before.value) / 2e-7, point.gradient[axis], 1e-5 * point.gradient.norm() + 1e-2);
        const Vec3 bend = (after.gradient - before.gradient) / 2e-7;
        ASSERT_LT((bend - point.hessian.col(axis)).norm(), 1e-3 * (1e6 + point.hessian.norm()));
        bent = std::max(bent, bend.norm());
      }
    }
    if (order == 3) {
      EXPECT_GT(bent, 1e6);
    }
  }
}

TEST(ScalarField, HasADirectionErrorOfTheSecondOrderOnTheFieldOfDistance) {
  // |x|, whose gradient is a unit vector.
  for (const int order : {1, 3}) {
    std::vector<double> errors;
    for (const double spacing : {8e-3, 4e-3, 2e-3}) {
      const auto side = static_cast<std::size_t>(0.16 / spacing) + 1;
      const ScalarField field = field_of(volume_of([](const Vec3& p) { return p.norm(); }, side, spacing), order);
      std::mt19937 random(3);
      std::normal_distribution<double> normal;
      double worst = 0;
      for (int i = 0; i < 3000; ++i) {
        const Vec3 out = Vec3(normal(random), normal(random), normal(random)).normalized();
        const Vec3 direction = field.at(0.05 * out).gradient.normalized();
        worst = std::max(worst, direction.cross(out).norm());
      }
      errors.push_back(worst);
    }
    for (const std::size_t i : {0U, 1U})
      EXPECT_LT(errors[i + 1], std::max(errors[i] / 3.5, 1e-5)) << order;  // the last by rounding
    EXPECT_LT(errors[2], order == 1 ? 1e-3 : 1e-5);
    EXPECT_GT(errors[0], 1e-4);
  }
}

TEST(ScalarField, FindsWhereAStepEntersAsALookAtEveryPlaceDoes) {
  // Sheets that are thinner than a sample, seen by samples on both sides or by one.
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> side(-0.02, 0.02);
  const VolumeData data = volume_of([&](const Vec3&) { return 0.7 + normal(random); }, 24, 1e-3);
  for (const int order : {1, 3}) {
    const ScalarField field = field_of(data, order);
    int found = 0, missed = 0;
    for (int i = 0; i < 1500; ++i) {
      const Vec3 from(side(random), side(random), side(random)), to(side(random), side(random), side(random));
      if (field.covers(from) && field.at(from).value < 0) continue;
      const double share = field.entered(from, to);
      double first = 2;
      for (int j = 0; j <= 4000 && first > 1; ++j) {
        const Vec3 place = from + j / 4000.0 * (to - from);
        if (field.covers(place) && field.at(place).value < 0) first = j / 4000.0;
      }
      if (first <= 1) ++found;
      ASSERT_LE(share, first + 1e-9) << i;
      if (share < first - 1.0 / 4000) ++missed;  // between two looks
      if (share <= 1) {
        ASSERT_LT(field.at(from + share * (to - from)).value, 1e-6);
      }
    }
    EXPECT_GT(found, 500);
    EXPECT_LT(missed, 20);
  }
}

// --- Surface ---

TEST(VolumeOfAScene, IsTheSphereThatItsValuesAreTheDistanceFrom) {
  const Volume volume = volume_with(volume_of([](const Vec3& p) { return p.norm() - 0.03; }, 75, 1e-3));
  const Sphere sphere({.radius = 0.03});
  VolumeHand hand(volume), other(sphere);
  std::mt19937 random(5);
  std::normal_distribution<double> push;
  Vec3 place(0, 0, 0.035), velocity = Vec3::Zero();
  int touched = 0;
  for (int tick = 0; tick < 20'000; ++tick) {
    velocity +=
        1e-3 * (15 * Vec3(push(random), push(random), push(random)) - 300 * (place - 0.029 * place.normalized())) -
        0.01 * velocity;
    place += 1e-3 * velocity;
    const Proxy &own = hand.to(place), &exact = other.to(place);
    if (std::abs(exact.depth) < 1e-7) continue;
    ASSERT_EQ(own.touching, exact.touching) << exact.depth;
    if (!own.touching) continue;
    ++touched;
    ASSERT_NEAR(own.depth, exact.depth, 2e-8);
    ASSERT_LT((own.normal - exact.normal).norm(), 2e-5);
    ASSERT_LT((own.position - exact.position).norm(), 1e-6);
    ASSERT_LT((own.position - place - own.depth * own.normal).norm(), 1e-9) << "the tool is behind its proxy";
  }
  EXPECT_GT(touched, 5000);
}

/// Returns the largest change of the normal, beyond that of the sphere, from step to step of a slide over a sphere.
double largest_jump(const std::function<Vec3(const Vec3&)>& normal_at) {
  double worst = 0;
  Vec3 last = Vec3::Zero();
  for (int i = 0; i < 40'000; ++i) {
    const double a = 0.3 + 1e-5 * i;
    const Vec3 out(std::sin(a) * std::cos(0.4), std::sin(a) * std::sin(0.4), std::cos(a));
    const Vec3 normal = normal_at(out);
    if (i > 0) worst = std::max(worst, (normal - last).norm());
    last = normal;
  }
  return worst;
}

TEST(VolumeOfAScene, DoesNotBuzzOverTheFacesOfVoxels) {
  const VolumeData data = volume_of([](const Vec3& p) { return p.norm() - 0.03; }, 39, 2e-3);
  for (const int order : {1, 3}) {
    const Volume volume = volume_with(data, order);
    VolumeHand hand(volume);
    hand.to(Vec3(0.01, 0.005, 0.04));
    const double jump = largest_jump([&](const Vec3& out) { return hand.to(0.029 * out).normal; });
    EXPECT_LT(jump, (order == 1 ? 1.6 : 1.05) * 1e-5) << "the sphere's own turn is 1e-5 a step";
  }
  // The gradient of the trilinear value jumps at every face, by the change of slope over a sample.
  const ScalarField field = field_of(data, 1);
  const double contrast = largest_jump([&](const Vec3& out) -> Vec3 {
    const Vec3 u = field.index_of(0.03 * out), low(std::floor(u.x()), std::floor(u.y()), std::floor(u.z()));
    Vec3 slope;
    for (int axis = 0; axis < 3; ++axis) {
      Vec3 least = u, most = u;
      least[axis] = low[axis];
      most[axis] = low[axis] + 1;
      slope[axis] = field.at(field.place_of(most)).value - field.at(field.place_of(least)).value;
    }
    return slope.normalized();
  });
  EXPECT_GT(contrast, 1e-2);
}

TEST(VolumeOfAScene, TakesSamplesOfAnyShapeAndHandedness) {
  const Vec3 middle(0.1, -0.05, 0.02);
  Eigen::Matrix3d steps;
  steps << 0, 0.5e-3, 1e-4, -1e-3, 0, 0, 0, 1e-4, -2e-3;
  const VolumeData data =
      volume_of([&](const Vec3& p) { return 500 - 1e4 * (p - middle).norm(); }, {60, 120, 30}, steps, middle);
  const Volume volume = volume_with(data, 3, 300, true);  // a radius of 20 mm
  std::mt19937 random(6);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 500; ++i) {
    const Vec3 out = Vec3(normal(random), normal(random), normal(random)).normalized();
    VolumeHand hand(volume);
    hand.to(middle + 0.06 * out);
    const Proxy& proxy = hand.to(middle + 0.018 * out);
    ASSERT_TRUE(proxy.touching);
    ASSERT_NEAR(proxy.depth, 0.002, 2e-6);
    ASSERT_LT((proxy.normal - out).norm(), 1e-3);
    const SurfacePoint point = volume.nearest(middle + 0.024 * out);
    ASSERT_NEAR(point.distance, 0.004, 2e-6);
    ASSERT_LT((point.position - middle - 0.02 * out).norm(), 1e-5);
  }
}

TEST(VolumeOfAScene, StopsAFastToolOnTheSideOnWhichItCame) {
  // A sheet of a fifth of a sample.
  const Volume volume = volume_with(volume_of([](const Vec3& p) { return std::abs(p.z()) - 1e-4; }, {41, 41, 41},
                                              1e-3 * Eigen::Matrix3d::Identity()));
  for (const double speed : {1e-4, 1e-3, 1e-2, 0.1}) {
    VolumeHand hand(volume);
    int touched = 0;
    for (double z = 0.012; z > -0.011 && z > 0.012 - 40 * speed - 0.03; z -= speed) {
      const Proxy& proxy = hand.to({0.0013, -0.0021, z});
      if (z > 1e-4) continue;
      ++touched;
      ASSERT_TRUE(proxy.touching) << z;
      ASSERT_GT(proxy.normal.z(), 0.99) << "the side on which it came";
      ASSERT_NEAR(proxy.position.z(), 2e-4, 1e-4) << "a spline is a little round between samples";
    }
    if (speed < 0.05) {
      EXPECT_GT(touched, 0);
    }
  }
}

TEST(VolumeOfAScene, NeverLetsAToolThroughInARandomWalk) {
  const double wave = 2 * std::numbers::pi / 0.02;
  const auto gyroid = [&](const Vec3& p) {
    const Vec3 q = wave * p;
    return std::sin(q.x()) * std::cos(q.y()) + std::sin(q.y()) * std::cos(q.z()) + std::sin(q.z()) * std::cos(q.x());
  };
  const Volume volume = volume_with(volume_of(gyroid, 48, 1e-3));
  std::mt19937 random(7);
  std::normal_distribution<double> push;
  VolumeHand hand(volume);
  Vec3 place(0, 0, 0.05), velocity = Vec3::Zero();
  hand.to(place);
  int inside = 0, free_inside = 0;
  for (int tick = 0; tick < 200'000; ++tick) {
    velocity += 1e-3 * (40 * Vec3(push(random), push(random), push(random)) - 100 * place) - 0.01 * velocity;
    if (hand.proxy.touching) velocity += 0.3 * (hand.proxy.position - place) / 1e-3 * 0.05;
    place += 1e-3 * velocity;
    const Proxy& proxy = hand.to(place);
    if (!proxy.touching) {
      if (volume.field().covers(place) && volume.field().at(place).value < -1e-9) ++free_inside;
      continue;
    }
    ++inside;
    ASSERT_TRUE(is_finite(proxy.position) && is_finite(proxy.normal));
    ASSERT_NEAR(proxy.normal.norm(), 1, 1e-12);
    const FieldPoint point = volume.field().at(proxy.position);
    ASSERT_LT(std::abs(point.value) / point.gradient.norm(), 1e-4) << "it is on the surface";
    ASSERT_FALSE(proxy.began_inside);
  }
  EXPECT_GT(inside, 10'000);
  EXPECT_EQ(free_inside, 0);
}

TEST(VolumeOfAScene, IsClosedAtTheBorderOfItsGridAndNowhereBeyond) {
  // A rod along z, longer than the grid.
  const VolumeData data = volume_of([](const Vec3& p) { return std::hypot(p.x(), p.y()) - 0.01; }, {41, 41, 21},
                                    1e-3 * Eigen::Matrix3d::Identity());
  const Volume volume = volume_with(data);
  EXPECT_THAT(volume.remarks(), testing::Contains(HasSubstr("cut by the border of the grid")));
  const double end = 0.01;  // of the samples
  VolumeHand hand(volume);
  hand.to(Vec3(0.002, 0.001, 0.03));
  const Proxy& proxy = hand.to(Vec3(0.002, 0.001, 0.008));
  ASSERT_TRUE(proxy.touching);
  EXPECT_GT(proxy.normal.z(), 0.9);
  EXPECT_GE(proxy.position.z(), end);
  EXPECT_LE(proxy.position.z(), end + 1e-3);
  for (const Vec3& place : {Vec3(0, 0, 0.0111), Vec3(0, 0, 1), Vec3(0.5, 0, 0), Vec3(0.003, 0, -0.0111)}) {
    VolumeHand other(volume);
    EXPECT_FALSE(other.to(place).touching) << place.transpose();
  }
}

TEST(VolumeOfAScene, HoldsABallAtItsRadius) {
  Volume volume = volume_with(volume_of([](const Vec3& p) { return p.norm() - 0.02; }, 55, 1e-3));
  constexpr double kRadius = 0.004;
  volume.prepare(kRadius);
  VolumeHand hand(volume, kRadius);
  std::mt19937 random(8);
  std::normal_distribution<double> normal;
  for (const double speed : {2e-4, 5e-3, 0.05}) {
    int touched = 0;
    for (int i = 0; i < 50; ++i) {
      const Vec3 out = Vec3(normal(random), normal(random), normal(random)).normalized();
      hand.proxy = {};
      hand.at = nan3();
      for (double r = 0.06; r > 0.02; r -= speed) {
        const Proxy& proxy = hand.to(r * out);
        if (std::abs(r - 0.024) < 1e-6) continue;
        ASSERT_EQ(proxy.touching, r < 0.024) << r;
        if (!proxy.touching) continue;
        ++touched;
        ASSERT_NEAR(proxy.depth, 0.024 - r, 1e-6);
        ASSERT_LT((proxy.position - 0.024 * out).norm(), 1e-5);
      }
    }
    if (speed < 0.05) {
      EXPECT_GT(touched, 0);
    }
  }
}

TEST(VolumeOfAScene, RefusesABallThatIsTooLargeForIt) {
  // A hollow ball with an opening.
  const auto bowl = [](const Vec3& p) { return std::max(std::abs(p.norm() - 0.015) - 0.003, p.z() - 0.004); };
  Volume volume = volume_with(volume_of(bowl, 45, 1e-3));
  EXPECT_NO_THROW(volume.prepare(0.001));
  EXPECT_THAT(error_of([&] { volume.prepare(0.014); }),
              testing::AllOf(HasSubstr("a ball of 0.014 m does not fit"), HasSubstr("Use a smaller radius")));
}

TEST(VolumeOfAScene, SlidesAsTheDifferenceQuotientOfItsProxy) {
  const auto egg = [](const Vec3& p) { return p.cwiseQuotient(Vec3(0.02, 0.03, 0.04)).norm() - 1; };
  const Volume volume = volume_with(volume_of(egg, 90, 1e-3));
  std::mt19937 random(9);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 200; ++i) {
    const Vec3 out = Vec3(normal(random), normal(random), normal(random)).normalized();
    VolumeHand hand(volume);
    hand.to(0.06 * out);
    const SurfacePoint surface = volume.nearest(0.06 * out);
    const Vec3 place = surface.position - 0.003 * surface.normal;
    for (int settle = 0; settle < 20; ++settle) hand.to(place);
    ASSERT_TRUE(hand.proxy.touching);
    const Eigen::Matrix3d slide = volume.slide(hand.proxy);
    Eigen::Matrix3d quotient;
    for (int axis = 0; axis < 3; ++axis) {
      Vec3 moved[2];
      for (const int side : {0, 1}) {
        VolumeHand there = hand;
        for (int settle = 0; settle < 5; ++settle) there.to(place + (2 * side - 1) * 1e-6 * Vec3::Unit(axis));
        moved[side] = there.proxy.position;
      }
      quotient.col(axis) = (moved[1] - moved[0]) / 2e-6;
    }
    ASSERT_LT((slide - quotient).norm(), 1e-3) << slide << "\n\n" << quotient;
  }
}

TEST(VolumeOfAScene, ErrsLessWithMoreStepsAndTheFinerInterpolation) {
  const auto egg = [](const Vec3& p) { return p.cwiseQuotient(Vec3(0.012, 0.013, 0.014)).norm() - 1; };
  const VolumeData data = volume_of(egg, 41, 1e-3);
  const auto made = [&](int order, int steps) {
    Volume volume(std::make_shared<const VolumeData>(data),
                  {.iso = 0, .inside_above = false, .order = order, .steps = steps});
    volume.prepare(0);
    return volume;
  };
  const auto error = [&](int order, int steps) {
    const Volume volume = made(order, steps), exact = made(3, 10);
    VolumeHand hand(volume), other(exact);
    hand.to(Vec3(0, 0, 0.02));
    other.to(Vec3(0, 0, 0.02));
    double worst = 0;
    for (int i = 0; i < 2000; ++i) {
      // 0.6 mm a tick, 2 to 4 mm deep.
      const double a = 0.06 * i;
      const Vec3 place = 0.01 * Vec3(std::sin(a) * std::cos(0.3), std::sin(a) * std::sin(0.3), std::cos(a));
      worst = std::max(worst, (hand.to(place).normal - other.to(place).normal).norm());
    }
    return worst;
  };
  EXPECT_LT(error(3, 2), 0.5 * error(3, 1));
  EXPECT_LT(error(3, 3), 0.5 * error(3, 2));
  EXPECT_LT(error(3, 2), 0.5 * error(1, 3));
}

TEST(VolumeOfAScene, BecomesAClosedMeshWithinTheTolerance) {
  const auto egg = [](const Vec3& p) { return p.cwiseQuotient(Vec3(0.02, 0.03, 0.04)).norm() - 1; };
  Eigen::Matrix3d mirrored = Vec3(2e-3, -2e-3, 2e-3).asDiagonal();
  for (const Eigen::Matrix3d& steps : {Eigen::Matrix3d(2e-3 * Eigen::Matrix3d::Identity()), mirrored}) {
    const Volume volume = volume_with(volume_of(egg, {30, 40, 50}, steps));
    for (const double tolerance : {1e-3, 1e-4}) {
      const TriangleMesh mesh = volume.tessellated(tolerance, {});
      EXPECT_TRUE(test::closed(mesh));
      EXPECT_NEAR(test::volume(mesh), 4 * std::numbers::pi / 3 * 0.02 * 0.03 * 0.04, 0.02 * 1e-4);
      double worst = 0;
      for (const auto& t : mesh.triangles) {
        const Vec3 middle = (mesh.vertices[t[0]] + mesh.vertices[t[1]] + mesh.vertices[t[2]]) / 3;
        const FieldPoint point = volume.field().slope_at(middle);
        worst = std::max(worst, std::abs(point.value) / point.gradient.norm());
      }
      EXPECT_LE(worst, tolerance);
      for (const Vec3& vertex : mesh.vertices) {
        EXPECT_TRUE((vertex.array() >= volume.bounds().min.array()).all());
        EXPECT_TRUE((vertex.array() <= volume.bounds().max.array()).all());
      }
    }
  }
}

TEST(VolumeOfAScene, NamesTheKeyThatIsWrong) {
  const auto read = [](const std::string& keys) {
    return error_of([&] {
      (void)test::shape_of(fmt::format(R"({{"kind": "volume", "file": "{}"{}}})", test::ball_volume(), keys));
    });
  };
  EXPECT_EQ(read(R"(, "iso": 0)"), "no error");
  EXPECT_THAT(read(""), HasSubstr("'iso' is missing"));
  EXPECT_THAT(read(R"(, "iso": 1)"), HasSubstr("ball.nrrd: iso is 1, but the values are from -0.06 to"));
  EXPECT_THAT(read(R"(, "iso": 0, "inside": "abvoe")"), HasSubstr("above"));
  EXPECT_THAT(read(R"(, "iso": 0, "interpolation": 2)"), HasSubstr("1 (trilinear) or 3 (tricubic)"));
  EXPECT_THAT(read(R"(, "iso": 0, "steps": 0)"), HasSubstr("steps"));
  EXPECT_THAT(read(R"(, "iso": 0, "unit": "s")"), HasSubstr("'s' is no length"));
}

}  // namespace
}  // namespace haptrace
