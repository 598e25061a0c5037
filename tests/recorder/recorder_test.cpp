#include "recorder/recorder.h"

#include "base/error.h"
#include "recorder/annotations.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"
#include "tests/support/temp_folder.h"

#include <chrono>
#include <csignal>
#include <functional>
#include <future>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <hdf5.h>
#include <random>
#include <sys/resource.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

namespace haptrace {
namespace {

using test::TempFolder;
using testing::HasSubstr;
using namespace std::chrono_literals;

Sample row(std::uint64_t i) {
  Sample sample;
  sample.tick = i;
  sample.time_ns = static_cast<std::int64_t>(i) * 1'000'000;
  sample.position = Vec3(1e-3 * static_cast<double>(i), 0.5, -0.25);
  sample.velocity = Vec3(0.1, 0.2, 0.3);
  sample.force = Vec3(1, 2, static_cast<double>(i));
  sample.phase = Phase::run;
  sample.buttons = static_cast<std::uint32_t>(i % 4);
  return sample;
}

void expect_prefix(const std::string& file, std::uint64_t least) {
  const RecordingReader reader(file);
  EXPECT_GE(reader.rows(), least);
  const auto rows = reader.read(0, reader.rows());
  for (std::uint64_t i = 0; i < rows.size(); ++i) {
    ASSERT_EQ(rows[i].tick, i);
    ASSERT_EQ(rows[i].position, row(i).position);
    ASSERT_EQ(rows[i].force, row(i).force);
    ASSERT_EQ(rows[i].buttons, row(i).buttons);
  }
}

TEST(Recorder, WritesEverySampleAndEventInOrder) {
  const TempFolder folder;
  Recorder recorder(folder / "a.h5", {}, {});
  for (std::uint64_t i = 0; i < 12345; ++i) {
    recorder.push(row(i));
    recorder.between_ticks(true);
    if (i % 5000 == 0) recorder.push(Event{.time_ns = row(i).time_ns, .code = EventCode::mark});
  }
  recorder.finish();
  EXPECT_EQ(recorder.status().written, 12345U);
  EXPECT_EQ(recorder.status().lost, 0U);
  expect_prefix(folder / "a.h5", 12345);
  const RecordingReader reader(folder / "a.h5");
  EXPECT_TRUE(reader.header().complete);
  const auto events = reader.events();
  ASSERT_EQ(events.size(), 3U);
  EXPECT_EQ(events[1].time, 5.0);
  EXPECT_EQ(events[1].text, "mark");
}

/// Runs `action` while no other thread can write. HDF5 calls back with its only lock held, which blocks the writer's
/// thread like a stalling disk.
void while_the_disk_stalls(const std::function<void()>& action) {
  const hid_t access = H5Pcreate(H5P_FILE_ACCESS);
  H5Pset_fapl_core(access, 4096, false);
  const hid_t file = H5Fcreate("stall", H5F_ACC_TRUNC, H5P_DEFAULT, access);
  H5Gclose(H5Gcreate2(file, "one", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
  const auto call = [](hid_t, const char*, const H5L_info_t*, void* what) -> herr_t {
    (*static_cast<const std::function<void()>*>(what))();
    return 0;
  };
  H5Literate(file, H5_INDEX_NAME, H5_ITER_NATIVE, nullptr, call, const_cast<std::function<void()>*>(&action));
  H5Fclose(file);
  H5Pclose(access);
}

TEST(Recorder, MakesTheServoLoopWaitInVirtualTimeAndLosesNothingThere) {
  const TempFolder folder;
  Recorder recorder(folder / "a.h5", {}, {}, {.ring_seconds = 0});
  std::promise<void> stalled;
  std::jthread stall([&] {
    while_the_disk_stalls([&] {
      stalled.set_value();
      std::this_thread::sleep_for(500ms);
    });
  });
  stalled.get_future().wait();
  for (std::uint64_t i = 0; i < 50'000; ++i) {
    recorder.push(row(i));
    recorder.between_ticks(true);
  }
  recorder.finish();
  EXPECT_EQ(recorder.status().lost, 0U);
  expect_prefix(folder / "a.h5", 50'000);
}

TEST(Recorder, CountsTheSamplesThatAFullRingLosesAndReportsThemInTheFile) {
  const TempFolder folder;
  Recorder recorder(folder / "a.h5", {}, {}, {.ring_seconds = 0});
  constexpr std::uint64_t kPushed = 50'000;
  while_the_disk_stalls([&] {
    for (std::uint64_t i = 0; i < kPushed; ++i) recorder.push(row(i));
  });
  recorder.finish();
  ASSERT_GT(recorder.status().lost, 0U);
  EXPECT_EQ(recorder.status().written + recorder.status().lost, kPushed);
  const RecordingReader reader(folder / "a.h5");
  EXPECT_EQ(reader.rows(), recorder.status().written);
  const auto events = reader.events();
  ASSERT_FALSE(events.empty());
  EXPECT_EQ(events.back().code, static_cast<std::int32_t>(EventCode::samples_lost));
  EXPECT_THAT(events.back().text, HasSubstr("samples lost"));
}

TEST(Recorder, AllocatesNothingInAPush) {
  const TempFolder folder;
  Recorder recorder(folder / "a.h5", {}, {});
  const std::size_t before = test::allocations();
  for (std::uint64_t i = 0; i < 2000; ++i) {
    recorder.push(row(i));
    recorder.push(Event{.code = EventCode::overrun});
    recorder.between_ticks(false);
  }
  EXPECT_EQ(test::allocations(), before);
}

TEST(Recorder, KeepsItsSamplesWhenItIsAbandonedButIsNotComplete) {
  const TempFolder folder;
  {
    Recorder recorder(folder / "a.h5", {}, {});
    for (std::uint64_t i = 0; i < 1000; ++i) recorder.push(row(i));
  }
  const RecordingReader reader(folder / "a.h5");
  EXPECT_FALSE(reader.header().complete);
  expect_prefix(folder / "a.h5", 1000);
}

TEST(Recorder, CanBeReadWhileItRecords) {
  const TempFolder folder;
  // The reader runs in another process, as in practice: HDF5 keeps a file that is open in this process to itself. The
  // process starts before the recorder's thread, because it would inherit the locks of that thread in any state.
  const pid_t reader = fork();
  if (reader == 0) {
    for (int attempt = 0; attempt < 200; ++attempt) {
      std::this_thread::sleep_for(50ms);
      try {
        if (RecordingReader(folder / "a.h5").rows() == 1000) _exit(0);
      } catch (...) {
        // The file does not exist yet.
      }
    }
    _exit(1);
  }
  Recorder recorder(folder / "a.h5", {}, {});
  for (std::uint64_t i = 0; i < 1000; ++i) recorder.push(row(i));
  int status = 0;
  ASSERT_EQ(waitpid(reader, &status, 0), reader);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << "the reader did not see every row";
  recorder.finish();
}

TEST(Recorder, ContinuesInFurtherFilesAtALimitOnTheirSize) {
  const TempFolder folder;
  signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  rlimit small = before;
  small.rlim_cur = 6'000'000;
  setrlimit(RLIMIT_FSIZE, &small);
  Recorder recorder(folder / "a.h5", {}, {});
  for (std::uint64_t i = 0; i < 100'000; ++i) {
    recorder.push(row(i));
    recorder.between_ticks(true);
  }
  recorder.finish();
  setrlimit(RLIMIT_FSIZE, &before);
  const RecorderStatus status = recorder.status();
  EXPECT_FALSE(status.failed);
  EXPECT_EQ(status.lost, 0U);
  EXPECT_EQ(status.written, 100'000U);
  EXPECT_GE(status.parts, 2U);
  const RecordingReader reader(folder / "a.h5");
  EXPECT_EQ(reader.parts(), status.parts);
  EXPECT_TRUE(reader.header().complete);
  const auto warnings = recorder.take_warnings();
  EXPECT_TRUE(std::any_of(warnings.begin(), warnings.end(),
                          [](const Warning& warning) { return warning.code == "recording_resumed"; }));
  expect_prefix(folder / "a.h5", 100'000);
}

// ------------------------------------------------------------------------------- parts, triggers, marks and pauses

void push_rows(Recorder& recorder, std::uint64_t first, std::uint64_t count) {
  for (std::uint64_t i = first; i < first + count; ++i) {
    recorder.push(row(i));
    recorder.between_ticks(true);
  }
}

void wait_until(const std::function<bool()>& condition) {
  for (int i = 0; i < 2000 && !condition(); ++i) std::this_thread::sleep_for(5ms);
  ASSERT_TRUE(condition());
}

TEST(Recorder, CutsPartsExactlyAtTheirTime) {
  const TempFolder folder;
  // Batches in the ring end anywhere; parts end at multiples of 1.5 s of the session.
  Recorder recorder(folder / "a.h5", {}, {}, {.split = {.seconds = 1.5}});
  push_rows(recorder, 0, 5000);
  recorder.finish();
  EXPECT_EQ(recorder.status().parts, 4U);
  EXPECT_EQ(recorder.status().written, 5000U);
  for (std::uint32_t part = 1; part <= 4; ++part) {
    const RecordingReader reader(part_file(folder / "a.h5", part), RecordingReader::Parts::this_file);
    ASSERT_EQ(reader.rows(), part < 4 ? 1500U : 500U) << part;
    EXPECT_EQ(reader.read(0, 1).front().tick, 1500U * (part - 1));
    EXPECT_TRUE(reader.header().complete);
  }
  expect_prefix(folder / "a.h5", 5000);
}

TEST(Recorder, CutsPartsAtTheirTimeEvenAcrossAGap) {
  const TempFolder folder;
  Recorder recorder(folder / "a.h5", {}, {}, {.split = {.seconds = 1}});
  push_rows(recorder, 0, 300);
  push_rows(recorder, 2700, 1200);
  recorder.finish();
  // The next part begins with the first sample that is at least a second after the first one of the present part.
  std::vector<std::uint64_t> begins;
  for (std::uint32_t part = 1; part <= recorder.status().parts; ++part)
    begins.push_back(
        RecordingReader(part_file(folder / "a.h5", part), RecordingReader::Parts::this_file).read(0, 1).front().tick);
  EXPECT_EQ(begins, (std::vector<std::uint64_t>{0, 2700, 3700}));
}

TEST(Recorder, CutsPartsBeforeTheyAreLarger) {
  const TempFolder folder;
  Recorder recorder(folder / "a.h5", {}, {}, {.split = {.bytes = 1'000'000}});
  for (std::uint64_t i = 0; i < 6; ++i) {
    push_rows(recorder, i * 5000, 5000);
    wait_until([&] { return recorder.status().written == (i + 1) * 5000; });
  }
  recorder.finish();
  EXPECT_GE(recorder.status().parts, 3U);
  for (std::uint32_t part = 1; part < recorder.status().parts; ++part) {
    EXPECT_GE(std::filesystem::file_size(part_file(folder / "a.h5", part)), 600'000U);
    EXPECT_LE(std::filesystem::file_size(part_file(folder / "a.h5", part)), 1'000'000U);
  }
  expect_prefix(folder / "a.h5", 30'000);
}

TEST(Recorder, KeepsTheSameSamplesWhenItWaitsForTheDisk) {
  const TempFolder folder;
  Recorder recorder(folder / "a.h5", {}, {}, {.sync_period = 0.02});
  for (std::uint64_t i = 0; i < 10; ++i) {
    push_rows(recorder, i * 100, 100);
    std::this_thread::sleep_for(10ms);
  }
  recorder.finish();
  EXPECT_TRUE(RecordingReader(folder / "a.h5").header().complete);
  expect_prefix(folder / "a.h5", 1000);
}

TEST(Recorder, KeepsMarksAndPausesThatComeFromAnotherThread) {
  const TempFolder folder;
  const auto annotations = std::make_shared<Annotations>();
  Recorder recorder(folder / "a.h5", {}, {}, {.annotations = annotations});
  std::atomic<bool> done{false};
  constexpr int kTimes = 20;
  std::jthread person([&] {
    for (int i = 0; i < kTimes; ++i) {
      annotations->mark("mark " + std::to_string(i));
      std::this_thread::sleep_for(3ms);
      annotations->pause();
      std::this_thread::sleep_for(3ms);
      annotations->resume();
    }
    done = true;
  });
  std::uint64_t pushed = 0;
  for (; !done; ++pushed) {
    recorder.push(row(pushed));
    std::this_thread::sleep_for(200us);
  }
  person.join();
  recorder.finish();
  const RecordingReader reader(folder / "a.h5");
  const std::vector<StoredEvent> events = reader.events();
  ASSERT_EQ(events.size(), 3U * kTimes);
  for (std::size_t i = 0; i < events.size(); ++i) {
    constexpr EventCode kOrder[] = {EventCode::mark, EventCode::paused, EventCode::resumed};
    EXPECT_EQ(events[i].code, static_cast<std::int32_t>(kOrder[i % 3])) << i;
    EXPECT_GE(events[i].time, events[i - std::min<std::size_t>(i, 1)].time);
    EXPECT_EQ(events[i].text, i % 3 == 0 ? "mark " + std::to_string(i / 3) : i % 3 == 1 ? "paused" : "resumed");
  }
  EXPECT_LT(reader.rows(), pushed);
  EXPECT_EQ(reader.rows(), recorder.status().written);
  for (const Sample& sample : reader.read(0, reader.rows())) {
    ASSERT_LT(sample.tick, pushed);
    ASSERT_EQ(sample.position, row(sample.tick).position);
  }
  EXPECT_EQ(recorder.status().lost, 0U) << "what is left out on purpose is not lost";
}

TEST(Recorder, ReportsThatItIsPausedAndKeepsNothingMeanwhile) {
  const TempFolder folder;
  const auto annotations = std::make_shared<Annotations>();
  Recorder recorder(folder / "a.h5", {}, {}, {.annotations = annotations});
  push_rows(recorder, 0, 100);
  wait_until([&] { return recorder.status().written == 100; });
  annotations->pause();
  push_rows(recorder, 100, 100);
  wait_until([&] { return recorder.status().paused; });
  annotations->resume();
  push_rows(recorder, 200, 100);
  wait_until([&] { return !recorder.status().paused && recorder.status().written >= 200; });
  recorder.finish();
  const std::vector<Sample> rows = RecordingReader(folder / "a.h5").read(0, 1000);
  // Pause and resume act at the newest tick, or after it if the writer has taken its row from the ring already.
  ASSERT_THAT(rows.size(), testing::AnyOf(200U, 201U));
  EXPECT_EQ(rows[99].tick, 99U);
  EXPECT_EQ(rows[100].tick, 400U - rows.size());
}

TEST(Recorder, StartsWithTheSamplesBeforeTheTrigger) {
  const TempFolder folder;
  Recorder recorder(folder / "a.h5", {}, {}, {.capture = {.pre = 0.25}});
  push_rows(recorder, 0, 1000);
  EXPECT_TRUE(recorder.status().armed || recorder.status().written == 0);
  recorder.push(Event{.time_ns = row(1000).time_ns, .code = EventCode::triggered, .values = {0, 1, 0.5}});
  push_rows(recorder, 1000, 500);
  recorder.finish();
  EXPECT_FALSE(recorder.status().armed);
  const RecordingReader reader(folder / "a.h5");
  ASSERT_EQ(reader.rows(), 750U);
  const std::vector<Sample> rows = reader.read(0, 750);
  EXPECT_EQ(rows.front().tick, 750U);
  EXPECT_EQ(rows.front().time_ns, 0);
  const std::vector<StoredEvent> events = reader.events();
  ASSERT_EQ(events.size(), 1U);
  EXPECT_DOUBLE_EQ(events.front().time, 0.25);
}

TEST(Recorder, ReportsThatTheTriggerDidNotFire) {
  const TempFolder folder;
  Recorder recorder(folder / "a.h5", {}, {}, {.capture = {.pre = 1}});
  push_rows(recorder, 0, 5000);
  recorder.finish();
  EXPECT_TRUE(recorder.status().armed);
  EXPECT_EQ(recorder.status().written, 0U);
  const std::vector<Warning> warnings = recorder.take_warnings();
  EXPECT_THAT(warnings, testing::Contains(testing::Field(&Warning::text, HasSubstr("a.h5: the trigger did not fire"))));
  EXPECT_TRUE(recorder.take_warnings().empty()) << "warned once";
  const RecordingReader reader(folder / "a.h5");
  EXPECT_EQ(reader.rows(), 0U);
  EXPECT_TRUE(reader.header().complete);
}

TEST(Recorder, ReportsTheRemainingTimeOfTheDiskAndTheTimeWithoutAnAnswer) {
  const TempFolder folder;
  Recorder recorder(folder / "a.h5", {}, {});
  const std::filesystem::space_info space = std::filesystem::space(folder.path());
  EXPECT_NEAR(recorder.status().disk_seconds, static_cast<double>(space.available) / (97 * 1000),
              0.2 * static_cast<double>(space.available) / (97 * 1000));
  while_the_disk_stalls([&] {
    push_rows(recorder, 0, 100);
    wait_until([&] { return recorder.status().stalled > 0.3; });
  });
  wait_until([&] { return recorder.status().stalled < 0.1 && recorder.status().written == 100; });
  EXPECT_EQ(recorder.status().lost, 0U);
  recorder.finish();
  EXPECT_EQ(recorder.status().stalled, 0);
}

TEST(Recorder, RejectsInvalidOptions) {
  const TempFolder folder;
  const auto refuses = [&](const RecorderOptions& options, const RecordingHeader& header, const char* part) {
    EXPECT_THAT(test::error_of([&] { Recorder(folder / "a.h5", header, {}, options); }), HasSubstr(part));
  };
  refuses({.sync_period = -1}, {}, "--sync is -1 s");
  refuses({.sync_period = 3601}, {}, "from 0 (never) to 3600 s");
  refuses({.storage = {.deflate = 10}}, {}, "10");
  refuses({.capture = {.pre = -1}}, {}, "before the trigger is -1 s");
  RecordingHeader slow;
  slow.rate_hz = 100;
  refuses({.storage = {.deflate = 1}}, slow, "cannot be compressed while it grows");
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(Split, IsATimeOrASize) {
  EXPECT_EQ(parse_split("30min").seconds, 1800);
  EXPECT_EQ(parse_split("1.5h").seconds, 5400);
  EXPECT_EQ(parse_split("90s").seconds, 90);
  EXPECT_EQ(parse_split("90sec").seconds, 90);
  EXPECT_EQ(parse_split("30 min").seconds, 1800);
  EXPECT_EQ(parse_split("2 GiB").bytes, 2U << 30U);
  EXPECT_EQ(parse_split("1GiB").bytes, 1U << 30U);
  EXPECT_EQ(parse_split("500MB").bytes, 500'000'000U);
  for (const char* text : {"", "30", "min", "0s", "-1h", "1kB", "30 mm", "1e300h", "nans", "infGB", "999kMB"})
    EXPECT_THAT(test::error_of([&] { (void)parse_split(text); }), HasSubstr("neither a time from 1 s")) << text;
}

}  // namespace
}  // namespace haptrace
