// What nobody verified of the Haply Inverse3, and a user can measure on his own.
#pragma once

#include "base/types.h"

#include <nlohmann/json.hpp>
#include <string>

namespace haptrace {

/// Where W lies in S, the frame of the Inverse Service, and what the arm bears. docs/devices/inverse3.md says where the
/// defaults come from and how to measure each.
///
/// Real-time: all members.
struct Inverse3Calibration {
  Eigen::Matrix3d axes{{1, 0, 0}, {0, 0, 1}, {0, -1, 0}};  ///< rows are W's axes in S, a rotation
  Vec3 origin = Vec3(0, -0.12, 0.15);                      ///< of W in S [m]
  Vec3 workspace = Vec3::Constant(0.057);                  ///< from the origin to either side, in W [m]
  double max_force = 10;                                   ///< magnitude [N]
  double max_continuous_force = 4;                         ///< magnitude [N]

  [[nodiscard]] Vec3 position(const Vec3& in_service) const noexcept { return axes * (in_service - origin); }
  /// Of a velocity or force.
  [[nodiscard]] Vec3 vector(const Vec3& in_service) const noexcept { return axes * in_service; }
  [[nodiscard]] Quat orientation(const Quat& in_service) const noexcept { return Quat(axes) * in_service; }

  /// What the service is told for a force in W: no larger than the arm bears, in the same direction.
  [[nodiscard]] Vec3 command(const Vec3& force) const noexcept;
};

/// Reads "XZ-Y", as Haply writes a basis: for each axis of W the one of S that it is. Throws Error(input) naming
/// `where`, also when the axes would be left-handed.
Eigen::Matrix3d read_inverse3_axes(const std::string& text, const std::string& where);

/// Reads a calibration from JSON, whose keys samples/devices/inverse3.json explains; what is left out keeps its
/// default. Throws Error(input) naming `where` and the key.
Inverse3Calibration read_inverse3_calibration(const nlohmann::json& json, const std::string& where);

}  // namespace haptrace
