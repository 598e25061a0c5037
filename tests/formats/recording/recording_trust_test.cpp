// Integrity of recordings: changed values on the disk are found, summaries and checksums match the rounded values,
// clock readings are preserved, and other writers are detected.
#include "formats/recording/crash_recovery.h"
#include "formats/recording/recording_stream.h"
#include "tests/formats/support.h"

#include <cstdlib>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <hdf5.h>

namespace haptrace {
namespace {

using testing::Contains;
using testing::HasSubstr;

struct Rot {
  const char* name;
  Storage storage;
  const char* column;
};

void PrintTo(const Rot& rot, std::ostream* out) {
  *out << rot.name << ' ' << rot.column;
}

std::vector<Sample> read_all(const std::string& file) {
  const RecordingReader reader(file);
  return reader.read(0, reader.rows());
}

/// Returns the address and the size of chunk `index` of a dataset in its file.
std::pair<std::uint64_t, std::uint64_t> place_of_chunk(const std::string& file, const std::string& path,
                                                       hsize_t index) {
  const hid_t opened = H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  const hid_t dataset = H5Dopen2(opened, path.c_str(), H5P_DEFAULT);
  const hid_t space = H5Dget_space(dataset);
  hsize_t offset[2] = {}, size = 0;
  unsigned mask = 0;
  haddr_t address = 0;
  H5Dget_chunk_info(dataset, space, index, offset, &mask, &address, &size);
  H5Sclose(space);
  H5Dclose(dataset);
  H5Fclose(opened);
  return {address, size};
}

/// Flips one bit of byte `at`.
void flip(const std::string& file, std::uint64_t at, int bit = 3) {
  std::fstream stream(file, std::ios::binary | std::ios::in | std::ios::out);
  stream.seekg(static_cast<std::streamoff>(at));
  const char byte = static_cast<char>(stream.get());
  stream.seekp(static_cast<std::streamoff>(at));
  stream.put(static_cast<char>(byte ^ (1 << bit)));
}

std::vector<std::string> errors_of(const std::string& file) {
  std::vector<std::string> errors;
  for (const Finding& finding : check_recording(file))
    if (finding.severity == Severity::problem) errors.push_back(finding.where + ": " + finding.what);
  return errors;
}

constexpr RecordingColumns kForces{.reference = true, .guidance = true};

class BitRot : public testing::TestWithParam<Rot> {};

TEST_P(BitRot, IsFoundByReadersAndCheckAndRecoverSavesTheRest) {
  const TempFolder folder;
  const std::string file = folder / "a.h5", path = std::string("/samples/") + GetParam().column;
  const std::vector<Sample> session = random_session(1, 3000, kForces);
  {
    RecordingWriter writer(file, {}, kForces, {.storage = GetParam().storage});
    writer.append(session);
    writer.append(StoredEvent{.time = 1, .code = 50, .text = "mark"});
    writer.finish();
  }
  ASSERT_EQ(errors_of(file), std::vector<std::string>());
  const std::vector<Sample> before = RecordingReader(file).read(0, 3000);
  const auto [address, size] = place_of_chunk(file, path, 2);
  ASSERT_GT(size, 0U);
  flip(file, address + size / 2);

  expect_error([&] { (void)read_all(file); }, Error::Kind::input, {path});
  EXPECT_THAT(errors_of(file), Contains(HasSubstr(path)));
  const Recovery recovery = recover_recording(file);
  EXPECT_TRUE(recovery.needed);
  EXPECT_THAT(recovery.notes, Contains(HasSubstr(path)));
  EXPECT_EQ(errors_of(file), std::vector<std::string>());
  const RecordingReader reader(file);
  EXPECT_EQ(reader.rows() + recovery.unreadable, 3000U);
  EXPECT_LE(recovery.unreadable, 500U);
  // Every row outside the damaged block is unchanged.
  const std::vector<Sample> after = reader.read(0, reader.rows());
  expect_same(std::span(after).first(1000), std::span(before).first(1000));
  expect_same(std::span(after).last(1500), std::span(before).last(1500));
  EXPECT_FALSE(recover_recording(file).needed);
}

TEST(BitRot, InAnyBlockOfAnyColumnLeavesTheRestReadable) {
  const std::vector<Sample> session = random_session(2, 20'001, {});
  for (const char* column : {"time", "tick", "position", "velocity", "force", "latency", "phase"})
    for (const hsize_t block : {0U, 4U, 5U, 8U, 10U}) {  // 4 and 8 span multiples of 8192
      const TempFolder folder;
      const std::string file = folder / "a.h5", path = std::string("/samples/") + column;
      {
        RecordingWriter writer(file, {}, {}, {.storage = {.rows_per_chunk = 2000}});
        writer.append(session);
        writer.finish();
      }
      flip(file, place_of_chunk(file, path, block).first);
      const Recovery recovery = recover_recording(file);
      EXPECT_TRUE(recovery.damaged) << path << block;
      EXPECT_LE(recovery.unreadable, 1U) << path << block;
      EXPECT_EQ(errors_of(file), std::vector<std::string>()) << path << block;
      const RecordingReader reader(file);
      ASSERT_EQ(reader.rows() + recovery.unreadable, session.size()) << path << block;
      // A later check reports the damage and its location.
      bool told = false;
      for (const StoredEvent& event : reader.events())
        if (event.code == static_cast<int>(EventCode::values_lost)) {
          EXPECT_THAT(event.text, HasSubstr(path));
          EXPECT_NEAR(event.time, 1e-9 * static_cast<double>(session[2000 * block].time_ns), 0.1) << path << block;
          told = true;
        }
      EXPECT_TRUE(told) << path << block;
      EXPECT_THAT(check_recording(file), Contains(testing::Field(&Finding::what, HasSubstr("reports damage"))));
    }
}

TEST(BitRot, ThatMakesAPositionImpossibleCostsOneSample) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  write_recording(file, random_session(2, 300, {}));
  flip(file, place_of_chunk(file, "/samples/position", 1).first + 7, 6);  // a bit of the exponent
  const Recovery recovery = recover_recording(file);
  EXPECT_EQ(recovery.unreadable, 1U);
  EXPECT_EQ(RecordingReader(file).rows(), 299U);
  EXPECT_EQ(errors_of(file), std::vector<std::string>());
}

TEST(Checksums, ThatAreZeroInAFinishedFileAreDamage) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  write_recording(file, random_session(2, 300, {}));
  const auto [address, size] = place_of_chunk(file, "/checksums", 0);
  {
    std::fstream stream(file, std::ios::binary | std::ios::in | std::ios::out);
    stream.seekp(static_cast<std::streamoff>(address));
    stream << std::string(size, '\0');
  }
  EXPECT_THAT(errors_of(file), Contains(HasSubstr("has no checksum")));
  expect_error([&] { (void)read_all(file); }, Error::Kind::input, {"has no checksum"});
}

TEST(Recover, MendsImpossibleValuesInAFileWithoutChecksums) {
  for (const double value : {kNaN, 1e300, -5.0, 0.0}) {
    const TempFolder folder;
    const std::string file = folder / "a.h5";
    write_recording(file, random_session(2, 3000, {}));
    {
      const hid_t opened = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
      H5Ldelete(opened, "/checksums", H5P_DEFAULT);
      const hid_t dataset = H5Dopen2(opened, "/samples/time", H5P_DEFAULT);
      const hid_t space = H5Dget_space(dataset), one = H5Screate(H5S_SCALAR);
      const hsize_t row[] = {1000}, count[] = {1};
      H5Sselect_hyperslab(space, H5S_SELECT_SET, row, nullptr, count, nullptr);
      H5Dwrite(dataset, H5T_NATIVE_DOUBLE, one, space, H5P_DEFAULT, &value);
      H5Sclose(one);
      H5Sclose(space);
      H5Dclose(dataset);
      H5Fclose(opened);
    }
    const Recovery recovery = recover_recording(file);
    EXPECT_TRUE(recovery.needed) << value;
    EXPECT_LE(recovery.unreadable, 1U) << value;
    EXPECT_EQ(errors_of(file), std::vector<std::string>()) << value;
    EXPECT_GE(RecordingReader(file).rows(), 2999U) << value;
  }
}

TEST(Recover, RefusesAFormatThatItDoesNotKnow) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  write_recording(file, random_session(2, 30, {}));
  {
    const hid_t opened = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    const hid_t attribute = H5Aopen(opened, "format_version", H5P_DEFAULT), type = H5Aget_type(attribute);
    H5Awrite(attribute, type, "2.0");
    H5Tclose(type);
    H5Aclose(attribute);
    H5Fclose(opened);
  }
  const std::string before = read_bytes(file);
  expect_error([&] { (void)recover_recording(file); }, Error::Kind::input, {"2.0", "newer"});
  EXPECT_EQ(read_bytes(file), before);
}

