// Benchmarks of the tracking laws: one tick on three axes, and the search of an LQG law.
#include "control/design/lqg_search.h"
#include "control/lqg_law.h"
#include "control/observer_pd.h"

#include <benchmark/benchmark.h>
#include <cmath>

namespace haptrace::bench {
namespace {

AxisModel held_axis(double delay_ticks) {
  return {.mass = 0.4,
          .delay_ticks = delay_ticks,
          .lag = 0.5e-3,
          .hand = kRelaxedHand,
          .position_noise = 5e-5 / std::sqrt(12.0)};
}

/// Runs `law` on positions that change at every tick.
void run_ticks(benchmark::State& state, ForceTerm& law, const Tuning& tuning) {
  State tick;
  Reference reference{.position = Vec3::Zero(), .velocity = Vec3(0.1, 0, 0), .acceleration = Vec3::Zero(), .time = 0};
  law.start(tick);
  tick.dt = 1e-3;
  int i = 0;
  for (auto _ : state) {
    tick.position = 5e-5 * Vec3(i % 3, i % 2, i % 5);
    tick.force_applied = law.force({tick, reference, tuning});
    ++i;
  }
}

void lqg_tick(benchmark::State& state) {
  const AxisModel axis = held_axis(static_cast<double>(state.range(0)));
  const LqgLaws laws{*design_lqg(axis, LqgNumbers{}), *design_lqg_for_rest(axis, 0.1)};
  LqgLaw law({.axes = {laws, laws, laws}, .position_resolution = 5e-5, .authority = 6});
  Tuning tuning;
  tuning.gains = gains_of({laws, laws, laws});
  run_ticks(state, law, tuning);
}
BENCHMARK(lqg_tick)->Arg(1)->Arg(3)->Arg(10)->Arg(30);

void observer_pd_tick(benchmark::State& state) {
  PlantModel plant;
  plant.mass = Vec3::Constant(0.4);
  plant.delay = 1.5e-3;
  plant.position_resolution = 5e-5;
  const TrackingDesign design = design_tracking(plant, {.max_force = 8});
  ObserverPd law({.design = design, .position_resolution = 5e-5});
  run_ticks(state, law, {.gains = design.gains, .observer_hz = design.load_hz});
}
BENCHMARK(observer_pd_tick);

void lqg_search(benchmark::State& state) {
  const AxisModel axis = held_axis(1.3);
  for (auto _ : state) benchmark::DoNotOptimize(search_lqg({axis, axis, axis}, {.threads = 1}, StopRequest{}));
}
BENCHMARK(lqg_search)->Unit(benchmark::kMillisecond)->Iterations(1);

}  // namespace
}  // namespace haptrace::bench
