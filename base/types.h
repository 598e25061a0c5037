// Basic types of all other headers: vectors, wrenches, phases.
//
// Units are SI and frames are named throughout the library: W is the device base (right-handed), T the tool tip,
// p_WT the position of T in W. A value that is not SI carries its unit in its name (`_ms`, `_counts`, `_raw`).
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cmath>
#include <cstdint>
#include <limits>

namespace haptrace {

/// A 3-vector in frame W.
using Vec3 = Eigen::Vector3d;

/// A unit quaternion. Unaligned, so that its layout does not depend on the instruction set a program is compiled for.
using Quat = Eigen::Quaternion<double, Eigen::DontAlign>;

inline constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// Returns NaN, which stands for "not measured" and "no reference". Zero would be a valid position.
inline Vec3 nan3() {
  return Vec3::Constant(kNaN);
}
inline Quat nan_quat() {
  return {kNaN, kNaN, kNaN, kNaN};
}

/// Returns true if every component is finite. Must be compiled without -ffinite-math-only.
inline bool is_finite(const Vec3& v) {
  return std::isfinite(v.x()) && std::isfinite(v.y()) && std::isfinite(v.z());
}

/// Force and torque on the hand, expressed in W.
struct Wrench {
  Vec3 force = Vec3::Zero();   ///< [N]
  Vec3 torque = Vec3::Zero();  ///< [N m]
};

/// State of a session. The values are those of /samples/phase in a recording.
enum class Phase : std::uint8_t {
  idle = 0,      ///< no reference: the hand is free
  approach = 1,  ///< a bounded minimum-jerk movement to the start of the path
  run = 2,       ///< movement along the path; errors are measured here
  hold = 3,      ///< rest at the end of the path
  release = 4,   ///< the force ramps to zero
  stopped = 5,   ///< stopped by a limit or a fault
};

const char* to_string(Phase phase) noexcept;

}  // namespace haptrace
