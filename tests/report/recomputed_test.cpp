// Every metric that a report prints, recomputed from the recording by another program (recompute.py).
#include "formats/documents/reach_task.h"
#include "report/session_report.h"
#include "tests/report/support.h"

#include <algorithm>
#include <array>
#include <cstdio>
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
  figures["person_work_estimate_j"] =
      trial_figures(trial, std::nullopt, kRecomputedPlant).movement->person_work_estimate.value();
  for (const auto& [name, value] : figures.items())
    if (value.is_number()) seen.insert(name);
  const nlohmann::json printed{{"figures", figures},
                               {"plant", json_of_plant(kRecomputedPlant)},
                               {"reach", trial.reach ? json_of(*trial.reach) : nlohmann::json()}};
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
  for (const TrialFigure& figure : all_trial_figures())
    EXPECT_TRUE(seen.contains(figure.name)) << figure.name << " was defined in no recording";
}

}  // namespace
}  // namespace haptrace
