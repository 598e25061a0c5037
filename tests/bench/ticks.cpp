// haptrace_ticks N [part...]: runs one session of N ticks with the named parts, on a device that costs no time. Under
// callgrind, the cost of one tick is the difference between two sessions divided by the difference of their ticks.
//
// Sessions: playback, guidance, noise (a random force in three axes); without any of them, a free hand. Parts of every
// session: metrics, record, velocity=ESTIMATOR, torque, plane (no motor in z), watch (for a vibrating force). Parts of
// a playback: gravity, friction, inertia, learned, observer, guard, tuning, orientation, interpolation=NAME. Parts of
// guidance: wall-damping, expert-force, pace-help, viscosity, resistance, amplification. A session with scene=FILE
// touches the objects of that file: the tool stands in the middle of the device.
#include "control/guidance.h"
#include "control/guide_terms.h"
#include "control/tunnel_wall.h"
#include "control/velocity_estimator.h"
#include "player/guidance/guidance_controller.h"
#include "player/playback/tracking_metrics.h"
#include "player/record_controllers.h"
#include "recorder/recorder.h"
#include "scene/scene_controller.h"
#include "scene/scene_file.h"
#include "tests/bench/session.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>
#include <unistd.h>

namespace haptrace {
namespace {

class Parts {
 public:
  Parts(char** begin, char** end) : words_(begin, end) {}
  [[nodiscard]] bool has(const std::string& part) const {
    return std::find(words_.begin(), words_.end(), part) != words_.end();
  }
  /// Returns the text after `key`=, or `otherwise`.
  [[nodiscard]] std::string value(const std::string& key, const std::string& otherwise) const {
    for (const std::string& word : words_)
      if (word.starts_with(key + "=")) return word.substr(key.size() + 1);
    return otherwise;
  }

 private:
  std::vector<std::string> words_;
};

/// Runs another controller and finishes after `seconds`.
struct Until final : Controller {
  Until(Controller& inner_, double seconds) : inner(inner_), end(seconds) {}
  void start(const State& first) noexcept override { inner.start(first); }
  Command update(const State& state) noexcept override {
    Command command = inner.update(state);
    if (1e-9 * static_cast<double>(state.time_ns) >= end) command.status = Command::Status::finished;
    return command;
  }
  Controller& inner;
  double end;
};

/// A random force just below the alarm's threshold, which gives the vibration monitor many half cycles.
struct Noise final : Controller {
  Command update(const State&) noexcept override {
    Command command;
    for (double& force : command.wrench.force) {
      random = 1664525 * random + 1013904223;  // Numerical Recipes, 3rd edition, 7.1.4
      force = 1.2 * (2 * random / 4294967296.0 - 1);
    }
    return command;
  }
  std::uint32_t random = 1;
};

/// Returns guidance along a circle; the tool stands in the wall of its tunnel.
GuidanceController guided(const Parts& parts) {
  ArcPath::Builder builder(ArcPath::spacing_for(0.02));
  for (int i = 0; i < 4000; ++i) {
    const double t = 1e-3 * i;
    builder.add(t, 0.01 * Vec3(std::cos(t), std::sin(t), 0), Vec3(1, 0.5, 0));
  }
  GuideTerms terms;
  terms.push_back(std::make_unique<TunnelWall>(TunnelWall::Options{}));
  if (parts.has("wall-damping")) terms.push_back(std::make_unique<WallDamping>(3, 1e-3));
  if (parts.has("expert-force")) terms.push_back(std::make_unique<ExpertForce>(1));
  if (parts.has("pace-help")) terms.push_back(std::make_unique<PaceHelp>(PaceHelpOptions{}));
  if (parts.has("viscosity")) terms.push_back(std::make_unique<Viscosity>(1));
  if (parts.has("resistance")) terms.push_back(std::make_unique<Resistance>(1));
  if (parts.has("amplification")) terms.push_back(std::make_unique<ErrorAmplification>(100, 1));
  GuidanceController controller(std::make_shared<const ArcPath>(builder.finish(0.009)), Guidance(std::move(terms), {}),
                                {Vec3::Constant(500), Vec3::Constant(6)}, {});
  return controller;
}

std::uint64_t run(double seconds, const Parts& parts) {
  bench::Still device(parts.has("torque") || parts.has("orientation"), {true, true, !parts.has("plane")});
  const auto estimator = make_velocity_estimator(parts.value("velocity", "lowpass:100"), 1000, 5e-5);

  TrackingMetrics metrics(1000, 1);
  std::optional<Recorder> recorder;
  const std::string file =
      (std::filesystem::temp_directory_path() / ("haptrace-ticks-" + std::to_string(getpid()) + ".h5")).string();
  std::vector<SampleSink*> sinks;
  if (parts.has("metrics")) sinks.push_back(&metrics);
  if (parts.has("record")) sinks.push_back(&recorder.emplace(file, RecordingHeader{}, RecordingColumns{}));

  // The path lasts 1000 s for every N, so that its construction costs the same in every run.
  std::optional<PlaybackController> following;
  std::optional<GuidanceController> guidance;
  std::unique_ptr<SceneController> scene;
  PassiveController passive;
  if (const std::string scene_file = parts.value("scene", ""); !scene_file.empty())
    scene = make_scene_controller(load_scene(scene_file), 1000, std::nullopt, std::nullopt);
  if (parts.has("playback"))
    following.emplace(bench::playback(1000, {.axes = device.info().force_axes},
                                      {.observer = parts.has("observer"),
                                       .gravity = parts.has("gravity"),
                                       .friction = parts.has("friction"),
                                       .inertia = parts.has("inertia"),
                                       .learned = parts.has("learned"),
                                       .guard = parts.has("guard"),
                                       .orientation = parts.has("orientation"),
                                       .tuning = parts.has("tuning"),
                                       .interpolation = parse_interpolation(parts.value("interpolation", "cubic"))}));
  if (parts.has("guidance")) guidance.emplace(guided(parts));
  Noise noise;
  Controller* inner = &passive;
  if (parts.has("noise")) inner = &noise;
  if (scene) inner = scene.get();
  if (following) inner = &*following;
  if (guidance) inner = &*guidance;
  Until controller(*inner, seconds);
  const ServoReport report =
      ServoLoop(device, controller, *estimator, sinks, {.virtual_time = true, .watch_vibration = parts.has("watch")})
          .run(StopRequest{});
  recorder.reset();
  std::filesystem::remove(file);
  return report.samples;
}

}  // namespace
}  // namespace haptrace

int main(int argc, char** argv) {
  const double seconds = argc > 1 ? 1e-3 * std::atof(argv[1]) : 1;
  std::printf("%llu\n",
              static_cast<unsigned long long>(haptrace::run(seconds, {argv + std::min(argc, 2), argv + argc})));
}
