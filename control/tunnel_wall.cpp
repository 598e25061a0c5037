#include "control/tunnel_wall.h"

#include <algorithm>
#include <cmath>

namespace haptrace {
namespace {

/// Returns the depth in the wall [m]; negative within the tunnel.
double depth(const PathProjection::Foot& foot) {
  return foot.tube.distance - foot.tube.radius;
}

}  // namespace

Vec3 TunnelWall::force(const GuideInput& input) noexcept {
  const double w = options_.onset, most = options_.max_force, k = input.tuning.stiffness * options_.stiffness;
  const double d = depth(input.foot);
  if (!(d > 0)) return Vec3::Zero();
  const double f = d < w ? 0.5 * k * d * d / w : k * (d - 0.5 * w);
  return -std::min(f, most) * input.foot.tube.outwards;
}

double TunnelWall::stored(const PathProjection::Foot& foot, const GuideTuning& tuning) const noexcept {
  const double w = options_.onset, most = options_.max_force, k = tuning.stiffness * options_.stiffness;
  const double d = depth(foot);
  if (!(d > 0) || !(k > 0)) return 0;
  // Depth at which the force stops growing, in the onset or beyond it.
  const double full = most < 0.5 * k * w ? std::sqrt(2 * most * w / k) : most / k + 0.5 * w;
  const double sprung = std::min(d, full);
  const double elastic =
      sprung < w ? k * sprung * sprung * sprung / (6 * w) : k * (w * w / 6 + 0.5 * sprung * (sprung - w));
  return elastic + most * (d - sprung);
}

Vec3 WallDamping::force(const GuideInput& input) noexcept {
  const Vec3& outwards = input.foot.tube.outwards;
  const double d = depth(input.foot), v = input.state.velocity.dot(outwards);
  if (!(d > 0) || !(v > 0)) return Vec3::Zero();
  return -input.tuning.damping * damping_ * std::min(d / onset_, 1.0) * v * outwards;
}

double largest_wall_stiffness(double rate_hz, double delay, double damping) {
  return damping / (0.5 / rate_hz + delay);
}

}  // namespace haptrace
