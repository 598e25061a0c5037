#include "formats/recording/recording.h"
#include "tests/cli/command.h"

#include <cmath>
#include <csignal>
#include <filesystem>
#include <thread>

namespace haptrace {
namespace {

using test::read_bytes;

/// Writes a log like a slow logger's: samples after 1, 2, 1, 2, 1, 1, 2 ms, with a force sensor at 250 Hz.
std::string log_of(const TempFolder& folder, std::size_t rows = 2000) {
  std::string text = "t,x,y,z,fx,fy,fz\n";
  const int steps[] = {1, 2, 1, 2, 1, 1, 2};
  for (std::size_t i = 0, ms = 0; i < rows; ms += static_cast<std::size_t>(steps[i % 7]), ++i) {
    const double t = 1e-3 * static_cast<double>(ms), felt = static_cast<double>(ms / 4) * 4e-3;
    text += std::to_string(t) + "," + std::to_string(0.1 * std::sin(t)) + "," + std::to_string(0.1 * std::cos(t)) +
            "," + std::to_string(0.001 * t) + "," + std::to_string(1 + felt) + ",0," +
            std::to_string(std::cos(9 * felt)) + "\n";
  }
  return folder.write("log.csv", text);
}

bool valid(const std::string& file) {
  return haptrace("check", file).exit_code == 0;
}

TEST(ConvertCommand, ReportsAnIrregularLogAndConvertsItThereAndBack) {
  const TempFolder folder;
  const std::string log = log_of(folder);
  const Answer there = haptrace("convert", log, "--json");
  ASSERT_EQ(there.exit_code, 0) << there.err;
  const nlohmann::json json = there.json();
  EXPECT_EQ(json["file"], folder / "log.h5");
  EXPECT_EQ(json["samples"], 2000);
  EXPECT_EQ(json["sampling"]["pattern_s"].size(), 7U);
  EXPECT_NEAR(json["sampling"]["mean_rate_hz"].get<double>(), 700, 1);
  EXPECT_EQ(json["sampling"]["held"][0]["name"], "force");
  EXPECT_EQ(json["sampling"]["constant"], nlohmann::json::array({"fy"}));
  EXPECT_THAT(there.err, HasSubstr("they repeat 1, 2, 1, 2, 1, 1, 2 ms"));
  EXPECT_TRUE(valid(folder / "log.h5"));

  EXPECT_EQ(haptrace("convert", folder / "log.h5", "-o", folder / "a.jsonl", "-q").err, "");
  EXPECT_EQ(haptrace("convert", folder / "a.jsonl", "-o", folder / "b.h5").exit_code, 0);
  EXPECT_EQ(haptrace("convert", folder / "b.h5", "-o", folder / "c.jsonl").exit_code, 0);
  EXPECT_EQ(read_bytes(folder / "a.jsonl"), read_bytes(folder / "c.jsonl"));
}

TEST(ConvertCommand, SaysThatTheForceInCsvHoldsTheSupportOfTheArm) {
  const TempFolder folder;
  ASSERT_EQ(haptrace("record", folder / "a.h5", "--device", "sim:preset=omega3,hand=relaxed", "--duration", "3",
                     "--support", "1", "--up", "0,0,1")
                .exit_code,
            0);
  EXPECT_THAT(haptrace("convert", folder / "a.h5", "-o", folder / "a.csv").err,
              HasSubstr("the force holds the support of the arm, which the columns sx, sy, sz state"));
  EXPECT_THAT(haptrace("convert", folder / "a.h5", "-o", folder / "b.h5").err, Not(HasSubstr("support of the arm")));
}

TEST(ConvertCommand, ResamplesCutsAndReportsTheDifference) {
  const TempFolder folder;
  const std::string log = log_of(folder);
  const Answer answer =
      haptrace("convert", log, "-o", folder / "r.h5", "--resample", "1000", "--from", "0.5", "--to", "1.5", "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  const nlohmann::json json = answer.json();
  EXPECT_NEAR(json["resample"]["rows_out"].get<double>(), 1000, 3);
  EXPECT_LT(json["resample"]["rms_difference_m"], 1e-6);
  EXPECT_TRUE(valid(folder / "r.h5"));
  EXPECT_EQ(RecordingReader(folder / "r.h5").header().rate_hz, 1000);

  const std::string twice = folder.write("twice.csv", "t,x,y,z\n0,0,0,0\n0,1,0,0\n0.001,0,0,0\n0.002,0,0,0\n");
  const Answer refused = haptrace("convert", twice);
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("twice.csv:3: column t: 0 s is in line 2 as well"));
  EXPECT_THAT(refused.err, HasSubstr("--resample"));
  EXPECT_FALSE(std::filesystem::exists(folder / "twice.h5"));
  EXPECT_EQ(haptrace("convert", twice, "--resample", "1000", "--json").json()["resample"]["duplicates"], 1);
}

TEST(ConvertCommand, CompressesAndRoundsWithinTheBoundAndReportsTheLoss) {
  const TempFolder folder;
  const std::string log = log_of(folder, 5000);
  ASSERT_EQ(haptrace("convert", log, "-o", folder / "plain.h5").exit_code, 0);
  ASSERT_EQ(haptrace("convert", folder / "plain.h5", "-o", folder / "packed.h5", "--compress").exit_code, 0);
  const Answer rounded = haptrace("convert", folder / "plain.h5", "-o", folder / "rounded.h5", "--precision", "1um,1mN",
                                  "--compress", "9", "--json");
  ASSERT_EQ(rounded.exit_code, 0) << rounded.err;
  EXPECT_LT(std::filesystem::file_size(folder / "packed.h5"), std::filesystem::file_size(folder / "plain.h5"));
  EXPECT_LT(std::filesystem::file_size(folder / "rounded.h5"), std::filesystem::file_size(folder / "packed.h5"));
  const nlohmann::json told = rounded.json();
  for (const nlohmann::json& column : told["columns"]) {
    const double bound = column["name"] == "position" ? 1e-6 : column["name"] == "force" ? 1e-3 : 0;
    EXPECT_LE(column["max_loss"].get<double>(), bound) << column;
    EXPECT_LE(column["rms_loss"], column["max_loss"]);
    EXPECT_LT(column["stored_bytes"].get<double>(), 1.1 * column["raw_bytes"].get<double>());
    EXPECT_GT(column["bytes_per_hour"], 0);
  }
  EXPECT_TRUE(valid(folder / "rounded.h5"));
}

TEST(ConvertCommand, AnonymisesWritesForOldReadersAndRejectsInvalidOptions) {
  const TempFolder folder;
  ASSERT_EQ(haptrace("record", folder / "a.h5", "--device", "sim:hand=relaxed", "--duration", "0.2", "--subject",
                     "Jane", "--notes", "Jane's first")
                .exit_code,
            0);
  const Answer answer = haptrace("convert", folder / "a.h5", "-o", folder / "b.h5", "--anonymise", "--libver", "1.8");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_THAT(answer.out,
              HasSubstr("dropped: subject, notes, device_serial, uuid, config.file, config.notes, config.subject\n"));
  EXPECT_THAT(answer.out, HasSubstr("kept, and may still identify the participant or the date: created"));
  EXPECT_EQ(read_bytes(folder / "b.h5").find("Jane"), std::string::npos);
  EXPECT_EQ(read_bytes(folder / "a.h5")[8], 3);
  EXPECT_EQ(read_bytes(folder / "b.h5")[8], 2) << "the superblock version of HDF5 1.8";

  const auto refused = [&](const std::string& option, const std::string& value, const std::string& what) {
    const Answer said = haptrace("convert", folder / "a.h5", "-o", folder / "x.h5", option, value);
    EXPECT_EQ(said.exit_code, 2) << option;
    EXPECT_THAT(said.err, HasSubstr(what));
    EXPECT_FALSE(std::filesystem::exists(folder / "x.h5"));
  };
  refused("--libver", "1.6", "--libver 1.6 must be 1.10 or");
  refused("--digits", "18", "--digits 18 must be 1 to 17");
  refused("--resample", "-5", "is not a rate");
  refused("--method", "cubic", "--method has no effect without --resample");
  refused("--low-pass", "20", "--low-pass has no effect without --resample");
  refused("--from", "99", "no sample is after 99 s");
  refused("--precision", "1parsec", "parsec");
  refused("--compress", "10", "");
  refused("--map", "x", "--map x must be COLUMN=LABEL");
  EXPECT_THAT(haptrace("convert", folder / "a.h5", "-o", folder / "b.h5").err, HasSubstr("exists already"));
  EXPECT_EQ(haptrace("convert", folder / "a.h5", "-o", folder / "a.xyz").exit_code, 2);
  EXPECT_EQ(haptrace("convert").exit_code, 2);
}

TEST(ConvertCommand, LeavesNothingBehindWhenItIsInterrupted) {
  const TempFolder folder;
  const std::string log = log_of(folder, 400'000);
  const std::string precious = folder.write("out.csv", "precious");
  Command command({"convert", log, "-o", precious, "--overwrite"});
  // Wait until the new file grows beside the old one.
  const auto files = [&] { return std::distance(std::filesystem::directory_iterator(folder.path()), {}); };
  while (files() < 3) std::this_thread::yield();
  kill(command.pid(), SIGINT);
  const Answer answer = command.wait();
  EXPECT_EQ(answer.exit_code, 130);
  EXPECT_THAT(answer.err, HasSubstr("interrupted; nothing was written"));
  EXPECT_EQ(read_bytes(precious), "precious");
  EXPECT_EQ(files(), 2);
}

}  // namespace
}  // namespace haptrace
