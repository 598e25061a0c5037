// Runs every row (test) under the floating-point traps that the index lists for it. Checks the index against the rows.
#include <cfenv>
#include <csignal>
#include <cstring>
#include <fstream>
#include <gtest/gtest.h>
#include <map>
#include <regex>
#include <string>
#include <unistd.h>

namespace {

/// Traps by the text in the last column of the index.
const std::map<std::string, int> kTraps{{"all", FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW},
                                        {"no overflow", FE_INVALID | FE_DIVBYZERO},
                                        {"no invalid", FE_DIVBYZERO | FE_OVERFLOW},
                                        {"none", 0}};

/// Returns the rows by name, each with its traps; -1 if the index names unknown traps.
std::map<std::string, int> read_index() {
  std::map<std::string, int> rows;
  std::ifstream file(EXTREMES_INDEX);
  const std::regex row(R"(^\| `(\w+\.\w+)` \|.*\| ([^|]+) \|$)");
  std::smatch match;
  for (std::string line; std::getline(file, line);) {
    if (!std::regex_match(line, match, row)) continue;
    const auto traps = kTraps.find(match[2]);
    EXPECT_TRUE(rows.emplace(match[1], traps != kTraps.end() ? traps->second : -1).second) << "twice: " << match[1];
  }
  return rows;
}

char running[256];

/// Prints the trap and the running row, and ends the program. Async-signal-safe.
void tell_of_trap(int /*signal*/, siginfo_t* info, void* /*context*/) {
  const char* what = info->si_code == FPE_FLTINV   ? "an invalid floating-point operation in "
                     : info->si_code == FPE_FLTDIV ? "a floating-point division by zero in "
                     : info->si_code == FPE_FLTOVF ? "a floating-point overflow in "
                                                   : "SIGFPE in ";
  for (const char* text : {"[  FAILED  ] ", what, static_cast<const char*>(running), "\n"})
    if (write(STDERR_FILENO, text, std::strlen(text)) < 0) break;
  _exit(1);
}

/// Enables the traps of a row while it runs; a trapped operation ends the program with the row's name.
class Traps final : public testing::EmptyTestEventListener {
 public:
  void OnTestStart(const testing::TestInfo& test) override {
    const std::string name = std::string(test.test_suite_name()) + "." + test.name();
    std::strncpy(running, name.c_str(), sizeof running - 1);
    const auto row = index_.find(name);
    const int traps = row != index_.end() ? row->second : 0;
    std::feclearexcept(FE_ALL_EXCEPT);
    if (traps > 0 && feenableexcept(traps) < 0) std::fputs("this processor has no floating-point traps\n", stderr);
  }
  void OnTestEnd(const testing::TestInfo& /*test*/) override { fedisableexcept(FE_ALL_EXCEPT); }

 private:
  std::map<std::string, int> index_ = read_index();
};

TEST(Index, ListsEveryRowAndNoOther) {
  std::map<std::string, int> index = read_index();
  EXPECT_FALSE(index.empty()) << "nothing could be read of " << EXTREMES_INDEX;
  const testing::UnitTest& program = *testing::UnitTest::GetInstance();
  for (int i = 0; i < program.total_test_suite_count(); ++i) {
    const testing::TestSuite& suite = *program.GetTestSuite(i);
    for (int k = 0; k < suite.total_test_count(); ++k) {
      const std::string name = std::string(suite.name()) + "." + suite.GetTestInfo(k)->name();
      if (name == "Index.ListsEveryRowAndNoOther") continue;
      const auto row = index.find(name);
      if (row == index.end()) {
        ADD_FAILURE() << name << " is not in the index";
        continue;
      }
      EXPECT_NE(row->second, -1) << name << ": the last column names no choice of traps";
      index.erase(row);
    }
  }
  for (const auto& [name, traps] : index) ADD_FAILURE() << name << " is in the index, but there is no such test";
}

}  // namespace

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  struct sigaction action {};
  action.sa_sigaction = tell_of_trap;
  action.sa_flags = SA_SIGINFO;
  sigaction(SIGFPE, &action, nullptr);
  testing::UnitTest::GetInstance()->listeners().Append(new Traps);
  return RUN_ALL_TESTS();
}
