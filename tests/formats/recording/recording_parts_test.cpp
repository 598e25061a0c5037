#include "tests/formats/support.h"

#include <fmt/format.h>
#include <sys/stat.h>

namespace haptrace {
namespace {

namespace fs = std::filesystem;

/// Writes `session` in parts of the given numbers of rows, with an event at the start of each part.
void write_parts(const std::string& file, std::span<const Sample> session, std::initializer_list<std::size_t> rows,
                 bool finish = true) {
  RecordingWriter writer(file, {.title = "long"}, {}, {.overwrite = true, .in_parts = true});
  bool first = true;
  for (const std::size_t count : rows) {
    if (!first) writer.start_part();
    first = false;
    writer.append(StoredEvent{.time = 1e-9 * static_cast<double>(session.front().time_ns), .code = 50, .text = "part"});
    writer.append(session.first(count));
    session = session.subspan(count);
  }
  if (finish) writer.finish();
}

TEST(PartFile, OfTheFirstPartIsTheRecordingItself) {
  EXPECT_EQ(part_file("a/b.h5", 1), "a/b.h5");
  EXPECT_EQ(part_file("a/b.h5", 2), "a/b.part002.h5");
  EXPECT_EQ(part_file("a.b/c", 12), "a.b/c.part012");
  EXPECT_EQ(part_file("b.h5", 1234), "b.part1234.h5");
}

TEST(RecordingInParts, IsReadAsOneRecording) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(1, 1000, {});
  write_parts(folder / "a.h5", session, {300, 1, 0, 699});
  const RecordingReader reader(folder / "a.h5");
  EXPECT_EQ(reader.parts(), 4U);
  EXPECT_EQ(reader.rows(), 1000U);
  EXPECT_TRUE(reader.header().complete);
  expect_same(reader.read(0, 1000), session);
  std::mt19937 random(2);
  for (int i = 0; i < 100; ++i) {
    const std::size_t first = random() % 1000, count = random() % 500;
    const std::size_t there = std::min<std::size_t>(count, 1000 - first);
    expect_same(reader.read(first, count), std::span(session).subspan(first, there));
  }
  EXPECT_EQ(reader.events().size(), 4U);
  EXPECT_EQ(summarise(reader).rows, 1000U);
  for (std::size_t row = 0; row < 1000; row += 33) EXPECT_EQ(reader.row_at(session[row].time_ns), row);
}

TEST(RecordingInParts, HasACompleteRecordingInEachPart) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(1, 900, {});
  write_parts(folder / "a.h5", session, {300, 300, 300});
  for (std::uint32_t part = 1; part <= 3; ++part) {
    const std::string file = part_file(folder / "a.h5", part);
    for (const Finding& finding : check_recording(file)) ADD_FAILURE() << file << ": " << finding.where << finding.what;
  }
  const RecordingReader second(part_file(folder / "a.h5", 2));
  EXPECT_EQ(second.parts(), 1U);
  EXPECT_EQ(second.header().part, 2U);
  EXPECT_EQ(second.header().part_of, RecordingReader(folder / "a.h5").header().uuid);
  expect_same(second.read(0, 1000), std::span(session).subspan(300, 300));
}

TEST(RecordingInParts, EndsBeforeAPartOfAnotherRecording) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(1, 900, {});
  write_parts(folder / "other.h5", session, {100, 100, 100, 100});
  write_parts(folder / "a.h5", session, {300, 300, 300});
  fs::copy(folder / "other.part004.h5", folder / "a.part004.h5");
  EXPECT_EQ(RecordingReader(folder / "a.h5").rows(), 900U);
}

