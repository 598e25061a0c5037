// Laws of all objects that a hand can touch, then the special cases of each.
#include "base/json_reader.h"
#include "scene/scene_file.h"
#include "scene/shape/plane.h"
#include "scene/shape/sphere.h"
#include "tests/scene/alone.h"
#include "tests/scene/nurbs_patches.h"
#include "tests/scene/solid_cases.h"
#include "tests/scene/volumes.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"

#include <fmt/format.h>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

using test::Alone;
using test::error_of;
using test::scene_with;
using testing::AllOf;
using testing::HasSubstr;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kTick = 1e-3;  // [s]

/// An object with one changed accuracy setting, and independent knowledge of its surface.
struct ObjectCase {
  std::string name;
  std::string json;
  std::string knob;  ///< Name of the changed accuracy setting; empty: none.
  double level = 0;
  std::function<double(const Vec3&)> depth;
  Vec3 surface, normal;         ///< A point of the surface [m], and the normal there.
  double fine = 0, coarse = 0;  ///< Error of `depth` by interpolation, tricubic and trilinear [m].
};

void PrintTo(const ObjectCase& object, std::ostream* out) {
  *out << object.name << ' ' << object.knob << ' ' << object.level;
}

using Levels = std::vector<std::pair<std::string, std::vector<double>>>;

/// Returns the accuracy settings of an object and their levels. They are written down here because the names of the
/// tests need them: every process that runs one of the tests would have to load all objects to ask them.
Levels levels_of(const ObjectCase& object) {
  const std::string kind = nlohmann::json::parse(object.json).at("kind");
  Levels levels;
  if (kind == "implicit" || kind == "metaballs" || kind == "csg") levels = {{"steps", {1, 2, 4}}};
  if (kind == "nurbs") levels = {{"steps", {1, 2, 3}}, {"tessellation", {1e-3, 1e-4}}};
  if (kind == "sphere") levels = {{"renew", {0.03 / 5, 0.03 / 20, 0}}};
  if (kind == "volume") levels = {{"interpolation", {1, 3}}, {"steps", {1, 2, 3}}};
  levels.push_back({"lead", {0, 0.5}});
  return levels;
}

