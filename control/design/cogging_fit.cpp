#include "control/design/cogging_fit.h"

#include "base/statistics.h"
#include "control/design/dense.h"
#include "control/design/line_spectrum.h"
#include "control/feedforward.h"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>
#include <utility>

namespace haptrace {
namespace {

using Eigen::ArrayXf;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kKernel = 4e-3;    // standard deviation of the Gaussian kernel [s]
constexpr double kReach = 4;        // of the kernel [standard deviations]
constexpr double kStep = 3e-3;      // between filtered rows [s]
constexpr double kPiece = 1.5;      // longest piece with regressors of its own [s]
constexpr double kDrift = 5;        // highest frequency of the drift [Hz]
constexpr double kShortest = 2e-3;  // period of a wave [m]
constexpr double kLongest = 20e-3;  // [m]
constexpr double kGrid = 150;       // step of wave numbers, a third of the width of a line at the centre [rad/m]
constexpr std::size_t kStarts = 6;  // of the refinement of a new wave
constexpr std::size_t kMostWaves = 6;
constexpr double kCentreShare = 0.2;  // required of each wave if nothing was measured away from the centre
// Model error that the fit cannot see as noise: twice the standard deviation over random simulated devices.
constexpr double kAmplitudeLeftOut = 0.2;
constexpr double kMostUncertain = 0.5;  // largest half width of the interval of the amplitude, as a fraction of it

using Mass = std::optional<Eigen::MatrixXd>;  ///< matrix [kg]; nothing: it is one of the regressors

/// A part of the experiment, with what the movement alone explains removed from the force.
struct Piece {
  double distance = 0;         ///< of its mean position from the centre [m]
  std::vector<Vec3> place;     ///< raw positions from the centre on [m]
  std::vector<Index> first;    ///< first raw position of each filtered row
  std::vector<double> weight;  ///< kernel over `taps` raw positions from there on, for each filtered row
  Index taps = 0;
  MatrixXd velocity;  ///< of the filtered rows [m/s]
  MatrixXd basis;     ///< orthonormal columns of drift, friction and movement
  MatrixXd rest;      ///< force that drift, friction and movement leave unexplained [N]

  [[nodiscard]] Index rows() const { return rest.rows(); }

  /// Filters columns of raw values, and removes what the movement explains.
  [[nodiscard]] MatrixXd filtered(const MatrixXd& raw) const {
    MatrixXd result(rows(), raw.cols());
    for (Index c = 0; c < raw.cols(); ++c)
      for (Index i = 0; i < rows(); ++i) {
        const double* const at = raw.data() + c * raw.rows() + first[static_cast<std::size_t>(i)];
        const double* const g = weight.data() + i * taps;
        double sum = 0;
        for (Index k = 0; k < taps; ++k) sum += g[k] * at[k];
        result(i, c) = sum;
      }
    return rest_of(result);
  }

  [[nodiscard]] MatrixXd rest_of(const MatrixXd& columns) const {
    return columns - product(basis, transposed_product(basis, columns));
  }

