#include "player/calibration/law_trial.h"

#include "devices/sim/sim_device.h"
#include "tests/player/calibration/identified_device.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using testing::HasSubstr;

LawTrial tried(IdentifiedDevice law, double harder, const LawTrialOptions& options = {}) {
  law.design.gains.kp *= harder * harder;
  law.design.gains.kd *= harder;
  SimDevice device(test::true_device());
  return try_out(device, law, options, StopRequest{});
}

TEST(LawTrial, PassesALawThatIsStableOnTheDevice) {
  const LawTrial trial = tried(test::identified(test::known_plant()), 1);
  EXPECT_TRUE(trial.passed()) << trial.reason;
  EXPECT_GT(trial.rms_error, 0);
  EXPECT_LT(trial.rms_error, 0.2e-3);
}

TEST(LawTrial, FailsALawThatOscillates) {
  const LawTrial trial = tried(test::identified(test::known_plant()), 4);
  EXPECT_FALSE(trial.passed());
}

TEST(LawTrial, FailsALawThatHasNoMarginAlthoughItFollows) {
  // Find the lowest gains that fail. Such a law follows calmly by itself, but not with the trial's raised gains.
  double harder = 1;
  while (harder < 6 && tried(test::identified(test::known_plant()), harder).passed()) harder *= 1.05;
  ASSERT_LT(harder, 6);
  EXPECT_GT(harder, 1.3) << "the design alone has a margin of two";
}

TEST(LawTrial, FailsALawThatDoesNotFollow) {
  const LawTrial trial = tried(test::identified(test::known_plant()), 0.05);
  EXPECT_THAT(trial.reason, testing::AnyOf(HasSubstr("its error is"), HasSubstr("off the path")));
}

TEST(LawTrial, SaysThatItEndedEarly) {
  StopRequest stop;
  stop.raise();
  SimDevice device(test::true_device());
  const LawTrial trial = try_out(device, test::identified(test::known_plant()), {}, stop);
  EXPECT_EQ(trial.session.servo.cause, StopCause::interrupted);
  EXPECT_THAT(trial.reason, HasSubstr("ended early"));
}

}  // namespace
}  // namespace haptrace