/// Returns every object with its defaults, and with every level of every accuracy setting.
std::vector<ObjectCase> every_object() {
  const auto ball = [](const Vec3& p) { return 0.03 - (p - Vec3(0.01, 0, -0.02)).norm(); };
  const auto slope = [](const Vec3& p) { return -Vec3(0.6, 0, 0.8).dot(p - Vec3(0, 0, 0.01)); };
  const std::string sphere = R"("kind": "sphere", "centre": [0.01, 0, -0.02], "radius": 0.03, "stiffness": 900)";
  const std::string wall = R"("kind": "wall", "point": [0, 0, 0.01], "normal": [3, 0, 4], "stiffness": 1200)";
  const std::string volume = fmt::format(
      R"("kind": "volume", "file": "{}", "iso": 0, "inside": "below", "stiffness": 900)", test::ball_volume());
  const Vec3 top(0.01, 0, 0.01), up(0, 0, 1), on(0, 0, 0.01), out(0.6, 0, 0.8);
  const auto nurbs = [](const nlohmann::json& patch, bool flip) {
    return test::nurbs_object({patch}, {{"flip", flip}, {"stiffness", 900}});
  };
  const auto inside = [](const test::Distance& distance) { return [=](const Vec3& p) { return -distance(p); }; };
  const std::vector<ObjectCase> objects{
      {"Box", R"({"kind": "box", "size": [0.2, 0.3, 0.2], "stiffness": 900})", "", 0,
       inside(test::box_distance({0.1, 0.15, 0.1})), Vec3(0.01, -0.02, 0.1), up},
      {"Cone", R"({"kind": "cone", "radius": 0.1, "height": 0.2, "stiffness": 900})", "", 0,
       inside(test::cone_distance(0.1, 0.2)), Vec3(0.05, 0, 0.1), Vec3(2, 0, 1).normalized()},
      {"Cylinder", R"({"kind": "cylinder", "radius": 0.1, "height": 0.3, "stiffness": 900})", "", 0,
       inside(test::cylinder_distance(0.1, 0.3)), Vec3(0, 0.1, 0.02), Vec3::UnitY()},
      {"Ellipsoid", R"({"kind": "ellipsoid", "radii": [0.08, 0.06, 0.1], "stiffness": 900})", "", 0,
       inside(test::ellipsoid_distance({0.08, 0.06, 0.1})), Vec3(0.08, 0, 0), Vec3::UnitX()},
      {"NurbsSphere", nurbs(test::sphere_patch(0.08), false), "", 0, [](const Vec3& p) { return 0.08 - p.norm(); },
       Vec3(0, 0.064, 0.048), Vec3(0, 0.8, 0.6)},
      {"NurbsBowl", nurbs(test::half_sphere_patch(0.08), true), "", 0, [](const Vec3& p) { return p.norm() - 0.08; },
       Vec3(0, 0, -0.08), up},
      {"DampedTorus", R"({"kind": "torus", "radius": 0.15, "tube": 0.06, "stiffness": 900, "damping": 5})", "", 0,
       inside(test::torus_distance(0.15, 0.06)), Vec3(0.09, 0, 0), -Vec3::UnitX()},
      {"Torus", R"({"kind": "torus", "radius": 0.15, "tube": 0.06, "stiffness": 900})", "", 0,
       inside(test::torus_distance(0.15, 0.06)), Vec3(0, 0.15, 0.06), up},
      {"Implicit",
       R"({"kind": "implicit", "expression": "(x/0.08)^2 + (y/0.06)^2 + (z/0.1)^2 - 1", "stiffness": 900,
           "box": {"min": -0.12, "max": [0.11, 0.12, 0.13]}})",
       "", 0, inside(test::ellipsoid_distance({0.08, 0.06, 0.1})), Vec3(0.08, 0, 0), Vec3::UnitX()},
      {"Metaballs",
       R"({"kind": "metaballs", "threshold": 0.125, "stiffness": 900,
           "balls": [{"centre": 0, "radius": 0.1}, {"centre": [0.5, 0, 0], "radius": 0.1}]})",
       "", 0, [](const Vec3& p) { return 0.1 * std::sqrt(0.5) - p.norm(); }, Vec3(0, 0.1 * std::sqrt(0.5), 0),
       Vec3::UnitY()},
      {"Csg",
       R"({"kind": "csg", "operation": "difference", "stiffness": 900,
           "parts": [{"kind": "box", "size": 0.3}, {"kind": "sphere", "centre": [0, 0, 0.15], "radius": 0.1}]})",
       "", 0, [](const Vec3& p) { return (p - Vec3(0, 0, 0.15)).norm() - 0.1; }, Vec3(0, 0, 0.05), up},
      {"Sphere", "{" + sphere + "}", "", 0, ball, top, up},
      {"DampedSphere", "{" + sphere + R"(, "damping": 5})", "", 0, ball, top, up},
      {"Wall", "{" + wall + "}", "", 0, slope, on, out},
      {"Volume", "{" + volume + "}", "", 0, inside([](const Vec3& p) { return p.norm() - 0.06; }), Vec3(0, 0.06, 0),
       Vec3::UnitY(), 1e-7, 4e-5},
      {"DampedVolume", "{" + volume + R"(, "damping": 5})", "", 0,
       inside([](const Vec3& p) { return p.norm() - 0.06; }), Vec3(0, 0.06, 0), Vec3::UnitY(), 1e-7, 4e-5},
      {"DampedWall", "{" + wall + R"(, "damping": 5})", "", 0, slope, on, out},
  };
  std::vector<ObjectCase> cases;
  for (const ObjectCase& object : objects) {
    cases.push_back(object);
    for (const auto& [knob, levels] : levels_of(object))
      for (const double level : levels) {
        cases.push_back(object);
        cases.back().knob = knob;
        cases.back().level = level;
      }
  }
  return cases;
}

