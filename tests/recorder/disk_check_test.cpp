#include "recorder/disk_check.h"

#include "base/error.h"
#include "tests/devices/check/diagnoses.h"
#include "tests/support/temp_folder.h"

#include <cmath>
#include <filesystem>

namespace haptrace {
namespace {

namespace fs = std::filesystem;
using test::find, test::finding;
using test::TempFolder;
using testing::HasSubstr;
using testing::IsEmpty;

TEST(DiskCheck, MeasuresAFolderAsTheRecorderFindsItAndLeavesNothing) {
  for (const double rate : {100.0, 1000.0, 4000.0}) {
    const TempFolder folder;
    const DiskMeasurement disk = measure_disk(folder.path(), rate);
    EXPECT_GT(disk.write.count(), 0U);
    EXPECT_EQ(disk.write.count(), disk.sync.count());
    EXPECT_GT(disk.free_bytes, 0);
    // A row of position, velocity, force and the other fixed columns has 97 bytes.
    EXPECT_NEAR(disk.bytes_per_hour / (3600 * rate), 97, 12) << rate;
    EXPECT_TRUE(fs::is_empty(folder.path()));
  }
}

TEST(DiskCheck, RejectsAPathThatIsNotAFolder) {
  EXPECT_THROW((void)measure_disk("/nonexistent", 1000), Error);
}

TEST(DiskCheck, JudgesADiskByTheTimeThatTheRecordersRingBridges) {
  DiskMeasurement disk{.folder = "data", .bytes_per_hour = 3.5e8, .free_bytes = 3.5e9};
  const auto write = [&](double stall) {
    disk.write = disk.sync = {};
    disk.write.record(100'000, 200);
    disk.sync.record(100'000, 200);
    disk.write.record(std::llround(1e9 * stall));
    disk.write_total = 0.02 + stall;
    disk.sync_total = 0.02;
    return find(examine_disk(disk, 4), "disk write");
  };
  EXPECT_THAT(write(0.9), finding(Severity::ok, HasSubstr("max 900 ms"), IsEmpty()));
  EXPECT_THAT(write(1.1), finding(Severity::warning, HasSubstr("quarter"), HasSubstr("--folder")));
  EXPECT_THAT(write(4.1),
              finding(Severity::problem, HasSubstr("the ring buffer bridges only 4 s"), HasSubstr("--folder")));

  // Only a recording with --sync waits for the disk, so a slow sync is a warning.
  disk.write_total = disk.sync_total = 25;
  EXPECT_THAT(find(examine_disk(disk, 100), "disk write"),
              finding(Severity::problem, HasSubstr("slower than the samples"), HasSubstr("--folder")));
  EXPECT_THAT(find(examine_disk(disk, 100), "disk sync"),
              finding(Severity::warning, HasSubstr("slower than the samples"), HasSubstr("--folder")));

  EXPECT_THAT(find(examine_disk(disk, 4), "disk space"),
              finding(Severity::ok, HasSubstr("10 h of recording"), IsEmpty()));
  disk.free_bytes = 3e8;
  EXPECT_THAT(find(examine_disk(disk, 4), "disk space"),
              finding(Severity::warning, HasSubstr("0.857 h"), HasSubstr("--folder")));
}

}  // namespace
}  // namespace haptrace
