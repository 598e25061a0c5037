#include "control/design/saturation_identification.h"

#include "base/statistics.h"
#include "control/design/dense.h"
#include "control/norm.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <optional>
#include <span>

namespace haptrace {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kKernel = 3e-3;        // standard deviation of the Gaussian kernel [s]
constexpr double kReach = 5 * kKernel;  // [s]
constexpr double kStep = 2e-3;          // between filtered rows [s]
constexpr double kBlock = 0.1;          // of the jackknife [s]
constexpr double kLongestDelay = 8e-3;  // [s]
constexpr double kDelayStep = 0.5e-3;   // [s]
constexpr double kLeastLimit = 0.2;     // smallest limit that is looked for, as a share of what was tried
constexpr int kLimits = 33;             // number of limits that are compared; the last one is none
constexpr double kJudged = 20e-3;       // time for which a force must have been sent to count as tried [s]
constexpr double kClearly = 1.2;        // least ratio of the unexplained shares without and with a limit
constexpr double kBelow = 0.95;         // share of what was tried below which a limit's interval must end
constexpr double kMostUncertain = 0.2;  // largest half width of the interval, as a share of the limit: backlash and
                                        // links look like a limit that the data hardly determine
// Error of the limit beside its scatter, as a share: hands and friction that the model knows only roughly.
constexpr double kLimitLeftOut = 0.06;
constexpr int kDrifts = 4;                  // number of cosines that model a slow drift
constexpr std::array kSlides{5e-3, 30e-3};  // speeds at which friction has 76 % of its force [m/s]
constexpr int kColumns = 6 + static_cast<int>(kSlides.size()) + kDrifts;

/// The normal equations of a stretch of rows for every limit.
struct Block {
  MatrixXd g = MatrixXd::Zero(kColumns, kColumns);
  MatrixXd h = MatrixXd::Zero(kColumns, kLimits);
  VectorXd sum = VectorXd::Zero(kLimits), squares = VectorXd::Zero(kLimits);  ///< of the force
  double rows = 0;

  Block& operator+=(const Block& other) {
    g += other.g;
    h += other.h;
    sum += other.sum;
    squares += other.squares;
    rows += other.rows;
    return *this;
  }

  /// Returns the unexplained share of the force's variance, for every limit.
  [[nodiscard]] VectorXd unexplained() const {
    const VectorXd scale = g.diagonal().cwiseMax(1e-30).cwiseSqrt().cwiseInverse();
    MatrixXd scaled = scale.asDiagonal() * g * scale.asDiagonal();
    scaled.diagonal().array() += 1e-9;
    const MatrixXd right = scale.asDiagonal() * h;
    const MatrixXd solution = solve_symmetric(scaled, right);
    VectorXd shares(kLimits);
    for (Eigen::Index i = 0; i < kLimits; ++i) {
      const double variance = squares[i] - sum[i] * sum[i] / rows;
      shares[i] = variance > 0 ? std::max(squares[i] - right.col(i).dot(solution.col(i)), 0.0) / variance : 1;
    }
    return shares;
  }
};

/// The strokes under pulses along one axis, after the kernel.
class PulsedAxis {
 public:
  PulsedAxis(std::span<const TickRow> rows, int axis, double rate_hz) : rows_(rows), axis_(axis), period_(1 / rate_hz) {
    const double lead = kReach + kLongestDelay + period_;
    double integral = 0;
    std::size_t first = 0;
    for (double t = rows.front().time + lead; t < rows.back().time - kReach; t += kStep) {
      while (rows[first].time < t - lead) ++first;
      const std::optional<VectorXd> movement = smoothed(first, t);
      if (!movement) continue;
      instants_.push_back({first, t});
      columns_.conservativeResize(static_cast<Eigen::Index>(instants_.size()), kColumns);
      const double v = (*movement)[1], x = (*movement)[0];
      integral += x * kStep;
      auto row = columns_.row(columns_.rows() - 1);
      row.setZero();
      row.head<6>() << (*movement)[2], v, x, integral, (*movement)[3], 1;
      for (std::size_t i = 0; i < kSlides.size(); ++i)
        row[6 + static_cast<Eigen::Index>(i)] = std::tanh(v / kSlides[i]);
    }
    const auto n = static_cast<double>(instants_.size());
    for (Eigen::Index k = 0; k < columns_.rows(); ++k)
      for (Eigen::Index i = 0; i < kDrifts; ++i)
        columns_(k, kColumns - kDrifts + i) =
            std::cos(std::numbers::pi * static_cast<double>(i + 1) * static_cast<double>(k) / n);
  }