class SceneObjectLaws : public testing::TestWithParam<ObjectCase> {
 protected:
  [[nodiscard]] static std::shared_ptr<Scene> made_of(const ObjectCase& object) {
    auto scene = scene_with(object.json);
    if (!object.knob.empty()) scene->set(scene->object(0).name() + "." + object.knob, object.level);
    scene->prepare({.rate_hz = 1 / kTick});
    come(*scene, object);
    return scene;
  }
  /// Brings the tool to a place outside the object.
  static void come(Scene& scene, const ObjectCase& object) {
    scene.reset();
    (void)scene.answer({.position = object.surface + 0.01 * object.normal});
  }
  [[nodiscard]] static std::shared_ptr<Scene> make() { return made_of(GetParam()); }
  static Contact ask(Scene& scene, const Touch& touch) { return scene.answer(touch).contacts[0]; }

  /// Returns the error of the known depth at a level [m].
  [[nodiscard]] static double unsure() {
    const bool trilinear = GetParam().knob == "interpolation" && GetParam().level < 2;
    return 1e-12 + (trilinear ? GetParam().coarse : GetParam().fine);
  }
  /// Returns the distance outside the object within which a coarser level may send a force [m]; see sphere.h.
  [[nodiscard]] static double slack() { return GetParam().knob == "renew" ? std::pow(GetParam().level, 2) / 0.03 : 0; }

  /// Returns the path of a hand that wanders around a point of the surface, in and out.
  [[nodiscard]] static std::vector<Touch> walk(unsigned seed, int ticks) {
    std::mt19937 random(seed);
    std::normal_distribution<double> push(0, 1);
    std::vector<Touch> touches;
    Touch touch{.position = GetParam().surface};
    for (int i = 0; i < ticks; ++i) {
      const Vec3 noise(push(random), push(random), push(random));
      touch.velocity += kTick * (8 * noise - 40 * (touch.position - GetParam().surface)) - 0.01 * touch.velocity;
      touch.position += kTick * touch.velocity;
      touches.push_back(touch);
      touch.dt = kTick;
    }
    return touches;
  }
};

TEST_P(SceneObjectLaws, PushesNoToolThatIsOutside) {
  const auto scene = make();
  int outside = 0, inside = 0;
  for (Touch touch : walk(1, 4000)) {
    touch.velocity.setZero();
    const Contact contact = ask(*scene, touch);
    const double depth = GetParam().depth(touch.position);
    if (depth < -slack() - unsure()) {
      ++outside;
      ASSERT_FALSE(contact.touched());
      ASSERT_EQ(contact.force, Vec3::Zero());
      ASSERT_EQ(contact.stored, 0);
    } else if (depth > unsure()) {
      ++inside;
      ASSERT_TRUE(contact.touched());
      ASSERT_GT(contact.force.norm(), 0);
    }
  }
  EXPECT_GT(outside, 500);
  EXPECT_GT(inside, 500);
}

TEST_P(SceneObjectLaws, PushesAlongItsNormalAndNeverPulls) {
  const auto scene = make();
  for (const Touch& touch : walk(2, 4000)) {
    const Contact contact = ask(*scene, touch);
    if (!contact.touched()) {
      ASSERT_EQ(contact.force, Vec3::Zero());
      continue;
    }
    ASSERT_NEAR(contact.normal.norm(), 1, 1e-12);
    const double along = contact.force.dot(contact.normal);
    ASSERT_GE(along, 0);
    ASSERT_LE((contact.force - along * contact.normal).norm(), 1e-12 * (1 + along));
    ASSERT_GE(along, contact.stiffness * std::max(0.0, contact.depth) * (1 - 1e-12));
  }
}

