// Recovery of recordings whose writer died or whose files are damaged.
#pragma once

#include "formats/recording/recording.h"

#include <functional>
#include <string>
#include <vector>

namespace haptrace {

/// Result of recover_recording().
struct Recovery {
  bool needed = false;             ///< false: every file was intact, and none was changed
  std::uint64_t samples = 0;       ///< samples in the recording now
  std::uint64_t unreadable = 0;    ///< samples that could not be read, as far as is known
  std::vector<std::string> files;  ///< files that were written
  bool damaged = false;            ///< other data are lost or differ from the recorded ones: see the notes
  std::vector<std::string> notes;  ///< further losses, and where they are
};

/// Restores a recording and all its parts in place. For each damaged file it writes all readable data into a new file
/// beside it, forces that to the disk, reads it back and compares it. Only then does the new file take the old one's
/// name. Rounded or compressed values stay as they are. With `output` the old files stay, and the new ones have that
/// name.
///
/// It drops a row whose position cannot be read. It computes an unreadable time from the tick, and an unreadable tick
/// from the time. Other unreadable values are unknown (NaN) in the new file. It keeps readable values of a block with a
/// wrong checksum, unless no hand could have produced them. Every damaged stretch gets an event.
///
/// A second run changes nothing. `progress` receives the share of the rows that is done, 0 to 1. Throws Error(input),
/// without changing anything, if a living process writes the file, if it is not a recording, or if it cannot be read at
/// all.
Recovery recover_recording(const std::string& file, const std::string& output = {}, bool overwrite = false,
                           const std::function<void(double)>& progress = {});

}  // namespace haptrace
