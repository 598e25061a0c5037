// CSV files of other programs: recognised columns, noted assumptions, and files that need an option.
#include "formats/path/csv_header.h"
#include "formats/path/csv_names.h"
#include "formats/path/csv_stamp.h"
#include "formats/path/path_file.h"
#include "formats/recording/recording_stream.h"
#include "tests/formats/support.h"

#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

Path read_foreign(const std::string& text, const CsvOptions& csv = {}) {
  const TempFolder folder;
  return load_path(folder.write("a.csv", text), csv);
}

CsvOptions asking(const std::string& columns, const std::string& units = "") {
  CsvOptions options{.columns = {}, .units = units, .name = ""};
  if (!columns.empty()) add_columns(options.columns, columns);
  return options;
}

void expect_foreign_refused(const std::string& text, std::initializer_list<std::string> parts,
                            const CsvOptions& csv = {}) {
  const TempFolder folder;
  const std::string file = folder.write("a.csv", text);
  expect_error([&] { (void)load_path(file, csv); }, Error::Kind::input, parts);
  expect_error(
      [&] {
        const auto source = open_source(file, {.csv = csv});
        while (!source->next().empty()) {
        }
      },
      Error::Kind::input, parts);
}

void expect_note(const Path& path, const std::string& part) {
  for (const std::string& note : path.notes)
    if (note.find(part) != std::string::npos) return;
  ADD_FAILURE() << "no note holds: " << part << "\nnotes: " << fmt::format("{}", fmt::join(path.notes, "\n       "));
}

/// Expects the two rows of every file below: (0 s; 1, 2, 3 mm) and (10 ms; 1.5, -2, 3 mm).
void expect_two_rows(const Path& path) {
  ASSERT_EQ(path.size(), 2U);
  EXPECT_NEAR(path.time[1] - path.time[0], 0.01, 1e-12);
  EXPECT_NEAR((path.position[0] - Vec3(1e-3, 2e-3, 3e-3)).norm(), 0, 1e-15);
  EXPECT_NEAR((path.position[1] - Vec3(1.5e-3, -2e-3, 3e-3)).norm(), 0, 1e-15);
}

struct ForeignFile {
  const char* name;
  std::string text;
  std::vector<std::string> notes;
};

