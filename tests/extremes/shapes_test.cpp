// Tests of objects that the hand touches, with extreme sizes, stiffnesses and steps of the tool.
#include "scene/scene.h"
#include "scene/scene_file.h"
#include "tests/extremes/support.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <random>

namespace haptrace {
namespace {

/// Returns solids of about this radius around the origin [m]. The axis x leaves all of them through a single surface.
std::vector<nlohmann::json> solids_of(double radius) {
  const double r = radius;
  return {{{"kind", "sphere"}, {"centre", {0, 0, 0}}, {"radius", r}},
          {{"kind", "box"}, {"centre", {0, 0, 0}}, {"size", {2 * r, 2 * r, 2 * r}}},
          {{"kind", "cylinder"}, {"centre", {0, 0, 0}}, {"radius", r}, {"height", 2 * r}},
          {{"kind", "cone"}, {"centre", {0, 0, -0.1 * r}}, {"radius", r}, {"height", 2 * r}},
          {{"kind", "torus"}, {"centre", {0, 0, 0}}, {"radius", 0.7 * r}, {"tube", 0.3 * r}},
          {{"kind", "ellipsoid"}, {"centre", {0, 0, 0}}, {"radii", {r, 0.8 * r, 0.5 * r}}},
          {{"kind", "wall"}, {"point", {r, 0, 0}}, {"normal", {1, 0, 0}}},
          {{"kind", "metaballs"}, {"balls", {{{"centre", {0, 0, 0}}, {"radius", 1.5 * r}, {"weight", 1}}}}},
          {{"kind", "csg"},
           {"operation", "intersection"},
           {"parts",
            {{{"kind", "sphere"}, {"centre", {0, 0, 0}}, {"radius", r}},
             {{"kind", "box"}, {"centre", {0, 0, 0}}, {"size", {3 * r, r, r}}}}}}};
}

std::shared_ptr<Scene> scene_of(nlohmann::json solid, double stiffness, double damping = 0) {
  solid["stiffness"] = stiffness;
  solid["damping"] = damping;
  std::shared_ptr<Scene> scene = read_scene({{"objects", {std::move(solid)}}}, "test");
  scene->prepare({.rate_hz = 1000});
  scene->reset();
  return scene;
}

/// Moves the tool to a place in one tick.
SceneAnswer move_to(Scene& scene, const Vec3& place, const Vec3& velocity = Vec3::Zero()) {
  return scene.answer({place, velocity, 1e-3});
}

TEST(Shapes, PushBackFromTenMicrometresToTenMetres) {
  for (const double radius : {1e-5, 1e-3, 1., 10.})
    for (const nlohmann::json& solid : solids_of(radius)) {
      SCOPED_TRACE(fmt::format("{} of {} m", solid["kind"].get<std::string>(), radius));
      const auto scene = scene_of(solid, 1000);
      EXPECT_EQ(move_to(*scene, Vec3(2 * radius, 0, 0)).force, Vec3::Zero());
      Vec3 force = Vec3::Zero();
      for (double x = 2; x >= 0.75; x -= 0.05) {
        force = move_to(*scene, Vec3(x * radius, 0, 0)).force;
        ASSERT_TRUE(is_finite(force)) << "at " << x << " radii";
        ASSERT_LE(force.norm(), 1000 * radius) << "at " << x << " radii";
      }
      EXPECT_GT(force.x(), 0.01 * 1000 * radius);
      EXPECT_EQ(move_to(*scene, Vec3(2 * radius, 0, 0)).force, Vec3::Zero());
    }
}

TEST(Shapes, PushNoHarderThanTheToolIsAwayWhateverItsSteps) {
  constexpr double kRadius = 0.03, kStiffness = 1000;
  for (const nlohmann::json& solid : solids_of(kRadius)) {
    SCOPED_TRACE(solid["kind"].get<std::string>());
    const auto scene = scene_of(solid, kStiffness);
    std::mt19937_64 random(7);
    std::uniform_real_distribution<double> direction(-1, 1), exponent(-300, 6);
    Vec3 tool(2 * kRadius, 0, 0);
    for (int i = 0; i < 20000; ++i) {
      const Vec3 towards(direction(random), direction(random), direction(random));
      // Every other step leads back to the solid, so that most steps begin or end in it.
      tool = i % 2 == 0 ? Vec3(kRadius * towards) : Vec3(tool + std::pow(10., exponent(random)) * towards);
      const Vec3 force = move_to(*scene, tool).force;
      ASSERT_TRUE(is_finite(force)) << "step " << i;
      // A solid that was passed in one step holds the tool back on the side where it entered.
      ASSERT_LE(force.norm(), kStiffness * (tool.norm() + 2 * kRadius)) << "step " << i << " at " << tool.transpose();
    }
  }
}

TEST(Shapes, WithstandAnyStiffnessDampingAndSpeed) {
  constexpr double kRadius = 0.03;
  for (const double stiffness : {1., 1e9})
    for (const double damping : {0., 1e5})
      for (const double speed : {-1e6, 1e6})
        for (const nlohmann::json& solid : solids_of(kRadius)) {
          SCOPED_TRACE(
              fmt::format("{}, {} N/m, {} N s/m, {} m/s", solid["kind"].get<std::string>(), stiffness, damping, speed));
          const auto scene = scene_of(solid, stiffness, damping);
          (void)move_to(*scene, Vec3(2 * kRadius, 0, 0));
          for (const double x : {0.95, 0.9, 0.8}) {
            const Vec3 force = move_to(*scene, Vec3(x * kRadius, 0, 0), Vec3(speed, 0, 0)).force;
            ASSERT_TRUE(is_finite(force));
            ASSERT_GE(force.x(), 0) << "it pulls";
          }
        }
}

}  // namespace
}  // namespace haptrace
