#include "formats/recording/crash_recovery.h"

#include "tests/formats/support.h"

#include <csignal>
#include <gmock/gmock.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

namespace haptrace {
namespace {

namespace fs = std::filesystem;

/// Writes `session` into `file` in a child process, which is killed after the last flush, before it closes the file.
void write_and_die(const std::string& file, std::span<const Sample> session, const RecordingWriter::Options& options,
                   const RecordingHeader& header = {}) {
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    RecordingWriter writer(file, header, {.reference = true}, options);
    writer.append(StoredEvent{.time = 0, .code = 1, .text = "started"});
    writer.append(session.first(session.size() / 2));
    if (options.in_parts) writer.start_part();
    writer.append(session.subspan(session.size() / 2));
    writer.flush();
    raise(SIGKILL);
  }
  int status = 0;
  waitpid(child, &status, 0);
  ASSERT_TRUE(WIFSIGNALED(status));
}

void expect_valid(const std::string& file) {
  for (const Finding& finding : check_recording(file))
    ADD_FAILURE() << file << ": " << finding.where << ": " << finding.what;
}

class Recover : public testing::TestWithParam<RecordingWriter::Options> {};
INSTANTIATE_TEST_SUITE_P(EveryStorage, Recover,
                         testing::Values(RecordingWriter::Options{},
                                         RecordingWriter::Options{.storage = {.deflate = 3, .rows_per_chunk = 100}},
                                         RecordingWriter::Options{.in_parts = true}));

TEST_P(Recover, MakesARecordingWholeWhoseWriterWasKilled) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  const std::vector<Sample> session = random_session(1, 20'000, {.reference = true});
  write_and_die(file, session, GetParam(), {.title = "expert", .meta = {{"hand", "left"}}});
  const RecordingHeader before = RecordingReader(file).header();
  EXPECT_FALSE(before.complete);

  const Recovery recovery = recover_recording(file);
  EXPECT_TRUE(recovery.needed);
  EXPECT_EQ(recovery.samples, session.size());
  EXPECT_EQ(recovery.unreadable, 0U);
  const RecordingReader reader(file);
  expect_same(reader.read(0, session.size()), session);
  EXPECT_TRUE(reader.header().complete);
  EXPECT_EQ(reader.header().uuid, before.uuid);
  EXPECT_EQ(reader.header().created, before.created);
  EXPECT_EQ(reader.header().title, "expert");
  EXPECT_EQ(reader.header().meta.at("hand"), "left");
  EXPECT_EQ(reader.header().part_of, before.part_of);
  EXPECT_EQ(reader.events().back().code, static_cast<int>(EventCode::recovered));
  expect_valid(file);
}

TEST_P(Recover, ChangesNothingTheSecondTime) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  write_and_die(file, random_session(2, 5000, {.reference = true}), GetParam());
  recover_recording(file);
  const std::string once = read_bytes(file);
  const Recovery again = recover_recording(file);
  EXPECT_FALSE(again.needed);
  EXPECT_EQ(again.samples, 5000U);
  EXPECT_EQ(read_bytes(file), once);
}

TEST(Recover, LeavesAWholeRecordingAsItIs) {
  const TempFolder folder;
  write_recording(folder / "a.h5", random_session(3, 500, {}));
  const std::string before = read_bytes(folder / "a.h5");
  EXPECT_FALSE(recover_recording(folder / "a.h5").needed);
  EXPECT_EQ(read_bytes(folder / "a.h5"), before);
}

TEST(Recover, TouchesOnlyThePartThatNeedsIt) {
  const TempFolder folder;
  write_and_die(folder / "a.h5", random_session(4, 4000, {.reference = true}), {.in_parts = true});
  const std::string first = read_bytes(folder / "a.h5");
  const Recovery recovery = recover_recording(folder / "a.h5");
  EXPECT_EQ(recovery.files, std::vector<std::string>{folder / "a.part002.h5"});
  EXPECT_EQ(read_bytes(folder / "a.h5"), first);
  EXPECT_EQ(RecordingReader(folder / "a.h5").rows(), 4000U);
}

