// Every metric that a report prints, recomputed from the recording by another program (recompute.py).
#include "control/path/min_jerk.h"
#include "formats/documents/reach_task.h"
#include "formats/documents/sense_task.h"
#include "report/session_report.h"
#include "tests/report/support.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fmt/format.h>
#include <functional>
#include <gtest/gtest.h>
#include <set>

namespace haptrace {
namespace {

using test::Reference;
using test::TempFolder;

/// Returns what a command prints, on both outputs.
std::string printed_by(const std::string& command) {
  std::FILE* const stream = popen((command + " 2>&1").c_str(), "r");
  std::string text;
  std::array<char, 4096> buffer{};
  while (stream != nullptr && std::fgets(buffer.data(), buffer.size(), stream) != nullptr) text += buffer.data();
  EXPECT_EQ(stream != nullptr ? pclose(stream) : -1, 0) << text;
  return text;
}

nlohmann::json json_of_plant(const PlantModel& plant) {
  const auto three = [](const Vec3& v) { return nlohmann::json{v.x(), v.y(), v.z()}; };
  return {{"mass", three(plant.mass)},
          {"viscous", three(plant.viscous)},
          {"coulomb", three(plant.coulomb)},
          {"gravity", three(plant.gravity)}};
}

const PlantModel kRecomputedPlant{
    .mass = {0.3, 0.25, 0.2}, .viscous = {0.5, 0.4, 0.6}, .coulomb = {0.2, 0.1, 0.3}, .gravity = {0, 0, -0.4}};

/// Compares the metrics of the last repetition of a recording with those of numpy, and adds the names of those that are
/// defined to `seen`.
void compare_with_numpy(const TempFolder& folder, const std::string& file, std::set<std::string>& seen) {
  const Report report = gather_report(std::vector{file});
  nlohmann::json figures = to_json(report)["sessions"][0]["exercises"][0]["trials"][0]["figures"];
  // The work of the participant needs a calibrated device.
  const RecordedTrial trial = read_trials(RecordingReader(file), file).back();
  if (const auto movement = trial_figures(trial, std::nullopt, kRecomputedPlant).movement)
    figures["person_work_estimate_j"] = movement->person_work_estimate.value();
  for (const auto& [name, value] : figures.items())
    if (value.is_number()) seen.insert(name);
  const nlohmann::json printed{{"figures", figures},
                               {"plant", json_of_plant(kRecomputedPlant)},
                               {"reach", trial.reach ? json_of(*trial.reach) : nlohmann::json()},
                               {"sense", trial.sense ? json_of(*trial.sense) : nlohmann::json()}};
  const std::string json = folder.write("printed.json", printed.dump());
  EXPECT_EQ(printed_by(fmt::format("{} {}/recompute.py {} {}", HAPTRACE_PYTHON, HAPTRACE_REPORT_TESTS, file, json)),
            "");
}

/// Writes a reach of 0.1 m that starts 0.25 s after the cue.
std::string write_reach(const TempFolder& folder, ReachKind kind) {
  constexpr double kRate = 500;  // [Hz]
  Path path = make_shape("reach", {.size = 0.1, .duration = 0.6});
  std::vector<Sample> rows = test::rows_of(path, {.error = 8e-4, .rate_hz = kRate, .tremor = 1e-4}, Reference::none);
  const auto cue = std::find_if(rows.begin(), rows.end(), [](const Sample& row) { return row.phase == Phase::run; });
  rows.insert(cue, static_cast<std::size_t>(0.25 * kRate), *cue);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    rows[i].tick = i;
    rows[i].time_ns = static_cast<std::int64_t>(1e9 / kRate) * static_cast<std::int64_t>(i);
  }
  const ReachTrial reach{.geometry = {.target = Vec3(0.1, 0, 0), .lateral = Vec3::UnitY()},
                         .kind = kind,
                         .field = curl_field(-9, Vec3::UnitZ()),
                         .field_block = true};
  const std::string file = folder / fmt::format("{}.h5", to_string(kind));
  test::Recorded recorded;
  recorded.header.config = {{"mode", "reach"}, {"reach", json_of(reach)}};
  test::write(file, rows, Reference::none, recorded);
  return file;
}

/// Writes a recording of a hand along the x axis, under forces of the device along it.
std::string write_along_x(const TempFolder& folder, double duration, const nlohmann::json& config,
                          const std::function<double(double)>& place, const std::function<double(double)>& force) {
  constexpr double kRate = 500;  // [Hz]
  std::vector<Sample> rows;
  for (int i = 0; i < duration * kRate; ++i) {
    const double t = i / kRate;
    Sample row;
    row.tick = static_cast<std::uint64_t>(i);
    row.time_ns = static_cast<std::int64_t>(1e9 / kRate) * i;
    row.phase = Phase::run;
    row.position = Vec3(place(t) + 2e-4 * std::sin(50 * t), 1e-4 * std::sin(37 * t), 0);
    row.velocity = Vec3::Zero();
    row.force = Vec3(force(t), 0.1, 0);
    rows.push_back(row);
  }
  test::Recorded recorded;
  recorded.header.config = config;
  const std::string file = folder / "along-x.h5";
  test::write(file, rows, Reference::none, recorded);
  return file;
}

/// Writes a trial of an assessment.
std::string write_assessed(const TempFolder& folder, ReachGoal goal) {
  ReachTrial trial{.geometry = {.target = Vec3(0.05, 0, 0)}, .goal = goal, .hold = 0.4, .largest = 9};
  trial.track = {.frequency = {0.2, 0.43, 0.71}, .phase = {1, 2, 3}, .discard = 3};
  const nlohmann::json config{{"mode", to_string(goal)}, {"reach", json_of(trial)}};
  const auto blend = [](double share) { return MinJerk::at(std::clamp(share, 0.0, 1.0)).s; };
  switch (goal) {
    case ReachGoal::range:
      return write_along_x(
          folder, 3, config, [&](double t) { return 0.08 * blend(t / 1.2) - 0.01 * blend(3 * (t - 2)); },
          [](double) { return 0.0; });
    case ReachGoal::press:
      return write_along_x(
          folder, 2, config, [](double) { return 0.0; }, [&](double t) { return -4 * blend(2 * t) - std::sin(9 * t); });
    case ReachGoal::weigh:
      return write_along_x(
          folder, 6, config, [](double) { return 0.0; },
          [&](double t) { return -3 * blend(t / 2) - 0.5 * std::sin(11 * t) - 0.1 * t; });
    default:
      return write_along_x(
          folder, 20, config, [&](double t) { return 0.05 * 0.8 * trial.track.at(t - 0.23); },
          [](double) { return 0.0; });
  }
}

TEST(RecomputedMetrics, AgreeWithNumpyWithinOnePerCent) {
  std::set<std::string> seen;
  for (const Reference reference : {Reference::none, Reference::playback, Reference::guidance}) {
    const TempFolder folder;
    const std::string file = folder / "trial.h5";
    std::vector<Sample> rows = test::rows_of(
        test::expert_path(), {.error = 3e-3, .rate_hz = 500, .tremor = 4e-4, .radius = 2.5e-3}, reference);
    // Rest within the movement, and a peak of force that lasts 6 ms.
    std::int64_t pause = 0;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (i == 1200) pause = 400'000'000;
      rows[i].time_ns += pause;
      if (i >= 900 && i < 903) rows[i].force += Vec3(0, 4, 0);
    }
    std::vector<Sample> resting;
    for (int k = 0; k < 199; ++k) {
      Sample row = rows[1199];
      row.time_ns += std::int64_t{k + 1} * 2'000'000;
      resting.push_back(row);
    }
    rows.insert(rows.begin() + 1200, resting.begin(), resting.end());
    for (std::size_t i = 0; i < rows.size(); ++i) rows[i].tick = i;
    test::write(file, rows, reference);

    SCOPED_TRACE(static_cast<int>(reference));
    compare_with_numpy(folder, file, seen);
  }
  for (const ReachKind kind : {ReachKind::plain, ReachKind::catch_trial, ReachKind::clamp}) {
    SCOPED_TRACE(to_string(kind));
    const TempFolder folder;
    compare_with_numpy(folder, write_reach(folder, kind), seen);
  }
  for (const ReachGoal goal : {ReachGoal::range, ReachGoal::press, ReachGoal::track, ReachGoal::weigh}) {
    SCOPED_TRACE(to_string(goal));
    const TempFolder folder;
    compare_with_numpy(folder, write_assessed(folder, goal), seen);
  }
  {
    const SenseTask task{.move = 0.6, .stay = 0.8};
    const Path path = path_of_pair(task, 2);
    const TempFolder folder;
    compare_with_numpy(folder,
                       write_along_x(
                           folder, path.duration(), {{"mode", "sense"}, {"sense", json_of(sense_pair(task, 2))}},
                           [&](double t) { return path.position.at(static_cast<std::size_t>(t / 0.01)).x(); },
                           [](double) { return 0.5; }),
                       seen);
  }
  for (const TrialFigure& figure : all_trial_figures())
    EXPECT_TRUE(seen.contains(figure.name)) << figure.name << " was defined in no recording";
}

}  // namespace
}  // namespace haptrace
