#include "control/design/friction_axes.h"

#include "base/statistics.h"
#include "control/design/dense.h"
#include "control/design/line_spectrum.h"
#include "control/design/nelder_mead.h"
#include "control/feedforward.h"
#include "control/rotation.h"

#include <Eigen/Geometry>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace haptrace {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;

constexpr double kMostLeft = 0.9;       // of the squared force that friction along the axes of W leaves unexplained
constexpr double kLeastCertain = 0.35;  // largest half width of the interval of the rotation [rad]

Matrix3d turned(const Vec3& rotation) {
  return quaternion(rotation).toRotationMatrix();
}

Matrix3d turned(const std::array<double, 3>& rotation) {
  return turned(Vec3(rotation[0], rotation[1], rotation[2]));
}

double angle_of(const Matrix3d& rotation) {
  return Eigen::AngleAxisd(rotation).angle();
}

/// Rows of a stretch, with what it takes to remove the part that the other regressors explain.
struct Prepared {
  MatrixXd velocity;                                ///< [m/s]
  MatrixXd others;                                  ///< N, regressors of unit length
  const std::array<std::vector<Index>, 3>* used{};  ///< columns of N of each component of the force
  std::array<MatrixXd, 3> inverse;                  ///< (N^T N)^-1 of these columns
  std::array<MatrixXd, 3> rest;                     ///< force that they leave unexplained [N]
};

MatrixXd columns_of(const MatrixXd& all, const std::vector<Index>& columns) {
  MatrixXd some(all.rows(), static_cast<Index>(columns.size()));
  for (Index c = 0; c < some.cols(); ++c) some.col(c) = all.col(columns[static_cast<std::size_t>(c)]);
  return some;
}

/// Leaves out the rows [from, to).
Prepared prepared(const SlidingRows& rows, Index from, Index to) {
  const Index n = rows.velocity.rows(), left = n - (to - from);
  const auto without = [&](const MatrixXd& all) {
    MatrixXd some(left, all.cols());
    for (Index c = 0; c < all.cols(); ++c)
      for (Index i = 0; i < left; ++i) some(i, c) = all(i < from ? i : i + to - from, c);
    return some;
  };
  Prepared result{.velocity = without(rows.velocity),
                  .others = without(rows.others),
                  .used = &rows.used,
                  .inverse = {},
                  .rest = {}};
  for (Index c = 0; c < result.others.cols(); ++c)
    if (const double norm = result.others.col(c).norm(); norm > 0) result.others.col(c) /= norm;
  const MatrixXd force = without(rows.force);
  for (std::size_t k = 0; k < 3; ++k) {
    const MatrixXd others = columns_of(result.others, rows.used[k]), own = force.col(static_cast<Index>(k));
    MatrixXd gram = transposed_product(others, others);
    gram.diagonal().array() += 1e-9;
    result.inverse[k] = solve_symmetric(gram, MatrixXd::Identity(gram.rows(), gram.cols()));
    result.rest[k] = own - product(others, product(result.inverse[k], transposed_product(others, own)));
  }
  return result;
}

struct Fit {
  double unexplained = 0;  ///< sum of squares [N^2]
  Vec3 coulomb = Vec3::Zero();
};

/// Fits friction along the axes of `r`. Friction never pushes.
Fit fit(const std::vector<Prepared>& stretches, const Matrix3d& r) {
  Matrix3d gram = Matrix3d::Zero();
  Vec3 right = Vec3::Zero();
  double squares = 0;
  for (const Prepared& rows : stretches) {
    MatrixXd sign = product(rows.velocity, MatrixXd(r.transpose()));
    for (double& value : sign.reshaped()) value = std::tanh(value / FrictionFeedforward::kTransition);
    const MatrixXd all = transposed_product(sign, sign), shared = transposed_product(sign, rows.others);
    for (std::size_t k = 0; k < 3; ++k) {
      const MatrixXd in = columns_of(shared, (*rows.used)[k]);
      const MatrixXd left = all - product(in, transposed_product(rows.inverse[k], in.transpose()));
      const MatrixXd along = transposed_product(sign, rows.rest[k]);
      for (Index i = 0; i < 3; ++i) {
        const double share = r(i, static_cast<Index>(k));
        for (Index j = 0; j < 3; ++j) gram(i, j) += share * r(j, static_cast<Index>(k)) * left(i, j);
        right[i] += share * along(i, 0);
      }
      squares += rows.rest[k].squaredNorm();
    }
  }
  Fit best;
  std::array<bool, 3> used{true, true, true};
  for (int round = 0; round < 3; ++round) {
    MatrixXd a = gram, b = right;
    for (Index i = 0; i < 3; ++i) {
      a(i, i) += 1e-9 * gram.trace() + std::numeric_limits<double>::min();
      if (used[static_cast<std::size_t>(i)]) continue;
      for (Index j = 0; j < 3; ++j) a(i, j) = a(j, i) = i == j ? 1 : 0;
      b(i, 0) = 0;
    }
    best.coulomb = solve_symmetric(a, b);
    Index lowest = 0;
    if (!(best.coulomb.minCoeff(&lowest) < 0)) break;
    used[static_cast<std::size_t>(lowest)] = false;
    best.coulomb = best.coulomb.cwiseMax(0);
  }
  best.unexplained = squares - 2 * best.coulomb.dot(right) + best.coulomb.dot(Vec3(gram * best.coulomb));
  return best;
}

