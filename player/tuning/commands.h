// Commands of one line that change a running session, and the controls that a page shows for them.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// A quantity or switch of a running session that a command changes: "NAME VALUE" (docs/tuning.md).
struct LiveControl {
  /// A toggle is 0 or 1. A factor has no single value: only "NAME * F" and "NAME / F" change it.
  enum class Kind { number, toggle, factor };

  std::string name;               ///< first word of the command
  std::string label;              ///< in words, for a page
  std::string unit;               ///< of the values; empty for a share
  double value = 0;               ///< in force
  double least = 0, largest = 1;  ///< limits to which a command clamps
  double step = 0.05;             ///< of a button that increases or decreases the value
  double ratio = 0;               ///< by which a button multiplies or divides the value; 0: it adds `step`
  std::string because;            ///< name of the limit `largest`, without an article; of a factor, why it is one
  Kind kind = Kind::number;
  std::string text;  ///< present values of a factor
};

/// Executes commands for a running session.
///
/// Threads: any.
class Commands {
 public:
  virtual ~Commands() = default;

  /// Executes one command and returns a line, both without the line's end: "ok ..." or "error ...". Answers are
  /// printable ASCII whatever the command. Does not throw for any command.
  virtual std::string obey(std::string_view command) = 0;

  /// Returns the controls that the session has now, in the order of a page.
  [[nodiscard]] virtual std::vector<LiveControl> controls() const = 0;

  /// Returns those of the commands pause, resume, skip, repeat, mark and note that work now.
  [[nodiscard]] virtual std::vector<std::string> actions() const = 0;

  /// Tells whether someone attends the session at a controlling page. While nobody does, the feedback is softened as by
  /// `soften`; a `soften` or `restore` of before holds again when someone is back. Returns false if the session cannot
  /// soften anything.
  virtual bool attend(bool attended) {
    (void)attended;
    return false;
  }

  /// Returns the share of the feedback forces that commands ask for, 0 to 1.
  [[nodiscard]] virtual double share() const { return 1; }

  /// Returns true from `pause` to `resume`. A programme brings its present repetition to an end first.
  [[nodiscard]] virtual bool paused() const { return false; }

  /// Returns true if `skip` ends the present repetition of a programme, or ended the last one.
  [[nodiscard]] virtual bool skips() const { return false; }

  /// Takes a notice for the user from a source of commands that has no reader for the answers, such as a file.
  virtual void tell(std::string notice) { (void)notice; }
};

}  // namespace haptrace
