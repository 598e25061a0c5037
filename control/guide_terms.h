// Force terms of guidance beside the walls: the expert's force, help, resistance, amplified errors.
#pragma once

#include "control/guidance_options.h"
#include "control/guide_term.h"

namespace haptrace {

/// Applies the expert's force at this place of the path, times a scale. A negative scale makes the trainee overcome the
/// force. It follows the gate, times the certainty of the place. After the gate was closed, it returns within kReturn
/// of the expert's time: a faster trainee, by up to kFastest times, would else be past the place before the force is
/// back.
class ExpertForce final : public GuideTerm {
 public:
  explicit ExpertForce(double scale) noexcept : scale_(scale) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::active; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override;
  /// Returns the scaled force of the expert along the path, regardless of its direction.
  [[nodiscard]] double allowance(const PathProjection::Foot& foot, const GuideTuning& tuning) const noexcept override;

  static constexpr double kReturn = 0.3;  ///< [s]
  static constexpr double kFastest = 4;   ///< relative to the expert's speed

 private:
  double scale_;
  double share_ = 0;     ///< gate, with its rise limited
  bool returns_ = true;  ///< the gate was closed, and the share has not caught up with it
};

/// Helps a trainee along the path if they are slower than the expert by more than a margin and kUnnoticed. It never
/// slows the trainee down, and its force is bounded, so that it does not drag them. Where the direction is in doubt, it
/// fades.
class PaceHelp final : public GuideTerm {
 public:
  explicit PaceHelp(const PaceHelpOptions& options) noexcept : options_(options) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::active; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override;
  [[nodiscard]] double allowance(const PathProjection::Foot&, const GuideTuning& tuning) const noexcept override {
    return tuning.assist * options_.max_force;
  }

  /// Speed difference that causes no help: no hand keeps a speed so closely, and no device measures it [m/s].
  static constexpr double kUnnoticed = 5e-3;

 private:
  PaceHelpOptions options_;
};

/// Resists movement along the path, in both directions: f = -b (v . t) t.
class Resistance final : public GuideTerm {
 public:
  explicit Resistance(double damping) noexcept : damping_(damping) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::dissipative; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override;

 private:
  double damping_;  ///< [N s/m]
};

/// Resists all movement: f = -b v.
class Viscosity final : public GuideTerm {
 public:
  explicit Viscosity(double damping) noexcept : damping_(damping) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::dissipative; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override { return -damping_ * input.state.velocity; }

 private:
  double damping_;  ///< [N s/m]
};

/// Pushes away from the path, so that the trainee has to be more accurate than necessary: f = min(k d, f_max), fading
/// to zero where the wall begins (error augmentation, Patton et al. 2006).
class ErrorAmplification final : public GuideTerm {
 public:
  ErrorAmplification(double stiffness, double max_force) noexcept : stiffness_(stiffness), max_force_(max_force) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::active; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override;

 private:
  double stiffness_, max_force_;  ///< [N/m], [N]
};

}  // namespace haptrace
