// Runs the haptrace command as a person would, and keeps what it answered.
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
  int exit_code = -1;  ///< or minus the signal that ended it
  std::string out, err;

  /// Standard output as JSON; fails the test when it is none.
  [[nodiscard]] nlohmann::json json() const;
};

/// A command that runs; signals may be sent to it, and text typed.
class Command {
 public:
  enum class Input {
    none,  ///< whatever the test has
    pipe,
    terminal,  ///< of which standard error is a part as well
  };

  /// `environment`: further variables, NAME=VALUE. `program`: haptrace itself, or another.
  explicit Command(const std::vector<std::string>& arguments, Input input = Input::none,
                   const std::vector<std::string>& environment = {}, const std::string& program = HAPTRACE_COMMAND);
  ~Command();
  Command(const Command&) = delete;
  Command& operator=(const Command&) = delete;
  [[nodiscard]] pid_t pid() const { return pid_; }
  void type(const std::string& text) const;

  /// Its terminal is gone, as when a person closes the window.
  void hang_up();

  /// Waits until it has said `part` on standard error; false when it ended without.
  bool says(std::string_view part);

  /// The word that followed `part` in what it has said so far.
  [[nodiscard]] std::string word_after(std::string_view part) const;

  Answer wait();

 private:
  pid_t pid_ = -1;
  int in_ = -1, out_ = -1, err_ = -1;
  std::string said_;
};

/// Runs to the end: haptrace("info", "a.h5", "--json").
template <class... Words>
Answer haptrace(const Words&... words) {
  return Command({std::string(words)...}).wait();
}

}  // namespace haptrace::test

namespace haptrace {

// What the tests of every verb say.
using test::Answer;
using test::Command;
using test::haptrace;
using test::TempFolder;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

inline const std::string kFalcon = "sim:preset=falcon,hand=relaxed,seed=3";

}  // namespace haptrace
