#include "control/design/hand_fit.h"

#include "base/statistics.h"
#include "control/design/dense.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <utility>

namespace haptrace {
namespace {

using Complex = std::complex<double>;
using Eigen::Index;
using Eigen::Matrix3cd;
using Eigen::MatrixXd;
using Eigen::Vector3cd;
using Eigen::VectorXd;

// Order of the parameters, three each. All but coupling and lag are logarithms.
constexpr Index kMass = 0, kCoupling = 3, kViscous = 6, kLag = 9, kHand = 10, kLink = 19, kAll = 28;
constexpr Index kStiffness = 3, kDamping = 6;  // from the mass of the hand or the link

// The noise before the residuals are known.
constexpr double kHandForce = 0.012;       // amplitude of the hand's own force at the highest lines [N]
constexpr double kLeastHandForce = 0.001;  // [N]
constexpr double kHandCorner = 8;          // frequency below which it rises [Hz]
constexpr double kModelError = 0.02, kLeastModelError = 0.01, kMostModelError = 0.05;  // share of the response

// Priors: medians and standard deviations of the logarithms.
constexpr double kUsualHand[] = {0.1, 600, 4}, kHandSpread[] = {1.2, 1.2, 0.8};  // kg, N/m, N s/m
constexpr double kMassSpread = 0.4;                                              // about the mass at the highest lines
constexpr double kUsualViscous = 1, kViscousSpread = 1.5;                        // [N s/m]
constexpr double kUsualLag = 0.5e-3, kLagSpread = 0.4e-3;                        // not a logarithm [s]
constexpr double kCouplingSpread = 0.2;                                          // of M_ij / sqrt(M_ii M_jj)
constexpr double kAlike = 0.3;                                                   // between the axes
constexpr double kMassRatioSpread = 0.7;  // of the link's mass to the motors', median 1
constexpr double kLinkHz = 40;            // anti-resonance, median
constexpr double kLinkHzSpread = 0.6;
constexpr double kLinkDamping = 0.2;  // b_2 / sqrt(m_2 k_2), median
constexpr double kLinkDampingSpread = 1;

MatrixXd inverse(const MatrixXd& symmetric) {
  return solve_symmetric(symmetric, MatrixXd::Identity(symmetric.rows(), symmetric.rows()));
}

double log_determinant(const MatrixXd& symmetric) {
  return symmetric.ldlt().vectorD().cwiseMax(1e-300).array().log().sum();
}

class Fit {
 public:
  Fit(const LineSpectrum& spectrum, const std::array<bool, 3>& axes, double rate_hz, int periods, const Vec3& mass,
      HandFitParts parts)
      : spectrum_(spectrum), parts_(parts), mass_(mass), delay_(periods / rate_hz) {
    const double period = 1 / rate_hz;
    for (const LineResponse& line : spectrum.lines) {
      const double half = 0.5 * line.w * period;
      held_.push_back(std::polar(std::sin(half) / half, -half - line.w * delay_));
    }
    for (int axis = 0; axis < 3; ++axis)
      if (axes[static_cast<std::size_t>(axis)]) axes_.push_back(axis);
    for (const Index part : {kMass, kViscous}) add_free(part);
    for (const auto& [i, k] : pairs()) free_.push_back(kCoupling + i + k - 1);
    free_.push_back(kLag);
    for (Index kind = 0; parts.hand && kind < 3; ++kind) add_free(kHand + 3 * kind);
    for (Index kind = 0; parts.link && kind < 3; ++kind) add_free(kLink + 3 * kind);
    add_priors();
  }

  /// Fits from one start, and learns the noise from its residuals.
  void run(const std::array<double, 3>& hand, double link_hz) {
    constexpr int kRounds = 3, kIterations = 12, kLast = 25;
    theta_ = start(hand, link_hz);
    hand_force_ = kHandForce;
    model_error_ = kModelError;
    weigh();
    for (int round = 0; round <= kRounds; ++round) {
      descend(round < kRounds ? kIterations : kLast);
      learn_noise();
      weigh();
    }
    evidence_ = evidence();
  }

  [[nodiscard]] double evidence_found() const noexcept { return evidence_; }

