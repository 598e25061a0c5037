// Laws of the conversions between all formats.
#include "formats/path/path_file.h"
#include "formats/recording/recording_stream.h"
#include "tests/formats/support.h"

#include <cmath>

namespace haptrace {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Returns a session with irregular data: missed ticks, stamps to the nanosecond, and values that are NaN, infinite,
/// negative zero, very large or very small.
std::vector<Sample> odd_session(unsigned seed, std::size_t rows, const RecordingColumns& columns) {
  std::vector<Sample> session = random_session(seed, rows, columns);
  std::mt19937_64 random(seed + 1000);
  std::int64_t time_ns = static_cast<std::int64_t>(random() % 1000);
  std::uint64_t tick = random() % 100;
  const auto spoil = [&](Vec3& v) {
    const double odd[] = {kNaN, -0.0, 5e-324, 1.7976931348623157e308, kInfinity, -kInfinity, 0.1, 1.0 / 3};
    if (random() % 4 == 0) v[static_cast<int>(random() % 3)] = odd[random() % std::size(odd)];
    if (random() % 9 == 0) v = nan3();
  };
  for (Sample& sample : session) {
    sample.time_ns = time_ns;
    sample.tick = tick;
    const std::uint64_t step = 1 + (random() % 20 == 0 ? random() % 1000 : 0);
    tick += step;
    time_ns += static_cast<std::int64_t>(step * 1'000'000 + random() % 900'000) - 400'000;
    spoil(sample.position);
    spoil(sample.velocity);
    spoil(sample.force);
    if (columns.torque) spoil(sample.torque);
    if (columns.force_measured) spoil(sample.force_measured);
    if (columns.reference) spoil(sample.reference_position);
    if (columns.guidance) spoil(sample.reference_force);
  }
  return session;
}

RecordingHeader odd_header() {
  RecordingHeader header;
  header.uuid = "00000000-0000-4000-8000-000000000001";
  header.created = "2026-01-02T03:04:05Z";
  header.software = "haptrace 0";
  header.title = "Größe, \"quoted\", a\nline # and a tab\t";
  header.subject = "S01";
  header.operator_name = "op";
  header.notes = "t,x,y,z\n1,2,3,4";
  header.rate_hz = 1000.0 / 3;
  header.clock = "virtual";
  header.complete = true;
  header.config = {{"verb", "play"}, {"kp", 1.0 / 7}, {"list", {1, 2.5, nullptr}}};
  header.device_name = "sim";
  header.device_model = "x";
  header.device_serial = "123";
  header.device_backend = "sim";
  header.position_resolution_m = 5e-5;
  header.max_force_n = 8.1;
  header.meta = {{"lab", "Übung, 3"}, {"a b", ""}};
  return header;
}

const std::vector<StoredEvent> kEvents{{0.0015, 50, "mark, with a comma\nand a line"}, {0.1 + 0.2, -7, ""}};

nlohmann::json all_of(const RecordingHeader& header) {
  nlohmann::json all;
  for (const layout::Attribute& attribute : layout::attributes())
    std::visit([&](auto member) { all[attribute.name] = header.*member; }, attribute.member);
  all["meta"] = header.meta;
  return all;
}

void convert(const std::string& from, const std::string& to, const SinkOptions& options = {}) {
  const auto source = open_source(from);
  const auto sink = create_sink(to, source->header(), source->columns(), source->events(), options);
  copy(*source, *sink);
  sink->finish();
}

void expect_same_recording(const std::string& a, const std::string& b) {
  const RecordingReader first(a), second(b);
  EXPECT_EQ(all_of(first.header()), all_of(second.header()));
  for (const layout::Column& column : layout::columns())
    EXPECT_EQ(column.in(first.columns()), column.in(second.columns())) << column.name;
  expect_same(second.read(0, second.rows()), first.read(0, first.rows()));
  ASSERT_EQ(first.events().size(), second.events().size());
  for (std::size_t i = 0; i < first.events().size(); ++i) {
    EXPECT_EQ(first.events()[i].time, second.events()[i].time);
    EXPECT_EQ(first.events()[i].code, second.events()[i].code);
    EXPECT_EQ(first.events()[i].text, second.events()[i].text);
  }
}

class ConvertRoundTrip : public testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(All, ConvertRoundTrip, testing::Values("csv", "jsonl", "h5"));

TEST_P(ConvertRoundTrip, LosesNothingOfASessionWithAnyChoiceOfColumns) {
  unsigned seed = 1;
  for (const RecordingColumns& columns : all_columns()) {
    const TempFolder folder;
    const std::vector<Sample> session = odd_session(seed, 300, columns);
    write_recording(folder / "a.h5", session, columns, odd_header(), kEvents);
    convert(folder / "a.h5", folder / (std::string("b.") + GetParam()));
    convert(folder / (std::string("b.") + GetParam()), folder / "c.h5");
    expect_same_recording(folder / "a.h5", folder / "c.h5");
    expect_same(RecordingReader(folder / "c.h5").read(0, 300), session);
    ++seed;
  }
}

TEST_P(ConvertRoundTrip, LosesNothingAcrossBlocksOfManyThousandRows) {
  const TempFolder folder;
  const RecordingColumns columns{.force_measured = true};
  write_recording(folder / "a.h5", odd_session(7, 20'000, columns), columns, odd_header());
  convert(folder / "a.h5", folder / (std::string("b.") + GetParam()));
  convert(folder / (std::string("b.") + GetParam()), folder / "c.h5");
  expect_same_recording(folder / "a.h5", folder / "c.h5");
}

TEST_P(ConvertRoundTrip, KeepsARecordingWithoutASample) {
  const TempFolder folder;
  write_recording(folder / "a.h5", {}, {}, odd_header(), kEvents);
  convert(folder / "a.h5", folder / (std::string("b.") + GetParam()));
  convert(folder / (std::string("b.") + GetParam()), folder / "c.h5");
  expect_same_recording(folder / "a.h5", folder / "c.h5");
}

TEST_P(ConvertRoundTrip, RefusesToReplaceAFileUnlessAllowedAndLeavesNothingBehindWhenItIsGivenUp) {
  const TempFolder folder;
  write_recording(folder / "a.h5", odd_session(3, 50, {}), {}, odd_header());
  const std::string target = folder.write(std::string("b.") + GetParam(), "precious");
  const auto source = open_source(folder / "a.h5");
  expect_error([&] { (void)create_sink(target, source->header(), {}, {}, {}); }, Error::Kind::input,
               {target + ": exists already"});
  {
    const auto sink = create_sink(target, source->header(), {}, {}, {.overwrite = true});
    sink->append(source->next());
  }
  EXPECT_EQ(read_bytes(target), "precious");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 2);
  { const auto sink = create_sink(folder / (std::string("c.") + GetParam()), source->header(), {}, {}, {}); }
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 2);
  convert(folder / "a.h5", target, {.overwrite = true});
  EXPECT_NE(read_bytes(target), "precious");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 2);
}

TEST(Convert, MakesTheSameRecordingOfAPathAsSavingItDoes) {
  const TempFolder folder;
  const std::string csv = folder.write("a.csv", "t,x,y,z,fx,fy,fz,colour\n5,1,2,3,4,5,6,red\n5.5,1,2,3,nan,,6,blue\n");
  const auto source = open_source(csv);
  EXPECT_EQ(source->notes(),
            (std::vector<std::string>{"columns left out: colour", "force left out: 1 of 2 samples lack it"}));
  EXPECT_EQ(load_path(csv).notes, source->notes());
  const std::span<const Sample> samples = source->next();
  ASSERT_EQ(samples.size(), 2U);
  EXPECT_EQ(samples[0].time_ns, 0);
  EXPECT_EQ(samples[1].time_ns, 500'000'000);
  EXPECT_EQ(samples[1].tick, 1U);
  EXPECT_EQ(samples[0].phase, Phase::run);
  EXPECT_FALSE(is_finite(samples[0].force)) << "in every row or in none";
  EXPECT_FALSE(is_finite(samples[1].force));
  EXPECT_FALSE(is_finite(samples[0].velocity));
  EXPECT_EQ(source->header().rate_hz, 2);
  EXPECT_TRUE(source->next().empty());
}

TEST(Convert, WritesCsvThatIsReadAsAPathWithoutANoteAboutItsOwnColumns) {
  const TempFolder folder;
  const RecordingColumns columns{true, true, true, false, true, true, true};
  std::vector<Sample> session = random_session(5, 500, columns);
  for (Sample& sample : session) sample.velocity = nan3();
  write_recording(folder / "a.h5", session, columns, odd_header(), kEvents);
  convert(folder / "a.h5", folder / "b.csv");
  const std::string text = read_bytes(folder / "b.csv");
  EXPECT_NE(text.find("\nt,x,y,z,vx,vy,vz,fx,fy,fz,qw,qx,qy,qz,tx,ty,tz,mx,my,mz,rx,ry,rz,rvx,rvy,rvz,rfx,rfy,rfz,"
                      "progress,tunnel_radius,buttons,phase,latency,tick\n0,"),
            std::string::npos)
      << text.substr(0, 2000);
  const Path path = load_path(folder / "b.csv");
  ASSERT_EQ(path.size(), 500U);
  EXPECT_EQ(path.position[499], session[499].position);
  EXPECT_EQ(path.force[7], session[7].force);
  EXPECT_TRUE(path.velocity.empty());
  EXPECT_TRUE(path.notes.empty()) << path.notes.front();
}

TEST(Convert, WritesTimeAsADecimalOfNanoseconds) {
  const TempFolder folder;
  std::vector<Sample> session = random_session(5, 4, {});
  const std::int64_t times[] = {-1, 7'000'000, 1'000'000'000, 36'000'000'000'001};
  for (std::size_t i = 0; i < 4; ++i) session[i].time_ns = times[i];
  const auto sink = create_sink(folder / "a.csv", {}, {}, {}, {});
  sink->append(session);
  sink->finish();
  const std::string text = read_bytes(folder / "a.csv");
  for (const char* line : {"\n-0.000000001,", "\n0.007,", "\n1,", "\n36000.000000001,"})
    EXPECT_NE(text.find(line), std::string::npos) << line;
  const auto source = open_source(folder / "a.csv");
  const std::span<const Sample> read = source->next();
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(read[i].time_ns, times[i]);
}

TEST(Convert, RoundsToTheRequestedDigitsExceptTime) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(8, 200, {});
  for (const char* name : {"a.csv", "a.jsonl"}) {
    const auto sink = create_sink(folder / name, {}, {}, {}, {.digits = 5});
    sink->append(session);
    sink->finish();
    const auto source = open_source(folder / name);
    const std::span<const Sample> read = source->next();
    ASSERT_EQ(read.size(), session.size());
    bool rounded = false;
    for (std::size_t i = 0; i < read.size(); ++i) {
      EXPECT_EQ(read[i].time_ns, session[i].time_ns);
      EXPECT_EQ(read[i].tick, session[i].tick);
      EXPECT_LE((read[i].position - session[i].position).norm(), 5e-5 * session[i].position.norm());
      rounded = rounded || read[i].position != session[i].position;
    }
    EXPECT_TRUE(rounded);
  }
}

TEST(Convert, CutsTimeAndEventsFromOneInstantToAnother) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(4, 10'000, {});
  write_recording(folder / "a.h5", session, {}, odd_header(),
                  {{0.5, 50, "early"}, {5.0005, 51, "in"}, {8, 52, "late"}});
  for (const auto& [from, to, first, last] :
       std::vector<std::tuple<double, double, std::size_t, std::size_t>>{{5, 6, 5000, 6000},
                                                                         {-kInfinity, 1, 0, 1000},
                                                                         {4.0955, kInfinity, 4096, 9999},
                                                                         {4.095, 4.0955, 4095, 4095}}) {
    const auto part = cut(open_source(folder / "a.h5"), from, to);
    std::vector<Sample> read;
    for (auto block = part->next(); !block.empty(); block = part->next())
      read.insert(read.end(), block.begin(), block.end());
    ASSERT_EQ(read.size(), last - first + 1);
    EXPECT_EQ(read.front().time_ns, 0);
    EXPECT_EQ(read.front().tick, first);
    EXPECT_EQ(read.back().time_ns, session[last].time_ns - session[first].time_ns);
    EXPECT_EQ(read.back().position, session[last].position);
    EXPECT_TRUE(part->next().empty());
    for (const StoredEvent& event : part->events())
      EXPECT_LE(event.time, 1e-9 * static_cast<double>(read.back().time_ns) + 1e-3);
  }
  const std::vector<StoredEvent> events = cut(open_source(folder / "a.h5"), 5, 6)->events();
  ASSERT_EQ(events.size(), 1U);
  EXPECT_NEAR(events[0].time, 0.0005, 1e-12);
  expect_error([&] { (void)cut(open_source(folder / "a.h5"), 6, 5); }, Error::Kind::input, {"the end comes before"});
  expect_error([&] { (void)cut(open_source(folder / "a.h5"), 20, 30); }, Error::Kind::input, {"no sample is between"});
  expect_error([&] { (void)cut(open_source(folder / "a.h5"), 1.0001, 1.0002); }, Error::Kind::input, {"no sample is"});
}

TEST(Convert, SaysWhatIsWrongWithAText) {
  const TempFolder folder;
  const std::string header = R"({"format":"haptrace-recording","rate_hz":1000})"
                             "\n";
  const auto refused = [&](const std::string& name, const std::string& text, const std::string& where,
                           const std::string& what) {
    const std::string file = folder.write(name, text);
    expect_error(
        [&] {
          const auto source = open_source(file);
          while (!source->next().empty()) {
          }
        },
        Error::Kind::input, {file + where, what});
  };
  refused("a.jsonl", "", ": ", "the first line must be the header");
  refused("a.jsonl", "{\"x\":1}\n", ": ", "the first line must be the header");
  refused("a.jsonl", "[1]\n", ": ", "the first line must be the header");
  refused("a.jsonl", header + "{\"time\":0,\"postion\":[1,2,3]}",
          ":2: ", "'postion' is not a column; did you mean 'position'?");
  refused("a.jsonl", header + "{\"time\":0,\"position\":[1,2]}", ":2: ", "position must be an array of 3 numbers");
  refused("a.jsonl", header + "{\"time\":0,\"position\":[1,2,\"a\"]}", ":2: ", "position: '\"a\"' is not a number");
  refused("a.jsonl", header + "{\"time\":null}", ":2: ", "time is missing or is not a time in seconds");
  refused("a.jsonl", header + "{\"time\":1e10}", ":2: ", "time is missing or is not a time in seconds");
  refused("a.jsonl", header + "{\"time\":0,\"tick\":-1}", ":2: ", "tick: -1 is not a whole number from 0 to");
  refused("a.jsonl", header + "{\"time\":0,\"phase\":256}", ":2: ", "phase: 256 is not a whole number from 0 to 255");
  refused("a.jsonl", header + "{\"time\":0}\n{\"event\":{}}",
          ":3: ", "events must come after the header and before the samples");
  refused("a.jsonl", header + "{\"time\":0", ":2: ", "syntax error");
  refused("a.jsonl", header + "17", ":2: ", "a sample must be a JSON object");
  refused("a.jsonl", header + "{\"time\":1}\n{\"time\":1}", ": ", "--resample");
  refused("a.csv", "t,x,y,z\n1,0,0,0\n1,0,0,0\n", ":3: ", "haptrace convert --resample HZ leaves such samples out");
  refused("a.csv", "t,x,y,z\n0,0,0,0\n1e-10,0,0,0\n", ": ", "less than 1 ns");
  refused("a.csv", "t,x,y,z\n0,0,0,0\n1e11,0,0,0\n", ":3: ", "is over 290 years");
  refused("a.csv", "t,x,y,z,tick\n0,0,0,0,0.5\n", ":2: ", "column tick: 0.5 is not a whole number");
  refused("a.csv", "# haptrace {\"rate_hz\":1000}\nt,x,y,z,tick\n0,0,0,0,5\n0.001,0,0,0,5\n", ": ",
          "tick 5 at time 0.001000000 s does not come after 5 of the previous sample");
  refused("a.csv", "# haptrace {\"rate_hz\":\"fast\"}\nt,x,y,z\n", ": header", "rate_hz: expected a number");
  expect_error([&] { (void)open_source(folder / "absent.csv"); }, Error::Kind::input, {"no such file"});
  expect_error([&] { (void)open_source(folder.path()); }, Error::Kind::input, {"is a folder"});
  expect_error([&] { (void)create_sink(folder / "a.txt", {}, {}, {}, {}); }, Error::Kind::input,
               {"a.txt: has no known ending; choose .h5, .csv or .jsonl"});
}

TEST(Convert, CountsRowsThatHaveNoTick) {
  const TempFolder folder;
  const std::string csv = folder.write("a.csv", "# haptrace {\"rate_hz\":1000}\nt,x,y,z\n0,0,0,0\n0.001,0,0,0\n");
  const std::string jsonl = folder.write("a.jsonl",
                                         "{\"format\":\"haptrace-recording\",\"rate_hz\":1000}\n"
                                         "{\"time\":0,\"position\":[0,0,0]}\n{\"time\":0.001,\"position\":[0,0,0]}\n");
  for (const std::string& file : {csv, jsonl}) {
    const auto source = open_source(file);
    const auto samples = source->next();
    ASSERT_EQ(samples.size(), 2U);
    EXPECT_EQ(samples[1].tick, 1U);
    EXPECT_EQ(samples[1].phase, Phase::run);
  }
}

TEST(Convert, ToleratesRowsInAnyOrderOnRequest) {
  const TempFolder folder;
  const std::string file = folder.write("a.csv", "t,x,y,z\n1,0,0,0\n1,0,0,0\n0.5,0,0,0\n");
  EXPECT_EQ(open_source(file, {.any_order = true})->next().size(), 3U);
}

}  // namespace
}  // namespace haptrace
