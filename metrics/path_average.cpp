#include "metrics/path_average.h"

#include "base/error.h"
#include "base/statistics.h"
#include "control/path/path.h"
#include "metrics/polyline.h"

#include <algorithm>
#include <array>
#include <boost/math/distributions/fisher_f.hpp>
#include <cmath>
#include <cstdint>
#include <fmt/format.h>
#include <limits>
#include <numeric>
#include <optional>

namespace haptrace {
namespace {

constexpr std::size_t kFewestPoints = 400, kMostPoints = 8000;
constexpr int kRounds = 8;
constexpr double kBand = 0.15;                        // largest difference of matched places, as a share of the length
constexpr double kPointsPerDiagonal = 110;            // of long paths: 1 mm on a box of 110 mm
constexpr double kLongestPath = 360;                  // in diagonals of its box
constexpr double kTangentWeight = 4.0 / (110 * 110);  // of a square of the diagonal
constexpr double kChord = 3.0 / 110;                  // half length of the chord of a tangent, in diagonals
constexpr double kShortest = 0.7, kLongest = 1.4;     // in lengths of the reference
constexpr double kCoarse = 0.07;                      // of the low-pass for lengths: standard deviation, in diagonals
constexpr double kCostlier = 3, kNear = 0.08, kFar = 0.12;  // see require_same_movement()
constexpr double kSlow = 0.05, kBriefest = 0.1;             // of a pause: share of the median speed, and duration [s]

/// A path at evenly spaced places.
struct Shape {
  std::vector<Vec3> point, tangent;
  std::vector<double> arc;  ///< of each point on the copy, with the noise of the copy [m]; a mean has none
  double length = 0;

