// Control file: executes the commands of a session whenever the file changes.
#pragma once

#include "player/tuning/commands.h"

#include <cstdint>
#include <string>
#include <thread>

namespace haptrace {

/// Executes the lines of a file in order: at once if the file exists, and again within 0.3 s of every change. A change
/// counts once the file has not changed for 0.1 s, so that a half-written file is not executed. Empty lines and text
/// after # are ignored. The file may appear, disappear and be replaced. Errors become notices of `commands`, "FILE:
/// line 3: ..."; the other lines are executed. Only regular files up to 64 KiB are read; a file that other users can
/// write is refused.
///
/// Threads: one of its own, which ends with the object.
class TuningFile {
 public:
  /// `commands` is borrowed and must outlive this.
  TuningFile(Commands& commands, std::string file);

 private:
  /// Identity of one version of the file.
  struct Stamp {
    std::uint64_t inode = 0;  ///< 0: no file
    std::int64_t size = 0, seconds = 0, nanoseconds = 0;
    bool operator==(const Stamp&) const = default;
  };

  [[nodiscard]] Stamp look() const;
  void obey();
  void watch(const std::stop_token& stop);

  Commands& commands_;
  std::string file_;
  Stamp obeyed_;
  std::jthread thread_;
};

}  // namespace haptrace
