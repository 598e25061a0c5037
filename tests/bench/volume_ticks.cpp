// haptrace_volume_ticks [SIDE]: what a volume of SIDE^3 samples costs: preparation, a look at the field, and ticks of a
// tool that slides over the surface of a gyroid at 0.1 m/s, pressed 0.5 mm deep.
#include "scene/shape/volume.h"

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>

namespace haptrace {
namespace {

double seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Returns the least time of a call [ns], of 100 rounds that are too short to be interrupted.
template <class Call>
double least_ns(int calls, const Call& call) {
  double least = 1e300;
  for (int round = 0; round < 100; ++round) {
    const double begin = seconds();
    for (int i = 0; i < calls; ++i) call(i);
    least = std::min(least, (seconds() - begin) / calls);
  }
  return 1e9 * least;
}

void run(std::size_t side) {
  constexpr double kWide = 0.1, kPeriod = 0.025;  // [m]
  VolumeData data;
  data.size = {side, side, side};
  data.steps = kWide / static_cast<double>(side - 1) * Eigen::Matrix3d::Identity();
  data.origin = Vec3::Constant(-kWide / 2);
  const double wave = 2 * std::numbers::pi / kPeriod;
  for (std::size_t k = 0; k < side; ++k)
    for (std::size_t j = 0; j < side; ++j)
      for (std::size_t i = 0; i < side; ++i) {
        const Vec3 q = wave * data.place(Vec3(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)));
        data.values.push_back(static_cast<float>(std::sin(q.x()) * std::cos(q.y()) + std::sin(q.y()) * std::cos(q.z()) +
                                                 std::sin(q.z()) * std::cos(q.x())));
      }
  const auto shared = std::make_shared<const VolumeData>(std::move(data));
  double sum = 0;
  for (const int order : {1, 3}) {
    const double begin = seconds();
    Volume volume(shared, {.iso = 0, .order = order});
    std::printf("interpolation %d: ready in %.2f s\n", order, seconds() - begin);
    const ScalarField& field = volume.field();
    const auto place = [](int i) {
      return Vec3(0.02 * std::sin(0.01 * i), 0.02 * std::cos(0.013 * i), 2e-6 * (i % 1000));
    };
    std::printf("  value and gradient %4.0f ns, with second derivatives %4.0f ns\n",
                least_ns(1000, [&](int i) { sum += field.slope_at(place(i)).gradient.x(); }),
                least_ns(1000, [&](int i) { sum += field.at(place(i)).hessian(0, 1); }));
    Proxy far;
    std::printf("  tick beyond the grid %4.0f ns\n", least_ns(1000, [&](int i) {
                  const Vec3 at(0.2, 0.1, 1e-6 * i);
                  volume.follow({.from = at, .to = at + Vec3(0, 0, 1e-6)}, far);
                }));
    const SurfacePoint start = volume.nearest(Vec3::Zero());
    Proxy out;
    const Vec3 free = start.position + 1e-3 * start.normal;
    std::printf("  tick near the surface %4.0f ns\n",
                least_ns(1000, [&](int i) { volume.follow({.from = free, .to = free + Vec3(0, 0, 1e-9 * i)}, out); }));
    for (const int steps : {1, 2, 3}) {
      volume.set("steps", steps);
      volume.prepare(0);
      Proxy proxy;
      Vec3 at = start.position + 1e-3 * start.normal;
      int lost = 0;
      const double ns = least_ns(500, [&](int i) {
        const Vec3 along = proxy.touching ? Vec3(proxy.normal.cross(Vec3(0.3, 0.5, 0.8)).normalized()) : Vec3::Zero();
        const Vec3 on = proxy.touching ? proxy.position : start.position,
                   n = proxy.touching ? proxy.normal : start.normal;
        const Vec3 to = on - 5e-4 * n + (i % 500 < 250 ? 1e-4 : -1e-4) * along;
        volume.follow({.from = at, .to = to}, proxy);
        lost += proxy.touching ? 0 : 1;
        at = to;
      });
      std::printf("  tick that slides, %d steps, %4.0f ns%s\n", steps, ns, lost > 0 ? " (it was lost)" : "");
    }
  }
  if (!std::isfinite(sum)) std::printf("not finite\n");
}

}  // namespace
}  // namespace haptrace

int main(int argc, char** argv) {
  haptrace::run(argc > 1 ? static_cast<std::size_t>(std::atoi(argv[1])) : 128);
}
