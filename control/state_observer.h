// Where the device is, how fast it moves and what loads it, as far as its mass and the forces sent to it tell.
#pragma once

#include "control/sent_forces.h"

namespace haptrace {

/// A Luenberger observer of m x'' = u(t - delay) - load for each axis, with the load as a third state that stays where
/// it is (an extended state observer, Han 2009):
///
///     prediction   a = (u_delayed - known) / m - d;  x += dt v + dt^2 a / 2;  v += dt a
///     correction   e = x_measured - x;  x += l1 e;  v += l2 e;  d -= l3 e
///
/// d, times the mass, is what of the load is not `known` yet. The gains put all three poles at p = exp(-2 pi f / rate)
/// (critically damped, as in the fading memory filters of Morrison 1969): l1 = 1 - p^3, l2 = 3/2 (1-p)^2 (1+p) / T,
/// l3 = (1-p)^3 / T^2. Unlike a filter, it does not lag behind what the known forces do, so that the bandwidth f, which
/// sets how much noise of quantised positions passes, may be low.
///
/// An axis without mass is left alone: its position is the measured one, at rest, without load.
///
/// Real-time: all but the constructor. Positions and forces must be finite.
class StateObserver {
 public:
  struct Options {
    Vec3 mass = Vec3::Zero();  ///< [kg]
    double delay = 0;          ///< of the force [s]; beyond kLongestDelay ticks it is that
    double bandwidth_hz = 20;
    double rate_hz = 1000;
  };

  struct Estimate {
    Vec3 position = Vec3::Zero();  ///< [m]
    Vec3 velocity = Vec3::Zero();  ///< [m/s]
    Vec3 load = Vec3::Zero();      ///< the force that cancels what is not known of the load [N]
  };

  static constexpr int kLongestDelay = 30;  ///< ticks
  static constexpr double kLongestGap = 5;  ///< ticks after which it begins anew where the device is, at rest

  explicit StateObserver(const Options& options);

  /// Puts the poles at another frequency from now on; the states stay.
  void set_bandwidth(double bandwidth_hz) noexcept;

  /// At rest at `position`, nothing loads it, nothing was sent.
  void start(const Vec3& position) noexcept;

  /// A tick: `position` measured `dt` after the last; `sent` is the force that the last tick sent after all limits,
  /// `known` what of it cancels loads that are known.
  void update(const Vec3& position, double dt, const Vec3& sent, const Vec3& known) noexcept;

  /// Now.
  [[nodiscard]] Estimate now() const noexcept;

  /// At the whole tick nearest to when a force sent now acts, from the forces that are under way (a Smith predictor in
  /// state space); lead() from now.
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
