#include "control/guidance.h"

#include "control/guide_terms.h"
#include "control/tunnel_wall.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

using std::numbers::pi;
using testing::HasSubstr;

constexpr double kRadius = 0.005;

/// Returns a path of 0.2 m along x in 2 s, with an expert force along and across it.
ArcPath straight(double radius = kRadius) {
  ArcPath::Builder builder(2.5e-4);
  for (int i = 0; i <= 2000; ++i) builder.add(1e-3 * i, Vec3(1e-4 * i, 0, 0), Vec3(0.5, 1.5, -0.3));
  return builder.finish(radius);
}

PathProjection::Foot foot_at(const ArcPath& path, const Vec3& tool) {
  PathProjection projection(path, {});
  PathProjection::Foot foot = projection.move_to(tool.x(), tool, 1e-3);
  foot.speed = foot.expert_speed;
  return foot;
}

GuideTerms walls(double stiffness = 1000) {
  GuideTerms terms;
  terms.push_back(
      std::make_unique<TunnelWall>(TunnelWall::Options{.stiffness = stiffness, .onset = 1e-3, .max_force = 8}));
  return terms;
}

GuideTerms damped_walls(double stiffness) {
  GuideTerms terms = walls(stiffness);
  terms.push_back(std::make_unique<WallDamping>(5, 1e-3));
  return terms;
}

GuideTerms everything(double stiffness = 1000) {
  GuideTerms terms = damped_walls(stiffness);
  terms.push_back(std::make_unique<ExpertForce>(1));
  terms.push_back(std::make_unique<PaceHelp>(PaceHelpOptions{}));
  terms.push_back(std::make_unique<Resistance>(1));
  terms.push_back(std::make_unique<Viscosity>(0.5));
  terms.push_back(std::make_unique<ErrorAmplification>(100, 0.5));
  return terms;
}

State moving(const Vec3& position, const Vec3& velocity = Vec3::Zero()) {
  State state;
  state.position = position;
  state.velocity = velocity;
  state.dt = 1e-3;
  return state;
}

TEST(TunnelWall, BeginsSmoothlyAndIsTheSlopeOfItsStoredEnergy) {
  const ArcPath path = straight();
  TunnelWall wall({.stiffness = 1000, .onset = 1e-3, .max_force = 12});
  const auto force = [&](double y) {
    const State state = moving(Vec3(0.1, y, 0));
    return wall.force({state, foot_at(path, state.position)});
  };
  const auto stored = [&](double y) { return wall.stored(foot_at(path, Vec3(0.1, y, 0)), {}); };
  EXPECT_EQ(force(0.004), Vec3::Zero());
  EXPECT_LT(force(0.005).norm(), 1e-12);
  EXPECT_NEAR(force(0.0155).y(), -1000 * 0.01, 1e-6);
  EXPECT_NEAR(force(-0.0155).y(), 1000 * 0.01, 1e-6);
  for (double y = 0.0049; y < 0.009; y += 1e-5) {
    ASSERT_LT((force(y + 1e-5) - force(y)).norm(), 1000 * 1e-5 * 1.001) << "no step, at most its stiffness";
    ASSERT_NEAR((stored(y + 1e-6) - stored(y - 1e-6)) / 2e-6, -force(y).y(), 1e-3);
  }
}

TEST(TunnelWall, StaysBelowItsLargestForceAndStoresTheWorkDoneOnIt) {
  const ArcPath path = straight();
  for (const double most : {0.2, 3.0}) {
    TunnelWall wall({.stiffness = 1000, .onset = 1e-3, .max_force = most});
    double work = 0;
    for (double d = 0; d < 0.01; d += 1e-6) {
      const State state = moving(Vec3(0.1, 0.005 + d, 0));
      const double f = wall.force({state, foot_at(path, state.position)}).norm();
      ASSERT_LE(f, most * (1 + 1e-12));
      work += 1e-6 * f;
    }
    EXPECT_NEAR(work, wall.stored(foot_at(path, Vec3(0.1, 0.015, 0)), {}), 1e-5);
  }
}

