// Benchmarks of a tick, of the simulated device and of recording.
#include "devices/registry.h"
#include "recorder/recorder.h"
#include "tests/bench/session.h"

#include <benchmark/benchmark.h>
#include <filesystem>
#include <fmt/format.h>
#include <optional>

namespace haptrace::bench {
namespace {

std::string scratch_file() {
  return (std::filesystem::temp_directory_path() / fmt::format("haptrace-bench-{}.h5", getpid())).string();
}

/// Reports the time of a tick (device exchange, velocity, control, limits, push) as the loop measures it, on a device
/// that costs no time: the median and the 99th percentile over a session of 60 s.
void tick(benchmark::State& state, bool recording, const Made& made = {}) {
  Still device;
  const std::string file = scratch_file();
  DurationHistogram times;
  for (auto _ : state) {
    auto controller = playback(60, {.hold = 0}, made);
    SessionOptions options;
    if (recording) options.recording = SessionOptions::Recording{.file = file, .options = {.overwrite = true}};
    const SessionResult result = run_session(device, controller, {.reference = true}, {}, options, StopRequest{});
    times = result.servo.tick_time;
    state.SetItemsProcessed(state.items_processed() + static_cast<std::int64_t>(result.servo.samples));
  }
  state.counters["tick_p50_ns"] = 1e9 * times.quantile(0.5);
  state.counters["tick_p99_ns"] = 1e9 * times.quantile(0.99);
  std::filesystem::remove(file);
}
BENCHMARK_CAPTURE(tick, control_and_limits, false)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(tick, control_limits_and_recording, true)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(tick, every_compensation_and_recording, true, Made::every_compensation())
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

/// Times one exchange of 1 ms with a simulated device. times_real_time counts the exchange alone.
void exchange(benchmark::State& state, const char* spec) {
  const auto device = open_device(spec);
  DeviceState answer;
  Wrench wrench;
  (void)device->exchange(wrench, 0, answer);
  for (auto _ : state) {
    wrench.force = -200 * answer.position;
    (void)device->exchange(wrench, 1e-3, answer);
    benchmark::DoNotOptimize(answer);
  }
  state.counters["times_real_time"] =
      benchmark::Counter(1e-3 * static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
}
BENCHMARK_CAPTURE(exchange, ideal_mass, "sim:preset=ideal");
BENCHMARK_CAPTURE(exchange, falcon, "sim:preset=falcon");
BENCHMARK_CAPTURE(exchange, falcon_held, "sim:preset=falcon,hand=relaxed");

/// Times whole sessions: a playback of 60 s on the simulated Falcon with a hand, in virtual time.
void session(benchmark::State& state, bool recording) {
  const std::string file = scratch_file();
  double simulated = 0;
  for (auto _ : state) {
    const auto device = open_device("sim:preset=falcon,hand=relaxed,seed=1");
    auto controller = playback(60, {.hold = 0, .max_deviation = 1});
    SessionOptions options;
    if (recording) options.recording = SessionOptions::Recording{.file = file, .options = {.overwrite = true}};
    const SessionResult result = run_session(*device, controller, {.reference = true}, {}, options, StopRequest{});
    simulated += result.servo.duration;
  }
  state.counters["times_real_time"] = benchmark::Counter(simulated, benchmark::Counter::kIsRate);
  std::filesystem::remove(file);
}
BENCHMARK_CAPTURE(session, simulated, false)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(session, simulated_and_recorded, true)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace haptrace::bench
