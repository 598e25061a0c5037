// Forces that are known before they are needed, from the reference alone.
#pragma once

#include "control/design/plant_model.h"
#include "control/pd.h"

namespace haptrace {

/// m x_d'', what the mass asks for.
class InertiaFeedforward final : public ForceTerm {
 public:
  explicit InertiaFeedforward(const Vec3& mass) : mass_(mass) {}

  [[nodiscard]] Vec3 force(const TermInput& input) noexcept override {
    return input.tuning.inertia * mass_.cwiseProduct(input.reference.acceleration);
  }

 private:
  Vec3 mass_;  ///< [kg]
};

/// Holds what gravity pulls at, where the reference is: -(gravity + gradient x_d).
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

/// b x_d' + F_c tanh(x_d' / v_0). Of the reference's velocity, never of the measured one: friction that is paid back
/// for a movement that is only noise, or that has not happened yet, feeds a limit cycle.
class FrictionFeedforward final : public ForceTerm {
 public:
  explicit FrictionFeedforward(const PlantModel& plant) : viscous_(plant.viscous), coulomb_(plant.coulomb) {}

  static constexpr double kTransition = 0.01;  ///< v_0, over which the sign turns [m/s]

  [[nodiscard]] Vec3 force(const TermInput& input) noexcept override {
    const Vec3& v = input.reference.velocity;
    Vec3 force = viscous_.cwiseProduct(v);
    for (int axis = 0; axis < 3; ++axis) force[axis] += coulomb_[axis] * std::tanh(v[axis] / kTransition);
    return input.tuning.friction * force;
  }

 private:
  Vec3 viscous_;  ///< [N s/m]
  Vec3 coulomb_;  ///< [N]
};

}  // namespace haptrace
