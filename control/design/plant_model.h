// A device's dynamics as seen by the loop.
#pragma once

#include "base/types.h"
#include "control/cogging.h"

#include <optional>
#include <string>

namespace haptrace {

/// Coulomb friction along the actuators' axes, which need not be those of W:
///
///     R^T diag(F_c) sgn(R x')
struct ActuatorFriction {
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  ///< R, from W to the actuators' axes: p_A = R p_W
  Vec3 coulomb = Vec3::Zero();                         ///< F_c [N]
  double angle_half = 0;                               ///< half width of the 95 % confidence interval of R [rad]
  Vec3 coulomb_half = Vec3::Zero();                    ///< the same of F_c [N]
};

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
  /// Coulomb friction along the actuators' axes, where these are known to differ from those of W. It is then more
  /// accurate than F_c, the friction against a movement along each axis of W.
  std::optional<ActuatorFriction> actuators;
  std::optional<Cogging> cogging;  ///< force on the handle that repeats over the place, if one is known
  /// Largest force that the motors give, a magnitude, if it is below the largest that was tried [N]; 0: none was found.
  /// See identify_motor_limit().
  double motor_limit = 0;
};

/// Result of an identification, see identify().
struct Identification {
  PlantModel plant;          ///< zero on axes without force output
  PlantModel half_width;     ///< half widths of the 95 % confidence intervals; zero where there is none
  double line_residual = 0;  ///< unexplained fraction of the response at the spectral lines, rms; in a coarse model, of
                             ///< the force below 20 Hz
  double sweep_residual = 0;  ///< rms force of the sweeps that the model does not explain [N]
  bool fits = false;
  bool coarse = false;  ///< from identify_coarsely(): accurate enough only for a controller that is tested first
  std::string reason;   ///< reason why the model does not fit; empty when it does
};

}  // namespace haptrace
