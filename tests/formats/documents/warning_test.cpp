#include "formats/convert/anonymise.h"
#include "formats/documents/warning_json.h"
#include "formats/recording/recording.h"
#include "formats/recording/recording_stream.h"
#include "tests/support/temp_folder.h"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::TempFolder;
using testing::HasSubstr;
using testing::IsEmpty;

const std::vector<Warning> kThree{
    {Severity::note, "plan", kNaN, "/home/jane/a.csv: the trainee feels the walls alone"},
    {Severity::warning, "force_limit", 3.2, "the force was limited 14 times, first at 3.2 s"},
    {Severity::problem, "stopped", 4, "stopped: 31.0 mm off the path, the limit is 30.0 mm"}};

void record_warnings(const std::string& file, const nlohmann::json& warnings) {
  RecordingWriter writer(file, {}, {}, {});
  writer.append(std::vector<Sample>(3));
  writer.warn(warnings);
  writer.finish();
}

TEST(Warnings, AreKeptInARecording) {
  const TempFolder folder;
  record_warnings(folder / "a.h5", json_of(kThree));
  const std::vector<Warning> read = warnings_from(RecordingReader(folder / "a.h5").header().warnings);
  ASSERT_EQ(read.size(), kThree.size());
  for (std::size_t i = 0; i < read.size(); ++i) {
    EXPECT_EQ(read[i].severity, kThree[i].severity);
    EXPECT_EQ(read[i].code, kThree[i].code);
    EXPECT_EQ(std::isnan(read[i].time), std::isnan(kThree[i].time));
    EXPECT_EQ(read[i].text, kThree[i].text);
  }
}

TEST(Warnings, ThatDoNotFitAreLeftOutNotesFirst) {
  const TempFolder folder;
  std::vector<Warning> many{kThree[2]};
  for (int i = 0; i < 500; ++i) many.push_back(kThree[0]);
  many.push_back(kThree[1]);
  record_warnings(folder / "a.h5", json_of(many));
  const std::vector<Warning> read = warnings_from(RecordingReader(folder / "a.h5").header().warnings);
  ASSERT_GT(read.size(), 10U);
  EXPECT_LT(read.size(), 500U);
  EXPECT_EQ(read.front().code, "stopped");
  EXPECT_EQ(read.back().code, "force_limit");
}

TEST(Warnings, ThatAreInvalidAreSkipped) {
  EXPECT_THAT(warnings_from({{"text", "no list"}}), IsEmpty());
  EXPECT_THAT(warnings_from({1, nullptr, "text", {{"text", 5}}, {{"code", "a"}}}), IsEmpty());
  EXPECT_EQ(warnings_from({{{"text", "t"}, {"severity", "unheard of"}, {"time_s", "soon"}}}).size(), 1U);
}

TEST(Warnings, OfFilesFromBeforeTheOneScaleAreProblems) {
  EXPECT_EQ(warnings_from({{{"text", "t"}, {"severity", "error"}}}).at(0).severity, Severity::problem);
}

TEST(Warnings, ThatMayNameFilesLoseTheirTextWhenARecordingIsAnonymised) {
  const TempFolder folder;
  record_warnings(folder / "a.h5", json_of(kThree));
  const auto anonymised = anonymise(open_source(folder / "a.h5"));
  const std::string all = anonymised->header().warnings.dump();
  EXPECT_THAT(all, testing::Not(HasSubstr("jane")));
  EXPECT_THAT(all, HasSubstr("the force was limited 14 times"));
}

}  // namespace
}  // namespace haptrace