  [[nodiscard]] HandFit result() const {
    HandFit fit;
    const MatrixXd covariance = inverse(normal());
    VectorXd half = VectorXd::Zero(kAll);
    for (Index f = 0; f < frees(); ++f) half[free_[at(f)]] = kInterval95 * std::sqrt(std::max(covariance(f, f), 0.0));
    HeldModel &held = fit.held, &width = fit.half_width;
    held.delay = delay_;
    held.lag = theta_[kLag];
    width.lag = half[kLag];
    // The half width of a logarithm is relative to the parameter.
    const auto take = [&](Index p, double& value, double& half_width) {
      value = std::exp(theta_[p]);
      half_width = value * half[p];
    };
    const Eigen::Matrix3d mobility = masses(theta_).inverse();
    for (const int axis : axes_) {
      const auto i = static_cast<std::size_t>(axis);
      held.mass[axis] = 1 / mobility(axis, axis);
      width.mass[axis] = held.mass[axis] * half[kMass + axis];
      take(kViscous + axis, held.viscous[axis], width.viscous[axis]);
      const auto take_three = [&](Index part, double& mass, double& mass_half, double& stiffness,
                                  double& stiffness_half, double& damping, double& damping_half) {
        take(part + axis, mass, mass_half);
        take(part + kStiffness + axis, stiffness, stiffness_half);
        take(part + kDamping + axis, damping, damping_half);
      };
      HandModel &hand = held.hand[i], &hand_half = width.hand[i];
      hand_half = {.mass = 0,
                   .grip_stiffness = 0,
                   .grip_damping = 0,
                   .arm_stiffness = 0,
                   .arm_damping = 0,
                   .arm_relaxation_s = 0};
      if (parts_.hand)
        take_three(kHand, hand.mass, hand_half.mass, hand.grip_stiffness, hand_half.grip_stiffness, hand.grip_damping,
                   hand_half.grip_damping);
      LinkModel &link = held.link[i], &link_half = width.link[i];
      if (parts_.link)
        take_three(kLink, link.mass, link_half.mass, link.stiffness, link_half.stiffness, link.damping,
                   link_half.damping);
    }
    fit.evidence = evidence_;
    double rest = 0, seen = 0;
    for (std::size_t l = 0; l < held_.size(); ++l) {
      const Vector3cd& position = spectrum_.lines[l].position;
      const Vector3cd error = position - response(l, theta_).position;
      for (const int axis : axes_) {
        const double weight = 1 / (sigma_[l][axis] * sigma_[l][axis]);
        rest += weight * std::norm(error[axis]);
        seen += weight * std::norm(position[axis]);
      }
    }
    fit.residual = seen > 0 ? std::sqrt(rest / seen) : 1;
    return fit;
  }

 private:
  /// A normal prior of a sum of parameters: sum of factor * parameter = mean, with a standard deviation of 1.
  struct Prior {
    std::vector<std::pair<Index, double>> terms;
    double mean = 0;
  };

  struct Response {
    Matrix3cd compliance = Matrix3cd::Zero();
    Vector3cd position = Vector3cd::Zero();
  };

  static std::size_t at(Index i) { return static_cast<std::size_t>(i); }
  [[nodiscard]] Index frees() const { return static_cast<Index>(free_.size()); }
  [[nodiscard]] Index axes() const { return static_cast<Index>(axes_.size()); }
  [[nodiscard]] Index rows() const { return 2 * axes() * static_cast<Index>(held_.size()); }

  [[nodiscard]] std::vector<std::pair<int, int>> pairs() const {
    std::vector<std::pair<int, int>> result;
    for (std::size_t a = 0; a < axes_.size(); ++a)
      for (std::size_t b = a + 1; b < axes_.size(); ++b) result.emplace_back(axes_[a], axes_[b]);
    return result;
  }

  void add_free(Index part) {
    for (const int axis : axes_) free_.push_back(part + axis);
  }

  void add_prior(std::vector<std::pair<Index, double>> terms, double mean, double spread) {
    for (auto& term : terms) term.second /= spread;
    priors_.push_back({std::move(terms), mean / spread});
  }

  /// Keeps a parameter alike on all axes.
  void add_likeness(Index part) {
    const double mean = 1 / static_cast<double>(axes());
    if (axes() > 1)
      for (const int axis : axes_) {
        std::vector<std::pair<Index, double>> terms;
        for (const int other : axes_) terms.emplace_back(part + other, (other == axis ? 1 : 0) - mean);
        add_prior(std::move(terms), 0, kAlike);
      }
  }

