#include "control/feedforward.h"

#include "tests/support/allocations.h"

#include <Eigen/Geometry>

#include <gtest/gtest.h>

namespace haptrace {
namespace {

PlantModel plant() {
  PlantModel plant;
  plant.mass = Vec3(0.4, 0.5, 0);
  plant.viscous = Vec3(1, 2, 3);
  plant.coulomb = Vec3(0.7, 0.6, 0.5);
  plant.gravity = Vec3(0, 0.2, -2);
  plant.gravity_gradient << 1, 2, 3, 2, 4, 5, 3, 5, 6;
  return plant;
}

Vec3 answer(ForceTerm& term, const Reference& reference, const Tuning& tuning = {}) {
  // The measured state is far from the reference: a feedforward term must not use it.
  State state;
  state.position = Vec3(9, 9, 9);
  state.velocity = Vec3(-9, -9, -9);
  return term.force({state, reference, tuning, Vec3(7, 7, 7)});
}

TEST(InertiaFeedforward, IsTheMassTimesTheReferencesAcceleration) {
  InertiaFeedforward term(plant().mass);
  const Reference reference{Vec3(1, 1, 1), Vec3(2, 2, 2), Vec3(3, -4, 5), 0};
  EXPECT_TRUE(answer(term, reference).isApprox(Vec3(1.2, -2, 0), 1e-12));
  EXPECT_TRUE(answer(term, reference, {.inertia = 0.25}).isApprox(Vec3(0.3, -0.5, 0), 1e-12));
}

TEST(GravityFeedforward, CancelsGravityAtTheReference) {
  GravityFeedforward term(plant());
  const Reference reference{Vec3(0.1, 0, -0.1), Vec3(2, 2, 2), Vec3(3, 3, 3), 0};
  const Vec3 pull = Vec3(0, 0.2, -2) + Vec3(0.1 - 0.3, 0.2 - 0.5, 0.3 - 0.6);
  EXPECT_TRUE(answer(term, reference).isApprox(-pull, 1e-12));
  EXPECT_TRUE(answer(term, reference, {.gravity = 0.5}).isApprox(-0.5 * pull, 1e-12));
}

TEST(FrictionFeedforward, IsTheModelsFrictionAtTheReferencesVelocity) {
  FrictionFeedforward term(plant());
  const auto at = [&](const Vec3& velocity, const Tuning& tuning = {}) {
    return answer(term, {Vec3(1, 1, 1), velocity, Vec3(1, 1, 1), 0}, tuning);
  };
  EXPECT_TRUE(at(Vec3(0.3, -0.4, 0)).isApprox(Vec3(0.3 + 0.7, -0.8 - 0.6, 0), 1e-9));
  EXPECT_TRUE(at(Vec3(0.3, -0.4, 0), {.friction = 0.5}).isApprox(Vec3(0.5, -0.7, 0), 1e-9));
  EXPECT_EQ(at(Vec3::Zero()), Vec3::Zero()) << "a reference at rest needs no force";
}

TEST(FrictionFeedforward, CancelsTheFrictionOfTurnedActuators) {
  PlantModel turned = plant();
  const Eigen::Matrix3d r = Eigen::AngleAxisd(0.8, Vec3(1, -2, 0.5).normalized()).toRotationMatrix();
  turned.actuators = ActuatorFriction{.axes = r, .coulomb = Vec3(0.3, 0.9, 0.6)};
  FrictionFeedforward term(turned);
  for (const Vec3& along : {Vec3(0.9, 0, 0), Vec3(0, 0, -0.9), Vec3(-0.5, 0.4, 0.6)}) {
    const Vec3 v = r.transpose() * along;
    const Vec3 friction = turned.viscous.cwiseProduct(v) +
                          r.transpose() * turned.actuators->coulomb.cwiseProduct(
                                              Vec3((along / FrictionFeedforward::kTransition).array().tanh()));
    EXPECT_TRUE(answer(term, {Vec3::Zero(), v, Vec3::Zero(), 0}).isApprox(friction, 1e-9)) << along.transpose();
  }
}

TEST(FrictionFeedforward, TurnsItsSignSmoothly) {
  FrictionFeedforward term(plant());
  const auto x = [&](double speed) { return answer(term, {Vec3::Zero(), Vec3(speed, 0, 0), Vec3::Zero(), 0}).x(); };
  EXPECT_NEAR(x(FrictionFeedforward::kTransition), 0.7 * std::tanh(1) + FrictionFeedforward::kTransition, 1e-9);
  for (double speed = -0.02; speed < 0.02; speed += 1e-4) {
    EXPECT_GT(x(speed + 1e-4), x(speed));
    EXPECT_LE(x(speed + 1e-4) - x(speed), 1e-4 * (0.7 / FrictionFeedforward::kTransition + 1) + 1e-12);
    EXPECT_NEAR(x(-speed), -x(speed), 1e-12);
  }
}

Cogging cables() {
  return {.centre = Vec3(0.01, 0, 0),
          .waves = {{.wave_number = Vec3(2000, 0, 0), .cosine = 0.3, .sine = 0.4},
                    {.wave_number = Vec3(0, 600, 800), .cosine = 0, .sine = -0.5}}};
}

TEST(CoggingFeedforward, CancelsTheForceOfThePlaceWhereTheReferenceWillBe) {
  CoggingFeedforward term(cables(), 2e-3);
  // After 2 ms, x is 0.011 m, and y and z are 0.001 and 0.0005 m.
  const Reference reference{Vec3(0.0109, 0.001 + 1e-3, 0.0005), Vec3(0, -0.5, 0), Vec3(50, 0, 0), 0};
  const Vec3 force = Vec3(0.3 * std::cos(2) + 0.4 * std::sin(2), 0, 0) - 0.5 * std::sin(1) * Vec3(0, 0.6, 0.8);
  EXPECT_TRUE(answer(term, reference).isApprox(-force, 1e-9)) << answer(term, reference).transpose();
  EXPECT_TRUE(answer(term, reference, {.cogging = 0.5}).isApprox(-0.5 * force, 1e-9));
}

TEST(CoggingFeedforward, FadesWhereTheWaveNumbersSayLittleAboutThePhase) {
  Cogging known = cables();
  known.waves.pop_back();
  Cogging uncertain = known;
  uncertain.waves[0].wave_number_half = Vec3(19.6, 19.6, 19.6);  // a standard deviation of 10 rad/m
  const auto share = [&](const Vec3& off) {
    const Vec3 place = known.centre + off;
    return uncertain.force(place).x() / known.force(place).x();
  };
  EXPECT_NEAR(share(Vec3::Zero()), 1, 1e-12);
  EXPECT_NEAR(share(Vec3(0.02, 0, 0)), std::exp(-0.5 * 0.2 * 0.2), 1e-9);
  EXPECT_NEAR(share(Vec3(0, 0.1, 0)), std::exp(-0.5), 1e-9);
  EXPECT_LT(share(Vec3(0, 1, 0)), 1e-9);
}

TEST(Feedforward, IsFiniteForAnyFiniteReference) {
  InertiaFeedforward inertia(plant().mass);
  GravityFeedforward gravity(plant());
  FrictionFeedforward friction(plant());
  CoggingFeedforward cogging(cables(), 2e-3);
  const Reference reference{Vec3::Constant(1e3), Vec3::Constant(1e9), Vec3::Constant(-1e12), kNaN};
  const std::size_t before = test::allocations();
  for (ForceTerm* term : {static_cast<ForceTerm*>(&inertia), static_cast<ForceTerm*>(&gravity),
                          static_cast<ForceTerm*>(&friction), static_cast<ForceTerm*>(&cogging)})
    EXPECT_TRUE(is_finite(answer(*term, reference)));
  EXPECT_EQ(test::allocations(), before);
}

}  // namespace
}  // namespace haptrace