  [[nodiscard]] std::size_t size() const noexcept { return point.size(); }
  [[nodiscard]] double spacing() const noexcept { return length / static_cast<double>(size() - 1); }
};

/// Returns the direction of the chord of 2 `chord` [m] about point `i`.
Vec3 direction_at(const Shape& shape, std::size_t i, double chord) {
  const auto reach = static_cast<std::size_t>(std::max(1.0, std::round(chord / shape.spacing())));
  return (shape.point[std::min(i + reach, shape.size() - 1)] - shape.point[i - std::min(i, reach)]).stableNormalized();
}

/// Sets the tangents to the directions of chords of 2 `chord` [m], which noise hardly turns.
void set_tangents(Shape& shape, double chord) {
  shape.tangent.resize(shape.size());
  for (std::size_t i = 0; i < shape.size(); ++i) shape.tangent[i] = direction_at(shape, i, chord);
}

double length_of(const std::vector<Vec3>& points) noexcept {
  double length = 0;
  for (std::size_t i = 1; i < points.size(); ++i) length += (points[i] - points[i - 1]).norm();
  return length;
}

/// Returns the points after a Gaussian low-pass with this standard deviation [points]. The ends stay, because the curve
/// is continued by its reflection about them.
std::vector<Vec3> smoothed(const std::vector<Vec3>& points, double sigma) {
  const auto last = static_cast<std::ptrdiff_t>(points.size()) - 1, reach = std::min(std::lround(3 * sigma), last);
  std::vector<double> weight;
  for (std::ptrdiff_t k = 0; k <= reach; ++k)
    weight.push_back(std::exp(-0.5 * std::pow(static_cast<double>(k) / sigma, 2)));
  const double sum = 2 * std::accumulate(weight.begin(), weight.end(), 0.0) - weight[0];
  const auto at = [&](std::ptrdiff_t i) -> Vec3 {
    if (i < 0) return 2 * points.front() - points[static_cast<std::size_t>(-i)];
    if (i > last) return 2 * points.back() - points[static_cast<std::size_t>(2 * last - i)];
    return points[static_cast<std::size_t>(i)];
  };
  std::vector<Vec3> result(points.size());
  for (std::ptrdiff_t i = 0; i <= last; ++i) {
    Vec3 value = weight[0] * at(i);
    for (std::ptrdiff_t k = 1; k <= reach; ++k) value += weight[static_cast<std::size_t>(k)] * (at(i - k) + at(i + k));
    result[static_cast<std::size_t>(i)] = value / sum;
  }
  return result;
}

/// A copy without the noise that makes it longer.
struct CleanCopy {
  std::vector<Vec3> point;  ///< at places that are evenly spaced along the copy with its noise
  double arc = 0;           ///< length of the copy with its noise [m]
  double length = 0;        ///< [m]
};

/// Removes the noise of a copy at its own scale: by the narrowest of Gaussian low-passes along the arc length, each
/// twice as wide as the one before, after which the next one shortens the copy by less than a sixth, and all of them by
/// less than half. The widest has 3 % of the box, so that details of a path stay. An ordinary recording stays as it is.
CleanCopy clean(const ArcPath& path) {
  constexpr double kFiner = 8;  // than the points of a shape
  constexpr double kStep = 1.2, kWhole = 2, kWidest = 0.03;
  const auto parts = static_cast<std::size_t>(kFiner * std::clamp(kPointsPerDiagonal * path.length() / path.diagonal(),
                                                                  double{kFewestPoints}, double{kMostPoints}));
  CleanCopy copy{.arc = path.length()};
  for (std::size_t i = 0; i <= parts; ++i)
    copy.point.push_back(path.position_at(copy.arc * static_cast<double>(i) / static_cast<double>(parts)));
  std::vector<std::vector<Vec3>> scales{std::move(copy.point)};
  std::vector<double> lengths{length_of(scales.back())};
  double before = 0;  // standard deviation of the low-pass so far [points]
  for (double sigma = 2; sigma * lengths.back() <= kWidest * path.diagonal() * static_cast<double>(parts) &&
                         3 * sigma < static_cast<double>(parts);
       sigma *= 2) {
    scales.push_back(smoothed(scales.back(), std::sqrt(sigma * sigma - before * before)));
    lengths.push_back(length_of(scales.back()));
    before = sigma;
  }
  std::size_t k = 0;
  while (k + 1 < lengths.size() && (lengths[k] > kStep * lengths[k + 1] || lengths[k] > kWhole * lengths.back())) ++k;
  copy.point = std::move(scales[k]);
  copy.length = lengths[k];
  return copy;
}

/// Returns the lengths of the copies after one low-pass of kCoarse for all [m]. Noise and tremor below this scale do
/// not lengthen them.
std::vector<double> coarse_lengths(std::span<const CleanCopy> copies, double diagonal) {
  std::vector<double> lengths;
  for (const CleanCopy& copy : copies) lengths.push_back(copy.length);
  const double share = std::min(kCoarse * diagonal / median(lengths), 0.1);
  for (std::size_t i = 0; i < copies.size(); ++i)
    lengths[i] = length_of(smoothed(copies[i].point, share * static_cast<double>(copies[i].point.size())));
  return lengths;
}

/// Returns `points` evenly spaced points of a copy.
Shape shape_of(const CleanCopy& copy, std::size_t points, double chord) {
  Shape shape{.length = copy.length};
  const std::size_t parts = copy.point.size() - 1;
  double before = 0;  // length up to the part
  std::size_t part = 0;
  for (std::size_t i = 0; i < points; ++i) {
    const double s = copy.length * static_cast<double>(i) / static_cast<double>(points - 1);
    double step = (copy.point[part + 1] - copy.point[part]).norm();
    for (; before + step < s && part + 1 < parts; step = (copy.point[part + 1] - copy.point[part]).norm()) {
      before += step;
      ++part;
    }
    const double share = step > 0 ? std::clamp((s - before) / step, 0.0, 1.0) : 0;
    shape.point.emplace_back(copy.point[part] + share * (copy.point[part + 1] - copy.point[part]));
    shape.arc.push_back(copy.arc * (static_cast<double>(part) + share) / static_cast<double>(parts));
  }
  set_tangents(shape, chord);
  return shape;
}

/// Returns the curve through `points` at as many evenly spaced places.
Shape even(const std::vector<Vec3>& points, double chord) {
  const Polyline curve(points);
  Shape shape{.length = curve.length()};
  for (std::size_t i = 0; i < points.size(); ++i)
    shape.point.push_back(curve.at(curve.length() * static_cast<double>(i) / static_cast<double>(points.size() - 1)));
  set_tangents(shape, chord);
  return shape;
}

/// Alignment of a copy with a reference of as many points.
struct Warp {
  std::vector<double> place;  ///< place in the copy of each point of the reference, in points; increases
  double cost = 0;            ///< mean along the alignment [m^2]
};

/// Finds the cheapest alignment, see average_paths(). Both shapes have the same number of points.
class Warper {
 public:
  Warper(const Shape& reference, const Shape& copy, double tangent_weight)
      : a_(reference),
        b_(copy),
        weight_(tangent_weight),
        n_(static_cast<std::ptrdiff_t>(reference.size())),
        radius_(std::max<std::ptrdiff_t>(2, std::llround(kBand * static_cast<double>(n_)))),
        width_(2 * radius_ + 1 + 2 * kMargin),
        step_(static_cast<std::size_t>(n_ * width_), kNone) {}

