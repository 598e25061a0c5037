// What of a session is kept.
#pragma once

#include "formats/recording/recording.h"
#include "recorder/annotations.h"

#include <deque>
#include <optional>
#include <span>
#include <vector>

namespace haptrace {

struct CaptureOptions {
  /// Nothing is kept before the event `triggered`, but this much of what came before it [s]. Nothing: all is kept.
  std::optional<double> pre;
  bool mark_buttons = false;  ///< a button that is pressed leaves a mark
};

inline constexpr double kLongestPre = 600;  // [s]

/// Throws Error(input) unless `pre` is 0 to kLongestPre.
void validate(const CaptureOptions& options);

/// Decides, in the writer thread, on everything in the order of time: waits for the trigger, leaves out pauses, turns
/// buttons into marks. The time of what it keeps begins with the session, or with the first sample around its trigger.
class Capture {
 public:
  /// Takes what is kept. May throw; then nothing more is fed.
  class Output {
   public:
    virtual ~Output() = default;
    virtual void append(std::span<const Sample> samples) = 0;
    virtual void append(const StoredEvent& event) = 0;
  };

  Capture(const CaptureOptions& options, Output& output) : options_(options), output_(output) {}

  /// The next samples, and events in any order. An event acts before the first sample that is not older than it; one
  /// that is younger than all of `samples` waits for those that follow.
  void feed(std::span<const Sample> samples, std::vector<TimedEvent> events);

  /// There are no more samples.
  void finish();

  [[nodiscard]] bool armed() const noexcept { return options_.pre && !triggered_; }
  [[nodiscard]] bool paused() const noexcept { return paused_; }

 private:
  void take(std::span<const Sample> samples);
  void take(const TimedEvent& event);
  void keep(std::span<const Sample> samples);
  void write(std::span<const Sample> samples);
  void write(const TimedEvent& event);

  CaptureOptions options_;
  Output& output_;
  std::vector<TimedEvent> waiting_;  ///< younger than every sample so far, oldest first
  std::deque<Sample> before_;        ///< the last `pre` seconds while armed
  std::vector<Sample> scratch_;
  bool triggered_ = false;
  bool paused_ = false;
  std::uint32_t buttons_ = 0;
  std::int64_t begin_ns_ = 0;  ///< of the recording, in the session's time
};

}  // namespace haptrace
