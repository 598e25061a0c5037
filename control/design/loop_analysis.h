// Where a sampled PD loop is passive, where it is stable, and with how much margin.
#pragma once

#include "control/design/plant_model.h"

#include <array>
#include <complex>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// A disturbance observer beside the PD law, in its velocity form. At every tick
///
///     load = Q(u' + g M v) - g M v,   u = pd + load,   g = 2 pi f
///
/// where Q is the first-order low pass y += (1 - exp(-g T)) (input - y), v the estimated velocity, and u' the mean
/// force that the plant has had over the last period: u held and late by the plant's delay and lag.
struct ObserverModel {
  double bandwidth_hz = 10;  ///< f
  double nominal_mass = 0;   ///< M [kg]
};

/// One axis of a plant and what closes the loop round it.
struct LoopModel {
  double mass = 0;                       ///< [kg]
  double viscous = 0;                    ///< b [N s/m]
  double delay = 0;                      ///< from the tick that commands a force to the motor, any part of a period [s]
  double lag = 0;                        ///< of the motor, first order, beside `delay` [s]
  double rate_hz = 1000;                 ///< 1 / T
  std::string velocity = "lowpass:100";  ///< see make_velocity_estimator
  double resolution = 0;                 ///< of the positions that it sees [m]
  std::optional<ObserverModel> observer;
};

/// `axis` of `plant`; `lag` [s] is the part of the plant's delay that is the motor's lag.
LoopModel loop_of(const PlantModel& plant, int axis, double rate_hz, const std::string& velocity, double lag = 0);

/// What a stable loop bears before it is unstable. All zero of a loop that is not stable.
struct Margins {
  double gain_up = 0;    ///< the loop gain may be multiplied by less than this; infinity: by anything
  double gain_down = 0;  ///< and must be multiplied by more than this
  double phase = 0;      ///< least lag or lead that it does not bear [rad]
  double delay = 0;      ///< further delay, with the phase of exp(-j w delay) [s]; infinity: any
  double modulus = 0;    ///< least |1 + L|, which is 1 over the largest sensitivity
};

/// What is asked of a loop. 0.5 and 2 are the textbook's (Astrom and Murray, Feedback Systems, 10.3 and 12.3).
struct MarginFloor {
  double modulus = 0.5;
  double gain = 2;
};

/// Gains of one axis.
struct AxisGains {
  double kp = 0;  ///< [N/m]
  double kd = 0;  ///< [N s/m]
};

/// The linear loop u = -(kp x + kd v) (+ observer) round m x'' + b x' = F, where F is u, held for a period T, late by
/// `delay`, through 1 / (lag s + 1). Coulomb friction, gravity's gradient and quantisation are not in it.
///
/// With w = 1 / z, the loop is det(w) = A(w) + N(w) (kp + kd V(w)) = 0: A holds the poles of the sampled plant, N its
/// zeros (zero-order hold, solved by the matrix exponential), V the velocity estimator, whose response is measured from
/// the very estimator that a session uses. Of foaw, which is not linear, that is its longest window, the laggiest of
/// its answers. det is analytic within the unit circle, where its zeros are the unstable poles of the loop: they are
/// counted by its argument along the circle (Cauchy), and where gains are on the boundary follows from det = 0 at a
/// point of it (D-decomposition; Neimark 1949). Nothing is approximated but the end of V's response, at 1e-12 of it.
///
/// Immutable: any number of threads.
class LoopAnalysis {
 public:
  static constexpr double kLongestDelay = 64;  ///< periods, and as many of lag

  /// Throws Error(input) naming what is out of its range: the mass must be positive, b, delay and lag not negative and
  /// at most kLongestDelay, the estimator settled within 2^18 samples.
  explicit LoopAnalysis(const LoopModel& model);

  /// Every pole is within the unit circle. Not without stiffness: kp = 0 leaves one on it.
  [[nodiscard]] bool stable(double kp, double kd) const;

