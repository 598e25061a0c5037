// haptrace_append MODE FILE ROWS [reader]: writes ROWS rows of a movement in blocks of 100 and prints the cost as JSON.
// MODE is
//   none      only generate the rows
//   raw       write as many bytes with write(2)
//   timed     a recording, flushed every 0.1 s of the wall clock
//   each      a recording, flushed after every block
//   packed    like timed, with deflate, in chunks of 100 rows as at 1 kHz
//   rounded   like packed, with scale-offset to 1 um, 1 mN, 1 mm/s
// With `reader`, another process follows the recording 10 times a second.
#include "base/error.h"
#include "formats/recording/recording.h"
#include "formats/recording/recording_layout.h"

#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <sys/resource.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

using namespace haptrace;
using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

namespace {

constexpr std::size_t kBlock = 100;

/// Returns 10 s of a hand's movement, rounded to encoder counts.
std::vector<Sample> movement() {
  std::vector<Sample> samples(100 * kBlock);
  Vec3 velocity = Vec3::Zero();
  for (std::size_t i = 0; i < samples.size(); ++i) {
    Sample& s = samples[i];
    for (int axis = 0; axis < 3; ++axis) {
      s.position[axis] = 5e-5 * std::round(1e3 * std::sin(1e-3 * static_cast<double>(i) * (1.1 + axis)));
      if (i > 0) velocity[axis] += 0.4 * ((s.position[axis] - samples[i - 1].position[axis]) / 1e-3 - velocity[axis]);
    }
    s.velocity = velocity;
    s.force = -200 * s.position - 2 * velocity;
    s.phase = Phase::run;
    s.latency = 1e-6F * static_cast<float>(i * 2654435761U % 97);
  }
  return samples;
}

void move_on(std::span<Sample> block, std::uint64_t first) {
  for (std::size_t i = 0; i < block.size(); ++i) {
    block[i].tick = first + i;
    block[i].time_ns = static_cast<std::int64_t>(first + i) * 1'000'000;
  }
}

double cpu_seconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

/// Forks a process that reads the newest row of `file` 10 times a second until it is killed.
pid_t follow(const std::string& file) {
  const pid_t child = fork();
  if (child != 0) return child;
  for (std::optional<RecordingReader> reader;; std::this_thread::sleep_for(100ms)) {
    try {
      if (!reader)
        reader.emplace(file);
      else
        reader->refresh();
      if (reader->rows() > 0) (void)reader->read(reader->rows() - 1, 1);
    } catch (const Error&) {
      reader.reset();
    }
  }
}

/// Writes as many bytes as `rows` rows take in a recording, from a buffer as large as the samples.
void raw(const std::string& file, std::vector<Sample>& samples, std::uint64_t rows, bool write_them) {
  const int descriptor = open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  const std::size_t bytes = kBlock * row_bytes({});
  const std::vector<std::byte> packed(samples.size() / kBlock * bytes, std::byte{1});
  for (std::uint64_t row = 0; row < rows; row += kBlock) {
    const std::size_t at = row % samples.size();
    move_on(std::span(samples).subspan(at, kBlock), row);
    if (write_them && write(descriptor, packed.data() + at / kBlock * bytes, bytes) != static_cast<ssize_t>(bytes))
      std::abort();
  }
  close(descriptor);
}

void record(const std::string& mode, const std::string& file, std::vector<Sample>& samples, std::uint64_t rows) {
  Storage storage;
  if (mode == "packed" || mode == "rounded") storage = {.deflate = 1, .rows_per_chunk = kBlock};
  if (mode == "rounded") storage.precision = parse_precision("1um,1mN,1mm/s");
  RecordingWriter writer(file, {}, {}, {.overwrite = true, .storage = storage});
  auto flushed = Clock::now();
  for (std::uint64_t row = 0; row < rows; row += kBlock) {
    const std::span block = std::span(samples).subspan(row % samples.size(), kBlock);
    move_on(block, row);
    writer.append(block);
    if (mode != "each" && Clock::now() - flushed < 100ms) continue;
    writer.flush();
    flushed = Clock::now();
  }
  writer.finish();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) {
    std::fprintf(stderr, "usage: %s none|raw|timed|each|packed|rounded FILE ROWS [reader]\n", argv[0]);
    return 2;
  }
  const std::string mode = argv[1], file = argv[2];
  const auto rows = static_cast<std::uint64_t>(std::atoll(argv[3])) / kBlock * kBlock;
  std::vector<Sample> samples = movement();
  const pid_t reader = argc > 4 ? follow(file) : 0;
  const double before = cpu_seconds();
  const auto begin = Clock::now();
  if (mode == "raw" || mode == "none")
    raw(file, samples, rows, mode == "raw");
  else
    record(mode, file, samples, rows);
  const double cpu = cpu_seconds() - before;
  const double wall = std::chrono::duration<double>(Clock::now() - begin).count();
  if (reader > 0) {
    kill(reader, SIGKILL);
    waitpid(reader, nullptr, 0);
  }
  std::printf("{\"cpu_ns_per_row\": %.2f, \"wall_s\": %.4f, \"bytes\": %llu, \"data\": %llu}\n",
              1e9 * cpu / static_cast<double>(rows), wall,
              static_cast<unsigned long long>(std::filesystem::file_size(file)),
              static_cast<unsigned long long>(rows * row_bytes({})));
  std::filesystem::remove(file);
  return 0;
}
