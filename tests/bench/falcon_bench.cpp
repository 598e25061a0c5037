// Benchmarks of the Falcon's kinematics and packets per tick.
#include "devices/falcon/calibration.h"

#include <benchmark/benchmark.h>
#include <cmath>

namespace haptrace {
namespace {

/// Returns the encoder counts of a hand's movement: about 0.1 m/s, at 1 kHz.
std::vector<std::array<std::int16_t, 3>> encoders_of_a_loop(const FalconCalibration& falcon,
                                                            const FalconKinematics& kinematics) {
  std::vector<std::array<std::int16_t, 3>> loop;
  for (int k = 0; k < 2000; ++k) {
    const double phase = std::numbers::pi * k / 1000;
    const Vec3 place = 0.03 * Vec3(std::cos(phase), std::sin(phase), 0.5 * std::sin(2 * phase));
    const Vec3 turned = kinematics.at_position(falcon.origin + place)->angles - falcon.home_angle;
    const Vec3 counts = falcon.counts_per_rad.cwiseProduct(turned);
    loop.push_back({falcon_word(counts[0]), falcon_word(counts[1]), falcon_word(counts[2])});
  }
  return loop;
}

void falcon_pose(benchmark::State& bench) {
  const FalconCalibration falcon;
  const FalconKinematics kinematics(falcon.geometry);
  const auto loop = encoders_of_a_loop(falcon, kinematics);
  Vec3 position = falcon.origin;
  std::size_t k = 0;
  for (auto _ : bench) {
    position = kinematics.at_angles(falcon.angles(loop[k++ % loop.size()]), position)->position;
    benchmark::DoNotOptimize(position);
  }
}
BENCHMARK(falcon_pose)->Unit(benchmark::kNanosecond);

void falcon_tick(benchmark::State& bench) {
  const FalconCalibration falcon;
  const FalconKinematics kinematics(falcon.geometry);
  const auto loop = encoders_of_a_loop(falcon, kinematics);
  FalconDecoder decoder;
  Vec3 position = falcon.origin;
  std::size_t k = 0;
  for (auto _ : bench) {
    FalconReport report;
    for (const std::uint8_t byte : encode({loop[k++ % loop.size()], 0x70}))
      if (const auto packet = decoder.push(byte)) report = falcon_report(*packet);
    const FalconPose pose = *kinematics.at_angles(falcon.angles(report.encoders), position);
    position = pose.position;
    const FalconPacket command{falcon.motors(pose.torques(Vec3(1, -2, 3))), falcon.flags({.green = true}, true)};
    benchmark::DoNotOptimize(encode(command));
  }
}
BENCHMARK(falcon_tick)->Unit(benchmark::kNanosecond);

}  // namespace
}  // namespace haptrace