TEST_P(SceneObjectLaws, GivesNoEnergyToAHandThatMovesSlowlyRoundAClosedPath) {
  const auto scene = make();
  const ObjectCase& object = GetParam();
  const Vec3 across = object.normal.unitOrthogonal(), along = object.normal.cross(across);
  double given = 0, work = 0;
  Contact before;
  Vec3 last = Vec3::Zero();
  constexpr int kSteps = 40'000;
  for (int i = 0; i <= kSteps; ++i) {
    const double a = 2 * std::numbers::pi * i / kSteps;
    const Vec3 place =
        object.surface + 4e-3 * (std::cos(3 * a) * object.normal + 2 * std::sin(a) * across + std::sin(2 * a) * along);
    const Contact contact = ask(*scene, {place, i == 0 ? Vec3::Zero() : Vec3((place - last) / kTick), kTick});
    if (i > 0) {
      const double done = 0.5 * (before.force + contact.force).dot(place - last);
      given += done;
      work += std::abs(done);
    }
    before = contact;
    last = place;
  }
  EXPECT_GT(work, 5e-3) << "it was touched";
  EXPECT_LT(given, 1e-4 * work);
  const bool elastic = object.knob.empty() && object.json.find("damping") == std::string::npos;
  if (elastic) {
    EXPECT_GT(given, -1e-4 * work);
  }
}

TEST_P(SceneObjectLaws, StoresTheEnergyOfPressingIt) {
  const auto scene = make();
  double spent = 0;
  Contact contact, before;
  for (int i = -100; i <= 5000; ++i) {
    const Vec3 step = -1e-6 * GetParam().normal;
    contact = ask(*scene, {GetParam().surface + i * step, step, 1});
    spent -= 0.5 * (contact.force + before.force).dot(step);
    before = contact;
  }
  ASSERT_GT(contact.stored, 5e-3);
  EXPECT_NEAR(spent, contact.stored, 2e-3 * contact.stored);
}

TEST_P(SceneObjectLaws, AnswersWithoutAllocating) {
  const auto scene = make();
  const auto touches = walk(3, 1000);
  const std::size_t before = test::allocations();
  Vec3 sum = Vec3::Zero();
  for (const Touch& touch : touches) sum += scene->answer(touch).force;
  scene->reset();
  EXPECT_EQ(test::allocations(), before);
  EXPECT_GT(sum.norm(), 0);
}

TEST_P(SceneObjectLaws, TreatsAnInvalidStateAsNoContactAndForgetsIt) {
  const auto scene = make(), spared = make();
  const std::vector<Touch> nonsense{{.position = nan3()},
                                    {.velocity = Vec3(0, kNaN, 0)},
                                    {.position = Vec3(0, -kInfinity, 0)},
                                    {.velocity = Vec3::Constant(kInfinity)},
                                    {.position = Vec3::Constant(1e300)},
                                    {.velocity = Vec3::Constant(-1e308)}};
  for (const Touch& touch : walk(4, 1000)) {
    for (const Touch& none : nonsense) {
      const SceneAnswer answer = scene->answer(none);
      ASSERT_EQ(answer.force, Vec3::Zero());
      ASSERT_TRUE(answer.contacts.empty());
    }
    ASSERT_EQ(ask(*scene, touch).force, ask(*spared, touch).force);
  }
}

TEST_P(SceneObjectLaws, ForgetsItsContactsWhenItIsReset) {
  const auto scene = make();
  for (const Touch& touch : walk(5, 500)) (void)scene->answer(touch);
  come(*scene, GetParam());
  const auto fresh = make();
  for (const Touch& touch : walk(6, 500)) {
    const Contact a = ask(*scene, touch), b = ask(*fresh, touch);
    ASSERT_EQ(a.force, b.force);
    ASSERT_EQ(a.normal, b.normal);
    ASSERT_EQ(a.depth, b.depth);
  }
}

TEST_P(SceneObjectLaws, WorksAtTheEndsOfItsRange) {
  const ObjectCase& object = GetParam();
  for (const char* stiffness : {"0", "1e9"}) {
    ObjectCase extreme = object;
    nlohmann::json json = nlohmann::json::parse(object.json);
    json["stiffness"] = nlohmann::json::parse(stiffness);
    extreme.json = json.dump();
    const auto scene = made_of(extreme);
    for (const Touch& touch : walk(7, 500)) ASSERT_TRUE(is_finite(scene->answer(touch).force));
    for (const double far : {0.03, 0.06, 1.0, 1e3, 1e8}) {
      const SceneAnswer answer = scene->answer({object.surface - far * object.normal, Vec3::Zero(), kTick});
      ASSERT_TRUE(is_finite(answer.force));
      ASSERT_TRUE(std::isfinite(answer.stored));
    }
  }
}

