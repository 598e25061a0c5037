#include "player/calibration/workspace_trial.h"

#include "studies/ensemble_draw.h"
#include "tests/player/calibration/identified_device.h"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using testing::Each;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Le;
using testing::Lt;

WorkspaceTour around_the_centre() {
  return {.places = {Vec3::Zero(), Vec3(0.05, 0, 0), Vec3(0, 0.05, 0), Vec3(0, 0, -0.05)}};
}

SimSpec held_device_spec(double mass_factor = 1) {
  SimSpec spec = test::true_device();
  spec.mass *= mass_factor;
  spec.hand = test::relaxed_hand();
  return spec;
}

TourResult toured_under(const PlayOptions& law, const SimSpec& spec = held_device_spec(),
                        const WorkspaceTour& tour = around_the_centre()) {
  SimDevice device(spec);
  return toured(device, law, tour, StopRequest{});
}

PlayOptions lqg() {
  return {.identified = test::identified_in_a_hand()};
}

PlayOptions plain() {
  PlayOptions options = lqg();
  options.compensations = {};
  return options;
}

TEST(WorkspaceTrial, LetsALawPassThatFollowsCloserAtEveryPlace) {
  const TourResult own = toured_under(lqg()), other = toured_under(plain());
  ASSERT_TRUE(own.finished()) << own.session.servo.detail;
  ASSERT_EQ(own.rms_error.size(), 4U);
  EXPECT_THAT(own.rms_error, Each(Lt(0.3e-3)));
  EXPECT_THAT(own.saturated, Each(Le(0.01)));
  EXPECT_THAT(refusal_of(own, other, around_the_centre(), 1), IsEmpty());
  EXPECT_GT(least_improvement(own, other), 1.5);
}

TEST(WorkspaceTrial, RefusesALawThatOscillatesOnTheDevice) {
  const TourResult own = toured_under(lqg(), held_device_spec(0.3)),
                   other = toured_under(plain(), held_device_spec(0.3));
  EXPECT_THAT(refusal_of(own, other, around_the_centre(), 1),
              testing::AnyOf(HasSubstr("oscillates"), HasSubstr("ripple"), HasSubstr("ended early")));
}

TEST(WorkspaceTrial, RefusesWhatRipplesOrFollowsLessCloselyAtAnyPlace) {
  TourResult own = toured_under(lqg()), other = own;
  EXPECT_THAT(refusal_of(own, other, around_the_centre(), 1), IsEmpty()) << "equally good";
  for (double& error : other.rms_error) error *= 0.9;
  EXPECT_THAT(refusal_of(own, other, around_the_centre(), 1), HasSubstr("1.11 times that of plain PD control"));
  other.rms_error = own.rms_error;
  other.rms_error[1] *= 1.2;
  other.rms_error[2] *= 0.9;
  EXPECT_THAT(refusal_of(own, other, around_the_centre(), 1), IsEmpty()) << "closer in all";
  other.rms_error[2] *= 0.8;
  EXPECT_THAT(refusal_of(own, other, around_the_centre(), 1), HasSubstr("50 mm from the centre, and that of plain PD"));
  own.saturated[2] = 0.5;
  EXPECT_THAT(refusal_of(own, other, around_the_centre(), 1), IsEmpty()) << "the force did not suffice there";
  own.ripple[1] = 0.7;
  EXPECT_THAT(refusal_of(own, other, around_the_centre(), 0.5), HasSubstr("force ripple is 0.70 N rms 50 mm"));
}

TEST(WorkspaceTrial, CountsSmallOscillationsOnlyIfTheyMatter) {
  const SimSpec slack = draw_device(1, 22, EnsembleKind::everything).spec;
  WorkspaceTour tour = around_the_centre();
  const TourResult strict = toured_under(plain(), slack, tour);
  tour.small_oscillations = false;
  const TourResult lenient = toured_under(plain(), slack, tour);
  EXPECT_GT(strict.oscillations, lenient.oscillations);
  EXPECT_EQ(strict.rms_error, lenient.rms_error) << "they are only counted";
}

TEST(WorkspaceTrial, HasAnErrorOverAllPlacesThatWereReached) {
  TourResult toured;
  EXPECT_TRUE(std::isnan(whole_error(toured)));
  toured.rms_error = {3e-3, kNaN, 4e-3};
  EXPECT_DOUBLE_EQ(whole_error(toured), std::sqrt(12.5e-6));
}

TEST(WorkspaceTrial, ComparesNothingWhereTheForceNeverSuffices) {
  WorkspaceTour weak = around_the_centre();
  weak.session.loop.limits.max_force = 0.5;
  weak.max_deviation = 0.1;
  const TourResult own = toured_under(lqg(), held_device_spec(), weak);
  EXPECT_EQ(least_improvement(own, own), 0);
}

TEST(WorkspaceTrial, KnowsTheForceThatALawTakes) {
  SimSpec spec = test::true_device();
  spec.gravity_bias = Vec3(0, 0, -3);
  spec.gravity_gradient.setZero();
  EXPECT_NEAR(toured_under(plain(), spec).force, 3, 1);
  spec.gravity_bias = Vec3(0, 0, -6);
  EXPECT_NEAR(toured_under(plain(), spec).force, 6, 1);
}

TEST(WorkspaceTrial, SaysThatItEndedEarly) {
  StopRequest stop;
  stop.raise();
  SimDevice device(held_device_spec());
  const TourResult own = toured(device, lqg(), around_the_centre(), stop);
  EXPECT_FALSE(own.finished());
  EXPECT_THAT(refusal_of(own, own, around_the_centre(), 1), HasSubstr("ended early"));
}

}  // namespace
}  // namespace haptrace
