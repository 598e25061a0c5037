// What sessions learn of a path on a device, handed from one to the next.
#pragma once

#include "formats/documents/learned_force.h"
#include "player/playback/playback.h"

#include <string>

namespace haptrace {

/// Recalls what earlier sessions learned, for PlayOptions::learned, and keeps what a session learned, in a file.
///
/// Threads: one at a time. Not for the tick.
class LearnedMemory {
 public:
  /// `file`: as learned_file names it, or another. What is learned holds for this device, played at `speed` times the
  /// path's own, and reckoned with to be of `mass` [kg].
  LearnedMemory(std::string file, DeviceIdentity device, double speed, const Vec3& mass);

  struct Recalled {
    ForceTable table;     ///< empty when nothing was kept, or what was does not hold here
    std::string refused;  ///< why what was kept is not used, in words that name the file; empty otherwise
  };
  /// `path` as it will be played (PlayPlan::path); it is read to its end when something was kept. What cannot be read
  /// is refused, not thrown: what was learned is a help, not a need. Without recalling, what was kept before is
  /// forgotten by keep().
  Recalled recall(const PathSource& path);

  /// Keeps what was learned in the place of what was kept before. `result` must hold lessons. Throws Error(input) like
  /// save_learned.
  void keep(const PlayResult& result) const;

  [[nodiscard]] const std::string& file() const noexcept { return file_; }

 private:
  std::string file_;
  DeviceIdentity device_;
  double speed_;
  Vec3 mass_;
  int repetitions_ = 0;  ///< that what was recalled was learned from
};

}  // namespace haptrace
