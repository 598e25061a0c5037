#include "studies/ensemble.h"

#include "control/path/shapes.h"
#include "devices/sim/sim_device.h"
#include "player/playback/playback.h"
#include "studies/ensemble_report.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <set>

namespace haptrace {
namespace {

using ensemble::Range;
using test::error_of;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

// --- The draws ------------------------------------------------------------------------------------------------------

/// Observed values of one quantity, compared with the range of its draws.
class Seen {
 public:
  explicit Seen(const Range& range) : range_(range) {}
  void operator()(double value) {
    EXPECT_GE(value, range_.low * (1 - 1e-12));
    EXPECT_LE(value, range_.high * (1 + 1e-12));
    least_ = std::min(least_, value);
    most_ = std::max(most_, value);
  }
  /// Expects values up to within `share` of both ends of the range.
  void expect_all_of_it(double share = 0.03) const {
    const double room = share * (range_.high - range_.low);
    EXPECT_LE(least_, range_.low + room);
    EXPECT_GE(most_, range_.high - room);
  }

 private:
  Range range_;
  double least_ = std::numeric_limits<double>::infinity(), most_ = -least_;
};

constexpr std::uint64_t kMany = 1000;

TEST(EnsembleDraws, LieWithinTheirRangesAndUseAllOfThem) {
  const auto of_axis = [](const Range& range) {
    return Range{range.low * ensemble::kOfAxis.low, range.high * ensemble::kOfAxis.high};
  };
  Seen mass(of_axis(ensemble::kMass)), viscous(of_axis(ensemble::kViscous)), coulomb(of_axis(ensemble::kCoulomb)),
      ratio(ensemble::kStaticRatio), stribeck(ensemble::kStribeckVelocity), presliding(ensemble::kPreslidingDistance),
      cogging(ensemble::kCogging), period(ensemble::kCoggingPeriod), gravity(ensemble::kGravity),
      gradient(ensemble::kGravityGradient), rotation(ensemble::kRotation), delay(ensemble::kDelay),
      lag(ensemble::kActuatorLag), hand_mass(ensemble::kHandMass), grip(ensemble::kGripStiffness),
      grip_damping(ensemble::kGripDamping), arm(ensemble::kArmStiffness), relaxation(ensemble::kArmRelaxation),
      arm_damping(ensemble::kArmDamping);
  for (std::uint64_t i = 0; i < kMany; ++i) {
    const SimSpec s = draw_device(7, i).spec;
    for (int axis = 0; axis < 3; ++axis) {
      mass(s.mass[axis]);
      viscous(s.viscous[axis]);
      coulomb(s.coulomb[axis]);
      presliding(s.coulomb[axis] / s.presliding_stiffness[axis]);
      gradient(s.gravity_gradient(axis, axis));
      EXPECT_LE(s.mass.maxCoeff() / s.mass.minCoeff(), 1.15 / 0.85);
    }
    ratio(s.static_ratio);
    stribeck(s.stribeck_velocity);
    cogging(s.cogging.x());
    period(s.cogging_period);
    gravity(s.gravity_bias.norm());
    rotation(s.rotation.norm());
    delay(s.delay);
    lag(1 / (2 * std::numbers::pi * s.actuator_bandwidth_hz));
    EXPECT_EQ(s.gravity_gradient, s.gravity_gradient.transpose());
    EXPECT_EQ(s.max_force, 8.9);
    EXPECT_EQ(s.position_resolution, 5e-5);
    EXPECT_EQ(s.force_resolution, 5e-3);
    if (!s.hand) continue;
    hand_mass(s.hand->mass);
    grip(s.hand->grip_stiffness);
    grip_damping(s.hand->grip_damping);
    arm(s.hand->arm_stiffness);
    relaxation(s.hand->arm_relaxation);
    arm_damping(s.hand->arm_damping);
    EXPECT_EQ(s.hand->tremor, 0.04);
    EXPECT_EQ(s.hand->drift, 0.15);
  }
  for (const Seen* seen : {&ratio, &stribeck, &presliding, &cogging, &period, &gravity, &gradient, &rotation, &delay,
                           &lag, &hand_mass, &grip, &grip_damping, &arm, &relaxation, &arm_damping})
    seen->expect_all_of_it();
  for (const Seen* seen : {&mass, &viscous, &coulomb}) seen->expect_all_of_it(0.1);  // each is a product of two draws
}

TEST(EnsembleDraws, HaveOneDeviceInTenWithoutAHandAndGravityInEveryDirection) {
  int free = 0;
  Vec3 pull = Vec3::Zero();
  double grip = 0;
  for (std::uint64_t i = 0; i < kMany; ++i) {
    const SimSpec s = draw_device(1, i).spec;
    pull += s.gravity_bias.normalized();
    if (!s.hand)
      ++free;
    else
      grip += std::log(s.hand->grip_stiffness);
  }
  EXPECT_NEAR(free, 0.1 * kMany, 4 * std::sqrt(0.09 * kMany));
  EXPECT_LE(pull.norm(), 4 * std::sqrt(1.0 * kMany));
  EXPECT_NEAR(std::exp(grip / (kMany - free)), std::sqrt(200.0 * 2000), 40) << "even on a logarithmic scale";
}

TEST(EnsembleDraws, OfAHardKindDifferOnlyInWhatItsNameSays) {
  for (std::uint64_t i = 0; i < 100; ++i) {
    const SimSpec small = draw_device(3, i).spec, late = draw_device(3, i, EnsembleKind::late).spec;
    EXPECT_EQ(small.mass, late.mass);
    EXPECT_EQ(small.rotation, late.rotation);
    ASSERT_TRUE(late.hand);
    EXPECT_GE(late.delay, ensemble::kLateDelay.low);
    EXPECT_LE(late.delay, ensemble::kLateDelay.high);
    EXPECT_EQ(late.hand->drift_hz, ensemble::kHardDriftHz);
    if (small.hand) {
      EXPECT_EQ(small.hand->grip_stiffness, late.hand->grip_stiffness);
    }

    const auto of = [&](EnsembleKind kind) { return draw_device(3, i, kind).spec; };
    EXPECT_EQ(of(EnsembleKind::delay_2).delay, 2e-3);
    EXPECT_EQ(of(EnsembleKind::delay_3).delay, 3e-3);
    EXPECT_EQ(of(EnsembleKind::delay_4).delay, 4e-3);
    EXPECT_EQ(of(EnsembleKind::inertia_50).inertia_variation, 0.5);
    EXPECT_EQ(of(EnsembleKind::inertia_70).inertia_variation, 0.7);
    EXPECT_EQ(of(EnsembleKind::cables).cogging, Vec3(1, 1, 1));
    EXPECT_EQ(of(EnsembleKind::backlash).backlash, 0.2e-3);
    EXPECT_GE(of(EnsembleKind::link).structural_mode->frequency_hz, 45);
    EXPECT_LT(of(EnsembleKind::saturation).strongest(), 5.01);
    EXPECT_EQ(of(EnsembleKind::saturation).max_force, small.max_force);
    EXPECT_EQ(of(EnsembleKind::tremor_one).hand->tremor, 1);
    const SimSpec everything = of(EnsembleKind::everything);
    EXPECT_EQ(everything.delay, 3e-3);
    EXPECT_EQ(everything.inertia_variation, 0.5);
    EXPECT_GT(everything.backlash, 0);
    EXPECT_EQ(everything.cogging_period, 3e-3);
  }
}

TEST(EnsembleDraws, HaveFixedSharesOfTheHardKinds) {
  const std::vector<EnsembleKind> kinds = hard_kinds();
  ASSERT_EQ(kinds.size(), 20U);
  EXPECT_EQ(std::count(kinds.begin(), kinds.end(), EnsembleKind::late), 7);
  for (const std::string& name : ensemble_kind_names()) {
    const EnsembleKind kind = parse_ensemble_kind(name);
    EXPECT_EQ(to_string(kind), name);
    if (kind != EnsembleKind::small && kind != EnsembleKind::late) {
      EXPECT_EQ(std::count(kinds.begin(), kinds.end(), kind), 1) << name;
    }
  }
  EXPECT_THAT(error_of([] { (void)parse_ensemble_kind("cable"); }), HasSubstr("cables"));
}

TEST(EnsembleDraws, AreTheSameEverywhereAndEachAnother) {
  std::set<std::uint64_t> noise;
  std::set<double> masses;
  for (const std::uint64_t seed : {1U, 2U})
    for (std::uint64_t i = 0; i < kMany; ++i) {
      const EnsembleDraw draw = draw_device(seed, i);
      noise.insert(draw.noise_seed);
      masses.insert(draw.spec.mass.x());
    }
  EXPECT_EQ(noise.size(), 2 * kMany);
  EXPECT_EQ(masses.size(), 2 * kMany);

  const EnsembleDraw draw = draw_device(1, 0);
  EXPECT_DOUBLE_EQ(draw.spec.mass.x(), 0.32318263523722518);
  EXPECT_DOUBLE_EQ(draw.spec.delay, 0.00090631403324286449);
  EXPECT_EQ(draw.noise_seed, 10812886089824823550U);
}

// --- Statistics -----------------------------------------------------------------------------------------------------

TEST(Distribution, HasTheQuantilesOfItsValuesInAnyOrder) {
  std::vector<double> values;
  for (int i = 100; i >= 0; --i) values.push_back(i);
  values.push_back(kNaN);
  values.push_back(std::numeric_limits<double>::infinity());
  const Distribution d = Distribution::of(values);
  EXPECT_EQ(d.count, 101U);
  EXPECT_EQ(d.median, 50);
  EXPECT_EQ(d.p5, 5);
  EXPECT_EQ(d.p95, 95);
  EXPECT_EQ(d.max, 100);
  EXPECT_EQ(Distribution::of({1, 2}).median, 1.5);
  EXPECT_EQ(Distribution::of({3}).p95, 3);
  EXPECT_TRUE(std::isnan(Distribution::of({}).median));
}

/// Returns a member without faults, with errors of 1, 5 and 0.05 mm.
EnsembleMember sound_member(std::uint64_t index) {
  EnsembleMember member{.index = index};
  const std::array rms{1e-3, 5e-3, 5e-5};
  for (std::size_t c = 0; c < rms.size(); ++c)
    member.trials[c].runs = {{.rms_error = rms[c], .peak_error = 2 * rms[c], .force_ripple = 0.2, .ripple = 1e-5}};
  member.overdrive = {.onset = 1.5, .caught = 1.6};
  return member;
}

EnsembleRun& calibrated_run(EnsembleMember& member) {
  return member.trials[2].runs[0];
}

TEST(EnsembleReport, CountsEveryDrawWhereItBelongs) {
  EnsembleReport report{.seed = 4, .draws = 10, .paths = {"circle"}, .learn = 5};
  for (std::uint64_t i = 0; i < 8; ++i) report.members.push_back(sound_member(i));
  auto& m = report.members;
  calibrated_run(m[1]).saturated = 0.02;  // the hand is too strong
  calibrated_run(m[1]).needed_force = 9;
  calibrated_run(m[2]).saturated = 0.02;  // the controller saturates by itself
  calibrated_run(m[3]).cause = StopCause::deviation;
  calibrated_run(m[4]).ripple = 3e-5;
  m[5].trials[2].hold.hunting = 2.1e-5;
  m[6].calibration_error = "no force moves it";
  m[6].trials[2] = {};
  m[7].overdrive = {.onset = 1.5, .calm = false};
  report.members.push_back(sound_member(8));  // lacks force at the peaks, but hardly saturates
  calibrated_run(m[8]).needed_force = 9;

  const EnsembleSummary summary = summarise(report);
  EXPECT_THAT(summary.not_calibrated, ElementsAre(6));
  ASSERT_EQ(summary.paths.size(), 1U);
  const PathSummary& path = summary.paths[0];
  EXPECT_THAT(path.beyond_force, ElementsAre(1));
  EXPECT_EQ(path.counted, 8U);
  const ControllerSummary& calibrated = path.controllers[2];
  EXPECT_THAT(calibrated.saturated, ElementsAre(2));
  EXPECT_THAT(calibrated.stopped, ElementsAre(3));
  EXPECT_THAT(calibrated.limit_cycles, ElementsAre(4));
  EXPECT_EQ(calibrated.rms_error.count, 6U) << "not 1, 3 and 6";
  EXPECT_EQ(path.controllers[0].rms_error.count, 8U);
  EXPECT_DOUBLE_EQ(path.controllers[0].peak_error.median, 2e-3);
  EXPECT_EQ(path.stiff_over_calibrated.count, 6U);
  EXPECT_DOUBLE_EQ(path.stiff_over_calibrated.median, 20);
  EXPECT_DOUBLE_EQ(path.cautious_over_calibrated.median, 100);
  EXPECT_THAT(summary.holds[2].limit_cycles, ElementsAre(5));
  EXPECT_EQ(summary.holds[2].hunting.count, 8U);
  EXPECT_THAT(summary.holds[0].limit_cycles, IsEmpty());
  EXPECT_EQ(summary.overdrive.oscillating.size(), 9U);
  EXPECT_THAT(summary.overdrive.late, ElementsAre(7));
  EXPECT_THAT(summary.overdrive.uncalm, ElementsAre(7));
  EXPECT_NEAR(summary.overdrive.delay.max, 0.1, 1e-12);

  const nlohmann::json json = to_json(report);
  EXPECT_EQ(json["draws"], 9);
  EXPECT_EQ(json["draws_asked"], 10);
  EXPECT_EQ(json["not_calibrated"]["6"], "no force moves it");
  EXPECT_EQ(json["paths"][0]["controllers"]["calibrated"]["rms_error_m"]["median"], 5e-5);
  EXPECT_EQ(json["paths"][0]["controllers"]["calibrated"]["limit_cycles"], nlohmann::json({4}));
  EXPECT_EQ(json["criteria"]["hold_limit_cycle_m"], ensemble::kMostHoldRipple);
  EXPECT_THAT(text_of(report), HasSubstr("20.0 times as accurate as stiff"));

  const Figure figure = figure_of(report);
  ASSERT_EQ(figure.rows.size(), 4U);
  const Series& rms = figure.rows[0][0].series[2];
  EXPECT_EQ(rms.label, "calibrated");
  EXPECT_EQ(rms.x.size(), 6U);
  EXPECT_NEAR(rms.x.front(), std::log10(0.05), 1e-12);
  EXPECT_EQ(rms.y.back(), 100);
}

TEST(EnsembleReport, ShowsEveryKindByItself) {
  EnsembleReport report{.kinds = hard_kinds(), .seed = 4, .draws = 3, .paths = {"circle"}, .learn = 5};
  for (std::uint64_t i = 0; i < 3; ++i) report.members.push_back(sound_member(i));
  report.members[0].kind = report.members[1].kind = EnsembleKind::late;
  report.members[2].kind = EnsembleKind::cables;
  calibrated_run(report.members[1]).rms_error = 1e-4;
  calibrated_run(report.members[1]).force_ripple = 0.1;
  calibrated_run(report.members[2]).shaking = 7e-5;

  const std::vector<KindSummary> kinds = summarise(report).kinds;
  ASSERT_EQ(kinds.size(), 2U);
  EXPECT_EQ(kinds[0].kind, EnsembleKind::late);
  EXPECT_EQ(kinds[0].draws, 2U);
  EXPECT_DOUBLE_EQ(kinds[0].paths[0].stiff_over_calibrated.median, 15);
  EXPECT_DOUBLE_EQ(kinds[0].paths[0].stiff_over_calibrated.min, 10);
  EXPECT_DOUBLE_EQ(kinds[0].paths[0].ripple_over_stiff.median, 0.75);
  EXPECT_EQ(kinds[1].kind, EnsembleKind::cables);
  EXPECT_THAT(kinds[1].paths[0].controllers[2].shaking, ElementsAre(2));
  const nlohmann::json json = to_json(report)["kinds"];
  EXPECT_EQ(json[1]["kind"], "cables");
  EXPECT_EQ(json[0]["paths"][0]["stiff_over_calibrated"]["min"], 10.0);
  EXPECT_THAT(text_of(report), AllOf(HasSubstr("(hard)"), HasSubstr("15.0 (10.0)  0.75  0")));
}

TEST(EnsembleReport, ReportsThatItIsEmpty) {
  const EnsembleReport report{.draws = 5, .paths = {"circle"}};
  EXPECT_EQ(to_json(report)["draws"], 0);
  EXPECT_TRUE(to_json(report)["paths"][0]["stiff_over_calibrated"]["median"].is_number_float());
  EXPECT_NO_THROW(figure_of(report));
  EXPECT_THAT(text_of(report), HasSubstr("0 of 5"));
}

// --- The runs -------------------------------------------------------------------------------------------------------

EnsembleOptions short_options(std::size_t draws) {
  return {.draws = draws, .paths = {make_shape("circle", {.size = 0.04, .duration = 0.8})}, .learn = 2};
}

TEST(Ensemble, IsTheSameToTheBitWhateverTheThreads) {
  EnsembleOptions options = short_options(2);
  options.threads = 1;
  const EnsembleReport one = run_ensemble(options, StopRequest{});
  options.threads = 2;
  const EnsembleReport two = run_ensemble(options, StopRequest{});
  EXPECT_EQ(to_json(one).dump(), to_json(two).dump());
  ASSERT_EQ(one.members.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(one.members[i].index, i);
    EXPECT_FALSE(one.members[i].trial(EnsembleController::cautious).hold.limit_cycle()) << i;
    for (std::size_t c = 0; c < kEnsembleControllers.size(); ++c) {
      const EnsembleRun &a = one.members[i].trials[c].runs.at(0), &b = two.members[i].trials[c].runs.at(0);
      EXPECT_EQ(a.rms_error, b.rms_error);
      EXPECT_EQ(a.ripple, b.ripple);
      EXPECT_GT(a.rms_error, 0);
    }
  }
  options.first = 1;
  options.draws = 1;
  EXPECT_EQ(run_ensemble(options, StopRequest{}).members.at(0).trials[0].runs[0].rms_error,
            one.members[1].trials[0].runs[0].rms_error)
      << "a draw that stood out can be run alone";
}

/// Accumulates the true errors of a session.
class TrueErrors final : public SampleSink {
 public:
  using SampleSink::push;
  explicit TrueErrors(const SimDevice& device) : device_(device) {}
  void push(const Sample& sample) noexcept override {
    if (sample.phase != Phase::run) return;
    sum_ += (device_.true_position() - sample.reference_position).squaredNorm();
    ++samples_;
  }
  void push(const Event& event) noexcept override {
    if (event.code == EventCode::repetition) sum_ = samples_ = 0;
  }
  [[nodiscard]] double rms() const { return std::sqrt(sum_ / samples_); }

