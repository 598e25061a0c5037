// Tests of sessions on a faulty disk: the real command, on a C library that fails below HDF5 (preload.cpp). In every
// case the session continues, the command reports the fault at once, the data that could be kept is valid, and the exit
// code shows the fault.
#include "formats/recording/recording_layout.h"
#include "tests/cli/command.h"
#include "tests/formats/support.h"

#include <cerrno>
#include <chrono>
#include <csignal>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

namespace haptrace {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using Words = std::vector<std::string>;

constexpr auto kNoInput = Command::Input::none;

/// Returns the environment of a disk with these faults for files whose path contains `file`.
Words disk(Words faults, const std::string& file = "out") {
  faults.push_back("FAULT_PATH=" + file);
  faults.emplace_back("LD_PRELOAD=" FAULTS_PRELOAD);
  // AddressSanitizer checks that it is loaded first; another library is preloaded here.
  const char* options = std::getenv("ASAN_OPTIONS");
  faults.push_back(fmt::format("ASAN_OPTIONS={}:verify_asan_link_order=0", options == nullptr ? "" : options));
  return faults;
}

std::string full(std::uint64_t bytes, int error = ENOSPC) {
  return fmt::format("FAULT_ROOM={}|FAULT_ERRNO={}", bytes, error);
}

Words split(const std::string& text) {
  Words words;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end = std::min(text.find('|', begin), text.size());
    if (end > begin) words.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return words;
}

/// Returns all rows of a recording and expects it to be valid, though perhaps unfinished.
std::vector<Sample> rows_of(const std::string& file) {
  const RecordingReader reader(file);
  std::vector<Sample> rows = reader.read(0, reader.rows());
  for (std::size_t i = 1; i < rows.size(); ++i) {
    EXPECT_GT(rows[i].time_ns, rows[i - 1].time_ns) << i;
    EXPECT_GT(rows[i].tick, rows[i - 1].tick) << i;
  }
  for (const Finding& finding : check_recording(file))
    EXPECT_NE(finding.severity, Severity::problem) << finding.where << ": " << finding.what;
  return rows;
}

bool complete(const std::string& file) {
  return RecordingReader(file).header().complete;
}

// -------------------------------------------------------------------------------------------------------- virtual time

struct Fault {
  const char* name;
  std::string disk;
  const char* says;  ///< part of the error; null: nothing is lost
};

void PrintTo(const Fault& fault, std::ostream* out) {
  *out << fault.disk;
}

/// A playback in virtual time; its samples are bit-identical in every run.
class Play {
 public:
  explicit Play(const std::string& duration = "12") {
    EXPECT_EQ(test::haptrace("shape", "square", "--size", "0.04", "--duration", duration, "-o", path_).exit_code, 0);
  }

  [[nodiscard]] Words words(const std::string& name) const {
    return {"play", path_, "--device", kFalcon, "--rate", "4000", "--record", folder_ / name, "--json"};
  }
  std::string operator/(const std::string& name) const { return folder_ / name; }