/// Returns the rms force error relative to the object in continuous time [N], for a hand that presses and slides.
double error_of_level(ObjectCase object, const std::string& knob, double level) {
  auto exact = scene_with(object.json), held = scene_with(object.json);
  held->set(held->object(0).name() + "." + knob, level);
  for (Scene* scene : {exact.get(), held.get()}) {
    scene->prepare({.rate_hz = 1 / kTick});
    (void)scene->answer({.position = object.surface + 0.01 * object.normal});
  }
  const Vec3 across = object.normal.unitOrthogonal();
  const Vec3 velocity = -0.03 * object.normal + 0.1 * across;
  double sum = 0;
  int n = 0;
  for (int i = 0; i < 100; ++i) {
    const Vec3 place = object.surface - 5e-4 * object.normal + i * kTick * velocity;
    const Vec3 force = held->answer({place, velocity, kTick}).force;
    for (int j = 0; j < 20; ++j, ++n) {
      const Vec3 now = place + (j + 0.5) / 20 * kTick * velocity;
      sum += (exact->answer({now, Vec3::Zero(), kTick}).force - force).squaredNorm();
    }
  }
  return std::sqrt(sum / n);
}

/// Laws of undamped objects with their defaults: their error comes from the accuracy setting alone.
class SceneKnobLaws : public SceneObjectLaws {};

TEST_P(SceneKnobLaws, ErrsLessWithEveryMoreAccurateLevelOfASetting) {
  const ObjectCase& object = GetParam();
  const std::vector<Knob> knobs = scene_with(object.json)->object(0).knobs();
  ASSERT_FALSE(knobs.empty());
  for (const Knob& knob : knobs) {
    ASSERT_GE(knob.levels.size(), 2U);
    // The steps of a proxy err less than holding a force for a tick does: see implicit_test.cpp and volume_test.cpp.
    if (knob.name == "steps") continue;
    constexpr double share = 0.99;
    double before = kInfinity;
    for (const double level : knob.levels) {
      const double error = error_of_level(object, knob.name, level);
      EXPECT_LT(error, share * before) << knob.name << ' ' << level;
      before = error;
    }
  }
}

TEST_P(SceneObjectLaws, NamesItselfAndTheRangeWhenASettingIsOutOfRange) {
  const auto scene = make();
  const std::string& name = scene->object(0).name();
  for (const Knob& knob : scene->knobs()) {
    const std::string range = fmt::format("from {:g} to", knob.least);
    EXPECT_THAT(error_of([&] { scene->set(knob.name, -1); }), AllOf(HasSubstr(name + ": "), HasSubstr(range)));
    EXPECT_THAT(error_of([&] { scene->set(knob.name, kNaN); }), HasSubstr(range));
  }
  EXPECT_THAT(error_of([&] { scene->set(name + ".laed", 0); }), HasSubstr("did you mean 'lead'?"));
  EXPECT_THAT(error_of([&] { scene->set("nobody.lead", 0); }), HasSubstr(name + ".lead"));
}

/// Returns the objects whose settings change the force by more than holding it for a tick does. Those of NURBS do not:
/// nurbs_test.cpp measures them.
std::vector<ObjectCase> objects_with_knobs() {
  std::vector<ObjectCase> cases;
  for (const ObjectCase& object : every_object())
    if (object.knob.empty() && !object.name.starts_with("Damped") && !object.name.starts_with("Nurbs"))
      cases.push_back(object);
  return cases;
}

INSTANTIATE_TEST_SUITE_P(All, SceneObjectLaws, testing::ValuesIn(every_object()));
INSTANTIATE_TEST_SUITE_P(All, SceneKnobLaws, testing::ValuesIn(objects_with_knobs()));

TEST(SceneObjects, HaveTheLevelsThatTheLawsTry) {
  for (const ObjectCase& object : every_object()) {
    if (!object.knob.empty()) continue;
    Levels levels;
    for (const Knob& knob : scene_with(object.json)->object(0).knobs()) levels.emplace_back(knob.name, knob.levels);
    EXPECT_EQ(levels, levels_of(object)) << object.name;
  }
}

