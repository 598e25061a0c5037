// Objects that act on the tool without a penetration: adhesion and fields, in reports and in predictions; and notes.
#include "base/json_reader.h"
#include "control/norm.h"
#include "scene/scene_controller.h"
#include "scene/slow_scene.h"
#include "tests/scene/alone.h"
#include "tests/scene/volumes.h"

#include <cmath>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::Alone;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

constexpr double kActingTick = 1e-3;  // [s]

const std::string kSticky =
    R"({"kind": "wall", "point": 0, "normal": [0, 0, 1], "stiffness": 500, "adhesion": {"force": 1, "stiffness": 500}})";

std::shared_ptr<Scene> acting_scene(const std::string& object) {
  return test::scene_with(object);
}

/// A session with a scene: the places of the tool in, forces and events out.
class ActingSession {
 public:
  explicit ActingSession(const std::string& object) : controller_(make_scene_controller(acting_scene(object), 1000)) {
    controller_->start({.dt = 0});
  }
  /// Returns the command at a place.
  Command at(const Vec3& place, const Vec3& velocity = Vec3::Zero()) {
    State state;
    state.position = place;
    state.velocity = velocity;
    state.dt = kActingTick;
    const Command command = controller_->update(state);
    if (command.event) events.push_back(command.event->code);
    return command;
  }
  [[nodiscard]] TouchFigures figures() const { return controller_->figures()[0]; }

  std::vector<EventCode> events;

 private:
  std::unique_ptr<SceneController> controller_;
};

TEST(Touches, CountThePullOfAnAdhesionAndEndWithIt) {
  ActingSession session(kSticky);
  for (const double z : {1e-3, -1e-4}) (void)session.at({0, 0, z});
  for (int i = 0; i < 100; ++i) (void)session.at({0, 0, 1.9e-3});
  EXPECT_NEAR(session.figures().max_force, 0.95, 1e-12);
  EXPECT_NEAR(session.figures().max_depth, 1e-4, 1e-12);
  EXPECT_NEAR(session.figures().seconds, 0.101, 1e-9);
  EXPECT_THAT(session.events, testing::ElementsAre(EventCode::touched)) << "it has not left while it is pulled";
  for (int i = 0; i < 30; ++i) (void)session.at({0, 0, 2.1e-3});
  EXPECT_THAT(session.events, testing::ElementsAre(EventCode::touched, EventCode::left));
  EXPECT_EQ(session.figures().times, 1);
}

/// A field of drag in a cube of 40 mm.
std::string field_with(const std::string& field) {
  static const std::string file =
      test::volume_file("ramp.nrrd", test::volume_of([](const Vec3& p) { return 50 * p.z(); }, 41, 1e-3));  // -1 to 1
  return fmt::format(R"({{"kind": "volume", "file": "{}", "iso": 0, "field": {}}})", file, field);
}

TEST(Touches, CountADragWhileTheToolIsInItsField) {
  ActingSession session(field_with(R"({"drag": [[-1, 1], [1, 1]]})"));
  (void)session.at({0, 0, 0.05});
  for (int i = 0; i < 50; ++i) (void)session.at(Vec3::Zero(), Vec3(0.1, 0, 0));
  for (int i = 0; i < 50; ++i) (void)session.at(Vec3::Zero());
  EXPECT_THAT(session.events, testing::ElementsAre(EventCode::touched)) << "a rest in the field is no end of it";
  EXPECT_EQ(session.figures().times, 1);
  EXPECT_NEAR(session.figures().max_force, 0.1, 1e-9);
  EXPECT_NEAR(session.figures().seconds, 0.1, 1e-9);
}

TEST(FieldWithoutForceAtTheStart, IsNotGrownSoftlyNorReportedAsAStartInside) {
  // The energy is constant below the value 0, so below the middle.
  const std::string json = field_with(R"({"energy": [[0, 0], [0.5, 0.01]]})");
  Alone settled(json);
  const Touch inside{.position = Vec3(0, 0, 0.005), .dt = kActingTick};
  const Vec3 whole = settled.answer(inside).force;
  ASSERT_GT(norm_of(whole), 0.1);
  const auto scene = acting_scene(json);
  scene->prepare({});
  for (int i = 0; i < 100; ++i)
    ASSERT_EQ(scene->answer({.position = Vec3(0, 0, -0.005), .dt = kActingTick}).force, Vec3::Zero());
  const SceneAnswer answer = scene->answer(inside);
  EXPECT_EQ(answer.force, whole);
  EXPECT_FALSE(answer.contacts[0].pushed_out);
}

TEST(FieldWithForceAtTheStart, IsWholeAgainAfterItsForceWasZeroOnce) {
  const std::string json = field_with(R"({"energy": [[0, 0], [0.5, 0.01]]})");
  const auto scene = acting_scene(json);
  scene->prepare({});
  const Touch inside{.position = Vec3(0, 0, 0.005), .dt = kActingTick};
  EXPECT_TRUE(scene->answer(inside).contacts[0].pushed_out);
  (void)scene->answer({.position = Vec3(0, 0, -0.005), .dt = kActingTick});
  Alone settled(json);
  EXPECT_EQ(scene->answer(inside).force, settled.answer(inside).force);
}