TEST(Recover, KeepsTheFactThatAPartIsMissing) {
  const TempFolder folder;
  const std::string file = folder / "a.h5", copy = folder / "b.h5";
  {
    RecordingWriter writer(file, {}, {}, {.in_parts = true});
    writer.append(random_session(2, 100, {}));
    writer.start_part();
    writer.finish();
  }
  std::filesystem::remove(part_file(file, 2));
  const Recovery recovery = recover_recording(file, copy);
  EXPECT_TRUE(recovery.damaged);
  expect_error([&] { (void)RecordingReader(copy); }, Error::Kind::input, {part_file(copy, 2), "missing"});
}

TEST(Clocks, OfACutStartAtItsBeginning) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  const std::vector<Sample> session = random_session(2, 3000, {});
  RecordingWriter writer(file, {}, {}, {});
  writer.append(session);
  writer.append(ClockReading{0, 1'800'000'000'000'000'000, 77'000'000'000, 100});
  writer.finish();
  const double from = 1e-9 * static_cast<double>(session[1000].time_ns);
  const auto source = cut(open_source(file), from, 1e9);
  const std::vector<ClockReading> clocks = source->clocks();
  ASSERT_EQ(clocks.size(), 1U);
  EXPECT_EQ(clocks[0].time_ns, 0);
  EXPECT_EQ(clocks[0].realtime_ns, 1'800'000'000'000'000'000 + session[1000].time_ns);
  EXPECT_EQ(clocks[0].monotonic_ns, 77'000'000'000 + session[1000].time_ns);
  EXPECT_EQ(clocks[0].uncertainty_ns, 100 + session[1000].time_ns / 10'000);
}

std::vector<Rot> rots() {
  std::vector<Rot> all;
  for (const char* column : {"time", "tick", "position", "velocity", "force", "reference_force", "phase", "latency"}) {
    all.push_back({"plain", {.rows_per_chunk = 500}, column});
    all.push_back({"packed", {.deflate = 3, .rows_per_chunk = 500}, column});
    all.push_back(
        {"rounded",
         {.deflate = 3, .precision = {.position = 1e-6, .velocity = 1e-4, .force = 1e-3}, .rows_per_chunk = 500},
         column});
  }
  return all;
}
INSTANTIATE_TEST_SUITE_P(Of, BitRot, testing::ValuesIn(rots()), [](const auto& instance) {
  return fmt::format("{}_{}", instance.param.name, instance.param.column);
});

TEST(BitRot, InAPackedTimeCostsNoSampleBecauseTicksGiveTheTime) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  const std::vector<Sample> session = random_session(2, 3000, {});
  {
    RecordingWriter writer(file, {.rate_hz = 1000}, {}, {.storage = {.deflate = 3, .rows_per_chunk = 500}});
    writer.append(session);
    writer.finish();
  }
  const auto [address, size] = place_of_chunk(file, "/samples/time", 3);
  flip(file, address + size / 2);
  const Recovery recovery = recover_recording(file);
  EXPECT_EQ(recovery.unreadable, 0U);
  const std::vector<Sample> rows = RecordingReader(file).read(0, 3000);
  ASSERT_EQ(rows.size(), session.size());
  for (std::size_t i = 0; i < rows.size(); ++i)
    EXPECT_NEAR(static_cast<double>(rows[i].time_ns - session[i].time_ns), 0, 25'000) << i;
}

TEST(BitRot, InAnEventIsFound) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  write_recording(file, random_session(3, 100, {}), {}, {}, {{0.01, 50, "left hand"}});
  const auto [address, size] = place_of_chunk(file, "/events", 0);
  flip(file, address + 14);
  EXPECT_THAT(errors_of(file), Contains(HasSubstr("/events")));
  expect_error([&] { (void)RecordingReader(file).events(); }, Error::Kind::input, {"/events"});
  EXPECT_THAT(recover_recording(file).notes, Contains(HasSubstr("/events")));
  EXPECT_EQ(errors_of(file), std::vector<std::string>());
}

TEST(BitRot, InAClockReadingIsFound) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  {
    RecordingWriter writer(file, {}, {}, {});
    writer.append(random_session(3, 100, {}));
    writer.append(ClockReading{.time_ns = 0, .realtime_ns = 1'800'000'000'000'000'000, .monotonic_ns = 5});
    writer.finish();
  }
  ASSERT_EQ(errors_of(file), std::vector<std::string>());
  flip(file, place_of_chunk(file, "/clocks", 0).first + 9);
  EXPECT_THAT(errors_of(file), Contains(HasSubstr("/clocks")));
  EXPECT_TRUE(RecordingReader(file).clocks().empty()) << "a wrong time is worse than none";
  EXPECT_THAT(recover_recording(file).notes, Contains(HasSubstr("/clocks[0] is lost")));
}

TEST(BitRot, InTheOverviewIsFoundAndTheOverviewIsRecomputed) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  const std::vector<Sample> session = random_session(3, 20'000, {});
  write_recording(file, session, {});
  const double force = summarise(RecordingReader(file)).max_force;
  const auto [address, size] = place_of_chunk(file, "/overview", 0);
  for (std::uint64_t at = 0; at < 3 * size / 64; at += 8) flip(file, address + at + 5);
  EXPECT_THAT(errors_of(file), Contains(HasSubstr("/overview")));
  EXPECT_EQ(summarise(RecordingReader(file)).max_force, force);
  EXPECT_TRUE(recover_recording(file).needed);
  EXPECT_EQ(errors_of(file), std::vector<std::string>());
}

TEST(Recover, SaysWhatItDoesNotCopy) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  write_recording(file, random_session(3, 100, {}));
  const hid_t opened = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT), space = H5Screate(H5S_SCALAR);
  for (const char* path : {"/emg", "/samples/emg"})
    H5Dclose(H5Dcreate2(opened, path, H5T_IEEE_F64LE, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
  H5Aclose(H5Acreate2(opened, "session", H5T_IEEE_F64LE, space, H5P_DEFAULT, H5P_DEFAULT));
  H5Sclose(space);
  H5Fclose(opened);
  flip(file, place_of_chunk(file, "/samples/force", 0).first + 9);
  const std::vector<std::string> notes = recover_recording(file).notes;
  for (const char* path :
       {" /emg belongs to another", " /samples/emg belongs to another", " /@session belongs to another"})
    EXPECT_THAT(notes, Contains(HasSubstr(path)));
  EXPECT_THAT(notes, Not(Contains(HasSubstr("/samples/time"))));
}

TEST(Recover, SavesTheRowsThatEveryColumnHasWhenOneIsTooShort) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  const std::vector<Sample> session = random_session(3, 300, {});
  write_recording(file, session);
  const hid_t opened = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  const hid_t force = H5Dopen2(opened, "/samples/force", H5P_DEFAULT);
  const hsize_t extent[] = {200, 3};
  H5Dset_extent(force, extent);
  H5Dclose(force);
  H5Fclose(opened);
  expect_error([&] { const RecordingReader reader(file); }, Error::Kind::input, {"/samples/force has 200 rows"});
  recover_recording(file);
  EXPECT_EQ(errors_of(file), std::vector<std::string>());
  const std::vector<Sample> rows = RecordingReader(file).read(0, 300);
  ASSERT_EQ(rows.size(), 300U);
  EXPECT_EQ(rows[150].force, session[150].force);
  EXPECT_TRUE(rows.back().force.hasNaN());
  EXPECT_EQ(rows.back().position, session.back().position);
}

