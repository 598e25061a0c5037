#include "control/design/identification.h"

#include "base/statistics.h"
#include "control/design/cogging_fit.h"
#include "control/design/dense.h"
#include "control/design/friction_axes.h"
#include "control/design/hand_fit.h"
#include "control/design/spectrum_estimator.h"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <complex>
#include <fmt/format.h>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

namespace haptrace {
namespace {

using Complex = std::complex<double>;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Model errors that the fit cannot see as noise: friction that changes sides under the excitation signal, and actuators
// that hardly move. Each is twice the standard deviation of the error over random simulated devices, as a fraction.
constexpr double kMassLeftOut = 0.04;
constexpr double kFrictionLeftOut = 0.1;
constexpr double kDelayLeftOut = 0.1e-3;  // [s]

// ------------------------------------------------------------------------------------------- the spectral lines

/// Fits the response at the spectral lines; see identify() for the model.
class MobilityFit {
 public:
  static constexpr double kLowestLine = 15 - 1e-6;  ///< above what a hand does of its own accord, and most grips [Hz]

  struct Result {
    Vec3 mass = Vec3::Zero(), mass_half = Vec3::Zero();
    double delay = 0, delay_half = 0;
    double residual = 0;
    Eigen::Matrix3d mobility = Eigen::Matrix3d::Zero();
  };

  MobilityFit(const LineSpectrum& spectrum, const std::array<bool, 3>& axes, double rate_hz) : period_(1 / rate_hz) {
    spectrum_.noise = spectrum.noise;
    for (const LineResponse& line : spectrum.lines)
      if (line.w >= kTwoPi * kLowestLine) spectrum_.lines.push_back(line);
    for (int axis = 0; axis < 3; ++axis)
      if (axes[static_cast<std::size_t>(axis)]) axes_.push_back(axis);
  }

  [[nodiscard]] Result run() const {
    Eigen::Vector2d best(0, kLag);
    double least = cost(best);
    for (double delay = 0; delay <= kLongestDelay + 8 * period_; delay += kDelayStep)
      if (const double c = cost({delay, kLag}); c < least) {
        least = c;
        best.x() = delay;
      }
    refine(best, least);
    return conclude(best);
  }

  /// Returns the number of whole periods with which the response fits best. The lag is free, from 0.
  [[nodiscard]] int whole_delay() const {
    constexpr int kMost = 10;
    int best = 0;
    double least = least_cost(0);
    for (int periods = 1; periods <= kMost; ++periods)
      if (const double c = least_cost(periods); c < least) {
        least = c;
        best = periods;
      }
    return best;
  }

 private:
  static constexpr int kPowers = 4;               // powers of 1 / s that model the hand and the mechanism
  static constexpr double kModelError = 0.02;     // assumed model error as a fraction of the response
  static constexpr double kLag = 0.5e-3;          // expected lag of an actuator and its amplifier [s]
  static constexpr double kLagSpread = 0.3e-3;    // [s]
  static constexpr double kLongestLag = 3e-3;     // with a whole delay [s]
  static constexpr double kLongestDelay = 10e-3;  // [s]
  static constexpr double kDelayStep = 0.1e-3;    // [s]
  static constexpr double kScale = kTwoPi * 50;   // frequency scale that conditions the least squares [rad/s]

  [[nodiscard]] Eigen::Index axes() const { return static_cast<Eigen::Index>(axes_.size()); }
  [[nodiscard]] Eigen::Index columns() const { return axes() * (1 + kPowers); }
  [[nodiscard]] Eigen::Index rows() const { return 2 * static_cast<Eigen::Index>(spectrum_.lines.size()); }

  [[nodiscard]] double sigma(const LineResponse& line, int axis) const {
    return std::hypot(spectrum_.noise, kModelError * std::abs(line.position[axis]), 1e-12);
  }

  /// Computes the weighted regressors and the response of one axis. Each complex equation gives two real ones.
  void equations(const Eigen::Vector2d& theta, int axis, MatrixXd& regressors, VectorXd& response) const {
    regressors.resize(rows(), columns());
    response.resize(rows());
    for (Eigen::Index l = 0; l < rows() / 2; ++l) {
      const LineResponse& line = spectrum_.lines[static_cast<std::size_t>(l)];
      const double weight = 1 / sigma(line, axis);
      const double half = 0.5 * line.w * period_;
      const Complex held =
          std::polar(std::sin(half) / half, -half - line.w * theta.x()) / Complex(1, line.w * theta.y());
      const auto put = [&](Eigen::Index column, Complex value) {
        regressors(2 * l, column) = weight * value.real();
        regressors(2 * l + 1, column) = weight * value.imag();
      };
      for (Eigen::Index i = 0; i < axes(); ++i) {
        const int other = axes_[static_cast<std::size_t>(i)];
        put(i, -held * line.force[other] / (line.w * line.w));
        Complex power = 1;
        for (Eigen::Index p = 1; p <= kPowers; ++p) {
          power /= Complex(0, line.w / kScale);
          put(p * axes() + i, line.position[other] * power);
        }
      }
      response[2 * l] = weight * line.position[axis].real();
      response[2 * l + 1] = weight * line.position[axis].imag();
    }
  }

  /// Returns the residuals of every axis with the best mobility for this delay and lag. The last entry is the deviation
  /// from the expected lag.
  [[nodiscard]] VectorXd residuals(const Eigen::Vector2d& theta) const {
    VectorXd all(axes() * rows() + 1);
    MatrixXd regressors;
    VectorXd response;
    for (Eigen::Index i = 0; i < axes(); ++i) {
      equations(theta, axes_[static_cast<std::size_t>(i)], regressors, response);
      all.segment(i * rows(), rows()) = least_squares_rest(regressors, response);
    }
    all[all.size() - 1] = (theta.y() - kLag) / kLagSpread;
    return all;
  }

  [[nodiscard]] double cost(const Eigen::Vector2d& theta) const { return residuals(theta).squaredNorm(); }

  /// Returns the least cost over all lags for a whole delay, by golden section. Expects nothing of the lag.
  [[nodiscard]] double least_cost(int periods) const {
    constexpr double kGolden = 0.6180339887, kFine = 1e-6;  // [s]
    const auto at = [&](double lag) {
      const VectorXd r = residuals({periods * period_, lag});
      return r.head(r.size() - 1).squaredNorm();
    };
    double low = 0, high = kLongestLag;
    double left = high - kGolden * high, right = kGolden * high;
    double at_left = at(left), at_right = at(right);
    while (high - low > kFine) {
      if (at_left < at_right) {
        high = std::exchange(right, left);
        at_right = at_left;
        left = high - kGolden * (high - low);
        at_left = at(left);
      } else {
        low = std::exchange(left, right);
        at_left = at_right;
        right = low + kGolden * (high - low);
        at_right = at(right);
      }
    }
    return std::min({at_left, at_right, at(0)});
  }

