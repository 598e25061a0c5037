// Making a recording whole again whose writer died.
#pragma once

#include "formats/recording/recording.h"

#include <functional>
#include <string>
#include <vector>

namespace haptrace {

/// What recover_recording found and did.
struct Recovery {
  bool needed = false;             ///< false: every file was whole already and none was touched
  std::uint64_t samples = 0;       ///< that the recording has now
  std::uint64_t unreadable = 0;    ///< that it had, as far as can be told, and that could not be read
  std::vector<std::string> files;  ///< that were written
  bool damaged = false;            ///< something else is lost, or is not what was recorded: the notes say what
  std::vector<std::string> notes;  ///< what else is lost, and where
};

/// Restores a recording in place, all its parts: what can be read is written into a new file beside each damaged one,
/// forced to the disk, read back and compared; only then it takes the old one's name. Values that were rounded or
/// packed stay as they are. With `output` the old files stay, and the new ones have that name.
///
/// A row whose position cannot be read is given up. A time that cannot be read follows from the tick and a tick from
/// the time; other values that cannot be are not known (NaN) in the new file. Values that can be read from a block
/// whose checksum is another are kept, unless no hand could have made them. Either has an event for each stretch.
///
/// Doing it again changes nothing. `progress` is told the part of the rows that is done, 0 to 1. Throws Error(input):
/// the file is being written by a living process, is no recording, cannot be read at all; nothing is changed then.
Recovery recover_recording(const std::string& file, const std::string& output = {}, bool overwrite = false,
                           const std::function<void(double)>& progress = {});

}  // namespace haptrace
