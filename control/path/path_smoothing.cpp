#include "control/path/path_smoothing.h"

#include "base/statistics.h"

#include <Eigen/SparseCholesky>

#include <algorithm>
#include <array>
#include <cmath>

namespace haptrace {
namespace {

using Sparse = Eigen::SparseMatrix<double>;
constexpr double kMostSmoothing = 0.05;   // no hand movement is faster [s]
constexpr double kLargestNoise = 1e-3;    // [m]
constexpr double kSmallestNoise = 1e-9;   // below this, differences are rounding [m]
constexpr double kRecordingStep = 0.011;  // largest step of a recording, with jitter; waypoints are farther apart [s]
constexpr double kBendingTolerance = 2.5;

using Columns = Eigen::Matrix<double, Eigen::Dynamic, 3>;

Columns positions_of(const Path& path) {
  Columns position(static_cast<Eigen::Index>(path.size()), 3);
  for (Eigen::Index i = 0; i < position.rows(); ++i) position.row(i) = path.position[static_cast<std::size_t>(i)];
  return position;
}

/// Holds the matrices of one stretch, which do not depend on the time constant.
///
/// With the second derivatives g at the knots, a cubic spline with given end slopes c satisfies R g = Q' x - c, where R
/// holds the integrals of products of hat functions and Q' takes differences of chords. The sum has its minimum at
/// x = p - tau^4 W^-1 Q g with (R + tau^4 Q' W^-1 Q) g = Q' p - c. Here c = 0: an end is at rest, or, where the path
/// continues, has no second derivative (its row is left out).
class Smoother {
 public:
  Smoother(const Path& path, const PathEnds& ends) : position_(positions_of(path)) {
    const Eigen::Index n = position_.rows();
    const auto step = [&](Eigen::Index i) {
      return path.time[static_cast<std::size_t>(i) + 1] - path.time[static_cast<std::size_t>(i)];
    };
    weight_ = Eigen::VectorXd::Zero(n);
    const Eigen::Index first = ends.begins_at_rest ? 0 : 1, last = ends.ends_at_rest ? n - 1 : n - 2;
    const Eigen::Index knots = std::max<Eigen::Index>(last - first + 1, 0);
    std::vector<Eigen::Triplet<double>> hats, chords;
    const auto add = [&](Eigen::Index row, Eigen::Index knot, double value) {
      if (knot >= first && knot <= last) chords.emplace_back(row, knot - first, value);
    };
    for (Eigen::Index i = 0; i + 1 < n; ++i) {
      const double h = step(i);
      weight_[i] += h / 2;
      weight_[i + 1] += h / 2;
      for (const Eigen::Index a : {i, i + 1})
        for (const Eigen::Index b : {i, i + 1})
          if (a >= first && a <= last && b >= first && b <= last)
            hats.emplace_back(a - first, b - first, a == b ? h / 3 : h / 6);
      // The chord of a segment enters the equations of both of its knots, with opposite signs.
      for (const auto& [knot, sign] : {std::pair{i, 1.0}, std::pair{i + 1, -1.0}}) {
        add(i, knot, -sign / h);
        add(i + 1, knot, sign / h);
      }
    }
    hats_.resize(knots, knots);
    hats_.setFromTriplets(hats.begin(), hats.end());
    chords_.resize(n, knots);
    chords_.setFromTriplets(chords.begin(), chords.end());
    stiffness_ = chords_.transpose() * weight_.cwiseInverse().asDiagonal() * chords_;
    right_ = chords_.transpose() * position_;
  }

  struct Result {
    Columns position;    ///< [m]
    double bending = 0;  ///< integral of |x''|^2 [m^2/s^3]
    double aside = 0;    ///< integral of |x - p|^2 [m^2 s]
  };

  [[nodiscard]] Result smooth(double time_constant) const {
    if (hats_.rows() == 0) return {.position = position_};
    const double tau4 = std::pow(time_constant, 4);
    const Sparse system = hats_ + tau4 * stiffness_;
    const Eigen::SimplicialLDLT<Sparse, Eigen::Lower, Eigen::NaturalOrdering<int>> solver(system);
    const Columns bend = solver.solve(right_);
    const Columns off = tau4 * (weight_.cwiseInverse().asDiagonal() * (chords_ * bend));
    return {.position = position_ - off,
            .bending = bend.cwiseProduct(hats_ * bend).sum(),
            .aside = (weight_.asDiagonal() * off.cwiseAbs2()).sum()};
  }

