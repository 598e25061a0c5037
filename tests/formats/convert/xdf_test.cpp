#include "formats/recording/recording_stream.h"
#include "tests/formats/convert/xdf_writer.h"
#include "tests/formats/support.h"

#include <cmath>
#include <gmock/gmock.h>

namespace haptrace {
namespace {

using test::XdfWriter;
using testing::Contains;
using testing::HasSubstr;

struct Read {
  std::vector<Sample> samples;
  std::vector<StoredEvent> events;
  std::vector<std::string> notes;
  RecordingHeader header;
  RecordingColumns columns;
};

Read read(const std::string& bytes, const SourceOptions& options = {}) {
  const TempFolder folder;
  const auto source = open_source(folder.write("a.xdf", bytes), options);
  Read all;
  for (auto block = source->next(); !block.empty(); block = source->next())
    all.samples.insert(all.samples.end(), block.begin(), block.end());
  all.events = source->events();
  all.notes = source->notes();
  all.header = source->header();
  all.columns = source->columns();
  return all;
}

void expect_refused(const std::string& bytes, const std::string& what, const SourceOptions& options = {}) {
  expect_error([&] { (void)read(bytes, options); }, Error::Kind::input, {"a.xdf", what});
}

const std::vector<XdfWriter::Channel> kXyz{{"x", "m"}, {"y", "m"}, {"z", "m"}};

/// Position of the hand [m] and force on it [N] at `t` [s] of the recorder's clock.
Vec3 position(double t) {
  return {0.1 * std::sin(t), 0.1 * std::cos(t), 0.01 * t};
}
Vec3 force(double t) {
  return {std::cos(3 * t), 1, t};
}
std::vector<double> list(const Vec3& v) {
  return {v.x(), v.y(), v.z()};
}

/// Returns an XDF file with a second of a hand at 500 Hz and its force at 100 Hz, from three machines. The clock of the
/// hand's machine is 1000 s ahead of the recorder's and gains 50 us a second; the clock of the force's is 77 s behind.
/// The file has a measured clock offset every 0.1 s, with network noise of up to `noise` [s].
std::string two_machines(double noise = 0) {
  const auto hand_clock = [](double t) { return 1000 + t * (1 + 5e-5); };
  const auto force_clock = [](double t) { return t - 77; };
  XdfWriter xdf;
  xdf.stream(1, "Hand", "Position", "double64", 500, kXyz);
  xdf.stream(2, "Sensor", "Force", "float32", 100, {{"Fx", "N"}, {"Fy", "N"}, {"Fz", "mN"}});
  xdf.stream(3, "Keys", "Markers", "string", 0, {{"key", ""}});
  std::mt19937_64 random(4);
  std::uniform_real_distribution<double> delay(0, noise);
  for (int tenth = 0; tenth < 10; ++tenth) {
    std::vector<std::string> hand, sensor;
    const double begin = 0.1 * tenth;
    for (int i = 0; i < 50; ++i) {
      const double t = begin + i / 500.0;
      hand.push_back(XdfWriter::sample<double>(hand_clock(t), list(position(t))));
    }
    for (int i = 0; i < 10; ++i) {
      const double t = begin + i / 100.0;
      const Vec3 f = force(t);
      sensor.push_back(XdfWriter::sample<float>(
          force_clock(t), {static_cast<float>(f.x()), static_cast<float>(f.y()), static_cast<float>(1e3 * f.z())}));
    }
    xdf.samples(2, sensor);
    xdf.samples(1, hand);
    xdf.clock_offset(1, hand_clock(begin), begin - hand_clock(begin) + delay(random));
    xdf.clock_offset(2, force_clock(begin), 77 + delay(random));
    if (tenth == 5) xdf.samples(3, {XdfWriter::marker(0.5, {"go"}), XdfWriter::marker(0.55, {"stop"})});
    xdf.boundary();
  }
  for (const std::uint32_t id : {1, 2, 3}) xdf.footer(id);
  return xdf.file();
}

TEST(Xdf, PutsStreamsOfSeveralMachinesOnOneClockAndMarkersIntoEvents) {
  const Read all = read(two_machines(), {.streams = {"Hand", "Force"}});
  ASSERT_EQ(all.samples.size(), 500U);
  for (std::size_t i = 0; i < all.samples.size(); ++i) {
    const Sample& sample = all.samples[i];
    const double t = static_cast<double>(i) / 500;
    EXPECT_NEAR(1e-9 * static_cast<double>(sample.time_ns), t, 2e-9);
    EXPECT_LT((sample.position - position(t)).norm(), 1e-15);
    EXPECT_EQ(sample.tick, i);
    EXPECT_EQ(sample.phase, Phase::run);
    // Each sample has the newest force at its time. If two stamps are equal, rounding decides which is newest.
    const double newest = std::floor(t * 100 + 1e-9) / 100;
    const double off = i % 5 != 0 ? (sample.force - force(newest)).norm() : 0;
    EXPECT_LT(off, 1e-6) << i;
  }
  ASSERT_EQ(all.events.size(), 2U);
  EXPECT_EQ(all.events[0].text, "go");
  EXPECT_EQ(all.events[0].code, 50);
  EXPECT_NEAR(all.events[0].time, 0.5, 1e-9);
  EXPECT_NEAR(all.events[1].time, 0.55, 1e-9);
  EXPECT_TRUE(all.notes.empty()) << all.notes.front();
  EXPECT_EQ(all.header.rate_hz, 500);
  EXPECT_EQ(all.header.title, "Hand");
  EXPECT_EQ(all.header.created, "2026-03-01T12:00:00Z");
}

/// Returns an XDF file with 4 s of a hand at 500 Hz and a force at 100 Hz. The force begins 0.7 ms later and is missing
/// from `until` to 3 s.
std::string late_force(double until, const std::string& date = "2026-03-01T14:00:00+0200") {
  XdfWriter xdf(date);
  xdf.stream(1, "Hand", "Position", "double64", 500, kXyz);
  xdf.stream(2, "Sensor", "Force", "double64", 100, {{"Fx", "N"}, {"Fy", "N"}, {"Fz", "N"}});
  std::vector<std::string> hand, sensor;
  for (int i = 0; i < 2000; ++i) {
    const double t = 100 + i / 500.0;
    hand.push_back(XdfWriter::sample<double>(t, list(position(t))));
  }
  for (int i = 0; i < 400; ++i)
    if (const double t = 100 + 0.0007 + i / 100.0; t < 100 + until || t > 103)
      sensor.push_back(XdfWriter::sample<double>(t, list(force(t))));
  xdf.samples(1, hand);
  xdf.samples(2, sensor);
  return xdf.file();
}

TEST(Xdf, LeavesOutRowsWithoutAForceSoThatTheRecordingIsValid) {
  for (const double until : {10.0, 0.5}) {
    const TempFolder folder;
    const SourceOptions options{.streams = {"Hand", "Force"}};
    const auto source = open_source(folder.write("a.xdf", late_force(until)), options);
    const std::string file = folder / "a.h5";
    const auto sink = create_sink(file, source->header(), source->columns(), source->events(), {});
    const std::uint64_t rows = copy(*source, *sink);
    sink->finish();
    // The first row is left out, and the rows from a second after the last force to the next force.
    EXPECT_EQ(rows, until > 5 ? 1999U : 1999U - 755U);
    for (const Finding& finding : check_recording(file))
      EXPECT_NE(finding.severity, Severity::problem) << finding.where << ": " << finding.what;
    EXPECT_EQ(RecordingReader(file).header().created, "2026-03-01T12:00:00Z");
    EXPECT_THAT(source->notes(),
                Contains(HasSubstr(fmt::format("{} samples left out: there is no position or no force at "
                                               "their time",
                                               2000 - rows))));
  }
}

TEST(Xdf, ReportsAnInvalidDate) {
  const Read all = read(late_force(10, "last Tuesday\x1b[2J"), {.streams = {"Hand"}});
  EXPECT_EQ(all.header.created, "");
  EXPECT_THAT(all.notes, Contains(HasSubstr("the file's date 'last Tuesday")));
}

TEST(Xdf, FitsALineThroughNoisyClockOffsets) {
  const Read all = read(two_machines(2e-4), {.streams = {"Hand"}});
  ASSERT_EQ(all.samples.size(), 500U);
  for (std::size_t i = 1; i < all.samples.size(); ++i)  // even stamps stay even: single offsets would make jumps
    EXPECT_NEAR(1e-9 * static_cast<double>(all.samples[i].time_ns - all.samples[i - 1].time_ns), 0.002, 1e-6);
  EXPECT_NEAR(1e-9 * static_cast<double>(all.samples.back().time_ns), 0.998, 2e-4);
}

TEST(Xdf, TakesTheOnlyStreamThatHasAPosition) {
  EXPECT_EQ(read(two_machines()).samples.size(), 500U);
  EXPECT_FALSE(is_finite(read(two_machines()).samples[3].force));
}

TEST(Xdf, FindsChannelsByLabelOrByRequestAndConvertsUnitsToSi) {
  XdfWriter xdf;
  xdf.stream(7, "Tracker", "MoCap", "float32", 100,
             {{"Pos X", "mm"},
              {"Pos_Y", "mm"},
              {"PosZ", "mm"},
              {"VelX", "mm/s"},
              {"VelY", "mm/s"},
              {"VelZ", "mm/s"},
              {"sensor A", "N"},
              {"sensor B", "N"},
              {"sensor C", "furlong"}});
  xdf.samples(7, {XdfWriter::sample<float>(5, {1, 2, 3, 10, 20, 30, 7, 8, 9}),
                  XdfWriter::sample<float>({}, {4, 5, 6, 10, 20, 30, 7, 8, 9})});
  const Read found = read(xdf.file());
  ASSERT_EQ(found.samples.size(), 2U);
  EXPECT_LT((found.samples[0].position - Vec3(0.001, 0.002, 0.003)).norm(), 1e-12);
  EXPECT_LT((found.samples[0].velocity - Vec3(0.01, 0.02, 0.03)).norm(), 1e-9);
  EXPECT_EQ(found.samples[1].time_ns, 10'000'000) << "without a stamp: one period later";

  const Read told = read(xdf.file(), {.channels = {{"mx", "sensor A"}, {"my", "sensor B"}, {"mz", "sensor C"}}});
  EXPECT_EQ(told.samples[0].force_measured, Vec3(7, 8, 9));
  EXPECT_TRUE(told.columns.force_measured);
  EXPECT_FALSE(found.columns.force_measured);
  ASSERT_EQ(told.notes.size(), 1U);
  EXPECT_NE(told.notes[0].find("'sensor C' is in 'furlong', which is not a unit of mz"), std::string::npos)
      << told.notes[0];
}

template <class Value>
void expect_read_as(const std::string& format) {
  XdfWriter xdf;
  xdf.stream(1, "s", "t", format, 0, kXyz);
  xdf.samples(1, {XdfWriter::sample<Value>(1, {Value(1), Value(-2), Value(3)})});
  EXPECT_EQ(read(xdf.file()).samples.at(0).position, Vec3(1, -2, 3)) << format;
}

TEST(Xdf, ReadsValuesOfEveryFormat) {
  expect_read_as<float>("float32");
  expect_read_as<double>("double64");
  expect_read_as<std::int8_t>("int8");
  expect_read_as<std::int16_t>("int16");
  expect_read_as<std::int32_t>("int32");
  expect_read_as<std::int64_t>("int64");
}

TEST(Xdf, ReadsMarkersOfSeveralChannelsAndLeavesOutEmptyOnesOfAFixedRate) {
  XdfWriter xdf;
  xdf.stream(1, "Hand", "Position", "double64", 0, kXyz);
  xdf.stream(2, "Pairs", "Markers", "string", 0, {{"a", ""}, {"b", ""}});
  xdf.stream(3, "Often", "Markers", "string", 10, {{"a", ""}});
  xdf.samples(1, {XdfWriter::sample<double>(10, {1, 2, 3})});
  xdf.samples(2, {XdfWriter::marker(11, {"left", "hit"}), XdfWriter::marker(9, {"right", ""})});
  xdf.samples(3, {XdfWriter::marker(12, {""}), XdfWriter::marker(13, {"beep"})});
  const Read all = read(xdf.file());
  ASSERT_EQ(all.events.size(), 3U);
  EXPECT_EQ(all.events[0].text, "right");
  EXPECT_EQ(all.events[0].time, -1);
  EXPECT_EQ(all.events[1].text, "left, hit");
  EXPECT_EQ(all.events[2].text, "beep");
}

TEST(Xdf, MakesStampsEvenOnRequestOnlyAndNotAcrossGaps) {
  std::mt19937_64 random(6);
  std::uniform_real_distribution<double> jitter(-4e-4, 4e-4);
  XdfWriter xdf;
  xdf.stream(1, "Hand", "Position", "double64", 1000, kXyz);
  std::vector<std::string> samples;
  for (int i = 0; i < 4000; ++i)
    samples.push_back(XdfWriter::sample<double>(50 + 1.0005e-3 * i + (i >= 2000 ? 10 : 0) + jitter(random), {1, 2, 3}));
  xdf.samples(1, samples);
  const auto worst_step = [](const Read& all) {
    double worst = 0;
    for (std::size_t i = 1; i < all.samples.size(); ++i)
      if (i != 2000)
        worst = std::max(
            worst,
            std::abs(1e-9 * static_cast<double>(all.samples[i].time_ns - all.samples[i - 1].time_ns) - 1.0005e-3));
    return worst;
  };
  EXPECT_GT(worst_step(read(xdf.file())), 5e-4);
  const Read even = read(xdf.file(), {.dejitter = true});
  EXPECT_LT(worst_step(even), 2e-7);
  EXPECT_NEAR(1e-9 * static_cast<double>(even.samples[2000].time_ns - even.samples[1999].time_ns), 10.001, 1e-4);

  XdfWriter irregular;
  irregular.stream(1, "s", "t", "double64", 0, kXyz);
  irregular.samples(1, {XdfWriter::sample<double>(1, {1, 2, 3})});
  expect_refused(irregular.file(), "has no even clock", {.dejitter = true});
}

TEST(Xdf, ReadsAFileThatWasCutOffAnywhere) {
  const std::string whole = two_machines();
  std::size_t before = 0;
  for (std::size_t size = 4; size < whole.size(); size += 97) {
    try {
      const Read part = read(whole.substr(0, size));
      EXPECT_GE(part.samples.size(), before) << size;
      before = part.samples.size();
      for (std::size_t i = 0; i < before; ++i)
        EXPECT_LT((part.samples[i].position - position(static_cast<double>(i) / 500)).norm(), 1e-15);
    } catch (const Error& error) {
      EXPECT_EQ(before, 0U) << size << ": " << error.what();
    }
  }
  EXPECT_GT(before, 440U);
  const Read cut = read(whole.substr(0, whole.size() - 300));
  ASSERT_FALSE(cut.notes.empty());
  EXPECT_NE(cut.notes.back().find("cut off"), std::string::npos) << cut.notes.back();
}

TEST(Xdf, ContinuesAfterTheNextBoundaryWhereAChunkIsDamaged) {
  XdfWriter xdf;
  xdf.stream(1, "Hand", "Position", "double64", 0, kXyz);
  xdf.samples(1, {XdfWriter::sample<double>(1, {1, 2, 3})});
  xdf.raw("\x05garbage of a bad sector");
  xdf.boundary();
  xdf.samples(1, {XdfWriter::sample<double>(2, {4, 5, 6})});
  const Read all = read(xdf.file());
  ASSERT_EQ(all.samples.size(), 2U);
  EXPECT_EQ(all.samples[1].position, Vec3(4, 5, 6));
  ASSERT_EQ(all.notes.size(), 1U);
  EXPECT_NE(all.notes[0].find("damaged at byte"), std::string::npos);
  EXPECT_NE(all.notes[0].find("reading continued at the next boundary"), std::string::npos);
}

TEST(Xdf, ReadsAFileThatIsDamagedInManyThousandPlaces) {
  XdfWriter xdf;
  xdf.stream(1, "Hand", "Position", "double64", 0, kXyz);
  for (int i = 0; i < 50'000; ++i) {
    xdf.raw("\x05");
    xdf.boundary();
  }
  xdf.samples(1, {XdfWriter::sample<double>(2, {4, 5, 6})});
  const Read all = read(xdf.file());
  EXPECT_EQ(all.samples.size(), 1U);
  EXPECT_EQ(all.notes.size(), 10U);
}

TEST(Xdf, LeavesOutAStreamWithAnInvalidHeader) {
  XdfWriter xdf;
  xdf.stream(1, "Hand", "Position", "double64", 0, kXyz);
  xdf.stream(2, "New", "Position", "float16", 0, kXyz);
  xdf.samples(1, {XdfWriter::sample<double>(2, {4, 5, 6})});
  const Read all = read(xdf.file());
  EXPECT_EQ(all.samples.size(), 1U);
  EXPECT_EQ(all.notes.at(0), "left out: stream 2 ('New') has values of the unknown format 'float16'");
}

TEST(Xdf, NeverCrashesOnAFlippedByte) {
  const std::string whole = two_machines();
  const TempFolder folder;
  std::mt19937_64 random(9);
  for (int i = 0; i < 1500; ++i) {
    std::string damaged = whole;
    // Half of the damage is in the headers, which hold lengths and formats.
    damaged[random() % (i % 2 == 0 ? 1200 : damaged.size())] = static_cast<char>(random());
    try {
      const Read all = read(damaged);
      EXPECT_LE(all.samples.size(), 500U + 500U);
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), Error::Kind::input);
    }
  }
}