  Warp run() {
    constexpr double kOutOfReach = std::numeric_limits<double>::infinity();
    const std::vector<double> out(static_cast<std::size_t>(width_), kOutOfReach);
    std::array<std::vector<double>, 3> rows{out, out, out};  // sums at i, i - 1 and i - 2
    for (std::ptrdiff_t i = 0; i < n_; ++i) {
      rows[0] = out;
      for (std::ptrdiff_t j = std::max<std::ptrdiff_t>(i - radius_, 0); j <= std::min(i + radius_, n_ - 1); ++j)
        fill(i, j, rows);
      std::rotate(rows.begin(), rows.end() - 1, rows.end());
    }
    const double sum = rows[1][column(n_ - 1, n_ - 1)];
    return {.place = trace(), .cost = sum / static_cast<double>(n_)};
  }

 private:
  static constexpr std::ptrdiff_t kMargin = 1;  // cells out of reach on both sides of the band
  enum Step : std::uint8_t { kNone, kBoth, kCopyTwice, kReferenceTwice };

  [[nodiscard]] std::size_t column(std::ptrdiff_t i, std::ptrdiff_t j) const noexcept {
    return static_cast<std::size_t>(j - i + radius_ + kMargin);
  }
  [[nodiscard]] Step& step(std::ptrdiff_t i, std::ptrdiff_t j) noexcept {
    return step_[static_cast<std::size_t>(i * width_) + column(i, j)];
  }

  void fill(std::ptrdiff_t i, std::ptrdiff_t j, std::array<std::vector<double>, 3>& rows) noexcept {
    const auto p = static_cast<std::size_t>(i), q = static_cast<std::size_t>(j);
    const double cost = (a_.point[p] - b_.point[q]).squaredNorm() + weight_ * (1 - a_.tangent[p].dot(b_.tangent[q]));
    const std::size_t at = column(i, j);
    if (i == 0) {
      if (j == 0) rows[0][at] = cost;
      return;
    }
    constexpr double kLongStep = 1.5;  // mean length of a step that advances one by two
    const double both = rows[1][at] + cost, copy = rows[1][at - 1] + kLongStep * cost,
                 reference = rows[2][at + 1] + kLongStep * cost;
    rows[0][at] = std::min({both, copy, reference});
    step(i, j) = both <= copy && both <= reference ? kBoth : copy <= reference ? kCopyTwice : kReferenceTwice;
  }