class ForeignCsv : public testing::TestWithParam<ForeignFile> {};
INSTANTIATE_TEST_SUITE_P(
    Corpus, ForeignCsv,
    testing::Values(
        ForeignFile{"GermanExcel",
                    "sep=;\r\nZeit [ms];X [mm];Y [mm];Z [mm]\r\n0;1,0;2,0;3,0\r\n10;1,5;-2,0;3,0\r\n",
                    {"time is read from 'Zeit [ms]' in ms: the header says so",
                     "position is read from 'X [mm]', 'Y [mm]', 'Z [mm]' in mm: the header says so",
                     "numbers have decimal commas"}},
        ForeignFile{"Pandas",
                    ",timestamp,pos_x,pos_y,pos_z,label\n"
                    "0,2026-01-31 12:00:00.990000+01:00,0.001,0.002,0.003,\"a, b\"\n"
                    "1,2026-01-31 12:00:01+01:00,0.0015,-0.002,0.003,\"say \"\"hi\"\"\"\n",
                    {"time is read from 'timestamp' as dates and times; time 0 is 2026-01-31T11:00:00.990000000Z",
                     "in metres: no unit is stated", "columns left out: label"}},
        ForeignFile{"LabView",
                    "Time\tPosition X (mm)\tPosition Y (mm)\tPosition Z (mm)\t\n"
                    "12:00:00,990\t1,000\t2,000\t3,000\t\n12:00:01,000\t1,500\t-2,0E+0\t3,000\t\n",
                    {"as times of day; time 0 is 12:00:00,990"}},
        ForeignFile{"MatlabWritetable",
                    "Time,Position_1,Position_2,Position_3\ns,mm,mm,mm\n0.5,1,2,3\n0.51,1.5,-2,3\n",
                    {"position is read from 'Position_1', 'Position_2', 'Position_3' in mm: the row of units says so"}},
        ForeignFile{"RosTopicEcho",
                    "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.pose.position.x,field.pose."
                    "position.y,"
                    "field.pose.position.z,field.pose.orientation.x,field.pose.orientation.y,"
                    "field.pose.orientation.z,field.pose.orientation.w\n"
                    "1700000000123456789,7,1700000000123456700,map,0.001,0.002,0.003,0,0,0,1\n"
                    "1700000000133456789,8,1700000000133456700,map,0.0015,-0.002,0.003,0,0,0,1\n",
                    {"time is read from 'time' in ns: its stamps are too large for seconds",
                     "time 0 is the first stamp, 1700000000123456789", "the comment in line 1 is read as the header"}},
        ForeignFile{"NumpySavetxt",
                    "# t, x, y, z\n0,0.001,0.002,0.003\n1e-2,1.5e-3,-2e-3,3e-3\n\n",
                    {"the comment in line 1 is read as the header"}},
        ForeignFile{"Unity",
                    "TimeMs,HandPosX,HandPosY,HandPosZ\n100,0.001,0.002,0.003,\n110,0.0015,-0.002,0.003,\n",
                    {"time is read from 'TimeMs' in ms"}},
        ForeignFile{"TitleLines",
                    "Trial 7; subject 3\nsome device, serial 4\n\ntime_us;x_um;y_um;z_um\n0;1000;2000;3000\n"
                    "% a pause\n10000;1500;-2000;3000\n",
                    {"the header is line 4; the lines before it were ignored"}},
        ForeignFile{"DateAndTime",
                    "Date,Time,X (cm),Y (cm),Z (cm)\n31.01.2026,23:59:59.995,0.1,0.2,0.3\n"
                    "01.02.2026,00:00:00.005,0.15,-0.2,0.3\n",
                    {"time is read from 'Time' and 'Date' as dates and times"}},
        ForeignFile{"QuotedDecimalCommas",
                    "\"t\",\"x_mm\",\"y_mm\",\"z_mm\"\n\"0,00\",\"1,0\",\"2,0\",\"3,0\"\n"
                    "\"0,01\",\"1,5\",\"-2,0\",\"3,0\"\n",
                    {"numbers have decimal commas"}},
        ForeignFile{"ByteOrderMark", "\xEF\xBB\xBFTIME (S),x_mm,y_mm,z_mm\n0,1,2,3\n.01,1.5,-2,3\n", {}},
        ForeignFile{"Latin1Header",
                    "t [\xB5s];L\xE4nge;x_mm;y_mm;z_mm\n0;1;1;2;3\n10000;1;1.5;-2;3\n",
                    {"time is read from 't [\\xb5s]' in us", "columns left out: L\\xe4nge"}},
        ForeignFile{"Motive2",
                    "Format Version,1.23,Take Name,Take 1,Capture Frame Rate,100.000000,Rotation Type,Quaternion,"
                    "Length Units,Millimeters,Coordinate Space,Global\n\n"
                    ",Type,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,"
                    "Marker,Marker,Marker\n"
                    ",Name,Hand,Hand,Hand,Hand,Hand,Hand,Hand,Hand,Tip,Tip,Tip\n"
                    ",ID,1,1,1,1,1,1,1,1,2,2,2\n"
                    ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Mean Marker Error,Position,"
                    "Position,Position\n"
                    "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,,X,Y,Z\n"
                    "0,0.000000,0,0,0,1,1,2,3,0.0001,9,9,9\n"
                    "1,0.005000,,,,,,,,,9,9,9\n"
                    "2,0.010000,0,0,0,1,1.5,-2,3,0.0001,,,\n",
                    {"a Motive export: the path is that of 'Hand'; choose another with --columns x=NAME: Tip",
                     "in mm: its Length Units say so", "1 of 3 rows have no position"}},
        ForeignFile{"Motive3",
                    "Format Version,1.24,Take Name,\"Take, 1\",Length Units,Meters\n"
                    "\n"
                    ",Type,Marker,Marker,Marker\n,Name,S:Marker1,S:Marker1,S:Marker1\n,ID,a:1,a:1,a:1\n"
                    ",Parent,S,S,S\n,,Position,Position,Position\nFrame,Time (Seconds),X,Y,Z\n"
                    "0,0,0.001,0.002,0.003\n1,0.01,0.0015,-0.002,0.003\n",
                    {"the path is that of 'S:Marker1'"}}),
    [](const auto& tested) { return std::string(tested.param.name); });

TEST_P(ForeignCsv, IsReadAsAPathAndReportsItsAssumptions) {
  const Path path = read_foreign(GetParam().text);
  expect_two_rows(path);
  for (const std::string& note : GetParam().notes) expect_note(path, note);
}