class ACutRecording : public testing::TestWithParam<Storage> {};
INSTANTIATE_TEST_SUITE_P(EveryStorage, ACutRecording,
                         testing::Values(Storage{.rows_per_chunk = 100}, Storage{.deflate = 3, .rows_per_chunk = 100}));

TEST_P(ACutRecording, IsSavedUpToTheCut) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(6, 1950, {});
  {
    RecordingWriter writer(folder / "whole.h5", {}, {}, {.storage = GetParam()});
    writer.append(StoredEvent{.time = 0.1, .code = 50, .text = "mark"});
    writer.append(session);
    writer.finish();
  }
  const std::string whole = read_bytes(folder / "whole.h5");
  std::uint64_t most = 0;
  for (std::size_t length = whole.size() - 1; length > 4000; length -= std::min(length, 1 + whole.size() / 83)) {
    SCOPED_TRACE(length);
    const std::string file = folder.write("cut.h5", std::string_view(whole).substr(0, length));
    expect_error([&] { const RecordingReader reader(file); }, Error::Kind::input, {"is cut off: it has"});
    Recovery recovery;
    try {
      recovery = recover_recording(file, folder / "saved.h5", true);
    } catch (const Error& error) {
      EXPECT_LT(length, whole.size() / 3) << error.what();
      EXPECT_EQ(error.kind(), Error::Kind::input);
      continue;
    }
    EXPECT_TRUE(recovery.damaged);
    EXPECT_THAT(recovery.notes, Contains(HasSubstr("is cut off")));
    EXPECT_EQ(errors_of(folder / "saved.h5"), std::vector<std::string>());
    const std::vector<Sample> rows = RecordingReader(folder / "saved.h5").read(0, 2000);
    most = std::max<std::uint64_t>(most, rows.size());
    for (const Sample& row : rows) {
      const auto same =
          std::find_if(session.begin(), session.end(), [&](const Sample& s) { return s.tick == row.tick; });
      ASSERT_NE(same, session.end()) << row.tick;
      EXPECT_EQ(row.position, same->position);
      EXPECT_NEAR(static_cast<double>(row.time_ns - same->time_ns), 0, 25'000);
      EXPECT_TRUE(row.force == same->force || row.force.hasNaN());
      EXPECT_TRUE(row.velocity == same->velocity || row.velocity.hasNaN());
    }
    // The columns of a row are close together in the file, chunk by chunk.
    const double share = static_cast<double>(length) / static_cast<double>(whole.size());
    EXPECT_GE(static_cast<double>(rows.size()), 1950 * (share - 0.5));
  }
  EXPECT_GE(most, 1850U);
}

