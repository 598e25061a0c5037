#include "formats/documents/programme.h"

#include "base/json_reader.h"
#include "formats/path/path_file.h"
#include "tests/formats/support.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

namespace haptrace {
namespace {

using nlohmann::json;

const char* const kCircle = R"({"kind": "circle", "size": 0.05, "duration": 2})";

/// Returns a programme of one exercise with these keys.
json programme_of(const std::string& keys) {
  return parse_json(fmt::format(R"({{"haptrace_programme": 1, "exercises": [{{{}}}]}})", keys), "p.json");
}

json circle_with(const std::string& keys) {
  return programme_of(fmt::format(R"("shape": {}, {})", kCircle, keys));
}

void expect_refused(const json& programme, std::initializer_list<std::string> parts) {
  expect_error([&] { (void)programme_from_json(programme, "p.json"); }, Error::Kind::input, parts);
}

TEST(Programme, ReadsEverySetting) {
  const Programme programme = programme_from_json(parse_json(R"({
      "haptrace_programme": 1, "title": "Two", "rounds": 3, "person": {"mirror": "x", "scale": 0.5},
      "limits": {"time": 600, "force_dose": 100, "fatigue": {"figure": "sparc", "worse": 0.1, "repetitions": 2}},
      "warm_up": [{"shape": {"kind": "line"}, "mode": "passive", "pace": 0.5}],
      "exercises": [
        {"name": "a", "path": "a.csv", "mode": "assisted", "repetitions": 7, "rest": 1, "rest_after": 9, "hold": 0.2,
         "pace": 2, "time_limit": 30, "radius": 0.004, "stiffness": 300, "assist_force": 1, "viscosity": 2,
         "force_scale": 0.5, "feel": "resist", "allow_back": true,
         "progression": {"figure": "movement_time_s", "target": 3, "tolerance": 1, "window": 4,
                         "assistance": {"start": 0.9, "forget": 0.7, "gain": 0.1},
                         "difficulty": {"start": 0.5, "step": 0.25, "pace": {"easy": 0.5, "hard": 2}}}},
        {"path": "a.csv", "mode": "free", "test": "after"}]})",
                                                             "p.json"),
                                                  "p.json");
  EXPECT_EQ(programme.title, "Two");
  EXPECT_EQ(programme.rounds, 3);
  EXPECT_EQ(programme.person.mirror, 0);
  EXPECT_EQ(programme.limits.fatigue->figure, "sparc");
  ASSERT_EQ(programme.size(), 3U);
  EXPECT_EQ(programme.exercise(0).mode, ExerciseMode::passive);
  EXPECT_EQ(programme.exercise(0).name, "warm-up 1");
  const Exercise& a = programme.exercise(1);
  EXPECT_EQ(a.mode, ExerciseMode::assisted);
  EXPECT_EQ(a.repetitions, 7);
  EXPECT_EQ(a.radius, 0.004);
  EXPECT_EQ(a.stiffness, 300);
  EXPECT_TRUE(a.resist_forces);
  EXPECT_TRUE(a.allow_back);
  EXPECT_EQ(a.progression->assistance->forget, 0.7);
  EXPECT_EQ(a.progression->difficulty->pace->hard, 2);
  EXPECT_EQ(programme.exercise(2).test, TestLabel::after);
  EXPECT_EQ(programme.exercise(2).name, "exercise 2");
}

TEST(Programme, ReadsTheBackWallAndTheForceOfAnExpert) {
  const auto exercise = [](const std::string& keys) {
    return programme_from_json(programme_of(R"("path": "a.h5", )" + keys), "p.json").exercise(0);
  };
  EXPECT_FALSE(exercise(R"("mode": "tunnel")").initiate);
  EXPECT_FALSE(exercise(R"("mode": "tunnel", "initiate": false)").initiate);
  EXPECT_EQ(exercise(R"("mode": "tunnel", "initiate": true)").initiate->wait, BackWallOptions{}.wait);
  const Exercise wall = exercise(R"("mode": "assisted", "initiate": {"wait": 3, "stiffness": 120, "force": 1.5})");
  EXPECT_EQ(wall.initiate->wait, 3);
  EXPECT_EQ(wall.initiate->stiffness, 120);
  EXPECT_EQ(wall.initiate->max_force, 1.5);
  EXPECT_FALSE(wall.expert.force);
  const Exercise task =
      exercise(R"("mode": "tunnel", "expert_force": "task", "expert_profile": "e.json", "negate_measured": true)");
  EXPECT_EQ(task.expert.force, ReplayedForce::task);
  EXPECT_EQ(task.expert.profile, "e.json");
  EXPECT_TRUE(task.expert.negated);
  expect_refused(circle_with(R"("mode": "cursor", "initiate": true)"), {"exercises[0].initiate", "assisted, tunnel"});
  expect_refused(circle_with(R"("mode": "tunnel", "initiate": {"wait": -1})"), {"initiate.wait: -1 is too small"});
  expect_refused(circle_with(R"("mode": "tunnel", "expert_force": "tsk")"), {"exercises[0].expert_force", "task"});
}