/// Returns the forces of a slow scene on a tool that presses and leaves slowly, beside those of the scene itself.
std::pair<std::vector<double>, std::vector<double>> slow_and_true(Prediction prediction) {
  SlowScene slow(acting_scene(kSticky), {.rate_hz = 100, .prediction = prediction}, 1000);
  slow.reset();
  Alone exact(kSticky);
  std::pair<std::vector<double>, std::vector<double>> forces;
  for (int i = 0; i < 900; ++i) {
    // 5 mm/s: in from 0.5 mm above, and out to 3 mm above.
    const double z = 3e-6 + (i < 200 ? 5e-4 - 5e-6 * i : -5e-4 + 5e-6 * (i - 200));
    const Touch touch{.position = Vec3(0, 0, z), .velocity = Vec3(0, 0, i < 200 ? -5e-3 : 5e-3), .dt = kActingTick};
    forces.first.push_back(slow.answer(touch).force.z());
    slow.between_ticks(true);
    forces.second.push_back(exact.answer(touch).force.z());
  }
  return forces;
}

TEST(PredictionByAPlane, KnowsTheAdhesionOfTheSurface) {
  const auto [slow, exact] = slow_and_true(Prediction::model);
  EXPECT_NEAR(*std::min_element(slow.begin(), slow.end()), -1, 0.01);
  for (std::size_t i = 0; i < slow.size(); ++i) EXPECT_NEAR(slow[i], exact[i], 1e-9) << i;
}

TEST(PredictionByALine, HoldsThePullOfAnAdhesion) {
  const auto [slow, exact] = slow_and_true(Prediction::linear);
  EXPECT_NEAR(*std::min_element(slow.begin(), slow.end()), -1, 0.05);
}

TEST(Predictions, SayWhatTheyLeaveOut) {
  const auto notes = [](const std::string& surface, Prediction prediction) {
    const auto scene =
        acting_scene(R"({"kind": "wall", "point": 0, "normal": [0, 0, 1], "stiffness": 500, )" + surface + "}");
    return testing::PrintToString(notes_on_prediction(*scene, prediction));
  };
  const std::string friction = R"("friction": {"dynamic": 0.5})", adhesion = R"("adhesion": {"force": 1})";
  const std::string texture = R"("texture": {"kind": "perlin", "amplitude": 1e-4, "wavelength": 2e-3})";
  EXPECT_THAT(notes(friction, Prediction::model), AllOf(HasSubstr("'model' holds the friction"), HasSubstr("'wall'")));
  EXPECT_THAT(notes(texture, Prediction::model), HasSubstr("does not know a texture's waves"));
  EXPECT_EQ(notes(adhesion, Prediction::model), "{}");
  EXPECT_THAT(notes(adhesion, Prediction::linear), HasSubstr("'linear' holds the pull"));
  EXPECT_EQ(notes(friction, Prediction::hold), "{}");
}

TEST(Notes, SayThatShadingAndTheBumpLawCanDriveTheHandAndWhereShadingHasNoEffect) {
  const test::TempFolder folder;
  const std::string mesh = folder.write(
      "pyramid.obj",
      "v 0 0 .02\nv .02 0 0\nv 0 .02 0\nv -.02 0 0\nv 0 -.02 0\nf 1 2 3\nf 1 3 4\nf 1 4 5\nf 1 5 2\nf 5 4 3 2\n");
  const auto notes = [](const std::string& tool, const std::string& object) {
    const auto scene = read_scene(parse_json("{" + tool + R"("objects": [{)" + object + "}]}", "test"), "test");
    scene->prepare({});
    return testing::PrintToString(scene->notes());
  };
  const std::string shaded = fmt::format(R"("kind": "mesh", "file": "{}", "stiffness": 500, "shading": true)", mesh);
  EXPECT_THAT(notes("", shaded), HasSubstr("`shading` can drive the hand"));
  EXPECT_THAT(notes(R"("tool": {"radius": 0.001}, )", shaded), HasSubstr("no effect on a tool with a radius"));
  EXPECT_THAT(notes("", R"("kind": "sphere", "radius": 0.02, "stiffness": 500, "shading": true)"),
              HasSubstr("no effect on the kind 'sphere'"));
  EXPECT_THAT(notes("", R"("kind": "sphere", "radius": 0.02, "stiffness": 500)"), Not(HasSubstr("shading")));
  const std::string texture =
      R"("kind": "sphere", "radius": 0.02, "stiffness": 500, "texture": {"kind": "perlin", "amplitude": 1e-4, "wavelength": 4e-3)";
  EXPECT_THAT(notes("", texture + R"(, "law": "bump"})"), HasSubstr("'bump' of the texture can drive the hand"));
  EXPECT_THAT(notes("", texture + "}"), Not(HasSubstr("drive the hand")));
}

}  // namespace
}  // namespace haptrace