TEST_P(ForeignCsv, IsConvertedToARecordingThatIsValidAndTheSame) {
  const TempFolder folder;
  const std::string file = folder.write("a.csv", GetParam().text);
  const auto source = open_source(file);
  const auto sink = create_sink(folder / "a.h5", source->header(), source->columns(), source->events(), {});
  EXPECT_EQ(copy(*source, *sink), 2U);
  sink->finish();
  for (const Finding& finding : check_recording(folder / "a.h5"))
    ADD_FAILURE() << finding.where << ": " << finding.what;
  expect_two_rows(load_path(folder / "a.h5"));
}

TEST_P(ForeignCsv, MayEndItsLinesInAnyWay) {
  std::string text;
  for (const char c : GetParam().text)
    if (c == '\n')
      text += "\r\n";
    else if (c != '\r')
      text += c;
  expect_two_rows(read_foreign(text + "\r\n"));
  while (text.ends_with('\n') || text.ends_with('\r')) text.pop_back();
  expect_two_rows(read_foreign(text));
}

TEST_P(ForeignCsv, IsRefusedWithAMessageWhereverItIsCutOff) {
  const std::string& text = GetParam().text;
  const TempFolder folder;
  for (std::size_t length = 0; length < text.size(); length += 3) {
    const std::string file = folder.write("a.csv", text.substr(0, length));
    try {
      (void)load_path(file);
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), Error::Kind::input);
      EXPECT_NE(std::string_view(error.what()).find(file), std::string_view::npos) << error.what();
    }
  }
}

TEST(ForeignCsvColumns, AreRecognisedByManyNames) {
  const auto cell = [](std::string_view name) {
    const CsvName read = read_csv_name(name, false);
    return read.cell == CsvName::kUnknown ? std::string("unknown") : std::string(cell_names()[read.cell]);
  };
  for (const char* name : {"t", "TIME", "Timestamp", "time (s)", "time [ms]", "Time_ns", "time_stamp", "elapsed time",
                           "Time (Seconds)", "seconds", "field.header.stamp", "date/time", "timestampMs"})
    EXPECT_EQ(cell(name), "t") << name;
  for (const char* name : {"x", "X", "pos_x", "position_x", "PosX", "posx", "x_mm", "X [mm]", "position x (m)", "px",
                           "Position.x", "x position", "hand_x", "field.pose.position.x", "Tip Pos X (mm)"})
    EXPECT_EQ(cell(name), "x") << name;
  for (const char* name : {"vy", "vel_y", "velocity y [mm/s]", "vy_mm_s", "twist.linear.y", "Y Velocity"})
    EXPECT_EQ(cell(name), "vy") << name;
  for (const char* name : {"fz", "Force_Z", "fz_N", "F z (mN)", "wrench.force.z", "forceZ"})
    EXPECT_EQ(cell(name), "fz") << name;
  for (const char* name : {"qw", "quat.w", "Quaternion W", "orientation_w", "rotation w"})
    EXPECT_EQ(cell(name), "qw") << name;
  for (const char* name : {"", "w", "index", "box", "max", "acc_x", "target_x", "twist.angular.x", "x_error",
                           "pressure", "reaction time", "left_x", "m_x", "desired pos x", "123", "frame", "time_x"})
    EXPECT_EQ(cell(name), "unknown") << name;
}