TEST(Recover, SavesARecordingWhoseConfigurationIsDamaged) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  const std::vector<Sample> session = random_session(4, 2500, {});
  write_recording(file, session, {}, {.title = "kept", .config = {{"rate", 1000}}});
  const hid_t opened = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  const hid_t attribute = H5Aopen(opened, "config", H5P_DEFAULT);
  const hid_t type = H5Aget_type(attribute);
  std::string broken(H5Tget_size(type), '{');
  H5Awrite(attribute, type, broken.c_str());
  H5Tclose(type);
  H5Aclose(attribute);
  H5Fclose(opened);
  const Recovery recovery = recover_recording(file);
  EXPECT_EQ(recovery.samples, 2500U);
  EXPECT_THAT(recovery.notes, Contains(HasSubstr("config")));
  EXPECT_EQ(errors_of(file), std::vector<std::string>());
  const RecordingReader reader(file);
  EXPECT_EQ(reader.header().title, "kept");
  expect_same(reader.read(0, 2500), session);
}

TEST(Rounding, KeepsStatisticsAndChecksumsOfTheValuesThatAreRead) {
  // Some values are near zero, where a relative comparison sees a difference; others cannot be rounded.
  for (const Precision& precision : {Precision{.position = 1e-6, .velocity = 1e-3, .force = 1e-3},
                                     Precision{.position = 3e-7, .velocity = 7e-5, .force = 0.2},
                                     Precision{.position = 1e-9, .velocity = 1e-9, .force = 1e-9}}) {
    const TempFolder folder;
    const std::string file = folder / "a.h5";
    std::vector<Sample> session = random_session(5, 5000, kForces);
    for (std::size_t i = 0; i < session.size(); ++i) {
      session[i].position *= i % 3 == 0 ? 1e-7 : 1;
      if (i % 1000 == 999) session[i].position.x() = 1e-7;
      if (i > 2000 && i < 2100) session[i].reference_force = nan3();
    }
    {
      RecordingWriter writer(file, {}, kForces, {.storage = {.deflate = 1, .precision = precision}});
      writer.append(session);
      writer.finish();
    }
    for (const Finding& finding : check_recording(file)) ADD_FAILURE() << finding.where << ": " << finding.what;
    const std::vector<Sample> rows = RecordingReader(file).read(0, 5000);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      EXPECT_LE((rows[i].position - session[i].position).cwiseAbs().maxCoeff(), precision.position * (1 + 1e-6));
      EXPECT_LE((rows[i].force - session[i].force).cwiseAbs().maxCoeff(), precision.force * (1 + 1e-6));
    }
    // Rounded values do not change when they are rounded again.
    const std::string again = folder / "b.h5";
    {
      RecordingWriter writer(again, {}, kForces, {.storage = {.precision = precision, .rows_per_chunk = 333}});
      writer.append(rows);
      writer.finish();
    }
    expect_same(RecordingReader(again).read(0, 5000), rows);
  }
}