  [[nodiscard]] std::vector<double> trace() {
    std::vector<double> place(static_cast<std::size_t>(n_));
    std::ptrdiff_t i = n_ - 1, j = n_ - 1;
    while (i > 0) {
      place[static_cast<std::size_t>(i)] = static_cast<double>(j);
      const Step taken = step(i, j);
      if (taken == kReferenceTwice) place[static_cast<std::size_t>(i - 1)] = static_cast<double>(j) - 0.5;
      i -= taken == kReferenceTwice ? 2 : 1;
      j -= taken == kCopyTwice ? 2 : 1;
    }
    place[0] = 0;
    return place;
  }

  const Shape& a_;
  const Shape& b_;
  double weight_;
  std::ptrdiff_t n_, radius_, width_;
  std::vector<Step> step_;  ///< step that led to each cell of the band
};

Warp warp(const Shape& reference, const Shape& copy, double tangent_weight) {
  return Warper(reference, copy, tangent_weight).run();
}

/// Returns the value at a fractional index.
Vec3 between(const std::vector<Vec3>& values, double place) {
  const auto i = std::min(static_cast<std::size_t>(place), values.size() - 2);
  return values[i] + (place - static_cast<double>(i)) * (values[i + 1] - values[i]);
}

/// Returns the rms distance of the matched points [m].
double distance_of(const Shape& reference, const Shape& copy, const Warp& warp) {
  double squares = 0;
  for (std::size_t i = 0; i < reference.size(); ++i)
    squares += (between(copy.point, warp.place[i]) - reference.point[i]).squaredNorm();
  return std::sqrt(squares / static_cast<double>(reference.size()));
}

/// Returns the mean cosine of the angle between matched directions, over chords of 2 `chord` [m].
double agreement_of(const Shape& reference, const Shape& copy, const Warp& warp, double chord) {
  double sum = 0;
  for (std::size_t i = 0; i < reference.size(); ++i)
    sum += direction_at(reference, i, chord).dot(direction_at(copy, static_cast<std::size_t>(warp.place[i]), chord));
  return sum / static_cast<double>(reference.size());
}

Shape reversed(Shape shape) {
  std::reverse(shape.point.begin(), shape.point.end());
  std::reverse(shape.tangent.begin(), shape.tangent.end());
  for (Vec3& tangent : shape.tangent) tangent = -tangent;
  return shape;
}

Error other_movement(const std::string& name, const std::string& why) {
  return input_error(
      fmt::format("{}: shows another movement than the others. {}. Leave it out, or record it again", name, why));
}

void require_length(const PathCopy& copy) {
  if (!(copy.path->length() > 0))
    throw input_error(fmt::format("{}: does not move, so it has no path to average or to compare", copy.name));
}

/// `coarse` and `usual`: coarse lengths of the copy and of the others [m].
void require_like_length(const std::string& name, const CleanCopy& copy, double coarse, double usual) {
  const double ratio = coarse / usual;
  if (ratio >= kShortest && ratio <= kLongest) return;
  throw other_movement(name, fmt::format("It is {:.0f} mm long, {:.2f} times as long as the others, and {:g} to "
                                         "{:g} times are accepted; it may have another number of laps",
                                         1e3 * copy.length, ratio, kShortest, kLongest));
}

/// Returns the median of the costs; of an even number the smaller middle one, so that one of two is not its own norm.
double typical(std::vector<double> costs) {
  const auto middle = costs.begin() + static_cast<std::ptrdiff_t>((costs.size() - 1) / 2);
  std::nth_element(costs.begin(), middle, costs.end());
  return *middle;
}

/// Warps shapes onto a reference and refuses those of another movement.
void require_same_shape(const Shape& reference, std::span<const PathCopy> copies, std::span<const Shape> shapes,
                        double diagonal) {
  if (copies.empty()) return;
  const double weight = kTangentWeight * diagonal * diagonal;
  std::vector<Warp> warps;
  std::vector<double> costs;
  for (const Shape& shape : shapes) {
    warps.push_back(warp(reference, shape, weight));
    costs.push_back(warps.back().cost);
  }
  const double usual = typical(costs);
  // The worst copy is named first: the others may fail only because of it.
  const auto worst = static_cast<std::size_t>(std::max_element(costs.begin(), costs.end()) - costs.begin());
  const double distance = distance_of(reference, shapes[worst], warps[worst]);
  const bool turned = agreement_of(reference, shapes[worst], warps[worst], kCoarse * diagonal) < 0.5;
  const bool outlier = costs[worst] > kCostlier * usual && distance > kNear * diagonal;
  if (!turned && !outlier && distance <= kFar * diagonal) return;
  std::string why = fmt::format("After alignment it is {:.1f} mm away (rms)", 1e3 * distance);
  if (outlier && usual > 0)
    why += fmt::format(", and its alignment costs {:.1f} times as much as usual", costs[worst] / usual);
  if (warp(reference, reversed(shapes[worst]), weight).cost < costs[worst] / kCostlier)
    why += ". It runs in the opposite direction";
  throw other_movement(copies[worst].name, why);
}

/// The time of a copy along its path, without its pauses.
class MovingTime {
 public:
  struct Pause {
    double s = 0, duration = 0;  ///< [m], [s]
  };

