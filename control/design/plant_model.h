// A device's dynamics as seen by the loop.
#pragma once

#include "base/types.h"

namespace haptrace {

/// A mass with friction in a position-dependent field, behind a delay. The axes of W are independent:
///
///     m x'' = u(t - delay) + gravity + gradient x - b x' - F_c sgn(x')
///
/// where u is the force on the hand that a tick commands and holds until the next. `delay` does not include the half
/// period by which a held command lags on average.
struct PlantModel {
  Vec3 mass = Vec3::Zero();                                    ///< mass of the device alone, without a hand [kg]
  Vec3 viscous = Vec3::Zero();                                 ///< b [N s/m]
  Vec3 coulomb = Vec3::Zero();                                 ///< F_c [N]
  Vec3 gravity = Vec3::Zero();                                 ///< at the origin of W [N]
  Eigen::Matrix3d gravity_gradient = Eigen::Matrix3d::Zero();  ///< [N/m]
  double delay = 0;                ///< from the tick that commands a force to the force: transport and actuator lag [s]
  double position_resolution = 0;  ///< encoder resolution; 0: none found [m]
  double position_noise = 0;       ///< rms per axis, in addition to the quantisation noise [m]
};

}  // namespace haptrace