TEST(Clocks, AreReadBackUnchangedAndGiveTheDrift) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  std::vector<ClockReading> readings;
  for (std::int64_t i = 0; i < 100; ++i) {
    const std::int64_t at = i * 60'000'000'000;
    readings.push_back({.time_ns = at,
                        .realtime_ns = 1'800'000'000'123'456'789 + at + at / 100'000,  // 10 ppm
                        .monotonic_ns = 77'000'000'000 + at,
                        .uncertainty_ns = 150 + i});
  }
  RecordingWriter writer(file, {}, {}, {});
  writer.append(random_session(6, 100, {}));
  for (const ClockReading& reading : readings) writer.append(reading);
  writer.finish();
  const std::vector<ClockReading> read = RecordingReader(file).clocks();
  const auto expect_the_same = [&](const std::vector<ClockReading>& others) {
    ASSERT_EQ(others.size(), readings.size());
    for (std::size_t i = 0; i < others.size(); ++i) {
      EXPECT_EQ(others[i].time_ns, readings[i].time_ns);
      EXPECT_EQ(others[i].realtime_ns, readings[i].realtime_ns);
      EXPECT_EQ(others[i].monotonic_ns, readings[i].monotonic_ns);
      EXPECT_EQ(others[i].uncertainty_ns, readings[i].uncertainty_ns);
    }
  };
  expect_the_same(read);
  std::string from = file;
  for (const char* name : {"b.csv", "c.jsonl", "d.h5"}) {
    const auto source = open_source(from);
    from = folder / name;
    const auto sink =
        create_sink(from, source->header(), source->columns(), source->events(), {.clocks = source->clocks()});
    copy(*source, *sink);
    sink->finish();
  }
  expect_the_same(RecordingReader(from).clocks());
  EXPECT_NEAR(clock_drift(read), 1e-5, 1e-9);
  EXPECT_TRUE(std::isnan(clock_drift(std::span(read).first(1))));
}

