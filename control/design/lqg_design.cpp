#include "control/design/lqg_design.h"

#include "base/eigenvalues.h"
#include "base/error.h"
#include "control/design/riccati.h"
#include "control/filters.h"
#include "control/ripple.h"

#include <Eigen/LU>

#include <cmath>
#include <numbers>

namespace haptrace {
namespace {

using Complex = std::complex<double>;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::RowVectorXd;
using Eigen::VectorXd;

constexpr Index kRippleStates = 4;

/// The regulator of the model without its whole delay. Its states are those of the model, the last force if the model
/// needs it, and the ripple's.
std::optional<RowVectorXd> regulator(const DiscreteAxis& model, const RippleModel& ripple, double weight) {
  const Index n = model.states(), last = model.fractional ? 1 : 0, size = n + last + kRippleStates;
  MatrixXd a = MatrixXd::Zero(size, size);
  VectorXd b = VectorXd::Zero(size);
  a.topLeftCorner(n, n) = model.transition;
  b.head(n) = model.newer;
  if (model.fractional) {
    a.col(n).head(n) = model.older;
    b[n] = 1;
  }
  a.bottomRightCorner<kRippleStates, kRippleStates>() = ripple.a;
  b.tail<kRippleStates>() = ripple.b;

  MatrixXd q = MatrixXd::Zero(size, size);
  q(0, 0) = 1;
  q.bottomRightCorner<kRippleStates, kRippleStates>() = weight * ripple.c.transpose() * ripple.c;
  VectorXd s = VectorXd::Zero(size);
  s.tail<kRippleStates>() = weight * ripple.d * ripple.c.transpose();
  const double r = weight * ripple.d * ripple.d;

  const std::optional<MatrixXd> x = solve_riccati(a, b, q, r, s);
  if (!x) return std::nullopt;
  const VectorXd xb = *x * b;
  return (xb.transpose() * a + s.transpose()) / (r + b.dot(xb));
}

std::optional<VectorXd> kalman_gain(const DiscreteAxis& model) {
  const Index n = model.states();
  const std::optional<MatrixXd> p = solve_riccati(model.transition.transpose(), VectorXd::Unit(n, 0), model.noise,
                                                  model.measurement_variance, VectorXd::Zero(n));
  if (!p) return std::nullopt;
  return p->col(0) / ((*p)(0, 0) + model.measurement_variance);
}

}  // namespace

RippleModel::RippleModel(double rate_hz) {
  const auto section = Butterworth2(FilterKind::high_pass, kRippleCutoff, rate_hz).coefficients();
  Eigen::Matrix2d step;
  step << -section.a1, 1, -section.a2, 0;
  const Eigen::Vector2d in(section.b1 - section.a1 * section.b0, section.b0 - section.a2 * section.b0);
  const Eigen::RowVector2d out(1, 0);
  a.setZero();
  a.topLeftCorner<2, 2>() = step;
  a.bottomRightCorner<2, 2>() = step;
  a.bottomLeftCorner<2, 2>() = in * out;
  b << in, section.b0 * in;
  c << section.b0 * out, out;
  d = section.b0 * section.b0;
  constant << -section.b0, section.b0, 0, 0;
}

std::optional<LqgAxis> design_lqg(const AxisModel& model, double ripple_weight) {
  check_range("LQG design: the weight of the ripple", ripple_weight, 1e-30, 1e30, "m^2/N^2");
  check_range("LQG design: the position noise", model.position_noise, 1e-12, 1, "m");
  LqgAxis law;
  law.model = discretised(model);
  const DiscreteAxis& axis = law.model;
  const RippleModel ripple(model.rate_hz);
  const auto gains = regulator(axis, ripple, ripple_weight);
  const auto kalman = kalman_gain(axis);
  if (!gains || !kalman) return std::nullopt;
  law.kalman = *kalman;
  law.ripple = gains->tail<kRippleStates>();
  law.sent = RowVectorXd::Zero(axis.sent());
  // The last force of the model without delay is the newest that was sent.
  if (axis.fractional) law.sent[0] = (*gains)[axis.states()];
  // A force that was sent `ticks` ago acts in the period that is delay - ticks from now, and the model moves on from
  // there to the instant at which a force sent now acts.
  law.state = gains->head(axis.states());
  for (int ticks = 1; ticks <= axis.delay; ++ticks) {
    law.sent[ticks - 1] += law.state.dot(axis.newer);
    if (axis.fractional) law.sent[ticks] += law.state.dot(axis.older);
    law.state *= axis.transition;
  }
  law.stiffness = law.state.dot(axis.together);
  law.damping = law.state.dot(axis.moving);
  if (axis.drift >= 0) law.load = law.state.dot(axis.balanced) - law.sent.sum() - law.ripple.dot(ripple.constant);
  return law;
}

LqgLoop::LqgLoop(const LqgAxis& law, const DiscreteAxis& plant) {
  const RippleModel ripple(plant.rate_hz);
  // The states are the plant's, the forces on their way (newest first), the model's before the correction, the
  // ripple's.
  const DiscreteAxis& model = law.model;
  const Index n = plant.states(), m = model.states(), sent = std::max(plant.sent(), model.sent());
  const Index at_sent = n, at_model = n + sent, at_ripple = at_model + m, size = at_ripple + kRippleStates;

  // Command from the states, and from the measurement's noise.
  RowVectorXd command = RowVectorXd::Zero(size);
  const double correction = law.state.dot(law.kalman);
  command[0] = -correction;
  command.segment(at_sent, law.sent.size()) = -law.sent;
  command.segment(at_model, m) = -law.state;
  command[at_model] += correction;
  command.tail<kRippleStates>() = -law.ripple;
  const double from_noise = -correction;

  transition_ = MatrixXd::Zero(size, size);
  VectorXd noise = VectorXd::Zero(size);
  const auto act = [&](Index at, const VectorXd& by, int ticks) {
    if (ticks > 0) {
      transition_.col(at_sent + ticks - 1).segment(at, by.size()) += by;
    } else {
      transition_.middleRows(at, by.size()) += by * command;
      noise.segment(at, by.size()) += by * from_noise;
    }
  };
  transition_.topLeftCorner(n, n) = plant.transition;
  act(0, plant.newer, plant.delay);
  if (plant.fractional) act(0, plant.older, plant.delay + 1);
  if (sent > 0) {
    act(at_sent, VectorXd::Ones(1), 0);
    for (Index i = 1; i < sent; ++i) transition_(at_sent + i, at_sent + i - 1) = 1;
  }
  const VectorXd gain = model.transition * law.kalman;
  transition_.block(at_model, at_model, m, m) = model.transition;
  transition_.col(at_model).segment(at_model, m) -= gain;
  transition_.col(0).segment(at_model, m) += gain;
  noise.segment(at_model, m) += gain;
  act(at_model, model.newer, model.delay);
  if (model.fractional) act(at_model, model.older, model.delay + 1);
  transition_.bottomRightCorner<kRippleStates, kRippleStates>() += ripple.a;
  act(at_ripple, ripple.b, 0);

  noise_ = plant.measurement_variance * noise * noise.transpose();
  noise_.topLeftCorner(n, n) += plant.noise;
  ripple_row_ = ripple.d * command;
  ripple_row_.tail<kRippleStates>() += ripple.c;
  ripple_noise_ = std::pow(ripple.d * from_noise, 2) * plant.measurement_variance;
}

double LqgLoop::radius() const {
  return spectral_radius(transition_);
}

std::optional<LoopFigures> LqgLoop::figures() const {
  const std::optional<MatrixXd> p = solve_lyapunov(transition_, noise_);
  if (!p) return std::nullopt;
  return LoopFigures{std::sqrt((*p)(0, 0)), std::sqrt(ripple_row_ * *p * ripple_row_.transpose() + ripple_noise_)};
}

FrequencyGrid::FrequencyGrid(double rate_hz) : rate_hz_(rate_hz) {
  constexpr double kLowest = 0.05;  // [Hz]
  constexpr int kPerDecade = 30;
  const RippleModel ripple(rate_hz);
  const double decades = std::log10(0.5 * rate_hz / kLowest);
  const int points = static_cast<int>(std::ceil(decades * kPerDecade));
  for (int i = 0; i <= points; ++i) {
    const double frequency = kLowest * std::pow(10, decades * i / points);
    z_.push_back(std::polar(1.0, 2 * std::numbers::pi * frequency / rate_hz));
    const Eigen::Matrix4cd resolvent = z_.back() * Eigen::Matrix4cd::Identity() - ripple.a;
    ripple_.emplace_back(resolvent.partialPivLu().solve(ripple.b.cast<Complex>()));
  }
}

FrequencyGrid::Response FrequencyGrid::plant(const DiscreteAxis& plant) const {
  Response response;
  for (const Complex& z : z_) {
    Eigen::MatrixXcd resolvent = -plant.transition;
    resolvent.diagonal().array() += z;
    const Eigen::VectorXcd in = (plant.newer + plant.older / z) * std::pow(z, -plant.delay);
    response.push_back(resolvent.partialPivLu().solve(in)[0]);
  }
  return response;
}

double FrequencyGrid::frequency(std::size_t index) const {
  return std::arg(z_.at(index)) * rate_hz_ / (2 * std::numbers::pi);
}

FrequencyGrid::Response FrequencyGrid::law(const LqgAxis& law) const {
  // x = (I - kalman c) p + kalman e,   z p = transition x + (newer + older / z) z^-delay u
  const DiscreteAxis& model = law.model;
  RowVectorXd out = law.state;
  out[0] -= law.state.dot(law.kalman);
  const VectorXd gain = model.transition * law.kalman;
  MatrixXd predicted = model.transition;
  predicted.col(0) -= gain;
  Response response;
  response.reserve(z_.size());
  for (std::size_t i = 0; i < z_.size(); ++i) {
    const Complex z = z_[i], back = 1.0 / z;
    Eigen::MatrixXcd resolvent = -predicted.transpose();
    resolvent.diagonal().array() += z;
    const Eigen::VectorXcd seen = resolvent.partialPivLu().solve(out.transpose().cast<Complex>());
    const Complex forces = seen.cwiseProduct(model.newer + model.older * back).sum() * std::pow(back, model.delay);
    Complex before = 0;
    for (Index k = law.sent.size(); k-- > 0;) before = (before + law.sent[k]) * back;
    const Complex rippled = law.ripple * ripple_[i];
    response.push_back((seen.cwiseProduct(gain).sum() + law.state.dot(law.kalman)) / (1.0 + forces + before + rippled));
  }
  return response;
}

double FrequencyGrid::largest_sensitivity(const Response& plant, const Response& law) {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < law.size(); ++i) least = std::min(least, std::norm(1.0 + plant[i] * law[i]));
  return 1 / std::sqrt(least);
}

bool FrequencyGrid::stable_like(const Response& known, const Response& plant, const Response& law) {
  const auto ratio = [&](std::size_t i) { return (1.0 + plant[i] * law[i]) / (1.0 + known[i] * law[i]); };
  Complex before = ratio(0);
  double turned = std::arg(before);
  for (std::size_t i = 1; i < law.size(); ++i) {
    const Complex now = ratio(i);
    turned += std::arg(now * std::conj(before));
    before = now;
  }
  return std::abs(turned) < std::numbers::pi / 2;
}

}  // namespace haptrace