 private:
  TempFolder folder_;
  std::string path_ = folder_ / "square.h5";
};

class FaultsInVirtualTime : public testing::TestWithParam<Fault> {};

TEST(KilledWithinAWrite, AFileCanBeReadWhereverTheWriteEnds) {
  // A kill ends a write at a page boundary. Long texts fill the headers, so that many objects span two pages.
  const Play play("1");
  Words words = play.words("out.h5");
  words.insert(words.end(), {"--title", std::string(3000, 't'), "--kp", "900", "--kd", "30"});
  int readable = 0;
  for (int killed_at = 1;; ++killed_at) {
    std::error_code ignored;
    fs::remove(play / "out.h5", ignored);
    const Answer answer = Command(words, kNoInput, disk({fmt::format("FAULT_TORN={}", killed_at)})).wait();
    if (answer.exit_code != 128 + SIGKILL && answer.exit_code != -SIGKILL) {
      EXPECT_TRUE(complete(play / "out.h5")) << answer.exit_code << answer.err;
      break;
    }
    ASSERT_LT(killed_at, 2000);
    if (!fs::exists(play / "out.h5")) continue;  // killed before the file got its name
    ++readable;
    rows_of(play / "out.h5");
    EXPECT_FALSE(complete(play / "out.h5"));
  }
  EXPECT_GT(readable, 20);
}

TEST_P(FaultsInVirtualTime, CostNoSampleThatCouldBeKept) {
  const Play play;
  ASSERT_EQ(Command(play.words("whole.h5")).wait().exit_code, 0);
  const std::vector<Sample> whole = rows_of(play / "whole.h5");

  const Answer answer = Command(play.words("out.h5"), kNoInput, disk(split(GetParam().disk))).wait();
  const std::vector<Sample> rows = rows_of(play / "out.h5");
  EXPECT_EQ(answer.json()["stopped_by"], "finished") << "the session continues";
  EXPECT_EQ(answer.json()["session_samples"], whole.size());
  EXPECT_EQ(answer.json()["samples"], rows.size()) << "what is said is what is in the file";
  EXPECT_EQ(answer.json()["lost"], whole.size() - rows.size());
  expect_same(rows, std::span(whole).first(std::min(rows.size(), whole.size())));
  if (GetParam().says == nullptr) {
    EXPECT_EQ(answer.exit_code, 0) << answer.err;
    EXPECT_EQ(rows.size(), whole.size());
    EXPECT_TRUE(complete(play / "out.h5"));
    return;
  }
  EXPECT_EQ(answer.exit_code, 1);
  EXPECT_THAT(answer.err, testing::AllOf(HasSubstr(play / "out.h5"), HasSubstr(GetParam().says)));
  EXPECT_THAT(answer.json()["recording_error"].get<std::string>(), HasSubstr(GetParam().says));
  EXPECT_GT(rows.size(), 4000U);
  EXPECT_LT(rows.size(), whole.size());
  EXPECT_FALSE(complete(play / "out.h5"));
  // A disk that refuses to reserve space still writes every earlier sample.
  if (GetParam().disk.find("FAULT_ROOM") == 0) {
    EXPECT_THAT(answer.err, HasSubstr(fmt::format("recording stopped after {} samples", rows.size())));
  }
}

INSTANTIATE_TEST_SUITE_P(
    Disks, FaultsInVirtualTime,
    testing::Values(Fault{"AFullDisk", full(4'500'000), "No space left on device"},
                    Fault{"AUsedUpQuota", full(5'000'001, EDQUOT), "Disk quota exceeded"},
                    Fault{"AFullDiskThatHdf5Meets", "FAULT_DELAY_MS=2|FAULT_NO_CLAIM=1|" + full(2'000'000),
                          "No space left on device"},
                    Fault{"AQuotaThatHdf5Meets", "FAULT_DELAY_MS=2|FAULT_NO_CLAIM=1|" + full(2'300'003, EDQUOT),
                          "Disk quota exceeded"},
                    Fault{"ABrokenDisk", fmt::format("FAULT_DELAY_MS=2|FAULT_AFTER=3000000|FAULT_ERRNO={}", EIO),
                          "Input/output error"},
                    Fault{"ADiskThatCannotClaim", "FAULT_NO_CLAIM=1", nullptr},
                    Fault{"ShortWrites", "FAULT_SHORT=1000", nullptr},
                    Fault{"InterruptedCalls", "FAULT_INTERRUPT=1", nullptr},
                    Fault{"ASlowDisk", "FAULT_DELAY_MS=2", nullptr},
                    Fault{"AStall", "FAULT_STALL_MS=2500|FAULT_STALL_AFTER=1000000", nullptr}),
    [](const auto& instance) { return instance.param.name; });

// ----------------------------------------------------------------------------------------------------------- real time

/// A recording in real time that runs until end(); messages before that appear while it runs.
class Endless {
 public:
  explicit Endless(const Words& faults = {}, const char* rate = "1000")
      : file(folder / "in/out.h5"),
        command_((fs::create_directory(folder / "in"),
                  Words{"record", file, "--device", kFalcon, "--clock", "real", "--rate", rate, "--json"}),
                 kNoInput, disk(faults)) {}

  bool says(std::string_view part) { return command_.says(part); }

