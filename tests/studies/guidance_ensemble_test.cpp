#include "studies/guidance_ensemble.h"

#include "control/path/shapes.h"
#include "tests/support/errors.h"

#include <algorithm>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::error_of;
using testing::HasSubstr;

TEST(GuidanceDraws, AreTheSameEverywhereAndEachAnother) {
  const GuidanceDraw draw = draw_guidance(1, 0), again = draw_guidance(1, 0), other = draw_guidance(1, 1);
  EXPECT_EQ(draw.guide.session.loop.rate_hz, again.guide.session.loop.rate_hz);
  EXPECT_EQ(draw.trainee.seed, again.trainee.seed);
  EXPECT_NE(draw.guide.session.loop.rate_hz, other.guide.session.loop.rate_hz);
  EXPECT_NE(draw.trainee.seed, other.trainee.seed);
}

TEST(GuidanceDraws, CoverTheirStatedRanges) {
  namespace ranges = guidance_ensemble;
  int walls_alone = 0, cursors = 0, calibrated = 0, let_go = 0;
  double slowest = 1e9, fastest = 0, lightest = 1e9, heaviest = 0, latest = 0;
  for (std::uint64_t i = 0; i < 1000; ++i) {
    const GuidanceDraw draw = draw_guidance(3, i);
    const double rate = draw.guide.session.loop.rate_hz;
    ASSERT_TRUE(rate >= ranges::kRate.low && rate <= ranges::kRate.high);
    slowest = std::min(slowest, rate);
    fastest = std::max(fastest, rate);
    latest = std::max(latest, draw.device.spec.delay);
    walls_alone += draw.guide.radius == 0;
    cursors += draw.guide.guidance.cursor;
    calibrated += draw.guide.identified.has_value();
    let_go += draw.trainee.lets_go.has_value();
    if (!draw.device.spec.hand) continue;
    lightest = std::min(lightest, draw.device.spec.hand->mass);
    heaviest = std::max(heaviest, draw.device.spec.hand->mass);
  }
  EXPECT_LT(slowest, 1.05 * ranges::kRate.low);
  EXPECT_GT(fastest, 0.95 * ranges::kRate.high);
  EXPECT_GT(latest, 0.95 * (ranges::kFurtherDelay.high + ensemble::kDelay.high));
  EXPECT_LT(lightest, 1.05 * ranges::kHandMass.low);
  EXPECT_GT(heaviest, 0.95 * ranges::kHandMass.high);
  EXPECT_NEAR(walls_alone, 1000 * ranges::kNoRadius, 60);
  EXPECT_NEAR(cursors, 1000 * ranges::kCursor, 60);
  EXPECT_NEAR(calibrated, 1000 * ranges::kCalibrated, 60);
  EXPECT_NEAR(let_go, 1000 * ranges::kLetsGo, 60);
}

TEST(TraineesIntent, FollowsThePathStopsTurnsBackLeavesAndPushes) {
  const Path line = make_shape("reach", {.size = 0.1, .duration = 4, .constant_speed = true});
  Trainee trainee{.speed = 2, .seed = 5};
  for (Whim* whim : {&trainee.stops, &trainee.returns, &trainee.leaves, &trainee.pushes}) *whim = {.at = 2};  // never
  const Path plain = intent_of(trainee, line);
  EXPECT_NEAR(plain.duration(), kTraineeWaits + 4 / 2.0, 0.01);
  double off2 = 0;
  for (const Vec3& p : plain.position) off2 += p.z() * p.z();
  EXPECT_NEAR(std::sqrt(off2 / static_cast<double>(plain.size())), guidance_ensemble::kWander, 1e-3);

  trainee.stops = {.at = 0.3, .lasts = 0.5};
  trainee.returns = {.at = 0.5, .lasts = 0.4};
  trainee.leaves = {.at = 0.7, .lasts = 0.3, .way = Vec3(0, 0.03, 0)};
  trainee.pushes = {.at = 0.8, .lasts = 0.2, .way = Vec3(0, 0, 0.05)};
  const Path wilful = intent_of(trainee, line);
  EXPECT_NEAR(wilful.duration() - plain.duration(), 0.5 + 2 * 0.4, 0.02);
  const auto farthest = [](const Path& path, int axis) {
    double most = 0;
    for (const Vec3& p : path.position) most = std::max(most, p[axis]);
    return most;
  };
  EXPECT_GT(farthest(wilful, 1), 0.023);
  EXPECT_GT(farthest(wilful, 2), 0.043);
}

