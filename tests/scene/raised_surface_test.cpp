// Where a surface is touched in front of its shape, on every kind of shape: where a texture raises it, and where an
// adhesion holds a tool that leaves.
#include "control/norm.h"
#include "tests/scene/alone.h"
#include "tests/scene/nurbs_patches.h"
#include "tests/scene/volumes.h"
#include "tests/support/allocations.h"

#include <cmath>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>

namespace haptrace {
namespace {

using std::numbers::pi;
using test::Alone;
using test::TempFolder;

constexpr double kRaisedTick = 1e-3, kCrest = 5e-4, kWave = 8e-3, kRaisedStiffness = 500;  // [s], [m], [m], [N/m]

/// Waves along x with a crest at x = 0 and a valley at x = 4 mm.
std::string wavy(const std::string& more = "", const std::string& law = "potential") {
  return fmt::format(
      R"("stiffness": {}, {} "texture": {{"kind": "fourier", "law": "{}",
         "waves": [{{"wavelength": {}, "amplitude": {}, "direction": [1, 0, 0]}}]}})",
      kRaisedStiffness, more, law, kWave, kCrest);
}

std::string wavy_wall(const std::string& more = "", const std::string& law = "potential") {
  return R"({"kind": "wall", "point": 0, "normal": [0, 0, 1], )" + wavy(more, law) + "}";
}

/// A shape whose top is at the origin, flat or nearly so, and whether a ball can touch it.
struct RaisedCase {
  std::string name, shape;
  bool takes_ball = true;
  bool closed = true;  ///< an open surface does not know a tool that begins behind it
};

void PrintTo(const RaisedCase& one, std::ostream* out) {
  *out << one.name;
}

std::vector<RaisedCase> raised_cases() {
  static const TempFolder folder;
  const std::string slab = folder.write("slab.obj", "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3 4\n");
  const std::string block = folder.write(
      "block.obj",
      "v -.05 -.05 0\nv .05 -.05 0\nv .05 .05 0\nv -.05 .05 0\nv -.05 -.05 -.05\nv .05 -.05 -.05\n"
      "v .05 .05 -.05\nv -.05 .05 -.05\nf 1 2 3 4\nf 8 7 6 5\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n");
  const std::string ball = test::volume_file(
      "raised.nrrd", test::volume_of([](const Vec3& p) { return norm_of(p + Vec3(0, 0, 0.04)) - 0.04; }, {51, 51, 51},
                                     2e-3 * Eigen::Matrix3d::Identity(), Vec3(0, 0, -0.04)));
  return {
      {"Wall", R"("kind": "wall", "point": 0, "normal": [0, 0, 1])"},
      {"Sphere", R"("kind": "sphere", "centre": [0, 0, -0.05], "radius": 0.05)"},
      {"Box", R"("kind": "box", "centre": [0, 0, -0.02], "size": [0.1, 0.1, 0.04])"},
      {"Cylinder", R"("kind": "cylinder", "centre": [0, 0, -0.02], "radius": 0.05, "height": 0.04)"},
      {"Torus", R"("kind": "torus", "centre": [-0.04, 0, -0.02], "radius": 0.04, "tube": 0.02)"},
      {"Ellipsoid", R"("kind": "ellipsoid", "centre": [0, 0, -0.03], "radii": [0.05, 0.04, 0.03])"},
      {"OpenMesh", fmt::format(R"("kind": "mesh", "file": "{}")", slab), true, false},
      {"ClosedMesh", fmt::format(R"("kind": "mesh", "file": "{}")", block)},
      {"VerifiedMesh", fmt::format(R"("kind": "mesh", "file": "{}", "verify": true)", block)},
      {"Volume", fmt::format(R"("kind": "volume", "file": "{}", "iso": 0, "inside": "below")", ball)},
      {"Implicit",
       R"("kind": "implicit", "expression": "x^2+y^2+(z+0.05)^2-0.0025", "box": {"min": [-0.06, -0.06, -0.11], "max": [0.06, 0.06, 0.01]})",
       false},
      {"Nurbs",
       fmt::format(R"("kind": "nurbs", "patches": [{}])", test::plate_patch({-0.05, -0.05}, {0.05, 0.05}, 0).dump()),
       true, false},
  };
}