  /// Returns the transpose of the filter: values of filtered rows, spread over the raw ones.
  [[nodiscard]] MatrixXd spread(const MatrixXd& values) const {
    MatrixXd result = MatrixXd::Zero(static_cast<Index>(place.size()), values.cols());
    for (Index c = 0; c < values.cols(); ++c)
      for (Index i = 0; i < rows(); ++i)
        for (Index k = 0; k < taps; ++k)
          result(first[static_cast<std::size_t>(i)] + k, c) +=
              weight[static_cast<std::size_t>(i * taps + k)] * values(i, c);
    return result;
  }
};

/// Returns an orthonormal basis of the columns, without those that depend on the ones before them.
MatrixXd orthonormal(MatrixXd columns) {
  constexpr double kDependent = 1e-5;
  Index count = 0;
  for (Index c = 0; c < columns.cols(); ++c) {
    VectorXd column = columns.col(c);
    const double size = column.norm();
    if (!(size > 0)) continue;
    for (int twice = 0; twice < 2; ++twice)
      for (Index b = 0; b < count; ++b) column -= columns.col(b).dot(column) * columns.col(b);
    if (const double left = column.norm(); left > kDependent * size) columns.col(count++) = column / left;
  }
  return columns.leftCols(count);
}

/// Returns the sums of each row from the first one on, of rows that are kStep apart.
MatrixXd integrated(const MatrixXd& values) {
  MatrixXd result = MatrixXd::Zero(values.rows(), values.cols());
  for (Index c = 0; c < values.cols(); ++c) {
    const double mean = values.col(c).mean();
    for (Index i = 1; i < values.rows(); ++i) result(i, c) = result(i - 1, c) + kStep * (values(i, c) - mean);
  }
  return result;
}

/// Returns a basis of the regressors of a piece: a drift, friction along each axis, and the movement, with the hand's
/// grip and mass in powers of frequency from -2 on. If the mass is known, only damping and stiffness are among the
/// regressors of the movement.
MatrixXd basis_of(const MatrixXd& x, const MatrixXd& v, const MatrixXd& a, bool known_mass) {
  const Index n = x.rows();
  const Index drifts = 1 + static_cast<Index>(std::floor(2 * kDrift * kStep * static_cast<double>(n)));
  MatrixXd columns(n, drifts + (known_mass ? 9 : 18));
  for (Index i = 0; i < n; ++i) {
    const double share = (static_cast<double>(i) + 0.5) / static_cast<double>(n);
    for (Index d = 0; d < drifts; ++d) columns(i, d) = std::cos(std::numbers::pi * static_cast<double>(d) * share);
    for (Index axis = 0; axis < 3; ++axis)
      columns(i, drifts + axis) = std::tanh(v(i, axis) / FrictionFeedforward::kTransition);
  }
  columns.middleCols(drifts + 3, 3) = v;
  columns.middleCols(drifts + 6, 3) = x;
  if (!known_mass) {
    const MatrixXd once = integrated(x);
    columns.middleCols(drifts + 9, 3) = a;
    columns.middleCols(drifts + 12, 3) = once;
    columns.rightCols(3) = integrated(once);
  }
  return orthonormal(std::move(columns));
}

/// Returns nothing if ticks are missed in it, or if it is too short.
std::optional<Piece> piece_of(std::span<const TickRow> rows, const Vec3& centre, double delay, double period,
                              const Mass& mass) {
  const double reach = kReach * kKernel, late = delay + 0.5 * period;
  Piece piece;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    if (k > 0 && rows[k].time - rows[k - 1].time > 1.5 * period) return std::nullopt;
    piece.place.push_back(rows[k].position - centre);
  }
  const auto taps = static_cast<std::size_t>(std::ceil(2 * reach / period));
  if (rows.size() < 2 * taps) return std::nullopt;
  piece.taps = static_cast<Index>(taps);
  std::vector<double> times;
  for (double t = rows.front().time + reach + late; t < rows.back().time - reach - late; t += kStep) times.push_back(t);
  const auto n = static_cast<Index>(times.size());
  if (n < 60) return std::nullopt;

  MatrixXd x = MatrixXd::Zero(n, 3), v = x, a = x, force = x;
  std::size_t from = 0;
  for (Index i = 0; i < n; ++i) {
    const double t = times[static_cast<std::size_t>(i)];
    while (rows[from].time < t - reach) ++from;
    const std::size_t begin = std::min(from, rows.size() - taps);
    piece.first.push_back(static_cast<Index>(begin));
    double ones = 0, forces = 0;
    std::vector<double> weights(taps), delayed;
    std::size_t sent = begin;
    while (sent > 0 && rows[sent].time > t - late - reach) --sent;
    for (std::size_t k = 0; k < taps; ++k) {
      const double s = (t - rows[begin + k].time) / kKernel;
      ones += weights[k] = std::exp(-0.5 * s * s);
    }
    for (std::size_t k = 0; k < taps; ++k) {
      const double s = (t - rows[begin + k].time) / kKernel, g = weights[k] / ones;
      piece.weight.push_back(g);
      const Vec3& at = piece.place[begin + k];
      for (int axis = 0; axis < 3; ++axis) {
        x(i, axis) += g * at[axis];
        v(i, axis) += -s / kKernel * g * at[axis];
        a(i, axis) += (s * s - 1) / (kKernel * kKernel) * g * at[axis];
      }
    }
    for (std::size_t k = sent; k < rows.size() && rows[k].time < t - late + reach; ++k) {
      const double s = (t - late - rows[k].time) / kKernel, g = std::exp(-0.5 * s * s);
      forces += g;
      for (int axis = 0; axis < 3; ++axis) force(i, axis) += g * rows[k].force[axis];
    }
    force.row(i) /= forces;
  }
  piece.basis = basis_of(x, v, a, mass.has_value());
  if (mass) force -= product(a, mass->transpose());
  piece.rest = piece.rest_of(force);
  piece.velocity = v;
  Vec3 mean = Vec3::Zero();
  for (const Vec3& at : piece.place) mean += at / static_cast<double>(piece.place.size());
  piece.distance = mean.norm();
  return piece;
}

/// Returns the pieces of all measurements, the nearest to the centre first. With a mass, which is that at the centre:
/// those with excitation there, see refit_amplitudes().
std::vector<Piece> pieces_of(const Experiment& experiment, double delay, const Mass& mass = {}) {
  std::vector<Piece> pieces;
  const double period = 1 / experiment.rate_hz;
  const auto add = [&](const Stretch& stretch) {
    const std::size_t rows = stretch.end - stretch.begin;
    const double whole = std::max(1.0, std::round(static_cast<double>(rows) * period / kPiece));
    const auto count = static_cast<std::size_t>(whole);
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t from = stretch.begin + rows * i / count, to = stretch.begin + rows * (i + 1) / count;
      if (auto piece = piece_of(experiment.rows.subspan(from, to - from), experiment.centre, delay, period, mass))
        pieces.push_back(std::move(*piece));
    }
  };
  for (const Stretch& stretch : experiment.dithered) add(stretch);
  if (mass) return pieces;
  for (const auto& axis : experiment.sweeps)
    for (const Stretch& stretch : axis) add(stretch);
  for (const ExperimentPlace& place : experiment.places) add(place.dithered);
  std::stable_sort(pieces.begin(), pieces.end(),
                   [](const Piece& a, const Piece& b) { return a.distance < b.distance; });
  return pieces;
}

