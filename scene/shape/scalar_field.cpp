#include "scene/shape/scalar_field.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace haptrace {
namespace {

/// Weights of four neighbouring samples for a value and its first two derivatives.
struct Weights {
  std::array<double, 4> value, first, second;
};

Weights weights(int order, double t) noexcept {
  const double s = 1 - t;
  if (order == 1) return {{0, s, t, 0}, {-0.5 * s, -0.5 * t, 0.5 * s, 0.5 * t}, {0.5, -0.5, -0.5, 0.5}};
  return {{s * s * s / 6, (4 - 3 * t * t * (2 - t)) / 6, (4 - 3 * s * s * (2 - s)) / 6, t * t * t / 6},
          {-0.5 * s * s, t * (1.5 * t - 2), s * (2 - 1.5 * s), 0.5 * t * t},
          {s, 3 * t - 2, 3 * s - 2, t}};
}

/// Four neighbouring samples.
struct Four {
  Four() = default;
  explicit Four(const float* values) noexcept {
    for (std::size_t i = 0; i < 4; ++i) at[i] = static_cast<double>(values[i]);
  }
  void add(double weight, const Four& other) noexcept {
    for (std::size_t i = 0; i < 4; ++i) at[i] += weight * other.at[i];
  }
  [[nodiscard]] double sum(const std::array<double, 4>& weights_of) const noexcept {
    return (weights_of[0] * at[0] + weights_of[1] * at[1]) + (weights_of[2] * at[2] + weights_of[3] * at[3]);
  }
  std::array<double, 4> at{};
};

}  // namespace

ScalarField::ScalarField(const VolumeData& data, int order, const std::function<float(float)>& change,
                         const std::function<float(float)>& pad)
    : order_(order), to_place_(data.steps), to_index_(data.steps.inverse()) {
  origin_ = data.origin - data.steps * Vec3::Constant(kPad);
  spacing_ = to_index_.rowwise().norm().cwiseInverse();
  std::array<int, 3> last{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    last[axis] = static_cast<int>(data.size[axis]) - 1;
    size_[axis] = last[axis] + 1 + 2 * kPad;
    blocks_along_[axis] = (size_[axis] - 3 + kBlock - 1) / kBlock;
  }
  values_.resize(offset(0, 0, size_[2]));
  negative_.assign(values_.size() / 64 + 1, 0);
  std::size_t at = 0;
  for (int k = -kPad; k <= last[2] + kPad; ++k)
    for (int j = -kPad; j <= last[1] + kPad; ++j)
      for (int i = -kPad; i <= last[0] + kPad; ++i, ++at) {
        const int a = std::clamp(i, 0, last[0]), b = std::clamp(j, 0, last[1]), c = std::clamp(k, 0, last[2]);
        float value =
            change(data.at(static_cast<std::size_t>(a), static_cast<std::size_t>(b), static_cast<std::size_t>(c)));
        if (a != i || b != j || c != k) value = pad(value);
        values_[at] = value;
        if (value < 0) negative_[at >> 6U] |= std::uint64_t{1} << (at & 63U);
      }
  if (order_ == 3) prefilter();
  bound_blocks();
}

/// Turns samples into coefficients: along each axis, by the inverse of (1, 4, 1) / 6 as two recursions. Their start is
/// inexact, at samples of the padding that nothing reads as values.
void ScalarField::prefilter() {
  const float pole = std::sqrt(3.0F) - 2, gain = 6;
  std::size_t inner = 1;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto count = static_cast<std::size_t>(size_[axis]);
    const std::size_t outer = values_.size() / (inner * count);
    for (std::size_t o = 0; o < outer; ++o) {
      float* const rows = values_.data() + o * inner * count;
      for (std::size_t i = 0; i < inner; ++i) rows[i] *= gain / (1 - pole);
      for (std::size_t k = 1; k < count; ++k) {
        float *const row = rows + k * inner, *const before = row - inner;
        for (std::size_t i = 0; i < inner; ++i) row[i] = gain * row[i] + pole * before[i];
      }
      float* const end = rows + (count - 1) * inner;
      for (std::size_t i = 0; i < inner; ++i) end[i] *= pole / (pole - 1);
      for (std::size_t k = count - 1; k-- > 0;) {
        float *const row = rows + k * inner, *const after = row + inner;
        for (std::size_t i = 0; i < inner; ++i) row[i] = pole * (after[i] - row[i]);
      }
    }
    inner *= count;
  }
}

