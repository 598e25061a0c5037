#include "formats/documents/sense_task.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "control/path/min_jerk.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

using nlohmann::json;

constexpr double kFarthest = 10;                                  // [m]
constexpr double kLeastDifference = 1e-4, kMostDifference = 0.2;  // [m]
constexpr std::size_t kMostDifferences = 20;

/// Returns the duration of the movement to a place and back [s].
double visit(const SenseTask& task) {
  return 2 * task.move + task.stay;
}

/// Returns the begin of a movement to a place, since the first one began [s].
double begin_of(const SenseTask& task, int place) {
  return place * (visit(task) + SenseTask::kPause);
}

}  // namespace

std::vector<double> SenseTask::pairs() const {
  std::vector<double> all;
  for (const double sign : {-1.0, 1.0})
    for (const double difference : differences) all.push_back(sign * difference);
  return all;
}

double SenseTask::duration() const noexcept {
  return begin_of(*this, 1) + visit(*this);
}

SenseTask read_sense_task(JsonReader reader) {
  SenseTask task;
  task.start = reader.vector("start", task.start, -kFarthest, kFarthest);
  task.axis = reader.direction("axis", task.axis);
  task.reference = reader.number("reference", task.reference, 1e-3, 1);
  task.differences =
      reader.numbers("differences", task.differences, kMostDifferences, kLeastDifference, kMostDifference);
  std::sort(task.differences.begin(), task.differences.end());
  if (std::adjacent_find(task.differences.begin(), task.differences.end()) != task.differences.end())
    throw input_error(reader.where() + ".differences: the same number is there twice; `tries` repeats them all");
  task.tries = reader.integer("tries", task.tries, 2, 1000);
  if (task.tries % 2 != 0)
    throw input_error(fmt::format("{}.tries: is {}; it must be even, so that each order of the places comes as often",
                                  reader.where(), task.tries));
  task.move = reader.number("move", task.move, 0.2, 10);
  task.stay = reader.number("stay", task.stay, 0.2, 10);
  task.answer = reader.number("answer_time", task.answer, 1, 600);
  reader.finish();
  return task;
}

json json_of(const SenseTrial& trial) {
  return {{"pair", trial.pair}, {"answer", trial.answer}};
}

SenseTrial sense_trial_from(JsonReader reader) {
  const SenseTrial trial{
      .pair = reader.require("pair").integer("pair", 0, 0, 2 * static_cast<int>(kMostDifferences) - 1),
      .answer = reader.integer("answer", 0, 0, 2)};
  reader.finish();
  return trial;
}

Path path_of_pair(const SenseTask& task, int pair) {
  constexpr double kStep = 0.01;  // [s]
  const double difference = task.pairs().at(static_cast<std::size_t>(pair));
  const double first = task.reference + std::max(0.0, -difference), second = task.reference + std::max(0.0, difference);
  const auto along = [&](double t) {
    const bool later = t >= begin_of(task, 1);
    const double since = t - (later ? begin_of(task, 1) : 0), back = since - task.move - task.stay;
    const double there = MinJerk::at(std::clamp(since / task.move, 0.0, 1.0)).s,
                 returned = MinJerk::at(std::clamp(back / task.move, 0.0, 1.0)).s;
    return (later ? second : first) * (there - returned);
  };
  Path path{.name = fmt::format("pair {}", pair + 1)};
  for (int i = 0; i * kStep <= task.duration() + 0.5 * kStep; ++i) {
    path.time.push_back(i * kStep);
    path.position.push_back(task.start + along(i * kStep) * task.axis);
  }
  return path;
}

SensePair sense_pair(const SenseTask& task, int number) {
  SensePair pair{.axis = task.axis.normalized(),
                 .difference = task.axis.norm() * task.pairs().at(static_cast<std::size_t>(number))};
  for (int place = 0; place < 2; ++place) {
    std::array<double, 2>& window = place == 0 ? pair.first : pair.second;
    window[0] = begin_of(task, place) + task.move + 0.5 * task.stay;
    window[1] = begin_of(task, place) + task.move + task.stay;
  }
  return pair;
}

json json_of(const SensePair& pair) {
  return {{"axis", json_of(pair.axis)},
          {"first_s", {pair.first[0], pair.first[1]}},
          {"second_s", {pair.second[0], pair.second[1]}},
          {"difference_m", pair.difference}};
}

SensePair sense_pair_from(JsonReader reader) {
  SensePair pair;
  pair.axis = reader.require("axis").vector("axis", pair.axis);
  pair.difference = reader.require("difference_m").number("difference_m", 0, -kFarthest, kFarthest);
  for (const auto& [key, window] : {std::pair("first_s", &pair.first), std::pair("second_s", &pair.second)}) {
    const std::vector<double> ends = reader.require(key).numbers(key, {}, 2);
    if (ends.size() != 2) throw input_error(fmt::format("{}.{}: must be begin and end [s]", reader.where(), key));
    *window = {ends[0], ends[1]};
  }
  reader.finish();
  return pair;
}

}  // namespace haptrace
