#include "formats/documents/programme.h"

#include "base/enum_names.h"
#include "base/error.h"
#include "base/json_reader.h"
#include "base/suggest.h"
#include "control/path/shapes.h"
#include "formats/documents/device_frame.h"
#include "formats/path/path_file.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <numbers>
#include <set>

namespace haptrace {
namespace {

constexpr EnumNames<ExerciseMode, 12> kModeNames{"mode",
                                                 {"passive", "assisted", "tunnel", "cursor", "resist", "free", "reach",
                                                  "range", "press", "track", "weigh", "sense"}};
constexpr EnumNames<TestLabel, 4> kTestNames{"test", {"none", "before", "after", "retention"}};
constexpr EnumNames<TrialOrder, 3> kOrderNames{"order", {"listed", "blocked", "interleaved"}};
const std::vector<std::string> kForceNames{"auto", "task", "measured", "sent"};
constexpr EnumNames<int, 2> kFeelNames{"feel", {"active", "resist"}};

constexpr EnumNames<ScreenPart, kScreenParts> kPartNames{"part of the screen",
                                                         {"tool", "path", "tunnel", "trail", "score"}};

using Modes = std::set<ExerciseMode>;
constexpr auto kPassive = ExerciseMode::passive, kAssisted = ExerciseMode::assisted, kTunnel = ExerciseMode::tunnel,
               kCursor = ExerciseMode::cursor, kResist = ExerciseMode::resist, kFree = ExerciseMode::free,
               kReach = ExerciseMode::reach, kRange = ExerciseMode::range, kPress = ExerciseMode::press,
               kTrack = ExerciseMode::track, kWeigh = ExerciseMode::weigh, kSense = ExerciseMode::sense;

/// Keys that have a meaning in some modes only. All other keys apply to all modes.
const std::vector<std::pair<std::string, Modes>>& keys_of_modes() {
  static const std::vector<std::pair<std::string, Modes>> keys{
      {"pace", {kPassive, kAssisted, kCursor}},
      {"time_limit", {kAssisted, kTunnel, kCursor, kResist, kFree, kReach, kRange, kPress, kTrack, kWeigh}},
      {"radius", {kAssisted, kTunnel, kCursor, kResist, kFree}},
      {"stiffness", {kAssisted, kTunnel, kCursor, kResist}},
      {"assist_force", {kAssisted}},
      {"resistance", {kResist}},
      {"viscosity", {kAssisted, kTunnel, kCursor, kResist}},
      {"force_scale", {kAssisted, kTunnel, kCursor, kResist}},
      {"expert_force", {kAssisted, kTunnel, kCursor, kResist}},
      {"expert_profile", {kAssisted, kTunnel, kCursor, kResist}},
      {"negate_measured", {kAssisted, kTunnel, kCursor, kResist}},
      {"initiate", {kAssisted, kTunnel, kResist}},
      {"feel", {kAssisted, kTunnel, kCursor, kResist}},
      {"wait", {kCursor}},
      {"allow_back", {kAssisted, kTunnel, kResist, kFree}},
      {"catch", {kPassive, kAssisted, kTunnel, kCursor, kResist, kFree}},
      {"progression", {kPassive, kAssisted, kTunnel, kCursor, kResist, kFree}},
      {"reach", {kReach}},
      {"range", {kRange}},
      {"press", {kPress}},
      {"track", {kTrack}},
      {"weigh", {kWeigh}},
      {"support", {kPassive, kAssisted, kTunnel, kCursor, kResist, kFree, kReach, kRange, kTrack, kSense}},
      {"sense", {kSense}}};
  return keys;
}

void check_meaning(const JsonReader& reader, const char* prefix, const std::string& key, ExerciseMode mode) {
  for (const auto& [name, modes] : keys_of_modes()) {
    if (name != key || modes.contains(mode)) continue;
    std::string others;
    for (const ExerciseMode other : modes) others += (others.empty() ? "" : ", ") + std::string(to_string(other));
    throw input_error(fmt::format("{}.{}{}: does not apply in mode {}; it applies in {}", reader.where(), prefix, key,
                                  to_string(mode), others));
  }
}

template <class Enum, std::size_t n>
Enum choose(JsonReader& reader, const char* key, const EnumNames<Enum, n>& names, Enum otherwise) {
  return names.parse(reader.choice(key, names.name(otherwise), names.list()));
}

/// Reads the keys that change a path. Its frame is part of the exercise that names the path.
PathChange read_change(JsonReader& reader, bool with_frame) {
  PathChange change;
  change.mirror = parse_mirror(reader.choice("mirror", "none", std::vector<std::string>{"none", "x", "y", "z"}));
  if (reader.has("rotate")) {
    try {
      change.rotation = parse_rotation(reader.text("rotate", ""));
    } catch (const Error& error) {
      throw input_error(fmt::format("{}.rotate: {}", reader.where(), error.what()));
    }
  }
  change.scale = reader.number("scale", 1, 0.01, 100);
  if (reader.has("about") && reader.value("about").is_array()) {
    change.about = {.kind = ChangeCentre::Kind::point, .point = reader.vector("about", Vec3::Zero(), -10, 10)};
  } else {
    static const std::vector<std::string> kPlaces{"origin", "start", "centre"};
    change.about = parse_change_centre(reader.choice("about", "origin", kPlaces));
  }
  change.offset = reader.vector("offset", Vec3::Zero(), -10, 10);
  if (!with_frame) return change;
  if (std::optional<JsonReader> frame = reader.object("frame")) {
    change.frame = read_device_frame(*frame);
    frame->finish();
  }
  return change;
}

std::optional<DifficultyRange> read_range(JsonReader& difficulty, const char* key, double least, double most) {
  std::optional<JsonReader> reader = difficulty.object(key);
  if (!reader) return std::nullopt;
  const DifficultyRange range{.easy = reader->require("easy").number("easy", 0, least, most),
                              .hard = reader->require("hard").number("hard", 0, least, most)};
  reader->finish();
  return range;
}

constexpr double kLeastRadius = 1e-4, kMostRadius = 0.5;     // [m]
constexpr double kLeastStiffness = 1, kMostStiffness = 1e5;  // [N/m]
constexpr double kShortestPress = 1;                         // [s]
constexpr double kShortestWeighing = 4;                      // [s]
constexpr double kRestOfPress = 60;                          // muscles recover in it [s]
constexpr double kLeastPace = 0.05, kMostPace = 20;          // relative to the path's own pace

Progression read_progression(JsonReader reader, ExerciseMode mode) {
  Progression progression;
  progression.figure = reader.text("figure", progression.figure);
  progression.target = reader.require("target").number("target", 0, -1e6, 1e6);
  if (progression.target == 0)
    throw input_error(reader.where() + ".target: 0 cannot be reached; give a value that is good enough");
  progression.tolerance = reader.number("tolerance", progression.tolerance, 0, 100);
  progression.window = reader.integer("window", progression.window, 1, 100);
  if (std::optional<JsonReader> assistance = reader.object("assistance")) {
    if (mode != kAssisted)
      throw input_error(
          fmt::format("{}: does not apply in mode {}; it applies in assisted", assistance->where(), to_string(mode)));
    Progression::Assistance law;
    law.start = assistance->number("start", law.start, 0, 1);
    law.forget = assistance->number("forget", law.forget, 0, 0.999);
    law.gain = assistance->number("gain", law.gain, 0, 100);
    assistance->finish();
    progression.assistance = law;
  }
  if (std::optional<JsonReader> difficulty = reader.object("difficulty")) {
    Progression::Difficulty law;
    law.start = difficulty->number("start", law.start, 0, 1);
    law.step = difficulty->number("step", law.step, 0.001, 1);
    for (const char* key : {"radius", "stiffness", "pace"})
      if (difficulty->has(key)) check_meaning(*difficulty, "", key, mode);
    law.radius = read_range(*difficulty, "radius", kLeastRadius, kMostRadius);
    law.stiffness = read_range(*difficulty, "stiffness", kLeastStiffness, kMostStiffness);
    law.pace = read_range(*difficulty, "pace", kLeastPace, kMostPace);
    if (!law.radius && !law.stiffness && !law.pace)
      throw input_error(difficulty->where() + ": nothing adapts; give radius, stiffness or pace from easy to hard");
    difficulty->finish();
    progression.difficulty = law;
  }
  if (!progression.assistance && !progression.difficulty)
    throw input_error(reader.where() + ": nothing adapts; give assistance or difficulty");
  reader.finish();
  return progression;
}

Path path_of_shape(JsonReader reader) {
  ShapeOptions shape;
  const std::vector<std::string> names = shape_names();
  reader.require("kind");
  const std::string kind = reader.choice("kind", names.front(), names);
  shape.size = reader.number("size", shape.size, 1e-3, 10);
  shape.duration = reader.number("duration", shape.duration, 0.05, 3600);
  shape.blend = reader.number("blend", shape.blend, 0, 5);
  shape.turns = reader.integer("turns", shape.turns, 1, 1000);
  const bool alias = reader.has("center");
  if (alias && reader.has("centre"))
    throw input_error(reader.where() + ": centre and center are the same key; remove one of them");
  shape.centre = reader.vector(alias ? "center" : "centre", shape.centre, -10, 10);
  shape.plane = reader.choice("plane", shape.plane, std::vector<std::string>{"xy", "yz", "zx"});
  shape.angle = std::numbers::pi / 180 * reader.number("angle_deg", 0, -360, 360);
  shape.constant_speed = reader.boolean("constant_speed", shape.constant_speed);
  reader.finish();
  constexpr double kLongest = 3600;  // [s]
  if (shape.duration * shape.turns > kLongest)
    throw input_error(fmt::format("{}: {} turns of {} s are {:.0f} s; an exercise may last at most one hour",
                                  reader.where(), shape.turns, shape.duration, shape.duration * shape.turns));
  Path path = make_shape(kind, shape);
  path.name = kind;
  return path;
}

/// Reads "always", "never", a share, or {"from": share, "to": share}.
ShownShare read_shown(JsonReader& reader, const std::string& key) {
  const nlohmann::json value = reader.value(key);
  if (value.is_string()) {
    static const std::vector<std::string> kWords{"always", "never"};
    const double share = reader.choice(key, "always", kWords) == "always" ? 1 : 0;
    return {share, share};
  }
  if (value.is_object()) {
    JsonReader fading = *reader.object(key);
    const ShownShare share{.from = fading.require("from").number("from", 1, 0, 1),
                           .to = fading.require("to").number("to", 1, 0, 1)};
    fading.finish();
    return share;
  }
  if (!value.is_number())
    throw input_error(
        fmt::format("{}.{}: must be \"always\", \"never\", a share from 0 to 1, or from one share to another, as in "
                    "{{\"from\": 1, \"to\": 0.2}}",
                    reader.where(), key));
  const double share = reader.number(key, 1, 0, 1);
  return {share, share};
}

ShownShares read_show(JsonReader& owner) {
  ShownShares shares;
  std::optional<JsonReader> reader = owner.object("show");
  if (!reader) return shares;
  for (std::size_t part = 0; part < kScreenParts; ++part)
    if (const std::string key = to_string(static_cast<ScreenPart>(part)); reader->has(key))
      shares[part] = read_shown(*reader, key);
  reader->finish();
  return shares;
}

/// Reads a force, or {"share": share} of the weight that mode weigh measured.
std::optional<ArmSupportTask> read_support(JsonReader& owner) {
  constexpr double kMost = 100;  // [N]
  if (!owner.has("support")) return std::nullopt;
  if (owner.value("support").is_number())
    return ArmSupportTask{.force = owner.number("support", 0, 0, kMost), .share = {}};
  if (const nlohmann::json value = owner.value("support"); !value.is_object())
    throw input_error(fmt::format("{}: support: expected a force in N, or a share of the weight, as {{\"share\": 0.5}}",
                                  owner.where()));
  JsonReader reader = owner.object("support").value();
  const ArmSupportTask task{.share = reader.require("share").number("share", 0, 0, 1)};
  reader.finish();
  return task;
}

ExpertOptions read_expert(JsonReader& reader) {
  ExpertOptions options{.profile = reader.text("expert_profile", ""),
                        .negated = reader.boolean("negate_measured", false)};
  if (const std::string force = reader.choice("expert_force", kForceNames.front(), kForceNames);
      force != kForceNames.front())
    options.force = parse_replayed_force(force);
  return options;
}

/// Reads true, false, or the settings of the wall.
std::optional<BackWallOptions> read_back_wall(JsonReader& owner) {
  if (!owner.value("initiate").is_object())
    return owner.boolean("initiate", false) ? std::optional(BackWallOptions{}) : std::nullopt;
  JsonReader reader = *owner.object("initiate");
  BackWallOptions wall;
  wall.wait = reader.number("wait", wall.wait, 0, 60);
  wall.stiffness = reader.number("stiffness", wall.stiffness, 1, 1e4);
  wall.max_force = reader.number("force", wall.max_force, 0, 100);
  reader.finish();
  return wall;
}

/// Returns the goal of a mode with a cue; nothing for the others.
std::optional<ReachGoal> goal_of(ExerciseMode mode) {
  switch (mode) {
    case kReach:
      return ReachGoal::target;
    case kRange:
      return ReachGoal::range;
    case kPress:
      return ReachGoal::press;
    case kTrack:
      return ReachGoal::track;
    case kWeigh:
      return ReachGoal::weigh;
    default:
      return std::nullopt;
  }
}

/// Checks that an exercise has a path, or the settings of a mode with a cue.
void check_places(JsonReader& reader, const Exercise& exercise) {
  const int paths = (reader.has("path") ? 1 : 0) + (exercise.shape ? 1 : 0);
  const char* const mode = to_string(exercise.mode);
  if (goal_of(exercise.mode) || exercise.mode == kSense) {
    if (paths > 0)
      throw input_error(
          fmt::format("{}: mode {} has targets and no path; remove path and shape", reader.where(), mode));
    if (!reader.has(mode))
      throw input_error(fmt::format(
          "{}: mode {} needs the key {}{}; see programme.schema.json", reader.where(), mode, mode,
          exercise.mode == kTrack || exercise.mode == kSense || exercise.mode == kWeigh ? "" : ", with targets"));
  } else if (paths != 1 || (reader.has("path") && exercise.path.empty())) {
    throw input_error(reader.where() + ": needs either a path (a file) or a shape");
  }
}

/// Reads the settings of a mode with a cue. They state the number of repetitions, if they have blocks or tries.
void read_reach(JsonReader& reader, Exercise& exercise, const Vec3& up) {
  const std::optional<ReachGoal> goal = goal_of(exercise.mode);
  if (!goal) return;
  std::optional<JsonReader> settings = reader.object(to_string(exercise.mode));
  if (!settings) return;
  const bool tries = goal == ReachGoal::range || is_held(*goal);
  if ((tries || settings->has("blocks")) && reader.has("repetitions"))
    throw input_error(fmt::format(
        "{}.repetitions: {}; remove it", reader.where(),
        tries ? "`tries` states the number of trials for each target" : "the blocks state the number of reaches"));
  exercise.reach = read_reach_task(*settings, *goal, exercise.repetitions, up);
  exercise.repetitions = exercise.reach->reaches();
}

/// Reads the pairs of places of mode sense, which state the number of repetitions.
void read_sense(JsonReader& reader, Exercise& exercise) {
  if (exercise.mode != kSense) return;
  std::optional<JsonReader> settings = reader.object("sense");
  if (!settings) return;
  if (reader.has("repetitions"))
    throw input_error(reader.where() +
                      ".repetitions: `tries` states the number of trials for each difference; remove it");
  exercise.sense = read_sense_task(*settings);
  exercise.repetitions = exercise.sense->trials();
}

/// Reads the time limit, which a trial with a cue always has, and checks that the trial can end within it.
void read_time_limit(JsonReader& reader, Exercise& exercise) {
  exercise.time_limit = reader.number("time_limit", exercise.time_limit, 0, 1e5);
  if (!exercise.reach) return;
  const ReachTask& task = *exercise.reach;
  if (!(exercise.time_limit > 0)) exercise.time_limit = usual_time_limit(task.goal);
  const double limit = exercise.time_limit;
  if ((task.goal == ReachGoal::target || task.goal == ReachGoal::range) && task.target_hold >= limit)
    throw input_error(
        fmt::format("{}: no reach can end within time_limit ({:g} s) with a target_hold of {:g} s; raise the limit",
                    reader.where(), limit, task.target_hold));
  if (task.goal == ReachGoal::weigh && limit < kShortestWeighing)
    throw input_error(fmt::format("{}.time_limit: a weight takes {:g} s; at least {:g} s are needed", reader.where(),
                                  limit, kShortestWeighing));
  if (task.goal == ReachGoal::press && limit < kShortestPress)
    throw input_error(fmt::format("{}.time_limit: a press lasts {:g} s; at least {:g} s are needed", reader.where(),
                                  limit, kShortestPress));
  if (task.goal != ReachGoal::track) return;
  // The sines must be told apart by a whole period of their differences, and the slowest must be seen once.
  std::vector<double> lines = task.track.frequency;
  lines.push_back(0);
  std::sort(lines.begin(), lines.end());
  double nearest = lines.back();
  for (std::size_t i = 1; i < lines.size(); ++i) nearest = std::min(nearest, lines[i] - lines[i - 1]);
  if (nearest == 0) throw input_error(reader.where() + ".track.frequencies: two sines have the same frequency");
  if (const double counted = limit - task.track.discard; !(counted * nearest >= 1))
    throw input_error(fmt::format(
        "{}: tracking lasts {:g} s, of which {:g} s are discarded; {:.0f} s are needed to tell sines apart that are "
        "{:g} Hz from each other or from 0; raise time_limit, or choose other frequencies",
        reader.where(), limit, task.track.discard, std::ceil(1 / nearest) + task.track.discard, nearest));
}

Exercise read_exercise(JsonReader reader, const std::string& name, const Vec3& up) {
  Exercise exercise;
  exercise.name = reader.text("name", name);
  exercise.path = reader.text("path", "");
  // Reject a shape that cannot be made before the participant sits down.
  if (std::optional<JsonReader> shape = reader.object("shape")) {
    (void)path_of_shape(*shape);
    exercise.shape = reader.value("shape");
  }
  exercise.change = read_change(reader, true);
  reader.require("mode");
  exercise.mode = choose(reader, "mode", kModeNames, kTunnel);
  check_places(reader, exercise);
  exercise.test = choose(reader, "test", kTestNames, TestLabel::none);
  for (const auto& [key, modes] : keys_of_modes())
    if (reader.has(key)) check_meaning(reader, "", key, exercise.mode);

  exercise.repetitions = reader.integer("repetitions", exercise.repetitions, 1, 10'000);
  read_reach(reader, exercise, up);
  read_sense(reader, exercise);
  exercise.rest = reader.number("rest", exercise.mode == kPress ? kRestOfPress : exercise.rest, 0, 3600);
  exercise.rest_after = reader.number("rest_after", exercise.rest_after, 0, 3600);
  exercise.hold = reader.number("hold", exercise.hold, 0, 3600);
  exercise.pace = reader.number("pace", exercise.pace, kLeastPace, kMostPace);
  read_time_limit(reader, exercise);
  exercise.states_radius = reader.has("radius");
  exercise.radius = reader.number("radius", exercise.radius, 0, kMostRadius);
  if (reader.has("stiffness")) exercise.stiffness = reader.number("stiffness", 0, kLeastStiffness, kMostStiffness);
  exercise.assist_force = reader.number("assist_force", exercise.assist_force, 0, 100);
  exercise.resistance = reader.number("resistance", exercise.resistance, 0, 1000);
  exercise.viscosity = reader.number("viscosity", exercise.viscosity, 0, 1000);
  exercise.force_scale = reader.number("force_scale", exercise.force_scale, 0, 10);
  exercise.expert = read_expert(reader);
  exercise.initiate = read_back_wall(reader);
  exercise.resist_forces = choose(reader, "feel", kFeelNames, 0) == 1;
  exercise.wait = reader.number("wait", exercise.wait, 0, 10);
  exercise.allow_back = reader.boolean("allow_back", exercise.allow_back);
  exercise.catch_trial = reader.boolean("catch", false);
  exercise.support = read_support(reader);
  exercise.show = read_show(reader);
  if (std::optional<JsonReader> progression = reader.object("progression"))
    exercise.progression = read_progression(*progression, exercise.mode);
  if (exercise.progression && (exercise.mode == kFree || exercise.test != TestLabel::none))
    throw input_error(reader.where() +
                      ".progression: an exercise in mode free, or a test, must stay the same; remove the progression");
  if (exercise.test != TestLabel::none && exercise.mode != kFree)
    throw input_error(fmt::format("{}.test: a test must be without guidance, in mode free; the mode is {}",
                                  reader.where(), to_string(exercise.mode)));
  reader.finish();
  return exercise;
}

std::vector<Exercise> read_exercises(JsonReader& reader, const char* key, const char* name, const Vec3& up) {
  std::vector<Exercise> exercises;
  for (JsonReader& one : reader.objects(key))
    exercises.push_back(read_exercise(one, fmt::format("{} {}", name, exercises.size() + 1), up));
  return exercises;
}

ProgrammeLimits read_limits(JsonReader reader) {
  ProgrammeLimits limits;
  limits.time = reader.number("time", 0, 0, 1e5);
  limits.force_dose = reader.number("force_dose", 0, 0, 1e9);
  if (std::optional<JsonReader> fatigue = reader.object("fatigue")) {
    ProgrammeLimits::Fatigue law;
    law.figure = fatigue->text("figure", law.figure);
    law.worse = fatigue->number("worse", law.worse, 0.01, 100);
    law.repetitions = fatigue->integer("repetitions", law.repetitions, 1, 100);
    fatigue->finish();
    limits.fatigue = law;
  }
  reader.finish();
  return limits;
}

/// Checks what makes an order random.
void check_order(const Programme& programme, const std::string& where) {
  if (programme.seed && !programme.is_random())
    throw input_error(where + ": seed: the order 'listed' is not random; choose blocked or interleaved, or remove it");
  for (const Exercise& exercise : programme.warm_up)
    if (exercise.catch_trial)
      throw input_error(fmt::format("{}: '{}': a warm-up has no catch trials; remove catch", where, exercise.name));
  const auto is_catch = [](const Exercise& exercise) { return exercise.catch_trial; };
  if (programme.order != TrialOrder::listed ||
      std::none_of(programme.exercises.begin(), programme.exercises.end(), is_catch))
    return;
  throw input_error(where +
                    ": catch: catch trials lie at random places, which the order 'listed' does not have; set order to "
                    "blocked or interleaved");
}

/// Checks that a weight is measured before a share of it is carried.
void check_support(const Programme& programme, const std::string& where) {
  bool weighed = false;
  for (std::size_t i = 0; i < programme.size(); ++i) {
    const Exercise& exercise = programme.exercise(i);
    weighed = weighed || exercise.mode == kWeigh;
    if (!support_of(programme, i).share || weighed) continue;
    throw input_error(fmt::format(
        "{}: '{}' supports a share of the arm's weight, but no exercise before it measures it; add one in mode weigh, "
        "best to warm_up, or state the support in N",
        where, exercise.name));
  }
}

}  // namespace

ArmSupportTask support_of(const Programme& programme, std::size_t i) {
  const Exercise& exercise = programme.exercise(i);
  if (exercise.mode == kPress || exercise.mode == kWeigh) return {};
  return exercise.support ? *exercise.support : programme.support.value_or(ArmSupportTask{});
}

const char* to_string(ExerciseMode mode) {
  return kModeNames.name(mode);
}

std::vector<std::string> exercise_modes() {
  return kModeNames.list();
}

const char* to_string(TestLabel label) {
  return kTestNames.name(label);
}

const char* to_string(TrialOrder order) {
  return kOrderNames.name(order);
}

const char* to_string(ScreenPart part) {
  return kPartNames.name(part);
}

bool has_tunnel(const Exercise& exercise) {
  const auto shows = [&](ScreenPart part) {
    const std::optional<ShownShare>& share = exercise.show[static_cast<std::size_t>(part)];
    return share && (share->from > 0 || share->to > 0);
  };
  if (exercise.reach || exercise.sense) return false;
  return exercise.mode != ExerciseMode::free || exercise.states_radius || shows(ScreenPart::tunnel) ||
         shows(ScreenPart::score);
}

ShownShare shown_share(const Programme& programme, std::size_t i, ScreenPart part) {
  const Exercise& exercise = programme.exercise(i);
  const auto at = static_cast<std::size_t>(part);
  if (exercise.show[at]) return *exercise.show[at];
  if (exercise.sense) return {0, 0};  // the eyes would tell what the hand must feel
  const bool is_test =
      exercise.test != TestLabel::none || exercise.mode == ExerciseMode::free || exercise.reach.has_value();
  if (is_test && part != ScreenPart::tool && part != ScreenPart::path) return {0, 0};
  return programme.show[at].value_or(ShownShare{});
}

ShownParts shown_parts(const Programme& programme, std::size_t i, int round, int repetition) {
  const bool warm_up = i < programme.warm_up.size();
  const int repetitions = programme.exercise(i).repetitions, count = repetitions * (warm_up ? 1 : programme.rounds);
  const int index = std::clamp((warm_up ? 0 : round - 1) * repetitions + repetition - 1, 0, count - 1);
  // Exercises with few repetitions each begin elsewhere, so that a share of 0.5 shows every other one of them.
  constexpr double kGolden = 0.6180339887498949;
  const double offset = std::fmod(0.5 + kGolden * static_cast<double>(i), 1.0);
  ShownParts parts{};
  for (std::size_t part = 0; part < kScreenParts; ++part) {
    const auto [from, to] = shown_share(programme, i, static_cast<ScreenPart>(part));
    // The sum of the shares of the first n repetitions. A repetition shows the part where the sum passes a whole
    // number.
    const auto sum = [&, from = from, to = to](int n) {
      const double slope = count > 1 ? (to - from) / (count - 1) : 0;
      return offset + n * from + slope * 0.5 * n * (n - 1);
    };
    parts[part] = std::floor(sum(index + 1) + 1e-9) > std::floor(sum(index) + 1e-9);
  }
  return parts;
}

bool Programme::is_random() const noexcept {
  const auto draws = [](const Exercise& exercise) { return exercise.reach || exercise.sense; };
  return order != TrialOrder::listed || std::any_of(warm_up.begin(), warm_up.end(), draws) ||
         std::any_of(exercises.begin(), exercises.end(), draws);
}

double DifficultyRange::at(double level) const {
  return easy * std::pow(hard / easy, level);
}

Programme programme_from_json(const nlohmann::json& json, const std::string& where) {
  JsonReader reader(json, where);
  reader.require("haptrace_programme").integer("haptrace_programme", 1, 1, 1);
  (void)reader.text("$schema", "");
  Programme programme{.title = reader.text("title", ""), .description = reader.text("description", "")};
  if (std::optional<JsonReader> person = reader.object("person")) {
    programme.person = read_change(*person, false);
    person->finish();
  }
  if (std::optional<JsonReader> limits = reader.object("limits")) programme.limits = read_limits(*limits);
  programme.show = read_show(reader);
  programme.rounds = reader.integer("rounds", 1, 1, 1000);
  programme.order = choose(reader, "order", kOrderNames, TrialOrder::listed);
  constexpr int kLargestSeed = 2'147'483'647;
  if (reader.has("seed")) programme.seed = static_cast<std::uint64_t>(reader.integer("seed", 0, 0, kLargestSeed));
  programme.support = read_support(reader);
  programme.up = reader.direction("up", programme.up);
  programme.warm_up = read_exercises(reader, "warm_up", "warm-up", programme.up);
  programme.exercises = read_exercises(reader, "exercises", "exercise", programme.up);
  reader.finish();
  if (programme.exercises.empty()) throw input_error(where + ": exercises: a programme needs at least one exercise");
  check_order(programme, where);
  check_support(programme, where);
  return programme;
}

namespace {

/// Returns the path from the start to each target and back. A target that moves goes to both sides of the start.
Path path_of_reach(const ReachTask& task) {
  Path path{.name = "reach"};
  for (const Vec3& target : task.targets)
    for (const Vec3& place : {task.start, target}) {
      path.time.push_back(static_cast<double>(path.time.size()));
      path.position.push_back(place);
    }
  if (task.goal == ReachGoal::track) {
    path.time.push_back(static_cast<double>(path.time.size()));
    path.position.emplace_back(2 * task.start - task.targets.front());
  }
  return path;
}

/// Returns the way from the start to the farthest place.
Path path_of_sense(const SenseTask& task) {
  const double farthest = task.reference + task.differences.back();
  return {.name = "sense", .time = {0, 1}, .position = {task.start, task.start + farthest * task.axis}};
}

/// Reads the path of an exercise with the force that it asks for. Without guidance no force is replayed.
Path load_expert(const Exercise& exercise, const std::filesystem::path& folder) {
  ExpertOptions options = exercise.expert;
  if (!options.profile.empty()) options.profile = (folder / options.profile).string();
  if (exercise.mode == kPassive || exercise.mode == kFree || exercise.force_scale == 0)
    options.force = ReplayedForce::sent;
  const ExpertRecording expert = open_expert((folder / exercise.path).string(), options);
  Path path = expert.path->read(0, expert.path->facts().rows);
  path.notes = expert.path->facts().notes;
  const std::string named = path.name + ": ";  // notes of a path do not name it
  for (const auto* texts : {&expert.warnings, &expert.notes})
    for (const std::string& text : *texts)
      path.notes.push_back(text.starts_with(named) ? text.substr(named.size()) : text);
  return path;
}

}  // namespace

Eigen::Matrix3d turn_of(const Programme& programme, const Exercise& exercise) {
  const Box nowhere{.min = Vec3::Zero(), .max = Vec3::Zero()};  // the linear part does not depend on the path
  return (programme.person.of(Vec3::Zero(), nowhere) * exercise.change.of(Vec3::Zero(), nowhere)).turn;
}

Path path_of(const Programme& programme, const Exercise& exercise, const std::string& folder) {
  Path path = exercise.reach   ? path_of_reach(*exercise.reach)
              : exercise.sense ? path_of_sense(*exercise.sense)
              : exercise.shape ? path_of_shape(JsonReader(*exercise.shape, "shape of '" + exercise.name + "'"))
                               : load_expert(exercise, folder);
  if (exercise.reach || exercise.sense) path.name = exercise.name;
  exercise.change.apply(path);
  programme.person.apply(path);
  // Gravity does not turn with the person.
  if (exercise.mode == kWeigh)
    path.position.back() = path.position.front() + (exercise.reach->targets.front() - exercise.reach->start);
  return path;
}

}  // namespace haptrace
