#include "formats/documents/reach_task.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "control/path/shapes.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>
#include <numeric>

namespace haptrace {
namespace {

using nlohmann::json;

constexpr double kFarthestPlace = 10;                    // [m]
constexpr double kLargestGain = 100;                     // of a field [N s/m]
constexpr double kShortestWay = 1e-3;                    // that has a direction [m]
constexpr double kBelow = 0.03;                          // from the start to the place below it, for a weight [m]
constexpr double kSlowestSine = 0.01, kFastestSine = 5;  // of a target that moves [Hz]
constexpr std::size_t kMostSines = 12;
constexpr double kFastestTarget = 1;   // that moves [m/s]
constexpr double kShortestHold = 0.1;  // at the farthest place [s]

/// Reads a list of rows of numbers, all of the same length. `size` rows, or any number if it is 0.
std::vector<std::vector<double>> read_rows(const JsonReader& reader, const char* key, const json& value,
                                           std::size_t columns, double largest) {
  const auto wrong = [&] {
    return input_error(fmt::format("{}.{}: must be a list of rows of {} numbers from {:g} to {:g}", reader.where(), key,
                                   columns, -largest, largest));
  };
  if (!value.is_array() || value.empty()) throw wrong();
  std::vector<std::vector<double>> rows;
  for (const json& row : value) {
    if (!row.is_array() || row.size() != columns) throw wrong();
    rows.emplace_back();
    for (const json& number : row) {
      if (!number.is_number() || !(std::abs(number.get<double>()) <= largest)) throw wrong();
      rows.back().push_back(number.get<double>());
    }
  }
  return rows;
}

std::vector<Vec3> read_targets(JsonReader& reader, const ReachTask& task) {
  const json value = reader.require("targets").value("targets");
  std::vector<Vec3> targets;
  if (value.is_array()) {
    for (const auto& row : read_rows(reader, "targets", value, 3, kFarthestPlace))
      targets.emplace_back(row[0], row[1], row[2]);
    return targets;
  }
  if (!value.is_object())
    throw input_error(
        fmt::format("{}.targets: must be a list of points [m], or a pattern as in {{\"kind\": "
                    "\"centre-out\", \"count\": 8, \"distance\": 0.08}}",
                    reader.where()));
  JsonReader pattern = *reader.object("targets");
  static const std::vector<std::string> kPatterns{"centre-out"};
  (void)pattern.require("kind").choice("kind", kPatterns.front(), kPatterns);
  const int count = pattern.integer("count", 8, 1, 360);
  const double distance = pattern.number("distance", 0.08, 1e-3, 1);
  const double first = std::numbers::pi / 180 * pattern.number("first_angle_deg", 0, -360, 360);
  pattern.finish();
  const auto [right, up] = plane_axes(task.plane);
  return centre_out_targets(task.start, distance, count, first, right, up);
}

/// Reads {"curl": b} or {"matrix": rows}.
Eigen::Matrix3d read_field(JsonReader reader, const std::string& plane) {
  const auto [right, up] = plane_axes(plane);
  if (reader.has("curl") == reader.has("matrix"))
    throw input_error(reader.where() + ": needs either curl, as b in N s/m, or matrix, with 2 or 3 rows");
  Eigen::Matrix3d field;
  if (reader.has("curl")) {
    field = curl_field(reader.number("curl", 0, -kLargestGain, kLargestGain), right.cross(up));
  } else {
    const json value = reader.value("matrix");
    const std::size_t size = value.is_array() && value.size() == 2 ? 2 : 3;
    const auto rows = read_rows(reader, "matrix", value, size, kLargestGain);
    if (rows.size() != size)
      throw input_error(fmt::format("{}.matrix: must have 2 rows (in the plane) or 3 rows", reader.where()));
    const auto at = [&](Eigen::Index i, Eigen::Index j) {
      return rows[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)];
    };
    field = size == 2 ? plane_field(Eigen::Matrix2d::NullaryExpr(at), right, up)
                      : Eigen::Matrix3d(Eigen::Matrix3d::NullaryExpr(at));
  }
  reader.finish();
  return field;
}

ReachBlock read_block(JsonReader& reader, std::size_t number, bool has_field) {
  ReachBlock block{.name = reader.text("name", fmt::format("block {}", number)),
                   .reaches = reader.require("reaches").integer("reaches", 1, 1, 10'000),
                   .field = reader.boolean("field", false),
                   .clamps = reader.number("clamps", 0, 0, 0.5),
                   .catches = reader.number("catches", 0, 0, 0.5)};
  if (block.field && !has_field)
    throw input_error(reader.where() + ".field: the exercise has no force field; add the key field to reach");
  for (const auto& [key, share] : {std::pair("clamps", block.clamps), std::pair("catches", block.catches)})
    if (share > 0 && std::lround(share * block.reaches) == 0)
      throw input_error(fmt::format("{}.{}: {:g} of {} reaches is none; raise the share or the number of reaches",
                                    reader.where(), key, share, block.reaches));
  if (!block.field && reader.has("catches"))
    throw input_error(reader.where() +
                      ".catches: a catch trial turns the field off, and this block has none; set "
                      "field to true, or remove catches");
  reader.finish();
  return block;
}

/// Throws Error(input) naming the target that nobody can reach for, or that has no side in the plane.
void check_targets(const JsonReader& reader, const ReachTask& task) {
  const auto [right, up] = plane_axes(task.plane);
  const Vec3 normal = right.cross(up);
  for (std::size_t i = 0; i < task.targets.size(); ++i) {
    const Vec3 way = task.targets[i] - task.start;
    const auto wrong = [&](const std::string& why) {
      return input_error(fmt::format("{}.targets[{}]: {}", reader.where(), i, why));
    };
    if (const std::string why = too_near(way.norm(), task.start_radius, task.target_radius); !why.empty())
      throw wrong(why + "; move it, or make the radii smaller");
    constexpr double kSteepest = 0.5;
    if (std::abs(way.dot(normal)) > kSteepest * way.norm())
      throw wrong(fmt::format(
          "leads out of the plane {} by more than 30 degrees, so that the reach has no left and right there; choose "
          "another plane",
          task.plane));
  }
}

/// Throws Error(input) naming the target that is in the start, so that it has no direction.
void check_directions(const JsonReader& reader, const ReachTask& task) {
  for (std::size_t i = 0; i < task.targets.size(); ++i)
    if (!((task.targets[i] - task.start).norm() >= kShortestWay))
      throw input_error(
          fmt::format("{}.targets[{}]: is in the start, which is no direction; move it", reader.where(), i));
  constexpr double kSame = 0.9998;  // cosine of one degree
  for (std::size_t i = 0; i < task.targets.size(); ++i)
    for (std::size_t k = i + 1; k < task.targets.size(); ++k)
      if ((task.targets[i] - task.start).normalized().dot((task.targets[k] - task.start).normalized()) > kSame)
        throw input_error(
            fmt::format("{}.targets[{}]: lies in the same direction as targets[{}], and `tries` repeats a direction; "
                        "remove it",
                        reader.where(), k, i));
}

/// Reads the line of the moving target, and its sines.
void read_track(JsonReader& reader, ReachTask& task) {
  const Vec3 axis = reader.direction("axis", plane_axes(task.plane).first);
  const double amplitude = reader.number("amplitude", 0.04, kShortestWay, 1);
  task.targets = {task.start + amplitude * axis};
  task.track.frequency =
      reader.numbers("frequencies", {0.1, 0.17, 0.31, 0.53, 0.79}, kMostSines, kSlowestSine, kFastestSine);
  double sum = 0;
  for (const double f : task.track.frequency) sum += 2 * std::numbers::pi * f;
  if (const double fastest = amplitude * sum / static_cast<double>(task.track.frequency.size());
      fastest > kFastestTarget)
    throw input_error(fmt::format(
        "{}: its target moves at up to {:.2g} m/s; at most {:g} m/s can be followed: lower amplitude or frequencies",
        reader.where(), fastest, kFastestTarget));
  task.track.discard = reader.number("discard", task.track.discard, TrackSignal::kFadeIn, 60);
  // Phases that no pattern shares with another one: multiples of the golden section.
  const int pattern = reader.integer("pattern", 1, 1, 10'000);
  constexpr double kGolden = 0.6180339887498949;
  for (std::size_t k = 0; k < task.track.frequency.size(); ++k)
    task.track.phase.push_back(2 * std::numbers::pi * std::fmod(kGolden * pattern * static_cast<double>(k + 1), 1.0));
}

void read_clamp(JsonReader& reader, ReachTask::Clamp& clamp) {
  if (reader.has("stiffness")) clamp.stiffness = reader.number("stiffness", 0, 1, 1e5);
  clamp.damping = reader.number("damping", clamp.damping, 0, 1000);
  clamp.break_out = reader.number("break_out", clamp.break_out, 1e-3, 0.5);
}

/// Reads the lock of a press.
void read_lock(JsonReader& reader, ReachTask& task) {
  task.locked = reader.boolean("locked", task.locked);
  if (task.locked)
    for (const char* key : {"stiffness", "damping", "break_out", "energy"})
      if (reader.has(key))
        throw input_error(
            fmt::format("{}.{}: a handle that is locked needs no force; remove it, or locked", reader.where(), key));
  read_clamp(reader, task.clamp);
  task.energy = reader.number("energy", task.energy, 0.01, 10);
}

/// Reads what only reaches to a target have.
void read_fields_and_blocks(JsonReader& reader, ReachTask& task, int repetitions) {
  task.target_radius = reader.number("target_radius", task.target_radius, 1e-3, 0.1);
  check_targets(reader, task);
  task.energy = reader.number("energy", task.energy, 0.01, 10);
  if (std::optional<JsonReader> field = reader.object("field")) task.field = read_field(*field, task.plane);
  if (std::optional<JsonReader> clamp = reader.object("clamp")) {
    read_clamp(*clamp, task.clamp);
    clamp->finish();
  }
  if (!reader.has("blocks")) {
    task.blocks.push_back({.name = "", .reaches = repetitions});
    return;
  }
  for (JsonReader& block : reader.objects("blocks"))
    task.blocks.push_back(read_block(block, task.blocks.size() + 1, task.field.has_value()));
  if (task.blocks.empty()) throw input_error(reader.where() + ".blocks: needs at least one block");
}

void read_start_hold(JsonReader& reader, ReachTask& task) {
  constexpr double kLongestHold = 10;  // [s]
  const json value = reader.value("start_hold");
  if (!reader.has("start_hold")) return;
  if (value.is_number()) {
    task.least_start_hold = task.most_start_hold = reader.number("start_hold", 0, 0.1, kLongestHold);
    return;
  }
  JsonReader bounds = reader.object("start_hold").value();
  task.least_start_hold = bounds.require("least").number("least", 0, 0.1, kLongestHold);
  task.most_start_hold = bounds.require("most").number("most", 0, 0.1, kLongestHold);
  if (task.least_start_hold > task.most_start_hold)
    throw input_error(fmt::format("{}: least is {:g} s, but most is {:g} s; least must not be above most",
                                  bounds.where(), task.least_start_hold, task.most_start_hold));
  bounds.finish();
}

json json_of(const Eigen::Matrix3d& matrix) {
  json rows = json::array();
  for (Eigen::Index i = 0; i < 3; ++i) rows.push_back({matrix(i, 0), matrix(i, 1), matrix(i, 2)});
  return rows;
}

}  // namespace

int ReachTask::reaches() const {
  return std::accumulate(blocks.begin(), blocks.end(), 0,
                         [](int sum, const ReachBlock& block) { return sum + block.reaches; });
}

double usual_time_limit(ReachGoal goal) {
  switch (goal) {
    case ReachGoal::range:
      return 10;
    case ReachGoal::press:
      return 3;
    case ReachGoal::track:
      return 40;
    case ReachGoal::weigh:
      return 6;
    default:
      return 3;
  }
}

ReachTask read_reach_task(JsonReader reader, ReachGoal goal, int repetitions, const Vec3& up) {
  ReachTask task{.goal = goal};
  task.start = reader.vector("start", task.start, -kFarthestPlace, kFarthestPlace);
  task.plane = reader.choice("plane", task.plane, std::vector<std::string>{"xy", "yz", "zx"});
  task.start_radius = reader.number("start_radius", task.start_radius, 1e-3, 0.1);
  if (goal == ReachGoal::track)
    read_track(reader, task);
  else if (goal == ReachGoal::weigh)
    task.targets = {task.start - kBelow * up};
  else
    task.targets = read_targets(reader, task);
  read_start_hold(reader, task);
  task.pull = reader.boolean("pull", task.pull);
  if (goal == ReachGoal::target || goal == ReachGoal::range)
    task.target_hold = reader.number("target_hold", task.target_hold, goal == ReachGoal::range ? kShortestHold : 0, 10);
  if (goal == ReachGoal::range || is_held(goal)) {
    check_directions(reader, task);
    const int tries = reader.integer("tries", 3, 1, 1000);
    task.blocks.push_back({.name = "", .reaches = tries * static_cast<int>(task.targets.size())});
  } else if (goal == ReachGoal::track) {
    task.blocks.push_back({.name = "", .reaches = repetitions});
  }
  if (goal == ReachGoal::press) read_lock(reader, task);
  if (goal == ReachGoal::weigh) {
    read_clamp(reader, task.clamp);
    task.energy = reader.number("energy", task.energy, 0.01, 10);
  }
  if (goal == ReachGoal::target) read_fields_and_blocks(reader, task, repetitions);
  reader.finish();
  return task;
}

ReachTrial reach_trial(const ReachTask& task, const PlannedReach& planned, const Eigen::Matrix3d& turn,
                       const Vec3& start, const Vec3& target) {
  const auto [right, up] = plane_axes(task.plane);
  // To the left in the exercise's own coordinates: a mirrored exercise has mirrored signs.
  const Vec3 left = lateral_axis(turn.transpose() * start, turn.transpose() * target, right.cross(up), right);
  ReachTrial trial{.geometry = {.start = start,
                                .target = target,
                                .lateral = turn * left,
                                .start_radius = task.start_radius,
                                .target_radius = task.target_radius},
                   .goal = task.goal,
                   .hold = task.target_hold,
                   .track = task.track,
                   .kind = planned.kind,
                   .field_block = task.blocks.at(static_cast<std::size_t>(planned.block)).field};
  if (task.field) trial.field = turn * *task.field * turn.transpose();
  return trial;
}

double angle_of(const ReachTask& task, std::size_t target) {
  const auto [right, up] = plane_axes(task.plane);
  const Vec3 way = task.targets.at(target) - task.start;
  constexpr double kInPlane = 0.1;  // least part of a direction that has an angle in the plane
  if (std::hypot(way.dot(up), way.dot(right)) < kInPlane * way.norm()) return std::nan("");
  const double angle = 180 / std::numbers::pi * std::atan2(way.dot(up), way.dot(right));
  return std::round(angle < -1e-9 ? angle + 360 : std::abs(angle));
}

std::string angle_in_words(double angle) {
  return std::isnan(angle) ? "out of the plane" : fmt::format("{:.0f} degrees", angle);
}

std::string describe(const ReachTask& task, const PlannedReach& planned) {
  const ReachBlock& block = task.blocks.at(static_cast<std::size_t>(planned.block));
  if (task.goal == ReachGoal::track) return "tracking";
  if (task.goal == ReachGoal::weigh) return "weight of the arm";
  std::string text = fmt::format("{} {} of {}", task.goal == ReachGoal::target ? "target" : "direction",
                                 planned.target + 1, task.targets.size());
  if (task.goal != ReachGoal::target)
    text += ", " + angle_in_words(angle_of(task, static_cast<std::size_t>(planned.target)));
  if (!block.name.empty()) text += ", " + block.name;
  if (planned.kind != ReachKind::plain) text += fmt::format(", {}", to_string(planned.kind));
  return text;
}

json json_of(const PlannedReach& planned) {
  return {{"target", planned.target},
          {"block", planned.block},
          {"kind", to_string(planned.kind)},
          {"start_hold_s", planned.start_hold}};
}

PlannedReach planned_reach_from(JsonReader reader) {
  PlannedReach planned{.target = reader.require("target").integer("target", 0, 0, 10'000),
                       .block = reader.integer("block", 0, 0, 10'000),
                       .kind = parse_reach_kind(reader.text("kind", to_string(ReachKind::plain))),
                       .start_hold = reader.number("start_hold_s", 0, 0, 60)};
  reader.finish();
  return planned;
}

json json_of(const ReachTrial& trial) {
  const ReachGeometry& geometry = trial.geometry;
  json result{{"start_m", json_of(geometry.start)},        {"target_m", json_of(geometry.target)},
              {"lateral", json_of(geometry.lateral)},      {"start_radius_m", geometry.start_radius},
              {"target_radius_m", geometry.target_radius}, {"kind", to_string(trial.kind)},
              {"field_n_s_per_m", json_of(trial.field)},   {"field_block", trial.field_block}};
  if (trial.goal == ReachGoal::target) return result;
  result["goal"] = to_string(trial.goal);
  if (trial.goal == ReachGoal::range) {
    result["hold_s"] = trial.hold;
    if (is_finite(trial.workspace.min) && is_finite(trial.workspace.max))
      result["workspace_m"] = {json_of(trial.workspace.min), json_of(trial.workspace.max)};
  }
  if (is_held(trial.goal)) result["largest_n"] = trial.largest;
  if (trial.goal == ReachGoal::track)
    result["track"] = {{"frequencies_hz", trial.track.frequency},
                       {"phases_rad", trial.track.phase},
                       {"discard_s", trial.track.discard}};
  return result;
}

namespace {

/// Reads what depends on the goal.
void read_goal(JsonReader& reader, ReachTrial& trial) {
  trial.goal = parse_reach_goal(reader.text("goal", to_string(ReachGoal::target)));
  trial.hold = reader.number("hold_s", trial.hold, 0, 3600);
  trial.largest = reader.number("largest_n", 0, 0, 1e6);
  if (reader.has("workspace_m")) {
    const auto corners = read_rows(reader, "workspace_m", reader.value("workspace_m"), 3, kFarthestPlace);
    if (corners.size() != 2) throw input_error(reader.where() + ".workspace_m: must have 2 corners");
    trial.workspace = {.min = Vec3(corners[0].data()), .max = Vec3(corners[1].data())};
  }
  if (std::optional<JsonReader> track = reader.object("track")) {
    trial.track = {.frequency = track->require("frequencies_hz").numbers("frequencies_hz", {}, kMostSines),
                   .phase = track->require("phases_rad").numbers("phases_rad", {}, kMostSines),
                   .discard = track->number("discard_s", trial.track.discard, 0, 3600)};
    track->finish();
    if (trial.track.frequency.size() != trial.track.phase.size())
      throw input_error(track->where() + ": needs a phase for each frequency");
  }
  if (trial.goal == ReachGoal::track && trial.track.frequency.empty())
    throw input_error(reader.where() + ".track: is missing, but the goal is track");
}

}  // namespace

ReachTrial reach_trial_from(JsonReader reader) {
  ReachTrial trial;
  ReachGeometry& geometry = trial.geometry;
  geometry.start = reader.require("start_m").vector("start_m", geometry.start);
  geometry.target = reader.require("target_m").vector("target_m", geometry.target);
  geometry.lateral = reader.require("lateral").vector("lateral", geometry.lateral);
  geometry.start_radius = reader.number("start_radius_m", geometry.start_radius, 0, kFarthestPlace);
  geometry.target_radius = reader.number("target_radius_m", geometry.target_radius, 0, kFarthestPlace);
  trial.kind = parse_reach_kind(reader.text("kind", to_string(ReachKind::plain)));
  const auto rows = read_rows(reader, "field_n_s_per_m", reader.require("field_n_s_per_m").value("field_n_s_per_m"), 3,
                              10 * kLargestGain);
  if (rows.size() != 3) throw input_error(reader.where() + ".field_n_s_per_m: must have 3 rows");
  for (std::size_t i = 0; i < 9; ++i)
    trial.field(static_cast<Eigen::Index>(i / 3), static_cast<Eigen::Index>(i % 3)) = rows[i / 3][i % 3];
  trial.field_block = reader.boolean("field_block", false);
  read_goal(reader, trial);
  reader.finish();
  return trial;
}

}  // namespace haptrace
