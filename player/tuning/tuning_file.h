// A control file: the commands of a LiveTuning, obeyed whenever the file changes.
#pragma once

#include "player/tuning/live_tuning.h"

#include <cstdint>
#include <string>
#include <thread>

namespace haptrace {

/// Obeys the lines of a file in order: at once if the file is there, and anew within 0.3 s of every change, once the
/// file has rested for 0.1 s, so that what an editor is still writing is not taken for the whole. Empty lines and what
/// follows # are passed over. The file may come, go and be replaced. What goes wrong becomes a notice of `tuning`,
/// "FILE: line 3: ..."; the other lines are obeyed. Only regular files up to 64 KiB are read.
///
/// Threads: one of its own, which ends with the object.
class TuningFile {
 public:
  /// `tuning` is borrowed and must outlive this.
  TuningFile(LiveTuning& tuning, std::string file);

 private:
  /// What tells a file from what it was.
  struct Stamp {
    std::uint64_t inode = 0;  ///< 0: there is none
    std::int64_t size = 0, seconds = 0, nanoseconds = 0;
    bool operator==(const Stamp&) const = default;
  };

  [[nodiscard]] Stamp look() const;
  void obey();
  void watch(const std::stop_token& stop);

  LiveTuning& tuning_;
  std::string file_;
  Stamp obeyed_;
  std::jthread thread_;
};

}  // namespace haptrace