TEST(Programme, NamesThePathOfTheKeyThatIsWrong) {
  expect_refused(circle_with(R"("mode": "tunel")"), {"p.json: exercises[0].mode: 'tunel'", "tunnel"});
  expect_refused(circle_with(R"("mode": "tunnel", "radius": -1)"), {"p.json: exercises[0].radius: -1 is too small"});
  expect_refused(circle_with(R"("mode": "tunnel", "repetitions": 2.5)"), {"exercises[0].repetitions", "whole number"});
  expect_refused(circle_with(R"("mode": "tunnel", "raduis": 1)"), {"exercises[0]: key 'raduis'", "radius"});
  expect_refused(circle_with(R"("name": "a")"), {"p.json: exercises[0]: 'mode' is missing"});
  expect_refused(programme_of(R"("mode": "tunnel")"), {"exercises[0]: needs either a path (a file) or a shape"});
  expect_refused(circle_with(R"("mode": "tunnel", "path": "a.csv")"),
                 {"exercises[0]: needs either a path (a file) or a shape"});
  expect_refused(parse_json(R"({"exercises": []})", "p"), {"p.json: 'haptrace_programme' is missing"});
  expect_refused(parse_json(R"({"haptrace_programme": 1, "exercises": []})", "p"), {"at least one"});
  expect_refused(parse_json(R"({"haptrace_programme": 2, "exercises": []})", "p"),
                 {"haptrace_programme: 2 is too large"});
  expect_refused(parse_json(R"({"haptrace_programme": 1, "exercises": {"a": 1}})", "p"),
                 {"exercises: expected an array"});
  expect_refused(parse_json(R"({"haptrace_programme": 1, "exercises": [3]})", "p"),
                 {"exercises[0]: expected an object"});
  expect_refused(programme_of(R"("mode": "free", "shape": {"kind": "circle", "duration": 60, "turns": 100})"),
                 {"exercises[0].shape: 100 turns of 60 s are 6000 s; an exercise may last at most one hour"});
  expect_refused(programme_of(R"("name": "disc", "mode": "tunnel", "shape": {"kind": "disc"})"),
                 {"p.json: exercises[0].shape.kind: 'disc'", "circle"});
  expect_refused(programme_of(R"("mode": "free", "shape": {"kind": "circle", "centre": 0, "center": 0})"),
                 {"exercises[0].shape: centre and center are the same key; remove one of them"});
}

TEST(Programme, ReadsTheCentreOfAShapeInEitherSpelling) {
  for (const char* spelling : {"centre", "center"}) {
    const Programme programme = programme_from_json(
        programme_of(fmt::format(R"("mode": "free", "shape": {{"kind": "circle", "{}": [0.1, 0.2, 0.3]}})", spelling)),
        "p.json");
    const Vec3 middle = path_of(programme, programme.exercise(0), "").bounds().center();
    EXPECT_NEAR((middle - Vec3(0.1, 0.2, 0.3)).norm(), 0, 1e-4) << spelling;
  }
}

TEST(Programme, RefusesAKeyThatDoesNotApplyInItsMode) {
  expect_refused(
      circle_with(R"("mode": "passive", "radius": 0.01)"),
      {"exercises[0].radius: does not apply in mode passive; it applies in assisted, tunnel, cursor, resist, free"});
  expect_refused(circle_with(R"("mode": "tunnel", "pace": 1)"), {"exercises[0].pace", "passive, assisted, cursor"});
  expect_refused(circle_with(R"("mode": "tunnel", "test": "before")"), {"exercises[0].test", "mode free"});
  expect_refused(circle_with(R"("mode": "tunnel", "progression": {"target": 1, "assistance": {}})"),
                 {"exercises[0].progression.assistance", "assisted"});
  expect_refused(
      circle_with(R"("mode": "tunnel", "progression": {"target": 1, "difficulty": {"pace": {"easy": 1, "hard": 2}}})"),
      {"progression.difficulty.pace: does not apply in mode tunnel"});
  expect_refused(circle_with(R"("mode": "tunnel", "progression": {"target": 1})"), {"nothing adapts"});
  expect_refused(circle_with(R"("mode": "tunnel", "progression": {"target": 0, "difficulty": {}})"), {"target: 0"});
  expect_refused(circle_with(R"("mode": "tunnel", "progression": {"target": 1, "difficulty": {"step": 0.1}})"),
                 {"difficulty: nothing adapts; give radius, stiffness or pace"});
}

