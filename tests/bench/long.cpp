// Cost of a recording's length: creates a recording of 10 hours unless it exists, and measures the cost of opening it.
//   haptrace_long FILE.h5 [ROWS]
#include "devices/registry.h"
#include "formats/path/path_file.h"
#include "formats/recording/recording_summary.h"
#include "player/playback/playback.h"
#include "player/playback/reference_stream.h"
#include "recorder/recorded_devices.h"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <functional>

namespace {

using namespace haptrace;

constexpr int kRuns = 21;

/// Writes a movement within 60 mm at 1 kHz, with tremor, a force and a reference, like a recorded playback.
void make(const std::string& file, std::uint64_t rows) {
  RecordingHeader header;
  header.device_name = "benchmark";
  RecordingWriter writer(file, header, {.reference = true}, {});
  std::vector<Sample> block(8192);
  for (std::uint64_t first = 0; first < rows; first += block.size()) {
    block.resize(std::min<std::uint64_t>(block.size(), rows - first));
    for (std::size_t i = 0; i < block.size(); ++i) {
      const double t = 1e-3 * static_cast<double>(first + i);
      Sample& sample = block[i];
      sample.tick = first + i;
      sample.time_ns = static_cast<std::int64_t>(first + i) * 1'000'000;
      sample.reference_position = 0.03 * Vec3(std::cos(t), std::sin(1.1 * t), std::sin(0.3 * t));
      sample.reference_velocity = 0.03 * Vec3(-std::sin(t), 1.1 * std::cos(1.1 * t), 0.3 * std::cos(0.3 * t));
      sample.position = sample.reference_position + 2e-4 * Vec3(std::sin(50 * t), std::cos(57 * t), 0);
      sample.velocity = sample.reference_velocity + 1e-2 * Vec3(std::cos(50 * t), -1.14 * std::sin(57 * t), 0);
      sample.force = Vec3(std::sin(2 * t), std::cos(3 * t), 0.1);
      sample.phase = Phase::run;
    }
    writer.append(block);
  }
  writer.finish();
}

double status(const std::string& key) {
  std::ifstream file("/proc/self/status");
  for (std::string word; file >> word;)
    if (double kib = 0; word == key && file >> kib) return kib / 1024;
  return 0;
}

/// Prints the median and the longest time of `action`, and the peak increase of the process's memory.
void measure(const char* name, const std::function<void()>& action) {
  std::vector<double> times;
  std::ofstream("/proc/self/clear_refs") << "5";
  const double before = status("VmRSS:");
  for (int i = 0; i < kRuns; ++i) {
    const auto start = std::chrono::steady_clock::now();
    action();
    times.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count());
  }
  std::sort(times.begin(), times.end());
  fmt::print("{:<58} {:7.1f} ms {:7.1f} ms {:7.1f} MiB\n", name, times[kRuns / 2], times.back(),
             status("VmHWM:") - before);
}

}  // namespace

int main(int argc, char** argv) {
  use_recorded_devices();
  if (argc < 2) {
    fmt::print(stderr, "haptrace_long FILE.h5 [ROWS]\n");
    return 2;
  }
  const std::string file = argv[1];
  if (!std::filesystem::exists(file)) make(file, argc > 2 ? std::stoull(argv[2]) : 36'000'000);
  const double duration = open_path(file)->facts().duration();
  fmt::print("{}: {:.1f} h, {:.2f} GB\n{:<58} {:>10} {:>10} {:>11}\n", file, duration / 3600,
             1e-9 * static_cast<double>(std::filesystem::file_size(file)), "", "median", "longest", "peak memory");

  const auto device = open_device("sim:preset=omega3");
  const auto begin_at = [&](double from, double seconds) {
    const PlayPlan plan = plan_playback(device->info(), open_path(file, {.from = from}), {});
    ReferenceStream stream(*plan.path, {});
    Reference reference;
    for (double t = 0; t <= seconds; t += 1e-3) {
      stream.wait(t);
      if (stream.sample(t, reference) != ReferenceStream::Answer::ready) throw std::runtime_error(stream.error());
    }
  };
  measure("open, check, seek to the middle, first reference", [&] { begin_at(duration / 2, 0); });
  measure("open, check, first reference at the start", [&] { begin_at(-1, 0); });
  measure("the same, and the reference of 60 s", [&] { begin_at(duration / 2, 60); });
  measure("all metrics of `haptrace info`", [&] { (void)summarise(RecordingReader(file)); });
  measure("open as a replay device, first exchange", [&] {
    const auto replay = open_device("replay:file=" + file);
    DeviceState state;
    (void)replay->exchange({}, 0, state);
  });
}