TEST(ForeignCsvColumns, AreChosenByTheUserAndMissingOnesAreReported) {
  const std::string text = "clock,\"a, b\",b,c\n0,1,2,3\n10,1.5,-2,3\n";
  expect_two_rows(read_foreign(text, asking("t=clock,x=a, b,y=b,z=c", "mm,ms")));
  expect_foreign_refused(
      text, {"a.csv:1: the header lacks t, x, y, z;", "name the columns with --columns t=NAME,x=NAME,y=NAME,z=NAME"});
  expect_foreign_refused(text, {":1: --columns t=klock: the file has no column 'klock'; it has clock, a, b, b, c"},
                         asking("t=klock,x=b"));
  expect_foreign_refused(text, {"--columns y=b: another column uses the same column of the file"},
                         asking("t=clock,x=b,y=b,z=c"));
  expect_error([] { (void)asking("q=a"); }, Error::Kind::input, {"--columns q=...: haptrace has no column 'q'"});
  expect_error([] { (void)asking("x"); }, Error::Kind::input, {"--columns x: write it as COLUMN=NAME"});
  expect_error([] { (void)asking("x=a,x=b"); }, Error::Kind::input, {"column x is given twice"});
  expect_error([] { (void)asking("x="); }, Error::Kind::input, {"the name of the file's column for x is missing"});
  // The most certain of several matches wins, and a named column wins over a recognised one.
  EXPECT_EQ(read_foreign("t,x,y,z,tip_pos_x,tip_pos_y,tip_pos_z\n0,1,2,3,4,4,4\n").position[0], Vec3(1, 2, 3));
  EXPECT_EQ(read_foreign("t,x,y,z,tip_pos_x,tip_pos_y,tip_pos_z\n0,1,2,3,4,4,4\n", asking("x=tip_pos_x")).position[0],
            Vec3(4, 2, 3));
  expect_foreign_refused("t,Pos X,pos_x,y,z\n0,1,2,3,4\n",
                         {"x twice, as 'Pos X' and 'pos_x'; choose one with --columns x=NAME"});
  EXPECT_EQ(read_foreign("t,Pos X,pos_x,y,z\n0,1,2,3,4\n", asking("x=pos_x")).position[0], Vec3(2, 3, 4));
}

TEST(ForeignCsvColumns, OfAMotiveExportBelongToTheRequestedBody) {
  const std::string text =
      "Format Version,1.23,Take Name,T\n\n,Type,Rigid Body,Rigid Body,Rigid Body,Marker,Marker,Marker\n"
      ",Name,Hand,Hand,Hand,Tip,Tip,Tip\n,ID,1,1,1,2,2,2\n,,Position,Position,Position,Position,Position,Position\n"
      "Frame,Time (Seconds),X,Y,Z,X,Y,Z\n0,0,9,9,9,1,2,3\n1,0.01,9,9,9,1.5,-2,3\n";
  expect_two_rows(read_foreign(text, asking("x=Tip", "mm")));
  expect_foreign_refused(text, {":8: column x ('Hand.Position.X'): 9 m is farther", "--units mm"});
  expect_foreign_refused(text, {"the file has no column 'Foot'"}, asking("x=Foot"));
  expect_foreign_refused("Format Version,1.23\n1,2,3\n", {"a Motive export has a row Frame,Time (Seconds)"});
  const Path angles = read_foreign(
      "Format Version,1.23\n\n,Type,Rigid Body\n,Name,A,A,A,A,A,A\n,ID,1,1,1,1,1,1\n"
      ",,Rotation,Rotation,Rotation,Position,Position,Position\nFrame,Time (Seconds),X,Y,Z,X,Y,Z\n0,0,90,0,0,1,2,3\n");
  EXPECT_EQ(angles.position[0], Vec3(1, 2, 3));
  expect_note(angles, "its rotation is in angles and is not read");
  const std::string lost =
      "Format Version,1.23\n\n,Type,Marker,Marker,Marker\n,Name,A,A,A\n,ID,1,1,1\n"
      ",,Position,Position,Position\nFrame,Time (Seconds),X,Y,Z\n0,0,,,\n";
  expect_foreign_refused(lost, {"no row has a position"});
}

TEST(ForeignCsvUnits, OfTheUserTakePrecedenceWithANote) {
  const Path path = read_foreign(
      "time_s,x_m,y_m,z_m,vx,vy,vz,Fx (mN),Fy (mN),Fz (mN)\n0,1,2,3,1000,0,0,500,0,0\n"
      "10,1.5,-2,3,1000,0,0,500,0,0\n",
      asking("", "mm,ms"));
  expect_two_rows(path);
  EXPECT_EQ(path.velocity[0], Vec3(1, 0, 0)) << "as the positions are in mm";
  EXPECT_EQ(path.force[0], Vec3(0.5, 0, 0));
  expect_note(path, "--units states position in mm, but the file states m; --units takes precedence");
  expect_note(path, "--units states time in ms, but the file states s; --units takes precedence");
  expect_note(path, "velocity is read from 'vx', 'vy', 'vz' in mm/s: the positions are in that unit");
  expect_error([] { check(asking("", "furlong")); }, Error::Kind::input,
               {"--units furlong: 'furlong' is not a known unit"});
  expect_error([] { check(asking("", "mm,cm")); }, Error::Kind::input, {"two units of one quantity"});
  expect_error([] { check(asking("", "mm,,ms")); }, Error::Kind::input, {"'' is not a known unit"});
  expect_foreign_refused("t;x;y;z\ns;px;px;px\n0;1;2;3\n", {"column 'x' is in 'px'", "--units"});
  expect_foreign_refused("t,x [px],y [px],z [px]\n0,1,2,3\n", {"column 'x [px]' is in 'px'"});
  EXPECT_EQ(read_foreign("t,x [px],y [px],z [px]\n0,1,2,3\n", asking("", "cm")).position[0], Vec3(0.01, 0.02, 0.03));
}