/// A value is a mean of the coefficients around it with weights that are not negative, which bounds it.
void ScalarField::bound_blocks() {
  blocks_.clear();
  for (int c = 0; c < blocks_along_[2]; ++c)
    for (int b = 0; b < blocks_along_[1]; ++b)
      for (int a = 0; a < blocks_along_[0]; ++a) {
        // Cells 1 + 8 a and on, whose coefficients are from one before to two after.
        const auto most = [&](int axis, int index) {
          return std::min(size_[static_cast<std::size_t>(axis)] - 1, kBlock * (index + 1) + 2);
        };
        std::uint8_t signs = 0;
        for (int k = kBlock * c; k <= most(2, c); ++k)
          for (int j = kBlock * b; j <= most(1, b); ++j)
            for (int i = kBlock * a; i <= most(0, a); ++i)
              signs |= values_[offset(i, j, k)] < 0 ? kNegative : kPositive;
        blocks_.push_back(signs);
      }
}

bool ScalarField::covers(const Vec3& place) const noexcept {
  const Vec3 u = index_of(place);
  for (int axis = 0; axis < 3; ++axis)
    if (!(u[axis] >= 1 && u[axis] <= size_[static_cast<std::size_t>(axis)] - 2)) return false;
  return true;
}

template <bool kHessian>
FieldPoint ScalarField::sample(const Vec3& index) const noexcept {
  std::array<int, 3> cell{};
  std::array<Weights, 3> weight{};
  for (int axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<std::size_t>(axis);
    const double most = size_[a] - 2, u = std::clamp(index[axis], 1.0, most);
    cell[a] = std::min(static_cast<int>(u), size_[a] - 3);
    weight[a] = weights(order_, u - cell[a]);
  }
  const auto& [x, y, z] = weight;
  const std::size_t row = static_cast<std::size_t>(size_[0]), plane = row * static_cast<std::size_t>(size_[1]);
  const float* const first = values_.data() + offset(cell[0] - 1, cell[1] - 1, cell[2] - 1);
  // The sums along y and z first, of four neighbours along x at a time.
  Four all, by_y, by_z, by_yy, by_yz, by_zz;
  for (std::size_t k = 0; k < 4; ++k) {
    Four p, py, pyy;
    for (std::size_t j = 0; j < 4; ++j) {
      const Four c(first + k * plane + j * row);
      p.add(y.value[j], c);
      py.add(y.first[j], c);
      if constexpr (kHessian) pyy.add(y.second[j], c);
    }
    all.add(z.value[k], p);
    by_y.add(z.value[k], py);
    by_z.add(z.first[k], p);
    if constexpr (kHessian) {
      by_yy.add(z.value[k], pyy);
      by_yz.add(z.first[k], py);
      by_zz.add(z.second[k], p);
    }
  }
  FieldPoint point;
  point.value = all.sum(x.value);
  point.gradient = to_index_.transpose() * Vec3(all.sum(x.first), by_y.sum(x.value), by_z.sum(x.value));
  if constexpr (kHessian) {
    const double xy = by_y.sum(x.first), xz = by_z.sum(x.first), yz = by_yz.sum(x.value);
    Eigen::Matrix3d bend;
    bend << all.sum(x.second), xy, xz, xy, by_yy.sum(x.value), yz, xz, yz, by_zz.sum(x.value);
    point.hessian = to_index_.transpose() * bend * to_index_;
  }
  return point;
}

template FieldPoint ScalarField::sample<true>(const Vec3&) const noexcept;
template FieldPoint ScalarField::sample<false>(const Vec3&) const noexcept;

/// A step through the field, by the share of it that is done.
class ScalarField::Ray {
 public:
  Ray(const ScalarField& field, const Vec3& from, const Vec3& to) noexcept
      : field_(field), step_(to - from), a_(field.index_of(from)), way_(field.to_index_ * (to - from)) {
    constexpr double kPerCell = 4;  // looks at the field
    stride_ = 1 / (kPerCell * std::max(1e-9, way_.cwiseAbs().maxCoeff()));
    meets_ = clip();
  }

  /// Returns true if the step meets what the field covers, from begin() to end().
  [[nodiscard]] bool meets() const noexcept { return meets_; }
  [[nodiscard]] double begin() const noexcept { return begin_; }
  [[nodiscard]] double end() const noexcept { return end_; }
  [[nodiscard]] double stride() const noexcept { return stride_; }

