// Times of the view of a long recording: from opening to the first picture, and to queries at every zoom.
//   haptrace_view_zoom FILE.h5      a recording, for example that of tests/bench/long
#include "view/viewed_recording.h"

#include <algorithm>
#include <chrono>
#include <fmt/format.h>
#include <fstream>
#include <optional>
#include <random>
#include <vector>

namespace {

using namespace haptrace;
using Clock = std::chrono::steady_clock;

double since(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

double resident() {
  std::ifstream file("/proc/self/status");
  for (std::string word; file >> word;)
    if (double kib = 0; word == "VmRSS:" && file >> kib) return kib / 1024;
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    fmt::print(stderr, "haptrace_view_zoom FILE.h5\n");
    return 2;
  }
  auto start = Clock::now();
  ViewedRecording recording(argv[1]);
  fmt::print("open: {:.1f} ms; {:.2f} h\n", since(start), recording.duration() / 3600);
  std::vector<std::size_t> channels;
  for (const char* name : {"x", "y", "z", "force", "speed"}) channels.push_back(*recording.channels().find(name));
  const ViewRequest all{.t0 = 0, .t1 = 1e9, .pixels = 1600, .channels = channels};

  bool coarse = false;
  start = Clock::now();
  recording.ask(all, [&](const Frame& frame) { coarse = (frame.flags & FrameFlags::kCoarse) != 0; });
  fmt::print("first picture of everything: {:.1f} ms{}\n", since(start), coarse ? ", from the overview" : "");
  for (const double window : {10.0, 60.0, 600.0, 3600.0}) {
    start = Clock::now();
    recording.ask(
        {.t0 = recording.duration() / 2, .t1 = recording.duration() / 2 + window, .pixels = 1600, .channels = channels},
        [&](const Frame& frame) { coarse = (frame.flags & FrameFlags::kCoarse) != 0; });
    fmt::print("first picture of {:.0f} s in the middle: {:.1f} ms{}\n", window, since(start),
               coarse ? ", coarse" : "");
  }
  start = Clock::now();
  while (recording.work()) {
  }
  fmt::print("everything built: {:.0f} ms; {:.0f} MiB resident\n", since(start), resident());

  std::mt19937 random(1);
  fmt::print("\n{:>12} {:>10} {:>10}   queries of 1600 bins of 5 columns\n", "window [s]", "median", "longest");
  for (double window = 1; window < recording.duration(); window *= 4) {
    std::vector<double> times;
    for (int i = 0; i < 50; ++i) {
      const double from = std::uniform_real_distribution<>(0, recording.duration() - window)(random);
      start = Clock::now();
      recording.ask({.t0 = from, .t1 = from + window, .pixels = 1600, .channels = channels}, [](const Frame&) {});
      times.push_back(since(start));
    }
    std::sort(times.begin(), times.end());
    fmt::print("{:12.0f} {:7.2f} ms {:7.2f} ms\n", window, times[times.size() / 2], times.back());
  }
  fmt::print("{:.0f} MiB resident\n", resident());
}
