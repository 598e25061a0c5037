#include "formats/path/path_file.h"

#include "base/json_reader.h"
#include "tests/formats/support.h"

#include <cmath>

namespace haptrace {
namespace {

Path load_text(const std::string& text) {
  const TempFolder folder;
  return load_path(folder.write("a.csv", text));
}

/// Expects load_path to reject the text. The message begins with the file and `where` (":line" or ""), and contains
/// `what`.
void expect_refused(const std::string& text, const std::string& where, const std::string& what) {
  const TempFolder folder;
  const std::string file = folder.write("a.csv", text);
  expect_error([&] { load_path(file); }, Error::Kind::input, {file + where + ": ", what});
}

std::string notes_of(const Path& path) {
  std::string all;
  for (const std::string& note : path.notes) all += note + "\n";
  return all;
}

Path random_path(unsigned seed, std::size_t rows, bool velocity, bool force) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> number(-1, 1);
  const auto vector = [&] { return Vec3(number(random), 1e-9 * number(random), std::ldexp(number(random), -300)); };
  Path path;
  path.name = "random";
  std::int64_t ns = 0;
  for (std::size_t i = 0; i < rows; ++i) {
    path.time.push_back(static_cast<double>(ns) * 1e-9);
    ns += std::llround(1e6 * (1.5 + number(random)));
    path.position.push_back(vector());
    if (velocity) path.velocity.push_back(vector());
    if (force) path.force.push_back(vector());
  }
  return path;
}

TEST(Csv, ReadsColumnsInAnyOrderCaseAndQuotes) {
  const Path path = load_text("\" Z \", T ,x,'y',fx,FY,fz\n3, 0 ,1,\"2\",4,5,6\n3.5,+0.5,1e0,-2,-4,-5,-6\n");
  EXPECT_EQ(path.time, (std::vector<double>{0, 0.5}));
  EXPECT_EQ(path.position, (std::vector<Vec3>{{1, 2, 3}, {1, -2, 3.5}}));
  EXPECT_TRUE(path.velocity.empty());
  EXPECT_EQ(path.force, (std::vector<Vec3>{{4, 5, 6}, {-4, -5, -6}}));
  EXPECT_TRUE(path.notes.empty()) << notes_of(path);
}

TEST(Csv, ToleratesMarksCommentsLineEndsAndBlankLinesAtTheEnd) {
  for (const std::string text :
       {"t,x,y,z\n0,1,2,3\n", "t,x,y,z\n0,1,2,3", "\xEF\xBB\xBFt,x,y,z\r\n0,1,2,3\r\n",
        "# a log\n\n#t,x\nt,x,y,z\n0,1,2,3\n\n \n", "t;x;y;z\n0;1;2;3\n", "t\tx\ty\tz\n0\t1\t2\t3\n"}) {
    const Path path = load_text(text);
    ASSERT_EQ(path.size(), 1U) << text;
    EXPECT_EQ(path.position[0], Vec3(1, 2, 3)) << text;
  }
}

TEST(Csv, LeavesOutUnknownColumnsAndHalfVectorsWithANote) {
  const Path path = load_text("t,x,y,z,pressure,vx,vy,marker\n0,1,2,3,high,4,5,\n");
  EXPECT_EQ(path.size(), 1U);
  EXPECT_TRUE(path.velocity.empty());
  EXPECT_EQ(notes_of(path), "columns left out: pressure, vx, vy, marker\n");
}

TEST(Csv, ReadsUnderflowAsZeroButRejectsOverflow) {
  EXPECT_EQ(load_text("t,x,y,z\n0,1e-400,2,3\n").position[0].x(), 0);
  expect_refused("t,x,y,z\n0,1e400,2,3\n", ":2", "column x: '1e400' is not a finite number");
}

TEST(Csv, NamesTheFileLineAndColumnOfEveryFault) {
  const std::string header = "t,x,y,z\n";
  expect_refused("", "", "is empty; a path has a header t,x,y,z");
  expect_refused("# only\n\n", "", "is empty; a path has a header t,x,y,z");
  expect_refused("0,1,2,3\n1,1,2,3\n", ":1",
                 "there is no header; the first line must name the columns, as in t,x,y,z; found '0,1,2,3'");
  expect_refused("t,x,y\n0,1,2\n", ":1",
                 "the header lacks z; it must name t,x,y,z, separated by comma, semicolon or tab; found 't,x,y'");
  expect_refused("#\nclock,x,y,z\n0,1,2,3\n", ":2", "the header lacks t;");
  expect_refused("t x y z\n0 1 2 3\n", ":1", "found 't x y z'");
  expect_refused("t,x,y,z,T\n0,1,2,3,4\n", ":1", "the header names the column t twice");
  expect_refused("\xFF\xFEt", ":1", "the text is UTF-16; save it as UTF-8 or ASCII");
  expect_refused(header, ":1", "there is a header but no row");
  expect_refused(header + "0,1,2,3\n1,1,abc,3\n", ":3", "column y: 'abc' is not a number");
  expect_refused(header + "0,1,2,3x\n", ":2", "column z: '3x' is not a number");
  expect_refused(header + "0,1,,3\n", ":2", "column y: the field is empty");
  expect_refused(header + "0,nan,2,3\n", ":2", "column x: 'nan' is not a finite number");
  expect_refused(header + "0,1,2,-inf\n", ":2", "column z: '-inf' is not a finite number");
  expect_refused(header + "0,1,2\n", ":2", "3 columns where the header has 4");
  expect_refused(header + "0,1,2,3,4\n", ":2", "5 columns where the header has 4");
  expect_refused(header + "0,1,2,3\n0,1,2,3\n", ":3", "column t: 0 s is in line 2 as well; time stamps must increase");
  expect_refused(header + "0,1,2,3\n2,1,2,3\n1.5,1,2,3\n", ":4",
                 "column t: 1.5 s comes after 2 s in line 3; time stamps must increase");
  expect_refused(header + "0,1,2,3\n\n1,1,2,3\n", ":4", "line 3 is blank, but rows follow it");
  expect_refused("t;x;y;z\n0;0,25;2.5;3\n", ":2",
                 "column y: '2.5' has a decimal point, but numbers from line 2 on have a");
  expect_refused(header + "0,0,0,25,0,3,0,1\n", ":2",
                 "numbers need a decimal point, or semicolons between the columns");
  expect_refused(std::string("t,x,y,z\n0,1,2,\0\n", 16), ":2", "column z: '\\x00' is not a number");
  expect_refused(header + std::string(3 << 20, 'x'), ":2", "the line is longer than 1 MiB; is this CSV?");
}

TEST(LoadPath, SaysWhyAFileCannotBeRead) {
  const TempFolder folder;
  expect_error([&] { load_path(folder / "absent.csv"); }, Error::Kind::input,
               {folder / "absent.csv" + ": no such file"});
  expect_error([&] { load_path(folder.path()); }, Error::Kind::input, {"is a folder"});
  expect_error([&] { load_path(folder.write("a.h5", "t,x,y,z\n0,1,2,3\n")); }, Error::Kind::input,
               {"is not an HDF5 file"});
}

TEST(LoadPath, RefusesASizeThatCanOnlyBeAUnitMistake) {
  expect_refused("t,x,y,z\n0,0,0,0\n1,80,0,0\n", ":3", "millimetres");
}

TEST(LoadPath, NotesIrregularTimeStamps) {
  EXPECT_EQ(notes_of(load_text("t,x,y,z\n0,0,0,0\n0.001,0,0,0\n0.002,0,0,0\n0.003,0,0,0\n")), "");

  std::string milliseconds = "t,x,y,z\n";
  for (int i = 0; i < 30; ++i) milliseconds += std::to_string(i) + ",0,0,0\n";
  EXPECT_EQ(notes_of(load_text(milliseconds)),
            "the median step of time is 1 s; is t in milliseconds? It was read as seconds\n");

  EXPECT_EQ(
      notes_of(load_text("t,x,y,z\n0,0,0,0\n0.001,0,0,0\n0.002,0,0,0\n0.004,0,0,0\n0.005,0,0,0\n0.015,0,0,0\n")),
      "time stamps are uneven and kept as they are: 333.3 Hz on average, commonest steps 1 ms (60 %), 10 ms (20 %), "
      "2 ms (20 %); 1 gap longer than 5 median steps, the longest 0.01 s before sample 6\n");
}

TEST(LoadPath, NotesAForceSensorThatIsSlowerThanTheSamples) {
  std::string held = "t,x,y,z,fx,fy,fz\n", live = held;
  for (int i = 0; i < 20; ++i) {
    const std::string row = std::to_string(i) + "e-3," + std::to_string(i) + "e-2,0,0,0,0,";
    held += row + std::to_string(i / 2 + 1) + "\n";
    live += row + std::to_string(i + 1) + "\n";
  }
  EXPECT_EQ(notes_of(load_text(held)),
            "the force stays the same in 53 % of the steps in which the position moves: its sensor is slower than the "
            "samples, about 474 new values a second\n");
  EXPECT_EQ(notes_of(load_text(live)), "");
}

class PathRoundTrip : public testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(EveryFormat, PathRoundTrip, testing::Values("a.csv", "a.h5", "A.CSV", "a.HDF5"));

TEST_P(PathRoundTrip, KeepsEveryBit) {
  for (const std::size_t rows : {1U, 2U, 5000U})
    for (int columns = 0; columns < 4; ++columns) {
      const TempFolder folder;
      const Path path = random_path(static_cast<unsigned>(rows), rows, (columns & 1) != 0, (columns & 2) != 0);
      save_path(path, folder / GetParam(), "a title", false);
      const Path read = load_path(folder / GetParam());
      ASSERT_EQ(read.size(), path.size());
      EXPECT_EQ(read.time, path.time);
      EXPECT_EQ(read.position, path.position);
      EXPECT_EQ(read.velocity, path.velocity);
      EXPECT_EQ(read.force, path.force);
      EXPECT_EQ(read.name, folder / GetParam());
    }
}

TEST_P(PathRoundTrip, RefusesToReplaceAFileUnlessAllowed) {
  const TempFolder folder;
  const std::string file = folder.write(GetParam(), "precious");
  const Path path = random_path(1, 10, false, false);
  expect_error([&] { save_path(path, file, "", false); }, Error::Kind::input, {file + ": exists already"});
  EXPECT_EQ(read_bytes(file), "precious");
  save_path(path, file, "", true);
  EXPECT_EQ(load_path(file).position, path.position);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1);
}

