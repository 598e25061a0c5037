#include "control/design/identified_device.h"

#include "base/error.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

Identification found() {
  Identification identification;
  identification.plant.mass = Vec3(0.4, 0.3, 0);
  identification.plant.delay = 1.8e-3;
  identification.plant.position_resolution = 5e-5;
  return identification;
}

HeldIdentification found_hand() {
  HeldIdentification held{.margin = 50};
  held.held = held_model(found().plant, {.mass = 0.1, .grip_stiffness = 500, .grip_damping = 3}, 0.2e-3);
  held.half_width.mass = Vec3(0.01, 0.01, 0);
  return held;
}

TEST(HeldDevice, TakesTheIdentifiedHand) {
  const HeldDevice device = held_device(found(), found_hand(), 1000, 8);
  EXPECT_EQ(device.hand, HandKnown::identified);
  EXPECT_EQ(device.model.hand[0].mass, 0.1);
  EXPECT_EQ(device.model.lag, 0.2e-3);
  EXPECT_EQ(device.half_width.mass.x(), 0.01);
  EXPECT_EQ(device.margin, 50);
}

TEST(HeldDevice, ExpectsHardlyAHandWhereNobodyHoldsItForSure) {
  HeldIdentification nobody{.margin = 30};
  nobody.held.mass = found().plant.mass;
  const HeldDevice device = held_device(found(), nobody, 1000, 8);
  EXPECT_EQ(device.hand, HandKnown::nobody);
  EXPECT_EQ(device.model.hand[1].grip_stiffness, kHardlyAHand.grip_stiffness);
  EXPECT_EQ(device.model.hand[2].mass, 0) << "an axis without force has no hand";
}

TEST(HeldDevice, AssumesARelaxedHandWhereTheResponseDoesNotTell) {
  const HeldDevice device = held_device(found(), {}, 1000, 8);
  EXPECT_EQ(device.hand, HandKnown::assumed);
  EXPECT_EQ(device.model.hand[0].mass, kRelaxedHand.mass);
  EXPECT_EQ(device.model.mass, found().plant.mass);
  EXPECT_NEAR(device.model.delay + device.model.lag, found().plant.delay, 1e-12);
}

TEST(HeldDevice, MayRippleMoreWhereItIsHardlyFelt) {
  Identification fine = found();
  fine.plant.position_resolution = 1e-6;
  EXPECT_NEAR(held_device(fine, {}, 1000, 8).ripple, kFineRipple / std::sqrt(2.0), 1e-12) << "two axes with force";
  fine.plant.mass = {0.4, 0, 0};
  EXPECT_NEAR(held_device(fine, {}, 1000, 8).ripple, kFineRipple, 1e-12) << "one";
  EXPECT_NEAR(held_device(fine, {}, 1000, 1).ripple, kMostLawRipple / std::sqrt(3.0), 1e-12) << "a weak device";
  EXPECT_NEAR(held_device(found(), {}, 1000, 1).ripple, kMostLawRipple / std::sqrt(3.0), 1e-12) << "a coarse encoder";
  EXPECT_NEAR(held_device(found(), {}, 1000, 8).ripple, 5e-5 / std::sqrt(12.0) * plain_ripple(1000), 1e-12);
}

TEST(HeldDevice, HasTheLawsThatTheSearchFound) {
  HeldDevice device = held_device(found(), found_hand(), 1000, 8);
  device.one_mass = false;
  double done = 0;
  ASSERT_TRUE(design_laws(device, 1000, StopRequest{}, [&](double share) {
    EXPECT_GE(share, done);
    done = share;
  }));
  EXPECT_NEAR(done, 1, 1e-9);
  const auto axes = axis_models(device.model, device.position_noise, 1000);
  const auto searched = search_lqg(axes, {.plain_ripple = device.ripple}, StopRequest{});
  const auto laws = lqg_laws(device, Firmness::normal, 1000);
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const LqgLaws& own = (*searched)[axis]->laws;
    EXPECT_EQ(laws[axis]->moving.state, own.moving.state);
    EXPECT_EQ(laws[axis]->moving.kalman, own.moving.kalman);
    EXPECT_EQ(laws[axis]->resting.state, own.resting.state);
  }
  EXPECT_FALSE(laws[2]);
  EXPECT_NEAR(device.design(Firmness::normal).figures.error,
              std::hypot((*searched)[0]->figures.error, (*searched)[1]->figures.error), 1e-12);
  double error = 1;
  for (const Firmness firmness : kFirmnesses) {
    EXPECT_LT(device.design(firmness).figures.error, error) << to_string(firmness);
    error = device.design(firmness).figures.error;
  }
}

TEST(HeldDevice, IsNotDesignedToTheEndWhenAStopIsRaised) {
  HeldDevice device = held_device(found(), found_hand(), 1000, 8);
  StopRequest stop;
  stop.raise();
  EXPECT_FALSE(design_laws(device, 1000, stop));
}

}  // namespace
}  // namespace haptrace