TEST(Recover, RefusesARecordingThatIsBeingWritten) {
  const TempFolder folder;
  RecordingWriter writer(folder / "a.h5", {}, {}, {});
  writer.append(random_session(5, 300, {}));
  writer.flush();
  expect_error([&] { recover_recording(folder / "a.h5"); }, Error::Kind::input, {"being written by a running session"});
  writer.append(random_session(5, 300, {}));
  writer.finish();
  EXPECT_EQ(RecordingReader(folder / "a.h5").rows(), 600U);
}

TEST(Recover, WritesElsewhereWhenAskedAndLeavesTheOldFile) {
  const TempFolder folder;
  write_and_die(folder / "a.h5", random_session(6, 1000, {.reference = true}), {});
  const std::string before = read_bytes(folder / "a.h5");
  recover_recording(folder / "a.h5", folder / "b.h5");
  EXPECT_EQ(read_bytes(folder / "a.h5"), before);
  expect_valid(folder / "b.h5");
  expect_error([&] { recover_recording(folder / "a.h5", folder / "b.h5"); }, Error::Kind::input, {"b.h5", "exists"});
}

TEST(Recover, SavesTheRowsAroundThoseThatCannotBeRead) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  const std::vector<Sample> session = random_session(7, 10'000, {.reference = true});
  write_and_die(file, session, {.storage = {.deflate = 1, .rows_per_chunk = 1000}});
  // Random numbers hardly compress, so the bytes in the middle of the file are packed values.
  std::string bytes = read_bytes(file);
  for (std::size_t at = bytes.size() / 2; at < bytes.size() / 2 + 3000; at += 7)
    bytes[at] = static_cast<char>(~bytes[at]);
  std::ofstream(file, std::ios::binary) << bytes;
  const Recovery recovery = recover_recording(file);
  EXPECT_TRUE(recovery.needed);
  // If the velocity of a row cannot be read, the rest of the row is kept.
  EXPECT_GT(recovery.samples, 9000U);
  EXPECT_EQ(recovery.samples + recovery.unreadable, session.size());
  EXPECT_THAT(recovery.notes, testing::Contains(testing::HasSubstr("cannot be read in rows")));
  const RecordingReader reader(file);
  EXPECT_EQ(reader.rows(), recovery.samples);
  const auto events = reader.events();
  EXPECT_EQ(events.back().code, static_cast<int>(EventCode::recovered));
  EXPECT_TRUE(std::any_of(events.begin(), events.end(), [](const StoredEvent& event) {
    return event.code == static_cast<int>(EventCode::values_lost);
  }));
}

TEST(Recover, NeverTouchesTheFileWhenTheNewOneCannotBeWritten) {
  const TempFolder folder;
  write_and_die(folder / "a.h5", random_session(8, 1000, {.reference = true}), {});
  const std::string before = read_bytes(folder / "a.h5");
  rlimit old{};
  getrlimit(RLIMIT_FSIZE, &old);
  signal(SIGXFSZ, SIG_IGN);
  const rlimit small{.rlim_cur = before.size() / 2, .rlim_max = old.rlim_max};
  setrlimit(RLIMIT_FSIZE, &small);
  EXPECT_THROW(recover_recording(folder / "a.h5"), Error);
  setrlimit(RLIMIT_FSIZE, &old);
  EXPECT_EQ(read_bytes(folder / "a.h5"), before);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator{}), 1) << "a copy is left over";
  EXPECT_TRUE(recover_recording(folder / "a.h5").needed);
}

TEST(Recover, KeepsThePermissionsOfTheFile) {
  const TempFolder folder;
  write_and_die(folder / "a.h5", random_session(9, 100, {.reference = true}), {});
  chmod((folder / "a.h5").c_str(), 0640);
  recover_recording(folder / "a.h5");
  EXPECT_EQ(fs::status(folder / "a.h5").permissions(), static_cast<fs::perms>(0640));
}

}  // namespace
}  // namespace haptrace
