#include "formats/recording/recording.h"

#include "tests/formats/support.h"

#include <fcntl.h>
#include <regex>
#include <sys/file.h>
#include <sys/fsuid.h>
#include <unistd.h>

namespace haptrace {
namespace {

class RecordingRoundTrip : public testing::TestWithParam<RecordingColumns> {};
INSTANTIATE_TEST_SUITE_P(EveryChoiceOfColumns, RecordingRoundTrip, testing::ValuesIn(all_columns()));

TEST_P(RecordingRoundTrip, KeepsEveryBitOfEveryColumn) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  const std::vector<Sample> session = random_session(1, 257, GetParam());
  write_recording(file, session, GetParam());
  const RecordingReader reader(file);
  for (bool RecordingColumns::*option :
       {&RecordingColumns::orientation, &RecordingColumns::torque, &RecordingColumns::force_measured,
        &RecordingColumns::reference, &RecordingColumns::guidance, &RecordingColumns::tunnel, &RecordingColumns::gains})
    EXPECT_EQ(reader.columns().*option, GetParam().*option);
  expect_same(reader.read(0, session.size()), session);
}

TEST_P(RecordingRoundTrip, KeepsTheFormat) {
  const TempFolder folder;
  write_recording(folder / "a.h5", random_session(2, 300, GetParam()), GetParam());
  for (const Finding& finding : check_recording(folder / "a.h5"))
    ADD_FAILURE() << finding.where << ": " << finding.what;
}

TEST(Recording, IsTheSameHoweverItWasAppendedAndFlushed) {
  std::mt19937 random(3);
  const TempFolder folder;
  for (const std::size_t chunk : {1U, 7U, 100U, 2048U})
    for (const std::size_t rows : {0U, 1U, 99U, 100U, 101U, 2048U, 3001U}) {
      const std::string file = folder / (std::to_string(chunk) + "-" + std::to_string(rows) + ".h5");
      const std::vector<Sample> session = random_session(static_cast<unsigned>(rows), rows, {});
      RecordingWriter writer(file, {}, {}, {.storage = {.rows_per_chunk = chunk}});
      for (std::span<const Sample> rest = session; !rest.empty();) {
        const std::size_t count = std::min<std::size_t>(rest.size(), random() % 250);
        writer.append(rest.first(count));
        rest = rest.subspan(count);
        if (random() % 3 == 0) writer.flush();
      }
      EXPECT_EQ(writer.rows(), rows);
      writer.finish();
      const RecordingReader reader(file);
      EXPECT_EQ(reader.rows(), rows);
      EXPECT_TRUE(reader.header().complete);
      expect_same(reader.read(0, rows), session);
    }
}

TEST(Recording, IsReadInAnyRange) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(4, 9000, {});
  write_recording(folder / "a.h5", session);
  const RecordingReader reader(folder / "a.h5");
  std::mt19937 random(4);
  for (int i = 0; i < 20; ++i) {
    const std::size_t first = random() % session.size(), count = random() % (session.size() - first);
    expect_same(reader.read(first, count), std::span(session).subspan(first, count));
  }
  EXPECT_EQ(reader.read(8990, 100).size(), 10U);
  EXPECT_TRUE(reader.read(9000, 1).empty());
  EXPECT_TRUE(reader.read(std::uint64_t{1} << 63U, std::uint64_t{1} << 63U).empty());
}

TEST(Recording, KeepsItsHeader) {
  const TempFolder folder;
  RecordingHeader header{.software = "haptrace 0.1.0",
                         .title = "Schleife \xC3\xBC\x62\x65r \xE2\x88\x9E",
                         .subject = "P07",
                         .operator_name = "RF",
                         .notes = "first line\nsecond line",
                         .rate_hz = 4000.5,
                         .clock = "virtual",
                         .config = {{"gains", {{"kp", 800}}}, {"name", "\xC3\xBC"}},
                         .device_name = "sim",
                         .device_model = "omega.3",
                         .device_serial = "42",
                         .device_backend = "simulation",
                         .position_resolution_m = 1e-5,
                         .max_force_n = 12};
  write_recording(folder / "a.h5", {}, {}, header);
  const RecordingReader reader(folder / "a.h5");
  const RecordingHeader& read = reader.header();
  EXPECT_EQ(read.format_version, "1.1");
  EXPECT_TRUE(std::regex_match(read.uuid, std::regex("[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}"))) << read.uuid;
  EXPECT_TRUE(std::regex_match(read.created, std::regex("20\\d\\d-\\d\\d-\\d\\dT\\d\\d:\\d\\d:\\d\\dZ")))
      << read.created;
  for (std::string RecordingHeader::*text :
       {&RecordingHeader::software, &RecordingHeader::title, &RecordingHeader::subject, &RecordingHeader::operator_name,
        &RecordingHeader::notes, &RecordingHeader::clock, &RecordingHeader::device_name, &RecordingHeader::device_model,
        &RecordingHeader::device_serial, &RecordingHeader::device_backend})
    EXPECT_EQ(read.*text, header.*text);
  EXPECT_EQ(read.rate_hz, 4000.5);
  EXPECT_EQ(read.config, header.config);
  EXPECT_EQ(read.position_resolution_m, 1e-5);
  EXPECT_EQ(read.max_force_n, 12);
  EXPECT_TRUE(read.complete);
}

