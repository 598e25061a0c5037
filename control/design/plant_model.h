// What is known of a device's dynamics as the loop sees them.
#pragma once

#include "base/types.h"

namespace haptrace {

/// A mass with friction in a position-dependent field, behind a delay, for each axis of W by itself:
///
///     m x'' = u(t - delay) + gravity + gradient x - b x' - F_c sgn(x')
///
/// where u is the force on the hand that a tick commands and holds until the next. The half period by which a held
/// command lags on average is not part of `delay`.
struct PlantModel {
  Vec3 mass = Vec3::Zero();                                    ///< of the device alone, without a hand [kg]
  Vec3 viscous = Vec3::Zero();                                 ///< b [N s/m]
  Vec3 coulomb = Vec3::Zero();                                 ///< F_c [N]
  Vec3 gravity = Vec3::Zero();                                 ///< at the origin of W [N]
  Eigen::Matrix3d gravity_gradient = Eigen::Matrix3d::Zero();  ///< [N/m]
  double delay = 0;                ///< from the tick that commands a force to the force: transport, actuator lag [s]
  double position_resolution = 0;  ///< quantum of the positions; 0: none seen [m]
  double position_noise = 0;       ///< rms per axis, beside the quantum's [m]
};

}  // namespace haptrace
