// Calibration of a Haply Inverse3: parameters that nobody has verified and that users can measure on their own device.
#pragma once

#include "base/types.h"

#include <nlohmann/json.hpp>
#include <string>

namespace haptrace {

/// Pose of W in S, the frame of the Inverse Service, and the forces that the arm withstands. docs/devices/inverse3.md
/// gives the sources of the defaults and explains how to measure each.
///
/// Real-time: all members.
struct Inverse3Calibration {
  Eigen::Matrix3d axes{{1, 0, 0}, {0, 0, 1}, {0, -1, 0}};  ///< rotation; its rows are W's axes in S
  Vec3 origin = Vec3(0, -0.12, 0.15);                      ///< origin of W in S [m]
  Vec3 workspace = Vec3::Constant(0.057);                  ///< half extents around the origin, in W [m]
  double max_force = 10;                                   ///< magnitude [N]
  double max_continuous_force = 4;                         ///< magnitude [N]

  [[nodiscard]] Vec3 position(const Vec3& in_service) const noexcept { return axes * (in_service - origin); }
  /// Transforms a velocity or force from S to W.
  [[nodiscard]] Vec3 vector(const Vec3& in_service) const noexcept { return axes * in_service; }
  [[nodiscard]] Quat orientation(const Quat& in_service) const noexcept { return Quat(axes) * in_service; }

  /// Returns the force command in S for a force in W: limited to max_force, in the same direction.
  [[nodiscard]] Vec3 command(const Vec3& force) const noexcept;
};

/// Reads axes such as "XZ-Y", as Haply writes a basis: for each axis of W, the axis of S that it equals. Throws
/// Error(input) naming `where`, also if the axes are left-handed.
Eigen::Matrix3d read_inverse3_axes(const std::string& text, const std::string& where);

/// Reads a calibration from JSON. samples/devices/inverse3.json explains the keys; missing keys keep their defaults.
/// Throws Error(input) naming `where` and the key.
Inverse3Calibration read_inverse3_calibration(const nlohmann::json& json, const std::string& where);

}  // namespace haptrace