TEST(Recording, KeepsItsEvents) {
  const TempFolder folder;
  std::vector<StoredEvent> events;
  for (int i = 0; i < 150; ++i) events.push_back({0.5 * i, 10 + i, "event " + std::to_string(i)});
  write_recording(folder / "a.h5", {}, {}, {}, events);
  const std::vector<StoredEvent> read = RecordingReader(folder / "a.h5").events();
  ASSERT_EQ(read.size(), events.size());
  for (std::size_t i = 0; i < events.size(); ++i) {
    EXPECT_EQ(read[i].time, events[i].time);
    EXPECT_EQ(read[i].code, events[i].code);
    EXPECT_EQ(read[i].text, events[i].text);
  }
}

TEST(Recording, CutsTheTextOfAnEventAfterAWholeCharacterAndShowsIt) {
  const TempFolder folder;
  const std::string a123(123, 'a'), a124(124, 'a'), a127(127, 'a');
  write_recording(
      folder / "a.h5", {}, {}, {},
      {{0, 50, a127}, {0, 50, a127 + "b"}, {0, 50, a123 + "\xC3\xBC" + "too long"}, {0, 50, a124 + "\xC3\xBC"}});
  const std::vector<StoredEvent> read = RecordingReader(folder / "a.h5").events();
  EXPECT_EQ(read[0].text, a127);
  EXPECT_EQ(read[1].text, a124 + "...");
  EXPECT_EQ(read[2].text, a123 + "...");
  EXPECT_EQ(read[3].text, a124 + "\xC3\xBC");
}

TEST(Recording, KeepsTextsThatAreNotUtf8AsUtf8) {
  const TempFolder folder;
  RecordingHeader header;
  header.title = header.subject = "J\xe4ne";
  header.config = {{"file", "J\xe4ne.h5"}};
  header.meta = {{"k\xe4y", "v\xe4lue"}};
  write_recording(folder / "a.h5", random_session(1, 3, {}), {}, header, {{0, 50, "J\xe4ne"}});
  const RecordingReader reader(folder / "a.h5");
  EXPECT_EQ(reader.header().title, "J\uFFFDne");
  EXPECT_EQ(reader.header().subject, "J\uFFFDne");
  EXPECT_EQ(reader.header().config["file"], "J\uFFFDne.h5");
  EXPECT_EQ(reader.header().meta, (std::map<std::string, std::string>{{"k\uFFFDy", "v\uFFFDlue"}}));
  EXPECT_EQ(reader.events().front().text, "J\uFFFDne");
}

TEST(RecordingWriter, RefusesToReplaceAFileUnlessAllowed) {
  const TempFolder folder;
  const std::string file = folder.write("a.h5", "precious");
  expect_error([&] { RecordingWriter(file, {}, {}, {}); }, Error::Kind::input,
               {file + ": exists already", "--overwrite"});
  EXPECT_EQ(read_bytes(file), "precious");
  const std::vector<Sample> session = random_session(5, 10, {});
  RecordingWriter writer(file, {}, {}, {.overwrite = true});
  writer.append(session);
  writer.finish();
  expect_same(RecordingReader(file).read(0, 10), session);
}

TEST(RecordingWriter, LeavesAReplacedFileToItsReaders) {
  const TempFolder folder;
  const std::vector<Sample> old_session = random_session(6, 300, {}), new_session = random_session(7, 20, {});
  write_recording(folder / "a.h5", old_session);
  const RecordingReader old_reader(folder / "a.h5");
  RecordingWriter writer(folder / "a.h5", {}, {}, {.overwrite = true});
  writer.append(new_session);
  writer.finish();
  expect_same(old_reader.read(0, 300), old_session);
  expect_same(RecordingReader(folder / "a.h5").read(0, 20), new_session);
}

