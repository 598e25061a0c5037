// Checks that the installed library works in a program outside its tree: plays a circle on a simulated device, reads
// the recording, measures it, and runs a controller of its own.
#include "haptrace.h"

#include <cstdio>
#include <optional>
#include <string>
#include <vector>

namespace {

using namespace haptrace;

/// Pulls the tool to where it was at the start, for half a second.
class Spring final : public Controller {
 public:
  void start(const State& first) noexcept override { home_ = first.position; }
  [[nodiscard]] Command update(const State& state) noexcept override {
    Command command;
    command.wrench.force = 200 * (home_ - state.position);
    if (state.time_ns > 500'000'000) command.status = Command::Status::finished;
    return command;
  }

 private:
  Vec3 home_ = Vec3::Zero();
};

bool plays(const std::string& file) {
  const auto device = open_device("sim:preset=omega3,hand=relaxed,seed=1");
  PlayOptions options;
  options.session.recording = SessionOptions::Recording{.file = file};
  const Path path = make_shape("circle", {.size = 0.04, .duration = 2});
  const PlayResult result = play(*device, plan_playback(device->info(), path, options), options, StopRequest{});
  std::printf("rms error %.3f mm over %llu samples\n", 1e3 * result.last.rms_error,
              static_cast<unsigned long long>(result.last.samples));
  return result.session.servo.cause == StopCause::finished && result.last.samples > 1900;
}

bool reads_back(const std::string& file) {
  const RecordingReader reader(file);
  std::vector<double> time;
  std::vector<Vec3> position;
  for (const Sample& sample : reader.read(0, reader.rows())) {
    time.push_back(1e-9 * static_cast<double>(sample.time_ns));
    position.push_back(sample.position);
  }
  const std::optional<MovementFigures> figures = movement_figures({.time = time, .position = position});
  if (!figures) return false;
  std::printf("path of %.0f mm\n", 1e3 * figures->path_length);
  return figures->path_length > 0.1;
}

bool runs_a_controller() {
  const auto device = open_device("sim:preset=falcon,hand=relaxed,seed=2");
  Spring spring;
  const SessionResult result = run_session(*device, spring, {}, {}, SessionOptions{}, StopRequest{});
  return result.servo.cause == StopCause::finished;
}

bool refuses_a_bad_scene() {
  try {
    (void)load_scene("no such scene.json");
  } catch (const Error& error) {
    std::printf("%s\n", error.what());
    return true;
  }
  return false;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) return 2;
  return plays(argv[1]) && reads_back(argv[1]) && runs_a_controller() && refuses_a_bad_scene() ? 0 : 1;
}