using Pieces = std::span<const Piece>;
constexpr Index kOfWave = 5;  // unknowns of a wave: cosine, sine, wave number

/// Normal equations of a piece. Columns are those of the cosines and sines, and if asked those of the wave numbers.
struct Normal {
  MatrixXd g, h;
};

Vec3 direction(const CoggingWave& wave) {
  return wave.wave_number / wave.wave_number.norm();
}

/// Returns the regressors of the waves in a piece, cosine and sine of each, and with `slopes` those of its wave number.
/// They are to be multiplied by the direction of their wave.
MatrixXd regressors(const Piece& piece, std::span<const CoggingWave> waves, bool slopes) {
  const auto n = static_cast<Index>(piece.place.size());
  const Index each = slopes ? kOfWave : 2;
  MatrixXd raw(n, each * static_cast<Index>(waves.size()));
  for (std::size_t w = 0; w < waves.size(); ++w)
    for (Index i = 0; i < n; ++i) {
      const Vec3& d = piece.place[static_cast<std::size_t>(i)];
      const double phase = waves[w].wave_number.dot(d), c = std::cos(phase), s = std::sin(phase);
      const Index column = each * static_cast<Index>(w);
      raw(i, column) = c;
      raw(i, column + 1) = s;
      if (!slopes) continue;
      const double turn = waves[w].sine * c - waves[w].cosine * s;
      for (Index axis = 0; axis < 3; ++axis) raw(i, column + 2 + axis) = turn * d[axis];
    }
  return piece.filtered(raw);
}

Normal normal_of(const Piece& piece, std::span<const CoggingWave> waves, bool slopes) {
  const MatrixXd columns = regressors(piece, waves, slopes);
  const Index each = slopes ? kOfWave : 2;
  Normal normal{transposed_product(columns, columns), MatrixXd(columns.cols(), 1)};
  const MatrixXd along = transposed_product(columns, piece.rest);
  const auto of = [&](Index column) { return direction(waves[static_cast<std::size_t>(column / each)]); };
  for (Index i = 0; i < columns.cols(); ++i) {
    for (Index j = 0; j < columns.cols(); ++j) normal.g(i, j) *= of(i).dot(of(j));
    normal.h(i, 0) = along.row(i) * of(i);
  }
  return normal;
}

Normal sum_of(Pieces pieces, std::span<const CoggingWave> waves, bool slopes) {
  Normal sum;
  for (const Piece& piece : pieces) {
    Normal own = normal_of(piece, waves, slopes);
    if (sum.g.size() == 0) {
      sum = std::move(own);
    } else {
      sum.g += own.g;
      sum.h += own.h;
    }
  }
  return sum;
}