TEST(Sphere, PushesWithStiffnessTimesDepthAlongTheRadius) {
  Alone sphere(R"({"kind": "sphere", "centre": [0.01, 0, 0], "radius": 0.03, "stiffness": 700})");
  const Contact contact = sphere.answer({.position = Vec3(0.01, 0.025, 0)});
  EXPECT_LT((contact.force - Vec3(0, 700 * 0.005, 0)).norm(), 1e-12);
  EXPECT_NEAR(contact.depth, 0.005, 1e-15);
  EXPECT_NEAR(contact.stored, 0.5 * 700 * 0.005 * 0.005, 1e-15);
  const Contact outside = sphere.answer({.position = Vec3(0.01, 0, 0.05)});
  EXPECT_NEAR(outside.depth, -0.02, 1e-15) << "minus the distance";
  EXPECT_EQ(outside.normal, Vec3::UnitZ());
}

TEST(Sphere, KeepsItsDirectionInItsCentre) {
  Alone sphere(R"({"kind": "sphere", "radius": 0.03, "stiffness": 1000})");
  EXPECT_EQ(sphere.answer({}).force, Vec3(0, 0, 30)) << "the direction from which the tool came";
  (void)sphere.answer({.position = Vec3(0.01, 0, 0)});
  for (const double nothing : {0.0, 1e-13, 1e-160, 5e-324})
    EXPECT_LT((sphere.answer({.position = Vec3(0, nothing, 0)}).force - Vec3(30, 0, 0)).norm(), 1e-9) << nothing;
  EXPECT_LT((sphere.answer({.position = Vec3(0, -1e-3, 0)}).force - Vec3(0, -29, 0)).norm(), 1e-12);
  sphere.scene().reset();
  EXPECT_EQ(sphere.answer({}).normal, Vec3::UnitZ()) << "z, where there was nothing before";
}

TEST(Sphere, DampsMotionIntoItAndNotOutOfIt) {
  Alone sphere(R"({"kind": "sphere", "radius": 0.03, "stiffness": 100, "damping": 4})");
  const Vec3 inside(0, 0, 0.02);
  EXPECT_NEAR(sphere.answer({inside, Vec3(0.3, 0, -0.5)}).force.z(), 1 + 2, 1e-12);
  EXPECT_NEAR(sphere.answer({inside, Vec3(0.3, 0, 0.5)}).force.z(), 1, 1e-12);
}

TEST(Sphere, IsItsPlaneWithinTheStatedErrorUntilItIsRenewed) {
  constexpr double kRadius = 0.03, kRenew = 0.006;
  Alone coarse(R"({"kind": "sphere", "radius": 0.03, "stiffness": 1000, "renew": 0.006})");
  Alone exact(R"({"kind": "sphere", "radius": 0.03, "stiffness": 1000})");
  std::mt19937 random(1);
  std::uniform_real_distribution<double> side(-1, 1);
  double worst = 0, worst_angle = 0;
  for (int i = 0; i < 20'000; ++i) {
    coarse.reset();
    const double r = kRadius * (0.7 + 0.65 * side(random));
    (void)coarse.answer({.position = Vec3(0, 0, r)});
    const double e = std::min(kRenew, r / 2);
    const Vec3 place = Vec3(0, 0, r) + e * Vec3(side(random), side(random), side(random));
    const Contact plane = coarse.answer({.position = place}), truth = exact.answer({.position = place});
    const double share = (plane.depth - truth.depth) / (e * e / (2 * r));
    ASSERT_GE(share, -1e-9) << "never less deep";
    ASSERT_LE(share, 1 + 1e-9);
    const double angle = std::acos(std::min(1.0, plane.normal.dot(truth.normal))) / std::asin(e / r);
    ASSERT_LE(angle, 1 + 1e-9);
    worst = std::max(worst, share);
    worst_angle = std::max(worst_angle, angle);
  }
  EXPECT_GT(worst, 0.95) << "the bound is what happens";
  EXPECT_GT(worst_angle, 0.95);
}

