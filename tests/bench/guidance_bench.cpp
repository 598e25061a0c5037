// Benchmarks of guidance per tick and of one update of the place, for paths of different lengths: beyond a window, the
// cost should not depend on the length.
#include "control/guidance.h"
#include "control/guide_terms.h"
#include "control/path/place_tracker.h"
#include "control/tunnel_wall.h"

#include <algorithm>
#include <benchmark/benchmark.h>
#include <cmath>

namespace haptrace {
namespace {

/// Returns a path of loops in space with `samples` samples at 1 kHz, at 0.1 m/s.
ArcPath loops(std::int64_t samples) {
  ArcPath::Builder builder(ArcPath::spacing_for(0.1));
  for (std::int64_t i = 0; i < samples; ++i) {
    const double t = 1e-3 * static_cast<double>(i);
    builder.add(t, 0.04 * Vec3(std::cos(2.5 * t), std::sin(2.5 * t), std::sin(0.1 * t)), Vec3(1, 0.5, 0));
  }
  return builder.finish(0.005);
}

void guidance_tick(benchmark::State& bench) {
  const ArcPath path = loops(bench.range(0));
  GuideTerms terms;
  terms.push_back(std::make_unique<TunnelWall>(TunnelWall::Options{}));
  terms.push_back(std::make_unique<WallDamping>(3, 1e-3));
  terms.push_back(std::make_unique<ExpertForce>(1));
  terms.push_back(std::make_unique<PaceHelp>(PaceHelpOptions{}));
  terms.push_back(std::make_unique<Viscosity>(1));
  Guidance guidance(std::move(terms), {});
  PlaceTracker projection(path, {});
  projection.start(0.5 * path.length());
  State state;
  state.dt = 1e-3;
  double s = projection.foot().s;
  for (auto _ : bench) {
    s += 1e-4;
    if (s > 0.9 * path.length()) projection.start(s = 0.1 * path.length());
    state.position = path.position_at(s) + Vec3(0, 0, 6e-3);
    benchmark::DoNotOptimize(guidance.update(state, projection.update(state.position, 1e-3), false));
  }
  bench.counters["path_m"] = path.length();
}
BENCHMARK(guidance_tick)
    ->Arg(10'000)
    ->Arg(100'000)
    ->Arg(1'000'000)
    ->Arg(10'000'000)
    ->Arg(36'000'000)
    ->Unit(benchmark::kNanosecond);

/// Every iteration moves the hand far enough for an update of the costs of all places.
void place_update(benchmark::State& bench) {
  const ArcPath path = loops(bench.range(0));
  PlaceEvidence evidence(path);
  const double step = 1.001 * std::max(evidence.spacing(), evidence.scale() * 1e-3);
  double s = 0;
  for (auto _ : bench) {
    s += step;
    if (s > 0.9 * path.length()) evidence.start(s = 0, path.position_at(0));
    benchmark::DoNotOptimize(evidence.update(path.position_at(s) + Vec3(0, 0, 6e-3), 1e-2));
  }
  bench.counters["states"] = static_cast<double>(std::min<std::size_t>(evidence.states(), 801));
}
BENCHMARK(place_update)->Arg(3'800)->Arg(8'000)->Arg(100'000)->Arg(1'000'000)->Unit(benchmark::kNanosecond);

}  // namespace
}  // namespace haptrace
