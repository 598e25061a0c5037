// Scene files, scenes, and sessions in which a hand touches a scene.
#include "scene/scene.h"

#include "base/json_reader.h"
#include "formats/recording/recording.h"
#include "player/record.h"
#include "player/record_controllers.h"
#include "scene/knob.h"
#include "scene/scene_controller.h"
#include "scene/scene_file.h"
#include "scene/scene_files.h"
#include "scene/touch.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"
#include "tests/support/point_mass.h"
#include "tests/support/temp_folder.h"

#include <algorithm>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::error_of;
using test::Log;
using test::PointMass;
using test::TempFolder;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const std::string kBall = R"({"kind": "sphere", "name": "ball", "radius": 0.03, "stiffness": 800})";
const std::string kFloor = R"({"kind": "wall", "name": "floor", "point": [0, 0, -0.02], "normal": [0, 0, 2],
                               "stiffness": 1000})";

std::shared_ptr<Scene> scene_of(const std::string& objects, const std::string& more = "") {
  return read_scene(parse_json(R"({"objects": [)" + objects + "]" + more + "}", "my.json"), "my.json");
}

TEST(SceneFile, ReadsTheSamples) {
  const std::string folder = std::string(HAPTRACE_SAMPLES) + "/scenes/";
  EXPECT_THAT(load_scene(folder + "sphere.json")->names(), ElementsAre("ball"));
  EXPECT_THAT(load_scene(folder + "wall.json")->names(), ElementsAre("floor"));
  const auto both = load_scene(folder + "sphere_on_wall.json");
  EXPECT_THAT(both->names(), ElementsAre("ball", "floor"));
  EXPECT_FALSE(both->options().passivity);
}

TEST(SceneFile, NamesTheErrorAndItsPlace) {
  const auto error = [](const std::string& object) { return error_of([&] { scene_of(object); }); };
  EXPECT_THAT(error(R"({"kind": "spere"})"), HasSubstr("my.json: objects[0].kind: 'spere' is not known; did you mean "
                                                       "'sphere'?"));
  EXPECT_THAT(error(R"({"kind": "cube"})"), HasSubstr("known: box, cone"));
  EXPECT_THAT(error(R"({"radius": 1})"), HasSubstr("'kind' is missing"));
  EXPECT_THAT(error(kFloor + R"(, {"kind": "sphere", "radius": 0.03})"),
              HasSubstr("my.json: objects[1]: 'stiffness' is missing"));
  EXPECT_THAT(error(R"({"kind": "sphere", "radius": 0.03, "stiffness": 1e10})"),
              AllOf(HasSubstr("objects[0].stiffness"), HasSubstr("the maximum is 1000000000")));
  EXPECT_THAT(error(R"({"kind": "sphere", "radius": 0, "stiffness": 1})"), HasSubstr("objects[0].radius"));
  EXPECT_THAT(error(R"({"kind": "sphere", "radius": 0.03, "stiffness": 1, "renew": 0.04})"),
              HasSubstr("objects[0].renew"));
  EXPECT_THAT(error(R"({"kind": "sphere", "radius": 0.03, "stiffness": 1, "center": [0, 0, 0]})"),
              AllOf(HasSubstr("'center'"), HasSubstr("did you mean 'centre'?")));
  EXPECT_THAT(error(R"({"kind": "wall", "point": [0, 0, 0], "normal": [0, 0, 0], "stiffness": 1})"),
              HasSubstr("objects[0].normal: the vector has no direction"));
  EXPECT_EQ(scene_of(R"({"kind": "wall", "point": 0, "normal": [1e6, 1e6, 1e6], "stiffness": 1})")->size(), 1U);
  EXPECT_THAT(error(R"({"kind": "wall", "name": "", "point": 0, "normal": [0, 0, 1], "stiffness": 1})"),
              HasSubstr("objects[0].name"));
  EXPECT_THAT(error(kBall + "," + kBall), AllOf(HasSubstr("my.json: two objects"), HasSubstr("'ball'")));
  EXPECT_THAT(error(""), HasSubstr("my.json: the scene has no objects"));
  EXPECT_THAT(error_of([] { read_scene(parse_json("{}", "a.json"), "a.json"); }), HasSubstr("'objects' is missing"));
  EXPECT_THAT(error_of([] { scene_of(kBall, R"(, "pasivity": true)"); }), HasSubstr("did you mean 'passivity'?"));
  EXPECT_TRUE(scene_of(kBall, R"(, "passivity": true)")->options().passivity);
  EXPECT_THAT(error_of([] { load_scene("/nowhere/scene.json"); }), HasSubstr("/nowhere/scene.json"));
}