  /// Returns d residual / d delay and d residual / d lag as columns.
  [[nodiscard]] MatrixXd slopes(const Eigen::Vector2d& theta) const {
    constexpr double kStep = 1e-6;  // [s]
    MatrixXd result(axes() * rows() + 1, 2);
    for (int i = 0; i < 2; ++i) {
      Eigen::Vector2d more = theta, less = theta;
      more[i] += kStep;
      less[i] -= kStep;
      result.col(i) = (residuals(more) - residuals(less)) / (2 * kStep);
    }
    return result;
  }

  void refine(Eigen::Vector2d& theta, double least) const {
    double damping = 1e-3;
    for (int iteration = 0; iteration < 30 && damping < 1e6; ++iteration) {
      const VectorXd r = residuals(theta);
      const MatrixXd j = slopes(theta);
      MatrixXd normal = transposed_product(j, j);
      normal.diagonal() *= 1 + damping;
      Eigen::Vector2d next = theta - solve_symmetric(normal, transposed_product(j, r));
      next.y() = std::clamp(next.y(), 0.0, 5 * kLag);
      const double c = cost(next);
      if (c < least) {
        const bool settled = least - c < 1e-9 * least;
        theta = next;
        least = c;
        damping *= 0.1;
        if (settled) return;
      } else {
        damping *= 10;
      }
    }
  }

  [[nodiscard]] Result conclude(const Eigen::Vector2d& theta) const {
    Result result;
    const VectorXd r = residuals(theta);
    const double dof = static_cast<double>(r.size() - axes() * columns() - 2);
    const double variance = std::max(dof > 0 ? r.squaredNorm() / dof : 1.0, 1e-12);
    const MatrixXd j = slopes(theta);
    const Eigen::Matrix2d spread = variance * Eigen::Matrix2d(transposed_product(j, j)).inverse();
    result.delay = std::max(theta.sum(), 0.0);
    result.delay_half = std::hypot(kInterval95 * std::sqrt(std::max(spread.sum(), 0.0)), kDelayLeftOut);

    MatrixXd regressors;
    VectorXd response;
    double unexplained = 0, seen = 0;
    for (Eigen::Index i = 0; i < axes(); ++i) {
      const int axis = axes_[static_cast<std::size_t>(i)];
      const auto solve = [&](const Eigen::Vector2d& at) -> VectorXd {
        equations(at, axis, regressors, response);
        return least_squares(regressors, response);
      };
      // Sensitivity of the mobility to delay and lag. It carries their uncertainty into the interval of the mass.
      Eigen::Vector2d leaning;
      constexpr double kStep = 1e-6;
      for (int t = 0; t < 2; ++t)
        leaning[t] = (solve(theta + kStep * Eigen::Vector2d::Unit(t))[i] - solve(theta)[i]) / kStep;
      const VectorXd solution = solve(theta);
      const MatrixXd covariance =
          solve_symmetric(transposed_product(regressors, regressors), MatrixXd::Identity(columns(), columns()));
      const double mobility = solution[i];
      const double deviation = std::sqrt(variance * covariance(i, i) + leaning.dot(spread * leaning));
      for (Eigen::Index k = 0; k < axes(); ++k) result.mobility(axis, axes_[static_cast<std::size_t>(k)]) = solution[k];
      result.mass[axis] = mobility > 0 ? 1 / mobility : 0;
      result.mass_half[axis] =
          mobility > 0 ? std::hypot(kInterval95 * deviation / mobility, kMassLeftOut) / mobility : 0;
      const VectorXd rest = response - product(regressors, solution);
      for (std::size_t l = 0; l < spectrum_.lines.size(); ++l) {
        const LineResponse& line = spectrum_.lines[l];
        const double scale = line.w * sigma(line, axis);
        unexplained += scale * scale * rest.segment<2>(2 * static_cast<Eigen::Index>(l)).squaredNorm();
        seen += line.w * line.w * std::norm(line.position[axis]);
      }
    }
    result.residual = seen > 0 ? std::sqrt(unexplained / seen) : 1;
    return result;
  }

  LineSpectrum spectrum_;
  double period_;
  std::vector<int> axes_;
};

// --------------------------------------------------------------------------------------------------- the sweeps

constexpr double kKernel = 8e-3;      // standard deviation of the Gaussian kernel [s]
constexpr double kKernelReach = 4;    // standard deviations
constexpr double kKernelStep = 4e-3;  // between filtered rows [s]
constexpr int kColumns = 7;
/// Regressors of the force of a sweep. Beside friction they are linear in the movement, with powers of frequency from
/// -1 to 4. Jerk and snap model a hand that swings on its grip.
enum Column { kSign, kSpeed, kAcceleration, kPlace, kIntegral, kJerk, kSnap };

/// One axis of a stretch after the Gaussian kernel.
struct Filtered {
  double time = 0, x = 0, v = 0, a = 0, jerk = 0, snap = 0, u = 0;
};

/// Filters position, its derivatives and the delayed force with the same Gaussian. Skips instants with missed ticks
/// within the reach of the kernel.
std::vector<Filtered> filter(std::span<const TickRow> rows, int axis, double delay, double period) {
  std::vector<Filtered> result;
  if (rows.empty()) return result;
  const double reach = kKernelReach * kKernel;
  const double until = rows.back().time - reach - delay - period;
  std::size_t first = 0;
  for (double t = rows.front().time + reach + delay + period; t < until; t += kKernelStep) {
    while (rows[first].time < t - reach - delay - period) ++first;
    Filtered row{.time = t};
    double ones = 0, forces = 0;
    bool whole = true;
    const double origin = rows[first].position[axis];
    for (std::size_t k = first; k < rows.size() && rows[k].time <= t + reach; ++k) {
      const double gap = k + 1 < rows.size() ? rows[k + 1].time - rows[k].time : period;
      whole = whole && gap < 1.5 * period;
      const double s = (t - rows[k].time) / kKernel, g = std::exp(-0.5 * s * s);
      const double x = rows[k].position[axis] - origin;
      ones += g;
      row.x += g * x;
      row.v += -s / kKernel * g * x;
      row.a += (s * s - 1) / (kKernel * kKernel) * g * x;
      row.jerk += -s * (s * s - 3) / std::pow(kKernel, 3) * g * x;
      row.snap += (s * s * (s * s - 6) + 3) / std::pow(kKernel, 4) * g * x;
      const double su = (t - rows[k].time - 0.5 * period - delay) / kKernel, gu = std::exp(-0.5 * su * su);
      forces += gu;
      row.u += gu * rows[k].force[axis];
    }
    if (!whole || ones == 0 || forces == 0) continue;
    row.x = row.x / ones + origin;
    row.v /= ones;
    row.a /= ones;
    row.jerk /= ones;
    row.snap /= ones;
    row.u /= forces;
    result.push_back(row);
  }
  return result;
}

/// Normal equations. Blocks of rows can be subtracted again, as the jackknife needs.
template <int columns>
struct NormalEquations {
  using Square = Eigen::Matrix<double, columns, columns>;
  using Column = Eigen::Matrix<double, columns, 1>;
  Square g = Square::Zero();
  Column h = Column::Zero();