TEST(Programme, MirrorsAndScalesAPathForAParticipantAndMirrorsItsForcesOnly) {
  const TempFolder folder;
  Path path{.name = "a",
            .time = {0, 1},
            .position = {Vec3(1e-2, 2e-2, 3e-2), Vec3(2e-2, 2e-2, 3e-2)},
            .velocity = {Vec3(1, 2, 3), Vec3(1, 2, 3)},
            .force = {Vec3(1, 2, 3), Vec3(4, 5, 6)}};
  save_path(path, folder / "a.csv", "a", false);
  json programme = programme_of(R"("path": "a.csv", "mode": "tunnel", "mirror": "y", "scale": 2)");
  programme["person"] = {{"mirror", "x"}, {"scale", 0.25}};
  const Programme read = programme_from_json(programme, "p.json");
  const Path changed = path_of(read, read.exercise(0), folder.path());
  EXPECT_TRUE(changed.position[0].isApprox(0.5 * Vec3(-1e-2, -2e-2, 3e-2)));
  EXPECT_TRUE(changed.velocity[1].isApprox(0.5 * Vec3(-1, -2, 3)));
  EXPECT_TRUE(changed.force[1].isApprox(Vec3(-4, -5, 6)));
  EXPECT_EQ(changed.time, path.time);
}

TEST(Programme, PlacesAPathWithTheKeysOfPlayInTheirOrder) {
  const TempFolder folder;
  save_path({.name = "a",
             .time = {0, 1},
             .position = {Vec3(1, 2.03, 0), Vec3(1, 2.04, 0)},
             .force = {Vec3(0, 1, 0), Vec3(0, 1, 0)}},
            folder / "a.csv", "a", false);
  json programme = programme_of(
      R"("path": "a.csv", "mode": "tunnel", "frame": {"rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]], "translation": [1, 2, 0]},
         "rotate": "z=90deg", "about": "start", "offset": [0, 0.01, 0])");
  programme["person"] = {{"mirror", "x"}, {"about", {0.1, 0, 0}}};
  const Programme read = programme_from_json(programme, "p.json");
  const Path placed = path_of(read, read.exercise(0), folder.path());
  // The frame brings it to 0.03 and 0.04 along x. It turns about its start into y and moves; the person mirrors it.
  EXPECT_LT((placed.position[0] - Vec3(0.17, 0.01, 0)).norm(), 1e-12);
  EXPECT_LT((placed.position[1] - Vec3(0.17, 0.02, 0)).norm(), 1e-12);
  EXPECT_LT((placed.force[0] - Vec3(0, 1, 0)).norm(), 1e-12);
  for (const auto& [key, value] : {std::pair{"rotate", json("z=up")},
                                   {"about", json("end")},
                                   {"offset", json({0, 1})},
                                   {"frame", json{{"rotation", {2, 0, 0, 0}}}}}) {
    json wrong = programme;
    wrong["exercises"][0][key] = value;
    expect_error([&, &w = wrong] { (void)programme_from_json(w, "p.json"); }, Error::Kind::input,
                 {"exercises[0]", key});
  }
  programme["person"]["frame"] = {{"translation", {0, 0, 0}}};
  expect_error([&] { (void)programme_from_json(programme, "p.json"); }, Error::Kind::input, {"person", "frame"});
}

TEST(Programme, GoesFromEasyToHardByEqualFactors) {
  const DifficultyRange range{.easy = 0.01, .hard = 0.0025};
  EXPECT_DOUBLE_EQ(range.at(0), 0.01);
  EXPECT_DOUBLE_EQ(range.at(1), 0.0025);
  EXPECT_NEAR(range.at(0.5), 0.005, 1e-15);
}

}  // namespace
}  // namespace haptrace
