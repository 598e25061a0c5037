#include "devices/replay_device.h"

#include "formats/recording.h"
#include "tests/devices/support.h"

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

TEST(ReplayDevice, SaysWhichFileItCannotRead) {
  EXPECT_THAT(open_error("replay"), HasSubstr("replay:file=NAME.h5"));
  EXPECT_THAT(open_error("replay:file=/no/such.h5"), HasSubstr("/no/such.h5"));
}

}  // namespace
}  // namespace haptrace::test