  [[nodiscard]] Column solve() const {
    Column scale;
    for (int i = 0; i < columns; ++i) scale[i] = g(i, i) > 0 ? 1 / std::sqrt(g(i, i)) : 0;
    MatrixXd scaled(columns, columns);
    for (int i = 0; i < columns; ++i)
      for (int k = 0; k < columns; ++k) scaled(i, k) = scale[i] * g(i, k) * scale[k] + (i == k ? 1e-9 : 0);
    const Column solution = solve_symmetric(scaled, scale.cwiseProduct(h));
    return scale.cwiseProduct(solution);
  }
};
using Normal = NormalEquations<kColumns>;

struct SweepFit {
  double coulomb = 0, viscous = 0, gravity = 0, gradient = 0;
  double coulomb_half = 0, viscous_half = 0, gravity_half = 0, gradient_half = 0;
  double residual = 0;     ///< [N]
  double unexplained = 1;  ///< rms fraction of the force
  std::size_t blocks = 0;  ///< number of blocks in the jackknife
};

/// Returns the residual of the force, the last column, after a fit of the first kColumns columns.
VectorXd rest_of(const MatrixXd& columns, const Normal::Column& beta) {
  Eigen::Matrix<double, kColumns + 1, 1> weights;
  weights << -beta, 1;
  return product(columns, weights);
}

/// Returns component `index` of a drift, a cosine series, after a share of the stretch.
double drift_at(double share, Eigen::Index index) {
  return std::cos(std::numbers::pi * static_cast<double>(index) * share);
}

/// The samples of a stretch that slide and did not just start to slide.
struct Sliding {
  std::vector<std::size_t> rows;  ///< indices of the filtered rows; empty if they are too few
  MatrixXd columns;               ///< kColumns regressors and the force of every such row
  MatrixXd drift;                 ///< regressors of a drift slower than a sweep
  Eigen::Index cycles = 1;        ///< number of whole cycles
};

Sliding sliding(const std::vector<Filtered>& rows) {
  Sliding result;
  if (rows.size() < 50) return result;
  double fastest = 0;
  int reversals = 0;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    fastest = std::max(fastest, std::abs(rows[k].v));
    if (k > 0 && rows[k].v * rows[k - 1].v < 0) ++reversals;
  }
  const double duration = rows.back().time - rows.front().time;
  result.cycles = std::max<Eigen::Index>(reversals / 2, 1);

  constexpr std::size_t kAround = 5;
  std::vector<double> integral(rows.size(), 0.0);
  double mean = 0;
  for (const Filtered& row : rows) mean += row.x / static_cast<double>(rows.size());
  for (std::size_t k = 1; k < rows.size(); ++k)
    integral[k] = integral[k - 1] + (rows[k].x - mean) * (rows[k].time - rows[k - 1].time);
  // A force that follows the integral, as that of an arm that yields, has no mean over whole cycles. It would otherwise
  // count as gravity.
  double offset = 0;
  for (const double value : integral) offset += value / static_cast<double>(rows.size());
  for (double& value : integral) value -= offset;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    if (k < kAround || k + kAround >= rows.size()) continue;
    const auto slides = [&](const Filtered& row) {
      return std::abs(row.v) > std::max(0.15 * fastest, 0.01) && row.v * rows[k].v > 0;
    };
    if (slides(rows[k]) && slides(rows[k - kAround]) && slides(rows[k + kAround])) result.rows.push_back(k);
  }
  if (result.rows.size() < 30) {
    result.rows.clear();
    return result;
  }

  const auto n = static_cast<Eigen::Index>(result.rows.size());
  result.columns.resize(n, kColumns + 1);
  result.drift.resize(n, 1 + result.cycles);
  for (Eigen::Index i = 0; i < n; ++i) {
    const std::size_t k = result.rows[static_cast<std::size_t>(i)];
    const Filtered& row = rows[k];
    const double values[] = {row.v > 0 ? 1.0 : -1.0, row.v, row.a, row.x, integral[k], row.jerk, row.snap, row.u};
    for (int c = 0; c <= kColumns; ++c) result.columns(i, c) = values[c];
    const double s = (row.time - rows.front().time) / duration;
    for (Eigen::Index d = 0; d < result.drift.cols(); ++d) result.drift(i, d) = drift_at(s, d);
  }
  return result;
}

/// The sliding parts of an axis' sweeps, and their cycles.
struct SweptCycles {
  std::vector<Sliding> parts;
  std::vector<MatrixXd> blocks;  ///< kColumns regressors and the force of each cycle, without the drift
};

SweptCycles swept_cycles(const Experiment& experiment, int axis, double delay) {
  SweptCycles result;
  for (const Stretch& stretch : experiment.sweeps[static_cast<std::size_t>(axis)]) {
    Sliding part = sliding(filter(experiment.rows.subspan(stretch.begin, stretch.end - stretch.begin), axis, delay,
                                  1 / experiment.rate_hz));
    if (part.rows.empty()) continue;
    const MatrixXd without = least_squares_rest(part.drift, part.columns);
    const auto n = static_cast<Eigen::Index>(part.rows.size());
    for (Eigen::Index p = 0; p < part.cycles; ++p) {
      const Eigen::Index begin = n * p / part.cycles, end = n * (p + 1) / part.cycles;
      // A device that hardly slides leaves cycles without a row.
      if (end > begin) result.blocks.emplace_back(without.middleRows(begin, end - begin));
    }
    result.parts.push_back(std::move(part));
  }
  return result;
}