/// Solves with unknowns of any scale. `damping`: added to the scaled diagonal of the wave numbers.
VectorXd solution_of(const Normal& normal, double damping = 0) {
  const Index n = normal.g.rows();
  MatrixXd g = normal.g, h = normal.h;
  VectorXd scale(n);
  for (Index i = 0; i < n; ++i) scale[i] = g(i, i) > 0 ? 1 / std::sqrt(g(i, i)) : 0;
  for (Index i = 0; i < n; ++i) {
    for (Index j = 0; j < n; ++j) g(i, j) *= scale[i] * scale[j];
    g(i, i) += 1e-9 + (i % kOfWave >= 2 ? damping : 0);
    h(i, 0) *= scale[i];
  }
  const VectorXd solved = solve_symmetric(g, h);
  return scale.cwiseProduct(solved);
}

double force_in(Pieces pieces) {
  double sum = 0;
  for (const Piece& piece : pieces) sum += piece.rest.squaredNorm();
  return sum;
}

/// Sets the amplitudes of the waves to the best ones for their wave numbers. Returns the explained sum of squares
/// [N^2].
double fit_amplitudes(Pieces pieces, std::span<CoggingWave> waves) {
  if (waves.empty()) return 0;
  const Normal normal = sum_of(pieces, waves, false);
  const VectorXd found = solution_of(normal);
  for (std::size_t w = 0; w < waves.size(); ++w) {
    waves[w].cosine = found[2 * static_cast<Index>(w)];
    waves[w].sine = found[2 * static_cast<Index>(w) + 1];
  }
  return found.dot(VectorXd(normal.h));
}

/// Refines the wave numbers by Gauss-Newton steps, damped as by Levenberg and Marquardt. Returns the explained sum.
double refine(Pieces pieces, std::vector<CoggingWave>& waves, int steps) {
  double explained = fit_amplitudes(pieces, waves);
  double damping = 1e-3;
  Normal normal;
  for (bool moved = true; steps > 0 && damping < 1e3; --steps) {
    if (std::exchange(moved, false)) normal = sum_of(pieces, waves, true);
    const VectorXd found = solution_of(normal, damping);
    std::vector<CoggingWave> next = waves;
    for (std::size_t w = 0; w < waves.size(); ++w)
      next[w].wave_number += found.segment<3>(kOfWave * static_cast<Index>(w) + 2);
    const double more = fit_amplitudes(pieces, next);
    if (more > explained) {
      const bool settled = more - explained < 1e-7 * explained;
      waves = std::move(next);
      explained = more;
      damping *= 0.1;
      moved = true;
      if (settled) break;
    } else {
      damping *= 10;
    }
  }
  return explained;
}

/// Spectrum of the force over the wave number.
class Spectrum {
 public:
  /// The spectrum of the loads without the forces of `waves`.
  Spectrum(Pieces pieces, std::span<const CoggingWave> waves, double period) {
    const auto every = static_cast<Index>(std::max(1.0, std::round(kSample / period)));
    std::vector<Vec3> places, loads;
    for (const Piece& piece : pieces) {
      MatrixXd rest = piece.rest;
      if (!waves.empty()) {
        const MatrixXd columns = regressors(piece, waves, false);
        for (std::size_t w = 0; w < waves.size(); ++w) {
          const auto c = 2 * static_cast<Index>(w);
          const VectorXd value = waves[w].cosine * columns.col(c) + waves[w].sine * columns.col(c + 1);
          for (Index axis = 0; axis < 3; ++axis) rest.col(axis) -= direction(waves[w])[axis] * value;
        }
      }
      const MatrixXd load = piece.spread(rest);
      for (Index i = 0; i < load.rows(); i += every) {
        places.push_back(piece.place[static_cast<std::size_t>(i)]);
        loads.emplace_back(load.row(i));
      }
      for (Index i = 0; i < piece.rows(); i += kFewer) velocity_.emplace_back(piece.velocity.row(i));
    }
    const auto n = static_cast<Index>(places.size());
    place_.resize(n, 3);
    load_.resize(n, 3);
    for (Index i = 0; i < n; ++i) {
      place_.row(i) = places[static_cast<std::size_t>(i)].cast<float>();
      load_.row(i) = loads[static_cast<std::size_t>(i)].cast<float>();
    }
  }