TEST(Xdf, SaysWhatIsWrongAndWhatToDo) {
  expect_refused("XDF:", "there is no stream with channels x, y and z; choose one with --stream NAME");
  expect_refused("\x1F\x8B\x08\x08", "a.xdf: is compressed; unpack it first");
  expect_refused("XDX:abc", "is not XDF");
  expect_refused(two_machines(), "no streams have the name or type 'hand'", {.streams = {"hand"}});
  expect_refused(two_machines(), "it has 'Hand' (Position) with x, y, z; 'Sensor' (Force) with Fx, Fy, Fz; 'Keys'",
                 {.streams = {"hand"}});
  expect_refused(two_machines(), "stream 'Keys' holds markers", {.streams = {"Keys"}});
  expect_refused(two_machines(), "the chosen streams have no channels x, y and z", {.streams = {"Sensor"}});
  expect_error(
      [&] {
        (void)read(two_machines(), {.channels = {{"w", "x"}}});
      },
      Error::Kind::input, {"--map w=x: 'w' is not a column"});
  expect_error([&] { (void)read(two_machines(), {.channels = {{"x", "Fy"}}}); }, Error::Kind::input, {"no"});

  XdfWriter unknown;
  unknown.stream(1, "s", "t", "float16", 0, kXyz);
  expect_refused(unknown.file(), "stream 1 ('s') has values of the unknown format 'float16'");
  XdfWriter none;
  none.stream(1, "s", "t", "float32", 0, kXyz);
  expect_refused(none.file(), "stream 's' has no sample");
  XdfWriter twice;
  twice.stream(1, "s", "t", "double64", 0, kXyz);
  twice.samples(1, {XdfWriter::sample<double>(1, {1, 2, 3}), XdfWriter::sample<double>(1, {1, 2, 3})});
  expect_refused(twice.file(), "--resample");
  EXPECT_EQ(read(twice.file(), {.any_order = true}).samples.size(), 2U);
  XdfWriter no_time;
  no_time.stream(1, "s", "t", "double64", 0, kXyz);
  no_time.samples(1, {XdfWriter::sample<double>(std::nan(""), {1, 2, 3})});
  expect_refused(no_time.file(), "which is not a time");
}

}  // namespace
}  // namespace haptrace