TEST(WallDamping, DampsOutwardMovementOnly) {
  const ArcPath path = straight();
  WallDamping damping(5, 1e-3);
  const auto force = [&](double y, double v) {
    const State state = moving(Vec3(0.1, y, 0), Vec3(0.2, v, 0));
    return damping.force({state, foot_at(path, state.position)});
  };
  EXPECT_EQ(force(0.004, 0.1), Vec3::Zero()) << "inside";
  EXPECT_NEAR(force(0.007, 0.1).y(), -0.5, 1e-9);
  EXPECT_NEAR(force(0.0055, 0.1).y(), -0.25, 1e-6) << "in the onset";
  EXPECT_EQ(force(0.007, -0.1), Vec3::Zero()) << "coming back";
  EXPECT_NEAR(force(0.007, 0.1).x(), 0, 1e-12) << "along the wall";
}

TEST(GuideTerms, ThatDissipateNeverAddEnergy) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  const ArcPath path = straight();
  const GuideTerms terms = everything();
  for (int i = 0; i < 10000; ++i) {
    const State state = moving(Vec3(0.1, 0.01 * normal(random), 0.01 * normal(random)),
                               Vec3(normal(random), normal(random), normal(random)));
    const auto foot = foot_at(path, state.position);
    for (const auto& term : terms)
      ASSERT_LE(term->kind() == GuideTerm::Kind::dissipative ? term->force({state, foot}).dot(state.velocity) : 0, 0);
  }
}

TEST(PaceHelp, HelpsOnlyATraineeThatIsTooSlow) {
  const ArcPath path = straight();  // at 0.1 m/s
  PaceHelp help({.pace = 1, .margin = 0.2, .gain = 20, .max_force = 1});
  const auto force = [&](double speed, double gate) {
    auto foot = foot_at(path, Vec3(0.1, 0, 0));
    foot.speed = speed;
    foot.expert_speed = 0.1;
    const State state = moving(Vec3(0.1, 0, 0));
    return help.force({state, foot, gate});
  };
  for (const double speed : {0.08, 0.1, 0.5}) EXPECT_EQ(force(speed, 1), Vec3::Zero()) << speed;
  EXPECT_NEAR(force(0.06, 1).x(), 20 * 0.015, 1e-9);
  EXPECT_NEAR(force(-1, 1).x(), 1, 1e-9) << "bounded";
  EXPECT_NEAR(force(0.06, 0.5).x(), 20 * 0.0075, 1e-9) << "gated";
}

TEST(ErrorAmplification, PushesAwayWithinTheTunnelAndIsGoneWhereTheWallBegins) {
  const ArcPath path = straight();
  ErrorAmplification amplification(200, 0.3);
  const auto force = [&](double y) {
    const State state = moving(Vec3(0.1, y, 0));
    return amplification.force({state, foot_at(path, state.position)}).y();
  };
  EXPECT_NEAR(force(0.001), 0.2, 1e-9);
  EXPECT_NEAR(force(0.003), 0.3, 1e-9) << "clamped";
  EXPECT_NEAR(force(0.00499999), 0, 1e-5);
  EXPECT_EQ(force(0.0051), 0);
}

TEST(Guidance, LetsAFaithfulTraineeFeelTheExpertAlone) {
  const ArcPath path = straight();
  Guidance guidance(everything(), {});
  GuideTerms walls_and_force = walls();
  walls_and_force.push_back(std::make_unique<ExpertForce>(1));
  walls_and_force.push_back(std::make_unique<PaceHelp>(PaceHelpOptions{}));
  Guidance plain(std::move(walls_and_force), {});
  PathProjection projection(path, {});
  for (int i = 0; i < 1900; ++i) {
    const State state = moving(Vec3(1e-4 * i, 3e-3 * std::sin(0.01 * i), 0), Vec3(0.1, 0, 0));
    const Vec3 force = plain.update(state, projection.update(state.position, i == 0 ? 0 : 1e-3), false);
    ASSERT_LT((force - Vec3(0.5, 1.5, -0.3)).norm(), i > 400 ? 1e-6 : 2) << i;
  }
}

