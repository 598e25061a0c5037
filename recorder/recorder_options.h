// Options of a session's recorder, and the status that it reports.
#pragma once

#include "formats/recording/storage.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>

namespace haptrace {

class Annotations;

/// Limits at which a recording continues in another file; 0: none.
struct Split {
  double seconds = 0;       ///< of the session's time [s]
  std::uint64_t bytes = 0;  ///< largest size of a file

  [[nodiscard]] bool any() const noexcept { return seconds > 0 || bytes > 0; }
};

/// Parses a time with a unit that parse_quantity() reads ("30min", "2 h", "90 sec"), or a size ("1GiB", "500 MB").
/// Throws Error(input).
Split parse_split(std::string_view text);

/// Part of a session that its recording keeps.
struct CaptureOptions {
  /// Time before the event `triggered` at which the recording starts [s]. Without a value, everything is kept.
  std::optional<double> pre;
  bool mark_buttons = false;  ///< mark the press of a button
};

inline constexpr double kLongestPre = 600;  // [s]

/// Throws Error(input) unless `pre` is 0 to kLongestPre.
void validate(const CaptureOptions& options);

/// Settings of a recorder (Recorder).
struct RecorderOptions {
  bool overwrite = false;
  double ring_seconds = 8;    ///< longest stall of the disk without a lost sample [s]
  double flush_period = 0.1;  ///< time between flushes: the longest loss if the process dies [s]
  double sync_period = 0;     ///< time between syncs of the disk: the longest loss if the machine fails [s]; 0: never
  Storage storage;            ///< the recorder sets rows_per_chunk from the rate
  Split split;
  CaptureOptions capture;
  bool tell_room = true;  ///< note the free space at the start; a warning of a full disk is given in any case
  std::shared_ptr<Annotations> annotations;  ///< marks and pauses of the user; may be null
};

/// Status of a recorder.
struct RecorderStatus {
  std::uint64_t written = 0;  ///< samples passed to the file; after the end or a failure, those in the file
  std::uint64_t lost = 0;     ///< samples and events that found the ring full, or were in a file that broke
  bool interrupted = false;   ///< the disk refuses writes; the recorder tries again
  bool failed = false;        ///< the disk refused for good; see finish()
  bool armed = false;         ///< waiting for the trigger
  bool paused = false;
  bool disk_low = false;  ///< less than 64 MiB and less than 1 % of the disk are free: end the session
  std::uint32_t parts = 1;
  double disk_seconds = 0;  ///< session time for which the disk has room [s]; 0: unknown
  double stalled = 0;       ///< time since the disk last answered [s]
};

}  // namespace haptrace
