// Tests of docs/plugins.md: the code that it shows is the built sample, and the laws that it names find the mistakes.
#include "tests/devices/conformance.h"
#include "tests/devices/support.h"
#include "tests/support/real_time.h"

#include <algorithm>
#include <cstdlib>
#include <fmt/format.h>
#include <fstream>
#include <gmock/gmock.h>
#include <iterator>

namespace haptrace::test {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr const char* kPlugins = HAPTRACE_SOURCE "/samples/plugins";

std::string text_of(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  EXPECT_TRUE(in) << file;
  return {std::istreambuf_iterator<char>(in), {}};
}

ConformanceReport test_plugin(const std::string& library) {
  ConsentingUser user;
  ConformanceOptions options = hasty_options();
  options.ready_timeout = 1;
  return test_conformance([&] { return open_device("plugin:path=" + library); }, options, user, StopRequest());
}

std::vector<std::string> broken(const ConformanceReport& report) {
  std::vector<std::string> laws;
  for (const LawFinding& finding : report.findings)
    if (finding.verdict == LawFinding::Verdict::failed) laws.push_back(finding.id);
  return laws;
}

TEST(Tutorial, ShowsTheSampleAsItIsInFiftyLines) {
  const std::string sample = text_of(std::string(kPlugins) + "/tutorial.c");
  EXPECT_THAT(text_of(HAPTRACE_SOURCE "/docs/plugins.md"), HasSubstr("```c\n" + sample + "```\n"));
  EXPECT_LE(std::count(sample.begin(), sample.end(), '\n'), 50);
}

TEST(Tutorial, LeadsToADeviceThatPassesTheConformanceTest) {
  in_real_time();
  const ConformanceReport report = test_plugin(SLIDE_PLUGIN);
  EXPECT_THAT(broken(report), IsEmpty()) << describe(report);
  for (const LawFinding& finding : report.findings) {
    if (finding.id != "force_x" && finding.id != "host_pause" && finding.id != "resolution") continue;
    EXPECT_EQ(finding.verdict, LawFinding::Verdict::passed) << finding.id << ": " << finding.detail;
  }
}

TEST(Tutorial, NamesTheFindingThatShowsEachMistake) {
  in_real_time();
  struct Mistake {
    const char *right, *wrong, *law;
  };
  const Mistake mistakes[] = {
      {"kCountsPerNewton *", "-kCountsPerNewton *", "force_x"},
      {"state->position[0] = kMetresPerCount", "state->position[0] = 1e3 * kMetresPerCount", "gentle"},
      {"kCountsPerNewton = 200", "kCountsPerNewton = 20000", "gentle"},
      {"position_resolution = kMetresPerCount", "position_resolution = 1e-6", "resolution"},
      {"SLIDER_WATCHDOG_MS, 20", "SLIDER_WATCHDOG_MS, 0", "host_pause"},
      {"slider_write(board, SLIDER_HOME, 1);", "", "ready"},
      {"  slider_close(device);\n", "", "reopens"},
      // Longer than a tick on every machine.
      {"(void)dt;", "(void)dt; extern int usleep(unsigned); usleep(3000);", "exchange"},
  };
  const std::string sample = text_of(std::string(kPlugins) + "/tutorial.c"),
                    page = text_of(HAPTRACE_SOURCE "/docs/plugins.md");
  const TempFolder folder;
  for (const auto& [right, wrong, law] : mistakes) {
    const std::size_t place = sample.find(right);
    ASSERT_NE(place, std::string::npos) << right;
    EXPECT_THAT(page, HasSubstr(fmt::format("`{}`", law)));
    const std::string source =
        folder.write("wrong.c", std::string(sample).replace(place, std::string(right).size(), wrong));
    const std::string library = fmt::format("{}/{}.so", folder.path(), place);
    ASSERT_EQ(std::system(fmt::format("{} -shared -fPIC -I {} -I {} {} {}/slider_board.c -lm -o {}", C_COMPILER,
                                      HAPTRACE_SOURCE, kPlugins, source, kPlugins, library)
                              .c_str()),
              0);
    const ConformanceReport report = test_plugin(library);
    EXPECT_THAT(broken(report), Contains(law)) << wrong << "\n" << describe(report);
  }
}

}  // namespace
}  // namespace haptrace::test