TEST(Guidance, FadesTheExpertsForceWithDistanceAndBringsItBackSlowly) {
  const ArcPath path = straight();
  GuideTerms terms = walls(1e-9);
  terms.push_back(std::make_unique<ExpertForce>(2));
  Guidance guidance(std::move(terms), {});
  const auto force = [&](double y) {
    const State state = moving(Vec3(0.1, y, 0));
    return guidance.update(state, foot_at(path, state.position), false).y();
  };
  double f = 0;
  for (int i = 0; i < 400; ++i) f = force(0);
  EXPECT_NEAR(f, 3, 1e-6);
  EXPECT_NEAR(force(0.0075), 1.5, 1e-6) << "half a radius outside";
  EXPECT_NEAR(force(0.011), 0, 1e-9);
  for (int i = 0; i < 150; ++i) f = force(0);
  EXPECT_NEAR(f, 1.5, 0.05) << "half way after half the time";
  for (int i = 0; i < 200; ++i) f = force(0);
  EXPECT_NEAR(force(0.0075), 1.5, 1e-6);
  EXPECT_NEAR(force(0), 3, 1e-6) << "at once, if the gate was not closed";
}

TEST(Guidance, BringsTheExpertsForceBackWithinTheExpertsTimeForAFasterTrainee) {
  const ArcPath path = straight();
  for (const double pace : {0.5, 1.0, 3.0, 50.0}) {
    GuideTerms terms = walls(1e-9);
    terms.push_back(std::make_unique<ExpertForce>(1));
    Guidance guidance(std::move(terms), {});
    double f = 0;
    for (int i = 0; i < 60; ++i) {
      const State state = moving(Vec3(0.1, 0, 0));
      auto foot = foot_at(path, state.position);
      foot.speed = pace * foot.expert_speed;
      f = guidance.update(state, foot, false).y();
    }
    EXPECT_NEAR(f / 1.5, 60e-3 / 0.3 * std::clamp(pace, 1.0, 4.0), 1e-6) << pace;
  }
}

TEST(Guidance, FadesForcesOfAPlaceThatIsInDoubt) {
  const ArcPath path = straight();
  GuideTerms terms = walls(1e-9);
  terms.push_back(std::make_unique<ExpertForce>(1));
  terms.push_back(std::make_unique<PaceHelp>(PaceHelpOptions{}));
  Guidance guidance(std::move(terms), {});
  const auto force = [&](double certainty, double heading_certainty) {
    const State state = moving(Vec3(0.1, 0, 0));
    auto foot = foot_at(path, state.position);
    foot.speed = 0;
    foot.expert_speed = 0.1;
    foot.certainty = certainty;
    foot.heading_certainty = heading_certainty;
    return guidance.update(state, foot, false);
  };
  for (int i = 0; i < 400; ++i) (void)force(1, 0);
  EXPECT_NEAR(force(1, 0).y(), 1.5, 1e-6);
  EXPECT_NEAR(force(0.5, 0).y(), 0.75, 1e-6);
  EXPECT_NEAR(force(0, 0).norm(), 0, 1e-6);
  EXPECT_NEAR(force(0, 1).x(), 1, 1e-6) << "the help along the path, at its largest";
}

/// Returns the foot of a tool at y = 10 mm, 5 mm deep in the wall of a tunnel, that stands `depth` [m] deep in the wall
/// of the nearest plausible one, after `depth_before` in those before.
PathProjection::Foot between_tunnels(const ArcPath& path, double depth_before, double depth) {
  const Vec3 tool(0.1, 0.01, 0);
  PathProjection::Foot foot = foot_at(path, tool);
  const auto tube = [&](double deep) {
    return PathProjection::tube_of(tool - Vec3(0, kRadius + deep, 0), kRadius, tool);
  };
  foot.tube_before = tube(depth_before);
  foot.tube = tube(depth);
  return foot;
}

