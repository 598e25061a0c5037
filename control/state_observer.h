// Estimation of a device's position, velocity and load from its mass and the forces sent to it.
#pragma once

#include "control/sent_forces.h"

namespace haptrace {

/// A Luenberger observer of m x'' = u(t - delay) - load for each axis, with the load as a third state that is assumed
/// constant (an extended state observer, Han 2009):
///
///     prediction   a = (u_delayed - known) / m - d;  x += dt v + dt^2 a / 2;  v += dt a
///     correction   e = x_measured - x;  x += l1 e;  v += l2 e;  d -= l3 e
///
/// d times the mass is the part of the load that is not `known` yet. The gains put all three poles at
/// p = exp(-2 pi f / rate) (critically damped, as in the fading memory filters of Morrison 1969): l1 = 1 - p^3,
/// l2 = 3/2 (1-p)^2 (1+p) / T, l3 = (1-p)^3 / T^2. Unlike a filter, the observer does not lag behind the effect of
/// known forces. The bandwidth f, which sets how much noise of quantised positions passes, may therefore be low.
///
/// An axis without mass is not observed: its position is the measured one, at rest, without load.
///
/// Real-time: all but the constructor. Positions and forces must be finite.
class StateObserver {
 public:
  struct Options {
    Vec3 mass = Vec3::Zero();  ///< [kg]
    double delay = 0;          ///< delay of the force [s], limited to kLongestDelay ticks
    double bandwidth_hz = 20;
    double rate_hz = 1000;
  };

  struct Estimate {
    Vec3 position = Vec3::Zero();  ///< [m]
    Vec3 velocity = Vec3::Zero();  ///< [m/s]
    Vec3 load = Vec3::Zero();      ///< force that cancels the unknown part of the load [N]
  };

  static constexpr int kLongestDelay = 30;  ///< [ticks]
  static constexpr double kLongestGap = 5;  ///< gap after which it restarts at rest where the device is [ticks]

  explicit StateObserver(const Options& options);

  /// Moves the poles to another frequency from now on; the states stay.
  void set_bandwidth(double bandwidth_hz) noexcept;

  /// Starts at rest at `position`, without a load and without sent forces.
  void start(const Vec3& position) noexcept;

  /// Takes one tick: `position` is measured `dt` [s] after the previous one, `sent` is the force that the last tick
  /// sent after all limits, and `known` the part of it that cancels known loads.
  void update(const Vec3& position, double dt, const Vec3& sent, const Vec3& known) noexcept;

  /// Returns the estimate for now.
  [[nodiscard]] Estimate now() const noexcept;

  /// Returns the estimate for the whole tick nearest to the instant at which a force sent now acts, lead() from now. It
  /// uses the forces that are under way (a Smith predictor in state space).
  [[nodiscard]] Estimate ahead() const noexcept;
  [[nodiscard]] double lead() const noexcept { return lead_ticks_ * period_; }  ///< [s]

 private:
  Vec3 mass_, inverse_mass_;
  double period_, delay_ticks_;
  int lead_ticks_;
  double l1_ = 0, l2_ = 0, l3_ = 0;
  SentForces forces_{kLongestDelay};  ///< sent minus known
  Vec3 x_ = Vec3::Zero(), v_ = Vec3::Zero(), d_ = Vec3::Zero();
};

}  // namespace haptrace
