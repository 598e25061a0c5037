// Selection of the samples and events of a session that a recording keeps.
#pragma once

#include "formats/recording/recording.h"
#include "recorder/annotations.h"
#include "recorder/recorder_options.h"

#include <deque>
#include <optional>
#include <span>
#include <vector>

namespace haptrace {

/// Filters the samples and events of a session in time order, in the writer thread: waits for the trigger, omits
/// pauses, turns button presses into marks. Times in the output start with the session, or with the first sample that
/// is kept for the trigger.
class Capture {
 public:
  /// Receives the samples and events to keep. May throw; nothing more may be fed after that.
  class Output {
   public:
    virtual ~Output() = default;
    /// `contacts` are those of the ticks up to the last sample.
    virtual void append(std::span<const Sample> samples, std::span<const ContactSample> contacts) = 0;
    virtual void append(const StoredEvent& event) = 0;
  };

  Capture(const CaptureOptions& options, Output& output) : options_(options), output_(output) {}

  /// Takes the next samples with their contacts, and events in any order. An event acts before the first sample that is
  /// not older. An event that is younger than all of `samples` waits for the following samples.
  void feed(std::span<const Sample> samples, std::vector<TimedEvent> events,
            std::span<const ContactSample> contacts = {});

  /// Ends the input and writes the events that still wait.
  void finish();

  [[nodiscard]] bool armed() const noexcept { return options_.pre && !triggered_; }
  [[nodiscard]] bool paused() const noexcept { return paused_; }

 private:
  void take(std::span<const Sample> samples);
  void take(const TimedEvent& event);
  void keep(std::span<const Sample> samples);
  void write(std::span<const Sample> samples);
  void forget_contacts_before(std::uint64_t tick);
  void write(const TimedEvent& event);

  CaptureOptions options_;
  Output& output_;
  std::vector<TimedEvent> waiting_;  ///< events younger than every sample so far, oldest first
  std::deque<Sample> before_;        ///< the last `pre` seconds while armed
  std::vector<Sample> scratch_;
  std::deque<ContactSample> contacts_;  ///< of ticks whose samples were not written yet
  std::vector<ContactSample> scratch_contacts_;
  bool triggered_ = false;
  bool paused_ = false;
  std::uint32_t buttons_ = 0;
  std::int64_t begin_ns_ = 0;  ///< start of the recording, in the session's time
};

}  // namespace haptrace
