// A smooth field through the values of a volume.
#pragma once

#include "control/path/path.h"
#include "formats/volume/volume_file.h"

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

namespace haptrace {

/// Value of a field at a place, with its derivatives per metre.
struct FieldPoint {
  double value = 0;
  Vec3 gradient = Vec3::Zero();
  Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
};

/// A field through the values of a volume, which is padded so that every derivative exists up to one sample beyond its
/// border.
///
/// Order 3: the tricubic B-spline through the samples, C2 (Unser, Aldroubi and Eden 1993). Order 1: the trilinear
/// value, and the trilinear mean of the samples' central differences as its gradient; this gradient is continuous,
/// which that of the trilinear value is not.
///
/// Coordinates called index count samples; the first sample is at (kPad, kPad, kPad). Immutable. Real-time: all
/// functions of a place, except nearest with a large limit, whose time grows with the surface it looks at.
class ScalarField {
 public:
  static constexpr int kPad = 2;

  /// `change` turns a sample into a value of the field, `pad` a value at the border into one beyond it.
  ScalarField(const VolumeData& data, int order, const std::function<float(float)>& change,
              const std::function<float(float)>& pad);

  [[nodiscard]] int order() const noexcept { return order_; }
  [[nodiscard]] Vec3 index_of(const Vec3& place) const noexcept { return to_index_ * (place - origin_); }
  [[nodiscard]] Vec3 place_of(const Vec3& index) const noexcept { return origin_ + to_place_ * index; }
  /// Returns the distance of the planes through the samples along each axis [m].
  [[nodiscard]] const Vec3& spacing() const noexcept { return spacing_; }
  /// Returns the numbers of samples along the axes, those of the padding included.
  [[nodiscard]] const std::array<int, 3>& size() const noexcept { return size_; }

  /// Returns whether the field is defined at a place: within one sample from the border.
  [[nodiscard]] bool covers(const Vec3& place) const noexcept;
  /// Returns the field at a place; beyond what it covers, that of the nearest index.
  [[nodiscard]] FieldPoint at(const Vec3& place) const noexcept { return sample<true>(index_of(place)); }
  /// The same without the hessian, which is zero.
  [[nodiscard]] FieldPoint slope_at(const Vec3& place) const noexcept { return sample<false>(index_of(place)); }

  /// Returns the share of a step at which the field first becomes negative; above 1: nowhere. A step that begins where
  /// the field is negative enters at 0 if it goes deeper or stays there. Features thinner than a quarter of a cell are
  /// found by the turn of the slope along the step, and what is uniformly positive is passed in blocks.
  [[nodiscard]] double entered(const Vec3& from, const Vec3& to) const noexcept;

  /// Returns a place where the field is zero within `limit` [m] of a place, near the closest one; NaN if there is none.
  [[nodiscard]] Vec3 zero_near(const Vec3& place, double limit) const noexcept;

  /// Returns whether the sample at these indices is negative.
  [[nodiscard]] bool negative(int i, int j, int k) const noexcept {
    const std::size_t at = offset(i, j, k);
    return ((negative_[at >> 6U] >> (at & 63U)) & 1U) != 0;
  }
  /// Calls `visit` with the least indices of every cell whose corners have both signs.
  void each_zero_cell(const std::function<void(int, int, int)>& visit) const;

 private:
  static constexpr int kBlock = 8;  // cells along the side of a block
  class Ray;

  template <bool kHessian>
  [[nodiscard]] FieldPoint sample(const Vec3& index) const noexcept;
  [[nodiscard]] std::size_t offset(int i, int j, int k) const noexcept {
    return static_cast<std::size_t>(i) +
           static_cast<std::size_t>(size_[0]) *
               (static_cast<std::size_t>(j) + static_cast<std::size_t>(size_[1]) * static_cast<std::size_t>(k));
  }
  enum BlockSigns : std::uint8_t { kPositive = 1, kNegative = 2, kBoth = 3 };
  [[nodiscard]] std::uint8_t block(int i, int j, int k) const noexcept {
    return blocks_[static_cast<std::size_t>(i) +
                   static_cast<std::size_t>(blocks_along_[0]) *
                       (static_cast<std::size_t>(j) +
                        static_cast<std::size_t>(blocks_along_[1]) * static_cast<std::size_t>(k))];
  }
  [[nodiscard]] bool has_zero(int i, int j, int k) const noexcept;
  void prefilter();
  void bound_blocks();

  int order_;
  Vec3 origin_, spacing_;
  Eigen::Matrix3d to_place_, to_index_;
  std::array<int, 3> size_{}, blocks_along_{};
  std::vector<float> values_;  ///< coefficients of the spline, or samples
  std::vector<std::uint64_t> negative_;
  std::vector<std::uint8_t> blocks_;  ///< signs that the field can have in each block
};

}  // namespace haptrace
