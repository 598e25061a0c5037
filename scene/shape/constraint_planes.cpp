#include "scene/shape/constraint_planes.h"

#include <cmath>
#include <limits>

namespace haptrace {
namespace {

/// Returns whether a place is in front of all planes, but for rounding.
bool allowed(const Vec3& place, const ConstraintPlanes& planes) noexcept {
  constexpr double kRounding = 16 * std::numeric_limits<double>::epsilon();
  const double size = place.cwiseAbs().sum();
  for (std::size_t i = 0; i < planes.count; ++i)
    if (planes.normal[i].dot(place) < planes.height[i] - kRounding * (size + std::abs(planes.height[i]))) return false;
  return true;
}

}  // namespace

Vec3 nearest_in_front(const Vec3& goal, const ConstraintPlanes& planes) noexcept {
  if (allowed(goal, planes)) return goal;
  Vec3 best = goal;
  double least = std::numeric_limits<double>::infinity();
  const auto consider = [&](const Vec3& place) {
    const double square = (place - goal).squaredNorm();
    if (square < least && allowed(place, planes)) {
      best = place;
      least = square;
    }
  };
  const auto behind = [&](std::size_t i) { return planes.height[i] - planes.normal[i].dot(goal); };
  for (std::size_t i = 0; i < planes.count; ++i) consider(goal + behind(i) * planes.normal[i]);
  for (std::size_t i = 0; i < planes.count; ++i)
    for (std::size_t j = i + 1; j < planes.count; ++j) {
      const double cosine = planes.normal[i].dot(planes.normal[j]), determinant = 1 - cosine * cosine;
      if (!(determinant > 1e-12)) continue;
      const double a = behind(i), b = behind(j);
      consider(goal + ((a - cosine * b) * planes.normal[i] + (b - cosine * a) * planes.normal[j]) / determinant);
    }
  for (std::size_t i = 0; i < planes.count; ++i)
    for (std::size_t j = i + 1; j < planes.count; ++j)
      for (std::size_t k = j + 1; k < planes.count; ++k) {
        const Vec3 cross = planes.normal[j].cross(planes.normal[k]);
        const double determinant = planes.normal[i].dot(cross);
        if (std::abs(determinant) > 1e-12)
          consider((planes.height[i] * cross + planes.height[j] * planes.normal[k].cross(planes.normal[i]) +
                    planes.height[k] * planes.normal[i].cross(planes.normal[j])) /
                   determinant);
      }
  // Planes that leave no place, but for rounding: the deepest one decides.
  if (least < std::numeric_limits<double>::infinity()) return best;
  std::size_t deepest = 0;
  for (std::size_t i = 1; i < planes.count; ++i)
    if (behind(i) > behind(deepest)) deepest = i;
  return goal + behind(deepest) * planes.normal[deepest];
}

}  // namespace haptrace
