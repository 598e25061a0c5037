#include "recorder/recorder.h"

#include "control/error.h"
#include "tests/support/allocations.h"
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

TEST(Recorder, WritesEveryRowAndEventInOrder) {
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

/// Does something while nobody else can write: HDF5 calls back with its one lock held, as a disk that stalls would
/// keep the writer's thread in a call.
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

TEST(Recorder, CountsWhatFoundTheRingFullAndTellsInTheFile) {
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

TEST(Recorder, AbandonedKeepsItsRowsButIsNotComplete) {
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
  Recorder recorder(folder / "a.h5", {}, {});
  for (std::uint64_t i = 0; i < 1000; ++i) recorder.push(row(i));
  // Readers in other processes, as they would be; HDF5 keeps a file open in this one to itself.
  for (int attempt = 0;; ++attempt) {
    std::this_thread::sleep_for(50ms);
    const pid_t child = fork();
    if (child == 0) {
      try {
        _exit(RecordingReader(folder / "a.h5").rows() == 1000 ? 0 : 1);
      } catch (...) {
        _exit(2);
      }
    }
    int status = 0;
    waitpid(child, &status, 0);
    if (WEXITSTATUS(status) == 0) break;
    ASSERT_LT(attempt, 100) << "exit " << WEXITSTATUS(status);
  }
  recorder.finish();
}

TEST(Recorder, LosesAtMostTwoTenthsOfASecondToAKill) {
  std::mt19937 random(5);
  for (int kill_number = 0; kill_number < 5; ++kill_number) {
    const TempFolder folder;
    int pipe_ends[2];
    ASSERT_EQ(pipe(pipe_ends), 0);
    const pid_t child = fork();
    if (child == 0) {
      Recorder recorder(folder / "a.h5", {}, {});
      for (std::uint64_t i = 0;; ++i) {
        recorder.push(row(i));
        if (write(pipe_ends[1], &i, sizeof i) != sizeof i) _exit(1);
        std::this_thread::sleep_for(1ms);
      }
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(400 + random() % 400));
    kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
    close(pipe_ends[1]);
    std::uint64_t last = 0, i = 0;
    while (read(pipe_ends[0], &i, sizeof i) == sizeof i) last = i;
    close(pipe_ends[0]);
    // On a busy machine a millisecond's sleep is longer: rows are counted, which errs on the strict side.
    expect_prefix(folder / "a.h5", last > 200 ? last - 200 : 0);
    EXPECT_FALSE(RecordingReader(folder / "a.h5").header().complete);
  }
}

TEST(Recorder, OutlivesAFullDiskAndSaysSoAtTheEnd) {
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
  try {
    recorder.finish();
    ADD_FAILURE() << "the disk was full";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), Error::Kind::fault);
    EXPECT_THAT(error.what(), HasSubstr("a.h5"));
  }
  EXPECT_TRUE(recorder.status().failed);
  setrlimit(RLIMIT_FSIZE, &before);
  expect_prefix(folder / "a.h5", 10000);
}

}  // namespace
}  // namespace haptrace
