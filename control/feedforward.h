// Feedforward forces, computed from the reference alone.
#pragma once

#include "control/cogging.h"
#include "control/design/plant_model.h"
#include "control/force_term.h"
#include "control/inertia_map.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace haptrace {

/// Computes m x_d'', the force that accelerates the mass at the reference.
class InertiaFeedforward final : public ForceTerm {
 public:
  explicit InertiaFeedforward(const Vec3& mass, const std::optional<InertiaMap>& map = {}) : mass_(mass), map_(map) {}

  [[nodiscard]] Vec3 force(const TermInput& input) noexcept override {
    Vec3 force = mass_.cwiseProduct(input.reference.acceleration);
    if (map_) force = map_->at(input.reference.position).cwiseProduct(force);
    return input.tuning.inertia * force;
  }

 private:
  Vec3 mass_;  ///< [kg]
  std::optional<InertiaMap> map_;
};

/// Compensates for gravity at the reference position: -(gravity + gradient x_d).
class GravityFeedforward final : public ForceTerm {
 public:
  explicit GravityFeedforward(const PlantModel& plant) : gravity_(plant.gravity), gradient_(plant.gravity_gradient) {}

  [[nodiscard]] Vec3 force(const TermInput& input) noexcept override {
    return -input.tuning.gravity * (gravity_ + gradient_ * input.reference.position);
  }

 private:
  Vec3 gravity_;              ///< [N]
  Eigen::Matrix3d gradient_;  ///< [N/m]
};

/// Computes b x_d' + R^T F_c tanh(R x_d' / v_0), with the rotation R from W to the actuators' axes where it is known.
/// Uses the velocity of the reference, never the measured one: compensating for the friction of a movement that is only
/// noise, or that has not happened yet, feeds a limit cycle.
class FrictionFeedforward final : public ForceTerm {
 public:
  explicit FrictionFeedforward(const PlantModel& plant) : viscous_(plant.viscous), coulomb_(plant.coulomb) {
    if (!plant.actuators) return;
    axes_ = plant.actuators->axes;
    coulomb_ = plant.actuators->coulomb;
  }

  static constexpr double kTransition = 0.01;  ///< v_0, range of velocity over which the sign changes [m/s]

  [[nodiscard]] Vec3 force(const TermInput& input) noexcept override {
    const Vec3& v = input.reference.velocity;
    const Vec3 along = axes_ * v;
    Vec3 friction;
    for (int axis = 0; axis < 3; ++axis) friction[axis] = coulomb_[axis] * std::tanh(along[axis] / kTransition);
    return input.tuning.friction * (viscous_.cwiseProduct(v) + axes_.transpose() * friction);
  }

 private:
  Vec3 viscous_;                                        ///< along the axes of W [N s/m]
  Eigen::Matrix3d axes_ = Eigen::Matrix3d::Identity();  ///< R
  Vec3 coulomb_;                                        ///< along the axes of R [N]
};

/// Compensates for the force that repeats over the place, at the reference: -F(x_d(t + lead)). While the reference
/// moves, this force has tens of hertz, so that the delay of the device counts. The measured place is not used in its
/// stead: the force there would act as a spring of thousands of newtons per metre behind a delay. The force only fades
/// while the device is a good part of a period off the reference, since that at the reference then says nothing about
/// the force at the device.
class CoggingFeedforward final : public ForceTerm {
 public:
  /// `lead`: from the tick that sends a force to the middle of the period in which it acts [s].
  CoggingFeedforward(Cogging cogging, double lead) : cogging_(std::move(cogging)), lead_(lead) {}

  [[nodiscard]] Vec3 force(const TermInput& input) noexcept override {
    const Reference& r = input.reference;
    const Vec3 there = r.position + lead_ * r.velocity + 0.5 * lead_ * lead_ * r.acceleration;
    const Vec3 off = input.state.position - r.position;
    off_ += std::clamp(input.state.dt / kFade, 0.0, 1.0) * (off - off_);
    return -input.tuning.cogging * cogging_.force(there, off_);
  }

  void start(const State&) noexcept override { off_.setZero(); }

 private:
  static constexpr double kFade = 0.05;  // time constant of the distance from the reference [s]

  Cogging cogging_;
  Vec3 off_ = Vec3::Zero();  ///< slow part of that distance [m]
  double lead_;
};

}  // namespace haptrace
