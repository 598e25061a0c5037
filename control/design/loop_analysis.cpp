#include "control/design/loop_analysis.h"

#include "base/error.h"
#include "control/velocity_estimator.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numbers>
#include <unsupported/Eigen/MatrixFunctions>

namespace haptrace {
namespace {

using std::numbers::pi;
using Complex = std::complex<double>;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// A lag shorter than this fraction of a period is treated as a delay of the same length; the difference is negligible.
constexpr double kShortestLag = 1e-6;

Complex unit(double theta) {
  return std::polar(1.0, -theta);
}

/// Returns 1 - exp(-j theta) without cancellation.
Complex one_minus_unit(double theta) {
  const double half = std::sin(theta / 2);
  return {2 * half * half, std::sin(theta)};
}

/// Returns the sum of c_k w^k by Horner's scheme. It uses real numbers because products of std::complex check for
/// infinities.
Complex polynomial(const std::vector<double>& c, const Complex& w) {
  double re = 0, im = 0;
  for (std::size_t k = c.size(); k-- > 0;) {
    const double next = re * w.real() - im * w.imag() + c[k];
    im = re * w.imag() + im * w.real();
    re = next;
  }
  return {re, im};
}

void check(const LoopModel& model) {
  check_range("loop analysis: the mass", model.mass, 1e-6, 1e4, "kg");
  check_range("loop analysis: the viscous friction", model.viscous, 0, 1e7, "N s/m");
  check_range("loop analysis: the servo rate", model.rate_hz, 1, 1e6, "Hz");
  check_range("loop analysis: the delay", model.delay, 0, LoopAnalysis::kLongestDelay / model.rate_hz, "s");
  check_range("loop analysis: the lag", model.lag, 0, LoopAnalysis::kLongestDelay / model.rate_hz, "s");
  if (model.observer) {
    check_range("loop analysis: the observer's bandwidth", model.observer->bandwidth_hz, 1e-3, 1e5, "Hz");
    check_range("loop analysis: the observer's nominal mass", model.observer->nominal_mass, 0, 1e4, "kg");
  }
}

/// Returns the zero of `f` between `low` and `high`.
template <class Function>
double root_between(double low, double high, const Function& f) {
  const bool rises = f(low) < 0;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    if (!(low < middle && middle < high)) break;
    ((f(middle) < 0) == rises ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

/// Returns the minimum of `f` between `low` and `high` by golden-section search.
template <class Function>
double least_between(double low, double high, const Function& f, int sections) {
  constexpr double kGolden = 1 / std::numbers::phi;
  double a = high - kGolden * (high - low), b = low + kGolden * (high - low);
  double at_a = f(a), at_b = f(b);
  for (int i = 0; i < sections; ++i) {
    if (at_a < at_b) {
      high = b, b = a, at_b = at_a;
      at_a = f(a = high - kGolden * (high - low));
    } else {
      low = a, a = b, at_a = at_b;
      at_b = f(b = low + kGolden * (high - low));
    }
  }
  return at_a < at_b ? a : b;
}

/// Returns the angle in [0, 2 pi).
double wrapped(double angle) {
  angle = std::fmod(angle, 2 * pi);
  return angle < 0 ? angle + 2 * pi : angle;
}

}  // namespace

LoopModel loop_of(const PlantModel& plant, int axis, double rate_hz, const std::string& velocity, double lag) {
  if (!(lag >= 0 && lag <= plant.delay))
    throw input_error(fmt::format(
        "loop analysis: the motor's lag is {} s; it must be from 0 to the plant's delay of {} s", lag, plant.delay));
  return {.mass = plant.mass[axis],
          .viscous = plant.viscous[axis],
          .delay = plant.delay - lag,
          .lag = lag,
          .rate_hz = rate_hz,
          .velocity = velocity,
          .resolution = plant.position_resolution,
          .observer = std::nullopt};
}

LoopAnalysis::LoopAnalysis(const LoopModel& model) : model_(model), period_(1 / model.rate_hz) {
  check(model_);
  measure_velocity();
  discretise();
  make_grid();
}

/// Solves the plant over a period, in units of T and T^2 / m: x' = v, v' = f - (bT/m) v, f' = (u - f) T / lag.
void LoopAnalysis::discretise() {
  const double damping = model_.viscous * period_ / model_.mass, lag = model_.lag / period_;
  lags_ = lag > kShortestLag;
  const double delay = model_.delay / period_ + (lags_ ? 0 : lag);
  whole_delay_ = static_cast<int>(std::floor(delay + 1e-9));
  part_delay_ = std::max(delay - whole_delay_, 0.0);

  Eigen::Matrix4d rates = Eigen::Matrix4d::Zero();  // rates of x, v, f and the held u
  rates(0, 1) = 1;
  rates(1, 1) = -damping;
  if (lags_) {
    rates(1, 2) = 1;
    rates(2, 2) = -1 / lag;
    rates(2, 3) = 1 / lag;
  } else {
    rates(1, 3) = 1;
  }
  // The previous command acts first, for the fraction of the period by which the newest one is late.
  const Eigen::Matrix4d first = (part_delay_ * rates).exp(), rest = ((1 - part_delay_) * rates).exp();
  const Eigen::Matrix3d over_rest = rest.topLeftCorner<3, 3>(), over_all = over_rest * first.topLeftCorner<3, 3>();
  Eigen::Map<Vec3>(newest_.data()) = rest.topRightCorner<3, 1>();
  Eigen::Map<Vec3>(before_.data()) = over_rest * first.topRightCorner<3, 1>();
  pole_v_ = std::exp(-damping);
  lacks_v_ = -std::expm1(-damping);
  pole_f_ = lags_ ? std::exp(-1 / lag) : 0;
  lacks_f_ = lags_ ? -std::expm1(-1 / lag) : 1;
  x_from_v_ = over_all(0, 1);
  x_from_f_ = lags_ ? over_all(0, 2) : 0;
  v_from_f_ = lags_ ? over_all(1, 2) : 0;
}

/// Measures the response of the estimator to a step of position, so small that foaw keeps its longest window.
void LoopAnalysis::measure_velocity() {
  constexpr int kLongestWindow = 512, kQuiet = 64;
  constexpr std::size_t kLongest = 1 << 18;
  const auto estimator = make_velocity_estimator(model_.velocity, model_.rate_hz, model_.resolution);
  const double step = model_.resolution > 0 ? 1e-3 * model_.resolution : 1;
  for (int k = 0; k < kLongestWindow; ++k) estimator->update(Vec3::Zero(), period_);
  double sum = 0;
  for (int quiet = 0; quiet < kQuiet && velocity_.size() <= kLongest;) {
    const double v = estimator->update(Vec3::Constant(step), period_).x() / step;
    velocity_.push_back(v);
    sum += v;
    quiet = std::abs(v) < 1e-12 * model_.rate_hz ? quiet + 1 : 0;
  }
  // The estimated velocity must integrate to the full step.
  if (velocity_.size() > kLongest || std::abs(sum * period_ - 1) > 1e-6)
    throw input_error(fmt::format(
        "loop analysis: the impulse response of the velocity estimator '{}' is longer than {} samples at {} Hz",
        model_.velocity, kLongest, model_.rate_hz));
  velocity_.resize(velocity_.size() - kQuiet);
}

/// Combines even steps, which resolve every turn of the delay and of the estimator's memory, with even ratios from low
/// frequencies upwards, which resolve slow decays.
void LoopAnalysis::make_grid() {
  constexpr double kLowest = 1e-7, kPerDecade = 40, kForgotten = 1e-3;
  double weight = 0, remembered = 0;
  for (const double v : velocity_) weight += std::abs(v);
  std::size_t memory = 0;
  while (memory < velocity_.size() && remembered < (1 - kForgotten) * weight)
    remembered += std::abs(velocity_[memory++]);
  const int even = 512 + 8 * (whole_delay_ + static_cast<int>(std::min<std::size_t>(memory, 512)));
  std::vector<double> thetas;
  for (double theta = kLowest; theta < pi; theta *= std::pow(10, 1 / kPerDecade)) thetas.push_back(theta);
  for (int i = 1; i < even; ++i) thetas.push_back(pi * i / even);
  std::sort(thetas.begin(), thetas.end());
  thetas.push_back(pi);

  for (const double theta : thetas) {
    grid_.push_back(at(theta));
    discs_.push_back(disc(theta));
  }
}

LoopAnalysis::Point LoopAnalysis::at(double theta) const {
  const Complex w = unit(theta), less = one_minus_unit(theta);
  const auto delayed = [&](std::size_t i) { return newest_[i] + before_[i] * w; };
  const Complex slow_v = lacks_v_ + pole_v_ * less, slow_f = lacks_f_ + pole_f_ * less;  // 1 - p w

  Point point;
  point.theta = theta;
  point.poles = less * slow_v;
  Complex n;
  if (lags_) {
    const Complex f = delayed(2), v = w * v_from_f_ * f + delayed(1) * slow_f;
    n = w * x_from_v_ * v + w * x_from_f_ * f * slow_v + delayed(0) * slow_v * slow_f;
    point.poles *= slow_f;
  } else {
    n = w * x_from_v_ * delayed(1) + delayed(0) * slow_v;
  }
  point.plant = period_ * period_ / model_.mass * n * unit(theta * (whole_delay_ + 1));

  point.velocity = less * polynomial(velocity_, w);

  if (const auto& observer = model_.observer) {
    const double g = 2 * pi * observer->bandwidth_hz, gain = -std::expm1(-g * period_), keeps = 1 - gain;
    const Complex slow = gain + keeps * less, high = keeps * less / slow, low = gain / slow;  // 1 - Q, Q
    // D = w^(1 + n) (1 - part (1 - w)): the mean over the last period of a command with a delay of n + part periods.
    const double late = (model_.delay + model_.lag) / period_, whole = std::floor(late + 1e-9);
    const double part = std::max(late - whole, 0.0);
    const Complex past = unit(theta * (whole + 1));
    const Complex one_minus_d = one_minus_unit(theta * (whole + 1)) + part * past * less;
    point.feedback = high + low * one_minus_d;
    point.observer = g * observer->nominal_mass * high * point.velocity;
    point.poles *= point.feedback;
  }
  return point;
}

/// Returns centre and slack of (1 / T) sum over n of G(j w_n) Y. Y is any value in the disc through 0 and 1 (in units
/// of 1 / b). G contains the hold, the delay, the lag and the integration of a force to a position. The frequencies are
/// w_n = w + 2 pi n / T.
LoopAnalysis::Disc LoopAnalysis::disc(double theta) const {
  const Complex less = one_minus_unit(theta);
  if (!lags_) {
    // Closed form: between two whole delays the sum is linear in the delay.
    const Complex late = unit(theta * whole_delay_) * (1.0 - part_delay_ * less);
    return {theta, -less * late * period_ / std::norm(less), period_ * period_ * part_delay_ * (1 - part_delay_)};
  }
  constexpr int kAliases = 64;
  const double lag = model_.lag / period_, delay = whole_delay_ + part_delay_;
  const auto term = [&](double a) { return -unit(a * delay) / (a * a * Complex(1, a * lag)); };
  const Complex main = term(theta);
  Complex centre = 0;
  double radius = 0;
  for (int n = 1; n <= kAliases; ++n)
    for (const double a : {theta + 2 * pi * n, theta - 2 * pi * n}) {
      const Complex alias = term(a);
      centre += alias;
      radius += std::abs(alias);
    }
  // Upper bound of the aliases that are left out.
  radius += 2 / (2 * pi * pi * (kAliases - 0.5)) / (1 + 2 * pi * (kAliases - 0.5) * lag);
  const double slack =
      2 * std::abs(main) * radius - 2 * std::real(main * std::conj(centre)) + radius * radius - std::norm(centre);
  return {theta, period_ * less * (main + centre), period_ * period_ * std::norm(less) * slack};
}

bool LoopAnalysis::stable(double kp, double kd) const {
  if (!(kp > 0 && kd >= 0 && std::isfinite(kp) && std::isfinite(kd))) return false;
  constexpr double kSharpTurn = 0.8;  // [rad]
  constexpr int kDeepest = 60;
  bool on_boundary = false;
  // Returns the change of arg(det) from one point to the next, in steps too small to hide a full turn.
  const auto turn = [&](const auto& self, double from, Complex det_from, double to, Complex det_to,
                        int depth) -> double {
    const double angle = std::arg(det_to * std::conj(det_from));
    if (std::abs(angle) < kSharpTurn) return angle;
    const double middle = 0.5 * (from + to);
    if (depth == kDeepest || !(from < middle && middle < to)) {
      on_boundary = true;
      return angle;
    }
    const Complex det = at(middle).det(kp, kd);
    return self(self, from, det_from, middle, det, depth + 1) + self(self, middle, det, to, det_to, depth + 1);
  };
  double turned = 0, theta = 0;
  Complex det = at(0).det(kp, kd);
  for (const Point& point : grid_) {
    const Complex next = point.det(kp, kd);
    turned += turn(turn, theta, det, point.theta, next, 0);
    if (on_boundary || next == 0.0) return false;
    theta = point.theta;
    det = next;
  }
  return std::abs(turned) < pi / 2;
}

double LoopAnalysis::passive_damping(double kp, double kd) const {
  double largest = 0;
  for (std::size_t i = 0; i < grid_.size(); ++i) {
    const Complex h = grid_[i].law(kp, kd) / grid_[i].feedback;
    const double in_phase = std::real(discs_[i].centre * h);
    const double needed = std::sqrt(in_phase * in_phase + std::norm(h) * std::max(discs_[i].slack, 0.0)) - in_phase;
    largest = std::max(largest, 0.5 * needed);
  }
  return largest;
}

template <class LineAt>
std::vector<double> LoopAnalysis::crossings(const LineAt& line_at) const {
  const auto off_axis = [](const Line& line) { return std::imag(line.fixed * std::conj(line.moving)); };
  std::vector<double> found;
  const auto keep = [&](const Line& line) {
    const double s = -std::real(line.fixed * std::conj(line.moving)) / std::norm(line.moving);
    if (s > 0 && std::isfinite(s)) found.push_back(s);
  };
  double previous = 0;
  for (std::size_t i = 0; i < grid_.size(); ++i) {
    const Line line = line_at(grid_[i]);
    const double now = off_axis(line);
    if (i + 1 == grid_.size()) {
      keep(line);  // at theta = pi everything is real
    } else if (i > 0 && (now < 0) != (previous < 0)) {
      keep(line_at(at(root_between(grid_[i - 1].theta, grid_[i].theta,
                                   [&](double theta) { return off_axis(line_at(at(theta))); }))));
    }
    previous = now;
  }
  std::sort(found.begin(), found.end());
  return found;
}

template <class StableAt>
double LoopAnalysis::largest_stable(const std::vector<double>& crossings, const StableAt& stable_at) {
  // Between neighbouring crossings the number of unstable poles does not change.
  for (std::size_t i = crossings.size(); i-- > 0;) {
    const double high = crossings[i], low = i > 0 ? crossings[i - 1] : high / 4;
    if (high > low * (1 + 1e-9) && stable_at(std::sqrt(low * high))) return high;
  }
  return 0;
}

double LoopAnalysis::stiffest(double kd) const {
  return largest_stable(crossings([kd](const Point& p) {
                          return Line{p.det(0, kd), p.plant};
                        }),
                        [&](double kp) { return stable(kp, kd); });
}

double LoopAnalysis::most_damped(double kp) const {
  return largest_stable(crossings([kp](const Point& p) {
                          return Line{p.det(kp, 0), p.plant * p.velocity};
                        }),
                        [&](double kd) { return stable(kp, kd); });
}

Margins LoopAnalysis::margins(double kp, double kd) const {
  Margins margins;
  if (!stable(kp, kd)) return margins;

  margins.gain_up = kInfinity;
  for (const double s : crossings([&](const Point& p) { return Line{p.poles, p.plant * p.law(kp, kd)}; })) {
    if (s >= 1) margins.gain_up = std::min(margins.gain_up, s);
    if (s < 1) margins.gain_down = std::max(margins.gain_down, s);
  }

  margins.phase = pi;
  margins.delay = kInfinity;
  const auto beyond_one = [&](const Point& p) { return std::norm(p.plant * p.law(kp, kd)) - std::norm(p.poles); };
  for (std::size_t i = 1; i < grid_.size(); ++i) {
    if ((beyond_one(grid_[i - 1]) < 0) == (beyond_one(grid_[i]) < 0)) continue;
    const double theta =
        root_between(grid_[i - 1].theta, grid_[i].theta, [&](double between) { return beyond_one(at(between)); });
    const Point point = at(theta);
    const double ahead = wrapped(std::arg(point.plant * point.law(kp, kd) / point.poles) + pi);
    margins.phase = std::min({margins.phase, ahead, 2 * pi - ahead});
    margins.delay = std::min(margins.delay, ahead / theta * period_);
  }

  margins.modulus = kInfinity;
  const auto modulus = [&](const Point& p) { return p.sensitivity_inverse(kp, kd); };
  for (std::size_t i = 1; i < grid_.size(); ++i) {
    const double here = modulus(grid_[i]);
    const bool last = i + 1 == grid_.size();
    if (here > modulus(grid_[i - 1]) || (!last && here > modulus(grid_[i + 1]))) continue;
    const auto of_theta = [&](double theta) { return modulus(at(theta)); };
    const double least = least_between(grid_[i - 1].theta, grid_[last ? i : i + 1].theta, of_theta, 30);
    margins.modulus = std::min({margins.modulus, here, of_theta(least)});
  }
  return margins;
}

double LoopAnalysis::stiffest_within(double kd, const MarginFloor& floor) const {
  const auto keeps = [&](double kp) {
    const Margins m = margins(kp, kd);
    return m.modulus >= floor.modulus && m.gain_up >= floor.gain && m.gain_down * floor.gain <= 1;
  };
  constexpr double kStep = 0.8;
  constexpr int kSteps = 60;
  double high = stiffest(kd);
  for (int i = 0; i < kSteps && high > 0; ++i, high *= kStep) {
    if (!keeps(kStep * high)) continue;
    double low = kStep * high;
    while (high > low * 1.0002) {
      const double middle = std::sqrt(low * high);
      (keeps(middle) ? low : high) = middle;
    }
    return low;
  }
  return 0;
}

AxisGains LoopAnalysis::stiffest_pair(const MarginFloor& floor) const {
  // Stiffness rises with kd to a peak, then falls to zero at the largest stable kd.
  constexpr double kDecades = 4;
  constexpr int kPerDecade = 6;
  const double largest = most_damped(1e-9 * model_.mass / (period_ * period_));
  if (!(largest > 0)) return {};
  const auto kd_of = [&](double decades) { return largest * std::pow(10, -decades); };
  const auto softness = [&](double decades) { return -stiffest_within(kd_of(decades), floor); };
  double best = 0, softest = 0;
  for (int i = 1; i <= kDecades * kPerDecade; ++i) {
    const double decades = static_cast<double>(i) / kPerDecade, soft = softness(decades);
    if (soft < softest) softest = soft, best = decades;
  }
  if (softest == 0) return {};
  best = least_between(best - 1.0 / kPerDecade, best + 1.0 / kPerDecade, softness, 14);
  return {-softness(best), kd_of(best)};
}

}  // namespace haptrace
