#include "control/velocity_estimator.h"

#include "base/error.h"
#include "base/number.h"
#include "base/units.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <numbers>
#include <optional>

namespace haptrace {
namespace {

using std::numbers::pi;
using std::numbers::sqrt2;

constexpr double kShortestTick = 1e-9;  // [s]
constexpr double kLongestStep = 1e6;    // [s]

/// Smaller values count as zero: recursive filters would otherwise reach denormal numbers, which are slow.
constexpr double kNothing = 1e-100;

Vec3 flushed(const Vec3& v) {
  return (v.array().abs() < kNothing).select(0, v);
}

/// Common part of all estimators: selects the calls that are measurements, and turns positions into steps. A Filter has
/// `Vec3 step(const Vec3& moved, double dt)`, which returns the velocity after a step, and `reset()`.
template <class Filter>
class Estimator final : public VelocityEstimator {
 public:
  explicit Estimator(Filter filter) : filter_(std::move(filter)) {}

  Vec3 update(const Vec3& position, double dt) noexcept override {
    if (!(position.cwiseAbs().maxCoeff<Eigen::PropagateNaN>() <= kFarthestPosition)) return velocity_;
    if (started_) {
      if (!(dt >= kShortestTick && dt <= kLongestStep)) return velocity_;
      velocity_ = filter_.step(flushed(position - previous_), dt);
    }
    previous_ = position;
    started_ = true;
    return velocity_;
  }

  void reset() noexcept override {
    filter_.reset();
    velocity_ = Vec3::Zero();
    started_ = false;
  }

 private:
  Filter filter_;
  Vec3 previous_ = Vec3::Zero();
  Vec3 velocity_ = Vec3::Zero();
  bool started_ = false;
};

struct Difference {
  Vec3 step(const Vec3& moved, double dt) noexcept { return moved / dt; }
  void reset() noexcept {}
};

/// Solves y'' = w^2 (u - y) - sqrt(2) w y' exactly over each step for its constant u, the mean velocity of the step. In
/// p = y - u and r = y' / w the solution is a damped rotation that never lengthens (p, r), whatever the steps. It is
/// therefore stable for any sequence of dt.
class LowPass {
 public:
  LowPass(double cutoff_hz, double dt) : w_(2 * pi * cutoff_hz) { prepare(dt); }

  Vec3 step(const Vec3& moved, double dt) noexcept {
    if (dt != dt_) prepare(dt);
    const Vec3 u = moved / dt, p = y_ - u;
    y_ = flushed(u + pp_ * p + pr_ * r_);
    r_ = flushed(rr_ * r_ - pr_ * p);
    return y_;
  }

  void reset() noexcept { y_ = r_ = Vec3::Zero(); }

 private:
  void prepare(double dt) noexcept {
    dt_ = dt;
    const double angle = w_ * dt / sqrt2, decay = std::exp(-angle);
    const double c = decay * std::cos(angle), s = decay * std::sin(angle);
    pp_ = c + s;
    rr_ = c - s;
    pr_ = sqrt2 * s;
  }

  double w_;  ///< [rad/s]
  double dt_ = 0, pp_ = 0, pr_ = 0, rr_ = 0;
  Vec3 y_ = Vec3::Zero(), r_ = Vec3::Zero();
};

/// Ring of the last steps, newest first.
class Window {
 public:
  struct Step {
    Vec3 moved = Vec3::Zero();
    double dt = 0;
  };

  explicit Window(std::size_t steps) : ring_(steps) {}

  void push(const Vec3& moved, double dt) noexcept {
    newest_ = newest_ == 0 ? ring_.size() - 1 : newest_ - 1;
    ring_[newest_] = {moved, dt};
    count_ = std::min(count_ + 1, ring_.size());
  }
  void clear() noexcept { count_ = 0; }

  [[nodiscard]] std::size_t size() const noexcept { return count_; }
  [[nodiscard]] const Step& operator[](std::size_t i) const noexcept {
    const std::size_t at = newest_ + i;
    return ring_[at < ring_.size() ? at : at - ring_.size()];
  }