TEST(Guidance, DiscardsTheEnergyOfAWallThatTurnsOutToBeWrong) {
  const ArcPath path = straight();
  Guidance guidance(walls(), {});
  const State state = moving(Vec3(0.1, 0.01, 0));
  for (int i = 0; i < 3; ++i) (void)guidance.update(state, between_tunnels(path, 5e-3, 5e-3), false);
  const double level = guidance.tank().level(), given = guidance.given();
  double before = guidance.update(state, between_tunnels(path, 5e-3, -1e-3), false).norm();
  EXPECT_NEAR(before, 4.5, 0.02);
  for (int i = 0; i < 299; ++i) {
    const double force = guidance.update(state, between_tunnels(path, -1e-3, -1e-3), false).norm();
    EXPECT_NEAR(before - force, 4.5e-3 / WallRelease::kTime, 1e-6) << "it goes evenly, tick " << i;
    before = force;
  }
  EXPECT_NEAR(guidance.update(state, between_tunnels(path, -1e-3, -1e-3), false).norm(), 0, 1e-9);
  EXPECT_NEAR(guidance.tank().level(), level, 1e-12) << "not credited";
  EXPECT_NEAR(guidance.given(), given, 1e-12);
}

TEST(Guidance, TurnsAWallsForceWithoutAStep) {
  const ArcPath path = straight();
  Guidance guidance(walls(), {});
  const State state = moving(Vec3(0.1, 0.01, 0));
  const auto elsewhere = [&](PathProjection::Foot foot) {
    foot.tube = PathProjection::tube_of(state.position + Vec3(kRadius + 5e-3, 0, 0), kRadius, state.position);
    return foot;
  };
  Vec3 before = Vec3::Zero();
  for (int i = 0; i < 3; ++i) before = guidance.update(state, between_tunnels(path, 5e-3, 5e-3), false);
  EXPECT_NEAR(before.y(), -4.5, 1e-9);
  for (int i = 0; i < 600; ++i) {
    auto foot = elsewhere(between_tunnels(path, 5e-3, 5e-3));
    if (i > 0) foot.tube_before = foot.tube;
    const Vec3 force = guidance.update(state, foot, false);
    ASSERT_LE((force - before).norm(), 0.05) << "tick " << i;
    before = force;
  }
  EXPECT_LT((before - Vec3(4.5, 0, 0)).norm(), 0.05);
  EXPECT_LE(guidance.given(), guidance.budget());
}

TEST(WallRelease, GivesNoMoreThanTheEnergyThatItHolds) {
  const Vec3 place(0.02, 0.01, -0.03), force(3, -4, 0), along = force.normalized();
  const WallRelease release(force, place, 0.05);
  EXPECT_EQ(release.force(place), force);
  EXPECT_DOUBLE_EQ(release.stored(place), 0.05);
  double work = 0;
  constexpr double kStep = 1e-5;  // [m]
  for (double x = 0; x < 0.03; x += kStep) {
    const Vec3 here = place + x * along, next = place + (x + kStep) * along;
    const double step = kStep * 0.5 * (release.force(here) + release.force(next)).dot(along);
    EXPECT_NEAR(step, release.stored(here) - release.stored(next), 1e-8);
    work += step;
  }
  EXPECT_NEAR(work, 0.05, 1e-6);
  EXPECT_NEAR((release.stored(place - 0.01 * along) - 0.05) / 0.01, 5, 1e-6) << "pushed against: the force stays";
  EXPECT_EQ(release.force(place - 0.01 * along), force);
  WallRelease later = release;
  for (int i = 0; i < 150; ++i) later.pass(1e-3);
  EXPECT_NEAR(later.force(place).norm(), 2.5, 1e-9);
  for (int i = 0; i < 151; ++i) later.pass(1e-3);
  EXPECT_EQ(later.force(place), Vec3::Zero());
  EXPECT_EQ(later.stored(place), 0);
}

TEST(Guidance, RaisesAWallThatAppearsSlowlyAndPaysForItsEnergy) {
  const ArcPath path = straight();
  const TunnelWall wall({.stiffness = 1000, .onset = 1e-3, .max_force = 8});
  const double energy = wall.stored(between_tunnels(path, 5e-3, 5e-3), {});
  for (const double capacity : {0.3, 0.5 * energy}) {
    Guidance guidance(walls(), {.energy = capacity});
    const State state = moving(Vec3(0.1, 0.01, 0));
    for (int i = 0; i < 3; ++i) (void)guidance.update(state, between_tunnels(path, -1e-3, -1e-3), false);
    double before = guidance.update(state, between_tunnels(path, -1e-3, 5e-3), false).norm();
    EXPECT_LT(before, 0.02) << "it begins without force";
    for (int i = 0; i < 500; ++i) {
      const double force = guidance.update(state, between_tunnels(path, 5e-3, 5e-3), false).norm();
      ASSERT_LE(force - before, 0.02) << i;
      before = force;
    }
    EXPECT_NEAR(before / 4.5, std::min(capacity / energy, 1.0), 0.01) << "of the force of 4.5 N";
    EXPECT_NEAR(guidance.given(), std::min(energy, capacity), 0.01 * energy);
    EXPECT_GE(guidance.tank().level(), 0);
  }
}

