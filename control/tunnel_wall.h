// The walls of a tunnel: springs beyond its radius, and their damping.
#pragma once

#include "control/guide_term.h"

namespace haptrace {

/// Springs back towards the path beyond its radius. The stiffness rises linearly over `onset`, so that neither the
/// force nor its slope has a step where the wall begins:
///
///     f(d) = k d^2 / (2 w) for d < w,   k (d - w / 2) beyond, at most f_max,   d = distance - radius
///
/// It acts on the foot's tube, the nearest of all tunnels in which the trainee may be.
class TunnelWall final : public GuideTerm {
 public:
  struct Options {
    double stiffness = 500;  ///< [N/m]
    double onset = 1e-3;     ///< w [m]
    double max_force = 5;    ///< below the device's limit, so that the wall gives back the energy it took [N]
  };
  explicit TunnelWall(const Options& options) noexcept : options_(options) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::restoring; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override;
  [[nodiscard]] double stored(const PathProjection::Foot& foot, const GuideTuning& tuning) const noexcept override;

 private:
  Options options_;
};

/// Damps outward movement in the wall, never the return: f = -b (v . n) n, rising over `onset`.
class WallDamping final : public GuideTerm {
 public:
  WallDamping(double damping, double onset) noexcept : damping_(damping), onset_(onset) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::dissipative; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override;

 private:
  double damping_, onset_;  ///< [N s/m], [m]
};

/// Returns the largest stiffness [N/m] of walls that are sampled at `rate_hz` [Hz] and act `delay` [s] late, on a
/// device that no hand holds and whose own damping is `damping` [N s/m]: K < b / (T / 2 + delay) (Colgate and Schenkel
/// 1997; with the delay, Gil et al. 2004). The wall's own damping does not count, because it is as late.
double largest_wall_stiffness(double rate_hz, double delay, double damping = 1);

}  // namespace haptrace
