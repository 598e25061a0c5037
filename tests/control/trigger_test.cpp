#include "control/trigger.h"

#include "base/error.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::error_of;
using testing::AllOf;
using testing::HasSubstr;

State still() {
  State state;
  state.force_measured = Vec3::Zero();
  return state;
}

TEST(Trigger, FiresOnlyBeyondItsThreshold) {
  const Trigger trigger = Trigger::parse("force>0.5N");
  State state = still();
  EXPECT_FALSE(trigger.check(state));
  state.force_measured = Vec3(0.3, 0.4, 0);
  EXPECT_FALSE(trigger.check(state)) << "0.5 is not over 0.5";
  state.force_measured = Vec3(0.3, 0.4, 0.1);
  const std::optional<Event> event = trigger.check(state);
  ASSERT_TRUE(event);
  EXPECT_EQ(event->code, EventCode::triggered);
  EXPECT_THAT(describe(*event), AllOf(HasSubstr("force of 0.51 N"), HasSubstr("over 0.5 N")));
}

TEST(Trigger, NeverFiresOnAForceThatIsNotMeasured) {
  State state;
  EXPECT_FALSE(Trigger::parse("force>0.5").check(state));
  EXPECT_TRUE(Trigger::parse("force>0.5").needs_force_sensor());
  EXPECT_FALSE(Trigger::parse("speed>0.5|button").needs_force_sensor());
}

TEST(Trigger, ReadsUnitsAndPrefixes) {
  State state = still();
  state.velocity = Vec3(0, 0.021, 0);
  for (const char* text : {"speed>0.02", "speed>0.02m/s", "speed>20mm/s"})
    EXPECT_TRUE(Trigger::parse(text).check(state));
  state.velocity = Vec3(0, 0.019, 0);
  for (const char* text : {"speed>0.02", "speed>0.02m/s", "speed>20mm/s"})
    EXPECT_FALSE(Trigger::parse(text).check(state));
}

TEST(Trigger, DistinguishesButtons) {
  State state = still();
  state.buttons = 0b100;
  EXPECT_TRUE(Trigger::parse("button").check(state));
  EXPECT_TRUE(Trigger::parse("button3").check(state));
  EXPECT_FALSE(Trigger::parse("button2").check(state));
  state.buttons = 1U << 31U;
  EXPECT_TRUE(Trigger::parse("button32").check(state));
  state.buttons = 0;
  EXPECT_FALSE(Trigger::parse("button").check(state));
}

TEST(Trigger, TakesTheFirstOfItsAlternativesThatIsFulfilled) {
  const Trigger trigger = Trigger::parse("force>1N|speed>0.1|button2");
  State state = still();
  EXPECT_FALSE(trigger.check(state));
  state.buttons = 2;
  EXPECT_EQ(trigger.check(state)->values[0], 2);
  state.velocity = Vec3(0.2, 0, 0);
  EXPECT_EQ(trigger.check(state)->values[0], 1);
}

TEST(Trigger, OfAThresholdOfZeroWaitsForTheLeastMovement) {
  for (const char* text : {"speed>0", "speed>0.0", "speed>0m/s"}) {
    const Trigger trigger = Trigger::parse(text);
    State state = still();
    state.velocity = Vec3::Zero();
    EXPECT_FALSE(trigger.check(state)) << text;
    state.velocity = Vec3(1e-9, 0, 0);
    EXPECT_TRUE(trigger.check(state)) << text;
  }
}

TEST(Trigger, ThatIsNotUnderstoodIsRefusedByName) {
  for (const char* text : {"", "force", "force>", "force>-1", "force>1m/s", "speed>1N", "speed>nan", "button0",
                           "button33", "buttons", "force<1N", "force>1N|", "force>1N|spd>2"})
    EXPECT_THAT(error_of([&] { (void)Trigger::parse(text); }),
                AllOf(HasSubstr("not understood"), HasSubstr("force>0.5N")))
        << text;
  EXPECT_THAT(error_of([] { (void)Trigger::parse("force>1N|spd>2"); }), HasSubstr("'spd>2'"));
}

}  // namespace
}  // namespace haptrace
