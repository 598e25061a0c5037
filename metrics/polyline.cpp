#include "metrics/polyline.h"

#include "base/error.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {

Polyline::Polyline(std::span<const Vec3> points) {
  for (const Vec3& p : points) {
    if (!is_finite(p)) continue;
    const double s = arc_.empty() ? 0 : arc_.back() + (p - points_.back()).norm();
    if (!arc_.empty() && !(s > arc_.back())) continue;
    points_.push_back(p);
    arc_.push_back(s);
  }
  if (points_.empty()) throw input_error("the curve has no finite point; it needs at least one");
}

std::size_t Polyline::segment_at(double s) const noexcept {
  const auto after = std::upper_bound(arc_.begin(), arc_.end(), s);
  const auto last = static_cast<std::ptrdiff_t>(arc_.size()) - 2;
  return static_cast<std::size_t>(
      std::clamp<std::ptrdiff_t>(after - arc_.begin() - 1, 0, std::max<std::ptrdiff_t>(last, 0)));
}

Vec3 Polyline::at(double s) const noexcept {
  if (!(s > 0)) return points_.front();
  if (s >= length()) return points_.back();
  const std::size_t i = segment_at(s);
  const double u = (s - arc_[i]) / (arc_[i + 1] - arc_[i]);
  return points_[i] + u * (points_[i + 1] - points_[i]);
}

double Polyline::nearest(const Vec3& point, double from, double to) const noexcept {
  from = std::clamp(from, 0.0, length());
  to = std::clamp(to, from, length());
  double best = from, least = (at(from) - point).squaredNorm();
  const std::size_t first = segment_at(from);
  // Bounds the smallest distance from above by a few points of the curve. A length along the curve is at least the
  // straight distance. So a point of the curve closer to a vertex, along the curve, than (distance of the vertex -
  // bound) cannot be the nearest, and most segments are skipped.
  constexpr std::size_t kStride = 16;
  constexpr double kRounding = 1 + 1e-9;
  double bound = least;
  for (std::size_t i = first + kStride; i < arc_.size() && arc_[i] <= to; i += kStride)
    bound = std::min(bound, (points_[i] - point).squaredNorm());
  bound = std::sqrt(bound) * kRounding;
  for (std::size_t i = first; i + 1 < arc_.size() && arc_[i] <= to; ++i) {
    const double size = arc_[i + 1] - arc_[i];
    const Vec3 along = (points_[i + 1] - points_[i]) / size;
    const double s =
        std::clamp(arc_[i] + along.dot(point - points_[i]), std::max(arc_[i], from), std::min(arc_[i + 1], to));
    const double distance = (points_[i] + (s - arc_[i]) * along - point).squaredNorm();
    if (distance < least) {
      least = distance;
      best = s;
      bound = std::min(bound, std::sqrt(least) * kRounding);
    }
    const double passed = arc_[i + 1] + (points_[i + 1] - point).norm() - bound;
    if (const auto next = std::lower_bound(arc_.begin() + static_cast<std::ptrdiff_t>(i + 1), arc_.end(), passed);
        next - arc_.begin() > static_cast<std::ptrdiff_t>(i + 2))
      i = static_cast<std::size_t>(next - arc_.begin()) - 2;
  }
  return best;
}

std::vector<Vec3> Polyline::resampled(double spacing) const {
  constexpr double kMostPoints = 1e7;
  const double steps = std::round(length() / spacing);
  if (!(spacing > 0) || !(steps < kMostPoints))
    throw input_error(fmt::format("a curve of {} m cannot be divided into steps of {} m", length(), spacing));
  if (length() == 0) return {points_.front()};
  const auto size = static_cast<std::size_t>(std::max(steps, 1.0)) + 1;
  std::vector<Vec3> points(size);
  for (std::size_t k = 0; k < size; ++k)
    points[k] = at(length() * static_cast<double>(k) / static_cast<double>(size - 1));
  return points;
}

Polyline Polyline::simplified(double tolerance) const {
  constexpr std::size_t kLongest = 1024;  // points within one segment
  const std::size_t last = points_.size() - 1;
  const auto straight = [&](std::size_t a, std::size_t b) {
    const Vec3 chord = points_[b] - points_[a];
    const double squared = chord.squaredNorm();
    for (std::size_t i = a + 1; i < b; ++i) {
      const Vec3 from = points_[i] - points_[a];
      const double share = squared > 0 ? std::clamp(from.dot(chord) / squared, 0.0, 1.0) : 0;
      if ((from - share * chord).squaredNorm() > tolerance * tolerance) return false;
    }
    return true;
  };
  std::vector<Vec3> kept{points_.front()};
  for (std::size_t a = 0; a < last;) {
    // Doubles the segment while it is straight, so that every point is tested a few times only.
    std::size_t length = 1;
    while (length < kLongest && a + 2 * length <= last && straight(a, a + 2 * length)) length *= 2;
    a = std::min(a + length, last);
    kept.push_back(points_[a]);
  }
  return Polyline(kept);
}

}  // namespace haptrace