 private:
  const SimDevice& device_;
  double sum_ = 0;
  int samples_ = 0;
};

TEST(Ensemble, MatchesThePublicPlayAndMeasuresTheTruePosition) {
  const EnsembleOptions options = short_options(1);
  const EnsembleMember member = run_member(1, 5, options, StopRequest{});
  const EnsembleRun& run = member.trial(EnsembleController::stiff).runs.at(0);

  const EnsembleDraw draw = draw_device(1, 5);
  SimDevice device(draw.spec, {.seed = draw.noise_seed});
  TrueErrors truth(device);
  PlayOptions play_options;
  play_options.gains = PdGains{Vec3::Constant(3000), Vec3::Constant(25)};
  play_options.session.loop.limits.max_velocity = 1.5;
  play_options.playback.repetitions = options.learn;
  play_options.sinks = {&truth};
  const PlayResult result =
      play(device, plan_playback(device.info(), options.paths[0], play_options), play_options, StopRequest{});
  EXPECT_EQ(run.rms_error, truth.rms());
  EXPECT_EQ(run.measured_rms_error, result.last.rms_error);
  EXPECT_EQ(run.force_ripple, result.last.force_ripple);
  EXPECT_NE(run.rms_error, run.measured_rms_error);
  EXPECT_NEAR(run.rms_error, run.measured_rms_error, 5e-5);
}

TEST(Ensemble, PlaysHardKindsInTheirOrderAndSeesThemShake) {
  EnsembleOptions options = short_options(2);
  options.first = 1;
  options.kinds = {EnsembleKind::late, EnsembleKind::tremor_one};
  const EnsembleReport report = run_ensemble(options, StopRequest{});
  ASSERT_EQ(report.members.size(), 2U);
  EXPECT_EQ(report.members[0].kind, EnsembleKind::tremor_one);
  EXPECT_EQ(report.members[1].kind, EnsembleKind::late) << "they repeat";
  for (const EnsembleMember& member : report.members)
    for (const EnsembleTrial& trial : member.trials)
      for (const EnsembleRun& run : trial.runs) {
        EXPECT_GE(run.shaking, 0.99 * run.ripple);
        EXPECT_LT(run.shaking, 10 * run.ripple);
        EXPECT_EQ(run.available_force, ensemble::kMaxForce);
      }
  options.kinds.clear();
  EXPECT_THAT(error_of([&] { run_ensemble(options, StopRequest{}); }), HasSubstr("at least one kind"));
}

TEST(Ensemble, DetectsAPathThatNeedsMoreForceThanTheDeviceHas) {
  EnsembleOptions options = short_options(1);
  options.paths.push_back(make_shape("circle", {.size = 0.18, .duration = 2}));
  std::uint64_t stiff_arm = 0;
  while (true) {
    const auto hand = draw_device(1, stiff_arm).spec.hand;
    if (hand && hand->arm_stiffness > 190 && hand->grip_stiffness > 1000) break;
    ++stiff_arm;
  }
  const EnsembleMember member = run_member(1, stiff_arm, options, StopRequest{});
  EXPECT_FALSE(member.beyond_force(0)) << "4 N do for the small circle";
  EXPECT_TRUE(member.beyond_force(1)) << "17 N would be needed";
}

TEST(Ensemble, OscillatesWithGainsBeyondTheStableRange) {
  EnsembleOptions options = short_options(1);
  options.learn = 0;
  for (const double beyond : {0.2, 3.0}) {
    options.beyond = beyond;
    int oscillating = 0;
    for (std::uint64_t i = 0; i < 4; ++i) {
      oscillating += run_overdrive(1, i, options, StopRequest{}).oscillates();
    }
    EXPECT_EQ(oscillating, beyond < 1 ? 0 : 4);
  }
}

TEST(Ensemble, CatchesAnOscillationThatGrowsIntoSaturationUnevenly) {
  EnsembleOptions options = short_options(1);
  options.learn = 0;
  // The device oscillates at 17 Hz against the largest force: every other half of a window delivers almost no energy.
  const EnsembleOverdrive overdrive = run_overdrive(1, 159, options, StopRequest{});
  EXPECT_TRUE(overdrive.oscillates());
  EXPECT_LT(overdrive.delay(), ensemble::kCatchWithin);
}

TEST(Ensemble, ReportsTheDrawsThatWereFinishedWhenItIsCancelled) {
  StopRequest stop;
  std::size_t told = 0;
  const EnsembleReport report = run_ensemble(short_options(100000), stop, [&](const EnsembleProgress& progress) {
    told = std::max(told, progress.done);
    EXPECT_EQ(progress.draws, 100000U);
    if (progress.done > 0) {
      EXPECT_GT(progress.remaining, 0);
      stop.raise();
    }
  });
  EXPECT_EQ(report.draws, 100000U);
  EXPECT_GE(report.members.size(), 1U);
  EXPECT_LE(report.members.size(), told);
  for (const EnsembleMember& member : report.members)
    for (const EnsembleTrial& trial : member.trials) {
      EXPECT_TRUE(!trial.runs.empty() || !member.calibrated());
      for (const EnsembleRun& run : trial.runs) EXPECT_NE(run.cause, StopCause::interrupted);
    }
}

TEST(Ensemble, RejectsInvalidOptionsBeforeItStarts) {
  EXPECT_THAT(error_of([] { run_ensemble({.draws = 0}, StopRequest{}); }), HasSubstr("the number of draws is 0;"));
  EXPECT_THAT(error_of([] { run_ensemble({.beyond = kNaN}, StopRequest{}); }),
              HasSubstr("gains of a stable loop is nan"));
  EXPECT_THAT(error_of([] { run_ensemble({.learn = -1}, StopRequest{}); }), HasSubstr("learning repetitions is -1"));
  EnsembleOptions options;
  options.paths = {make_shape("circle", {.size = 0.1, .duration = 0.1})};
  EXPECT_THAT(error_of([&] { run_ensemble(options, StopRequest{}); }), HasSubstr("velocity limit"));
}

}  // namespace
}  // namespace haptrace
