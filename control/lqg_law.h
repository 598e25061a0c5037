// State feedback on the estimates of a Kalman filter (LQG).
#pragma once

#include "control/design/lqg_design.h"
#include "control/force_term.h"
#include "control/inertia_map.h"
#include "control/rest.h"

#include <array>
#include <optional>

namespace haptrace {

/// The estimator and the feedback of one axis, see LqgAxis, in memory of a fixed size.
///
/// Real-time: all but the constructor. Numbers must be finite.
class LqgFeedback {
 public:
  /// An axis that is not driven: all forces are zero.
  LqgFeedback() = default;
  explicit LqgFeedback(const LqgAxis& law);

  /// Starts at rest with `error` = position - reference [m], without a load and without sent forces.
  void start(double error) noexcept;

  /// Takes one tick: `error` [m] is measured `dt` [s] after the previous one, and `sent` [N] is what the last tick
  /// really sent of this law's force. While ticks are missed, that force is held. After a gap of more than
  /// StateObserver::kLongestGap ticks, the estimate restarts at rest and keeps the load.
  void update(double error, double dt, double sent) noexcept;

  struct Forces {
    double spring = 0, other = 0;  ///< feedback: the part that is proportional to the error, and the rest [N]
    double load = 0;               ///< balances the estimated drift [N]
  };
  [[nodiscard]] Forces forces() const noexcept;

 private:
  static constexpr int kMostStates = AxisModel::kMostStates;
  static constexpr int kMostSent = static_cast<int>(AxisModel::kLongestDelay) + 2;
  using State = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMostStates, 1>;

  void push(double sent) noexcept;
  void predict() noexcept;
  void flush() noexcept;

  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMostStates, kMostStates> transition_;
  State newer_, older_, kalman_, state_gain_, together_, balanced_;
  Eigen::Matrix<double, kMostSent, 1> sent_gain_ = Eigen::Matrix<double, kMostSent, 1>::Zero();
  Eigen::Matrix4d ripple_step_ = Eigen::Matrix4d::Zero();
  Eigen::Vector4d ripple_in_ = Eigen::Vector4d::Zero(), ripple_gain_ = Eigen::Vector4d::Zero();
  double load_gain_ = 0, stiffness_ = 0, period_ = 1e-3;
  int delay_ = 0, drift_ = -1, gains_ = 0;

  State x_;
  Eigen::Vector4d ripple_ = Eigen::Vector4d::Zero();
  Eigen::Matrix<double, kMostSent, 1> sent_ = Eigen::Matrix<double, kMostSent, 1>::Zero();  ///< newest first
};

/// Returns stiffness and damping of laws for movement, with which they act as designed; 0 on axes without a law.
PdGains gains_of(const std::array<std::optional<LqgLaws>, 3>& laws) noexcept;

/// F = s K(x - x_d)
///
/// where K is the LqgLaws of each axis of W, whose input is the error and whose model is the device in a hand. It
/// predicts the effect of the forces that are on their way, cancels the estimated load, and limits its own ripple.
///
/// This term comes after all others: their sum is the feedforward for the reference, the known load and the inertia.
/// The law takes the force that was really sent, without this sum, for its own. Nothing therefore winds up while the
/// device saturates or an operator holds it.
///
/// s scales the law to the mass at the reference: with s = m(x_d) / m from options.inertia and options.designed_for, a
/// law for m becomes that for m(x_d) of a free mass, exactly. The load is clamped to its authority. Tuned gains scale
/// the part of the feedback that is proportional to the error by kp over the law's stiffness, and the rest by kd over
/// its damping; see gains_of(). While the reference rests, Rest keeps the load, and the law for rest replaces that for
/// movement. Both are computed at every tick.
///
/// An axis without a law is not driven.
class LqgLaw final : public ForceTerm {
 public:
  struct Options {
    std::array<std::optional<LqgLaws>, 3> axes;
    double position_resolution = 0;       ///< [m]
    double authority = 0;                 ///< largest force against a load, magnitude [N]
    std::optional<InertiaMap> inertia{};  ///< how the mass varies; without it, s = 1
    Vec3 designed_for = Vec3::Ones();     ///< mass for which the laws are, over that at the map's centre
  };

  explicit LqgLaw(const Options& options);

  void start(const State& first) noexcept override;
  [[nodiscard]] bool feeds_back() const noexcept override { return true; }
  [[nodiscard]] Vec3 force(const TermInput& input) noexcept override;
  [[nodiscard]] PdGains gains(const Tuning& tuning) const noexcept override;

 private:
  std::array<LqgFeedback, 3> moving_, resting_;
  Vec3 driven_ = Vec3::Zero();             ///< 1 for an axis with a law, else 0
  Vec3 inverse_stiffness_ = Vec3::Zero();  ///< [m/N]
  Vec3 inverse_damping_ = Vec3::Zero();    ///< [m/(N s)]
  PdGains at_rest_;                        ///< of the laws for rest, over those for movement
  double authority_;
  Rest rest_;
  bool starts_ = true;
  std::optional<InertiaMap> inertia_;
  Vec3 per_mass_;  ///< the inverse of options.designed_for
  Vec3 scale_ = Vec3::Ones(), sent_scale_ = Vec3::Ones();
  Vec3 known_ = Vec3::Zero();   ///< force of the other terms at the last tick [N]
  Vec3 slow_ = Vec3::Zero();    ///< load that is followed slowly at standstill [N]
  Vec3 offset_ = Vec3::Zero();  ///< its difference from the load, fading in a movement [N]
};

}  // namespace haptrace