TEST(RecordingWriter, LeavesNothingBehindWhenItCannotCreate) {
  const TempFolder folder;
  const RecordingHeader too_long{.notes = std::string(60'001, 'x')};
  expect_error([&] { RecordingWriter(folder / "a.h5", too_long, {}, {}); }, Error::Kind::input,
               {folder / "a.h5", "notes has 60001 bytes; a recording keeps at most 60000"});
  RecordingHeader large;
  large.config = {{"text", std::string(70'000, 'x')}};
  expect_error([&] { RecordingWriter(folder / "a.h5", large, {}, {}); }, Error::Kind::input,
               {"config has 70011 bytes"});
  const std::string old = folder.write("old.h5", "precious");
  expect_error([&] { RecordingWriter(old, too_long, {}, {.overwrite = true}); }, Error::Kind::input, {"notes"});
  EXPECT_EQ(read_bytes(old), "precious");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1);
}

TEST(RecordingWriter, KeepsTheLongestTextsThatItAllows) {
  const TempFolder folder;
  RecordingHeader header;
  header.notes = std::string(60'000, 'n');
  header.config = {{"text", std::string(59'989, 'x')}};
  const std::vector<Sample> session = random_session(8, 500, {});
  write_recording(folder / "a.h5", session, {}, header);
  const RecordingReader reader(folder / "a.h5");
  EXPECT_EQ(reader.header().notes, header.notes);
  EXPECT_EQ(reader.header().config, header.config);
  EXPECT_TRUE(reader.header().complete);
}

TEST(RecordingWriter, SaysWhyAFileCannotBeCreated) {
  const TempFolder folder;
  expect_error([&] { RecordingWriter(folder / "no/a.h5", {}, {}, {}); }, Error::Kind::input,
               {folder / "no/a.h5", "folder " + folder / "no" + " does not exist; create it first"});
  expect_error([&] { RecordingWriter(folder.path(), {}, {}, {.overwrite = true}); }, Error::Kind::input,
               {folder.path() + ": exists and is not a regular file"});
  expect_error([&] { RecordingWriter("/dev/null", {}, {}, {.overwrite = true}); }, Error::Kind::input,
               {"/dev/null: exists and is not a regular file"});
  expect_error([&] { RecordingWriter(folder / "a.h5", {}, {}, {.storage = {.deflate = 10}}); }, Error::Kind::input,
               {"compression level is 10"});
}

TEST(RecordingWriter, SaysThatAFolderIsNotWritable) {
  const TempFolder folder;
  std::filesystem::permissions(folder.path(), std::filesystem::perms(0555));
  // The superuser may write everywhere, so the test changes to another user here.
  const int user = setfsuid(65534);
  expect_error([&] { RecordingWriter(folder / "a.h5", {}, {}, {}); }, Error::Kind::input,
               {folder / "a.h5" + ": cannot be created: Permission denied"});
  setfsuid(static_cast<uid_t>(user));
  std::filesystem::permissions(folder.path(), std::filesystem::perms(0755));
}

TEST(RecordingWriter, RefusesToContinueAfterItsEnd) {
  const TempFolder folder;
  RecordingWriter writer(folder / "a.h5", {}, {}, {});
  writer.finish();
  for (const auto& call : std::vector<std::function<void()>>{[&] { writer.append(std::vector<Sample>(1)); },
                                                             [&] { writer.append(StoredEvent{}); },
                                                             [&] { writer.flush(); }, [&] { writer.finish(); }})
    expect_error(call, Error::Kind::fault, {"the recording is closed already"});
  writer.abandon();
  EXPECT_TRUE(RecordingReader(folder / "a.h5").header().complete);
}

TEST(RecordingWriter, KeepsItsDataWhenItIsAbandoned) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(9, 250, {});
  {
    RecordingWriter writer(folder / "a.h5", {}, {}, {.storage = {.rows_per_chunk = 100}});
    writer.append(session);
  }
  const RecordingReader reader(folder / "a.h5");
  EXPECT_FALSE(reader.header().complete);
  ASSERT_EQ(reader.rows(), 250U);
  expect_same(reader.read(0, 250), session);
}

TEST(RecordingWriter, MovesWithItsFile) {
  const TempFolder folder;
  RecordingWriter first(folder / "a.h5", {}, {}, {});
  RecordingWriter second = std::move(first);
  second.append(random_session(10, 5, {}));
  second.finish();
  EXPECT_EQ(RecordingReader(folder / "a.h5").rows(), 5U);
}

TEST(RecordingReader, SaysWhyAFileIsNoRecording) {
  const TempFolder folder;
  const auto bad = [](const std::string& file, const std::string& message) {
    expect_error([&] { RecordingReader reader(file); }, Error::Kind::input, {file + ": " + message});
  };
  bad(folder / "absent.h5", "no such file");
  bad(folder.path(), "is a folder");
  bad("/dev/null", "is not a regular file");
  bad(folder.write("empty.h5", ""), "is empty");
  bad(folder.write("text.h5", "t,x,y,z\n"), "is not an HDF5 file");
  EXPECT_FALSE(is_hdf5(folder / "text.h5"));
  EXPECT_FALSE(is_hdf5(folder / "absent.h5"));
  write_recording(folder / "a.h5", {});
  EXPECT_TRUE(is_hdf5(folder / "a.h5"));
}

TEST(RecordingReader, SaysWhenAnotherProgramHasLockedTheFile) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  write_recording(file, {});
  const int descriptor = open(file.c_str(), O_RDWR);
  ASSERT_EQ(flock(descriptor, LOCK_EX), 0);
  expect_error([&] { RecordingReader reader(file); }, Error::Kind::input,
               {file + ": is open for writing in another program; close it there first"});
  close(descriptor);
  EXPECT_NO_THROW(RecordingReader reader(file));
}

}  // namespace
}  // namespace haptrace