TEST(Scene, AddsTheAnswersOfItsObjects) {
  const auto both = scene_of(kBall + "," + kFloor), ball = scene_of(kBall), floor = scene_of(kFloor);
  for (const auto& scene : {both, ball, floor}) {
    scene->prepare({});
    (void)scene->answer({.position = Vec3(0, 0, 1)});
  }
  const Touch touch{.position = Vec3(0.001, 0.002, -0.025)};
  const SceneAnswer sum = both->answer(touch), a = ball->answer(touch), b = floor->answer(touch);
  EXPECT_EQ(sum.force, a.force + b.force);
  EXPECT_EQ(sum.stored, a.contacts[0].stored + b.contacts[0].stored);
  EXPECT_GT(sum.stored, b.contacts[0].stored);
  ASSERT_EQ(sum.contacts.size(), 2U);
  EXPECT_TRUE(sum.contacts[0].touched() && sum.contacts[1].touched());
  EXPECT_NEAR(sum.contacts[1].depth, 0.005, 1e-15);
}

TEST(Scene, HasTheSettingsOfItsObjectsByTheirNames) {
  const auto scene = scene_of(kBall + "," + kFloor);
  scene->set("ball.renew", 0.002);
  scene->set("floor.lead", 0.5);
  std::map<std::string, double> levels;
  for (const Knob& knob : scene->knobs()) levels[knob.name] = knob.level;
  EXPECT_EQ(levels, (std::map<std::string, double>{{"ball.lead", 0}, {"ball.renew", 0.002}, {"floor.lead", 0.5}}));
}

TEST(SceneFile, TakesEverySettingOfItsObjectsAsAKey) {
  for (const char* const file : {"relief", "sphere_on_wall", "textures", "drum"}) {
    const std::string path = fmt::format("{}/scenes/{}.json", HAPTRACE_SAMPLES, file);
    const nlohmann::json json = load_json(path);
    const auto scene = load_scene(path);
    for (std::size_t i = 0; i < scene->size(); ++i)
      for (const Knob& knob : scene->object(i).knobs())
        for (const double level : knob.levels) {
          bool taken = false;
          for (const char* const part : {"", "/shape", "/surface", "/surface/texture"})
            for (const nlohmann::json& value : {nlohmann::json(level), nlohmann::json(level != 0)}) {
              nlohmann::json changed = json;
              nlohmann::json& object = changed["objects"][i];
              const nlohmann::json::json_pointer at(part);
              if (taken || !object.contains(at)) continue;
              object[at][knob.name] = value;
              SceneFiles files(std::string(HAPTRACE_SAMPLES) + "/scenes");
              try {
                const std::vector<Knob> now = read_scene(changed, "scene", files)->object(i).knobs();
                taken = std::any_of(now.begin(), now.end(),
                                    [&](const Knob& other) { return other.name == knob.name && other.level == level; });
              } catch (const Error&) {
              }
            }
          EXPECT_TRUE(taken) << file << ": " << scene->object(i).name() << "." << knob.name << " " << level;
        }
  }
}

TEST(Scene, KnowsTheObjectsThatAreOutOfReach) {
  const auto scene =
      scene_of(kFloor + R"(, {"kind": "sphere", "name": "far", "centre": [1, 0, 0], "radius": 0.03, "stiffness": 1})");
  EXPECT_THAT(scene->out_of({Vec3::Constant(-0.1), Vec3::Constant(0.1)}), ElementsAre("far"));
  EXPECT_THAT(scene->out_of({Vec3::Constant(-2), Vec3::Constant(2)}), IsEmpty());
}

State state_at(const Vec3& position, int tick) {
  State state;
  state.position = position;
  state.time_ns = tick * 1'000'000;
  state.dt = tick == 0 ? 0 : 1e-3;
  return state;
}

