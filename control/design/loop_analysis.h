// Passivity, stability and margins of a sampled PD loop.
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
/// force on the plant over the last period, which is u after the hold and the plant's delay and lag.
struct ObserverModel {
  double bandwidth_hz = 10;  ///< f
  double nominal_mass = 0;   ///< M [kg]
};

/// One axis of a plant, with the elements that close the loop around it.
struct LoopModel {
  double mass = 0;        ///< [kg]
  double viscous = 0;     ///< b [N s/m]
  double delay = 0;       ///< from the tick that commands a force to the motor; any fraction of a period is allowed [s]
  double lag = 0;         ///< first-order lag of the motor, in addition to `delay` [s]
  double rate_hz = 1000;  ///< 1 / T
  std::string velocity = "lowpass:100";  ///< see make_velocity_estimator
  double resolution = 0;                 ///< position resolution [m]
  std::optional<ObserverModel> observer;
};

/// Returns the loop model of one axis of `plant`. `lag` [s] is the part of the plant's delay that is the motor's lag.
LoopModel loop_of(const PlantModel& plant, int axis, double rate_hz, const std::string& velocity, double lag = 0);

/// Stability margins of a loop. All are zero for an unstable loop.
struct Margins {
  double gain_up = 0;    ///< upper limit of the factor on the loop gain; infinity: none
  double gain_down = 0;  ///< lower limit of the factor on the loop gain
  double phase = 0;      ///< phase margin: the smallest lag or lead that makes the loop unstable [rad]
  double delay = 0;      ///< largest additional delay, with the phase of exp(-j w delay) [s]; infinity: any
  double modulus = 0;    ///< modulus margin: the smallest |1 + L|, which is 1 over the largest sensitivity
};

/// Required margins. 0.5 and 2 are textbook values (Astrom and Murray, Feedback Systems, 10.3 and 12.3).
struct MarginFloor {
  double modulus = 0.5;
  double gain = 2;
};

/// Gains of one axis.
struct AxisGains {
  double kp = 0;  ///< [N/m]
  double kd = 0;  ///< [N s/m]
};

/// Analyses the linear loop u = -(kp x + kd v) (+ observer) around m x'' + b x' = F, where F is u, held for a period T,
/// delayed by `delay` and filtered by 1 / (lag s + 1). The model has no Coulomb friction, gravity gradient or
/// quantisation.
///
/// With w = 1 / z, the loop is det(w) = A(w) + N(w) (kp + kd V(w)) = 0. A contains the poles of the sampled plant, and
/// N its zeros (zero-order hold, solved by the matrix exponential). V is the velocity estimator; its response is
/// measured from the estimator that a session uses. foaw is not linear: V is then its longest window, the one with the
/// most lag. Within the unit circle det is analytic, and its zeros are the unstable poles of the loop. They are counted
/// by the argument of det along the circle (Cauchy). Gains on the stability boundary follow from det = 0 at a point of
/// the circle (D-decomposition; Neimark 1949). The only approximation is that V's response is cut off at 1e-12.
///
/// Immutable; safe to share between threads.
class LoopAnalysis {
 public:
  static constexpr double kLongestDelay = 64;  ///< limit of `delay`, and of `lag` [periods]

  /// Throws Error(input) naming the value that is out of range. The mass must be positive. b, delay and lag must not be
  /// negative, and delay and lag at most kLongestDelay. The estimator must settle within 2^18 samples.
  explicit LoopAnalysis(const LoopModel& model);

  /// Returns whether every pole is inside the unit circle. Without stiffness (kp = 0) one pole is on it: not stable.
  [[nodiscard]] bool stable(double kp, double kd) const;

  /// Returns the damping [N s/m] that the device must exceed for the law to be passive with any passive hand:
  ///
  ///     b > T / (2 (1 - cos wT)) Re{(1 - exp(-jwT)) H(exp(jwT))}   for 0 < w <= pi / T
  ///
  /// (Colgate and Schenkel, J. Robotic Systems 14(1), 1997). With kp = K, kd = B and the first difference this is
  /// K T / 2 + |B|. A force that arrives late by a fraction of a period, or through the lag, changes the weights of the
  /// aliases w + 2 pi n / T. The argument of Colgate and Schenkel then excludes a disc of centre c and radius r, and
  /// gives 2 b > -Re(c H) + sqrt(Re(c H)^2 + |H|^2 (r^2 - |c|^2)). With an observer the damping is practically
  /// infinite.
  [[nodiscard]] double passive_damping(double kp, double kd) const;
  [[nodiscard]] bool passive(double kp, double kd) const { return model_.viscous > passive_damping(kp, kd); }

  /// Returns the margins of the loop opened at the motor: L = N (kp + kd V) / A, with the terms of the observer.
  [[nodiscard]] Margins margins(double kp, double kd) const;

  /// Returns the largest stable kp for this kd; 0 when there is none. With an observer the stable gains may form
  /// several intervals; the result is the end of the highest.
  [[nodiscard]] double stiffest(double kd) const;
  /// Returns the largest stable kd for this kp > 0; 0 when there is none.
  [[nodiscard]] double most_damped(double kp) const;
  /// Returns the gains with the largest kp that keep the margins, to a thousandth; zeros when there are none.
  [[nodiscard]] AxisGains stiffest_pair(const MarginFloor& floor) const;

  [[nodiscard]] const LoopModel& model() const noexcept { return model_; }

 private:
  using Complex = std::complex<double>;

  /// All quantities that do not depend on the gains, at w = exp(-j theta).
  struct Point {
    double theta = 0;       ///< frequency [rad per sample]
    Complex poles;          ///< poles of the sampled plant, times the observer's feedback 1 - Q D
    Complex plant;          ///< N [m/N]
    Complex velocity;       ///< V [1/s]
    Complex observer;       ///< g M (1 - Q) V [N/m]
    Complex feedback{1.0};  ///< 1 - Q D

    [[nodiscard]] Complex law(double kp, double kd) const { return kp + kd * velocity + observer; }
    [[nodiscard]] Complex det(double kp, double kd) const { return poles + plant * law(kp, kd); }
    [[nodiscard]] double sensitivity_inverse(double kp, double kd) const { return std::abs(det(kp, kd) / poles); }
  };
  /// The line fixed + s moving, at one point of the circle.
  struct Line {
    Complex fixed, moving;
  };
  /// Effect of hold, delay and lag on the aliases; see passive_damping.
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
  /// Returns the positive s at which fixed + s moving vanishes somewhere on the circle, in ascending order.
  template <class LineAt>
  [[nodiscard]] std::vector<double> crossings(const LineAt& line_at) const;
  template <class StableAt>
  [[nodiscard]] static double largest_stable(const std::vector<double>& crossings, const StableAt& stable_at);
  [[nodiscard]] double stiffest_within(double kd, const MarginFloor& floor) const;

  LoopModel model_;
  double period_;
  // The sampled plant maps x, v, f, the newest active command and the previous one to x, v, f after a period.
  int whole_delay_ = 0;    ///< whole periods of the delay
  double part_delay_ = 0;  ///< remaining fraction of a period
  bool lags_ = false;
  double pole_v_ = 0, lacks_v_ = 0, pole_f_ = 0, lacks_f_ = 0;  ///< exp(-bT/m) and exp(-T/lag), and 1 minus each
  double x_from_v_ = 0, x_from_f_ = 0, v_from_f_ = 0;
  std::array<double, 3> newest_{}, before_{};
  std::vector<double> velocity_;  ///< V's response to a position step [1/s]
  std::vector<Point> grid_;
  std::vector<Disc> discs_;
};

}  // namespace haptrace