TEST(ForeignCsvUnits, OfHaptracesOwnNamesAreMetresAndSecondsWithoutANote) {
  const Path path = read_foreign("t,x,y,z\n0,1,2,3\n0.01,1.5,-2,3\n");
  EXPECT_TRUE(path.notes.empty()) << path.notes.front();
  EXPECT_EQ(path.position[1], Vec3(1.5, -2, 3));
}

TEST(ForeignCsvUnits, AreRequiredForPositionsThatAHandDeviceCannotReach) {
  expect_foreign_refused("t,x,y,z\n0,0,0,0\n1,50,0,0\n",
                         {"a.csv:3: column x: 50 m is farther than a hand device reaches", "Use --units mm"});
  expect_foreign_refused("time;Pos X;Pos Y;Pos Z\n0;0;0;-5,1\n", {"column z ('Pos Z'): -5.1 m is farther"});
  EXPECT_EQ(read_foreign("t,x,y,z\n0,0,0,0\n1,50,0,0\n", asking("", "mm")).position[1], Vec3(0.05, 0, 0));
  EXPECT_EQ(read_foreign("t,x,y,z\n0,0,0,0\n1,6,0,0\n", asking("", "m")).position[1], Vec3(6, 0, 0));
  EXPECT_EQ(read_foreign("t,x [m],y [m],z [m]\n0,0,0,0\n1,6,0,0\n").position[1], Vec3(6, 0, 0));
}

TEST(ForeignCsvTime, NeedsAUnitIfItsStepsDoNotFitAMovementInSeconds) {
  const auto log = [](double step, double speed) {
    std::string text = "t,x,y,z\n";
    for (int i = 0; i < 50; ++i) text += fmt::format("{},{},0,0\n", step * i, speed * i);
    return text;
  };
  expect_foreign_refused(log(1, 2e-4), {"two rows would be 1 s apart. Are these milliseconds? Use --units ms"});
  expect_foreign_refused(log(16, 1e-3), {"Are these milliseconds?"});
  expect_foreign_refused(log(1000, 0), {"Are these microseconds? Use --units us"});
  expect_foreign_refused(log(1e6, 0), {"Are these nanoseconds? Use --units ns"});
  EXPECT_NEAR(read_foreign(log(1, 2e-4), asking("", "ms")).duration(), 0.049, 1e-12);
  EXPECT_EQ(read_foreign(log(1, 2e-4), asking("", "s")).duration(), 49);
  EXPECT_EQ(read_foreign(log(1, 0.02)).duration(), 49) << "a hand that is sampled once a second";
  EXPECT_EQ(read_foreign(log(1, 0)).duration(), 49) << "a hand that rests";
}

TEST(ForeignCsvTime, KeepsEveryNanosecondOfStampsSince1970) {
  for (const char* stamps : {"timestamp\n1700000000.123456789\n1700000000.123456790\n",
                             "timestamp_ms\n1700000000123.456789\n1700000000123.456790\n",
                             "timestamp_us\n1700000000123456.789\n1700000000123456.790\n",
                             "timestamp\n1700000000123456789\n1700000000123456790\n",
                             "timestamp\n2023-11-14T22:13:20.123456789Z\n2023-11-14T22:13:20.123456790Z\n"}) {
    std::string text = stamps;
    for (std::size_t at = text.find('\n'), line = 0; at != std::string::npos; at = text.find('\n', at + 1), ++line) {
      const std::string rest = line == 0 ? ",x,y,z" : ",0,0,0";
      text.insert(at, rest);
      at += rest.size();
    }
    const Path path = read_foreign(text);
    ASSERT_EQ(path.size(), 2U) << text;
    EXPECT_EQ(path.time[0], 0) << text;
    EXPECT_EQ(path.time[1], 1e-9) << text;
  }
}