TEST(RecordingInParts, IsNotReadWithAMissingPartExceptOnRequest) {
  const std::vector<Sample> session = random_session(1, 900, {});
  for (const std::uint32_t lost : {2U, 3U}) {
    const TempFolder folder;
    write_parts(folder / "a.h5", session, {300, 300, 300});
    fs::remove(part_file(folder / "a.h5", lost));
    const std::string name = fmt::format("a.part00{}.h5", lost);
    expect_error([&] { const RecordingReader reader(folder / "a.h5"); }, Error::Kind::input,
                 {name, "is missing", "--partial"});
    const RecordingReader reader(folder / "a.h5", RecordingReader::Parts::present);
    EXPECT_EQ(reader.rows(), 600U);
    EXPECT_FALSE(reader.header().complete);
    EXPECT_EQ(reader.missing_parts(), std::vector<std::string>{folder / name});
    std::vector<Sample> kept(session.begin(), session.begin() + (lost == 2 ? 300 : 600));
    if (lost == 2) kept.insert(kept.end(), session.begin() + 600, session.end());
    expect_same(reader.read(0, 900), kept);
    const auto findings = check_recording(folder / "a.h5");
    EXPECT_TRUE(std::any_of(findings.begin(), findings.end(), [&](const Finding& finding) {
      return finding.severity == Severity::problem && finding.where.ends_with(name);
    }));
    for (const Finding& finding : check_recording(folder / "a.h5", {}, true))
      EXPECT_NE(finding.severity, Severity::problem) << finding.where << ": " << finding.what;
  }
}

TEST(RecordingInParts, IgnoresAPartOfAnotherRecording) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(1, 600, {});
  write_parts(folder / "other.h5", session, {100, 100, 100, 100});
  write_parts(folder / "a.h5", session, {300, 300});
  fs::copy(folder / "other.part004.h5", folder / "a.part004.h5");
  EXPECT_EQ(RecordingReader(folder / "a.h5").rows(), 600U);
}

TEST(RecordingInParts, IsFollowedIntoTheNextPart) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(1, 500, {});
  RecordingWriter writer(folder / "a.h5", {}, {}, {.in_parts = true});
  writer.append(std::span(session).first(200));
  writer.flush();
  RecordingReader reader(folder / "a.h5");
  EXPECT_EQ(reader.rows(), 200U);
  writer.start_part();
  EXPECT_EQ(writer.rows(), 200U);
  EXPECT_EQ(writer.part_rows(), 0U);
  writer.append(std::span(session).subspan(200));
  writer.flush();
  reader.refresh();
  EXPECT_EQ(reader.rows(), 500U);
  EXPECT_FALSE(reader.header().complete);
  writer.finish();
  reader.refresh();
  EXPECT_TRUE(reader.header().complete);
  expect_same(reader.read(0, 500), session);
}

TEST(RecordingInParts, RefusesToBeginIfAFileHasTheNameOfItsSecondPart) {
  const TempFolder folder;
  const std::string blocked = folder.write("a.part002.h5", "mine");
  expect_error([&] { RecordingWriter(folder / "a.h5", {}, {}, {.in_parts = true}); }, Error::Kind::input,
               {"a.part002.h5", "exists already", "--overwrite"});
  EXPECT_FALSE(fs::exists(folder / "a.h5"));
  EXPECT_EQ(read_bytes(blocked), "mine");
}

TEST(RecordingInParts, KeepsItsDataWhenTheNextPartCannotBeCreated) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(1, 100, {});
  fs::create_directory(folder / "sub");
  RecordingWriter writer(folder / "sub/a.h5", {}, {}, {.in_parts = true});
  writer.append(session);
  fs::create_directory(folder / "sub/a.part002.h5");
  expect_error([&] { writer.start_part(); }, Error::Kind::fault, {"ends with part 1", "a.part002.h5"});
  EXPECT_THROW(writer.append(session), Error);
  const RecordingReader reader(folder / "sub/a.h5");
  EXPECT_FALSE(reader.header().complete);
  expect_same(reader.read(0, 100), session);
}

