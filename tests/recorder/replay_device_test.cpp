#include "recorder/replay_device.h"

#include "formats/recording/recording.h"
#include "tests/devices/support.h"
#include "tests/support/allocations.h"

#include <atomic>
#include <functional>
#include <gmock/gmock.h>

namespace haptrace::test {
namespace {

using testing::HasSubstr;

ReplayDevice::Rows three_rows() {
  ReplayDevice::Rows recording;
  recording.time_ns = {0, 1'000'000, 5'000'000};
  recording.position = {Vec3(1, 0, 0), Vec3(2, 0, 0), Vec3(3, 0, 0)};
  return recording;
}

TEST(ReplayDevice, HoldsTheLastSampleAtOrBeforeItsTime) {
  ReplayDevice device({}, three_rows());
  EXPECT_EQ(exchange(device, Vec3::Zero(), 0).position.x(), 1);
  EXPECT_EQ(exchange(device, Vec3::Zero(), 0.9e-3).position.x(), 1);
  EXPECT_EQ(exchange(device, Vec3::Zero(), 0.1e-3).position.x(), 2);
  EXPECT_EQ(exchange(device, Vec3::Zero(), 3.999e-3).position.x(), 2);
  EXPECT_EQ(exchange(device, Vec3::Zero(), 0.001e-3).position.x(), 3);
}

TEST(ReplayDevice, KeepsAnsweringItsLastSample) {
  ReplayDevice device({}, three_rows());
  EXPECT_EQ(exchange(device, Vec3::Zero(), 1e6).position.x(), 3);
  EXPECT_EQ(exchange(device, Vec3::Zero(), 1).position.x(), 3);
}

TEST(ReplayDevice, MeetsEveryStampOfALongRecordingAtAnUnevenRate) {
  ReplayDevice::Rows recording;
  constexpr int kRows = 30000;
  for (int k = 0; k < kRows; ++k) {
    recording.time_ns.push_back(1'000'000'000LL * k / 3000);
    recording.position.emplace_back(k, 0, 0);
  }
  ReplayDevice device({}, recording);
  for (int k = 1; k < kRows; ++k) ASSERT_EQ(exchange(device, Vec3::Zero(), 1.0 / 3000).position.x(), k);
}

TEST(ReplayDevice, IgnoresForces) {
  ReplayDevice device({}, three_rows());
  EXPECT_EQ(exchange(device, Vec3(100, 0, 0), 1e-3).position, Vec3(2, 0, 0));
}

TEST(ReplayDevice, AnswersAPathInCsv) {
  const TempFolder folder;
  const std::string file = folder.write("path.csv", "t,x,y,z\n10,0.01,0,0\n10.002,0.02,0,0\n10.003,0.03,0,0.01\n");
  const auto device = open_device("replay:file=" + file);
  EXPECT_EQ(device->info().backend, "replay");
  EXPECT_TRUE(device->info().virtual_time);
  EXPECT_FALSE(device->info().measures_force);
  EXPECT_NEAR(device->info().workspace_max.x(), 0.031, 1e-12);
  EXPECT_EQ(exchange(*device, Vec3::Zero(), 1e-3).position, Vec3(0.01, 0, 0));
  EXPECT_EQ(exchange(*device, Vec3::Zero(), 1e-3).position, Vec3(0.02, 0, 0));
  EXPECT_EQ(exchange(*device, Vec3::Zero(), 1e-3).position, Vec3(0.03, 0, 0.01));
}

TEST(ReplayDevice, AnswersARecordingWithItsMeasuredForce) {
  const TempFolder folder;
  const std::string file = folder / "take.h5";
  RecordingHeader header;
  header.device_model = "omega.3";
  header.device_serial = "17";
  header.position_resolution_m = 1e-5;
  header.max_force_n = 12;
  header.rate_hz = 500;
  RecordingWriter writer(file, header, {.force_measured = true}, {});
  std::vector<Sample> samples(3);
  for (std::size_t k = 0; k < samples.size(); ++k) {
    samples[k].tick = k;
    samples[k].time_ns = 2'000'000 * static_cast<std::int64_t>(k);
    samples[k].position = Vec3(0.01 * static_cast<double>(k), 0, 0);
    samples[k].velocity = Vec3::Zero();
    samples[k].force_measured = Vec3(0, static_cast<double>(k), 0);
    samples[k].phase = k == 0 ? Phase::approach : Phase::run;
  }
  writer.append(samples);
  writer.finish();

  const auto device = open_device("replay:file=" + file);
  EXPECT_EQ(device->info().model, "omega.3");
  EXPECT_EQ(device->info().serial, "17");
  EXPECT_EQ(device->info().position_resolution, 1e-5);
  EXPECT_EQ(device->info().max_force, 12);
  EXPECT_EQ(device->info().nominal_rate, 500);
  EXPECT_TRUE(device->info().measures_force);
  EXPECT_EQ(exchange(*device, Vec3::Zero(), 0).position.x(), 0);
  EXPECT_EQ(exchange(*device, Vec3::Zero(), 2e-3).force.y(), 1);
  EXPECT_EQ(exchange(*device, Vec3::Zero(), 2e-3).position.x(), 0.02);
}

/// Returns a block of a recording at 1 kHz. Row k has x = k; every 1000th position is unknown.
ReplayDevice::Rows block_of_kilohertz(std::size_t block, std::size_t blocks, std::size_t rows) {
  ReplayDevice::Rows result;
  for (std::size_t k = block * rows; k < (block + 1) * rows; ++k) {
    result.time_ns.push_back(1'000'000 * static_cast<std::int64_t>(k));
    result.position.emplace_back(k % 1000 == 999 ? kNaN : static_cast<double>(k), 0, 0);
  }
  if (block + 1 < blocks) result.until_ns = 1'000'000 * static_cast<std::int64_t>((block + 1) * rows);
  return result;
}

std::unique_ptr<ReplayDevice> in_blocks(const std::function<void(std::size_t)>& before_each) {
  constexpr std::size_t kBlocks = 9, kRows = 500;
  return std::make_unique<ReplayDevice>(
      DeviceInfo{}, std::make_shared<const ReplayDevice::Rows>(block_of_kilohertz(0, kBlocks, kRows)), kBlocks,
      [=](std::size_t block) {
        before_each(block);
        return std::make_unique<const ReplayDevice::Rows>(block_of_kilohertz(block, kBlocks, kRows));
      });
}

TEST(ReplayDevice, GoesThroughALongRecordingBlockByBlockAndAllocatesNothingMeanwhile) {
  const auto device = in_blocks([](std::size_t) {});
  std::size_t allocated = 0;
  for (int k = 0; k < 4600; ++k) {
    DeviceState state;
    const std::size_t before = allocations();
    ASSERT_EQ(device->exchange({}, k == 0 ? 0 : 1e-3, state), Device::Status::ok);
    allocated += allocations() - before;
    const int row = std::min(k, 4499);
    ASSERT_EQ(state.position.x(), row % 1000 == 999 ? row - 1 : row);
    device->between_ticks(true);
  }
  EXPECT_EQ(allocated, 0U);
}

TEST(ReplayDevice, HoldsItsLastSampleWhileTheNextIsNotRead) {
  std::atomic<bool> open{false};
  const auto device = in_blocks([&](std::size_t block) {
    if (block >= 2) open.wait(false);
  });
  device->between_ticks(true);
  for (int k = 0; k < 1500; ++k) EXPECT_LE(exchange(*device, Vec3::Zero(), k == 0 ? 0 : 1e-3).position.x(), 998);
  EXPECT_EQ(exchange(*device, Vec3::Zero(), 0).position.x(), 998) << "row 999 has no position";
  open = true;
  open.notify_all();
  for (int i = 0; i < 3; ++i) {
    device->between_ticks(true);
    (void)exchange(*device, Vec3::Zero(), 0);
  }
  EXPECT_EQ(exchange(*device, Vec3::Zero(), 0).position.x(), 1499) << "where its time is by now";
}

TEST(ReplayDevice, IsLostWhereTheRecordingCannotBeRead) {
  const auto device = in_blocks([](std::size_t block) {
    if (block == 3) throw input_error("take.h5 is damaged");
  });
  DeviceState state;
  int answered = 0;
  while (device->exchange({}, answered == 0 ? 0 : 1e-3, state) == Device::Status::ok) {
    device->between_ticks(true);
    ASSERT_LE(++answered, 1500);
  }
  EXPECT_EQ(answered, 1500);
  EXPECT_EQ(device->exchange({}, 1e-3, state), Device::Status::lost);
  EXPECT_EQ(device->lost_reason(), "take.h5 is damaged");
}

TEST(ReplayDevice, AnswersEverySampleOfARecordingOfSeveralBlocks) {
  const TempFolder folder;
  constexpr std::size_t kRows = 2 * ReplayDevice::kBlock + 100;
  {
    RecordingWriter writer(folder / "long.h5", {}, {}, {});
    std::vector<Sample> samples(kRows);
    for (std::size_t k = 0; k < kRows; ++k) {
      samples[k].tick = k;
      samples[k].time_ns = 1'000'000 * static_cast<std::int64_t>(k);
      // The first rows have no position.
      if (k >= 7) samples[k].position = Vec3(1e-6 * static_cast<double>(k), 0, 0);
    }
    writer.append(samples);
    writer.finish();
  }
  const auto device = open_device("replay:file=" + folder / "long.h5");
  EXPECT_NEAR(device->info().natural_duration, 1e-3 * (kRows - 1), 1e-9);
  for (std::size_t k = 0; k < kRows; ++k) {
    const double x = exchange(*device, Vec3::Zero(), k == 0 ? 0 : 1e-3).position.x();
    ASSERT_EQ(x, 1e-6 * static_cast<double>(std::max<std::size_t>(k, 7)));
    device->between_ticks(true);
  }
}

TEST(ReplayDevice, NamesAFileThatItCannotRead) {
  EXPECT_THAT(open_error("replay"), HasSubstr("replay:file=NAME.h5"));
  EXPECT_THAT(open_error("replay:file=/no/such.h5"), HasSubstr("/no/such.h5"));
}

}  // namespace
}  // namespace haptrace::test
