#include "devices/falcon/kinematics.h"

#include "base/error.h"

#include <cmath>

namespace haptrace {
namespace {

constexpr double kShortestPart = 1e-3, kLongestPart = 1;  // [m]
constexpr double kLeastSpread = 0.1;   // spread of the legs: twice the area of the triangle of their directions
constexpr int kMostSteps = 20;         // steps of Newton's method; two or three are typical
constexpr double kLongestStep = 0.03;  // [m], so that no step jumps past the elbows
constexpr double kLastStep = 1e-8;     // [m]; the error after it is of the order of its square
// Minima for a reached pose. In a box of 80 mm around (0, 0, 0.12) the values are at least 0.15, 0.31 and 0.82.
constexpr double kLeastVolume = 0.02;  // |det N|
constexpr double kLeastLever = 0.02;   // k / a
constexpr double kLeastReach = 0.4;    // a shin's long sides as seen along the motor's axis, relative to b

}  // namespace

struct FalconKinematics::Legs {
  explicit Legs(const Vec3& theta) : angles(theta), cos(theta.array().cos()), sin(theta.array().sin()) {}
  Vec3 angles, cos, sin;
};

struct FalconKinematics::Shins {
  Vec3 excess;              ///< g [m]
  Vec3 reach;               ///< (q - d - e) / b; negative on the inner half of the torus, where no shin can be
  Vec3 rise;                ///< n_z; positive if the handle is in front of the elbow
  Vec3 lever;               ///< k / a
  Eigen::Matrix3d inverse;  ///< N^-1
  double volume = 0;        ///< det N
};

FalconKinematics::FalconKinematics(const FalconGeometry& geometry) : geometry_(geometry) {
  const FalconGeometry& g = geometry_;
  check_range("thigh", g.thigh, kShortestPart, kLongestPart, "m");
  check_range("shin", g.shin, kShortestPart, kLongestPart, "m");
  check_range("shin_offset", g.shin_offset, 0, kLongestPart, "m");
  check_range("handle_radius", g.handle_radius, -kLongestPart, kLongestPart, "m");
  check_range("handle_offset", g.handle_offset, -kLongestPart, kLongestPart, "m");
  check_range("base_radius", g.base_radius, -kLongestPart, kLongestPart, "m");
  check_range("base_offset", g.base_offset, -kLongestPart, kLongestPart, "m");
  for (int leg = 0; leg < 3; ++leg) check_range("azimuths", g.azimuths[leg], -7, 7, "rad");
  cos_ = g.azimuths.array().cos();
  sin_ = g.azimuths.array().sin();
  const auto turn = [this](int from, int to) { return cos_[from] * sin_[to] - sin_[from] * cos_[to]; };
  const double spread = turn(0, 1) + turn(1, 2) + turn(2, 0);
  if (std::abs(spread) < kLeastSpread) throw input_error("azimuths: two legs are at the same place, or nearly");
  orientation_ = std::copysign(1.0, spread);
  front_ = Vec3(0, 0, g.thigh + g.shin);
}

/// Returns the leg's end (U, V, z) in the leg's frame.
Vec3 FalconKinematics::leg_end(int leg, const Vec3& position) const noexcept {
  const FalconGeometry& g = geometry_;
  const double u = cos_[leg] * position.x() + sin_[leg] * position.y();
  const double v = cos_[leg] * position.y() - sin_[leg] * position.x();
  return {u + g.handle_radius - g.base_radius, v + g.handle_offset - g.base_offset, position.z()};
}

FalconKinematics::Shins FalconKinematics::shins(const Legs& legs, const Vec3& position) const noexcept {
  const FalconGeometry& g = geometry_;
  Shins shins;
  Eigen::Matrix3d n;  // a column for each leg
  for (int leg = 0; leg < 3; ++leg) {
    const Vec3 end = leg_end(leg, position);
    const double u = end.x() - g.thigh * legs.cos[leg], v = end.y(), w = end.z() - g.thigh * legs.sin[leg];
    const double q = std::sqrt(u * u + w * w), reach = q - g.shin_offset;
    const double length = std::sqrt(reach * reach + v * v), slant = reach / (length * q);
    const double n_u = slant * u, n_v = v / length, n_w = slant * w;
    shins.excess[leg] = length - g.shin;
    shins.reach[leg] = reach / g.shin;
    shins.rise[leg] = n_w;
    shins.lever[leg] = n_w * legs.cos[leg] - n_u * legs.sin[leg];
    n.col(leg) << cos_[leg] * n_u - sin_[leg] * n_v, sin_[leg] * n_u + cos_[leg] * n_v, n_w;
  }
  shins.inverse << n.col(1).cross(n.col(2)), n.col(2).cross(n.col(0)), n.col(0).cross(n.col(1));
  shins.volume = n.col(0).dot(shins.inverse.col(0));
  shins.inverse /= shins.volume;
  return shins;
}

std::optional<FalconPose> FalconKinematics::reached(const Legs& legs, const Vec3& position,
                                                    const Shins& shins) const noexcept {
  const bool in_front = position.z() > 0 && shins.rise.minCoeff() > 0;
  const bool regular = orientation_ * shins.volume > kLeastVolume && shins.lever.minCoeff() > kLeastLever &&
                       shins.reach.minCoeff() > kLeastReach;
  if (!in_front || !regular) return std::nullopt;
  return FalconPose{legs.angles, position, shins.inverse * (geometry_.thigh * shins.lever).asDiagonal()};
}

std::optional<FalconPose> FalconKinematics::at_position(const Vec3& position) const noexcept {
  const FalconGeometry& g = geometry_;
  Vec3 angles;
  for (int leg = 0; leg < 3; ++leg) {
    const Vec3 end = leg_end(leg, position);
    const double shin = g.shin_offset + std::sqrt(g.shin * g.shin - end.y() * end.y());
    const double square = end.x() * end.x() + end.z() * end.z();
    const double cosine = (square + g.thigh * g.thigh - shin * shin) / (2 * g.thigh * std::sqrt(square));
    if (!(std::abs(cosine) < 1)) return std::nullopt;
    angles[leg] = std::atan2(end.z(), end.x()) - std::acos(cosine);
  }
  const Legs legs(angles);
  return reached(legs, position, shins(legs, position));
}

std::optional<FalconPose> FalconKinematics::newton(const Legs& legs, Vec3 position) const noexcept {
  bool found = false;
  for (int steps = 0; steps < kMostSteps; ++steps) {
    const Shins now = shins(legs, position);
    if (found) return reached(legs, position, now);
    Vec3 step = -(now.inverse * now.excess);
    const double length = step.norm();
    if (!std::isfinite(length)) return std::nullopt;
    found = length < kLastStep;
    if (length > kLongestStep) step *= kLongestStep / length;
    position += step;
  }
  return std::nullopt;
}

std::optional<FalconPose> FalconKinematics::at_angles(const Vec3& angles, const Vec3& near) const noexcept {
  const Legs legs(angles);
  const auto pose = newton(legs, near);
  return pose ? pose : newton(legs, front_);
}

std::optional<FalconPose> FalconKinematics::at_angles(const Vec3& angles) const noexcept {
  return newton(Legs(angles), front_);
}

}  // namespace haptrace
