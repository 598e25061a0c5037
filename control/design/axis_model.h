// Model of one axis of a device in a hand, and its exact discretisation.
#pragma once

#include "control/design/plant_model.h"

#include <Eigen/Core>

#include <array>
#include <optional>

namespace haptrace {

/// A hand on the handle: a mass behind the grip's spring and damper, held by an arm whose spring relaxes.
struct HandModel {
  double mass = 0;                ///< m_h; 0: no hand, and its forces act on the device [kg]
  double grip_stiffness = 0;      ///< k_g [N/m]
  double grip_damping = 0;        ///< b_g [N s/m]
  double arm_stiffness = 40;      ///< k_a [N/m]
  double arm_damping = 2.5;       ///< b_a [N s/m]
  double arm_relaxation_s = 0.7;  ///< tau, time constant with which the arm's spring relaxes [s]
};

/// Force of the hand's own: first-order noise (drift) and second-order noise (tremor).
struct HandNoise {
  double drift = 0;      ///< standard deviation [N]
  double drift_hz = 1;   ///< corner; above 0 if there is drift [Hz]
  double tremor = 0;     ///< standard deviation; 0: none, and no states for it [N]
  double tremor_hz = 9;  ///< natural frequency, damping ratio kTremorDamping [Hz]

  static constexpr double kTremorDamping = 0.3;
};

/// A flexible link behind the motor's mass, which carries the encoder; the hand holds the link's other end.
struct LinkModel {
  double mass = 0;       ///< m_2; 0: no link, the hand holds the motor's mass [kg]
  double stiffness = 0;  ///< k_2 [N/m]
  double damping = 0;    ///< b_2 [N s/m]
};

/// One axis of a device in a hand, relative to a reference that moves:
///
///     m v'     = f - b v - k_g (x - x_h) - b_g (v - v_h) + w,   f' = (u - f) / lag
///     m_h v_h' = k_g (x - x_h) + b_g (v - v_h) - k_a (x_h - x_e) - b_a v_h + d + t,   x_e' = (x_h - x_e) / tau
///     d'       = -2 pi drift_hz d + noise,   t'' = -2 zeta w_t t' - w_t^2 t + noise,   w_t = 2 pi tremor_hz
///
/// With a link, the grip acts on its mass m_2 instead of m, and k_2 and b_2 connect the two. u is the force that was
/// commanded `delay` before and is held for a period.
struct AxisModel {
  double mass = 0;         ///< m [kg]
  double viscous = 0;      ///< b [N s/m]
  double delay_ticks = 0;  ///< from the tick that commands a force to the motor; need not be whole [periods]
  double lag = 0;          ///< first-order lag of the motor [s]; 0: none
  LinkModel link;
  HandModel hand;
  HandNoise noise;
  double force_noise = 0;     ///< w, white force on m: root of its two-sided spectral density [N sqrt(s)]
  double position_noise = 0;  ///< standard deviation of a measured position, quantisation included [m]
  double rate_hz = 1000;      ///< of the servo loop

  static constexpr double kLongestDelay = 30;  ///< [periods]
  static constexpr int kMostStates = 11;
};

/// Returns the standard deviation of the positions that `plant` measures. The quantisation error is uniform, so its
/// variance is a twelfth of the squared resolution [m].
double measured_noise(const PlantModel& plant) noexcept;

/// An AxisModel from tick to tick, exact for a held force:
///
///     x[k+1] = transition x[k] + newer u[k - delay] + older u[k - delay - 1] + noise,   y[k] = x_0[k] + noise
///
/// `older` is zero for a whole delay. The states are x, v, then f, x_2, v_2, x_h, v_h, x_e, d, t, t' as far as the
/// model has them.
struct DiscreteAxis {
  Eigen::MatrixXd transition;
  Eigen::VectorXd newer, older;
  Eigen::MatrixXd noise;  ///< covariance
  double rate_hz = 1000;
  double measurement_variance = 0;  ///< [m^2]
  int delay = 0;                    ///< whole part of the delay [periods]
  bool fractional = false;          ///< `older` is not zero
  int drift = -1;                   ///< index of d; -1 if the model has no drift
  Eigen::VectorXd together;         ///< states when every body is displaced by 1 m
  Eigen::VectorXd moving;           ///< states when every body moves at 1 m/s
  Eigen::VectorXd balanced;         ///< states at rest with x = 0 when a held u of -1 N balances d = 1 N

  [[nodiscard]] Eigen::Index states() const noexcept { return transition.rows(); }
  [[nodiscard]] int sent() const noexcept { return delay + (fractional ? 1 : 0); }  ///< number of past forces needed
};

/// Discretises a model: matrix exponentials for the forces, and for the noise the integral of Van Loan 1978 ("Computing
/// integrals involving the matrix exponential", IEEE Trans. Autom. Control 23(3)) over a fraction of a period, doubled
/// up to a whole one. Throws Error(input) naming a parameter that is out of its range. Allocates.
DiscreteAxis discretised(const AxisModel& model);

}  // namespace haptrace
