// Keys that annotate and tune a running session.
#pragma once

#include "player/tuning/live_tuning.h"
#include "recorder/annotations.h"

#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace haptrace::cli {

/// Reads keys from standard input during its lifetime:
///
///     m or space  a numbered mark at the current time      p  pauses; again: resumes
///     1 to 9      a mark with one of `texts`               q  ends the session, as Ctrl+C does
///     t TEXT ⏎    a mark with text at the time of t
///
/// and, in a session that can be tuned:
///
///     + or ]      stiffer: all gains by 10 %                o  disturbance observer on, off
///     - or [      softer: all gains by 10 %                 l  learned correction on, off
///     r           back to the values at the start           f  feedforward on, off
///
/// Reads a terminal only if this process is in its foreground. With `always`, also reads input that is not a terminal.
class Keys {
 public:
  /// Called by the key p to pause or to resume, from another thread.
  using Pause = std::function<void(bool paused)>;

  /// Without `annotations` there are no marks, without `pause` no pauses, and without `tuning`, which is borrowed, no
  /// tuning.
  Keys(std::shared_ptr<Annotations> annotations, std::vector<std::string> texts, Pause pause, bool always,
       LiveTuning* tuning = nullptr);
  /// Returns a Pause that omits the pauses from a recording.
  static Pause recording_pause(std::shared_ptr<Annotations> annotations);

  ~Keys();  ///< restores the terminal
  Keys(const Keys&) = delete;
  Keys& operator=(const Keys&) = delete;

  [[nodiscard]] bool active() const noexcept { return thread_.joinable(); }

  /// Returns the text that is being typed after t, or an empty text. From any thread.
  [[nodiscard]] std::string typing() const;

 private:
  void run(const std::stop_token& stop);
  void press(char key);
  void annotate(char key);
  void tune(char key);
  void type(char key);

  std::shared_ptr<Annotations> annotations_;
  std::vector<std::string> texts_;
  Pause pause_;
  LiveTuning* tuning_;
  struct Terminal;
  std::unique_ptr<Terminal> terminal_;

  bool paused_ = false;
  int marks_ = 0;
  std::int64_t typed_at_ns_ = 0;
  mutable std::mutex mutex_;
  bool typing_ = false;  ///< typing_ and text_ are guarded by mutex_
  std::string text_;

  std::jthread thread_;
};

}  // namespace haptrace::cli
