#include "player/playback/learned_memory.h"

#include "base/error.h"
#include "base/rfc3339.h"
#include "player/calibration/device_identity.h"
#include "player/playback/reference_stream.h"

#include <chrono>
#include <fmt/format.h>
#include <optional>
#include <utility>

namespace haptrace {

LearnedMemory::LearnedMemory(std::string file, DeviceIdentity device, double speed, const Vec3& mass, double max_force)
    : file_(std::move(file)), device_(std::move(device)), speed_(speed), mass_(mass), max_force_(max_force) {}

LearnedMemory::Recalled LearnedMemory::recall(const PathSource& path) {
  std::optional<LearnedPath> learned;
  try {
    learned = load_learned(file_);
  } catch (const Error& error) {
    return {{}, fmt::format("{}; the learned forces are not used", error.what())};
  }
  if (!learned) return {};
  if (const std::string reason = check_learned(*learned, device_, digest_of(path), speed_, mass_, max_force_);
      !reason.empty())
    return {{}, fmt::format("{} is not used: {}", file_, reason)};
  repetitions_ = learned->repetitions;
  return {std::move(learned->table), ""};
}

std::string LearnedMemory::apply(const DeviceInfo& device, const std::shared_ptr<const PathSource>& path,
                                 PlayOptions& options, PlayPlan& plan) {
  Recalled recalled = recall(plan.path->source());
  options.learned = std::move(recalled.table);
  if (!options.learned.force.empty()) plan = plan_playback(device, path, options);
  return recalled.refused;
}

void LearnedMemory::keep(const PlayResult& result) const {
  int repetitions = repetitions_;
  for (const Lesson& lesson : result.lessons)
    if (lesson.outcome == LearningOutcome::learned) ++repetitions;
  save_learned({.device = device_,
                .path_digest = digest_of(result.plan.path->source()),
                .speed = speed_,
                .mass = mass_,
                .repetitions = repetitions,
                .rms_error = result.lessons.back().rms_error,
                .created = rfc3339(std::chrono::system_clock::now()),
                .software = software_name(),
                .table = result.learned},
               file_);
}

std::optional<LearnedMemory> learned_memory_of(const DeviceInfo& device, const PlayOptions& options, std::string file) {
  if (!options.identified || !options.compensations.learning) return std::nullopt;
  return LearnedMemory(std::move(file), identity_of(device), options.playback.speed, options.identified->design.mass,
                       device.max_force);
}

}  // namespace haptrace