  /// Returns the highest peaks, the highest first.
  [[nodiscard]] std::vector<Vec3> peaks(std::size_t count) const {
    struct Point {
      Vec3 k;
      double height;
    };
    std::vector<Point> points;
    const int most = static_cast<int>(std::floor(kTwoPi / kShortest / kGrid));
    const float step = static_cast<float>(kGrid);
    const ArrayXf turn_re = (step * place_.col(2)).cos(), turn_im = (step * place_.col(2)).sin();
    for (int i = 0; i <= most; ++i)
      for (int j = i > 0 ? -most : 0; j <= most; ++j) {
        const int left = most * most - i * i - j * j;
        if (left < 0) continue;
        const int high = static_cast<int>(std::sqrt(left)), low = i > 0 || j > 0 ? -high : 0;
        const ArrayXf phase = step * (static_cast<float>(i) * place_.col(0) + static_cast<float>(j) * place_.col(1) +
                                      static_cast<float>(low) * place_.col(2));
        ArrayXf re = phase.cos(), im = phase.sin();
        for (int l = low; l <= high; ++l) {
          const Vec3 k = kGrid * Vec3(i, j, l);
          if (k.norm() >= kTwoPi / kLongest) points.push_back({k, height(k, re, im)});
          const ArrayXf next = re * turn_re - im * turn_im;
          im = re * turn_im + im * turn_re;
          re = next;
        }
      }
    std::sort(points.begin(), points.end(), [](const Point& a, const Point& b) { return a.height > b.height; });
    std::vector<Vec3> result;
    for (const Point& point : points) {
      if (result.size() == count) break;
      if (std::none_of(result.begin(), result.end(),
                       [&](const Vec3& k) { return std::min((k - point.k).norm(), (k + point.k).norm()) < 2 * kGrid; }))
        result.push_back(point.k);
    }
    return result;
  }

 private:
  static constexpr double kSample = 4e-3;  // [s]
  static constexpr Index kFewer = 8;       // filtered rows for each velocity

  /// Returns the force that a wave explains, over the share of it that passes the kernel.
  [[nodiscard]] double height(const Vec3& k, const ArrayXf& re, const ArrayXf& im) const {
    const Eigen::Vector3f along = (k / k.norm()).cast<float>();
    double real = 0, imaginary = 0, passes = 0;
    for (Index axis = 0; axis < 3; ++axis) {
      real += along[axis] * (load_.col(axis) * re).sum();
      imaginary += along[axis] * (load_.col(axis) * im).sum();
    }
    for (const Vec3& v : velocity_) passes += std::exp(-std::pow(kKernel * k.dot(v), 2));
    return (real * real + imaginary * imaginary) / (passes + 1e-3 * static_cast<double>(velocity_.size()));
  }

  Eigen::Array<float, Eigen::Dynamic, 3> place_, load_;
  std::vector<Vec3> velocity_;
};

/// Finds waves in the measurements near the centre, one after the other: those that explain a share of at least
/// `least`.
std::vector<CoggingWave> first_waves(Pieces near, double period, double least) {
  std::vector<CoggingWave> waves;
  const double force = force_in(near);
  double explained = 0;
  while (waves.size() < kMostWaves) {
    std::vector<CoggingWave> best;
    double most = explained;
    for (const Vec3& k : Spectrum(near, waves, period).peaks(kStarts)) {
      std::vector<CoggingWave> more = waves;
      more.push_back({.wave_number = k});
      if (const double with = refine(near, more, 6); with > most) {
        most = with;
        best = std::move(more);
      }
    }
    if (most - explained < least * (force - most)) break;
    waves = std::move(best);
    explained = refine(near, waves, 12);
  }
  return waves;
}

/// Drops the waves that explain a share below `required`, the least first.
void drop_unclear(Pieces pieces, double required, std::vector<CoggingWave>& waves) {
  const double force = force_in(pieces);
  while (!waves.empty()) {
    const double explained = refine(pieces, waves, 20), left = force - explained;
    std::size_t least = 0;
    double least_share = std::numeric_limits<double>::infinity();
    for (std::size_t w = 0; w < waves.size(); ++w) {
      std::vector<CoggingWave> others = waves;
      others.erase(others.begin() + static_cast<std::ptrdiff_t>(w));
      const double share = (explained - fit_amplitudes(pieces, others)) / left;
      if (share >= least_share) continue;
      least_share = share;
      least = w;
    }
    if (least_share >= required) return;
    waves.erase(waves.begin() + static_cast<std::ptrdiff_t>(least));
  }
}

