#include "control/reaching.h"

#include "base/enum_names.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

constexpr EnumNames<ReachKind, 3> kReachKinds{"kind of reach", {"plain", "catch", "clamp"}};
constexpr EnumNames<ReachGoal, 5> kReachGoals{"goal of a reach", {"target", "range", "press", "track", "weigh"}};

}  // namespace

const char* to_string(ReachKind kind) noexcept {
  return kReachKinds.name(kind);
}

ReachKind parse_reach_kind(std::string_view name) {
  return kReachKinds.parse(name);
}

const char* to_string(ReachGoal goal) noexcept {
  return kReachGoals.name(goal);
}

ReachGoal parse_reach_goal(std::string_view name) {
  return kReachGoals.parse(name);
}

double TrackSignal::at(double t) const noexcept {
  double sum = 0;
  for (std::size_t k = 0; k < frequency.size(); ++k)
    sum += std::sin(2 * std::numbers::pi * frequency[k] * t + phase[k]);
  const double fade = t < kFadeIn ? std::sin(0.5 * std::numbers::pi * std::max(0.0, t) / kFadeIn) : 1;
  return fade * fade * sum / static_cast<double>(frequency.size());
}

Vec3 lateral_axis(const Vec3& start, const Vec3& target, const Vec3& normal, const Vec3& otherwise) noexcept {
  constexpr double kParallel = 1e-6;
  const Vec3 left = normal.cross((target - start).normalized());
  return left.norm() > kParallel ? left.normalized() : otherwise;
}

std::string too_near(double distance, double start_radius, double target_radius) {
  const double radii = start_radius + target_radius;
  if (distance > radii) return "";
  return fmt::format("is {:.1f} mm from the start, within start_radius and target_radius, which are {:.1f} mm together",
                     1e3 * distance, 1e3 * radii);
}

std::vector<Vec3> centre_out_targets(const Vec3& start, double distance, int count, double first_angle,
                                     const Vec3& right, const Vec3& up) {
  std::vector<Vec3> targets;
  for (int i = 0; i < count; ++i) {
    const double angle = first_angle + 2 * std::numbers::pi * i / count;
    targets.push_back(start + distance * (std::cos(angle) * right + std::sin(angle) * up));
  }
  return targets;
}

Eigen::Matrix3d curl_field(double b, const Vec3& normal) {
  Eigen::Matrix3d field;
  for (int axis = 0; axis < 3; ++axis) field.col(axis) = b * Vec3(Vec3::Unit(axis)).cross(normal);
  return field;
}

Eigen::Matrix3d plane_field(const Eigen::Matrix2d& matrix, const Vec3& right, const Vec3& up) {
  Eigen::Matrix<double, 3, 2> axes;
  axes << right, up;
  return axes * matrix * axes.transpose();
}

}  // namespace haptrace