using Weights = Normal::Column;

/// Fits all cycles, with intervals from the fits without each of them (jackknife). Returns the weights of the columns.
Weights fit_cycles(const std::vector<MatrixXd>& blocks, SweepFit& fit) {
  Normal all;
  std::vector<Normal> own(blocks.size());
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    const MatrixXd all_products = transposed_product(blocks[b], blocks[b]);
    own[b].g = all_products.topLeftCorner<kColumns, kColumns>();
    own[b].h = all_products.topRightCorner<kColumns, 1>();
    all.g += own[b].g;
    all.h += own[b].h;
  }
  Weights beta = all.solve();
  Weights variance = Weights::Zero();
  const auto count = static_cast<double>(blocks.size());
  double squares = 0, forces = 0, rows = 0;
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    Normal others = all;
    others.g -= own[b].g;
    others.h -= own[b].h;
    variance += (others.solve() - beta).cwiseAbs2() * (count - 1) / count;
    squares += rest_of(blocks[b], beta).squaredNorm();
    forces += blocks[b].col(kColumns).squaredNorm();
    rows += static_cast<double>(blocks[b].rows());
  }
  const Weights half = kInterval95 * variance.cwiseSqrt();
  fit.residual = std::sqrt(squares / rows);
  fit.unexplained = forces > 0 ? std::sqrt(squares / forces) : 1;
  fit.coulomb = std::max(beta[kSign], 0.0);
  fit.coulomb_half = std::hypot(half[kSign], kFrictionLeftOut * fit.coulomb);
  fit.viscous = std::max(beta[kSpeed], 0.0);
  fit.viscous_half = half[kSpeed];
  fit.gradient = -beta[kPlace];
  fit.gradient_half = half[kPlace];
  return beta;
}

/// Finds gravity: the mean force that the drift terms removed, averaged over the stretches.
void fit_gravity(const std::vector<Sliding>& parts, const Weights& beta, SweepFit& fit) {
  double sum = 0, sum_of_squares = 0;
  for (const Sliding& part : parts) {
    const double mean = least_squares(part.drift, rest_of(part.columns, beta))(0, 0);
    sum += mean;
    sum_of_squares += mean * mean;
  }
  const auto stretches = static_cast<double>(parts.size());
  fit.gravity = -sum / stretches;
  fit.gravity_half =
      stretches > 1 ? kInterval95 * std::sqrt(std::max(0.0, sum_of_squares / stretches - fit.gravity * fit.gravity) /
                                              (stretches - 1))
                    : fit.residual;
}

SweepFit fit_sweeps(const Experiment& experiment, int axis, double delay) {
  const SweptCycles swept = swept_cycles(experiment, axis, delay);
  SweepFit fit;
  fit.blocks = swept.blocks.size();
  if (swept.blocks.size() < 2) return fit;
  const Weights beta = fit_cycles(swept.blocks, fit);
  fit_gravity(swept.parts, beta, fit);
  // Regressors that hardly differ can get huge weights of opposite signs.
  double most = 0;
  for (const MatrixXd& block : swept.blocks) most = std::max(most, block.col(kColumns).cwiseAbs().maxCoeff());
  for (const Sliding& part : swept.parts) most = std::max(most, part.columns.col(kColumns).cwiseAbs().maxCoeff());
  for (const Sliding& part : swept.parts) {
    const double place = part.columns.col(kPlace).mean(), gravity = fit.gravity + fit.gradient * place;
    if (!(fit.coulomb <= most && std::abs(gravity) <= most)) return {};  // the motors held it
  }
  return fit;
}

// ----------------------------------------------------------------------------------------- the actuators' axes

std::array<std::vector<Filtered>, 3> filter(const Experiment& experiment, const Stretch& stretch, double delay) {
  std::array<std::vector<Filtered>, 3> result;
  for (std::size_t axis = 0; axis < 3; ++axis)
    result[axis] = filter(experiment.rows.subspan(stretch.begin, stretch.end - stretch.begin), static_cast<int>(axis),
                          delay, 1 / experiment.rate_hz);
  return result;
}

constexpr std::size_t kEvery = 2;          // of the filtered rows, which overlap
constexpr Eigen::Index kBlocksOfAxes = 4;  // most blocks of a stretch in the jackknife of the axes

/// `rows`: indices of filtered rows. `others`: number of regressors.
SlidingRows sliding_rows(const std::array<std::vector<Filtered>, 3>& filtered, const std::vector<std::size_t>& rows,
                         Eigen::Index others, Eigen::Index blocks) {
  const auto n = static_cast<Eigen::Index>(rows.size());
  SlidingRows result{
      .velocity = MatrixXd(n, 3), .force = MatrixXd(n, 3), .others = MatrixXd(n, others), .used = {}, .blocks = {}};
  for (Eigen::Index p = 0; p < blocks; ++p) result.blocks.push_back(n * p / blocks);
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      const Filtered& own = filtered[static_cast<std::size_t>(axis)][rows[static_cast<std::size_t>(i)]];
      result.velocity(i, axis) = own.v;
      result.force(i, axis) = own.u;
    }
  return result;
}

/// Returns the sliding part of a sweep along `axis`; nothing if it is too short. The force across the sweep has fewer
/// regressors: a hand hardly pushes across, and each of them could stand for friction. The position across is none of
/// them, since the force across follows from it by the law that holds the device.
std::optional<SlidingRows> swept(const Experiment& experiment, const Stretch& stretch, std::size_t axis, double delay) {
  const std::array<std::vector<Filtered>, 3> filtered = filter(experiment, stretch, delay);
  const Sliding part = sliding(filtered[axis]);
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < part.rows.size(); i += kEvery) rows.push_back(part.rows[i]);
  if (rows.empty()) return std::nullopt;
  // Columns: those of the sweep but the sign, the acceleration of each axis, the drift.
  constexpr Eigen::Index kSweep = kColumns - kSpeed, kLinear = kSweep + 3;
  const Eigen::Index drifts = part.drift.cols();
  SlidingRows result = sliding_rows(filtered, rows, kLinear + drifts, std::min(part.cycles, kBlocksOfAxes));
  for (Eigen::Index i = 0; i < result.others.rows(); ++i) {
    const auto whole = static_cast<Eigen::Index>(kEvery) * i;
    for (Eigen::Index c = 0; c < kSweep; ++c) result.others(i, c) = part.columns(whole, kSpeed + c);
    for (Eigen::Index k = 0; k < 3; ++k)
      result.others(i, kSweep + k) = filtered[static_cast<std::size_t>(k)][rows[static_cast<std::size_t>(i)]].a;
    for (Eigen::Index d = 0; d < drifts; ++d) result.others(i, kLinear + d) = part.drift(whole, d);
  }
  for (std::size_t k = 0; k < 3; ++k) {
    std::vector<Eigen::Index>& used = result.used[k];
    if (k == axis)
      for (Eigen::Index c = 0; c < kSweep; ++c) used.push_back(c);
    else
      used = {kAcceleration - kSpeed, kPlace - kSpeed, kSweep + static_cast<Eigen::Index>(k)};
    for (Eigen::Index d = 0; d < drifts; ++d) used.push_back(kLinear + d);
  }
  return result;
}