  /// Returns the value of the field and its slope along the step.
  [[nodiscard]] std::pair<double, double> look(double t) const noexcept {
    const FieldPoint point = field_.sample<false>(a_ + t * way_);
    // The gradient of order 1 is not that of its value.
    const double slope = field_.order_ == 1 ? field_.sample<false>(a_ + (t + 1e-3 * stride_) * way_).value - point.value
                                            : point.gradient.dot(step_);
    return {point.value, slope};
  }

  /// Returns where the field becomes negative between two shares.
  [[nodiscard]] double crossing(double outside, double inside) const noexcept {
    for (int i = 0; i < kHalvings && inside - outside > 1e-15; ++i) {
      const double middle = 0.5 * (outside + inside);
      (look(middle).first < 0 ? inside : outside) = middle;
    }
    return outside;
  }

  /// Returns where the field becomes negative in a dip between two shares at which it is not; kNever: nowhere.
  [[nodiscard]] double crossing_in_dip(double left, double right) const noexcept {
    const double outside = left;
    for (int i = 0; i < kHalvings / 3; ++i) {
      const double middle = 0.5 * (left + right);
      const auto [least, turn] = look(middle);
      if (least < 0) return crossing(outside, middle);
      (turn < 0 ? left : right) = middle;
    }
    return kNever;
  }

  /// Returns where the step leaves the block of `t`, if the field is nowhere negative in it; else kNever.
  [[nodiscard]] double exit_of_positive_block(double t) const noexcept {
    const Vec3 u = a_ + t * way_;
    std::array<int, 3> home{};
    for (std::size_t axis = 0; axis < 3; ++axis)
      home[axis] =
          std::clamp((static_cast<int>(u[static_cast<int>(axis)]) - 1) / kBlock, 0, field_.blocks_along_[axis] - 1);
    if ((field_.block(home[0], home[1], home[2]) & kNegative) != 0) return kNever;
    double exit = end_;
    for (int axis = 0; axis < 3; ++axis) {
      if (way_[axis] == 0) continue;
      const int side = home[static_cast<std::size_t>(axis)] + (way_[axis] > 0 ? 1 : 0);
      exit = std::min(exit, (1 + kBlock * side - a_[axis]) / way_[axis]);
    }
    return exit;
  }

  static constexpr double kNever = 2;

 private:
  static constexpr int kHalvings = 60;

  bool clip() noexcept {
    for (int axis = 0; axis < 3; ++axis) {
      const double least = 1, most = field_.size_[static_cast<std::size_t>(axis)] - 2;
      if (way_[axis] == 0) {
        if (!(a_[axis] >= least && a_[axis] <= most)) return false;
        continue;
      }
      const double one = (least - a_[axis]) / way_[axis], other = (most - a_[axis]) / way_[axis];
      begin_ = std::max(begin_, std::min(one, other));
      end_ = std::min(end_, std::max(one, other));
    }
    return begin_ <= end_;
  }

  const ScalarField& field_;
  Vec3 step_;     ///< [m]
  Vec3 a_, way_;  ///< beginning and step, as indices
  double begin_ = 0, end_ = 1, stride_ = 0;
  bool meets_ = false;
};

double ScalarField::entered(const Vec3& from, const Vec3& to) const noexcept {
  const Ray ray(*this, from, to);
  if (!ray.meets()) return Ray::kNever;
  const double begin = ray.begin(), end = ray.end();
  double last = begin, last_slope = 0;
  bool outside = false, first = true;
  for (double t = begin;;) {
    if (const double exit = ray.exit_of_positive_block(t); exit < Ray::kNever) {
      outside = true;
      first = false;
      last = t;
      last_slope = 0;
      if (t >= end || exit >= end) return Ray::kNever;
      t = std::min(end, std::max(exit, t) + 1e-3 * ray.stride());
      continue;
    }
    const auto [value, slope] = ray.look(t);
    if (value < 0) {
      if (outside) return ray.crossing(last, t);
      // From beyond the grid, or from inside.
      if (first && (begin > 0 || slope < 0)) return t;
    } else if (outside && last_slope < 0 && slope > 0) {
      if (const double dip = ray.crossing_in_dip(last, t); dip < Ray::kNever) return dip;
    }
    outside = outside || value >= 0;
    first = false;
    last = t;
    last_slope = slope;
    if (t >= end) break;
    t = std::min(end, t + ray.stride());
  }
  return outside ? Ray::kNever : 0;
}

