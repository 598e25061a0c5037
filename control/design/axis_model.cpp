#include "control/design/axis_model.h"

#include "base/error.h"
#include "control/design/line_spectrum.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <unsupported/Eigen/MatrixFunctions>

namespace haptrace {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

void check(const AxisModel& model) {
  constexpr double kMost = 1e9;
  const auto positive = [](const char* what, double value, const char* unit) {
    check_range(what, value, 1e-9, kMost, unit);
  };
  positive("axis model: the mass", model.mass, "kg");
  check_range("axis model: the viscous damping", model.viscous, 0, kMost, "N s/m");
  check_range("axis model: the delay", model.delay_ticks, 0, AxisModel::kLongestDelay, "periods");
  check_range("axis model: the rate", model.rate_hz, 1, 1e6, "Hz");
  check_range("axis model: the motor's lag", model.lag, 0, 1, "s");
  check_range("axis model: the force noise", model.force_noise, 0, kMost, "N sqrt(s)");
  check_range("axis model: the position noise", model.position_noise, 0, 1, "m");
  check_range("axis model: the drift", model.noise.drift, 0, kMost, "N");
  check_range("axis model: the tremor", model.noise.tremor, 0, kMost, "N");
  check_range("axis model: the mass of the hand", model.hand.mass, 0, kMost, "kg");
  check_range("axis model: the mass of the link", model.link.mass, 0, kMost, "kg");
  if (model.noise.drift > 0) positive("axis model: the corner of the drift", model.noise.drift_hz, "Hz");
  if (model.noise.tremor > 0) positive("axis model: the frequency of the tremor", model.noise.tremor_hz, "Hz");
  if (model.hand.mass > 0) {
    positive("axis model: the stiffness of the grip", model.hand.grip_stiffness, "N/m");
    check_range("axis model: the damping of the grip", model.hand.grip_damping, 0, kMost, "N s/m");
    check_range("axis model: the stiffness of the arm", model.hand.arm_stiffness, 0, kMost, "N/m");
    check_range("axis model: the damping of the arm", model.hand.arm_damping, 0, kMost, "N s/m");
    positive("axis model: the relaxation of the arm", model.hand.arm_relaxation_s, "s");
  }
  if (model.link.mass > 0) {
    positive("axis model: the stiffness of the link", model.link.stiffness, "N/m");
    check_range("axis model: the damping of the link", model.link.damping, 0, kMost, "N s/m");
  }
}

/// The model in continuous time: x' = rates x + force u + noise of the spectral densities `density`.
struct Continuous {
  MatrixXd rates;
  VectorXd force, density, together, moving, balanced;
  int drift = -1;

  explicit Continuous(const AxisModel& model) {
    const States at = states_of(model);
    drift = at.drift;
    rates.setZero(at.count, at.count);
    for (VectorXd* const vector : {&force, &density, &together, &moving, &balanced}) vector->setZero(at.count);
    add_device(model, at);
    Body held{at.device, model.mass};
    if (at.link >= 0) held = add_link(model.link, held, at.link);
    if (at.hand >= 0) held = add_hand(model.hand, held, at.hand);
    if (at.drift >= 0) add_drift(model.noise, held);
    if (at.tremor >= 0) add_tremor(model.noise, held, at.tremor);
  }

 private:
  /// The first state of each part; -1: the model has no such part.
  struct States {
    int device = -1, lag = -1, link = -1, hand = -1, drift = -1, tremor = -1;
    int count = 0;
  };

  /// A body is its position; its velocity is the next state.
  struct Body {
    int at;
    double mass;
  };

  static States states_of(const AxisModel& model) {
    States states;
    const auto add = [&](bool present, int count) {
      const int first = present ? states.count : -1;
      if (present) states.count += count;
      return first;
    };
    states.device = add(true, 2);
    states.lag = add(model.lag > 0, 1);
    states.link = add(model.link.mass > 0, 2);
    states.hand = add(model.hand.mass > 0, 3);
    states.drift = add(model.noise.drift > 0, 1);
    states.tremor = add(model.noise.tremor > 0, 2);
    return states;
  }

  void add_body(int at) {
    rates(at, at + 1) = 1;
    together[at] = moving[at + 1] = 1;
  }

  void connect(const Body& a, const Body& b, double stiffness, double damping) {
    for (const auto& [from, to, mass] : {std::tuple{a.at, b.at, a.mass}, {b.at, a.at, b.mass}}) {
      rates(from + 1, from) -= stiffness / mass;
      rates(from + 1, to) += stiffness / mass;
      rates(from + 1, from + 1) -= damping / mass;
      rates(from + 1, to + 1) += damping / mass;
    }
  }

