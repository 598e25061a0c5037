// Runs the haptrace command as a user does, and keeps its output.
#pragma once

#include "tests/support/temp_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <sys/types.h>
#include <vector>

namespace haptrace::test {

struct Answer {
  int exit_code = -1;  ///< or the negated number of the signal that ended it
  std::string out, err;

  /// Returns standard output parsed as JSON; fails the test if it is not JSON.
  [[nodiscard]] nlohmann::json json() const;
};

/// A running command. A test can send it signals and type text into it.
class Command {
 public:
  enum class Input {
    none,  ///< standard input of the test
    pipe,
    terminal,  ///< a terminal for standard input and standard error
  };

  /// Starts `program`. `environment`: additional variables, NAME=VALUE.
  explicit Command(const std::vector<std::string>& arguments, Input input = Input::none,
                   const std::vector<std::string>& environment = {}, const std::string& program = HAPTRACE_COMMAND);
  ~Command();
  Command(const Command&) = delete;
  Command& operator=(const Command&) = delete;
  [[nodiscard]] pid_t pid() const { return pid_; }
  void type(const std::string& text) const;

  /// Closes its terminal, as if the user closed the window.
  void hang_up();

  /// Waits until it has printed `part` on standard error; returns false if it ended before.
  bool says(std::string_view part);

  /// Returns the word after `part` in its standard error so far.
  [[nodiscard]] std::string word_after(std::string_view part) const;

  Answer wait();

 private:
  pid_t pid_ = -1;
  int in_ = -1, out_ = -1, err_ = -1;
  std::string said_;
};

/// Runs the command to its end: haptrace("info", "a.h5", "--json").
template <class... Words>
Answer haptrace(const Words&... words) {
  return Command({std::string(words)...}).wait();
}

}  // namespace haptrace::test

namespace haptrace {

// Names that the tests of every verb use.
using test::Answer;
using test::Command;
using test::haptrace;
using test::TempFolder;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

inline const std::string kFalcon = "sim:preset=falcon,hand=relaxed,seed=3";

}  // namespace haptrace