TEST(Sphere, LosesEnergyWhenItsPlaneIsRenewedAndGainsNone) {
  Alone sphere(R"({"kind": "sphere", "radius": 0.03, "stiffness": 1000, "renew": 0.004})");
  double stored = 0, last_normal_z = 2;
  int renewed = 0;
  for (int i = 0; i < 3000; ++i) {
    const double a = 1e-3 * i;
    const Contact contact = sphere.answer({.position = 0.025 * Vec3(std::sin(a), 0, std::cos(a))});
    if (contact.normal.z() != last_normal_z && i > 0) {
      EXPECT_LT(contact.stored, stored);
      ++renewed;
    }
    stored = contact.stored;
    last_normal_z = contact.normal.z();
  }
  EXPECT_GT(renewed, 10);
}

std::string wall_of(double stiffness, double lead) {
  return fmt::format(R"({{"kind": "wall", "point": 0, "normal": [0, 0, 1], "stiffness": {}, "lead": {}}})", stiffness,
                     lead);
}

TEST(Lead, RemovesTheEnergyThatASampledSpringCreatesAsStated) {
  constexpr double kStiffness = 2000, kSpeed = 0.05, kStep = kSpeed * kTick;
  constexpr int kTicks = 100;
  for (const double lead : {0.0, 0.25, 0.5, 1.0}) {
    Alone wall(wall_of(kStiffness, lead));
    double given = 0;
    for (int i = -2; i < 2 * kTicks + 2; ++i) {
      const bool in = i < kTicks;
      const double z = -kStep * (in ? i : 2 * kTicks - i), v = in ? -kSpeed : kSpeed;
      given += wall.answer({Vec3(0, 0, z), Vec3(0, 0, v), kTick}).force.z() * v * kTick;
    }
    const double stated = kStiffness * kSpeed * kTick * (1 - 2 * lead) * kTicks * kStep;
    EXPECT_NEAR(given, stated, 1e-12) << lead;
  }
}

TEST(Lead, ErrsAsMuchAsStated) {
  constexpr double kStiffness = 1000, kSpeed = 0.1, kUnit = kStiffness * kSpeed * kTick;
  for (const double lead : {0.0, 0.25, 0.5, 1.0, 2.0}) {
    Alone wall(wall_of(kStiffness, lead));
    double most = 0, sum = 0;
    constexpr int kParts = 1000;
    const double held = wall.answer({Vec3(0, 0, -0.01), Vec3(0, 0, -kSpeed), kTick}).force.z();
    for (int j = 0; j < kParts; ++j) {
      const double error = held - kStiffness * (0.01 + kSpeed * kTick * (j + 0.5) / kParts);
      most = std::max(most, std::abs(error));
      sum += error * error;
    }
    EXPECT_LE(most, kUnit * std::max(lead, std::abs(1 - lead)));
    EXPECT_NEAR(std::sqrt(sum / kParts), kUnit * std::sqrt(1.0 / 12 + (lead - 0.5) * (lead - 0.5)), 1e-6 * kUnit);
  }
}

TEST(Plane, KnowsWhetherItIsInAWorkspace) {
  const Box box{Vec3::Constant(-0.1), Vec3::Constant(0.1)};
  const auto wall = [](const Vec3& point, const Vec3& normal) { return Plane({point, normal}); };
  EXPECT_TRUE(wall({0, 0, -0.05}, {0, 0, 1}).meets(box));
  EXPECT_FALSE(wall({0, 0, -0.11}, {0, 0, 1}).meets(box));
  EXPECT_TRUE(wall({0, 0, -0.11}, {0, 0, -1}).meets(box)) << "all of it is wall";
  EXPECT_TRUE(wall({0.05, 0.05, 0.05}, {-1, -1, -1}).meets(box));
  EXPECT_FALSE(wall({0.11, 0.11, 0.11}, {-1, -1, -1}).meets(box));
  const auto ball = [](const Vec3& centre) { return Sphere({.centre = centre, .radius = 0.05}); };
  EXPECT_TRUE(ball({0.14, 0, 0}).meets(box));
  EXPECT_FALSE(ball({0.14, 0.14, 0}).meets(box)) << "its box would";
}

}  // namespace
}  // namespace haptrace