/// Returns the axes near `from` that leave least unexplained. `step`: first step of the search [rad].
Matrix3d refined(const std::vector<Prepared>& stretches, const Matrix3d& from, double step, int evaluations) {
  const auto cost = [&](const std::array<double, 3>& at) { return fit(stretches, turned(at) * from).unexplained; };
  const double spread = 1e-6 * cost({});
  return turned(minimised<3>(cost, {}, {step, step, step}, evaluations, spread)) * from;
}

/// Returns the axes that leave least unexplained. Every rotation is within 1.1 rad of a change of order and signs.
/// Close to the axes of W, the friction changes within a tenth of a radian, and needs a finer grid of its own.
Matrix3d best_axes(const std::vector<Prepared>& stretches) {
  struct Grid {
    double step;
    int steps;
  };
  constexpr double kFarthest = 1.1;   // [rad]
  constexpr std::size_t kStarts = 4;  // of each grid
  Matrix3d best = Matrix3d::Identity();
  double least = std::numeric_limits<double>::infinity();
  for (const Grid& grid : {Grid{0.2, 5}, Grid{0.05, 3}}) {
    std::vector<std::pair<double, Vec3>> starts;
    for (int i = -grid.steps; i <= grid.steps; ++i)
      for (int j = -grid.steps; j <= grid.steps; ++j)
        for (int k = -grid.steps; k <= grid.steps; ++k)
          if (const Vec3 at = grid.step * Vec3(i, j, k); at.norm() <= kFarthest)
            starts.emplace_back(fit(stretches, turned(at)).unexplained, at);
    std::partial_sort(starts.begin(), starts.begin() + kStarts, starts.end(),
                      [](const auto& a, const auto& b) { return a.first < b.first; });
    for (std::size_t s = 0; s < kStarts; ++s) {
      const Matrix3d r = refined(stretches, turned(starts[s].second), 0.5 * grid.step, 120);
      if (const double cost = fit(stretches, r).unexplained; cost < least) {
        least = cost;
        best = r;
      }
    }
  }
  return best;
}

/// Changes the order and the signs of the axes so that their angle to those of W is smallest.
Matrix3d nearest_to_identity(const Matrix3d& r) {
  Matrix3d best = r;
  std::array<int, 3> order{0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      Matrix3d other;
      for (int i = 0; i < 3; ++i)
        other.row(i) = ((signs >> i & 1) != 0 ? -1 : 1) * r.row(order[static_cast<std::size_t>(i)]);
      if (other.determinant() > 0 && other.trace() > best.trace()) best = other;
    }
  } while (std::next_permutation(order.begin(), order.end()));
  return best;
}

}  // namespace

std::optional<ActuatorFriction> find_friction_axes(std::span<const SlidingRows> stretches) {
  std::vector<Prepared> all;
  for (const SlidingRows& rows : stretches) all.push_back(prepared(rows, 0, 0));
  if (all.empty()) return std::nullopt;
  ActuatorFriction result;
  result.axes = nearest_to_identity(best_axes(all));
  const Fit own = fit(all, result.axes), plain = fit(all, Matrix3d::Identity());
  result.coulomb = own.coulomb;
  if (!(own.unexplained < kMostLeft * plain.unexplained)) return std::nullopt;

  double variance = 0, count = 0;
  Vec3 variances = Vec3::Zero();
  for (std::size_t s = 0; s < stretches.size(); ++s) {
    const SlidingRows& rows = stretches[s];
    for (std::size_t b = 0; b < rows.blocks.size(); ++b) {
      const Index to = b + 1 < rows.blocks.size() ? rows.blocks[b + 1] : rows.velocity.rows();
      std::vector<Prepared> others = all;
      others[s] = prepared(rows, rows.blocks[b], to);
      const Matrix3d r = refined(others, result.axes, 0.05, 80);
      variance += std::pow(angle_of(r * result.axes.transpose()), 2);
      variances += (fit(others, r).coulomb - result.coulomb).cwiseAbs2();
      ++count;
    }
  }
  result.angle_half = kInterval95 * std::sqrt(variance * (count - 1) / count);
  result.coulomb_half = kInterval95 * (variances * (count - 1) / count).cwiseSqrt();
  if (!(result.angle_half < std::min(kLeastCertain, angle_of(result.axes)))) return std::nullopt;
  return result;
}

}  // namespace haptrace