TEST(RecordingWriter, KeepsOtherProgramsFromWritingAndLetsThemRead) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  RecordingWriter writer(file, {}, {}, {});
  writer.append(random_session(7, 3000, {}));
  writer.flush();
  const auto h5py = [&](const char* mode) {
    const std::string code = fmt::format("import h5py; h5py.File(\"{}\", {})", file, mode);
    return std::system(fmt::format("{} -c '{}' 2>/dev/null", HAPTRACE_PYTHON, code).c_str());
  };
  EXPECT_EQ(h5py("\"r\", swmr=True"), 0);
  EXPECT_NE(h5py("\"r+\""), 0);
  EXPECT_NE(h5py("\"a\""), 0);
  writer.append(random_session(7, 10, {}));
  writer.finish();
  EXPECT_EQ(h5py("\"r+\""), 0);
}

TEST(RecordingWriter, EndsWithAnErrorAndWritesNothingIntoAFileOfAnotherProgram) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  RecordingWriter writer(file, {}, {}, {});
  const std::vector<Sample> session = random_session(8, 9000, {});
  writer.append(std::span(session).first(7000));
  writer.flush();
  std::ofstream(file, std::ios::binary) << "mine";
  expect_error(
      [&] {
        writer.append(std::span(session).subspan(7000));
        writer.flush();
      },
      Error::Kind::fault, {"another program overwrote it"});
  EXPECT_EQ(read_bytes(file), "mine");
  // Memory still holds the chunk before the one that could not be written.
  EXPECT_EQ(writer.resume(), 4096U);
  writer.finish();
  EXPECT_EQ(read_bytes(file), "mine");
  const RecordingReader reader(part_file(file, 2));
  expect_same(reader.read(0, 9000), std::span(session).subspan(4096));
}