  void add_priors() {
    for (const auto& [i, k] : pairs()) add_prior({{kCoupling + i + k - 1, 1}}, 0, kCouplingSpread);
    add_prior({{kLag, 1}}, kUsualLag, kLagSpread);
    const double all = std::sqrt(static_cast<double>(axes()));  // one prior, shared among the axes
    for (const int axis : axes_) {
      add_prior({{kMass + axis, 1}}, std::log(mass_[axis]), kMassSpread);
      add_prior({{kViscous + axis, 1}}, std::log(kUsualViscous), kViscousSpread);
      for (Index kind = 0; parts_.hand && kind < 3; ++kind)
        add_prior({{kHand + 3 * kind + axis, 1}}, std::log(kUsualHand[kind]), all * kHandSpread[kind]);
      if (!parts_.link) continue;
      const Index m = kLink + axis, k = m + kStiffness, b = m + kDamping;
      add_prior({{m, 1}, {kMass + axis, -1}}, 0, kMassRatioSpread);
      add_prior({{k, 0.5}, {m, -0.5}}, std::log(kTwoPi * kLinkHz), kLinkHzSpread);
      add_prior({{b, 1}, {k, -0.5}, {m, -0.5}}, std::log(kLinkDamping), kLinkDampingSpread);
    }
    for (Index kind = 0; kind < 3; ++kind) {
      if (parts_.hand) add_likeness(kHand + 3 * kind);
      if (parts_.link) add_likeness(kLink + 3 * kind);
    }
  }

  [[nodiscard]] VectorXd start(const std::array<double, 3>& hand, double link_hz) const {
    VectorXd theta = VectorXd::Zero(kAll);
    theta[kLag] = kUsualLag;
    const double w = kTwoPi * link_hz;
    for (const int axis : axes_) {
      const double mass = mass_[axis];
      theta[kMass + axis] = std::log(mass);
      for (Index kind = 0; kind < 3; ++kind) theta[kHand + 3 * kind + axis] = std::log(hand[at(kind)]);
      theta[kLink + axis] = std::log(mass);
      theta[kLink + kStiffness + axis] = std::log(mass * w * w);
      theta[kLink + kDamping + axis] = std::log(kLinkDamping * mass * w);
    }
    return theta;
  }

  [[nodiscard]] Eigen::Matrix3d masses(const VectorXd& theta) const {
    Eigen::Matrix3d m = Eigen::Matrix3d::Identity();
    for (const int axis : axes_) m(axis, axis) = std::exp(theta[kMass + axis]);
    for (const auto& [i, k] : pairs())
      m(i, k) = m(k, i) = theta[kCoupling + i + k - 1] * std::exp(0.5 * (theta[kMass + i] + theta[kMass + k]));
    return m;
  }

  /// Returns the force of hand and link per displacement of the motors along an axis [N/m].
  [[nodiscard]] Complex impedance(Complex s, const VectorXd& theta, int axis) const {
    const auto p = [&](Index part) { return std::exp(theta[part + axis]); };
    HandModel hand;
    if (parts_.hand) {
      hand.mass = p(kHand);
      hand.grip_stiffness = p(kHand + kStiffness);
      hand.grip_damping = p(kHand + kDamping);
    }
    LinkModel link;
    if (parts_.link) link = {.mass = p(kLink), .stiffness = p(kLink + kStiffness), .damping = p(kLink + kDamping)};
    return held_response(hand, link, s).impedance;
  }

  [[nodiscard]] Response response(std::size_t line, const VectorXd& theta) const {
    const Complex s(0, spectrum_.lines[line].w);
    Matrix3cd dynamic = Matrix3cd::Identity();
    const Eigen::Matrix3d m = masses(theta);
    for (const int i : axes_)
      for (const int k : axes_) dynamic(i, k) = m(i, k) * s * s;
    Vector3cd force = Vector3cd::Zero();
    for (const int axis : axes_) {
      dynamic(axis, axis) += std::exp(theta[kViscous + axis]) * s + impedance(s, theta, axis);
      force[axis] = held_[line] / (1.0 + s * theta[kLag]) * spectrum_.lines[line].force[axis];
    }
    Response result;
    result.compliance = dynamic.inverse();
    result.position = result.compliance * force;
    return result;
  }