 private:
  std::vector<Step> ring_;
  std::size_t newest_ = 0, count_ = 0;
};

/// Finds the longest window in which the line from the oldest to the newest position passes all others within the band.
///
/// Seen from the newest position, a position x_i at age t_i allows the slopes (x - x_i -+ band) / t_i. The window grows
/// while the slope to its oldest position is among those that all younger ones allow: one pass, not n^2 / 2.
class AdaptiveWindow {
 public:
  AdaptiveWindow(std::size_t steps, double band) : window_(steps), band_(band) {}

  Vec3 step(const Vec3& moved, double dt) noexcept {
    window_.push(moved, dt);
    Vec3 velocity;
    for (int axis = 0; axis < 3; ++axis) velocity[axis] = slope(axis);
    return velocity;
  }

  void reset() noexcept { window_.clear(); }

 private:
  [[nodiscard]] double slope(int axis) const noexcept {
    constexpr double inf = std::numeric_limits<double>::infinity();
    double moved = 0, age = 0, fitting = 0, least = -inf, most = inf;
    for (std::size_t i = 0; i < window_.size(); ++i) {
      moved += window_[i].moved[axis];
      age += window_[i].dt;
      const double slope = moved / age;
      if (slope < least || slope > most) break;
      fitting = slope;
      least = std::max(least, (moved - band_) / age);
      most = std::min(most, (moved + band_) / age);
    }
    return fitting;
  }

  Window window_;
  double band_;  ///< [m]
};

/// Computes (n S_ty - S_t S_y) / (n S_tt - S_t^2) over ages and positions relative to the newest sample, which keeps
/// the denominator at least S_tt.
class LeastSquares {
 public:
  explicit LeastSquares(std::size_t samples) : window_(samples - 1) {}

  Vec3 step(const Vec3& moved, double dt) noexcept {
    window_.push(moved, dt);
    const auto n = static_cast<double>(window_.size() + 1);
    double age = 0, s_t = 0, s_tt = 0;
    Vec3 back = Vec3::Zero(), s_y = Vec3::Zero(), s_ty = Vec3::Zero();
    for (std::size_t i = 0; i < window_.size(); ++i) {
      age += window_[i].dt;
      back += window_[i].moved;
      s_t += age;
      s_tt += age * age;
      s_y += back;
      s_ty += age * back;
    }
    return (n * s_ty - s_t * s_y) / (n * s_tt - s_t * s_t);
  }

  void reset() noexcept { window_.clear(); }

 private:
  Window window_;
};

/// Predicts x, v, a over dt with constant a, then corrects by alpha, beta / dt and gamma / dt^2 times the innovation.
///
/// With the tracking index l, here (w dt)^3, and s the root of 2 (1 - s)^3 = l s (1 + s) in (0, 1), the steady state of
/// the Kalman filter has alpha = 1 - s^2, beta = 2 (1 - s)^2, gamma = beta^2 / (2 alpha) (Kalata 1984).
class AlphaBetaGamma {
 public:
  AlphaBetaGamma(double bandwidth_hz, double dt) : w_(2 * pi * bandwidth_hz) { prepare(dt); }

  Vec3 step(const Vec3& moved, double dt) noexcept {
    if (dt != dt_) prepare(dt);
    if (beyond_nyquist_) {
      reset();
      return v_ = moved / dt;
    }
    // x_ is the estimate minus the measurement, so that at rest the whole state decays to zero.
    const Vec3 innovation = moved - (x_ + dt * (v_ + 0.5 * dt * a_));
    x_ = (alpha_ - 1) * innovation;
    v_ += dt * a_ + beta_ / dt * innovation;
    a_ += gamma_ / (dt * dt) * innovation;
    // Flush all three at once: a state without one of them decays differently, or not at all.
    for (int i = 0; i < 3; ++i)
      if (std::max({w_ * std::abs(x_[i]), std::abs(v_[i]), std::abs(a_[i]) / w_}) < kNothing) x_[i] = v_[i] = a_[i] = 0;
    return v_;
  }

  void reset() noexcept { x_ = v_ = a_ = Vec3::Zero(); }

 private:
  void prepare(double dt) noexcept {
    dt_ = dt;
    const double wt = w_ * dt;
    beyond_nyquist_ = wt >= pi;
    // Newton's method for e = 1 - s, which keeps its digits when s is close to 1.
    const double l = wt * wt * wt;
    double e = wt / (1 + wt);
    for (int i = 0; i < 6; ++i) e -= (2 * e * e * e - l * (1 - e) * (2 - e)) / (6 * e * e + l * (3 - 2 * e));
    alpha_ = e * (2 - e);
    beta_ = 2 * e * e;
    gamma_ = beta_ * beta_ / (2 * alpha_);
  }

