// Storage of learned forces between sessions.
#pragma once

#include "formats/documents/learned_force.h"
#include "player/playback/playback.h"

#include <string>

namespace haptrace {

/// Loads the forces that earlier sessions learned, for PlayOptions::learned, and stores those of a session in a file.
///
/// Threads: one at a time. Not real-time.
class LearnedMemory {
 public:
  /// `file`: from learned_file or any other name. The learned forces hold for this device, at `speed` relative to the
  /// path's own, with inertia compensation for `mass` [kg].
  LearnedMemory(std::string file, DeviceIdentity device, double speed, const Vec3& mass);

  struct Recalled {
    ForceTable table;     ///< empty when nothing was stored or the stored forces do not apply
    std::string refused;  ///< message that names the file and says why it is not used; empty otherwise
  };
  /// Loads the stored forces for `path`, which is the path as it will be played (PlayPlan::path). Reads the whole path
  /// if a file exists. An unreadable file is refused without an exception, because learned forces are optional. If
  /// recall() is not called, keep() discards what earlier sessions learned.
  Recalled recall(const PathSource& path);

  /// Stores the learned forces of a session and replaces those stored before. `result` must hold lessons. Throws
  /// Error(input) like save_learned.
  void keep(const PlayResult& result) const;

  [[nodiscard]] const std::string& file() const noexcept { return file_; }

 private:
  std::string file_;
  DeviceIdentity device_;
  double speed_;
  Vec3 mass_;
  int repetitions_ = 0;  ///< repetitions behind the recalled forces
};

}  // namespace haptrace
