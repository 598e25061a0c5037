// From the servo loop to the disk: a ring, a thread, a file.
#pragma once

#include "control/warning.h"
#include "formats/recording/recording.h"
#include "recorder/annotations.h"
#include "recorder/capture.h"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace haptrace {

/// When a recording goes on in another file; 0: never.
struct Split {
  double seconds = 0;       ///< of the session's time [s]
  std::uint64_t bytes = 0;  ///< of a file, at most

  [[nodiscard]] bool any() const noexcept { return seconds > 0 || bytes > 0; }
};

/// Reads "30min", "2h", "90s" or "1GiB", "500MB". Throws Error(input).
Split parse_split(std::string_view text);

/// Records a session. The servo loop pushes into a lock-free ring; a thread of its own writes to the disk, so that a
/// slow disk costs samples (counted, and told in the recording) but never a tick.
///
/// Threads: push from one thread (the servo loop); everything else from another one.
/// Real-time: push and start. A failure of the disk never reaches the servo loop: the session goes on, and so does the
/// recording, in a further part, as soon as the disk takes one; what the ring holds until then is not lost.
class Recorder final : public SampleSink {
 public:
  struct Options {
    bool overwrite = false;
    double ring_seconds = 8;    ///< how long the disk may stall without losing a sample [s]
    double flush_period = 0.1;  ///< how often the file is made whole: at most this much is lost with the process [s]
    double sync_period = 0;     ///< how often the disk is waited for: this much is lost with the machine [s]; 0: never
    Storage storage;            ///< rows_per_chunk is chosen by the rate
    Split split;
    CaptureOptions capture;
    bool tell_room = true;  ///< at the start, even when there is plenty; of a full disk is warned in any case
    std::shared_ptr<Annotations> annotations;  ///< from a person; may be null
  };

  /// Creates the file and starts the writer. Throws what RecordingWriter throws, and Error(input) when an option is out
  /// of range, or when the rate is too slow to pack a recording while it grows.
  Recorder(const std::string& file, const RecordingHeader& header, const RecordingColumns& columns,
           const Options& options);
  Recorder(const std::string& file, const RecordingHeader& header, const RecordingColumns& columns);

  /// Abandons the recording unless it was finished.
  ~Recorder() override;

  void start(std::int64_t monotonic_ns) noexcept override;
  void push(const Sample& sample) noexcept override;
  void push(const Event& event) noexcept override;
  void between_ticks(bool may_wait) noexcept override;

  /// Writes what is left and the session's `warnings` (see json_of), marks the recording complete and closes it. Call
  /// after the last push. Throws Error(fault) with the disk's reason when anything could not be written; what was
  /// written before stays.
  void finish(const nlohmann::json& warnings = nlohmann::json::array());

  /// Stops writing and closes without marking the recording complete.
  void abandon() noexcept;

  struct Status {
    std::uint64_t written = 0;  ///< rows handed to the file; after finish(), abandon() or a failure, those in it
    std::uint64_t lost = 0;     ///< samples and events that found the ring full, or went with a file that broke
    bool interrupted = false;   ///< the disk refuses; it is tried again
    bool failed = false;        ///< the disk refused for good; see finish()
    bool armed = false;         ///< waiting for the trigger
    bool paused = false;
    bool disk_low = false;  ///< less than a hundredth of the disk, or 64 MiB, is free: it is time to end
    std::uint32_t parts = 1;
    double disk_seconds = 0;  ///< how long a session the disk has room for [s]; 0: unknown
    double stalled = 0;       ///< for how long the disk has not answered [s]
  };
  /// From any thread.
  [[nodiscard]] Status status() const noexcept;

  /// The warnings since the last call, in the order in which they arose. From any thread.
  [[nodiscard]] std::vector<Warning> take_warnings();

  [[nodiscard]] const std::string& file() const noexcept;

 private:
  class Writer;
  std::unique_ptr<Writer> writer_;
};

}  // namespace haptrace
