#include "control/stand_in_law.h"

#include "control/pd.h"
#include "tests/support/allocations.h"

#include <gtest/gtest.h>

namespace haptrace {
namespace {

constexpr double kStep = 1e-3;  // [s]
const PdGains kOwn{Vec3(4000, 2000, 0), Vec3(40, 20, 0)}, kPlain{Vec3(3000, 3000, 3000), Vec3(25, 25, 25)};

/// A law of a constant force.
class Constant final : public ForceTerm {
 public:
  [[nodiscard]] bool feeds_back() const noexcept override { return true; }
  [[nodiscard]] Vec3 force(const TermInput&) noexcept override { return Vec3(0, 0, 1); }
  [[nodiscard]] PdGains gains(const Tuning& tuning) const noexcept override { return tuning.gains; }
};

struct Played {
  StandInLaw law{std::make_unique<Constant>(), kOwn, kPlain};
  State state;
  Reference reference{.position = Vec3(1e-3, 1e-3, 0), .velocity = Vec3::Zero(), .acceleration = Vec3::Zero()};
  Tuning tuning;
  int renewals = 0;

  Played() {
    tuning.gains = kOwn;
    state.dt = kStep;
    law.start(state);
  }

  Vec3 run(int ticks, bool on_path, bool vibrated) {
    reference.time = on_path ? 1 : kNaN;
    state.vibrated = vibrated;
    Vec3 force = Vec3::Zero();
    for (int k = 0; k < ticks; ++k) {
      force = law.force({state, reference, tuning});
      renewals += law.renewed() ? 1 : 0;
    }
    return force;
  }
};

TEST(StandInLaw, IsTheLawAsLongAsNothingVibrates) {
  Played played;
  for (int repetition = 0; repetition < 3; ++repetition) {
    EXPECT_EQ(played.run(500, false, false), Vec3(0, 0, 1));
    EXPECT_EQ(played.run(500, true, false), Vec3(0, 0, 1));
  }
  EXPECT_EQ(played.renewals, 0);
  EXPECT_EQ(played.law.gains(played.tuning).kp, kOwn.kp);
}

TEST(StandInLaw, ReplacesALawThatVibratedFromTheNextRepetitionOnForGood) {
  Played played;
  (void)played.run(500, false, false);
  EXPECT_EQ(played.run(500, true, true), Vec3(0, 0, 1)) << "in the midst of a repetition, the law goes on";
  (void)played.run(1, false, true);
  EXPECT_EQ(played.renewals, 1);
  const Vec3 plain = played.run(1000, false, false);
  EXPECT_NEAR(plain.x(), 3, 1e-9);
  EXPECT_NEAR(plain.y(), 3, 1e-9);
  EXPECT_NEAR(plain.z(), 0, 1e-9) << "the law has no gains there, and neither has its stand-in";
  EXPECT_NEAR((played.run(500, true, true) - plain).norm(), 0, 1e-9);
  (void)played.run(500, false, true);
  EXPECT_EQ(played.renewals, 1) << "there is no other stand-in";
}

TEST(StandInLaw, ReplacesTheLawWithoutAJumpAndWithoutAnAllocation) {
  Played played;
  (void)played.run(500, true, true);
  const std::size_t before = test::allocations();
  Vec3 last(0, 0, 1);
  for (int k = 0; k < 1000; ++k) {
    const Vec3 force = played.run(1, false, k == 0);
    EXPECT_LT((force - last).norm(), 0.02);
    last = force;
  }
  EXPECT_EQ(test::allocations(), before);
}

TEST(StandInLaw, FollowsTheTunedGains) {
  Played played;
  (void)played.run(500, true, true);
  (void)played.run(1000, false, true);
  played.tuning.gains = {0.5 * kOwn.kp, 0.5 * kOwn.kd};
  EXPECT_NEAR(played.run(1, false, false).x(), 1.5, 1e-9);
  EXPECT_NEAR(played.law.gains(played.tuning).kp.x(), 1500, 1e-9);
}

}  // namespace
}  // namespace haptrace