TEST(Guidance, CreditsWhatWasWalkedAndNoMoreThanTheHandMoved) {
  const ArcPath path = straight();
  const double allowance = 0.5;  // the expert's force along the path [N]
  const auto credit = [&](const std::vector<std::pair<double, bool>>& places) {
    GuideTerms terms = walls();
    terms.push_back(std::make_unique<ExpertForce>(1));
    Guidance guidance(std::move(terms), {});
    double moved = 0;
    for (const auto& [s, relocated] : places) {
      PathProjection projection(path, {});
      auto foot = projection.move_to(s, Vec3(moved, 0, 0), 1e-3);
      foot.relocated = relocated;
      (void)guidance.update(moving(Vec3(moved, 0, 0)), foot, false);
      moved += 1e-3;
    }
    return guidance.budget() - 0.3;
  };
  EXPECT_NEAR(credit({{0, false}, {1e-3, false}, {2e-3, false}}), allowance * 2e-3, 1e-9);
  EXPECT_NEAR(credit({{0, false}, {0.01, false}}), allowance * 1e-3, 1e-9) << "the hand moved 1 mm";
  EXPECT_NEAR(credit({{0, false}, {0.1, true}, {0.101, false}}), allowance * 1e-3, 1e-9) << "nobody walked the rest";
  EXPECT_NEAR(credit({{0.1, false}, {0.101, false}, {0, true}, {1e-3, false}}), allowance * 2e-3, 1e-9)
      << "skipped, and walked later";
  EXPECT_NEAR(credit({{0, false}, {1e-3, false}, {0, false}, {1e-3, false}}), allowance * 1e-3, 1e-9) << "once";
}

TEST(Guidance, ChargesAForceWhenItActs) {
  // One force is sent, for a tick of 1 ms and with a delay of 1.25 ms: three quarters of it act in the second tick, the
  // rest in the third.
  const ArcPath path = straight();
  Guidance guidance(walls(), {.delay = 1.25e-3});
  std::vector<double> given;
  for (int i = 0; i < 6; ++i) {
    State state = moving(Vec3(1e-4 * i, 0, 0));
    state.force_applied = i == 2 ? Vec3(2, 0, 0) : Vec3(Vec3::Zero());
    const double before = guidance.given();
    (void)guidance.update(state, foot_at(path, state.position), false);
    given.push_back(guidance.given() - before);
  }
  const std::vector<double> expected{0, 0, 0, 0.75 * 2e-4, 0.25 * 2e-4, 0};
  for (std::size_t i = 0; i < given.size(); ++i) EXPECT_NEAR(given[i], expected[i], 1e-12) << i;
}

TEST(Guidance, RefusesToReplayForcesWithoutAWall) {
  GuideTerms terms;
  terms.push_back(std::make_unique<ExpertForce>(1));
  EXPECT_THAT(test::error_of([&] { Guidance(std::move(terms), {}); }), HasSubstr("without walls"));
  EXPECT_THAT(test::error_of([] { Guidance(walls(), {.energy = 0}); }), HasSubstr("the energy of guidance is 0"));
}

TEST(Guidance, AllocatesNothing) {
  const ArcPath path = straight();
  Guidance guidance(everything(), {});
  PathProjection projection(path, {});
  const std::size_t before = test::allocations();
  for (int i = 0; i < 1000; ++i) {
    const State state = moving(Vec3(1e-4 * i, 0.008 * std::sin(0.1 * i), 0), Vec3(0.1, 0, 0));
    (void)guidance.update(state, projection.update(state.position, 1e-3), i % 2 == 0);
  }
  EXPECT_EQ(test::allocations(), before);
}