/// Returns a stretch with excitation. The device slides along a path in all directions; without it, friction along
/// axes that are turned little looks like that along others that are turned much, since what sticks across a sweep
/// hides the small angle.
std::optional<SlidingRows> swung(const Experiment& experiment, const Stretch& stretch, double delay) {
  constexpr double kDrift = 0.5;  // highest frequency of the drift [Hz]
  constexpr Eigen::Index kLinear = 9;
  const std::array<std::vector<Filtered>, 3> filtered = filter(experiment, stretch, delay);
  if (filtered[0].size() < 50) return std::nullopt;
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < filtered[0].size(); i += kEvery) rows.push_back(i);
  const double begin = filtered[0].front().time, duration = filtered[0].back().time - begin;
  const auto drifts = static_cast<Eigen::Index>(1 + std::floor(2 * kDrift * duration));
  SlidingRows result = sliding_rows(filtered, rows, kLinear + drifts, kBlocksOfAxes);
  for (Eigen::Index i = 0; i < result.others.rows(); ++i) {
    const std::size_t row = rows[static_cast<std::size_t>(i)];
    for (Eigen::Index k = 0; k < 3; ++k) {
      const Filtered& own = filtered[static_cast<std::size_t>(k)][row];
      result.others(i, k) = own.v;
      result.others(i, k + 3) = own.a;
      result.others(i, k + 6) = own.x;
    }
    const double s = (filtered[0][row].time - begin) / duration;
    for (Eigen::Index d = 0; d < drifts; ++d) result.others(i, kLinear + d) = drift_at(s, d);
  }
  for (std::vector<Eigen::Index>& used : result.used)
    for (Eigen::Index c = 0; c < result.others.cols(); ++c) used.push_back(c);
  return result;
}

/// Finds the actuators' axes of a device with motors along all axes, from its sweeps and its swing.
std::optional<ActuatorFriction> find_actuators(const Experiment& experiment, double delay) {
  if (experiment.axes != std::array{true, true, true}) return std::nullopt;
  std::vector<SlidingRows> stretches;
  const auto add = [&](std::optional<SlidingRows> rows) {
    if (rows) stretches.push_back(std::move(*rows));
  };
  for (const Stretch& stretch : experiment.dithered) add(swung(experiment, stretch, delay));
  if (stretches.empty()) return std::nullopt;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t before = stretches.size();
    for (const Stretch& stretch : experiment.sweeps[axis]) add(swept(experiment, stretch, axis, delay));
    if (stretches.size() == before) return std::nullopt;
  }
  return find_friction_axes(stretches);
}

// --------------------------------------------------------------------------------------------- the coarse model

/// Fits all movement along the axes at low frequencies; see identify_coarsely().
class CoarseFit {
 public:
  struct Result {
    Vec3 mass = Vec3::Zero(), mass_half = Vec3::Zero();
    Vec3 coulomb = Vec3::Zero(), coulomb_half = Vec3::Zero();
    double delay = 0, delay_half = 0;
    double residual = 1;  ///< unexplained fraction of the force, rms
  };

  explicit CoarseFit(const Experiment& experiment) : period_(1 / experiment.rate_hz) {
    for (double delay = 0; delay <= kLongestDelay; delay += kDelayStep) late_.push_back({delay, {}});
    for (Late& late : late_)
      for (int axis = 0; axis < 3; ++axis)
        if (experiment.axes[static_cast<std::size_t>(axis)])
          late.blocks[static_cast<std::size_t>(axis)] = blocks(experiment, axis, late.delay);
  }