bool ScalarField::has_zero(int i, int j, int k) const noexcept {
  const bool sign = negative(i, j, k);
  for (int corner = 1; corner < 8; ++corner)
    if (negative(i + (corner & 1), j + ((corner >> 1) & 1), k + (corner >> 2)) != sign) return true;
  return false;
}

void ScalarField::each_zero_cell(const std::function<void(int, int, int)>& visit) const {
  for (int c = 0; c < blocks_along_[2]; ++c)
    for (int b = 0; b < blocks_along_[1]; ++b)
      for (int a = 0; a < blocks_along_[0]; ++a) {
        if (block(a, b, c) != kBoth) continue;
        const auto end = [&](std::size_t axis, int index) {
          return std::min(size_[axis] - 2, 1 + kBlock * (index + 1));
        };
        for (int k = 1 + kBlock * c; k < end(2, c); ++k)
          for (int j = 1 + kBlock * b; j < end(1, b); ++j)
            for (int i = 1 + kBlock * a; i < end(0, a); ++i)
              if (has_zero(i, j, k)) visit(i, j, k);
      }
}

Vec3 ScalarField::zero_near(const Vec3& place, double limit) const noexcept {
  const Vec3 u = index_of(place);
  std::array<int, 3> home{};
  int rings = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double own = std::clamp(u[static_cast<int>(axis)], 1.0, static_cast<double>(size_[axis]));
    home[axis] = std::clamp((static_cast<int>(own) - 1) / kBlock, 0, blocks_along_[axis] - 1);
    rings = std::max({rings, home[axis], blocks_along_[axis] - 1 - home[axis]});
  }
  // Not below the distance from a place to a box of cells.
  const auto far = [&](const std::array<int, 3>& least, int cells) {
    double distance = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const double low = least[static_cast<std::size_t>(axis)];
      distance = std::max(distance, spacing_[axis] * std::max(low - u[axis], u[axis] - low - cells));
    }
    return distance;
  };
  Vec3 best = nan3();
  double distance = limit;
  const auto search_cell = [&](int i, int j, int k) {
    if (!has_zero(i, j, k) || far({i, j, k}, 1) >= distance) return;
    // Along the gradient from where the place is nearest to the middle of the cell, and not far out of it.
    const Vec3 middle(i + 0.5, j + 0.5, k + 0.5);
    Vec3 x = u.cwiseMax(middle - Vec3::Constant(0.5)).cwiseMin(middle + Vec3::Constant(0.5));
    for (int polish = 0; polish < 3; ++polish) {
      const FieldPoint point = sample<false>(x);
      const double steep = point.gradient.squaredNorm();
      if (!(steep > 0)) return;
      x -= to_index_ * (point.value / steep * point.gradient);
      if (!((x - middle).cwiseAbs().maxCoeff() < 1)) return;
    }
    const double own = (place_of(x) - place).norm();
    if (own < distance) {
      distance = own;
      best = place_of(x);
    }
  };
  const auto search_block = [&](int a, int b, int c) {
    const std::array<int, 3> least{1 + kBlock * a, 1 + kBlock * b, 1 + kBlock * c};
    if (block(a, b, c) != kBoth || far(least, kBlock) >= distance) return;
    for (int k = least[2]; k < std::min(size_[2] - 2, least[2] + kBlock); ++k)
      for (int j = least[1]; j < std::min(size_[1] - 2, least[1] + kBlock); ++j)
        for (int i = least[0]; i < std::min(size_[0] - 2, least[0] + kBlock); ++i) search_cell(i, j, k);
  };
  for (int ring = 0; ring <= rings; ++ring) {
    if (kBlock * (ring - 1) * spacing_.minCoeff() >= distance) break;
    for (int c = std::max(0, home[2] - ring); c <= std::min(blocks_along_[2] - 1, home[2] + ring); ++c)
      for (int b = std::max(0, home[1] - ring); b <= std::min(blocks_along_[1] - 1, home[1] + ring); ++b) {
        const bool whole = std::abs(c - home[2]) == ring || std::abs(b - home[1]) == ring;
        for (int a = home[0] - ring; a <= home[0] + ring; a += whole || ring == 0 ? 1 : 2 * ring)
          if (a >= 0 && a < blocks_along_[0]) search_block(a, b, c);
      }
  }
  return best;
}

}  // namespace haptrace
