// From the servo loop to the disk: a ring, a thread, a file.
#pragma once

#include "control/sample.h"
#include "formats/recording.h"

#include <cstdint>
#include <memory>
#include <string>

namespace haptrace {

/// Records a session. The servo loop pushes into a lock-free ring; a thread of its own writes to the disk, so that a
/// slow disk costs samples (counted, and told in the recording) but never a tick.
///
/// Threads: push from one thread (the servo loop); everything else from another one.
/// Real-time: push. A failure of the disk never reaches the servo loop: recording stops, the session goes on.
class Recorder final : public SampleSink {
 public:
  struct Options {
    bool overwrite = false;
    double ring_seconds = 4;    ///< how long the disk may stall without losing a sample [s]
    double flush_period = 0.1;  ///< how often the file is made whole: at most this much is lost with the process [s]
  };

  /// Creates the file and starts the writer. Throws what RecordingWriter throws.
  Recorder(const std::string& file, const RecordingHeader& header, const RecordingColumns& columns,
           const Options& options);
  Recorder(const std::string& file, const RecordingHeader& header, const RecordingColumns& columns);

  /// Abandons the recording unless it was finished.
  ~Recorder() override;

  void push(const Sample& sample) noexcept override;
  void push(const Event& event) noexcept override;
  void between_ticks(bool may_wait) noexcept override;

  /// Writes what is left, marks the recording complete and closes it. Call after the last push. Throws Error(fault)
  /// with the disk's reason when anything could not be written; what was written before stays.
  void finish();

  /// Stops writing and closes without marking the recording complete.
  void abandon() noexcept;

  struct Status {
    std::uint64_t written = 0;  ///< rows handed to the file
    std::uint64_t lost = 0;     ///< samples and events that found the ring full
    bool failed = false;        ///< the disk refused; see finish()
  };
  /// From any thread.
  [[nodiscard]] Status status() const noexcept;

  [[nodiscard]] const std::string& file() const noexcept;

 private:
  struct Writer;
  std::unique_ptr<Writer> writer_;
};

}  // namespace haptrace