TEST(ForeignCsvTime, WithAZoneIsPutIntoUtc) {
  for (const char* text : {"2026-03-01T12:00:00Z", "2026-03-01T14:00:00+0200", "2026-03-01T14:00:00+02:00",
                           "2026-03-01T14:00:00.123456+02:00", "2026-03-01 14:00:00,5 +0200",
                           "2026-03-01T06:30:00-05:30", "2026-02-28T23:00:00-13"})
    EXPECT_EQ(parse_date_stamp(text, true).value_or(0) / 1'000'000'000, 1'772'366'400) << text;
  EXPECT_EQ(parse_date_stamp("2026-01-01T00:30:00+01:00", true), 1'767'223'800'000'000'000);
}

TEST(ForeignCsvTime, MayBeRequiredToNameItsZone) {
  for (const char* text : {"", "yesterday", "2026-03-01", "2026-03-01T12:00:00", "2026-03-01T12:00:00.5",
                           "2026-13-01T12:00:00Z", "2026-03-01T12:00:00Z and more", "2026-03-01T12:00:00+2:x"})
    EXPECT_EQ(parse_date_stamp(text, true), std::nullopt) << text;
}

TEST(ForeignCsvTime, IsReadFromDatesInManyForms) {
  const std::int64_t expected = 1769857200'123'000'000;  // 2026-01-31 11:00:00.123 UTC
  for (const char* text : {"2026-01-31T11:00:00.123Z", "2026-01-31t11:00:00.123z", "2026-01-31 11:00:00.123",
                           "2026/01/31 11:00:00.123", "2026-01-31T12:00:00.123+01:00", "2026-01-31T12:00:00.123+0100",
                           "2026-01-31T12:00:00,123+01", "20260131T110000.123Z", "31.01.2026 11:00:00,123",
                           "2026-01-31 11:00:00.123 UTC", "2026-01-31T06:30:00.123-04:30"})
    EXPECT_EQ(parse_date_stamp(text).value_or(0), expected) << text;
  for (const char* text :
       {"", "2026-02-30T00:00:00Z", "2026-01-31", "2026-01-31T25:00:00", "2026-01-31T11:60:00", "2026-01-31T11:00:00.",
        "2026-01-31T11:00:00x", "31.13.2026 11:00:00", "9999-01-01T00:00:00", "2026-01-31T11:00:00+1", "11:00:00"})
    EXPECT_FALSE(parse_date_stamp(text).has_value()) << text;
  EXPECT_EQ(parse_clock_stamp("01:02:03.5").value_or(0), 3'723'500'000'000);
  EXPECT_FALSE(parse_clock_stamp("24:00:00").has_value());
  EXPECT_EQ(parse_decimal_stamp("-0.000000001", 1).value_or(0), -1);
  EXPECT_FALSE(parse_decimal_stamp("99999999999999999999", 1).has_value());
  expect_foreign_refused("time,x,y,z\n2026-01-31T11:00:00Z,0,0,0\n2026-01-31T11:00:61Z,0,0,0\n",
                         {":3: column t ('time'): '2026-01-31T11:00:61Z' is not a date and time"});
  expect_foreign_refused("time,x,y,z\n1700-01-31T11:00:00Z,0,0,0\n2250-01-31T11:00:10Z,0,0,0\n", {"over 290 years"});
}

TEST(ForeignCsvRows, AreRefusedWithTheirOwnTextInTheMessage) {
  expect_foreign_refused("t;x;y;z\n0;1,5;2.5;3\n",
                         {":2: column y: '2.5' has a decimal point, but numbers from line 2"});
  expect_foreign_refused("t;x;y;z\n0;1;2;3\n1;1.000,5;2;3\n", {":3: column x: '1.000,5' is not a number"});
  expect_foreign_refused("t,x,y,z,who\n0,1,2,3,\"a\nb\"\n", {":2: a field in quotes does not end in this line"});
  expect_foreign_refused("time,x,y,z\n", {"there is a header but no row"});
  expect_foreign_refused("time,x,y,z\n0,1,2\n", {":2: 3 columns where the header has 4"});
  expect_foreign_refused("time,x,y,z\n0,1,2,3,4\n", {":2: 5 columns where the header has 4"});
  expect_foreign_refused("time,x,y,z,qw,qx,qy,qz\n0,1,2,3,2,0,0,0\n", {":2: column qw: the quaternion has the norm 2"});
  EXPECT_EQ(read_foreign("time,x,y,z\n0,1,2,3,\n0.1,1,2,3,,,\n").size(), 2U) << "separators behind the last field";
  EXPECT_EQ(read_foreign("time,x,y,z\n# here\n0,-1e-1,+2.5E-1,.3\n").position[0], Vec3(-0.1, 0.25, 0.3));
  EXPECT_EQ(read_foreign("t,x,y,z\n0,1,2,3\n").size(), 1U);
}

