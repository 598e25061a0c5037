#include "recorder/disk_check.h"

#include "devices/loop/clock.h"
#include "formats/recording/recording.h"

#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <unistd.h>

namespace haptrace {
namespace {

namespace fs = std::filesystem;

/// Returns a sample of a moving hand, so that the samples differ.
Sample moving_sample(std::uint64_t tick, double rate_hz) {
  const double t = static_cast<double>(tick) / rate_hz;
  Sample sample;
  sample.tick = tick;
  sample.time_ns = std::llround(1e9 * t);
  sample.position = 0.04 * Vec3(std::sin(3 * t), std::cos(5 * t), std::sin(7 * t));
  sample.velocity = 0.04 * Vec3(3 * std::cos(3 * t), -5 * std::sin(5 * t), 7 * std::cos(7 * t));
  sample.force = -100 * sample.position;
  return sample;
}

double seconds_since(std::int64_t start_ns) {
  return 1e-9 * static_cast<double>(monotonic_ns() - start_ns);
}

}  // namespace

DiskMeasurement measure_disk(const std::string& folder, double rate_hz) {
  constexpr double kSpan = 20;    // session time to write [s]
  constexpr double kLongest = 5;  // longest measurement [s]
  DiskMeasurement disk{.folder = folder};
  const std::string name = (fs::path(folder) / fmt::format(".haptrace-doctor-{}.h5", getpid())).string();
  struct Removed {
    const std::string& file;
    ~Removed() { unlink(file.c_str()); }
  } const removed{name};
  RecordingWriter writer(name, {.rate_hz = rate_hz}, {}, {.overwrite = true});
  std::error_code unknown_space;
  const fs::space_info space = fs::space(folder, unknown_space);
  if (!unknown_space) disk.free_bytes = static_cast<double>(space.available);

  std::uint64_t tick = 0;
  const auto append = [&](std::uint64_t rows) {
    std::vector<Sample> block;
    for (; rows > 0; --rows) block.push_back(moving_sample(tick++, rate_hz));
    const std::int64_t start_ns = monotonic_ns();
    writer.append(block);
    writer.flush();
    return monotonic_ns() - start_ns;
  };
  const auto rows = static_cast<std::uint64_t>(std::max(1.0, disk.flush_period * rate_hz));
  const std::int64_t began_ns = monotonic_ns();
  for (double span = 0; span < kSpan && seconds_since(began_ns) < kLongest; span += disk.flush_period) {
    const std::int64_t write_ns = append(rows);
    const std::int64_t written_ns = monotonic_ns();
    writer.sync();
    const std::int64_t sync_ns = monotonic_ns() - written_ns;
    disk.write.record(write_ns);
    disk.sync.record(sync_ns);
    disk.write_total += 1e-9 * static_cast<double>(write_ns);
    disk.sync_total += 1e-9 * static_cast<double>(sync_ns);
  }

  // A file grows by whole chunks. These rows fill a whole number of them, wherever the last chunk started.
  constexpr std::uint64_t kWholeChunks = 16384;  // rows
  const std::uint64_t before = writer.part_bytes(0);
  append(kWholeChunks);
  disk.bytes_per_hour = 3600 * rate_hz * static_cast<double>(writer.part_bytes(0) - before) / kWholeChunks;
  writer.finish();
  return disk;
}

std::vector<Diagnosis> examine_disk(const DiskMeasurement& disk, double patience) {
  const auto blocks = static_cast<double>(disk.write.count());
  const auto other_folder = "haptrace doctor --folder DIR   # with DIR on a faster disk, and record there";
  std::vector<Diagnosis> found;

  const auto judge = [&](const char* check, const DurationHistogram& stalls, double total, Severity worst,
                         const std::string& otherwise) {
    const double busy = blocks > 0 ? total / (blocks * disk.flush_period) : 0;
    const std::string figures = fmt::format("{} for {:.0f} ms of samples; busy {:.2g} % of the time",
                                            quantiles_text(stalls), 1e3 * disk.flush_period, 100 * busy);
    if (busy >= 1)
      found.push_back({worst, check, figures + ": slower than the samples arrive", otherwise});
    else if (stalls.max() >= patience)
      found.push_back(
          {worst, check, fmt::format("{}: the ring buffer bridges only {:g} s", figures, patience), otherwise});
    else if (stalls.max() >= patience / 4)
      found.push_back({Severity::warning, check,
                       fmt::format("{}: more than a quarter of the time that the ring buffer bridges", figures),
                       otherwise});
    else
      found.push_back({Severity::ok, check, figures, ""});
  };
  judge("disk write", disk.write, disk.write_total, Severity::problem, other_folder);
  // Only sessions that ask for it wait for the disk itself.
  judge("disk sync", disk.sync, disk.sync_total, Severity::warning, other_folder);

  constexpr double kScarce = 1;  // [h]
  const std::string space = fmt::format("{:.4g} GB free in {}: {:.3g} h of recording at {:.3g} MB/h",
                                        1e-9 * disk.free_bytes, disk.folder, disk.hours(), 1e-6 * disk.bytes_per_hour);
  found.push_back({disk.hours() < kScarce ? Severity::warning : Severity::ok, "disk space", space,
                   disk.hours() < kScarce ? other_folder : ""});
  return found;
}

}  // namespace haptrace