/// Moves a tool along straight lines with small steps, and sums the work of the force on the hand.
class Tracer {
 public:
  static constexpr double kStep = 2e-6;  // [m]
  Tracer(Alone& object, const Vec3& start) : object_(object), place_(start) {
    last_ = object_.answer({.position = start, .dt = kRaisedTick});
  }
  void to(const Vec3& end) {
    const Vec3 start = place_;
    const auto steps = static_cast<int>(std::ceil(norm_of(end - start) / kStep));
    for (int i = 1; i <= steps; ++i) {
      const Vec3 next = start + static_cast<double>(i) / steps * (end - start);
      const Contact contact = object_.answer({.position = next, .dt = kRaisedTick});
      work += 0.5 * (last_.force + contact.force).dot(next - place_);
      largest_jump = std::max(largest_jump, norm_of(contact.force - last_.force));
      if (contact.touched() && !last_.touched()) began = next;
      last_ = contact;
      place_ = next;
    }
  }
  [[nodiscard]] const Contact& last() const { return last_; }

  double work = 0, largest_jump = 0;
  Vec3 began = nan3();  ///< where the last contact began

 private:
  Alone& object_;
  Vec3 place_;
  Contact last_;
};

class RaisedSurfaces : public testing::TestWithParam<RaisedCase> {};

TEST_P(RaisedSurfaces, AreFeltFromTheirCrestsOnAndNotInTheirValleys) {
  for (const double radius : {0.0, 2e-3}) {
    if (radius > 0 && !GetParam().takes_ball) continue;
    const std::string tool = fmt::format(R"("tool": {{"radius": {}}}, )", radius);
    const auto scene = read_scene(
        parse_json("{" + tool + R"("objects": [{)" + GetParam().shape + ", " + wavy() + "}]}", "test"), "test");
    scene->prepare({});
    for (const double x : {0.0, 0.004}) {
      scene->reset();
      double began = kNaN;
      (void)scene->answer({.position = Vec3(x, 0, 3e-3 + radius)});
      for (double z = 3e-3; z > -3e-3 && std::isnan(began); z -= 1e-6) {
        const SceneAnswer answer = scene->answer({.position = Vec3(x, 0, z + radius), .dt = kRaisedTick});
        if (answer.force.z() > 0) began = z;
      }
      // The torus's own surface is 0.4 mm below the origin at x = 4 mm, the others' less.
      const double drop = x == 0 ? 0 : 4.5e-4;
      EXPECT_LT(began, (x == 0 ? kCrest : -kCrest) + 3e-6) << x << ' ' << radius;
      EXPECT_GT(began, (x == 0 ? kCrest : -kCrest) - drop - 3e-6) << x << ' ' << radius;
    }
  }
}

TEST_P(RaisedSurfaces, TakeAndGiveNoWorkInAClosedStrokeThroughThem) {
  Alone object("{" + GetParam().shape + ", " + wavy() + "}");
  for (const bool back : {false, true}) {
    Tracer tracer(object, {0, 0, 2e-3});
    const Vec3 first(0, 0, -2e-3), second(4e-3, 0, -2e-3), third(4e-3, 0, 2e-3);
    for (const Vec3& corner : back ? std::array{third, second, first} : std::array{first, second, third})
      tracer.to(corner);
    tracer.to({0, 0, 2e-3});
    // It was k A^2 / 2 = 62.5 uJ.
    EXPECT_LT(std::abs(tracer.work), 0.02 * 0.5 * kRaisedStiffness * kCrest * kCrest);
    EXPECT_LT(tracer.largest_jump, 4 * kRaisedStiffness * Tracer::kStep) << "the force is continuous";
    EXPECT_FALSE(tracer.last().touched());
  }
}