  /// Damping [N s/m] that the device must exceed for the law to be passive, with whatever passive hand:
  ///
  ///     b > T / (2 (1 - cos wT)) Re{(1 - exp(-jwT)) H(exp(jwT))}   for 0 < w <= pi / T
  ///
  /// (Colgate and Schenkel, J. Robotic Systems 14(1), 1997), which is K T / 2 + |B| for kp = K and kd = B by the first
  /// difference. A force that arrives late by a part of a period, or through the lag, weighs the aliases w + 2 pi n / T
  /// differently; then their argument gives the disc of centre c and radius r that b takes out of the plane, and
  /// 2 b > -Re(c H) + sqrt(Re(c H)^2 + |H|^2 (r^2 - |c|^2)). With an observer it is infinite in effect.
  [[nodiscard]] double passive_damping(double kp, double kd) const;
  [[nodiscard]] bool passive(double kp, double kd) const { return model_.viscous > passive_damping(kp, kd); }

  /// Of the loop opened at the motor: L = N (kp + kd V) / A, with the observer's parts in it.
  [[nodiscard]] Margins margins(double kp, double kd) const;

  /// The largest stable kp with this kd; 0: none is. With an observer what is stable may fall apart into intervals;
  /// this is the end of the highest.
  [[nodiscard]] double stiffest(double kd) const;
  /// The largest stable kd with this kp > 0; 0: none is.
  [[nodiscard]] double most_damped(double kp) const;
  /// The pair of largest kp that keeps the margins, to a thousandth; zeros: none does.
  [[nodiscard]] AxisGains stiffest_pair(const MarginFloor& floor) const;

  [[nodiscard]] const LoopModel& model() const noexcept { return model_; }

 private:
  using Complex = std::complex<double>;

  /// Everything that does not depend on the gains, at w = exp(-j theta).
  struct Point {
    double theta = 0;       ///< frequency [rad per sample]
    Complex poles;          ///< of the sampled plant, times the observer's feedback 1 - Q D
    Complex plant;          ///< N [m/N]
    Complex velocity;       ///< V [1/s]
    Complex observer;       ///< g M (1 - Q) V [N/m]
    Complex feedback{1.0};  ///< 1 - Q D

    [[nodiscard]] Complex law(double kp, double kd) const { return kp + kd * velocity + observer; }
    [[nodiscard]] Complex det(double kp, double kd) const { return poles + plant * law(kp, kd); }
    [[nodiscard]] double sensitivity_inverse(double kp, double kd) const { return std::abs(det(kp, kd) / poles); }
  };
  /// fixed + s moving, at a point.
  struct Line {
    Complex fixed, moving;
  };
  /// What the hold, the delay and the lag make of aliases: see passive_damping.
  struct Disc {
    double theta;
    Complex centre;
    double slack;  ///< r^2 - |c|^2
  };

  void discretise();
  void measure_velocity();
  void make_grid();
  [[nodiscard]] Disc disc(double theta) const;
  [[nodiscard]] Point at(double theta) const;
  /// Positive s at which fixed + s moving vanishes somewhere on the circle, ascending.
  template <class LineAt>
  [[nodiscard]] std::vector<double> crossings(const LineAt& line_at) const;
  template <class StableAt>
  [[nodiscard]] static double largest_stable(const std::vector<double>& crossings, const StableAt& stable_at);
  [[nodiscard]] double stiffest_within(double kd, const MarginFloor& floor) const;

  LoopModel model_;
  double period_;
  // The sampled plant: x, v, f after a period from x, v, f, the newest command that acts and the one before it.
  int whole_delay_ = 0;    ///< in periods
  double part_delay_ = 0;  ///< of a period
  bool lags_ = false;
  double pole_v_ = 0, lacks_v_ = 0, pole_f_ = 0, lacks_f_ = 0;  ///< exp(-bT/m) and exp(-T/lag), and 1 less them
  double x_from_v_ = 0, x_from_f_ = 0, v_from_f_ = 0;
  std::array<double, 3> newest_{}, before_{};
  std::vector<double> velocity_;  ///< V's response to a step of position [1/s]
  std::vector<Point> grid_;
  std::vector<Disc> discs_;
};

}  // namespace haptrace
