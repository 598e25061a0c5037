// Recorder of a session: a ring, a writer thread and a file.
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

/// Limits at which a recording continues in another file; 0: none.
struct Split {
  double seconds = 0;       ///< of the session's time [s]
  std::uint64_t bytes = 0;  ///< largest size of a file

  [[nodiscard]] bool any() const noexcept { return seconds > 0 || bytes > 0; }
};

/// Parses "30min", "2h", "90s" or "1GiB", "500MB". Throws Error(input).
Split parse_split(std::string_view text);

/// Records a session. The servo loop pushes into a lock-free ring, and a separate thread writes to the disk. A slow
/// disk costs samples (counted, and noted in the recording) but never a tick.
///
/// Threads: push from one thread (the servo loop); everything else from another one. Real-time: push and start. A
/// failure of the disk never reaches the servo loop. The session continues, and so does the recording, in a further
/// part, as soon as the disk accepts one. The samples in the ring are not lost meanwhile.
class Recorder final : public SampleSink {
 public:
  struct Options {
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

  /// Creates the file and starts the writer. Throws what RecordingWriter throws. Throws Error(input) if an option is
  /// out of range, or if the rate is too low to pack a recording while it grows.
  Recorder(const std::string& file, const RecordingHeader& header, const RecordingColumns& columns,
           const Options& options);
  Recorder(const std::string& file, const RecordingHeader& header, const RecordingColumns& columns);

  /// Abandons the recording unless it was finished.
  ~Recorder() override;

  void start(std::int64_t monotonic_ns) noexcept override;
  void push(const Sample& sample) noexcept override;
  void push(const Event& event) noexcept override;
  void push_contact(const ContactSample& contact) noexcept override;
  void between_ticks(bool may_wait) noexcept override;

  /// Writes the remaining samples and the session's `warnings` (see json_of), marks the recording complete and closes
  /// it. Call it after the last push. Throws Error(fault) with the disk's reason if anything could not be written;
  /// earlier data stays in the file.
  void finish(const nlohmann::json& warnings = nlohmann::json::array());

  /// Stops writing and closes without marking the recording complete.
  void abandon() noexcept;

  struct Status {
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
  /// Returns the current status. From any thread.
  [[nodiscard]] Status status() const noexcept;

  /// Returns the warnings since the last call, in the order in which they arose. From any thread.
  [[nodiscard]] std::vector<Warning> take_warnings();

  [[nodiscard]] const std::string& file() const noexcept;

 private:
  class Writer;
  std::unique_ptr<Writer> writer_;
};

}  // namespace haptrace