  explicit MovingTime(const ArcPath& path) : path_(path) {
    const std::size_t segments = path.knots() - 1;
    std::vector<double> pace;  // [s/m]
    for (std::size_t i = 0; i < segments; ++i) pace.push_back(time_on(i) / length_of(i));
    const double usual = median(pace);
    moving_.push_back(0);
    for (std::size_t i = 0; i < segments;) {
      std::size_t end = i;
      double rest = 0;
      for (; end < segments && pace[end] * kSlow > usual; ++end) rest += time_on(end);
      const bool pauses = rest >= kBriefest;
      if (pauses) pauses_.push_back({0.5 * (path.knot_at(i) + path.knot_at(end)), rest});
      for (end = std::max(end, i + 1); i < end; ++i)
        moving_.push_back(moving_.back() + (pauses ? usual / kSlow * length_of(i) : time_on(i)));
    }
  }

  [[nodiscard]] double at(double s) const noexcept {
    const std::size_t i = path_.segment_at(s);
    return std::lerp(moving_[i], moving_[i + 1], std::clamp((s - path_.knot_at(i)) / length_of(i), 0.0, 1.0));
  }

  [[nodiscard]] const std::vector<Pause>& pauses() const noexcept { return pauses_; }

 private:
  [[nodiscard]] double time_on(std::size_t i) const noexcept {
    return path_.time_at(path_.knot_at(i + 1)) - path_.time_at(path_.knot_at(i));
  }
  [[nodiscard]] double length_of(std::size_t i) const noexcept { return path_.knot_at(i + 1) - path_.knot_at(i); }

  const ArcPath& path_;
  std::vector<double> moving_;  ///< at each knot [s]
  std::vector<Pause> pauses_;
};

/// Averages copies that show one movement.
class Averaging {
 public:
  Averaging(std::span<const PathCopy> copies, std::span<const CleanCopy> cleaned, std::size_t points, double diagonal)
      : copies_(copies), diagonal_(diagonal), chord_(kChord * diagonal) {
    for (const CleanCopy& copy : cleaned) shapes_.push_back(shape_of(copy, points, chord_));
  }

  AveragedPath run(std::size_t medoid) {
    mean_ = shapes_[medoid];
    for (int round = 0; round < kRounds; ++round) {
      align();
      std::vector<Vec3> points(mean_.size(), Vec3::Zero());
      for (std::size_t k = 0; k < shapes_.size(); ++k)
        for (std::size_t i = 0; i < points.size(); ++i)
          points[i] += between(shapes_[k].point, warps_[k].place[i]) / static_cast<double>(shapes_.size());
      mean_ = even(points, chord_);
    }
    align();
    remove_noise();
    result_.medoid = medoid;
    result_.position = mean_.point;
    for (std::size_t i = 0; i < mean_.size(); ++i) result_.arc.push_back(mean_.spacing() * static_cast<double>(i));
    for (std::size_t k = 0; k < shapes_.size(); ++k)
      result_.agreement.push_back({distance_of(mean_, shapes_[k], warps_[k]), shapes_[k].length / mean_.length});
    add_force();
    add_time();
    add_spread();
    return std::move(result_);
  }

