// Storage of learned forces between sessions.
#pragma once

#include "formats/documents/learned_force.h"
#include "player/playback/playback.h"

#include <memory>
#include <optional>
#include <string>

namespace haptrace {

/// Loads the forces that earlier sessions learned, for PlayOptions::learned, and stores those of a session in a file:
///
///     PlayPlan plan = plan_playback(device->info(), path, options);
///     std::optional<LearnedMemory> memory = learned_memory_of(device->info(), options, file);
///     const std::string refused = memory ? memory->apply(device->info(), path, options, plan) : "";
///     const PlayResult result = play(*device, plan, options, stop);
///     if (memory && !result.lessons.empty()) memory->keep(result);
///
/// Threads: one at a time. Not real-time.
class LearnedMemory {
 public:
  /// `file`: from learned_file or any other name. The learned forces hold for this device, at `speed` relative to the
  /// path's own, with inertia compensation for `mass` [kg]. The device has `max_force` [N]; 0: not known.
  LearnedMemory(std::string file, DeviceIdentity device, double speed, const Vec3& mass, double max_force = 0);

  struct Recalled {
    ForceTable table;     ///< empty when nothing was stored or the stored forces do not apply
    std::string refused;  ///< message that names the file and says why it is not used; empty otherwise
  };
  /// Loads the stored forces for `path`, which is the path as it will be played (PlayPlan::path). Reads the whole path
  /// if a file exists. An unreadable file is refused without an exception, because learned forces are optional. If
  /// recall() is not called, keep() discards what earlier sessions learned.
  Recalled recall(const PathSource& path);

  /// Recalls the forces for the path of `plan` into `options`, and if there are any, plans the playback of `path` again
  /// with them. Returns the message of Recalled. Throws Error(input) like plan_playback.
  std::string apply(const DeviceInfo& device, const std::shared_ptr<const PathSource>& path, PlayOptions& options,
                    PlayPlan& plan);

  /// Stores the learned forces of a session and replaces those stored before. `result` must hold lessons. Throws
  /// Error(input) like save_learned.
  void keep(const PlayResult& result) const;

  [[nodiscard]] const std::string& file() const noexcept { return file_; }

 private:
  std::string file_;
  DeviceIdentity device_;
  double speed_;
  Vec3 mass_;
  double max_force_;
  int repetitions_ = 0;  ///< repetitions behind the recalled forces
};

/// Returns the memory in `file` of a playback; none if the device is not identified, or if the force terms are without
/// the learned force.
std::optional<LearnedMemory> learned_memory_of(const DeviceInfo& device, const PlayOptions& options, std::string file);

}  // namespace haptrace
