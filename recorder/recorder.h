// Recorder of a session: a ring, a writer thread and a file.
#pragma once

#include "control/warning.h"
#include "formats/recording/recording.h"
#include "recorder/recorder_options.h"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace haptrace {

/// Records a session. The servo loop pushes into a lock-free ring, and a separate thread writes to the disk. A slow
/// disk costs samples (counted, and noted in the recording) but never a tick.
///
/// Threads: push from one thread (the servo loop); everything else from another one. Real-time: push and start. A
/// failure of the disk never reaches the servo loop. The session continues, and so does the recording, in a further
/// part, as soon as the disk accepts one. The samples in the ring are not lost meanwhile.
class Recorder final : public SampleSink {
 public:
  /// Creates the file and starts the writer. Throws what RecordingWriter throws. Throws Error(input) if an option is
  /// out of range, or if the rate is too low to pack a recording while it grows.
  Recorder(const std::string& file, const RecordingHeader& header, const RecordingColumns& columns,
           const RecorderOptions& options);
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

  /// Returns the current status. From any thread.
  [[nodiscard]] RecorderStatus status() const noexcept;

  /// Returns the warnings since the last call, in the order in which they arose. From any thread.
  [[nodiscard]] std::vector<Warning> take_warnings();

  [[nodiscard]] const std::string& file() const noexcept;

 private:
  class Writer;
  std::unique_ptr<Writer> writer_;
};

}  // namespace haptrace