  double w_;  ///< [rad/s]
  double dt_ = 0, alpha_ = 0, beta_ = 0, gamma_ = 0;
  bool beyond_nyquist_ = false;
  Vec3 x_ = Vec3::Zero(), v_ = Vec3::Zero(), a_ = Vec3::Zero();
};

struct Parameter {
  const char* name;
  const char* unit;
  double usual, least, most;
  bool whole;
};

struct Kind {
  std::string name;
  std::optional<Parameter> parameter;
  std::unique_ptr<VelocityEstimator> (*make)(double parameter, double dt, double resolution);
};

template <class Filter>
std::unique_ptr<VelocityEstimator> estimator(Filter filter) {
  return std::make_unique<Estimator<Filter>>(std::move(filter));
}

const std::array<Kind, 5>& kinds() {
  static const std::array<Kind, 5> all{
      {{"difference", std::nullopt, [](double, double, double) { return estimator(Difference{}); }},
       {"lowpass", Parameter{"cut-off", " Hz", 100, 0.1, 1e5, false},
        [](double cutoff, double dt, double) { return estimator(LowPass(cutoff, dt)); }},
       {"foaw", Parameter{"window", " steps", 8, 1, 256, true},
        [](double steps, double, double resolution) {
          return estimator(AdaptiveWindow(static_cast<std::size_t>(steps), resolution));
        }},
       {"least-squares", Parameter{"window", " samples", 8, 2, 256, true},
        [](double samples, double, double) { return estimator(LeastSquares(static_cast<std::size_t>(samples))); }},
       {"alpha-beta-gamma", Parameter{"bandwidth", " Hz", 60, 0.1, 1e5, false},
        [](double bandwidth, double dt, double) { return estimator(AlphaBetaGamma(bandwidth, dt)); }}}};
  return all;
}

double parse_parameter(std::string_view spec, const Kind& kind, std::string_view text) {
  if (!kind.parameter)
    throw input_error(fmt::format("velocity estimator '{}': {} takes no parameter", spec, kind.name));
  const Parameter& p = *kind.parameter;
  std::optional<double> value = number_of<double>(text);
  if (constexpr std::string_view kHertz = " Hz"; !value && p.unit == kHertz) value = parse_quantity(text, "Hz");
  if (!value || !(*value >= p.least && *value <= p.most) || (p.whole && *value != std::floor(*value)))
    throw input_error(fmt::format("velocity estimator '{}': the {} must be a {}number from {} to {}{}, as in '{}:{}'",
                                  spec, p.name, p.whole ? "whole " : "", p.least, p.most, p.unit, kind.name, p.usual));
  return *value;
}

}  // namespace

std::unique_ptr<VelocityEstimator> make_velocity_estimator(std::string_view spec, double rate_hz, double resolution) {
  if (!(rate_hz >= 1 && rate_hz <= 1e6))
    throw input_error(
        fmt::format("velocity estimator '{}': the servo rate is {} Hz; it must be 1 to 1e6", spec, rate_hz));
  if (!(resolution >= 0 && resolution <= 1))
    throw input_error(
        fmt::format("velocity estimator '{}': the position resolution is {} m; it must be 0 to 1", spec, resolution));

  const std::size_t colon = std::min(spec.find(':'), spec.size());
  const std::string_view name = spec.substr(0, colon);
  const auto kind = std::find_if(kinds().begin(), kinds().end(), [&](const Kind& k) { return k.name == name; });
  if (kind == kinds().end())
    throw input_error(fmt::format("velocity estimator '{}': '{}' is not known; known: {}", spec, name,
                                  fmt::join(velocity_estimator_names(), ", ")));
  const double parameter = colon < spec.size() ? parse_parameter(spec, *kind, spec.substr(colon + 1))
                           : kind->parameter   ? kind->parameter->usual
                                               : 0;
  return kind->make(parameter, 1 / rate_hz, resolution);
}

std::vector<std::string> velocity_estimator_names() {
  std::vector<std::string> names;
  for (const Kind& kind : kinds()) names.push_back(kind.name);
  return names;
}

}  // namespace haptrace