 private:
  void align() {
    warps_.clear();
    for (const Shape& shape : shapes_) warps_.push_back(warp(mean_, shape, kTangentWeight * diagonal_ * diagonal_));
  }

  /// Returns the share by which the noise that the mean still has makes it longer. If the deviations of the copies
  /// from the mean turn them by d' = |dq/ds| across it, their noise is sqrt(n / (n - 1)) as large, and sqrt(n) times as
  /// large as that of the mean.
  [[nodiscard]] double excess() const noexcept {
    double sum = 0;
    for (std::size_t i = 1; i < mean_.size(); ++i) {
      double squares = 0;
      for (std::size_t k = 0; k < shapes_.size(); ++k) {
        const Vec3 turn = (offset(k, i) - offset(k, i - 1)) / mean_.spacing();
        squares += (turn - turn.dot(mean_.tangent[i]) * mean_.tangent[i]).squaredNorm();
      }
      const auto n = static_cast<double>(shapes_.size());
      sum += std::sqrt(1 + squares / (n * (n - 1))) - 1;
    }
    return sum / static_cast<double>(mean_.size() - 1);
  }

  /// Returns the deviation of copy `k` from point `i` of the mean [m].
  [[nodiscard]] Vec3 offset(std::size_t k, std::size_t i) const noexcept {
    return between(shapes_[k].point, warps_[k].place[i]) - mean_.point[i];
  }

  /// Shortens the mean by what its noise added, with the narrowest low-pass that does so, at most 2 kChord wide.
  void remove_noise() {
    constexpr double kNegligible = 5e-4;
    constexpr int kSteps = 12;
    const double share = excess(), goal = mean_.length / (1 + share);
    if (share < kNegligible) return;
    double low = 0, high = 2 * chord_ / mean_.spacing();  // [points]
    std::vector<Vec3> points;
    for (int step = 0; step < kSteps; ++step) {
      const double sigma = 0.5 * (low + high);
      points = smoothed(mean_.point, sigma);
      (length_of(points) > goal ? low : high) = sigma;
    }
    mean_ = even(points, chord_);
    align();
  }

  /// Returns the arc length on copy `k` at a place of its shape [m].
  [[nodiscard]] double arc_at(std::size_t k, double place) const noexcept {
    const std::vector<double>& arc = shapes_[k].arc;
    const auto i = std::min(static_cast<std::size_t>(place), arc.size() - 2);
    return std::lerp(arc[i], arc[i + 1], place - static_cast<double>(i));
  }

  void add_force() {
    constexpr int kParts = 4;  // of a point's surroundings, over which a copy's force is averaged
    result_.force.assign(mean_.size(), Vec3::Zero());
    for (std::size_t k = 0; k < shapes_.size(); ++k)
      for (std::size_t i = 0; i < mean_.size(); ++i)
        for (int part = 0; part < kParts; ++part) {
          const double beside = (part + 0.5) / kParts - 0.5;
          const double place = std::clamp(warps_[k].place[i] + beside, 0.0, static_cast<double>(mean_.size() - 1));
          result_.force[i] +=
              copies_[k].path->at(arc_at(k, place)).force / (kParts * static_cast<double>(shapes_.size()));
        }
  }

  void add_time() {
    std::vector<MovingTime> times;
    for (const PathCopy& copy : copies_) times.emplace_back(*copy.path);
    // Time per length of the mean: a copy whose noise makes it longer does not slow it down.
    std::vector<double> pace(mean_.size());
    for (std::size_t i = 0; i < mean_.size(); ++i) {
      std::vector<double> values;
      for (std::size_t k = 0; k < shapes_.size(); ++k) {
        constexpr double kReach = 2;  // [points]
        const double place = warps_[k].place[i];
        const double from = std::max(place - kReach, 0.0),
                     to = std::min(place + kReach, static_cast<double>(mean_.size() - 1));
        values.push_back((times[k].at(arc_at(k, to)) - times[k].at(arc_at(k, from))) / ((to - from) * mean_.spacing()));
      }
      pace[i] = median(std::move(values));
    }
    result_.time.assign(1, 0);
    for (std::size_t i = 1; i < mean_.size(); ++i)
      result_.time.push_back(result_.time.back() + mean_.spacing() * 0.5 * (pace[i - 1] + pace[i]));
    add_pauses(times);
  }

