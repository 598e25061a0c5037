// A rational B-spline patch: its points and derivatives, and its trimming.
#pragma once

#include "base/types.h"
#include "formats/nurbs/nurbs_file.h"

#include <array>
#include <cstdint>
#include <vector>

namespace haptrace {

using Vec2 = Eigen::Vector2d;

/// A point of a surface S(u, v) [m], and its derivatives.
struct SurfaceJet {
  Vec3 s, u, v, uu, uv, vv;
};

/// Rational B-spline surface of degree 1 to 5. Real-time: jet() and side_of(). Threads: any number.
class NurbsPatch {
 public:
  /// `data` must have passed check_nurbs().
  explicit NurbsPatch(const NurbsData& data);

  /// Returns the point and its derivatives up to the second, by the recursion of Cox and de Boor and the quotient rule.
  /// Outside the domain, the nearest span continues.
  [[nodiscard]] SurfaceJet jet(double u, double v) const noexcept;

  [[nodiscard]] const Vec2& least() const noexcept { return least_; }
  [[nodiscard]] const Vec2& most() const noexcept { return most_; }
  /// Returns the number of spans between different knots in u or v.
  [[nodiscard]] int spans(std::size_t side) const noexcept;

 private:
  static constexpr std::size_t kMost = kMostNurbsDegree + 1;
  struct Basis {
    std::size_t first = 0;  ///< of the functions that are not zero
    std::array<double, kMost> value{}, d1{}, d2{};
  };
  void basis(std::size_t side, double x, Basis& basis) const noexcept;

  std::array<std::size_t, 2> degree_{}, count_{};
  std::array<std::vector<double>, 2> knots_;
  std::vector<Eigen::Vector4d> points_;  ///< multiplied with their weights; v runs fastest
  Vec2 least_, most_;
};

/// Returns the patches into which the lines of knots divide a patch along which its derivative jumps. Trimmed patches
/// stay whole.
std::vector<NurbsData> split_at_creases(NurbsData patch);

/// Where a trimmed patch is: between closed loops in (u, v), by the even-odd rule. Real-time: all but the construction.
class NurbsTrim {
 public:
  /// A straight part of a loop; the surface is on its left.
  struct Part {
    Vec2 from, to;
    std::uint32_t next = 0, before = 0;  ///< in the loop
  };
  static constexpr std::uint32_t kNone = 0xffffffff;

  NurbsTrim() = default;
  explicit NurbsTrim(const NurbsData& data);

  [[nodiscard]] bool empty() const noexcept { return parts_.empty(); }
  [[nodiscard]] const std::vector<Part>& parts() const noexcept { return parts_; }
  [[nodiscard]] bool holds(const Vec2& place) const noexcept;

  /// Cuts a step short where it leaves the surface. Returns the part of a loop where the step then ends, or kNone.
  [[nodiscard]] std::uint32_t stop(const Vec2& from, Vec2& to) const noexcept;
  /// Returns the part of a loop that is nearest to a place, in shares of the domain, and moves the place there.
  [[nodiscard]] std::uint32_t nearest(Vec2& place) const noexcept;

 private:
  static constexpr int kCells = 64;
  [[nodiscard]] int cell_of(double x, int axis) const noexcept;
  /// Returns whether the whole box around two places is known to be on the surface.
  [[nodiscard]] bool clear(const Vec2& a, const Vec2& b) const noexcept;

  std::vector<Part> parts_;
  Vec2 least_ = Vec2::Zero(), size_ = Vec2::Ones();
  std::vector<std::uint8_t> inside_;  ///< of cells: all of it is on the surface
};

}  // namespace haptrace