 private:
  Columns position_, right_;
  Eigen::VectorXd weight_;  ///< time that a sample represents [s]
  Sparse hats_, chords_, stiffness_;
};

/// Returns the distance of the middle sample from the cubic through its four neighbours, scaled to the error of a
/// single sample, in each axis.
Vec3 miss(const Path& path, std::size_t middle) {
  constexpr std::array<std::ptrdiff_t, 4> kNeighbours{-2, -1, 1, 2};
  const auto at = [&](std::ptrdiff_t k) { return static_cast<std::size_t>(static_cast<std::ptrdiff_t>(middle) + k); };
  Vec3 off = path.position[middle];
  double squares = 1;
  for (const std::ptrdiff_t j : kNeighbours) {
    double weight = 1;
    for (const std::ptrdiff_t k : kNeighbours)
      if (k != j) weight *= (path.time[middle] - path.time[at(k)]) / (path.time[at(j)] - path.time[at(k)]);
    off -= weight * path.position[at(j)];
    squares += weight * weight;
  }
  return off / std::sqrt(squares);
}

/// Returns the encoder resolution in `axis`: the step of which every difference is a multiple; 0 when there is none.
double quantum(std::span<const Path> stretches, int axis) {
  constexpr double kTolerance = 0.02;  // of a step; a text file rounds digits
  constexpr double kMostCounts = 1e5;  // more counts make the tolerance meaningless
  constexpr int kFewest = 8;           // a few steps are multiples of the smallest by chance
  std::vector<double> steps;           // zero at the end of each stretch
  for (const Path& stretch : stretches) {
    for (std::size_t i = 0; i + 1 < stretch.size(); ++i)
      steps.push_back(stretch.position[i + 1][axis] - stretch.position[i][axis]);
    steps.push_back(0);
  }
  double smallest = std::numeric_limits<double>::infinity();
  for (const double step : steps)
    if (std::abs(step) > kSmallestNoise) smallest = std::min(smallest, std::abs(step));

  // Encoder counts vary from step to step; those of a computed line do not.
  int moves = 0, changes = 0;
  for (std::size_t i = 0; i + 1 < steps.size(); ++i) {
    if (std::abs(steps[i]) <= kSmallestNoise) continue;
    const double counts = steps[i] / smallest;
    if (std::abs(counts) > kMostCounts || std::abs(counts - std::round(counts)) > kTolerance) return 0;
    ++moves;
    if (std::abs(steps[i + 1] - steps[i]) > kTolerance * smallest) ++changes;
  }
  return moves >= kFewest && 10 * changes >= moves ? smallest : 0;
}

}  // namespace

Vec3 position_noise(std::span<const Path> stretches) {
  std::array<std::vector<double>, 3> misses;
  std::size_t rows = 0;
  for (const Path& stretch : stretches) {
    rows += stretch.size();
    for (std::size_t i = 2; i + 2 < stretch.size(); ++i) {
      if (stretch.time[i + 2] - stretch.time[i - 2] > 4 * kRecordingStep) continue;
      const Vec3 off = miss(stretch, i).cwiseAbs();
      for (std::size_t axis = 0; axis < 3; ++axis) misses[axis].push_back(off[static_cast<int>(axis)]);
    }
  }
  // If most samples are farther apart, they are waypoints.
  if (misses[0].empty() || 2 * misses[0].size() < rows) return Vec3::Zero();
  constexpr double kQuantile = 0.95;
  Vec3 noise;
  for (int axis = 0; axis < 3; ++axis) {
    noise[axis] = std::max(quantile(misses[static_cast<std::size_t>(axis)], kQuantile) / kInterval95,
                           quantum(stretches, axis) / std::sqrt(12.0));
    if (noise[axis] > kLargestNoise || noise[axis] < kSmallestNoise) noise[axis] = 0;
  }
  return noise;
}

double smoothing_time(std::span<const Path> stretches) {
  const double variance = position_noise(stretches).squaredNorm();
  if (variance == 0) return 0;

  std::vector<Smoother> smoothers;
  double duration = 0;
  for (const Path& stretch : stretches) {
    smoothers.emplace_back(stretch, PathEnds{.begins_at_rest = false, .ends_at_rest = false});
    duration += stretch.duration();
  }
  const auto smooth_all = [&](double tau) {
    Smoother::Result sum;
    for (const Smoother& smoother : smoothers) {
      const Smoother::Result one = smoother.smooth(tau);
      sum.bending += one.bending;
      sum.aside += one.aside;
    }
    return sum;
  };
  const auto leaves_too_much = [&](double tau) { return smooth_all(tau).aside > variance * duration; };

  constexpr double kLeast = 1e-5, kPrecision = 1.02;
  double low = kLeast, high = kMostSmoothing;
  if (leaves_too_much(low)) return 0;
  if (!leaves_too_much(high)) low = high;
  while (high > kPrecision * low) {
    const double middle = std::sqrt(low * high);
    (leaves_too_much(middle) ? high : low) = middle;
  }
  return smooth_all(0).bending > kBendingTolerance * smooth_all(low).bending ? low : 0;
}

std::vector<Vec3> smooth_positions(const Path& path, double time_constant, const PathEnds& ends) {
  if (time_constant <= 0 || path.size() < 3) return path.position;
  const Smoother::Result result = Smoother(path, ends).smooth(time_constant);
  // Neighbouring steps with a ratio of about 1 : 1e6 exceed the precision of doubles.
  const double extent = path.bounds().size().norm();
  if (!((result.position - positions_of(path)).rowwise().norm().array() <= extent).all()) return path.position;
  std::vector<Vec3> position(path.size());
  for (std::size_t i = 0; i < position.size(); ++i) position[i] = result.position.row(static_cast<Eigen::Index>(i));
  return position;
}

}  // namespace haptrace