  [[nodiscard]] Result run() const {
    Result result;
    result.delay = delay(kNone);
    const Late& best = *std::min_element(late_.begin(), late_.end(), [&](const Late& a, const Late& b) {
      return std::abs(a.delay - result.delay) < std::abs(b.delay - result.delay);
    });
    std::size_t most = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::vector<Block>& own = best.blocks[axis];
      if (own.size() < 2) continue;
      const Beta beta = sum(own, kNone).normal.solve();
      Beta variance = Beta::Zero();
      const auto count = static_cast<double>(own.size());
      for (std::size_t left = 0; left < own.size(); ++left)
        variance += (sum(own, left).normal.solve() - beta).cwiseAbs2() * (count - 1) / count;
      const Beta half = kInterval95 * variance.cwiseSqrt();
      const auto i = static_cast<Eigen::Index>(axis);
      result.mass[i] = std::max(beta[kAcceleration], 0.0);
      result.mass_half[i] = std::hypot(half[kAcceleration], kCoarseMassLeftOut * result.mass[i]);
      result.coulomb[i] = std::max(beta[kSign], 0.0);
      result.coulomb_half[i] = std::hypot(half[kSign], kFrictionLeftOut * result.coulomb[i]);
      most = std::max(most, own.size());
    }
    double variance = 0;
    for (std::size_t left = 0; left < most; ++left)
      variance += std::pow(delay(left) - result.delay, 2) * static_cast<double>(most - 1) / static_cast<double>(most);
    result.delay_half = std::hypot(kInterval95 * std::sqrt(variance), 0.5 * kDelayStep);
    result.residual = std::sqrt(unexplained(best, kNone));
    return result;
  }

 private:
  /// After kSign to kPlace come harmonics of the position, with periods of kPlacePeriod and below. They model forces
  /// that depend on position.
  static constexpr int kHarmonics = 5, kOwn = kPlace + 1, kAll = kOwn + 2 * kHarmonics;
  static constexpr double kPlacePeriod = 0.05;  // [m]
  using Beta = NormalEquations<kAll>::Column;
  struct Block {
    NormalEquations<kAll> normal;
    double force = 0;  ///< sum of squares [N^2]
  };
  struct Late {
    double delay = 0;  ///< [s]
    std::array<std::vector<Block>, 3> blocks;
  };

  static constexpr double kLongestDelay = 20e-3;      // [s]
  static constexpr double kDelayStep = 1e-3;          // [s]
  static constexpr double kBlock = 0.33;              // [s]
  static constexpr double kCoarseMassLeftOut = 0.15;  // fraction of the mass; backlash may hide or add that of a handle
  static constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();

  [[nodiscard]] std::vector<Block> blocks(const Experiment& experiment, int axis, double delay) const {
    std::vector<Block> result;
    const auto add = [&](const Stretch& stretch) {
      const std::vector<Filtered> rows =
          filter(experiment.rows.subspan(stretch.begin, stretch.end - stretch.begin), axis, delay, period_);
      const auto n = static_cast<Eigen::Index>(rows.size());
      const auto pieces =
          static_cast<Eigen::Index>(std::max(1.0, std::round(static_cast<double>(n) * kKernelStep / kBlock)));
      if (n < 50) return;
      MatrixXd columns = MatrixXd::Zero(n, kAll + 1);
      for (Eigen::Index i = 0; i < n; ++i) {
        const Filtered& row = rows[static_cast<std::size_t>(i)];
        columns(i, kSign) = std::tanh(row.v / kSlides);
        columns(i, kSpeed) = row.v;
        columns(i, kAcceleration) = row.a;
        columns(i, kPlace) = row.x;
        for (int h = 0; h < kHarmonics; ++h) {
          const double angle = kTwoPi * (h + 1) * row.x / kPlacePeriod;
          columns(i, kOwn + 2 * h) = std::cos(angle);
          columns(i, kOwn + 2 * h + 1) = std::sin(angle);
        }
        columns(i, kAll) = row.u;
      }
      for (Eigen::Index column = 0; column <= kAll; ++column)  // removes the offset
        columns.col(column).array() -= columns.col(column).mean();
      for (Eigen::Index piece = 0; piece < pieces; ++piece) {
        const Eigen::Index begin = n * piece / pieces, end = n * (piece + 1) / pieces;
        const MatrixXd part = columns.middleRows(begin, end - begin), all = transposed_product(part, part);
        result.push_back({.normal = {.g = all.topLeftCorner<kAll, kAll>(), .h = all.topRightCorner<kAll, 1>()},
                          .force = all(kAll, kAll)});
      }
    };
    for (const Stretch& stretch : experiment.dithered) add(stretch);
    for (const Stretch& stretch : experiment.sweeps[static_cast<std::size_t>(axis)]) add(stretch);
    return result;
  }

  static Block sum(const std::vector<Block>& blocks, std::size_t without) {
    Block all;
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      if (b == without) continue;
      all.normal.g += blocks[b].normal.g;
      all.normal.h += blocks[b].normal.h;
      all.force += blocks[b].force;
    }
    return all;
  }

  /// Returns the unexplained fraction of the squared force, averaged over the axes.
  [[nodiscard]] static double unexplained(const Late& late, std::size_t without) {
    double shares = 0, axes = 0;
    for (const std::vector<Block>& own : late.blocks) {
      if (own.size() < 2) continue;
      const Block all = sum(own, without);
      if (all.force > 0) shares += std::max(1 - all.normal.solve().dot(all.normal.h) / all.force, 0.0);
      ++axes;
    }
    return axes > 0 ? shares / axes : 1;
  }

  /// Returns the delay with the smallest unexplained fraction, from the parabola through the best three values [s].
  [[nodiscard]] double delay(std::size_t without) const {
    std::vector<double> shares;
    for (const Late& late : late_) shares.push_back(unexplained(late, without));
    const auto best = static_cast<std::size_t>(std::min_element(shares.begin(), shares.end()) - shares.begin());
    if (best == 0 || best + 1 == shares.size()) return late_[best].delay;
    const double before = shares[best - 1], after = shares[best + 1];
    const double curvature = before - 2 * shares[best] + after;
    return late_[best].delay + (curvature > 0 ? 0.5 * (before - after) / curvature * kDelayStep : 0);
  }

  static constexpr double kSlides = 0.01;  // [m/s]
  double period_;
  std::vector<Late> late_;
};

/// Returns the rms of the white noise in the positions per axis, without the share of the encoder resolution [m]. A
/// third difference has 20 times the variance of white noise and contains almost no movement.
double white_noise(std::span<const TickRow> rows, const std::array<bool, 3>& axes, double quantum) {
  std::vector<double> squares;
  for (std::size_t k = 3; k < rows.size(); ++k) {
    const Vec3 d = rows[k].position - 3 * rows[k - 1].position + 3 * rows[k - 2].position - rows[k - 3].position;
    for (int axis = 0; axis < 3; ++axis)
      if (axes[static_cast<std::size_t>(axis)]) squares.push_back(d[axis] * d[axis] / 20);
  }
  if (squares.empty()) return 0;
  double sum = 0;
  for (const double s : squares) sum += s;
  const double beyond = sum / static_cast<double>(squares.size()) - quantum * quantum / 12;
  return std::sqrt(std::max(beyond, 0.0));
}

constexpr double kMostUnexplained = 0.5;      // limit of the unexplained fraction of a response or a force
constexpr double kLeastCertain = 0.35;        // largest half width of a mass interval, as a fraction of the mass
constexpr double kLeastCertainCoarse = 0.75;  // the same for a coarse model

constexpr double kClearEvidence = 10;         // 2 ln of a Bayes factor
constexpr double kOverwhelmingEvidence = 30;  // the same
constexpr int kMostPeriods = 6;               // longest whole delay of a device with a link

/// Returns the apparent mass of every axis at the lines from 70 Hz, the median [kg].
Vec3 mass_at_high_lines(const LineSpectrum& spectrum, const Multisine& dither) {
  constexpr double kFrom = 70;  // [Hz]
  Vec3 result = Vec3::Zero();
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> masses;
    for (const SpectralLine& own : dither.lines(axis))
      for (const LineResponse& line : spectrum.lines)
        if (own.frequency_hz >= std::min(kFrom, dither.lines(axis).back().frequency_hz) &&
            std::abs(line.w - kTwoPi * own.frequency_hz) < 1e-6)
          masses.push_back(std::abs(line.force[axis]) /
                           (line.w * line.w * std::max(std::abs(line.position[axis]), 1e-9)));
    if (masses.empty()) continue;
    std::sort(masses.begin(), masses.end());
    result[axis] = std::max(masses[masses.size() / 2], 1e-4);
  }
  return result;
}