/// Returns the waves as forces of the mechanism, which the force sent opposes, with the intervals of a jackknife over
/// the pieces, linear in the unknowns.
std::vector<CoggingWave> with_intervals(Pieces pieces, std::vector<CoggingWave> waves) {
  const Normal all = sum_of(pieces, waves, true);
  const VectorXd best = solution_of(all);
  const auto count = static_cast<double>(pieces.size());
  const auto amplitude = [](const VectorXd& of, Index at) { return std::hypot(of[at], of[at + 1]); };
  VectorXd amplitudes = VectorXd::Zero(static_cast<Index>(waves.size())), all_of = VectorXd::Zero(best.size());
  for (const Piece& piece : pieces) {
    Normal others = normal_of(piece, waves, true);
    others.g = all.g - others.g;
    others.h = all.h - others.h;
    const VectorXd found = solution_of(others);
    all_of += (found - best).cwiseAbs2();
    for (Index w = 0; w < amplitudes.size(); ++w)
      amplitudes[w] += std::pow(amplitude(found, kOfWave * w) - amplitude(best, kOfWave * w), 2);
  }
  const double share = (count - 1) / count;
  for (std::size_t w = 0; w < waves.size(); ++w) {
    const auto at = static_cast<Index>(w);
    waves[w].cosine = -waves[w].cosine;
    waves[w].sine = -waves[w].sine;
    waves[w].amplitude_half =
        std::hypot(kInterval95 * std::sqrt(share * amplitudes[at]), kAmplitudeLeftOut * waves[w].amplitude());
    waves[w].wave_number_half = kInterval95 * (share * all_of.segment<3>(kOfWave * at + 2)).cwiseSqrt();
  }
  return waves;
}

}  // namespace

std::optional<Cogging> find_cogging(const Experiment& experiment, double delay, const CoggingShares& required) {
  if (experiment.dither == nullptr || experiment.axes != std::array{true, true, true}) return std::nullopt;
  const std::vector<Piece> pieces = pieces_of(experiment, delay);
  std::size_t near = 0;
  constexpr double kNear = 5e-3;  // [m]
  while (near < pieces.size() && pieces[near].distance < kNear) ++near;
  if (near < 2) return std::nullopt;
  const bool elsewhere = !experiment.places.empty();
  std::vector<CoggingWave> waves =
      first_waves(Pieces(pieces).first(near), 1 / experiment.rate_hz, elsewhere ? required.near : kCentreShare);
  if (waves.empty()) return std::nullopt;
  for (std::size_t known = near + 1; known <= pieces.size(); ++known) refine(Pieces(pieces).first(known), waves, 4);

  drop_unclear(pieces, elsewhere ? required.everywhere : kCentreShare, waves);
  Cogging cogging{.centre = experiment.centre, .waves = with_intervals(pieces, waves)};
  std::erase_if(cogging.waves,
                [](const CoggingWave& wave) { return !(wave.amplitude_half < kMostUncertain * wave.amplitude()); });
  if (cogging.waves.empty()) return std::nullopt;
  return cogging;
}

void refit_amplitudes(const Experiment& experiment, const Eigen::Matrix3d& mass, double delay, Cogging& cogging) {
  const std::vector<Piece> pieces = pieces_of(experiment, delay, MatrixXd(mass));
  if (pieces.empty()) return;
  const Normal normal = sum_of(pieces, cogging.waves, false);
  VectorXd now(normal.g.rows());
  for (std::size_t w = 0; w < cogging.waves.size(); ++w)
    now.segment<2>(2 * static_cast<Index>(w)) << -cogging.waves[w].cosine, -cogging.waves[w].sine;
  const double squares = now.dot(VectorXd(product(normal.g, now)));
  if (!(squares > 0)) return;
  const double factor = now.dot(VectorXd(normal.h)) / squares;
  for (CoggingWave& wave : cogging.waves) {
    wave.cosine *= factor;
    wave.sine *= factor;
    wave.amplitude_half *= std::abs(factor);
  }
}

std::vector<TickRow> without_cogging(const Experiment& experiment, const Cogging& cogging, double delay) {
  std::vector<TickRow> rows(experiment.rows.begin(), experiment.rows.end());
  const double late = delay + 0.5 / experiment.rate_hz;
  std::size_t after = 0;
  for (TickRow& row : rows) {
    // The force sent at a tick acts later, when the device is elsewhere.
    const double time = row.time + late;
    while (after + 1 < experiment.rows.size() && experiment.rows[after].time < time) ++after;
    const TickRow& next = experiment.rows[after];
    const TickRow& last = experiment.rows[after - std::min<std::size_t>(after, 1)];
    const double span = next.time - last.time;
    const double share = span > 0 ? std::clamp((time - last.time) / span, 0.0, 1.0) : 1.0;
    row.force += cogging.force(last.position + share * (next.position - last.position));
  }
  return rows;
}

}  // namespace haptrace
