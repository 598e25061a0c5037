// Force Dimension's omega, delta, sigma and lambda, through the vendor's library: not linked, but looked for.
#pragma once

#include "devices/registry.h"
#include "devices/vendor/shared_library.h"

#include <string>
#include <vector>

namespace haptrace {

/// A vector in W of one in F, the frame of the vendor's library: both lie in the device's base; x of F points at the
/// user, y to his right, z up; x of W to his right, y up, z at him. Real-time safe.
inline Vec3 from_force_dimension(const Vec3& v_f) {
  return {v_f.y(), v_f.z(), v_f.x()};
}

/// The inverse. Real-time safe.
inline Vec3 to_force_dimension(const Vec3& v_w) {
  return {v_w.z(), v_w.x(), v_w.y()};
}

/// R_WT of the library's rotation matrix, by rows. The axes of T are named as those of W: a wrist that stands straight
/// has the identity. Real-time safe.
Quat orientation_from_force_dimension(const double (&rotation)[3][3]);

/// What a model is said to be like: nobody verified it. Unknown figures are 0.
struct ForceDimensionModel {
  int type;  ///< of dhdGetSystemType
  const char* name;
  double max_force;             ///< [N]
  double max_torque;            ///< [N m]
  double depth, width, height;  ///< half the workspace: along z, x and y of W [m]
  double position_resolution;   ///< [m]
};

/// Null when it is not known.
const ForceDimensionModel* force_dimension_model(int type);

/// Where libdrd is looked for when nobody says where it is.
WantedLibrary force_dimension_library();

/// `forcedimension`, with the options library, serial, index, initialise, gravity_compensation and max_force, which
/// docs/devices/force-dimension.md explains.
DeviceBackend force_dimension_backend();

}  // namespace haptrace