/// Returns true when a force along an axis moves the device backwards at some line of the mass fit: below the resonance
/// of a hand or a link.
bool turns_round(const LineSpectrum& spectrum, const Multisine& dither, double delay) {
  for (int axis = 0; axis < 3; ++axis)
    for (const SpectralLine& own : dither.lines(axis))
      for (const LineResponse& line : spectrum.lines) {
        if (own.frequency_hz < MobilityFit::kLowestLine || std::abs(line.w - kTwoPi * own.frequency_hz) > 1e-6)
          continue;
        if ((-line.position[axis] * std::conj(line.force[axis]) * std::polar(1.0, line.w * delay)).real() < 0)
          return true;
      }
  return false;
}

/// Fits the models with and without hand at a whole delay, and those with a link if `links`. Keeps the best of each
/// choice: nobody, hand, link, link and hand.
void fit_held(const Experiment& experiment, const LineSpectrum& spectrum, int periods, bool links,
              std::array<std::optional<HandFit>, 4>& fits) {
  const Vec3 mass = mass_at_high_lines(spectrum, *experiment.dither);
  for (std::size_t choice = 0; choice < (links ? 4 : 2); ++choice) {
    const HandFit fit = fit_hand(spectrum, experiment.axes, experiment.rate_hz, periods, mass,
                                 {.hand = choice % 2 == 1, .link = choice >= 2});
    if (!fits[choice] || fit.evidence < fits[choice]->evidence) fits[choice] = fit;
  }
}

/// `responds`: the device responds like a mass, with a total delay of `delay` [s].
void take_held(const Experiment& experiment, const LineSpectrum& spectrum, bool responds, double delay,
               HeldIdentification& result) {
  const int periods = MobilityFit(spectrum, experiment.axes, experiment.rate_hz).whole_delay();
  std::array<std::optional<HandFit>, 4> fits;
  fit_held(experiment, spectrum, periods, false, fits);
  if (!responds)
    for (int other = 0; other <= kMostPeriods; ++other) fit_held(experiment, spectrum, other, true, fits);
  else if (turns_round(spectrum, *experiment.dither, delay))
    for (int other = std::max(periods - 1, 0); other <= periods; ++other)
      fit_held(experiment, spectrum, other, true, fits);
  // A device that swings on its link within the lines seems to be late.
  const auto explained = [](const auto& fit) { return fit && fit->residual < kMostUnexplained; };
  if (responds && std::ranges::none_of(fits, explained))
    for (int other = 0; other < std::min(periods - 1, kMostPeriods + 1); ++other)
      fit_held(experiment, spectrum, other, true, fits);
  // Each part needs evidence of its own.
  std::array<double, 4> cost{};
  for (std::size_t choice = 0; choice < 4; ++choice)
    cost[choice] = fits[choice] ? fits[choice]->evidence + (choice % 2 == 1 ? kClearEvidence : 0) +
                                      (choice >= 2 ? kOverwhelmingEvidence : 0)
                                : std::numeric_limits<double>::infinity();
  const auto best = static_cast<std::size_t>(std::min_element(cost.begin(), cost.end()) - cost.begin());
  if (!(fits[best]->residual < kMostUnexplained)) return;
  double other = std::numeric_limits<double>::infinity();
  for (std::size_t choice = 0; choice < 4; ++choice)
    if (choice != best && fits[choice]) other = std::min(other, fits[choice]->evidence);
  result.held = fits[best]->held;
  result.half_width = fits[best]->half_width;
  result.margin = other - fits[best]->evidence;
}

/// Returns the reason to doubt the result of an axis; empty when there is none.
std::string doubt_about(int axis, const Identification& found, const SweepFit& sweeps) {
  const char name = "xyz"[axis];
  const double mass = found.plant.mass[axis], half = found.half_width.mass[axis];
  if (!(mass > 0))
    return fmt::format(
        "the response in {} from 15 to 120 Hz is not that of a mass: the mechanism resonates or has backlash", name);
  if (!(half < kLeastCertain * mass))
    return fmt::format("the mass in {} is uncertain: {:.3f} +- {:.3f} kg", name, mass, half);
  if (sweeps.blocks < 2)
    return fmt::format("the device slid for too little of the sweeps in {}, or ticks were missed", name);
  if (sweeps.unexplained > kMostUnexplained)
    return fmt::format("the model does not explain {:.0f} % of the force of the sweeps in {}", 100 * sweeps.unexplained,
                       name);
  return "";
}

void take(const SweepFit& fit, int axis, Identification& result) {
  PlantModel &plant = result.plant, &half = result.half_width;
  plant.coulomb[axis] = fit.coulomb;
  plant.viscous[axis] = fit.viscous;
  plant.gravity[axis] = fit.gravity;
  plant.gravity_gradient(axis, axis) = fit.gradient;
  half.coulomb[axis] = fit.coulomb_half;
  half.viscous[axis] = fit.viscous_half;
  half.gravity[axis] = fit.gravity_half;
  half.gravity_gradient(axis, axis) = fit.gradient_half;
  result.sweep_residual = std::max(result.sweep_residual, fit.residual);
}

void take_noise(const Experiment& experiment, int axis, PlantModel& plant) {
  for (const Stretch& stretch : experiment.sweeps[static_cast<std::size_t>(axis)])
    plant.position_noise =
        std::max(plant.position_noise, white_noise(experiment.rows.subspan(stretch.begin, stretch.end - stretch.begin),
                                                   experiment.axes, plant.position_resolution));
}

}  // namespace

double position_quantum(std::span<const TickRow> rows) {
  std::vector<double> steps;
  for (std::size_t k = 1; k < rows.size(); ++k) {
    const double step = (rows[k].position - rows[k - 1].position).norm();
    if (step > 1e-9) steps.push_back(step);
  }
  if (steps.size() < 10) return 0;
  std::sort(steps.begin(), steps.end());
  // Steps on a lattice repeat to the last digits; continuous steps do not.
  constexpr double kSame = 1e-4;
  const auto again = static_cast<std::size_t>(
      std::upper_bound(steps.begin(), steps.end(), steps.front() * (1 + kSame)) - steps.begin());
  return again >= 5 ? steps[again / 2] : 0;
}