TEST(Guidance, GivesAForceNoMoreEnergyThanTheTankHolds) {
  // A force follows the hand and shakes it to and fro in one place. Without the tank it would be an endless source of
  // energy.
  const ArcPath path = straight(0.1);
  GuideTerms terms = walls();
  terms.push_back(std::make_unique<ErrorAmplification>(1000, 2));
  Guidance guidance(std::move(terms), {.energy = 0.2, .delay = 0});
  double given = 0, before = 0;
  Vec3 sent = Vec3::Zero();
  for (int i = 0; i < 20000; ++i) {
    // Moves in and out, and jumps to the opposite side every second.
    const double y = 0.02 * std::abs(std::fmod(0.002 * i, 2.0) - 1) * (i % 2000 < 1000 ? 1 : -1);
    State state = moving(Vec3(0.1, y, 0), Vec3(0, (y - before) / 1e-3, 0));
    state.force_applied = sent;
    given += sent.y() * (y - before);
    before = y;
    sent = guidance.update(state, foot_at(path, state.position), false);
  }
  EXPECT_LT(given, 0.2 + 0.02);
}

/// A hand that moves along the path with tremor and disturbances. It holds a device of 0.3 kg with 1 N s/m of viscous
/// and 0.2 N of dry friction.
struct Hand {
  double mass, stiffness, damping, speed, tremor;
  double wander;   ///< Amplitude of a movement across the path [m].
  bool lets_go;    ///< Lets go of the device between 2 and 3 s.
  bool pushes_on;  ///< Pushes against the wall between 1 and 2 s.
};

struct Loop {
  double rate_hz, delay, radius, stiffness;
};

struct Outcome {
  double given = 0, budget = 0;  ///< Work of the force and spring energy, beyond the budget; the budget [J].
  double farthest = 0;           ///< Largest distance from the path after the first second [m].
  double ripple = 0;             ///< Rms speed above some 2 Hz in the last half second of 2 s without a hand [m/s].
};

enum class Terms { all, walls };

Outcome guided(const Hand& hand, const Loop& loop, bool cursor, Terms terms) {
  ArcPath::Builder builder(2.5e-4);
  for (int i = 0; i <= 4000; ++i) {
    const double u = i / 4000.0;
    builder.add(1e-3 * i, Vec3(0.06 * std::sin(2 * pi * u), 0.04 * std::sin(4 * pi * u), 0),
                Vec3(std::cos(2 * pi * u), 1, 0.3));
  }
  const ArcPath path = builder.finish(loop.radius);
  const double stiffness = std::min(loop.stiffness, largest_wall_stiffness(loop.rate_hz, loop.delay));
  Guidance guidance(terms == Terms::all ? everything(stiffness) : damped_walls(stiffness),
                    {.delay = loop.delay, .rate_hz = loop.rate_hz});
  PathProjection projection(path, {});
  std::mt19937 random(5);
  std::normal_distribution<double> normal;

  const double period = 1 / loop.rate_hz, step = 2e-5;
  const int steps = static_cast<int>(std::lround(period / step));
  const double mass = 0.3 + hand.mass;
  std::deque<Vec3> late(static_cast<std::size_t>(std::lround(loop.delay * loop.rate_hz)), Vec3::Zero());
  Vec3 x = path.at(0).position, v = Vec3::Zero(), estimate = Vec3::Zero(), before = x, acting = Vec3::Zero(),
       sent = Vec3::Zero(), tremor = Vec3::Zero(), slow = Vec3::Zero();
  TunnelWall wall({.stiffness = stiffness, .onset = 1e-3, .max_force = 8});
  Outcome outcome;
  double wanted = 0, given = 0, ripple = 0;
  int rippled = 0;
  const double duration = 6;
  for (int tick = 0; tick * period < duration; ++tick) {
    const double t = tick * period;
    for (int axis = 0; axis < 3; ++axis)
      tremor[axis] += period * 60 * (hand.tremor * normal(random) / std::sqrt(0.5 * 60 * period) - tremor[axis]);
    wanted += hand.speed * period;
    const bool holds = !(hand.lets_go && t > 2 && t < 3) && t < duration - 2;
    Vec3 will = path.at(wanted).position + tremor + Vec3(0, 0, hand.wander * std::sin(7 * t));
    if (hand.pushes_on && t > 1 && t < 2) will += Vec3(0.03, 0.03, 0);
    for (int i = 0; i < steps; ++i) {
      const Vec3 force = holds ? Vec3(hand.stiffness * (will - x) - hand.damping * v) : Vec3(Vec3::Zero());
      v += step / mass * (force + acting - 1.0 * v);
      v *= std::max(1 - 0.2 * step / mass / std::max(v.norm(), 1e-12), 0.0);  // dry friction
      const Vec3 dx = step * v;
      x += dx;
      given += acting.dot(dx);
    }
    State state = moving(x);
    state.dt = period;
    estimate += -std::expm1(-2 * pi * 60 * period) * ((x - before) / period - estimate);
    before = x;
    state.velocity = estimate;
    state.force_applied = sent;
    const auto& foot =
        cursor ? projection.move_to(0.8 * wanted, x, period) : projection.update(x, tick == 0 ? 0 : period);
    sent = guidance.update(state, foot, cursor);
    if (sent.norm() > 10) sent *= 10 / sent.norm();
    if (late.empty()) {
      acting = sent;
    } else {
      late.push_back(sent);
      acting = late.front();
      late.pop_front();
    }
    outcome.given = std::max(outcome.given, given + wall.stored(foot, {}) - guidance.budget());
    if (t > 1) outcome.farthest = std::max(outcome.farthest, foot.distance);
    slow += -std::expm1(-period / 0.08) * (v - slow);
    if (t > duration - 0.5) {
      ripple += (v - slow).squaredNorm();
      ++rippled;
    }
  }
  outcome.budget = guidance.budget();
  outcome.ripple = std::sqrt(ripple / rippled);
  return outcome;
}

