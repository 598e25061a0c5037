#include "devices/haply/kinematics.h"

#include "base/error.h"

#include <cmath>

namespace haptrace {
namespace {

constexpr double kShortestLink = 1e-3, kLongestLink = 1;  // [m]
// Minima for a reached pose. In the workspaces of the calibrations the values are at least 0.6 and 0.3.
constexpr double kLeastCrossing = 0.05;  // |det N|
constexpr double kLeastArmLever = 0.02;  // |k| / l

double cross(const Vec2& a, const Vec2& b) {
  return a.x() * b.y() - a.y() * b.x();
}

}  // namespace

PantographKinematics::PantographKinematics(const PantographGeometry& geometry) : geometry_(geometry) {
  check_range("proximal", geometry.proximal, kShortestLink, kLongestLink, "m");
  check_range("distal", geometry.distal, kShortestLink, kLongestLink, "m");
  check_range("separation", geometry.separation, 0, kLongestLink, "m");
}

std::optional<PantographPose> PantographKinematics::at_angles(const Vec2& angles) const noexcept {
  const PantographGeometry& g = geometry_;
  const Vec2 along_1(std::cos(angles[0]), std::sin(angles[0])), along_2(std::cos(angles[1]), std::sin(angles[1]));
  const Vec2 a = g.proximal * along_1, b = Vec2(g.separation, 0) + g.proximal * along_2;
  const Vec2 base = b - a;
  const double half = 0.5 * base.norm(), square = g.distal * g.distal - half * half;
  if (!(square > 0 && half > 0)) return std::nullopt;
  const Vec2 position = 0.5 * (a + b) + std::sqrt(square) / (2 * half) * Vec2(-base.y(), base.x());

  Eigen::Matrix2d n;
  n.row(0) = (position - a) / g.distal;
  n.row(1) = (position - b) / g.distal;
  const Vec2 lever(n.row(0).dot(Vec2(-along_1.y(), along_1.x())), n.row(1).dot(Vec2(-along_2.y(), along_2.x())));
  const bool regular =
      cross(n.row(0), n.row(1)) > kLeastCrossing && -lever[0] > kLeastArmLever && lever[1] > kLeastArmLever;
  if (!regular) return std::nullopt;
  return PantographPose{angles, position, n.inverse() * (g.proximal * lever).asDiagonal()};
}

std::optional<PantographPose> PantographKinematics::at_position(const Vec2& position) const noexcept {
  const PantographGeometry& g = geometry_;
  Vec2 angles;
  for (int arm = 0; arm < 2; ++arm) {
    const Vec2 reach = position - Vec2(arm == 0 ? 0 : g.separation, 0);
    const double distance = reach.norm();
    const double cosine =
        (g.proximal * g.proximal + distance * distance - g.distal * g.distal) / (2 * g.proximal * distance);
    if (!(std::abs(cosine) < 1)) return std::nullopt;
    angles[arm] = std::atan2(reach.y(), reach.x()) + (arm == 0 ? 1 : -1) * std::acos(cosine);
  }
  auto pose = at_angles(angles);
  // For a position on the near side of the elbows, the same arms hold the handle elsewhere.
  if (!pose || (pose->position - position).norm() > 1e-9) return std::nullopt;
  return pose;
}

}  // namespace haptrace
