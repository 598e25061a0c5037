// recording_session FILE [KEY=VALUE...]: records a session on a device with a known movement through the library, for
// tests that kill it or break its disk. Prints the session's JSON, and its warnings on standard error as they occur.
//   rate=1000 duration=0 clock=virtual|real       duration 0: until SIGTERM or SIGINT
//   ring=8 flush=0.1 sync=0 split= deflate=0 precision=
//   counter=FILE    16 bytes of shared memory: number of samples pushed, and time of the newest one [ns]
// Row i has the position x = 1e-6 |i mod 100000 - 50000| m.
#include "player/playback/playback.h"
#include "player/record.h"
#include "player/record_controllers.h"

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fcntl.h>
#include <iostream>
#include <stdexcept>
#include <sys/mman.h>
#include <unistd.h>

using namespace haptrace;

namespace {

class KnownMovement final : public Device {
 public:
  KnownMovement() {
    info_.name = "known movement";
    info_.virtual_time = true;
    info_.max_force = 8;
  }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench&, double, DeviceState& state) noexcept override {
    state.position = Vec3(1e-6 * std::abs(static_cast<double>(exchanges_++ % 100'000) - 50'000), 0.5, -0.25);
    return Status::ok;
  }
  void close() noexcept override {}

 private:
  DeviceInfo info_;
  std::int64_t exchanges_ = -1;  ///< the first exchange precedes the first tick
};

/// Counts samples in a file, so that the count outlives the process.
class SharedCounter final : public SampleSink {
 public:
  explicit SharedCounter(const std::string& file) {
    const int descriptor = open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
    if (descriptor < 0 || ftruncate(descriptor, sizeof(Shared)) != 0) throw std::runtime_error(file);
    void* memory = mmap(nullptr, sizeof(Shared), PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
    if (memory == MAP_FAILED) throw std::runtime_error(file);
    close(descriptor);
    shared_ = new (memory) Shared;
  }
  using SampleSink::push;
  void push(const Sample& sample) noexcept override {
    shared_->time_ns.store(sample.time_ns, std::memory_order_relaxed);
    shared_->pushed.fetch_add(1, std::memory_order_release);
  }

 private:
  struct Shared {
    std::atomic<std::uint64_t> pushed{0};
    std::atomic<std::int64_t> time_ns{0};
  };
  Shared* shared_ = nullptr;
};

StopRequest stop;

int run(const std::string& file, const std::map<std::string, std::string>& given) {
  const auto text = [&](const char* key, const char* otherwise) {
    const auto found = given.find(key);
    return found == given.end() ? std::string(otherwise) : found->second;
  };
  const auto number = [&](const char* key, const char* otherwise) { return std::stod(text(key, otherwise)); };

  SessionOptions options;
  options.loop.rate_hz = number("rate", "1000");
  options.clock = parse_clock(text("clock", "virtual"));
  RecorderOptions recorder;
  recorder.ring_seconds = number("ring", "8");
  recorder.flush_period = number("flush", "0.1");
  recorder.sync_period = number("sync", "0");
  recorder.storage.deflate = static_cast<int>(number("deflate", "0"));
  recorder.storage.precision = parse_precision(text("precision", ""));
  if (given.count("split") != 0) recorder.split = parse_split(given.at("split"));
  if (file != "-") options.recording = SessionOptions::Recording{.file = file, .options = recorder};

  KnownMovement device;
  const double duration = number("duration", "0");
  PassiveController passive;
  TimedController controller(passive, duration > 0 ? duration : 1e9);
  std::vector<SampleSink*> sinks;
  std::optional<SharedCounter> counter;
  if (given.count("counter") != 0) sinks.push_back(&counter.emplace(given.at("counter")));
  const SessionResult result = run_session(device, controller, {}, sinks, options, stop, [](const SessionView& view) {
    for (const Warning& warning : view.warnings) std::cerr << warning.text << std::endl;
  });
  std::cout << to_json(result).dump(2) << std::endl;
  return result.recorded_all() ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  std::map<std::string, std::string> given;
  for (int i = 2; i < argc; ++i) {
    const std::string word = argv[i];
    const auto equals = word.find('=');
    if (equals == std::string::npos) return 2;
    given[word.substr(0, equals)] = word.substr(equals + 1);
  }
  if (argc < 2) return 2;
  for (const int signal : {SIGINT, SIGTERM}) std::signal(signal, [](int) { stop.raise(); });
  std::signal(SIGXFSZ, SIG_IGN);
  try {
    return run(argv[1], given);
  } catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
    return 2;
  }
}