TEST_P(RaisedSurfaces, PushOutSoftlyOnlyAToolThatBeginsBehindThem) {
  const auto scene = test::scene_with("{" + GetParam().shape + ", " + wavy() + "}");
  scene->prepare({});
  const Touch crest{.position = Vec3(0, 0, 2e-4), .dt = kRaisedTick},
      valley{.position = Vec3(4e-3, 0, -4e-4), .dt = kRaisedTick};
  SceneAnswer answer = scene->answer(crest);
  ASSERT_EQ(answer.contacts.size(), 1U);
  EXPECT_TRUE(answer.contacts[0].touched() && answer.contacts[0].pushed_out) << "in front of the shape, on a crest";
  EXPECT_EQ(answer.force, Vec3::Zero());
  for (int i = 0; i < 600; ++i) answer = scene->answer(crest);
  EXPECT_NEAR(answer.force.z(), kRaisedStiffness * 3e-4, 1e-7) << "whole after half a second";

  scene->reset();
  answer = scene->answer(valley);
  EXPECT_FALSE(answer.contacts[0].touched() || answer.contacts[0].pushed_out) << "behind the shape, in a valley";
  if (!GetParam().closed) return;
  answer = scene->answer({.position = Vec3(4e-3, 0, -2e-3), .dt = kRaisedTick});
  EXPECT_FALSE(answer.contacts[0].pushed_out);
  EXPECT_GT(answer.force.z(), kRaisedStiffness * 1e-3) << "pressed in from there, it is whole at once";
}

INSTANTIATE_TEST_SUITE_P(All, RaisedSurfaces, testing::ValuesIn(raised_cases()),
                         [](const auto& one) { return one.param.name; });

class StickySurfaces : public testing::TestWithParam<RaisedCase> {};

TEST_P(StickySurfaces, HoldAToolThatLeavesAsFarAsTheirAdhesionReachesAndNoOther) {
  for (const double radius : {0.0, 2e-3}) {
    if (radius > 0 && !GetParam().takes_ball) continue;
    const auto scene =
        read_scene(parse_json(fmt::format(R"({{"tool": {{"radius": {}}}, "objects": [{{{}, "stiffness": 500,
                                   "adhesion": {{"force": 1, "stiffness": 500}}}}]}})",
                                          radius, GetParam().shape),
                              "test"),
                   "test");
    scene->prepare({});
    double z = 5e-3;
    const auto force_at = [&](double end) {
      SceneAnswer answer;
      for (int i = 1; i <= 50; ++i)
        answer = scene->answer({.position = Vec3(0, 0, radius + z + i * (end - z) / 50), .dt = kRaisedTick});
      z = end;
      return answer.force.z();
    };
    EXPECT_EQ(force_at(1e-3), 0) << "a tool that comes is not pulled";
    EXPECT_NEAR(force_at(-1e-3), 0.5, 1e-6);
    EXPECT_NEAR(force_at(1e-3), -0.5, 1e-6);
    EXPECT_NEAR(force_at(1.9e-3), -0.95, 1e-6);
    EXPECT_NEAR(force_at(-0.5e-3), 0.25, 1e-6) << "pressed again";
    EXPECT_NEAR(force_at(1.5e-3), -0.75, 1e-6);
    EXPECT_EQ(force_at(2.5e-3), 0) << "let go";
    EXPECT_EQ(force_at(1e-3), 0) << "and not taken again without a touch";
  }
}

INSTANTIATE_TEST_SUITE_P(All, StickySurfaces, testing::ValuesIn(raised_cases()),
                         [](const auto& one) { return one.param.name; });

TEST(RaisedSurface, IsFoundThroughTheBoxesOfAScene) {
  const auto scene = read_scene(
      parse_json(R"({"objects": [{"kind": "box", "centre": [0, 0, -0.02], "size": [0.1, 0.1, 0.04], )" + wavy() +
                     R"(}, {"kind": "sphere", "centre": [0, 0, 1], "radius": 0.01, "stiffness": 100}]})",
                 "test"),
      "test");
  scene->prepare({});
  (void)scene->answer({.position = Vec3(0, 0, 1e-3)});
  EXPECT_NEAR(scene->answer({.position = Vec3(0, 0, 3e-4), .dt = kRaisedTick}).force.z(), kRaisedStiffness * 2e-4,
              1e-12);
}