TEST(ForeignCsvRows, WithoutAVelocityOrForceMakeARecordingWithoutOneThatIsValid) {
  const TempFolder folder;
  const std::string file = folder.write("a.csv",
                                        "time,x,y,z,vx,vy,vz,fx,fy,fz,qw,qx,qy,qz\n0,0,0,0,1,1,1,1,1,1,1,0,0,0\n"
                                        "0.1,0,0,0,,,,,,,,,,\n0.2,0,0,0,1,,1,1,1,1,1,0,0,0\n");
  const auto source = open_source(file);
  const auto sink = create_sink(folder / "a.h5", source->header(), source->columns(), source->events(), {});
  copy(*source, *sink);
  sink->finish();
  for (const Finding& finding : check_recording(folder / "a.h5"))
    ADD_FAILURE() << finding.where << ": " << finding.what;
  const Path path = load_path(file), converted = load_path(folder / "a.h5");
  EXPECT_TRUE(path.velocity.empty() && path.force.empty());
  EXPECT_TRUE(converted.velocity.empty() && converted.force.empty());
  expect_note(path, "velocity left out: 2 of 3 samples lack it");
  const std::vector<std::string> notes = source->notes();
  EXPECT_NE(std::find(notes.begin(), notes.end(), "velocity left out: 2 of 3 samples lack it"), notes.end());
  EXPECT_TRUE(source->columns().orientation);
}

TEST(ForeignCsvOptions, AreRefusedForOtherFormats) {
  const TempFolder folder;
  write_recording(folder / "a.h5", random_session(1, 10, {}));
  expect_error([&] { (void)load_path(folder / "a.h5", asking("", "mm")); }, Error::Kind::input,
               {"a.h5: is a recording (HDF5); --columns and --units are for CSV"});
  expect_error([&] { (void)open_source(folder / "a.h5", {.csv = asking("", "mm")}); }, Error::Kind::input,
               {"--columns and --units are for CSV"});
}

TEST(ForeignCsvOptions, AreRefusedForRecordingsThatHaptraceWrote) {
  const TempFolder folder;
  std::vector<Sample> session = random_session(3, 40, {});
  for (Sample& sample : session) sample.position *= 1e6;
  const auto sink = create_sink(folder / "a.csv", {}, {}, {}, {});
  sink->append(session);
  sink->finish();
  EXPECT_EQ(open_source(folder / "a.csv")->next()[7].position, session[7].position);
  expect_error([&] { (void)open_source(folder / "a.csv", {.csv = asking("", "mm")}); }, Error::Kind::input,
               {"a.csv: is a recording that haptrace wrote"});
}

TEST(ForeignCsvHostile, IsRefusedWithoutDelay) {
  const TempFolder folder;
  std::mt19937_64 random(4);
  const auto refused = [&](const std::string& text) {
    const std::string file = folder.write("a.csv", text);
    try {
      (void)load_path(file);
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), Error::Kind::input);
      return;
    }
    ADD_FAILURE() << "read: " << text.substr(0, 100);
  };
  std::string bytes(1 << 16, '\0');
  for (int round = 0; round < 20; ++round) {
    for (char& c : bytes) c = static_cast<char>(random());
    refused(bytes);
    refused("time,x,y,z\n" + bytes);
  }
  std::string names, groups;
  for (int i = 0; i < 100'000; ++i) {
    names += "x,";
    groups += fmt::format("a{} pos x,", i);
  }
  refused(names + "\n");
  refused(groups + "\n");
  for (int i = 0; i < 8; ++i) names += names.substr(0, 100'000) + "\n";
  refused(names);
  refused(std::string(1 << 20, '"'));
  refused(std::string(1 << 20, '['));
  refused("t,x,y,z\n" + std::string(900'000, ',') + "\n");
  refused(std::string(3, '\0'));
  refused("Format Version" + std::string(1000, '\n'));
}

}  // namespace
}  // namespace haptrace