  /// Adds the mass and the damping, and the motor, which the force drives with a lag or at once.
  void add_device(const AxisModel& model, const States& at) {
    const int x = at.device, f = at.lag;
    add_body(x);
    rates(x + 1, x + 1) = -model.viscous / model.mass;
    density[x + 1] = std::pow(model.force_noise / model.mass, 2);
    if (f >= 0) {
      rates(x + 1, f) = 1 / model.mass;
      rates(f, f) = -1 / model.lag;
      force[f] = 1 / model.lag;
      balanced[f] = -1;
    } else {
      force[x + 1] = 1 / model.mass;
    }
  }

  /// Returns the body on which the hand acts: the link.
  Body add_link(const LinkModel& link, const Body& device, int at) {
    const Body body{at, link.mass};
    add_body(at);
    connect(device, body, link.stiffness, link.damping);
    balanced[at] = 1 / link.stiffness;
    return body;
  }

  /// Returns the body on which the noise acts: the hand, which the arm holds.
  Body add_hand(const HandModel& h, const Body& held, int at) {
    const Body body{at, h.mass};
    add_body(at);
    connect(held, body, h.grip_stiffness, h.grip_damping);
    const int elbow = at + 2;
    rates(at + 1, at) -= h.arm_stiffness / h.mass;
    rates(at + 1, elbow) += h.arm_stiffness / h.mass;
    rates(at + 1, at + 1) -= h.arm_damping / h.mass;
    rates(elbow, at) = 1 / h.arm_relaxation_s;
    rates(elbow, elbow) = -1 / h.arm_relaxation_s;
    together[elbow] = 1;
    balanced[at] = balanced[elbow] = balanced[held.at] + 1 / h.grip_stiffness;
    return body;
  }

  void add_drift(const HandNoise& noise, const Body& held) {
    const double corner = kTwoPi * noise.drift_hz;
    rates(held.at + 1, drift) = 1 / held.mass;
    rates(drift, drift) = -corner;
    balanced[drift] = 1;
    density[drift] = 2 * corner * noise.drift * noise.drift;
  }

  void add_tremor(const HandNoise& noise, const Body& held, int at) {
    constexpr double kZeta = HandNoise::kTremorDamping;
    const double w = kTwoPi * noise.tremor_hz;
    rates(held.at + 1, at) = 1 / held.mass;
    rates(at, at + 1) = 1;
    rates(at + 1, at) = -w * w;
    rates(at + 1, at + 1) = -2 * kZeta * w;
    density[at + 1] = 4 * kZeta * w * w * w * noise.tremor * noise.tremor;
  }
};

/// Returns the covariance of the noise that gathers in `span` [s].
MatrixXd gathered_noise(const Continuous& model, double span) {
  const Index n = model.rates.rows();
  int doublings = 0;
  while (model.rates.norm() * span > 1 && doublings < 60) {
    span /= 2;
    ++doublings;
  }
  MatrixXd both = MatrixXd::Zero(2 * n, 2 * n);
  both.topLeftCorner(n, n) = -span * model.rates;
  both.topRightCorner(n, n) = span * MatrixXd(model.density.asDiagonal());
  both.bottomRightCorner(n, n) = span * model.rates.transpose();
  const MatrixXd powers = both.exp();
  MatrixXd transition = powers.bottomRightCorner(n, n).transpose();
  MatrixXd covariance = transition * powers.topRightCorner(n, n);
  for (int i = 0; i < doublings; ++i) {
    covariance += (transition * covariance * transition.transpose()).eval();
    transition = (transition * transition).eval();
  }
  return 0.5 * (covariance + covariance.transpose());
}

}  // namespace

double measured_noise(const PlantModel& plant) noexcept {
  return std::hypot(plant.position_resolution / std::sqrt(12.0), plant.position_noise);
}

DiscreteAxis discretised(const AxisModel& model) {
  check(model);
  const Continuous continuous(model);
  const double period = 1 / model.rate_hz;
  const Index n = continuous.rates.rows();

  DiscreteAxis axis;
  axis.rate_hz = model.rate_hz;
  axis.drift = continuous.drift;
  axis.together = continuous.together;
  axis.moving = continuous.moving;
  axis.balanced = continuous.balanced;
  axis.measurement_variance = model.position_noise * model.position_noise;
  axis.delay = static_cast<int>(std::floor(model.delay_ticks + 1e-9));
  const double late = std::max(model.delay_ticks - axis.delay, 0.0);
  axis.fractional = late > 1e-9;

  // The previous force acts first, for the fraction of the period by which the newest one is late.
  MatrixXd rates = MatrixXd::Zero(n + 1, n + 1);
  rates.topLeftCorner(n, n) = continuous.rates;
  rates.topRightCorner(n, 1) = continuous.force;
  const MatrixXd first = (late * period * rates).exp(), rest = ((1 - late) * period * rates).exp();
  const auto transition = [n](const MatrixXd& m) { return m.topLeftCorner(n, n); };
  axis.transition = transition(rest) * transition(first);
  axis.newer = rest.topRightCorner(n, 1);
  axis.older = transition(rest) * first.topRightCorner(n, 1);
  axis.noise = gathered_noise(continuous, period);
  return axis;
}

}  // namespace haptrace