TEST(RaisedSurface, StatesItsHeightToAPredictionBeforeItIsTouched) {
  for (const char* shape : {R"("kind": "wall", "point": 0, "normal": [0, 0, 1])",
                            R"("kind": "box", "centre": [0, 0, -0.02], "size": [0.1, 0.1, 0.04])"}) {
    const auto scene = test::scene_with(std::string("{") + shape + ", " + wavy() + "}");
    scene->prepare({.ahead = 0.01});
    EXPECT_NEAR(scene->answer({.position = Vec3(0, 0, 4e-3)}).contacts[0].depth, -3.5e-3, 1e-12);
    EXPECT_NEAR(scene->answer({.position = Vec3(4e-3, 0, 4e-3)}).contacts[0].depth, -4.5e-3, 1e-12);
  }
}

TEST(RaisedSurface, HoldsByAdhesionFromItsOwnHeightOn) {
  Alone wall(wavy_wall(R"("adhesion": {"force": 0.1, "stiffness": 200},)"));
  const auto force_at = [&](double z) { return wall.answer({.position = Vec3(0, 0, z), .dt = kRaisedTick}).force.z(); };
  EXPECT_EQ(force_at(kCrest + 1e-4), 0) << "it does not catch a tool on its way in";
  EXPECT_NEAR(force_at(kCrest - 1e-4), 0.05, 1e-12);
  EXPECT_NEAR(force_at(kCrest + 1e-4), -0.02, 1e-12);
  EXPECT_NEAR(force_at(kCrest + 4.9e-4), -0.098, 1e-12);
  EXPECT_EQ(force_at(kCrest + 5.1e-4), 0) << "it lets go";
  EXPECT_EQ(force_at(kCrest + 1e-4), 0);
}

TEST(RaisedSurface, IsTheShapeItselfUnderTheBumpLaw) {
  Alone wall(wavy_wall("", "bump"));
  EXPECT_EQ(wall.answer({.position = Vec3(0, 0, 1e-4), .dt = kRaisedTick}).force, Vec3::Zero());
  EXPECT_NEAR(norm_of(wall.answer({.position = Vec3(4e-3, 0, -1e-4), .dt = kRaisedTick}).force), 0.05, 1e-12)
      << "the law turns the force and keeps its size";
}

TEST(RaisedSurface, DampsAndRubsOnlyWhereItIsTouched) {
  Alone wall(wavy_wall(R"("damping": 50, "friction": {"dynamic": 0.5},)"));
  const Contact valley = wall.answer({Vec3(4e-3, 0, -3e-4), Vec3(0.01, 0, -0.1), kRaisedTick});
  EXPECT_EQ(valley.force, Vec3::Zero());
  const Contact crest = wall.answer({Vec3(0, 0, 3e-4), Vec3(0, 0, -0.1), kRaisedTick});
  EXPECT_NEAR(crest.force.z(), kRaisedStiffness * 2e-4 + 5, 1e-9);
}

TEST(RaisedSurface, DeclaresItsVibrationToAToolThatSkipsFromCrestToCrest) {
  Alone wall(wavy_wall());
  for (const double x : {0.0, 4e-3}) {
    const Contact contact = wall.answer({Vec3(x, 0, 2e-4), Vec3(0.1, 0, 0), kRaisedTick});
    EXPECT_EQ(contact.touched(), x == 0);
    EXPECT_GE(contact.vibration, 0.5 * kRaisedStiffness * 3e-4) << "from 0 to k (d + A)";
    EXPECT_LT(contact.vibration, 4 * kRaisedStiffness * 3e-4);
  }
  EXPECT_EQ(wall.answer({Vec3(0, 0, 6e-4), Vec3(0.1, 0, 0), kRaisedTick}).vibration, 0) << "above every crest";
}

TEST(RaisedSurface, AllocatesNothingWhileItIsApproached) {
  for (const RaisedCase& one : raised_cases()) {
    Alone object("{" + one.shape + ", " + wavy() + "}");
    const std::size_t before = test::allocations();
    for (int i = 0; i < 2000; ++i)
      (void)object.answer(
          {.position = Vec3(5e-3 * std::sin(0.01 * i), 0, 1e-3 * std::cos(0.037 * i)), .dt = kRaisedTick});
    EXPECT_EQ(test::allocations(), before) << one.name;
  }
}

}  // namespace
}  // namespace haptrace