TEST(SceneController, ReportsEveryTouchOnceAndItsLastingEnd) {
  const auto controller = make_scene_controller(scene_of(kBall + "," + kFloor), 1000);
  std::vector<std::pair<int, Event>> events;
  int tick = 0;
  const auto stay = [&](const Vec3& position, int ticks) {
    for (int i = 0; i < ticks; ++i, ++tick) {
      if (tick == 0) controller->start(state_at(position, 0));
      const std::size_t before = test::allocations();
      const Command command = controller->update(state_at(position, tick));
      ASSERT_EQ(test::allocations(), before);
      if (command.event) events.emplace_back(tick, *command.event);
    }
  };
  const Vec3 out(0, 0, 0.05), in(0, 0, 0.028), in_both(0, 0, -0.025);
  stay(out, 10);
  stay(in, 10);
  stay(out, 10);  // a bounce
  stay(in, 10);
  stay(out, 30);
  stay(in_both, 1);
  stay(out, 30);
  ASSERT_EQ(events.size(), 6U);
  const auto expect = [&](std::size_t i, int when, EventCode code, double object) {
    EXPECT_EQ(events[i].first, when);
    EXPECT_EQ(events[i].second.code, code);
    EXPECT_EQ(events[i].second.values[0], object);
  };
  expect(0, 10, EventCode::touched, 0);
  EXPECT_NEAR(events[0].second.values[1], 800 * 0.002, 1e-9);
  expect(1, 59, EventCode::left, 0);
  EXPECT_NEAR(events[1].second.values[1], 0.002, 1e-12);
  EXPECT_NEAR(events[1].second.values[2], 0.02, 1e-9);
  expect(2, 70, EventCode::touched, 0);
  expect(3, 71, EventCode::touched, 1);  // one event per tick
  expect(4, 90, EventCode::left, 0);
  expect(5, 91, EventCode::left, 1);
  const auto figures = controller->figures();
  EXPECT_EQ(figures[0].times, 2);
  EXPECT_NEAR(figures[0].seconds, 0.021, 1e-9);
  EXPECT_NEAR(figures[0].max_depth, 0.005, 1e-12);
  EXPECT_NEAR(figures[0].max_force, 4, 1e-9);
  EXPECT_EQ(figures[1].times, 1);
  EXPECT_EQ(describe(events[0].second), "object 1 touched: 1.60 N");
  EXPECT_EQ(describe(events[1].second), "object 1 left: 2.00 mm deep at most, 0.02 s");
}

TEST(TimedController, LosesNoEventToItsTrigger) {
  struct Talker final : Controller {
    int said = 0;
    Command update(const State&) noexcept override {
      Command command;
      if (++said <= 4) command.event = Event{.code = EventCode::mark, .values = {static_cast<double>(said), 0, 0}};
      return command;
    }
  } talker;
  TimedController timed(talker, 0.003, Trigger::parse("speed>0.1"));
  std::vector<double> heard;
  int ended = -1;
  for (int tick = 0; tick < 10; ++tick) {
    State state = state_at(Vec3::Zero(), tick);
    if (tick >= 2) state.velocity.x() = 0.2;
    const Command command = timed.update(state);
    if (command.event) heard.push_back(command.event->code == EventCode::triggered ? 0 : command.event->values[0]);
    if (ended < 0 && command.status == Command::Status::finished) ended = tick;
  }
  EXPECT_THAT(heard, ElementsAre(1, 2, 0, 3, 4));
  EXPECT_EQ(ended, 5) << "3 ms after the trigger";
}