TEST(RecordingWriter, KeepsTheExperimentersMetadata) {
  const TempFolder folder;
  const std::map<std::string, std::string> meta{{"hand", "left"}, {"Händigkeit/Test", "µ"}, {"empty", ""}};
  RecordingHeader header;
  header.meta = meta;
  write_recording(folder / "a.h5", random_session(1, 10, {}), {}, header);
  EXPECT_EQ(RecordingReader(folder / "a.h5").header().meta, meta);
  for (const Finding& finding : check_recording(folder / "a.h5"))
    ADD_FAILURE() << finding.where << ": " << finding.what;
  header.meta["long"] = std::string(60'001, 'x');
  expect_error([&] { RecordingWriter(folder / "b.h5", header, {}, {}); }, Error::Kind::input, {"long", "60001 bytes"});
}

TEST(RecordingWriter, KeepsARecordingWhoseFileIsRemovedMeanwhile) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(1, 5000, {});
  RecordingWriter writer(folder / "a.h5", {}, {}, {});
  writer.append(session);
  EXPECT_EQ(writer.misplaced(), "");
  fs::remove(folder / "a.h5");
  EXPECT_NE(writer.misplaced().find("was removed"), std::string::npos);
  expect_error([&] { writer.finish(); }, Error::Kind::fault, {"a.h5: was removed", "kept as " + (folder / "a.h5")});
  expect_same(RecordingReader(folder / "a.h5").read(0, 5000), session);
  EXPECT_TRUE(RecordingReader(folder / "a.h5").header().complete);
}

TEST(RecordingWriter, KeepsARecordingWhoseFileIsReplacedAndDoesNotTouchTheOther) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(1, 500, {});
  RecordingWriter writer(folder / "a.h5", {}, {}, {});
  writer.append(session);
  fs::rename(folder.write("other", "somebody else's"), folder / "a.h5");
  expect_error([&] { writer.finish(); }, Error::Kind::fault, {"kept as " + (folder / "a.rescued1.h5")});
  EXPECT_EQ(read_bytes(folder / "a.h5"), "somebody else's");
  expect_same(RecordingReader(folder / "a.rescued1.h5").read(0, 500), session);
}

TEST(RecordingWriter, KeepsARecordingWhoseFolderIsRemoved) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(1, 500, {});
  fs::create_directories(folder / "x/y");
  RecordingWriter writer(folder / "x/y/a.h5", {}, {}, {});
  writer.append(session);
  fs::remove_all(folder / "x");
  expect_error([&] { writer.finish(); }, Error::Kind::fault, {"kept as " + (folder / "a.h5")});
  expect_same(RecordingReader(folder / "a.h5").read(0, 500), session);
}

TEST(RecordingWriter, SaysWhereAFileThatWasMovedIsNow) {
  const TempFolder folder;
  RecordingWriter writer(folder / "a.h5", {}, {}, {});
  writer.append(random_session(1, 50, {}));
  fs::rename(folder / "a.h5", folder / "b.h5");
  EXPECT_NE(writer.misplaced().find("it is now " + (folder / "b.h5")), std::string::npos) << writer.misplaced();
  writer.finish();
  EXPECT_EQ(RecordingReader(folder / "b.h5").rows(), 50U);
}

TEST(RecordingWriter, ContinuesWhenItsFileAndFolderBecomeReadOnly) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(1, 5000, {});
  RecordingWriter writer(folder / "a.h5", {}, {}, {});
  writer.append(std::span(session).first(100));
  writer.flush();
  chmod((folder / "a.h5").c_str(), 0400);
  chmod(folder.path().c_str(), 0500);
  writer.append(std::span(session).subspan(100));
  writer.finish();
  chmod(folder.path().c_str(), 0700);
  expect_same(RecordingReader(folder / "a.h5").read(0, 5000), session);
}

TEST(RecordingWriter, SyncsItsDataToTheDiskOnRequest) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(1, 100, {});
  RecordingWriter writer(folder / "a.h5", {}, {}, {});
  writer.append(session);
  writer.sync();
  expect_same(RecordingReader(folder / "a.h5").read(0, 100), session);
}

}  // namespace
}  // namespace haptrace
