#include "player/guidance/averaged_expert.h"

#include "base/error.h"
#include "control/path/trajectory.h"
#include "control/sample.h"
#include "formats/path/path_file.h"
#include "player/guidance/expert_path.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr double kStep = 1e-3;         // of the path's rows [s]
constexpr std::size_t kFewCopies = 5;  // below these the radius is mostly the doubt about the spread
constexpr const char* kNoForce = "the average has no forces: ";

/// Returns true if the average has forces, and notes why not.
bool has_forces(std::span<const std::shared_ptr<const PathSource>> experts, std::vector<std::string>& notes) {
  const auto without = std::ranges::find_if(experts, [](const auto& one) { return !one->facts().force; });
  if (without == experts.end()) {
    const bool contacts = experts.front()->facts().contacts;
    const auto other =
        std::ranges::find_if(experts, [&](const auto& one) { return one->facts().contacts != contacts; });
    if (other == experts.end()) return true;
    notes.push_back(fmt::format("{}only one of {} and {} was recorded with a scene", kNoForce,
                                experts.front()->facts().name, (*other)->facts().name));
    return false;
  }
  if (std::ranges::any_of(experts, [](const auto& one) { return one->facts().force; }))
    notes.push_back(fmt::format("{}{} has none", kNoForce, (*without)->facts().name));
  return false;
}

/// Samples the average at even steps of time.
void sample(AveragedExpert& expert, bool forces) {
  const AveragedPath& average = expert.average;
  const double factor = prediction_factor(expert.copies.size(), average.directions);
  const Trajectory trajectory({.name = expert.path.name, .time = average.time, .position = average.position},
                              Interpolation::cubic);
  Trajectory::Cursor cursor;
  std::size_t after = 1;
  const auto rows = static_cast<std::size_t>(std::ceil(average.time.back() / kStep));
  for (std::size_t row = 0; row <= rows; ++row) {
    const double t = std::min(kStep * static_cast<double>(row), average.time.back());
    if (!expert.path.time.empty() && t - expert.path.time.back() < 0.5 * kStep) break;
    while (after + 1 < average.time.size() && average.time[after] < t) ++after;
    const double share =
        std::clamp((t - average.time[after - 1]) / (average.time[after] - average.time[after - 1]), 0.0, 1.0);
    expert.path.time.push_back(t);
    expert.path.position.push_back(trajectory.sample(t, cursor).position);
    if (forces)
      expert.path.force.emplace_back(average.force[after - 1] +
                                     share * (average.force[after] - average.force[after - 1]));
    expert.radius.push_back(factor * std::lerp(average.spread[after - 1], average.spread[after], share));
  }
}

}  // namespace

AveragedExpert average_experts(std::span<const std::shared_ptr<const PathSource>> experts,
                               std::optional<double> smoothing) {
  AveragedExpert expert;
  expert.path.name = "the average";
  std::vector<PathCopy> copies;
  for (const auto& one : experts) {
    expert.copies.push_back(one->facts().name);
    copies.push_back(
        {one->facts().name, std::make_shared<const ArcPath>(expert_path(one, smoothing, std::nullopt, 0))});
  }
  expert.average = average_paths(copies);
  const bool forces = has_forces(experts, expert.notes);
  expert.contacts = forces && experts.front()->facts().contacts;
  sample(expert, forces);
  const double directions = expert.average.directions, factor = prediction_factor(copies.size(), directions);
  expert.typical_radius = factor * expert.average.overall_spread;
  if (copies.size() < kFewCopies)
    expert.notes.push_back(
        fmt::format("the spread of {} recordings is uncertain, so the radius that holds the next repetition with 95 % "
                    "probability is {:.1f} times as large; {} recordings make it {:.1f} times",
                    copies.size(), factor, kFewCopies + 1, prediction_factor(kFewCopies + 1, directions)));
  if (std::ranges::any_of(experts, [](const auto& one) { return one->facts().orientation; }))
    expert.notes.emplace_back("the orientations of the tool are left out: the average has positions and forces");
  return expert;
}

void save_average(const AveragedExpert& expert, const std::string& file, const std::string& title, bool overwrite,
                  const std::string& scene_of) {
  AverageColumns columns{.radius = expert.radius,
                         .copies = fmt::format("{}: {}", expert.copies.size(), fmt::join(expert.copies, ", "))};
  const AveragedPath& average = expert.average;
  for (const AveragedPath::Pause& pause : average.pauses) {
    const auto at = std::ranges::lower_bound(average.arc, pause.arc) - average.arc.begin();
    columns.events.push_back({.time = average.time[static_cast<std::size_t>(at)],
                              .code = static_cast<std::int32_t>(EventCode::mark),
                              .text = fmt::format("{} of {} experts rest here, {:.1f} s in the median", pause.copies,
                                                  expert.copies.size(), pause.duration)});
  }
  if (expert.contacts && !scene_of.empty()) columns.scene = RecordingReader(scene_of).header().scene;
  save_path(expert.path, file, title, overwrite, &columns);
}

}  // namespace haptrace
