// Driver of Force Dimension's omega, delta, sigma and lambda, through the vendor's library, loaded at run time.
#pragma once

#include "devices/registry.h"
#include "devices/vendor/shared_library.h"

#include <string>
#include <vector>

namespace haptrace {

/// Transforms a vector from F, the frame of the vendor's library, to W. Both frames lie in the device's base. F: x
/// towards the user, y to the user's right, z up. W: x to the user's right, y up, z towards the user. Real-time safe.
inline Vec3 from_force_dimension(const Vec3& v_f) {
  return {v_f.y(), v_f.z(), v_f.x()};
}

/// Transforms a vector from W to F. Real-time safe.
inline Vec3 to_force_dimension(const Vec3& v_w) {
  return {v_w.z(), v_w.x(), v_w.y()};
}

/// Returns R_WT for the library's rotation matrix, by rows. The axes of T are named like those of W: a straight wrist
/// has the identity. Real-time safe.
Quat orientation_from_force_dimension(const double (&rotation)[3][3]);

/// Published figures of a model, which nobody has verified. Unknown figures are 0.
struct ForceDimensionModel {
  int type;  ///< result of dhdGetSystemType
  const char* name;
  double max_force;             ///< [N]
  double max_torque;            ///< [N m]
  double depth, width, height;  ///< half the workspace: along z, x and y of W [m]
  double position_resolution;   ///< [m]
};

/// Returns the model of a type; null if it is unknown.
const ForceDimensionModel* force_dimension_model(int type);

/// Returns the default places to search for libdrd.
WantedLibrary force_dimension_library();

/// Returns the backend `forcedimension`, with the options library, serial, index, initialise, gravity_compensation and
/// max_force, which docs/devices/force-dimension.md explains.
DeviceBackend force_dimension_backend();

}  // namespace haptrace
