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

/// While it lives, reads keys from standard input:
///
///     m or space  a mark at this instant, numbered        p  pauses; again: goes on
///     1 to 9      a mark with one of `texts`               q  ends the session, as Ctrl+C does
///     t TEXT ⏎    a mark at the instant of t, with text
///
/// and, of a session that can be tuned:
///
///     + or ]      stiffer: all gains by 10 %                o  disturbance observer on, off
///     - or [      softer, by as much                        l  what was learned on, off
///     r           back to the session's start               f  feedforward on, off
///
/// Reads a terminal that this process is in the foreground of, and with `always` also what is no terminal.
class Keys {
 public:
  /// Told by p whether to pause or to go on; from a thread of its own.
  using Pause = std::function<void(bool paused)>;

  /// Without `annotations` there are no marks, without `pause` is none, and without `tuning`, which is borrowed, there
  /// is nothing to tune.
  Keys(std::shared_ptr<Annotations> annotations, std::vector<std::string> texts, Pause pause, bool always,
       LiveTuning* tuning = nullptr);
  /// A pause leaves out of a recording what follows.
  static Pause recording_pause(std::shared_ptr<Annotations> annotations);

  ~Keys();  ///< the terminal is as it was
  Keys(const Keys&) = delete;
  Keys& operator=(const Keys&) = delete;

  [[nodiscard]] bool active() const noexcept { return thread_.joinable(); }

  /// The text that is being typed after t, or nothing. From any thread.
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
  bool typing_ = false;  ///< these two under mutex_
  std::string text_;

  std::jthread thread_;
};

}  // namespace haptrace::cli