namespace {

Identification identify_slow_rows(const Experiment& experiment) {
  Identification result;
  result.coarse = true;
  PlantModel& plant = result.plant;
  plant.position_resolution = position_quantum(experiment.rows);
  const CoarseFit::Result fit = CoarseFit(experiment).run();
  plant.mass = fit.mass;
  plant.coulomb = fit.coulomb;
  plant.delay = fit.delay;
  result.half_width.mass = fit.mass_half;
  result.half_width.coulomb = fit.coulomb_half;
  result.half_width.delay = fit.delay_half;
  result.line_residual = fit.residual;
  for (int axis = 0; axis < 3; ++axis) {
    if (!experiment.axes[static_cast<std::size_t>(axis)]) continue;
    if (const SweepFit sweeps = fit_sweeps(experiment, axis, plant.delay);
        sweeps.blocks >= 2 && sweeps.unexplained <= kMostUnexplained)
      take(sweeps, axis, result);
    take_noise(experiment, axis, plant);
    const double mass = plant.mass[axis], half = result.half_width.mass[axis];
    if (result.reason.empty() && !(mass > 0 && half < kLeastCertainCoarse * mass))
      result.reason =
          fmt::format("not even a coarse model fits: the mass in {} is {:.3f} +- {:.3f} kg", "xyz"[axis], mass, half);
  }
  result.fits = result.reason.empty();
  return result;
}

}  // namespace

Identification identify_coarsely(const Experiment& experiment) {
  constexpr double kMostDelay = 2e-3;  // of an ordinary device; friction, backlash and cables seem to delay more [s]
  constexpr int kRounds = 4;
  // Backlash adds to the force that nothing explains, and so true waves explain less of it. On 48 random devices with
  // backlash, false waves explained at most 0.015. Two thirds of the true waves of 1 N explained more than 0.06.
  constexpr CoggingShares kRequired{.near = 0.02, .everywhere = 0.018};
  Identification result = identify_slow_rows(experiment);
  const double delay = std::min(result.plant.delay, kMostDelay);
  std::optional<Cogging> cogging = find_cogging(experiment, delay, kRequired);
  if (!cogging) return result;
  // Without the force of the cables, mass and delay are more accurate, and with the mass, that force is.
  Identification found;
  for (int round = 0; round < kRounds; ++round) {
    const std::vector<TickRow> rows = without_cogging(experiment, *cogging, delay);
    Experiment without = experiment;
    without.rows = rows;
    found = identify_slow_rows(without);
    if (!found.fits || found.line_residual > result.line_residual) return result;
    if (round + 1 < kRounds) refit_amplitudes(experiment, found.plant.mass.asDiagonal(), delay, *cogging);
  }
  found.plant.cogging = cogging;
  return found;
}

LineSpectrum spectrum_of(const Experiment& experiment) {
  const Multisine& dither = *experiment.dither;
  SpectrumEstimator estimator(dither.frequencies(), dither.period(), experiment.rate_hz);
  for (const Stretch& stretch : experiment.dithered)
    estimator.add(experiment.rows.subspan(stretch.begin, stretch.end - stretch.begin));
  return estimator.mean();
}

namespace {

/// Finds the force that repeats over the place. Its amplitudes follow from the mass, which in turn is more accurate
/// without this force. Returns nothing if there is no such force.
std::optional<Cogging> cogging_of(const Experiment& experiment, double delay) {
  constexpr int kRounds = 3;
  std::optional<Cogging> cogging = find_cogging(experiment, delay);
  for (int round = 0; cogging && round < kRounds; ++round) {
    const std::vector<TickRow> rows = without_cogging(experiment, *cogging, delay);
    Experiment without = experiment;
    without.rows = rows;
    const MobilityFit::Result lines = MobilityFit(spectrum_of(without), experiment.axes, experiment.rate_hz).run();
    const Eigen::Matrix3d mobility = 0.5 * (lines.mobility + lines.mobility.transpose());
    if (!(mobility.determinant() > 0 && lines.mass.minCoeff() > 0)) return std::nullopt;
    refit_amplitudes(experiment, mobility.inverse(), lines.delay, *cogging);
  }
  return cogging;
}

Identification identify_rows(const Experiment& experiment) {
  Identification result;
  PlantModel& plant = result.plant;
  plant.position_resolution = position_quantum(experiment.rows);

  if (experiment.dither != nullptr) {
    const LineSpectrum spectrum = spectrum_of(experiment);
    if (spectrum.lines.empty()) {
      result.reason = "no whole period of the dither was recorded without missing ticks";
      return result;
    }
    const MobilityFit::Result lines = MobilityFit(spectrum, experiment.axes, experiment.rate_hz).run();
    plant.mass = lines.mass;
    result.half_width.mass = lines.mass_half;
    plant.delay = lines.delay;
    result.half_width.delay = lines.delay_half;
    result.line_residual = lines.residual;
  }

  for (int axis = 0; axis < 3; ++axis) {
    if (!experiment.axes[static_cast<std::size_t>(axis)]) continue;
    const SweepFit fit = fit_sweeps(experiment, axis, plant.delay);
    take(fit, axis, result);
    if (result.reason.empty()) result.reason = doubt_about(axis, result, fit);
    take_noise(experiment, axis, plant);
  }
  if (result.reason.empty() && result.line_residual > kMostUnexplained)
    result.reason =
        fmt::format("the model does not explain {:.0f} % of the response to the dither", 100 * result.line_residual);
  result.fits = result.reason.empty();
  if (result.fits) plant.actuators = find_actuators(experiment, plant.delay);
  return result;
}

}  // namespace

Identification identify(const Experiment& experiment) {
  Identification result = identify_rows(experiment);
  if (experiment.dither == nullptr || !(result.plant.mass.maxCoeff() > 0)) return result;
  const std::optional<Cogging> cogging = cogging_of(experiment, result.plant.delay);
  if (!cogging) return result;
  const std::vector<TickRow> rows = without_cogging(experiment, *cogging, result.plant.delay);
  Experiment without = experiment;
  without.rows = rows;
  Identification found = identify_rows(without);
  // Without its force, a device responds more like a mass.
  if (!found.fits || found.line_residual > result.line_residual) return result;
  found.plant.cogging = cogging;
  return found;
}

HeldIdentification identify_held(const Experiment& experiment, const Identification& identified) {
  HeldIdentification result;
  if (experiment.dither == nullptr) return result;
  const LineSpectrum spectrum = spectrum_of(experiment);
  if (spectrum.lines.empty()) return result;
  bool responds = identified.line_residual <= kMostUnexplained;
  for (int axis = 0; axis < 3; ++axis)
    if (experiment.axes[static_cast<std::size_t>(axis)])
      responds = responds && identified.half_width.mass[axis] < kLeastCertain * identified.plant.mass[axis];
  take_held(experiment, spectrum, responds, identified.plant.delay, result);
  return result;
}

}  // namespace haptrace