class GuidedHand : public testing::TestWithParam<bool> {};

TEST_P(GuidedHand, ReceivesNoMoreThanTheBudgetAndComesToRestWhenItLetsGo) {
  std::mt19937 random(9);
  std::uniform_real_distribution<double> number(0, 1);
  const auto between = [&](double low, double high) { return low * std::pow(high / low, number(random)); };
  for (int i = 0; i < 60; ++i) {
    const Hand hand{.mass = between(0.005, 1.5),
                    .stiffness = between(50, 1000),
                    .damping = between(2, 40),
                    .speed = between(0.02, 0.4),
                    .tremor = i % 4 == 0 ? 2e-3 : 2e-4,
                    .wander = i % 3 == 0 ? 0.012 : 0.002,
                    .lets_go = i % 2 == 0,
                    .pushes_on = i % 5 == 0};
    const Loop loop{.rate_hz = std::array{250.0, 1000.0, 4000.0, 10000.0}[static_cast<std::size_t>(i) % 4],
                    .delay = std::array{0.0, 1e-3, 5e-3}[static_cast<std::size_t>(i) % 3],
                    .radius = std::array{0.0, 5e-3}[static_cast<std::size_t>(i / 2) % 2],
                    .stiffness = std::array{300.0, 3000.0}[static_cast<std::size_t>(i / 4) % 2]};
    const Outcome outcome = guided(hand, loop, GetParam(), Terms::all);
    const Outcome passive = guided(hand, loop, GetParam(), Terms::walls);
    SCOPED_TRACE(fmt::format("hand {} of {:.3f} kg, {} Hz, delay {} s, radius {} m, {} N/m", i, hand.mass, loop.rate_hz,
                             loop.delay, loop.radius, loop.stiffness));
    EXPECT_LT(outcome.given, 0.005) << "J beyond a budget of " << outcome.budget;
    EXPECT_LT(passive.given, 0.005);
    EXPECT_LT(outcome.farthest, 0.15);
    EXPECT_LT(GetParam() ? 0 : passive.ripple, 0.06)
        << "a hand that springs hold comes to rest; a cursor keeps pulling";
  }
}

INSTANTIATE_TEST_SUITE_P(, GuidedHand, testing::Bool(),
                         [](const auto& tested) { return tested.param ? "WithACursor" : "InATunnel"; });

}  // namespace
}  // namespace haptrace