std::string failures(const GuidanceReport& report) {
  return to_json(report).dump(1);
}

TEST(GuidanceEnsemble, IsStableWithinTheBudgetAndWithoutJumpsInEveryHand) {
  const GuidanceReport report = run_guidance_ensemble({.seed = 11, .draws = 12}, StopRequest{});
  ASSERT_EQ(report.members.size(), 12U);
  for (const GuidanceMember& member : report.members) {
    ASSERT_EQ(member.runs.size(), guidance_paths().size());
    for (const GuidanceRun& run : member.runs) EXPECT_GT(run.speed, 0.02) << "a trainee moves";
  }
  EXPECT_EQ(report.failures(), 0U) << failures(report);
}

TEST(GuidanceEnsemble, IsTheSameToTheBitWhateverTheThreads) {
  GuidanceEnsembleOptions options{.draws = 3, .paths = {guidance_paths()[5]}, .threads = 1};
  const std::string one = to_json(run_guidance_ensemble(options, StopRequest{})).dump();
  options.threads = 2;
  EXPECT_EQ(one, to_json(run_guidance_ensemble(options, StopRequest{})).dump());
  const nlohmann::json third = nlohmann::json::parse(one)["members"][2];
  options.first = 2;
  options.draws = 1;
  EXPECT_EQ(to_json(run_guidance_ensemble(options, StopRequest{}))["members"][0], third)
      << "a draw that stood out can be run alone";
}

/// Returns a free device between walls that are too stiff for it.
GuidanceDraw shaken() {
  GuidanceDraw draw = draw_guidance(1, 0);
  SimSpec& spec = draw.device.spec;
  spec.hand.reset();
  spec.coulomb.setZero();
  spec.presliding_stiffness.setZero();
  spec.delay = 6e-3;
  draw.guide.session.loop.rate_hz = 1000;
  draw.guide.radius = 0;
  draw.guide.stiffness = 2000;
  draw.guide.expert = true;
  draw.guide.guidance.cursor = false;
  return draw;
}

TEST(GuidanceEnsemble, DetectsWallsThatAreTooStiffForTheDevice) {
  GuidanceDraw draw = shaken();
  draw.guide.guard = false;
  const GuidanceRun alone = run_guidance_member(draw, {guidance_paths()[0]}, StopRequest{}).runs.at(0);
  EXPECT_TRUE(alone.failed());
  EXPECT_TRUE(alone.unstable() || alone.stopped()) << "it oscillates, or is too fast in the end";
}

TEST(GuidanceEnsemble, SoftensWallsThatAreTooStiffForTheDevice) {
  const GuidanceRun run = run_guidance_member(shaken(), {guidance_paths()[0]}, StopRequest{}).runs.at(0);
  EXPECT_GT(run.oscillations, 0);
}

TEST(GuidanceEnsemble, CountsFailuresByDrawAndPath) {
  GuidanceReport report{.seed = 2, .draws = 2, .paths = {"circle", "line"}};
  report.members = {{.index = 4, .runs = {{.excess = -0.3}, {.excess = 0.1}}},
                    {.index = 5, .runs = {{.excess = -0.3, .jump = 3e-3}, {.ripple = 1e-3, .ripple_alone = 1e-3}}}};
  report.members[0].runs[1].cause = StopCause::velocity;
  EXPECT_EQ(report.failures(), 2U);
  const nlohmann::json json = to_json(report);
  const auto names = [](std::uint64_t draw, const char* path) {
    return nlohmann::json::array({{{"draw", draw}, {"path", path}}});
  };
  EXPECT_EQ(json["beyond_budget"], names(4, "line"));
  EXPECT_EQ(json["stopped"], names(4, "line"));
  EXPECT_EQ(json["jumped"], names(5, "circle"));
  EXPECT_TRUE(json["unstable"].empty()) << "the hand shakes as much alone";
  EXPECT_EQ(json["failed"], 2);
  EXPECT_THAT(text_of(report), HasSubstr("2 runs failed"));
}

TEST(GuidanceEnsemble, RejectsInvalidOptionsBeforeItStarts) {
  EXPECT_THAT(error_of([] { run_guidance_ensemble({.draws = 0}, StopRequest{}); }),
              HasSubstr("the number of draws is 0;"));
  GuidanceEnsembleOptions options;
  options.paths = {make_shape("circle", {.size = 0.9})};
  EXPECT_THAT(error_of([&] { run_guidance_ensemble(options, StopRequest{}); }), HasSubstr("leaves the workspace"));
}

}  // namespace
}  // namespace haptrace
