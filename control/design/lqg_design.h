// Kalman filter and state feedback for one axis (LQG), and figures of the loop that they close.
#pragma once

#include "control/design/axis_model.h"

#include <complex>
#include <optional>
#include <vector>

namespace haptrace {

/// The high pass that measures ripple (control/ripple.h) as a state-space model: h <- a h + b u, ripple = c h + d u.
struct RippleModel {
  Eigen::Matrix4d a;
  Eigen::Vector4d b;
  Eigen::RowVector4d c;
  double d = 0;
  Eigen::Vector4d constant;  ///< h after a constant u of 1 N

  explicit RippleModel(double rate_hz);
};

/// The law of one axis, in coordinates of the error e = position - reference:
///
///     x <- transition x + newer u[k - delay] + older u[k - delay - 1]     prediction, with the forces that were sent
///     x <- x + kalman (e - x_0)                                           correction
///     u = -(state x + sent (u[k - 1], u[k - 2], ...) + ripple h)
///
/// with h the states of the RippleModel. The part -load d of u balances the estimated drift d; while nothing moves, the
/// remainder is zero but for -stiffness e.
struct LqgAxis {
  DiscreteAxis model;
  Eigen::VectorXd kalman;
  Eigen::RowVectorXd state;
  Eigen::RowVectorXd sent;  ///< newest force first
  Eigen::RowVector4d ripple = Eigen::RowVector4d::Zero();
  double load = 0;       ///< 1 but for the drift that the model expects to fade
  double stiffness = 0;  ///< force for an error of the device and the hand together [N/m]
  double damping = 0;    ///< the same for a velocity [N s/m]
};

/// The laws of one axis, in movement and at rest (control/rest.h).
struct LqgLaws {
  LqgAxis moving, resting;
  double learning_hz = 0;  ///< highest frequency at which a force is to be learned under them, see learning_bandwidth()
};

/// Designs the law that minimises E[e^2] + ripple_weight E[(H u)^2] on `model`, where H is the RippleModel: the
/// stationary Kalman filter with the model's noise, and the linear quadratic regulator (Astrom and Wittenmark,
/// Computer- Controlled Systems, 3rd ed. 1997, chapter 11). A force that acts n periods late changes only when it acts:
/// the regulator is that of the model without delay, applied to the state that the forces on their way lead to. The
/// sizes of both Riccati equations therefore do not depend on the delay.
///
/// `ripple_weight` [m^2/N^2] and the model's noise are above 0. Returns nothing if a Riccati equation has no solution.
/// Throws what discretised() throws. Allocates.
std::optional<LqgAxis> design_lqg(const AxisModel& model, double ripple_weight);

/// Figures of a loop, per axis.
struct LoopFigures {
  double error = 0;   ///< rms of e at the ticks [m]
  double ripple = 0;  ///< rms of the command after the RippleModel [N]
};

/// The loop that a law closes around a plant, which may be another than its model. Both have the same rate.
class LqgLoop {
 public:
  LqgLoop(const LqgAxis& law, const DiscreteAxis& plant);

  /// Returns the largest magnitude of a pole, those of the plant's own noise included; below 1 the loop is stable.
  [[nodiscard]] double radius() const;

  /// Returns the figures under the plant's noise, or nothing if the loop is not stable.
  [[nodiscard]] std::optional<LoopFigures> figures() const;

 private:
  Eigen::MatrixXd transition_, noise_;
  Eigen::RowVectorXd ripple_row_;  ///< ripple from the states
  double ripple_noise_ = 0;        ///< variance of the ripple from the measurement at the same tick [N^2]
};

/// Frequency responses on a grid that is even in the logarithm of the frequency, up to half the rate.
class FrequencyGrid {
 public:
  explicit FrequencyGrid(double rate_hz);

  using Response = std::vector<std::complex<double>>;

  /// Returns the response of the plant's position to the command.
  [[nodiscard]] Response plant(const DiscreteAxis& plant) const;

  [[nodiscard]] double frequency(std::size_t index) const;  ///< [Hz]

  /// Returns the response of the command to the position, with its sign inverted.
  [[nodiscard]] Response law(const LqgAxis& law) const;

  /// Returns Ms, the largest magnitude of the sensitivity 1 / (1 + plant law).
  [[nodiscard]] static double largest_sensitivity(const Response& plant, const Response& law);

  /// Returns whether the loop of `plant` is stable if that of `known` is and both plants have equally many unstable
  /// poles: by Nyquist's criterion, (1 + plant law) / (1 + known law) then does not encircle 0. As exact as the grid.
  [[nodiscard]] static bool stable_like(const Response& known, const Response& plant, const Response& law);

 private:
  double rate_hz_;
  std::vector<std::complex<double>> z_;
  std::vector<Eigen::Vector4cd> ripple_;  ///< states of the RippleModel per command
};

}  // namespace haptrace
