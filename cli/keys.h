// Keys that annotate and tune a running session.
#pragma once

#include "player/tuning/commands.h"
#include "recorder/annotations.h"

#include <atomic>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace haptrace::cli {

/// Reads keys from standard input during its lifetime:
///
///     m or space  a numbered mark at the current time      p  pauses; again: resumes
///     1 to 9      a mark with one of `texts`               q  ends the session, as Ctrl+C does
///     t TEXT ⏎    a mark with text at the time of t
///
/// and, in a playback (play_keys):
///
///     + or ]      stiffer: all gains by 10 %                o  disturbance observer on, off
///     - or [      softer: all gains by 10 %                 l  learned correction on, off
///     r           back to the values at the start           f  feedforward on, off
///
/// or in guidance and programmes (guide_keys), where 1 and 2 answer an open question instead of marking:
///
///     + or ]      stiffer walls by 10 %                     w  wider tunnel by 10 %
///     - or [      softer walls by 10 %                      n  narrower tunnel by 10 %
///     r           back to the values at the start           s  skips the repetition
///     a           repeats the repetition after it
///
/// Reads a terminal only if this process is in its foreground. With `always`, also reads input that is not a terminal.
class Keys {
 public:
  /// Keys that give a command.
  struct Binding {
    std::string_view keys, command;
  };
  static std::span<const Binding> play_keys();
  static std::span<const Binding> guide_keys();

  /// Pauses and gives the commands of `bindings` through `commands`, which is borrowed. Without `annotations` there are
  /// no marks.
  Keys(std::shared_ptr<Annotations> annotations, std::vector<std::string> texts, bool always, Commands& commands,
       std::span<const Binding> bindings = {});

  ~Keys();  ///< restores the terminal
  Keys(const Keys&) = delete;
  Keys& operator=(const Keys&) = delete;

  [[nodiscard]] bool active() const noexcept { return thread_.joinable(); }

  /// Returns the first keys of the commands.
  [[nodiscard]] std::string letters() const;

  /// Returns the text that is being typed after t, or an empty text. From any thread.
  [[nodiscard]] std::string typing() const;

 private:
  void run(const std::stop_token& stop);
  void press(char key);
  void annotate(char key);
  /// Answers an open question. Returns false if there is none, or if the key is no answer.
  bool answer(char key);
  void command(char key);
  /// Returns true if a command without a value has an effect now.
  [[nodiscard]] bool offers(const std::string& action) const;
  /// Executes a command, and shows its answer if that is not simply "ok".
  void give(char key, std::string_view command);
  void type(char key);

  std::shared_ptr<Annotations> annotations_;
  std::vector<std::string> texts_;
  Commands& commands_;
  std::span<const Binding> bindings_;
  struct Terminal;
  std::unique_ptr<Terminal> terminal_;

  int marks_ = 0;
  std::int64_t typed_at_ns_ = 0;
  mutable std::mutex mutex_;
  bool typing_ = false;  ///< typing_ and text_ are guarded by mutex_
  std::string text_;

  std::jthread thread_;
};

}  // namespace haptrace::cli