  /// Returns the blocks of the jackknife for a delay [s].
  [[nodiscard]] std::vector<Block> blocks(double delay, std::span<const double> limits) const {
    const auto n = static_cast<Eigen::Index>(instants_.size());
    MatrixXd force(n, kLimits);
    for (Eigen::Index k = 0; k < n; ++k)
      force.row(k) = smoothed_force(instants_[static_cast<std::size_t>(k)], delay, limits).transpose();
    const auto count =
        std::max<Eigen::Index>(1, static_cast<Eigen::Index>(std::lround(static_cast<double>(n) * kStep / kBlock)));
    std::vector<Block> result;
    for (Eigen::Index b = 0; b < count; ++b) {
      const Eigen::Index begin = n * b / count, rows = n * (b + 1) / count - begin;
      const MatrixXd own = columns_.middleRows(begin, rows), sent = force.middleRows(begin, rows);
      Block block;
      block.g = transposed_product(own, own);
      block.h = transposed_product(own, sent);
      block.sum = sent.colwise().sum().transpose();
      block.squares = sent.colwise().squaredNorm().transpose();
      block.rows = static_cast<double>(rows);
      result.push_back(std::move(block));
    }
    return result;
  }

  [[nodiscard]] bool suffices() const { return static_cast<double>(instants_.size()) * kStep > 5 * kBlock; }

 private:
  struct Instant {
    std::size_t first = 0;  ///< row that the kernel reaches
    double time = 0;        ///< [s]
  };

  /// Returns position, velocity, acceleration and jerk at `t`; nothing if ticks were missed around it.
  [[nodiscard]] std::optional<VectorXd> smoothed(std::size_t first, double t) const {
    VectorXd sums = VectorXd::Zero(4);
    double ones = 0;
    const double origin = rows_.front().position[axis_];
    for (std::size_t k = first; k < rows_.size() && rows_[k].time <= t + kReach; ++k) {
      if (k + 1 < rows_.size() && rows_[k + 1].time - rows_[k].time > 1.5 * period_) return std::nullopt;
      const double s = (t - rows_[k].time) / kKernel, g = std::exp(-0.5 * s * s);
      const double x = rows_[k].position[axis_] - origin;
      ones += g;
      sums[0] += g * x;
      sums[1] += -s / kKernel * g * x;
      sums[2] += (s * s - 1) / (kKernel * kKernel) * g * x;
      sums[3] += -s * (s * s - 3) / (kKernel * kKernel * kKernel) * g * x;
    }
    return sums / ones;
  }

  /// Returns the force along the axis that acts at an instant, for every limit.
  [[nodiscard]] VectorXd smoothed_force(const Instant& at, double delay, std::span<const double> limits) const {
    VectorXd sums = VectorXd::Zero(kLimits);
    double ones = 0;
    for (std::size_t k = at.first; k < rows_.size() && rows_[k].time <= at.time + kReach; ++k) {
      const double s = (at.time - rows_[k].time - 0.5 * period_ - delay) / kKernel, g = std::exp(-0.5 * s * s);
      ones += g;
      const double size = rows_[k].force.norm(), along = g * rows_[k].force[axis_];
      for (std::size_t i = 0; i < limits.size(); ++i)
        sums[static_cast<Eigen::Index>(i)] += size > limits[i] ? along * limits[i] / size : along;
    }
    return sums / ones;
  }

