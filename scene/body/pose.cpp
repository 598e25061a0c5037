#include "scene/body/pose.h"

#include <limits>

namespace haptrace {
namespace {

/// Returns the box around a turned box. Infinity times zero would be NaN, so an infinite side makes all sides infinite.
Box turned(const Eigen::Matrix3d& axes, const Vec3& centre, const Vec3& half) noexcept {
  const Vec3 reach =
      is_finite(half) ? Vec3(axes.cwiseAbs() * half) : Vec3(Vec3::Constant(std::numeric_limits<double>::infinity()));
  return {centre - reach, centre + reach};
}

}  // namespace

Box box_in_world(const Pose& pose, const Box& box) noexcept {
  const Vec3 half = 0.5 * box.size();
  if (!is_finite(half)) return turned(pose.axes, Vec3::Zero(), half);
  return turned(pose.axes, pose.position + pose.axes * box.center(), half);
}

Box box_in_frame(const Pose& pose, const Box& box) noexcept {
  return turned(pose.axes.transpose(), pose.place_of(box.center()), 0.5 * box.size());
}

}  // namespace haptrace
