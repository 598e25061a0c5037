#include "tests/cli/command.h"

#include <filesystem>

namespace haptrace {
namespace {

using test::read_bytes;

/// Writes a recording of a square, played twice on a device that a hand holds.
std::string played(const TempFolder& folder) {
  const std::string path = folder / "square.csv", file = folder / "played.h5";
  EXPECT_EQ(haptrace("shape", "square", "--duration", "2", "-o", path).exit_code, 0);
  const Answer answer = haptrace("play", path, "--device", kFalcon, "--no-profile", "--repeat", "2", "--record", file);
  EXPECT_EQ(answer.exit_code, 0) << answer.err;
  return file;
}

TEST(ReportCommand, WritesAPageBesideTheRecordingAndReplacesNone) {
  const TempFolder folder;
  const std::string file = played(folder), page = folder / "played.report.html";
  Answer answer = haptrace("report", file);
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_EQ(answer.out, page + "\n");
  EXPECT_THAT(read_bytes(page), HasSubstr("played back the path"));
  answer = haptrace("report", file);
  EXPECT_EQ(answer.exit_code, 2);
  EXPECT_THAT(answer.err, HasSubstr(page));
  EXPECT_EQ(haptrace("report", file, "--overwrite").exit_code, 0);
  EXPECT_EQ(haptrace("report", file, "-o", folder / "other.html").exit_code, 0);
  EXPECT_TRUE(std::filesystem::exists(folder / "other.html"));
}

TEST(ReportCommand, WritesTheNumbersForStatistics) {
  const TempFolder folder;
  const std::string file = played(folder);
  Answer answer = haptrace("report", file, "--no-page", "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  const nlohmann::json trials = answer.json()["sessions"][0]["exercises"][0]["trials"];
  ASSERT_EQ(trials.size(), 2);
  EXPECT_EQ(trials[1]["repetition"], 2);
  EXPECT_GT(trials[0]["figures"]["deviation_rms_m"].get<double>(), 1e-4);
  EXPECT_TRUE(trials[0]["figures"]["time_in_tunnel"].is_null());
  EXPECT_FALSE(std::filesystem::exists(folder / "played.report.html"));

  answer = haptrace("report", file, "--no-page", "--csv", "-");
  EXPECT_EQ(std::count(answer.out.begin(), answer.out.end(), '\n'), 3);
  EXPECT_THAT(answer.out, HasSubstr("contour_rms_m"));
  const Answer to_file = haptrace("report", file, "--csv", folder / "table.csv", "--json");
  EXPECT_EQ(to_file.json()["csv"], folder / "table.csv");
  EXPECT_EQ(to_file.json()["file"], folder / "played.report.html");
  EXPECT_EQ(read_bytes(folder / "table.csv"), answer.out);
}

TEST(ReportCommand, SaysWhenNormsHoldForNoExercise) {
  const TempFolder folder;
  const std::string file = played(folder);
  const auto norms = [&](const std::string& device, const std::string& metric) {
    return folder.write("norms.json",
                        R"({"haptrace_norms": 1, "source": "A. Author 2024", "age": [20, 60], "device": ")" + device +
                            R"(", "task": "square", "mode": "playback", "metrics": {")" + metric +
                            R"(": {"mdc95": 1e-3}}})");
  };
  Answer answer = haptrace("report", file, "--no-page", "--json", "--norms", norms("falcon", "contour_rms_m"));
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_EQ(answer.json()["norms"]["hold"], true);
  EXPECT_THAT(answer.err, testing::Not(HasSubstr("holds for no exercise")));
  answer = haptrace("report", file, "--no-page", "--json", "--norms", norms("omega", "contour_rms_m"));
  EXPECT_EQ(answer.json()["norms"]["hold"], false);
  EXPECT_THAT(answer.err, HasSubstr("holds for no exercise"));
  EXPECT_THAT(answer.json()["sessions"][0]["remarks"].dump(), HasSubstr("hold for no exercise"));
  answer = haptrace("report", file, "--no-page", "--json", "--norms", norms("falcon", "contour_rms"));
  EXPECT_EQ(answer.exit_code, 2);
  EXPECT_THAT(answer.err, HasSubstr("contour_rms_m"));
}

TEST(ReportCommand, ReplacesNeitherRecordedDataNorItsOwnOutput) {
  const TempFolder folder;
  const std::string file = played(folder), session = folder / "lesson";
  std::filesystem::create_directory(session);
  const std::string programme = folder.write("one.json", R"({"haptrace_programme": 1, "title": "one", "exercises": [
        {"name": "alone", "mode": "passive", "shape": {"kind": "circle", "duration": 1}}]})");
  const Answer run = haptrace("run", programme, "--device", kFalcon, "--no-profile", "-o", session);
  ASSERT_EQ(run.exit_code, 0) << run.err;
  std::string trial, path;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(session))
    if (entry.path().extension() == ".h5")
      (entry.path().parent_path() == session ? trial : path) = entry.path().string();
  const std::string log = session + "/session.json", link = folder / "link.html";
  std::filesystem::create_symlink(file, link);

  const auto refused = [](const std::vector<std::string>& words, const std::string& kept) {
    std::vector<std::string> all{"report"};
    all.insert(all.end(), words.begin(), words.end());
    const std::string before = read_bytes(kept);
    const Answer answer = Command(all).wait();
    EXPECT_EQ(answer.exit_code, 2) << answer.err;
    EXPECT_THAT(answer.err, HasSubstr("belongs to the recorded data"));
    EXPECT_EQ(read_bytes(kept), before);
  };
  refused({file, "-o", file, "--overwrite"}, file);
  refused({file, "-o", folder / "lesson/../played.h5", "--overwrite"}, file);
  refused({file, "-o", link, "--overwrite"}, file);
  refused({file, "--csv", file, "--overwrite"}, file);
  refused({file, session, "-o", file, "--overwrite"}, file);
  for (const std::string& kept : {log, trial, path}) refused({session, "-o", kept, "--overwrite"}, kept);
  refused({log, "--csv", trial, "--no-page", "--overwrite"}, trial);
  refused({file, "-o", log, "--overwrite"}, log);
  EXPECT_FALSE(std::filesystem::exists(folder / "played.report.html"))
      << "the table is rejected before the page is written";

  const Answer same = haptrace("report", file, "-o", folder / "x.html", "--csv", folder / "./x.html", "--overwrite");
  EXPECT_EQ(same.exit_code, 2);
  EXPECT_THAT(same.err, HasSubstr("both the page and the table"));
  EXPECT_FALSE(std::filesystem::exists(folder / "x.html"));
}

TEST(ReportCommand, ReportsErrors) {
  const TempFolder folder;
  const auto error = [&](const std::vector<std::string>& words) {
    std::vector<std::string> all{"report"};
    all.insert(all.end(), words.begin(), words.end());
    const Answer answer = Command(all).wait();
    EXPECT_EQ(answer.exit_code, 2) << answer.err;
    return answer.err;
  };
  EXPECT_THAT(error({}), HasSubstr("needs SESSION"));
  EXPECT_THAT(error({folder / "none.h5"}), HasSubstr("none.h5"));
  EXPECT_FALSE(std::filesystem::exists(folder / "none.report.html")) << "nothing is left behind";
  EXPECT_THAT(error({folder.path()}), HasSubstr("session.json"));
  EXPECT_THAT(error({folder.path(), "--no-page"}), HasSubstr("--csv"));
  EXPECT_THAT(error({folder.path(), "--json", "--csv", "-"}), HasSubstr("standard output"));
  EXPECT_THAT(error({folder / "a.h5", "-o", folder / "no/where.html"}), HasSubstr("where.html"));
}

}  // namespace
}  // namespace haptrace