TEST(RecordingWriter, OutlastsBytesThatAnotherProgramScribbledOverItsFile) {
  // Wherever the damage is, the writer finishes the file or throws an error and can resume.
  std::mt19937 random(9);
  for (int trial = 0; trial < 60; ++trial) {
    const TempFolder folder;
    const std::string file = folder / "a.h5";
    RecordingWriter writer(file, {}, {}, {.storage = {.rows_per_chunk = 64}});
    const std::vector<Sample> session = random_session(10, 12'000, {});
    writer.append(std::span(session).first(6000));
    writer.flush();
    {
      std::fstream stream(file, std::ios::binary | std::ios::in | std::ios::out);
      const std::uint64_t most = trial % 2 == 0 ? 30'000 : std::filesystem::file_size(file);
      stream.seekp(static_cast<std::streamoff>(random() % most));
      for (int i = 0; i < 64; ++i) stream.put(static_cast<char>(random()));
    }
    try {
      writer.append(std::span(session).subspan(6000));
      writer.flush();
      writer.finish();
    } catch (const Error&) {
      EXPECT_NO_THROW({
        (void)writer.resume();
        writer.finish();
      });
      EXPECT_EQ(errors_of(writer.part()), std::vector<std::string>());
    }
  }
}

}  // namespace
}  // namespace haptrace