  /// Joins the pauses of the copies at one place of the mean.
  void add_pauses(const std::vector<MovingTime>& times) {
    struct Rest {
      double arc, duration;
      std::size_t copy;
    };
    std::vector<Rest> rests;
    const double end = 0.01 * mean_.length;
    for (std::size_t k = 0; k < times.size(); ++k)
      for (const MovingTime::Pause& pause : times[k].pauses()) {
        std::size_t i = 0;
        while (i + 1 < mean_.size() && arc_at(k, warps_[k].place[i]) < pause.s) ++i;
        const double arc = mean_.spacing() * static_cast<double>(i);
        if (arc > end && arc < mean_.length - end) rests.push_back({arc, pause.duration, k});
      }
    std::sort(rests.begin(), rests.end(), [](const Rest& a, const Rest& b) { return a.arc < b.arc; });
    for (auto first = rests.begin(); first != rests.end();) {
      const auto last =
          std::find_if(first, rests.end(), [&](const Rest& rest) { return rest.arc > first->arc + 3 * chord_; });
      std::vector<double> durations(times.size(), 0);
      double arc = 0;
      for (auto rest = first; rest != last; ++rest) {
        durations[rest->copy] += rest->duration;
        arc += rest->arc / static_cast<double>(last - first);
      }
      const auto resting = times.size() - static_cast<std::size_t>(std::count(durations.begin(), durations.end(), 0.0));
      if (2 * resting >= times.size()) result_.pauses.push_back({arc, median(std::move(durations)), resting});
      first = last;
    }
  }

  void add_spread() {
    const auto n = static_cast<double>(shapes_.size());
    std::vector<double> sums{0};  // of the variance up to each point
    Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
    Vec3 side = mean_.tangent.front().unitOrthogonal();
    for (std::size_t i = 0; i < mean_.size(); ++i) {
      const Vec3& tangent = mean_.tangent[i];
      const Vec3 turned = side - side.dot(tangent) * tangent;
      side = turned.squaredNorm() > 1e-6 ? Vec3(turned.normalized()) : tangent.unitOrthogonal();  // about a cusp
      const Vec3 other = tangent.cross(side);
      double squares = 0;
      for (std::size_t k = 0; k < shapes_.size(); ++k) {
        const Vec3 off = offset(k, i);
        const Eigen::Vector2d across(off.dot(side), off.dot(other));
        covariance += across * across.transpose();
        squares += across.squaredNorm();
      }
      sums.push_back(sums.back() + squares / (n - 1));
    }
    if (const double trace = covariance.trace(); trace > 0)
      result_.directions = trace * trace / (covariance * covariance).trace();
    constexpr double kPooled = 0.025;  // on either side, as a share of the length
    const auto reach = static_cast<std::size_t>(kPooled * static_cast<double>(mean_.size()));
    for (std::size_t i = 0; i < mean_.size(); ++i) {
      const std::size_t from = i - std::min(i, reach), to = std::min(i + reach + 1, mean_.size());
      result_.spread.push_back(std::sqrt((sums[to] - sums[from]) / static_cast<double>(to - from)));
    }
    result_.overall_spread = std::sqrt(sums.back() / static_cast<double>(mean_.size()));
  }