TEST(SavePath, MakesACompleteRecordingWithoutFindings) {
  const TempFolder folder;
  const Path path = random_path(2, 1000, true, false);
  save_path(path, folder / "a.h5", "a title", false);
  const RecordingReader reader(folder / "a.h5");
  EXPECT_EQ(reader.header().title, "a title");
  EXPECT_EQ(reader.header().clock, "virtual");
  EXPECT_NEAR(reader.header().rate_hz, 999 / path.duration(), 1e-9);
  EXPECT_TRUE(reader.header().complete);
  for (const Sample& sample : reader.read(990, 10)) EXPECT_EQ(sample.phase, Phase::run);
  EXPECT_EQ(reader.read(999, 1)[0].tick, 999U);
  for (const Finding& finding : check_recording(folder / "a.h5"))
    ADD_FAILURE() << finding.where << ": " << finding.what;
}

TEST(SavePath, RefusesUnknownEndingsInvalidPathsAndStepsBelowANanosecond) {
  const TempFolder folder;
  Path path = random_path(3, 3, false, false);
  expect_error([&] { save_path(path, folder / "a.txt", "", false); }, Error::Kind::input,
               {"a.txt: a path is written as .csv or .h5"});
  expect_error([&] { save_path(path, folder / "no/a.csv", "", false); }, Error::Kind::input,
               {"folder ", "does not exist"});
  path.time = {0, 1e-10, 2e-10};
  expect_error([&] { save_path(path, folder / "a.h5", "", false); }, Error::Kind::input,
               {"sample 2", "less than 1 ns"});
  expect_error([&] { save_path(Path{}, folder / "a.csv", "", false); }, Error::Kind::input, {"no samples"});
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(LoadPath, TakesOnlyPhaseRunOfASession) {
  const TempFolder folder;
  std::vector<Sample> session = random_session(4, 300, {});
  for (std::size_t i = 0; i < session.size(); ++i)
    session[i].phase = i < 100 ? Phase::approach : i < 250 ? Phase::run : Phase::hold;
  write_recording(folder / "a.h5", session);
  const Path path = load_path(folder / "a.h5");
  ASSERT_EQ(path.size(), 150U);
  EXPECT_EQ(path.position.front(), session[100].position);
  EXPECT_EQ(path.force.back(), session[249].force);
  EXPECT_EQ(notes_of(path), "150 of 300 samples are in phase run; the others were left out\n");
  for (Sample& sample : session) sample.phase = Phase::idle;
  write_recording(folder / "b.h5", session);
  EXPECT_EQ(load_path(folder / "b.h5").size(), 300U);
}

TEST(LoadPath, NotesAnUnfinishedRecordingAndIncompleteVelocities) {
  const TempFolder folder;
  std::vector<Sample> session = random_session(5, 30, {});
  for (Sample& sample : session) sample.phase = Phase::run;
  session[3].velocity = nan3();
  {
    RecordingWriter writer(folder / "a.h5", {}, {}, {});
    writer.append(session);
  }
  const Path path = load_path(folder / "a.h5");
  EXPECT_TRUE(path.velocity.empty());
  EXPECT_EQ(path.force.size(), 30U);
  EXPECT_EQ(notes_of(path),
            "the recording was not finished; the samples in the file were read\nvelocity left out: 1 of 30 samples "
            "lack it\n");
}

TEST(SampleStroke, MatchesItsDescription) {
  const Path path = load_path(HAPTRACE_SAMPLES "/paths/stroke.csv");
  const nlohmann::json said = load_json(HAPTRACE_SAMPLES "/paths/stroke.json");
  EXPECT_EQ(path.size(), said["rows"]);
  EXPECT_DOUBLE_EQ(path.duration(), said["duration_s"]);
  EXPECT_DOUBLE_EQ(static_cast<double>(path.size() - 1) / path.duration(), said["mean_rate_hz"]);
  const Box box = path.bounds();
  double gap = 0, speed = 0, force = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (i > 0) gap = std::max(gap, path.time[i] - path.time[i - 1]);
    speed = std::max(speed, path.velocity[i].norm());
    force = std::max(force, path.force[i].norm());
  }
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_EQ(box.min[axis], said["bounds_m"]["min"][static_cast<std::size_t>(axis)]);
    EXPECT_EQ(box.max[axis], said["bounds_m"]["max"][static_cast<std::size_t>(axis)]);
  }
  EXPECT_NEAR(gap, said["longest_gap_s"], 1e-9);
  EXPECT_NEAR(speed, said["max_speed_m_s"], 1e-12);
  EXPECT_NEAR(force, said["max_force_n"], 1e-12);
}

}  // namespace
}  // namespace haptrace