  /// Returns d position / d parameter, at a response.
  [[nodiscard]] Vector3cd slope(std::size_t line, const VectorXd& theta, const Response& at_theta, Index p) const {
    constexpr double kStep = 1e-5;
    const Complex s(0, spectrum_.lines[line].w);
    const Vector3cd& x = at_theta.position;
    if (p == kLag) return -s / (1.0 + s * theta[kLag]) * x;
    if (p < kViscous) {
      VectorXd more = theta;
      more[p] += kStep;
      const Eigen::Matrix3d change = (masses(more) - masses(theta)) / kStep;
      return -(s * s) * (at_theta.compliance * (change * x).eval());
    }
    const int axis = static_cast<int>(p < kLag ? p - kViscous : (p - kHand) % 3);
    Complex change;
    if (p < kLag) {
      change = std::exp(theta[p]) * s;
    } else {
      VectorXd more = theta;
      more[p] += kStep;
      change = (impedance(s, more, axis) - impedance(s, theta, axis)) / kStep;
    }
    return -at_theta.compliance.col(axis) * (change * x[axis]);
  }

  [[nodiscard]] double hand_force(double w) const { return hand_force_ * std::hypot(1.0, kTwoPi * kHandCorner / w); }

  /// Returns the position amplitude due to the hand's own force.
  [[nodiscard]] static double moved(const Response& response, int axis, double force) {
    return response.compliance.row(axis).norm() * force;
  }

  /// Computes the standard deviation of every position amplitude from the current parameters.
  void weigh() {
    sigma_.assign(held_.size(), Vec3::Ones());
    for (std::size_t l = 0; l < held_.size(); ++l) {
      const LineResponse& line = spectrum_.lines[l];
      const Response model = response(l, theta_);
      for (const int axis : axes_)
        sigma_[l][axis] = std::max(1e-12, std::hypot(spectrum_.noise, model_error_ * std::abs(line.position[axis]),
                                                     moved(model, axis, hand_force(line.w))));
    }
  }

  /// Scales the hand's force and the model error such that they explain the residuals. Each takes the residuals in
  /// proportion to its share of the variance.
  void learn_noise() {
    constexpr int kRounds = 6;
    for (int round = 0; round < kRounds; ++round) {
      double of_hand = 0, hand_share = 0, of_model = 0, model_share = 0;
      for (std::size_t l = 0; l < held_.size(); ++l) {
        const LineResponse& line = spectrum_.lines[l];
        const Response model = response(l, theta_);
        for (const int axis : axes_) {
          const double by_hand = std::pow(moved(model, axis, hand_force(line.w)), 2);
          const double by_model = std::pow(model_error_, 2) * std::norm(line.position[axis]);
          const double variance = std::max(1e-24, std::pow(spectrum_.noise, 2) + by_model + by_hand);
          const double ratio = 0.5 * std::norm(line.position[axis] - model.position[axis]) / variance;
          of_hand += by_hand / variance * ratio;
          hand_share += by_hand / variance;
          of_model += by_model / variance * ratio;
          model_share += by_model / variance;
        }
      }
      const auto step = [](double found, double share) {
        return share > 1e-9 ? std::sqrt(std::clamp(found / share, 0.25, 4.0)) : 1;
      };
      hand_force_ = std::max(hand_force_ * step(of_hand, hand_share), kLeastHandForce);
      model_error_ = std::clamp(model_error_ * step(of_model, model_share), kLeastModelError, kMostModelError);
    }
  }

  /// Returns the weighted residuals, first those of the lines, then those of the priors, and their slopes if asked for.
  [[nodiscard]] VectorXd residuals(const VectorXd& theta, MatrixXd* slopes) const {
    VectorXd r(rows() + static_cast<Index>(priors_.size()));
    if (slopes != nullptr) slopes->setZero(r.size(), frees());
    Index row = 0;
    for (std::size_t l = 0; l < held_.size(); ++l) {
      const Response model = response(l, theta);
      const Vector3cd rest = spectrum_.lines[l].position - model.position;
      for (std::size_t i = 0; i < axes_.size(); ++i) {
        const int axis = axes_[i];
        const auto place = row + 2 * static_cast<Index>(i);
        r[place] = rest[axis].real() / sigma_[l][axis];
        r[place + 1] = rest[axis].imag() / sigma_[l][axis];
      }
      for (Index f = 0; slopes != nullptr && f < frees(); ++f) {
        const Vector3cd change = slope(l, theta, model, free_[at(f)]);
        for (std::size_t i = 0; i < axes_.size(); ++i) {
          const auto place = row + 2 * static_cast<Index>(i);
          (*slopes)(place, f) = -change[axes_[i]].real() / sigma_[l][axes_[i]];
          (*slopes)(place + 1, f) = -change[axes_[i]].imag() / sigma_[l][axes_[i]];
        }
      }
      row += 2 * axes();
    }
    for (const Prior& prior : priors_) {
      double sum = -prior.mean;
      for (const auto& [p, factor] : prior.terms) sum += factor * theta[p];
      r[row] = sum;
      if (slopes != nullptr) slopes->row(row) = direction(prior).transpose();
      ++row;
    }
    return r;
  }