  std::span<const PathCopy> copies_;
  double diagonal_, chord_;
  std::vector<Shape> shapes_;
  Shape mean_;
  std::vector<Warp> warps_;
  AveragedPath result_;
};

/// Returns the copy with the smallest sum of costs to the others.
std::size_t medoid_of(std::span<const Shape> shapes, double tangent_weight) {
  std::vector<double> sums(shapes.size(), 0);
  for (std::size_t a = 0; a < shapes.size(); ++a)
    for (std::size_t b = a + 1; b < shapes.size(); ++b) {
      const double cost = warp(shapes[a], shapes[b], tangent_weight).cost;
      sums[a] += cost;
      sums[b] += cost;
    }
  return static_cast<std::size_t>(std::min_element(sums.begin(), sums.end()) - sums.begin());
}

}  // namespace

double prediction_factor(std::size_t copies, double directions) {
  if (copies < 2)
    throw input_error(fmt::format("a spread needs at least two recordings of the movement; there is {}", copies));
  const auto n = static_cast<double>(copies);
  const boost::math::fisher_f squares(directions, directions * (n - 1));
  return std::sqrt((1 + 1 / n) * boost::math::quantile(squares, 0.95));
}

void require_same_movement(const PathCopy& reference, std::span<const PathCopy> copies) {
  require_length(reference);
  const double diagonal = reference.path->diagonal(), chord = kChord * diagonal;
  std::vector<CleanCopy> cleaned{clean(*reference.path)};
  for (const PathCopy& copy : copies) {
    require_length(copy);
    cleaned.push_back(clean(*copy.path));
  }
  const std::vector<double> coarse = coarse_lengths(cleaned, diagonal);
  std::vector<Shape> shapes;
  for (std::size_t i = 0; i < copies.size(); ++i) {
    require_like_length(copies[i].name, cleaned[i + 1], coarse[i + 1], coarse[0]);
    shapes.push_back(shape_of(cleaned[i + 1], kFewestPoints, chord));
  }
  require_same_shape(shape_of(cleaned[0], kFewestPoints, chord), copies, shapes, diagonal);
}

AveragedPath average_paths(std::span<const PathCopy> copies) {
  if (copies.size() < 2)
    throw input_error(
        fmt::format("an average needs at least two recordings of the movement; there is {}", copies.size()));
  std::vector<CleanCopy> cleaned;
  std::vector<double> lengths, diagonals;
  for (const PathCopy& copy : copies) {
    require_length(copy);
    cleaned.push_back(clean(*copy.path));
    lengths.push_back(cleaned.back().length);
    diagonals.push_back(copy.path->diagonal());
  }
  // With two copies, neither is the norm: each is compared with the other.
  const double length = median(lengths), diagonal = median(diagonals), chord = kChord * diagonal;
  if (length > kLongestPath * diagonal)
    throw input_error(
        fmt::format("{}: its path of {:.4g} m is more than {:g} times as long as its box is wide ({:.4g} m), too long "
                    "to be averaged. Average one repetition, or a part of it",
                    copies.front().name, length, kLongestPath, diagonal));
  const std::vector<double> coarse = coarse_lengths(cleaned, diagonal);
  std::vector<Shape> shapes;
  for (std::size_t i = 0; i < copies.size(); ++i) {
    require_like_length(copies[i].name, cleaned[i], coarse[i], typical(coarse));
    shapes.push_back(shape_of(cleaned[i], kFewestPoints, chord));
  }
  const std::size_t medoid = medoid_of(shapes, kTangentWeight * diagonal * diagonal);
  std::vector<PathCopy> others(copies.begin(), copies.end());
  std::vector<Shape> other_shapes = shapes;
  others.erase(others.begin() + static_cast<std::ptrdiff_t>(medoid));
  other_shapes.erase(other_shapes.begin() + static_cast<std::ptrdiff_t>(medoid));
  require_same_shape(shapes[medoid], others, other_shapes, diagonal);
  const auto points = static_cast<std::size_t>(
      std::ceil(std::clamp(kPointsPerDiagonal * length / diagonal, double{kFewestPoints}, double{kMostPoints})));
  return Averaging(copies, cleaned, points, diagonal).run(medoid);
}

}  // namespace haptrace