  /// Waits until part of the recording is on the disk.
  void wait_for_rows() const {
    for (int i = 0; i < 2400 && !(fs::exists(file) && fs::file_size(file) > 50'000); ++i)
      std::this_thread::sleep_for(25ms);
  }

  [[nodiscard]] pid_t pid() const { return command_.pid(); }

  /// Ends the recording with a signal and expects a session without faults.
  Answer end(int exit_code, int signal = SIGINT) {
    kill(command_.pid(), signal);
    Answer answer = command_.wait();
    EXPECT_EQ(answer.exit_code, exit_code) << answer.err;
    EXPECT_EQ(answer.json()["stopped_by"], "interrupted");
    return answer;
  }

  const TempFolder folder;
  const std::string file;

 private:
  Command command_;
};

/// Expects a complete recording with a row for every tick.
void expect_whole(const std::string& file, const Answer& answer) {
  EXPECT_EQ(answer.json()["lost"], 0);
  EXPECT_EQ(rows_of(file).size(), answer.json()["samples"]);
  EXPECT_TRUE(complete(file));
}

struct LiveFault {
  const char* name;
  std::string disk;
  const char* says;
  const char* rate;
};

void PrintTo(const LiveFault& fault, std::ostream* out) {
  *out << fault.disk;
}

class FaultsInRealTime : public testing::TestWithParam<LiveFault> {};

TEST_P(FaultsInRealTime, AreReportedAtOnceAndTheSessionContinues) {
  Endless session(split(GetParam().disk), GetParam().rate);
  ASSERT_TRUE(session.says(GetParam().says));
  const Answer answer = session.end(1);
  EXPECT_THAT(answer.err, HasSubstr(session.file));
  const std::vector<Sample> rows = rows_of(session.file);
  EXPECT_GT(rows.size(), 500U);
  EXPECT_EQ(rows.size(), answer.json()["samples"]);
  EXPECT_EQ(rows.size() + answer.json()["lost"].get<std::size_t>(), answer.json()["session_samples"]);
  EXPECT_FALSE(complete(session.file));
}

INSTANTIATE_TEST_SUITE_P(
    Disks, FaultsInRealTime,
    testing::Values(LiveFault{"AFullDisk", full(3'300'000), "No space left on device", "20000"},
                    LiveFault{"AUsedUpQuota", full(3'500'000, EDQUOT), "Disk quota exceeded", "20000"},
                    LiveFault{"AFullDiskThatHdf5Meets", "FAULT_DELAY_MS=2|FAULT_NO_CLAIM=1|" + full(400'000),
                              "No space left", "5000"},
                    LiveFault{"ABrokenDisk", "FAULT_AFTER=3000000", "Input/output error", "1000"}),
    [](const auto& instance) { return instance.param.name; });

class PassingFaults : public testing::TestWithParam<LiveFault> {};

TEST_P(PassingFaults, CostNoSampleAndAreEventsOfTheNextPart) {
  Endless session(split(GetParam().disk), GetParam().rate);
  ASSERT_TRUE(session.says(GetParam().says));
  ASSERT_TRUE(session.says("recording continues in a further file"));
  std::this_thread::sleep_for(300ms);
  const Answer answer = session.end(130);
  EXPECT_EQ(answer.json()["lost"], 0);
  EXPECT_EQ(answer.json()["parts"], 2);
  EXPECT_EQ(answer.json()["samples"], answer.json()["session_samples"]);
  EXPECT_EQ(rows_of(session.file).size(), answer.json()["samples"]);
  EXPECT_TRUE(complete(session.file));
  std::vector<std::string> told;
  for (const StoredEvent& event : RecordingReader(session.file).events())
    if (event.code == static_cast<int>(EventCode::recording_resumed)) told.push_back(event.text);
  ASSERT_EQ(told.size(), 1U);
  EXPECT_THAT(told.front(), HasSubstr("0 samples are missing"));
  std::vector<std::string> codes;
  const nlohmann::json json = answer.json();
  for (const nlohmann::json& warning : json["warnings"]) codes.push_back(warning["code"]);
  EXPECT_THAT(codes, testing::IsSupersetOf({"recording_interrupted", "recording_resumed"}));
}

INSTANTIATE_TEST_SUITE_P(Disks, PassingFaults,
                         testing::Values(LiveFault{"ADiskThatIsBackAfterHalfASecond",
                                                   "FAULT_AFTER=400000|FAULT_BACK_MS=500", "Input/output error",
                                                   "1000"},
                                         LiveFault{"RoomThatIsMade", "FAULT_BACK_MS=1500|" + full(3'300'000),
                                                   "No space left on device", "20000"}),
                         [](const auto& instance) { return instance.param.name; });

TEST(Recording, GivesUpOnADiskThatIsNotBackWhenTheSessionEnds) {
  Endless session({"FAULT_AFTER=400000"});
  ASSERT_TRUE(session.says("the recorder tries to continue in a further file"));
  std::this_thread::sleep_for(500ms);
  const Answer answer = session.end(1);
  EXPECT_EQ(answer.json()["samples"], rows_of(session.file).size());
  EXPECT_GT(answer.json()["lost"], 300);
  EXPECT_EQ(fs::exists(part_file(session.file, 2)), false);
}

TEST(Recording, ContinuesInAFurtherPartWhenAnotherFileIsCopiedOverIt) {
  const TempFolder folder;
  const std::string other = folder / "other.h5";
  ASSERT_EQ(test::haptrace("record", other, "--device", kFalcon, "--duration", "1").exit_code, 0);
  const std::string bytes = read_bytes(other);
  Endless session({"FAULT_COPY=" + other, "FAULT_COPY_AFTER=2000000"}, "10000");  // memory cannot hold all samples
  ASSERT_TRUE(session.says("another program overwrote it"));
  ASSERT_TRUE(session.says("recording continues in a further file"));
  const Answer answer = session.end(1);  // samples that were only in the file are lost
  EXPECT_EQ(read_bytes(session.file), bytes) << "nothing of ours is written into it";
  const std::string part = part_file(session.file, 2);
  const RecordingReader reader(part);
  EXPECT_EQ(reader.rows() + answer.json()["lost"].get<std::size_t>(), answer.json()["session_samples"]);
  for (const Finding& finding : check_recording(part)) EXPECT_NE(finding.severity, Severity::problem);
}

TEST(Recording, OutlastsAStallOfFiveSecondsAndEndsGentlyInIt) {
  Endless session({"FAULT_STALL_MS=5000", "FAULT_STALL_AFTER=200000"});
  ASSERT_TRUE(session.says("the disk has not answered for"));
  expect_whole(session.file, session.end(130, SIGTERM));
}

TEST(Recording, KeepsUpWithASlowNetworkMount) {
  Endless session({"FAULT_DELAY_MS=20"});
  session.wait_for_rows();
  std::this_thread::sleep_for(2s);
  expect_whole(session.file, session.end(130, SIGHUP));
}

TEST(Recording, IsRescuedFromARemovedFolder) {
  Endless session;
  session.wait_for_rows();
  fs::remove_all(session.folder / "in");
  ASSERT_TRUE(session.says("was removed while it is being written; it will be kept as " + session.folder / "out.h5"));
  const Answer answer = session.end(1);
  EXPECT_THAT(answer.err, HasSubstr("the recording was kept as " + session.folder / "out.h5"));
  expect_whole(session.folder / "out.h5", answer);
}

TEST(Recording, IsKeptBesideAFileThatReplacesIt) {
  Endless session;
  session.wait_for_rows();
  fs::rename(session.folder.write("other", "other"), session.file);
  const std::string kept = session.folder / "in/out.rescued1.h5";
  ASSERT_TRUE(session.says(kept));
  const Answer answer = session.end(1);
  expect_whole(kept, answer);
  EXPECT_EQ(read_bytes(session.file), "other");
}

TEST(Recording, ContinuesInAFileThatIsMoved) {
  Endless session;
  session.wait_for_rows();
  fs::rename(session.file, session.folder / "elsewhere.h5");
  ASSERT_TRUE(session.says("was moved while it is being written; it is now " + session.folder / "elsewhere.h5"));
  expect_whole(session.folder / "elsewhere.h5", session.end(130));
}

TEST(Recording, ContinuesWithoutThePermissionsOfItsFile) {
  Endless session;
  session.wait_for_rows();
  fs::permissions(session.file, fs::perms::none);
  fs::permissions(session.folder / "in", fs::perms::none);
  std::this_thread::sleep_for(500ms);
  const Answer answer = session.end(130);
  fs::permissions(session.folder / "in", fs::perms::owner_all);
  fs::permissions(session.file, fs::perms::owner_all);
  expect_whole(session.file, answer);
}

TEST(Recording, ContinuesInAFurtherFileAtASizeLimitSetDuringTheSession) {
  Endless session({}, "20000");
  session.wait_for_rows();
  const rlimit limit{fs::file_size(session.file) + 3'000'000, RLIM_INFINITY};
  ASSERT_EQ(prlimit(session.pid(), RLIMIT_FSIZE, &limit, nullptr), 0);
  ASSERT_TRUE(session.says("recording continues in a further file"));
  const Answer answer = session.end(130);
  EXPECT_EQ(answer.json()["lost"], 0);
  EXPECT_GE(answer.json()["parts"], 2);
  EXPECT_EQ(rows_of(session.file).size(), answer.json()["session_samples"]);
}

/// Processes that keep every core busy.
class BusyCores {
 public:
  BusyCores() {
    for (unsigned i = 0; i < 2 * std::thread::hardware_concurrency(); ++i) {
      const pid_t child = fork();
      if (child == 0)
        for (volatile unsigned spin = 0;;) spin = spin + 1;
      children_.push_back(child);
    }
  }
  ~BusyCores() {
    for (const pid_t child : children_) kill(child, SIGKILL);
    for (const pid_t child : children_) waitpid(child, nullptr, 0);
  }
  BusyCores(const BusyCores&) = delete;
  BusyCores& operator=(const BusyCores&) = delete;

 private:
  std::vector<pid_t> children_;
};

TEST(Recording, LosesNothingWhenItsWriterHardlyEverRuns) {
  Endless session;
  session.wait_for_rows();
  // Lower the priority of all its threads except the servo loop's, if that is a real-time thread.
  for (const auto& thread : fs::directory_iterator(fmt::format("/proc/{}/task", session.pid()))) {
    const pid_t id = std::stoi(thread.path().filename());
    const sched_param none{};
    if (sched_getscheduler(id) != SCHED_OTHER) continue;
    ASSERT_EQ(sched_setscheduler(id, SCHED_IDLE, &none), 0);
  }
  {
    const BusyCores busy;
    std::this_thread::sleep_for(2s);
  }
  expect_whole(session.file, session.end(130));
}

// --------------------------------------------------------------------------------------- faults through the library

/// Returns the position of a sample [um]; recording_session.cpp defines the movement.
std::int64_t row_of(const Sample& sample) {
  return std::llround(1e6 * sample.position.x());
}

Command known_movement(const std::string& file, Words options, const Words& faults) {
  options.insert(options.begin(), file);
  return Command(options, kNoInput, disk(faults), RECORDING_SESSION);
}

std::int64_t known_position(std::uint64_t row) {
  return std::llabs(static_cast<std::int64_t>(row % 100'000) - 50'000);
}

TEST(Recording, CountsEveryLossAndShowsTheGapWhenItOverflows) {
  const TempFolder folder;
  const std::string file = folder / "out.h5";
  Command session =
      known_movement(file, {"clock=real", "rate=10000", "ring=0"}, {"FAULT_STALL_MS=4000", "FAULT_STALL_AFTER=300000"});
  ASSERT_TRUE(session.says("samples were lost so far"));
  // Wait until after the stall, so that there are rows on both sides of the gap.
  std::this_thread::sleep_for(3s);
  kill(session.pid(), SIGINT);
  const Answer answer = session.wait();
  EXPECT_EQ(answer.exit_code, 1);
  const std::uint64_t ran = answer.json()["session_samples"], lost = answer.json()["lost"];
  const std::vector<Sample> rows = rows_of(file);
  EXPECT_GT(lost, 1000U);
  EXPECT_EQ(rows.size() + lost, ran);
  EXPECT_TRUE(complete(file)) << "the recording itself was finished";

  // The rows are those before and after the gap, and the gap is as long as the reported count.
  std::uint64_t at = 0, skipped = 0;
  for (const Sample& row : rows) {
    while (at < ran && row_of(row) != known_position(at)) ++at, ++skipped;
    ++at;
  }
  EXPECT_EQ(at, ran);
  EXPECT_EQ(skipped, lost);

  std::uint64_t told = 0;
  for (const StoredEvent& event : RecordingReader(file).events())
    if (event.code == static_cast<std::int32_t>(EventCode::samples_lost)) told += std::stoull(event.text);
  EXPECT_EQ(told, lost);
}

TEST(Recording, ReportsAtOnceThatItCannotWaitForTheDisk) {
  const TempFolder folder;
  Command session = known_movement(folder / "out.h5", {"clock=real", "sync=0.2"}, {"FAULT_SYNC=1"});
  ASSERT_TRUE(session.says("cannot be synced to the disk: Input/output error"));
  kill(session.pid(), SIGINT);
  EXPECT_EQ(session.wait().exit_code, 1);
  EXPECT_GT(rows_of(folder / "out.h5").size(), 100U);
}

TEST(Recording, KeepsThePartsBeforeTheDiskBroke) {
  const TempFolder folder;
  const std::string file = folder / "out.h5";
  for (const auto& [faults, says] : {std::pair<Words, std::string>{{"FAULT_AFTER=5000000"}, "Input/output error"},
                                     {{"FAULT_CREATE=1"}, "the recording ends with part 3"}}) {
    Words variables = disk(faults, faults.front() == "FAULT_CREATE=1" ? "part004" : "out");
    const Answer answer = Command({file, "duration=60", "split=10s"}, kNoInput, variables, RECORDING_SESSION).wait();
    EXPECT_EQ(answer.exit_code, 1);
    EXPECT_THAT(answer.err, HasSubstr(says));
    const RecordingReader reader(file);
    EXPECT_GE(reader.parts(), 3U);
    EXPECT_GE(reader.rows(), 30'000U);
    const std::vector<Sample> rows = reader.read(0, reader.rows());
    for (std::size_t i = 0; i < rows.size(); ++i) ASSERT_EQ(row_of(rows[i]), known_position(i)) << i;
    for (const fs::path& part : {fs::path(file), fs::path(part_file(file, 2)), fs::path(part_file(file, 3)),
                                 fs::path(part_file(file, 4)), fs::path(part_file(file, 5))})
      fs::remove(part);
  }
}

TEST(Recording, LeavesNothingBehindIfItCannotBeCreated) {
  for (const int error : {ENOSPC, EDQUOT, EROFS, EACCES}) {
    const TempFolder folder;
    const Answer answer = Command({"record", folder / "out.h5", "--device", kFalcon, "--duration", "1"}, kNoInput,
                                  disk({"FAULT_CREATE=1", fmt::format("FAULT_ERRNO={}", error)}))
                              .wait();
    EXPECT_EQ(answer.exit_code, 2);
    EXPECT_THAT(answer.err, testing::AllOf(HasSubstr(folder / "out.h5"), HasSubstr(std::strerror(error))));
    EXPECT_TRUE(fs::is_empty(folder.path()));
  }
}

/// A disk of `bytes` at `folder`: a tmpfs if the system allows mounting it, otherwise the preloaded fake.
class SmallDisk {
 public:
  SmallDisk(std::string folder, std::uint64_t bytes) : folder_(std::move(folder)) {
    mounted_ = mount("none", folder_.c_str(), "tmpfs", 0, fmt::format("size={}", bytes).c_str()) == 0;
    if (!mounted_) variables_ = disk(split(full(bytes)));
  }
  ~SmallDisk() {
    if (mounted_) umount2(folder_.c_str(), MNT_DETACH);
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;
  [[nodiscard]] const Words& variables() const { return variables_; }

 private:
  std::string folder_;
  bool mounted_ = false;
  Words variables_;
};

TEST(Recording, EndsWithEverySampleThatFitsOnASmallDisk) {
  const TempFolder folder;
  const SmallDisk small(folder.path(), 8U << 20U);
  const std::string file = folder / "out.h5";
  const Answer answer = Command({file, "duration=200"}, kNoInput, small.variables(), RECORDING_SESSION).wait();
  EXPECT_EQ(answer.exit_code, 1);
  EXPECT_THAT(answer.err, HasSubstr("No space left on device"));
  EXPECT_EQ(answer.json()["stopped_by"], "finished");
  const std::vector<Sample> rows = rows_of(file);
  EXPECT_THAT(answer.err, HasSubstr(fmt::format("recording stopped after {} samples", rows.size())));
  EXPECT_GT(rows.size(), 40'000U);
  for (std::size_t i = 0; i < rows.size(); ++i) ASSERT_EQ(row_of(rows[i]), known_position(i)) << i;
}

}  // namespace
}  // namespace haptrace
