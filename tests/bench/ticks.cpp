// haptrace_ticks N [term...]: one session of N ticks on a device that costs nothing, made of the named terms. Under
// callgrind the difference between two sessions divided by the difference of their ticks is what one tick costs.
#include "tests/bench/session.h"

#include <cstdio>
#include <cstdlib>
#include <cstring>

int main(int argc, char** argv) {
  using namespace haptrace;
  const double seconds = argc > 1 ? 1e-3 * std::atof(argv[1]) : 1;
  const auto has = [&](const char* term) {
    for (int i = 2; i < argc; ++i)
      if (std::strcmp(argv[i], term) == 0) return true;
    return false;
  };

  bench::Still device;
  const auto estimator = make_velocity_estimator("lowpass:100", 1000, 5e-5);
  TrackingMetrics metrics(1000, 1);
  std::vector<SampleSink*> sinks;
  if (has("metrics")) sinks.push_back(&metrics);
  // A path of a thousand seconds whatever N is, so that its making costs the same in every run.
  auto following = bench::playback(1000, {},
                                   {.observer = has("observer"),
                                    .feedforward = has("feedforward"),
                                    .learned = has("learned"),
                                    .guard = has("guard")});
  PassiveController free_hand;
  TimedController passive(free_hand, seconds);

  /// Ends a playback after N ticks.
  struct Until final : Controller {
    Until(Controller& inner_, double seconds_) : inner(inner_), end(seconds_) {}
    void start(const State& first) noexcept override { inner.start(first); }
    Command update(const State& state) noexcept override {
      Command command = inner.update(state);
      if (1e-9 * static_cast<double>(state.time_ns) >= end) command.status = Command::Status::finished;
      return command;
    }
    Controller& inner;
    double end;
  } until(following, seconds);

  Controller& controller = has("playback") ? static_cast<Controller&>(until) : passive;
  const ServoReport report =
      ServoLoop(device, controller, *estimator, sinks, {.virtual_time = true}).run(StopRequest{});
  std::printf("%llu\n", static_cast<unsigned long long>(report.samples));
}
