// Benchmark of a tick of NURBS: a bowl of 24 spans, quadratic round its axis and cubic along its profile, touched by a
// point.
#include "scene/scene.h"
#include "scene/scene_file.h"

#include <benchmark/benchmark.h>
#include <cmath>

namespace haptrace {
namespace {

std::shared_ptr<Scene> bowl(double steps) {
  auto scene = load_scene(HAPTRACE_SAMPLES "/scenes/bowl.json");
  scene->set("bowl.steps", steps);
  scene->prepare({.rate_hz = 1000});
  return scene;
}

/// Slides over the inner wall at 0.2 m/s, 1 to 3 mm deep, across seams.
void nurbs_contact(benchmark::State& bench) {
  const auto scene = bowl(static_cast<double>(bench.range(0)));
  const Shape& shape = scene->object(0).shape();
  Proxy proxy;
  Vec3 from(0.02, 0, 0.03);
  double turn = 0;
  for (auto _ : bench) {
    turn += 0.01;
    const double rho = 0.016 + 0.006 * std::sin(0.37 * turn);
    const Vec3 foot = Vec3(rho * std::cos(turn), rho * std::sin(turn), -0.018);
    shape.follow({.from = from, .to = foot - Vec3(0, 0, 0.001)}, proxy);
    from = foot - Vec3(0, 0, 0.001);
    benchmark::DoNotOptimize(proxy);
  }
  if (!proxy.touching) bench.SkipWithError("the tool came off");
}
BENCHMARK(nurbs_contact)->Arg(1)->Arg(2)->Arg(3)->Unit(benchmark::kNanosecond);

/// Moves 2 mm above the inner wall.
void nurbs_free(benchmark::State& bench) {
  const auto scene = bowl(2);
  const Shape& shape = scene->object(0).shape();
  Proxy proxy;
  Vec3 from(0.02, 0, 0);
  double turn = 0;
  for (auto _ : bench) {
    turn += 0.01;
    const Vec3 to(0.02 * std::cos(turn), 0.02 * std::sin(turn), 0);
    shape.follow({.from = from, .to = to}, proxy);
    from = to;
    benchmark::DoNotOptimize(proxy);
  }
}
BENCHMARK(nurbs_free)->Unit(benchmark::kNanosecond);

/// Enters through the inner wall.
void nurbs_first_contact(benchmark::State& bench) {
  const auto scene = bowl(2);
  const Shape& shape = scene->object(0).shape();
  double turn = 0;
  for (auto _ : bench) {
    turn += 0.01;
    const Vec3 to(0.02 * std::cos(turn), 0.02 * std::sin(turn), -0.0185);
    Proxy proxy;
    shape.follow({.from = to + Vec3(0, 0, 0.004), .to = to}, proxy);
    benchmark::DoNotOptimize(proxy);
  }
}
BENCHMARK(nurbs_first_contact)->Unit(benchmark::kNanosecond);

/// Loads and prepares the bowl.
void nurbs_load(benchmark::State& bench) {
  for (auto _ : bench) benchmark::DoNotOptimize(bowl(2));
}
BENCHMARK(nurbs_load)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace haptrace