TEST(RecordedScene, PushesTheToolOutAndReportsTheForceOnTheHand) {
  const TempFolder folder;
  PointMass device;
  device.place({0, 0, 0.0305});
  device.throw_at({0, 0, -0.2});
  RecordOptions options{.duration = 0.5};
  options.session.touch.scene = scene_of(kBall);
  options.session.recording = SessionOptions::Recording{.file = folder / "touched.h5"};
  options.session.loop.limits.soft_start = 0;
  const SessionResult result = record(device, options, StopRequest{});
  EXPECT_EQ(result.servo.cause, StopCause::finished);
  ASSERT_EQ(result.touches.size(), 1U);
  EXPECT_EQ(result.touches[0].name, "ball");
  EXPECT_EQ(result.touches[0].times, 1);
  EXPECT_NEAR(result.touches[0].max_force, 800 * result.touches[0].max_depth, 1e-9);
  EXPECT_GT(result.touches[0].max_depth, 0.003);
  EXPECT_EQ(to_json(result)["touches"][0]["object"], "ball");

  const RecordingReader reader(folder / "touched.h5");
  const auto rows = reader.read(0, reader.rows());
  EXPECT_GT(rows.back().position.z(), 0.03);
  for (const Sample& row : rows)
    EXPECT_NEAR(row.force.z(), row.phase == Phase::release ? 0 : 800 * std::max(0.0, 0.03 - row.position.z()), 1e-9);
  std::vector<int> codes;
  for (const StoredEvent& event : reader.events()) codes.push_back(event.code);
  EXPECT_THAT(codes, testing::IsSupersetOf({65, 66}));

  const auto contacts = reader.contacts(0, reader.contact_rows());
  ASSERT_FALSE(contacts.empty());
  std::size_t i = 0;
  for (const Sample& row : rows) {
    if (!(row.position.z() < 0.03)) continue;
    ASSERT_LT(i, contacts.size());
    EXPECT_EQ(contacts[i].tick, row.tick);
    EXPECT_EQ(contacts[i].time_ns, row.time_ns);
    EXPECT_NEAR(contacts[i].proxy.z(), 0.03, 1e-12);
    EXPECT_NEAR(contacts[i].depth, 0.03 - row.position.z(), 1e-12);
    EXPECT_NEAR(contacts[i].force.z(), 800 * contacts[i].depth, 1e-9);
    ++i;
  }
  EXPECT_EQ(i, contacts.size());
  EXPECT_EQ(reader.header().scene.objects, std::vector<std::string>{"ball"});
  EXPECT_NE(reader.header().scene.text.find("sphere"), std::string::npos);
  EXPECT_TRUE(check_recording(folder / "touched.h5").empty());
}

TEST(RecordedScene, PushesAToolThatBeginsInsideOutSoftlyAndWarns) {
  const TempFolder folder;
  PointMass device;
  device.place({0, 0, 0.02});
  RecordOptions options{.duration = 1.5};
  options.session.touch.scene = scene_of(kBall);
  options.session.recording = SessionOptions::Recording{.file = folder / "inside.h5"};
  options.session.loop.limits.soft_start = 0;
  const SessionResult result = record(device, options, StopRequest{});
  EXPECT_EQ(result.servo.cause, StopCause::finished);
  ASSERT_GE(result.warnings.size(), 1U);
  EXPECT_EQ(result.warnings[0].code, "began_inside");
  EXPECT_THAT(result.warnings[0].text, HasSubstr("began inside object 1, which pushes it out softly: 10.00 mm deep"));
  const RecordingReader reader(folder / "inside.h5");
  const auto rows = reader.read(0, reader.rows());
  EXPECT_EQ(rows.front().force, Vec3::Zero());
  EXPECT_GT(rows.back().position.z(), 0.03);
  Vec3 before = Vec3::Zero();
  for (const Sample& row : rows) {
    EXPECT_LE(row.force.z(), before.z() + 8 * 1e-3 / Object::kPushOut * 1.01);
    before = row.force;
  }
  const auto events = reader.events();
  EXPECT_TRUE(std::any_of(events.begin(), events.end(), [](const StoredEvent& event) { return event.code == 94; }));
}

TEST(RecordedScene, StopsAToolThatItMadeTooFast) {
  PointMass device;
  device.place({0, 0, 0.02});
  RecordOptions options{.duration = 0.5};
  options.session.touch.scene = scene_of(kBall);
  options.session.loop.limits.max_velocity = 0.1;
  EXPECT_EQ(record(device, options, StopRequest{}).servo.cause, StopCause::velocity);
  options.session.touch.scene = nullptr;
  EXPECT_EQ(record(device, options, StopRequest{}).servo.cause, StopCause::finished)
      << "without a scene no force is sent, and no speed is too fast";
}

TEST(RecordedScene, RejectsAnInvalidSceneRate) {
  EXPECT_THAT(error_of([] { make_scene_controller(scene_of(kBall), 0); }), HasSubstr("the rate of the scene"));
}

}  // namespace
}  // namespace haptrace