  std::span<const TickRow> rows_;
  int axis_;
  double period_;  ///< [s]
  std::vector<Instant> instants_;
  MatrixXd columns_;
};

/// Returns the unexplained shares of all axes together, without one block of them.
VectorXd unexplained(const std::vector<std::vector<Block>>& axes, std::size_t without_axis, std::size_t without) {
  VectorXd shares = VectorXd::Zero(kLimits);
  for (std::size_t axis = 0; axis < axes.size(); ++axis) {
    Block all;
    for (std::size_t b = 0; b < axes[axis].size(); ++b)
      if (axis != without_axis || b != without) all += axes[axis][b];
    shares += all.unexplained();
  }
  return shares;
}

/// Returns the limit with the smallest share, from the parabola through the best three.
double best_limit(const VectorXd& shares, std::span<const double> limits) {
  Eigen::Index best = 0;
  shares.minCoeff(&best);
  const double limit = limits[static_cast<std::size_t>(best)];
  if (best == 0 || best + 2 >= kLimits) return limit;
  const double before = shares[best - 1], after = shares[best + 1], bend = before - 2 * shares[best] + after;
  const double step = limits[1] - limits[0];
  return bend > 0 ? limit + 0.5 * (before - after) / bend * step : limit;
}

/// Returns the largest magnitude that was sent for kJudged.
double tried_force(const Experiment& experiment) {
  std::vector<double> sizes;
  for (const auto& stretches : experiment.pulsed)
    for (const Stretch& stretch : stretches)
      for (std::size_t k = stretch.begin; k < stretch.end; ++k) sizes.push_back(experiment.rows[k].force.norm());
  const auto enough = static_cast<std::size_t>(kJudged * experiment.rate_hz);
  if (sizes.size() <= enough) return 0;
  std::nth_element(sizes.begin(), sizes.begin() + static_cast<std::ptrdiff_t>(enough), sizes.end(), std::greater<>());
  return sizes[enough];
}

}  // namespace

MotorLimit identify_motor_limit(const Experiment& experiment) {
  constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
  MotorLimit result{.tried = tried_force(experiment)};
  if (!(result.tried > 0)) return result;
  std::vector<PulsedAxis> axes;
  for (int axis = 0; axis < 3; ++axis)
    for (const Stretch& stretch : experiment.pulsed[static_cast<std::size_t>(axis)]) {
      if (stretch.end < stretch.begin + 2) continue;
      PulsedAxis along(experiment.rows.subspan(stretch.begin, stretch.end - stretch.begin), axis, experiment.rate_hz);
      if (along.suffices()) axes.push_back(std::move(along));
    }
  if (axes.empty()) return result;

  std::vector<double> limits;
  for (int i = 0; i + 1 < kLimits; ++i)
    limits.push_back(result.tried * (kLeastLimit + (1 - kLeastLimit) * i / (kLimits - 2)));
  limits.push_back(std::numeric_limits<double>::infinity());
  std::vector<std::vector<Block>> best;
  VectorXd shares;
  for (double delay = 0; delay <= kLongestDelay; delay += kDelayStep) {
    std::vector<std::vector<Block>> blocks;
    for (const PulsedAxis& axis : axes) blocks.push_back(axis.blocks(delay, limits));
    const VectorXd now = unexplained(blocks, kNone, kNone);
    if (best.empty() || now.minCoeff() < shares.minCoeff()) {
      best = std::move(blocks);
      shares = now;
    }
  }

  const double limit = best_limit(shares, limits);
  if (!(shares[kLimits - 1] > kClearly * shares.minCoeff())) return result;
  double variance = 0;
  for (std::size_t axis = 0; axis < best.size(); ++axis) {
    const auto count = static_cast<double>(best[axis].size());
    for (std::size_t b = 0; b < best[axis].size(); ++b)
      variance += std::pow(best_limit(unexplained(best, axis, b), limits) - limit, 2) * (count - 1) / count;
  }
  const double half = std::hypot(kInterval95 * std::sqrt(variance), kLimitLeftOut * limit);
  if (!(limit > limits.front() && limit + half < kBelow * result.tried && half < kMostUncertain * limit)) return result;
  result.force = limit;
  result.half_width = half;
  return result;
}

void shorten_forces(std::vector<TickRow>& rows, double limit) {
  for (TickRow& row : rows) row.force = shortened(row.force, limit);
}

}  // namespace haptrace