  [[nodiscard]] VectorXd direction(const Prior& prior) const {
    VectorXd result = VectorXd::Zero(frees());
    for (const auto& [p, factor] : prior.terms)
      result[std::find(free_.begin(), free_.end(), p) - free_.begin()] = factor;
    return result;
  }

  void descend(int iterations) {
    constexpr double kLongestStep = 1.5, kSettled = 1e-6, kMostDamping = 1e8;
    double damping = 1e-2;
    MatrixXd slopes;
    VectorXd r = residuals(theta_, &slopes);
    double least = r.squaredNorm();
    for (int iteration = 0; iteration < iterations; ++iteration) {
      const MatrixXd normal = transposed_product(slopes, slopes), gradient = transposed_product(slopes, r);
      bool better = false, settled = false;
      for (; !better && damping < kMostDamping; damping *= better ? 1 : 10) {
        MatrixXd damped = normal;
        damped.diagonal() *= 1 + damping;
        const MatrixXd step = -solve_symmetric(damped, gradient);
        VectorXd next = theta_;
        for (Index f = 0; f < frees(); ++f) next[free_[at(f)]] += std::clamp(step(f, 0), -kLongestStep, kLongestStep);
        next[kLag] = std::max(next[kLag], 0.0);
        const double cost = residuals(next, nullptr).squaredNorm();
        if (!(cost < least)) continue;
        better = true;
        settled = least - cost < kSettled * least;
        theta_ = next;
        least = cost;
      }
      if (!better) return;
      r = residuals(theta_, &slopes);
      damping = std::max(0.1 * damping, 1e-9);
      if (settled) return;
    }
  }

  [[nodiscard]] MatrixXd normal() const {
    MatrixXd slopes;
    (void)residuals(theta_, &slopes);
    return transposed_product(slopes, slopes);
  }

  /// Returns -2 ln of the evidence. Parameters that every model has need no prior volume: it is the same for all.
  [[nodiscard]] double evidence() const {
    double result = residuals(theta_, nullptr).squaredNorm();
    for (const Vec3& sigma : sigma_)
      for (const int axis : axes_) result += 4 * std::log(sigma[axis]);
    result += log_determinant(normal());
    // The volume of the priors that all models share cancels.
    const auto shared = static_cast<Index>(2 * axes_.size() + pairs().size() + 1);
    if (const Index own = frees() - shared; own > 0) {
      MatrixXd prior = 1e-2 * MatrixXd::Identity(own, own);
      for (const Prior& one : priors_) {
        const VectorXd d = direction(one).tail(own);
        prior += d * d.transpose();
      }
      result -= log_determinant(prior);
    }
    return result;
  }

  const LineSpectrum& spectrum_;
  HandFitParts parts_;
  Vec3 mass_;
  double delay_;
  std::vector<Complex> held_;  ///< hold and whole delay at the lines
  std::vector<int> axes_;
  std::vector<Index> free_;  ///< parameters of this model; those of hand and link come last
  std::vector<Prior> priors_;
  VectorXd theta_;
  std::vector<Vec3> sigma_;
  double hand_force_ = kHandForce, model_error_ = kModelError, evidence_ = 0;
};

}  // namespace

HandFit fit_hand(const LineSpectrum& spectrum, const std::array<bool, 3>& axes, double rate_hz, int periods,
                 const Vec3& mass, HandFitParts parts) {
  constexpr std::array<std::array<double, 3>, 2> kHands{{{0.03, 300, 2}, {0.2, 1000, 5}}};
  constexpr std::array kLinks{30.0, 60.0};
  HandFit best;
  bool first = true;
  for (std::size_t hand = 0; hand < (parts.hand ? kHands.size() : 1); ++hand)
    for (std::size_t link = 0; link < (parts.link ? kLinks.size() : 1); ++link) {
      Fit fit(spectrum, axes, rate_hz, periods, mass, parts);
      fit.run(kHands[hand], kLinks[link]);
      if (!first && !(fit.evidence_found() < best.evidence)) continue;
      best = fit.result();
      first = false;
    }
  return best;
}

}  // namespace haptrace
