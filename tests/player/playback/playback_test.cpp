// Tests of playback on a device with known dynamics: the law has the chosen terms and no others.
#include "player/playback/playback.h"

#include "control/feedforward.h"
#include "control/lqg_law.h"
#include "control/observer_pd.h"
#include "control/path/shapes.h"
#include "control/pd.h"
#include "player/playback/playback_controller.h"
#include "player/playback/reference_stream.h"
#include "player/tuning/live_tuning.h"
#include "tests/player/calibration/identified_device.h"
#include "tests/support/allocations.h"
#include "tests/support/blind_device.h"
#include "tests/support/errors.h"
#include "tests/support/point_mass.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::everything;
using test::Log;
using testing::ElementsAre;
using testing::HasSubstr;

Path small_circle(double duration = 1) {
  return make_shape("circle", {.size = 0.04, .duration = duration});
}

DeviceInfo info() {
  return SimDevice(test::true_device()).info();
}

PlayResult played_circle(Device& device, PlayOptions options, Log* log = nullptr) {
  if (log != nullptr) options.sinks.push_back(log);
  return play(device, plan_playback(device.info(), small_circle(), options), options, StopRequest{});
}

/// Returns the forces of a session with the true device.
std::vector<Vec3> forces(const PlayOptions& options) {
  SimDevice device(test::true_device());
  Log log;
  EXPECT_EQ(played_circle(device, options, &log).session.servo.cause, StopCause::finished);
  std::vector<Vec3> all;
  for (const Sample& sample : log.samples) all.push_back(sample.force);
  return all;
}

std::vector<std::string> composed(const PlayOptions& options) {
  SimDevice device(test::true_device());
  return to_json(played_circle(device, options)).at("compensations").get<std::vector<std::string>>();
}

TEST(PlayPlan, ComposesEverythingForAnIdentifiedDeviceAndSaysSo) {
  EXPECT_THAT(composed(everything()), ElementsAre("inertia", "observer", "learning"))
      << "learning starts from the gravity and friction of the model";
  PlayOptions options = everything();
  options.learn = 0;
  EXPECT_THAT(composed(options), ElementsAre("inertia", "gravity", "friction", "observer"))
      << "there is nothing learned";
  options.compensations = {.gravity = true};
  EXPECT_THAT(composed(options), ElementsAre("gravity"));
}

TEST(PlayPlan, ComposesAPdLawAloneForAnUnidentifiedDevice) {
  PlayOptions options;
  EXPECT_THAT(composed(options), ElementsAre());
  const PlayPlan plan = plan_playback(info(), small_circle(), options);
  EXPECT_EQ(plan.tuning.gains.kp, cautious_gains(8, 1000).kp);
}

TEST(PlayPlan, TakesGainsAndBandwidthOfTheDesignUnlessGainsAreGiven) {
  PlayOptions options = everything();
  const TrackingDesign& design = options.identified->design;
  EXPECT_EQ(plan_playback(info(), small_circle(), options).tuning.gains.kp, design.gains.kp);
  EXPECT_EQ(plan_playback(info(), small_circle(), options).tuning.observer_hz, design.load_hz);
  options.compensations.observer = false;
  options.identified->design.plain = {Vec3::Constant(300), Vec3::Constant(3)};
  EXPECT_EQ(plan_playback(info(), small_circle(), options).tuning.gains.kp, Vec3::Constant(300));
  options.gains = PdGains{Vec3(1, 2, 3), Vec3(4, 5, 6)};
  EXPECT_EQ(plan_playback(info(), small_circle(), options).tuning.gains.kd, Vec3(4, 5, 6));
  options.gains->kp.x() = -1;
  EXPECT_THAT(test::error_of([&] { (void)plan_playback(info(), small_circle(), options); }),
              HasSubstr("kp of the x axis"));
}

PlayOptions with_laws() {
  PlayOptions options = everything();
  options.identified = test::identified_in_a_hand();
  return options;
}

TEST(PlayPlan, TakesTheLqgLawOfAnIdentifiedDeviceUnlessAnotherIsAskedFor) {
  PlayOptions options = with_laws();
  const auto planned = [&] { return plan_playback(info(), small_circle(), options); };
  ASSERT_TRUE(planned().lqg);
  EXPECT_EQ(planned().tuning.gains.kp, gains_of(*planned().lqg).kp);
  EXPECT_EQ(planned().firmness, Firmness::normal);
  const double normal = planned().tuning.gains.kp.x();
  options.firmness = Firmness::exact;
  EXPECT_GT(planned().tuning.gains.kp.x(), normal);
  options.gains = PdGains{Vec3::Constant(1000), Vec3::Constant(10)};
  EXPECT_FALSE(planned().lqg) << "given gains are those of a PD law";
  options.gains.reset();
  options.law = TrackingLaw::observer;
  EXPECT_FALSE(planned().lqg);
  EXPECT_EQ(planned().tuning.gains.kp, options.identified->design.gains.kp);
  options.law = TrackingLaw::lqg;
  options.compensations.observer = false;
  EXPECT_FALSE(planned().lqg);
}

TEST(PlayPlan, TakesTheFirstLawThatTheTrialDidNotRefuseAndSaysWhy) {
  PlayOptions options = with_laws();
  HeldDevice& held = *options.identified->held;
  const auto planned = [&] { return plan_playback(info(), small_circle(), options); };
  held.design(Firmness::normal).verdict = {.tried = true, .improvement = 2, .refused = ""};
  EXPECT_THAT(planned().notes, testing::IsEmpty());

  held.design(Firmness::normal).verdict.refused = "it oscillates";
  held.design(Firmness::quiet).verdict.tried = true;
  EXPECT_EQ(planned().firmness, Firmness::quiet);
  EXPECT_THAT(planned().notes, ElementsAre(HasSubstr("firmness normal was refused: it oscillates")));

  held.design(Firmness::quiet).verdict.refused = "its error is large";
  EXPECT_FALSE(planned().lqg);
  EXPECT_TRUE(planned().composed.observer);
  EXPECT_EQ(planned().tuning.gains.kp, options.identified->design.gains.kp);

  options.identified->design.verdict = {.tried = true, .improvement = 0.8, .refused = "it oscillates too"};
  options.identified->design.plain = {Vec3::Constant(300), Vec3::Constant(3)};
  EXPECT_FALSE(planned().composed.observer);
  EXPECT_EQ(planned().tuning.gains.kp, Vec3::Constant(300));
  EXPECT_THAT(planned().notes.back(), HasSubstr("plain PD control"));

  options.firmness = Firmness::normal;
  EXPECT_TRUE(planned().lqg) << "what was asked for";
  EXPECT_THAT(planned().notes, ElementsAre(HasSubstr("it oscillates")));
  options.firmness.reset();
  options.law = TrackingLaw::observer;
  EXPECT_TRUE(planned().composed.observer);
  EXPECT_THAT(planned().notes, ElementsAre(HasSubstr("it oscillates too")));
}

TEST(PlayPlan, TakesPlainControlAfterALawVibratedUnlessATrialPassedAnother) {
  PlayOptions options = with_laws();
  HeldDevice& held = *options.identified->held;
  const auto planned = [&] { return plan_playback(info(), small_circle(), options); };
  held.design(Firmness::normal).verdict = {
      .tried = true, .improvement = 5, .refused = "it vibrated at 30 Hz", .since = "2026-01-31T12:00:00Z"};
  EXPECT_FALSE(planned().composed.observer);
  EXPECT_THAT(planned().notes, ElementsAre(HasSubstr("in a playback at 2026-01-31T12:00:00Z, the LQG law of firmness "
                                                     "normal was refused: it vibrated at 30 Hz"),
                                           HasSubstr("plain PD control")));
  options.identified->design.verdict.tried = true;
  EXPECT_TRUE(planned().composed.observer);
  held.design(Firmness::quiet).verdict.tried = true;
  EXPECT_EQ(planned().firmness, Firmness::quiet);
  EXPECT_TRUE(planned().lqg);
}

TEST(PlayPlan, TakesPlainControlIfTheTrialRefusedTheLawForACoarseModel) {
  PlayOptions options = with_laws();
  options.identified->held.reset();
  const auto planned = [&] { return plan_playback(info(), small_circle(), options); };
  EXPECT_TRUE(planned().composed.observer) << "older profiles have no verdict";
  EXPECT_FALSE(planned().stand_in);
  TrackingDesign& design = options.identified->design;
  design.plain_calm = true;
  design.plain = design.gains;
  EXPECT_TRUE(planned().stand_in);

  design.verdict = {.tried = true, .improvement = 0.8, .refused = "it follows less closely"};
  EXPECT_FALSE(planned().composed.observer);
  EXPECT_EQ(planned().tuning.gains.kp, design.plain.kp);
  EXPECT_THAT(planned().notes, ElementsAre(HasSubstr("the law with an observer was refused: it follows less closely"),
                                           HasSubstr("plain PD control")));
  options.law = TrackingLaw::observer;
  EXPECT_TRUE(planned().composed.observer) << "what was asked for";
}

TEST(PlayPlan, LeavesOutTheFeedforwardThatMadePlainPdControlLessAccurate) {
  PlayOptions options = with_laws();
  options.identified->held.reset();
  options.learn = 0;
  TrackingDesign& design = options.identified->design;
  design.plain_calm = design.plain_bare = true;
  const auto planned = [&] { return plan_playback(info(), small_circle(), options); };
  EXPECT_TRUE(planned().composed.inertia) << "of the law with an observer";
  design.verdict = {.tried = true, .improvement = 0.8, .refused = "it follows less closely"};
  EXPECT_THAT(planned().notes, testing::Contains(HasSubstr("goes without")));
  EXPECT_FALSE(planned().composed.inertia || planned().composed.friction || planned().composed.gravity);
  options.learn = options.playback.repetitions = 3;
  EXPECT_TRUE(planned().composed.inertia) << "learning learns the load beside it";
  options.learn = 0;
  options.compensations.observer = false;
  EXPECT_TRUE(planned().composed.inertia) << "what was asked for";
  options.compensations.observer = true;
  design.plain_bare = false;
  EXPECT_TRUE(planned().composed.inertia);
}

TEST(PlayPlan, SaysBeforeAPlaybackThatStiffPdControlWasCloserInTheTrials) {
  PlayOptions options = with_laws();
  const auto planned = [&] { return plan_playback(info(), small_circle(), options); };
  TrackingDesign& design = options.identified->design;
  design.stiff_ripple = 0.8;
  design.stiff_error = 1.4;
  EXPECT_THAT(planned().notes, testing::IsEmpty()) << "it was not closer";
  design.stiff_error = 0.5;
  EXPECT_THAT(planned().notes, ElementsAre(HasSubstr("was 2.0 times closer than the law that playbacks choose, but its "
                                                     "force vibrated with 0.80 N rms")));
  options.law = TrackingLaw::observer;
  EXPECT_THAT(planned().notes, testing::IsEmpty()) << "nobody asked for a choice";
}

TEST(PlayPlan, SaysBeforeAPlaybackThatTheMotorsWillGetTooWarm) {
  PlayOptions options = with_laws();
  const auto planned = [&] { return plan_playback(info(), small_circle(), options); };
  LawVerdict &lqg = options.identified->held->design(Firmness::normal).verdict,
             &observer = options.identified->design.verdict;
  options.session.loop.limits.max_continuous_force = 3;
  lqg.force = 4;
  EXPECT_THAT(planned().notes, testing::IsEmpty()) << "one circle is short";
  options.playback.repetitions = 10;
  EXPECT_THAT(planned().notes, ElementsAre(HasSubstr("took 4 N rms")));
  options.playback.speed = 4;
  EXPECT_THAT(planned().notes, testing::IsEmpty());
  options.playback.repetitions = 0;
  EXPECT_THAT(planned().notes, ElementsAre(HasSubstr("took 4 N rms"))) << "until it is stopped";
  options.law = TrackingLaw::observer;
  EXPECT_THAT(planned().notes, testing::IsEmpty()) << "not known of this law";
  observer.force = 5;
  EXPECT_THAT(planned().notes, ElementsAre(HasSubstr("took 5 N rms")));
  options.compensations.observer = false;
  EXPECT_THAT(planned().notes, testing::IsEmpty()) << "PD control follows less closely and takes less";
}

/// A playback of the LQG law that was softened as often as `energy` says.
PlayResult softened(const PlayOptions& options, int energy) {
  PlayResult result{.session = {}, .plan = plan_playback(info(), small_circle(), options), .repetitions = {}};
  result.session.servo.vibration.steps[static_cast<std::size_t>(VibrationRule::energy)] = energy;
  result.session.servo.vibration.frequency_hz = 30.4;
  return result;
}

TEST(PlayResult, RefusesALawThatVibratedForLaterPlaybacks) {
  const PlayOptions options = with_laws();
  IdentifiedDevice device = *options.identified;
  EXPECT_EQ(refuse_vibrated(softened(options, 0), options, "now", device), "");
  EXPECT_EQ(device.held->design(Firmness::normal).verdict.refused, "");
  EXPECT_THAT(refuse_vibrated(softened(options, 1), options, "now", device), HasSubstr("the law vibrated at 30 Hz"));
  EXPECT_EQ(device.held->design(Firmness::normal).verdict.refused, "it vibrated at 30 Hz");
  EXPECT_EQ(device.held->design(Firmness::normal).verdict.since, "now");
  EXPECT_EQ(device.held->design(Firmness::exact).verdict.refused, "");
  EXPECT_EQ(refuse_vibrated(softened(options, 1), options, "later", device), "") << "it is refused already";
  EXPECT_EQ(device.held->design(Firmness::normal).verdict.since, "now");
}

TEST(PlayResult, RefusesNoLawForAVibrationThatMayHaveAnotherCause) {
  PlayOptions options = with_laws();
  IdentifiedDevice device = *options.identified;
  PlayResult slow = softened(options, 0);
  slow.session.servo.vibration.steps[static_cast<std::size_t>(VibrationRule::slow)] = 2;
  EXPECT_EQ(refuse_vibrated(slow, options, "now", device), "") << "a hand may sway";

  LiveTuning tuning(plan_playback(info(), small_circle(), options).tuning, {});
  options.tuning = &tuning;
  EXPECT_NE(refuse_vibrated(softened(options, 1), options, "now", device), "");
  device = *options.identified;
  EXPECT_THAT(tuning.obey("gains * 1.1"), testing::StartsWith("ok"));
  EXPECT_EQ(refuse_vibrated(softened(options, 1), options, "now", device), "") << "these are other gains";
  options.tuning = nullptr;

  options.gains = PdGains{Vec3::Constant(3000), Vec3::Constant(25)};
  EXPECT_EQ(refuse_vibrated(softened(options, 1), options, "now", device), "");
  options.gains.reset();
  options.compensations.observer = false;
  EXPECT_EQ(refuse_vibrated(softened(options, 1), options, "now", device), "") << "plain control is what is left";
  EXPECT_EQ(device.held->design(Firmness::normal).verdict.refused, "");
}

TEST(Play, FollowsCloserUnderTheLqgLawThanUnderTheObserver) {
  const auto played = [](TrackingLaw law, Firmness firmness = Firmness::normal) {
    PlayOptions options = with_laws();
    options.law = law;
    options.firmness = firmness;
    options.learn = options.playback.repetitions = 4;
    SimSpec spec = test::true_device();
    spec.hand = test::relaxed_hand();
    SimDevice device(spec);
    return played_circle(device, options);
  };
  const PlayResult observer = played(TrackingLaw::observer), lqg = played(TrackingLaw::lqg),
                   exact = played(TrackingLaw::lqg, Firmness::exact);
  EXPECT_LT(lqg.last.rms_error, 0.95 * observer.last.rms_error);
  EXPECT_LT(lqg.last.force_ripple, 1.2 * observer.last.force_ripple);
  EXPECT_LT(exact.last.rms_error, lqg.last.rms_error);
  const nlohmann::json json = to_json(exact);
  EXPECT_EQ(json.at("law"), "lqg");
  EXPECT_EQ(json.at("firmness"), "exact");
  EXPECT_EQ(to_json(observer).at("law"), "observer");
  EXPECT_FALSE(to_json(observer).contains("firmness"));
}

TEST(PlayPlan, RefusesToLearnWithoutCalibrationAndSaysWhatToDo) {
  PlayOptions options;
  options.learn = 3;
  const auto error = [&] { return test::error_of([&] { (void)plan_playback(info(), small_circle(), options); }); };
  EXPECT_THAT(error(), HasSubstr("must be calibrated before it can learn"));
  EXPECT_THAT(error(), HasSubstr("haptrace calibrate --device sim"));
  options.identified = test::identified(test::known_plant());
  EXPECT_EQ(error(), "no error");
  options.compensations.learning = false;
  EXPECT_THAT(error(), HasSubstr("both request learning and switch it off"));
}

TEST(PlayPlan, RefusesToLearnAPathThatIsTooLong) {
  PlayOptions options = everything();
  options.playback.speed = 0.001;
  EXPECT_THAT(test::error_of([&] { (void)plan_playback(info(), small_circle(), options); }),
              HasSubstr("a repetition lasts 1000.0 s"));
}

TEST(Play, RejectsAnInvalidNumberOfRepetitionsToLearnFrom) {
  for (const int learn : {-1, kMostLearned + 1}) {
    PlayOptions options = everything();
    options.learn = learn;
    EXPECT_THAT(test::error_of([&] { (void)plan_playback(info(), small_circle(), options); }), HasSubstr("(learn)"));
  }
}

TEST(Play, SendsTheForceOfAPdLawWhenEveryCompensationIsOff) {
  PlayOptions known = everything();
  known.learn = 0;
  known.compensations = {};
  known.gains = PdGains{Vec3::Constant(500), Vec3::Constant(6)};
  PlayOptions unknown;
  unknown.gains = known.gains;
  unknown.playback = known.playback;
  EXPECT_TRUE(forces(known) == forces(unknown)) << "to the last bit";
}

TEST(Play, StatesTheGainsOfTheForceThatWasSentAlsoWhileItIsLimitedAndFades) {
  SimDevice device(test::true_device());
  PlayOptions options;
  options.gains = PdGains{Vec3(500, 450, 400), Vec3(6, 5, 6)};
  options.session.loop.limits.max_force = 6;
  Log log;
  (void)played_circle(device, options, &log);
  std::size_t full = 0, softer = 0;
  for (const Sample& sample : log.samples) {
    ASSERT_TRUE(is_finite(sample.kp) && is_finite(sample.kd));
    if (sample.phase == Phase::stopped) {
      EXPECT_EQ(sample.kp, Vec3::Zero()) << "a force that fades after a fault does not respond";
      continue;
    }
    const Vec3 force = sample.kp.cwiseProduct(sample.reference_position - sample.position) +
                       sample.kd.cwiseProduct(sample.reference_velocity - sample.velocity);
    ASSERT_LT((sample.force - force).norm(), 1e-9) << "at " << 1e-9 * static_cast<double>(sample.time_ns) << " s";
    ++(sample.kp.x() > 499.9 ? full : softer);
  }
  EXPECT_GT(full, 100U);
  EXPECT_GT(softer, 100U);
}

TEST(Play, OmitsTheTermsThatAreOff) {
  const auto with = forces(everything());
  for (bool Compensations::*off :
       {&Compensations::inertia, &Compensations::gravity, &Compensations::friction, &Compensations::observer}) {
    PlayOptions options = everything();
    options.compensations.*off = false;
    EXPECT_FALSE(forces(options) == with);
  }
}

TEST(Play, FollowsCloserWithAModelThanWithoutIt) {
  PlayOptions unknown;
  unknown.playback.repetitions = 3;
  SimDevice one(test::true_device()), other(test::true_device());
  const PlayResult with = played_circle(one, everything()), without = played_circle(other, unknown);
  EXPECT_LT(with.repetitions[0].rms_error, 0.1 * without.repetitions[0].rms_error);
}

TEST(Play, FollowsAQuantisedRecordingAsWellAsTheMovementItself) {
  Path movement = small_circle(2), recording = movement;
  recording.velocity.clear();
  for (Vec3& p : recording.position) p = 5e-5 * (p / 5e-5).array().round().matrix();
  const auto followed = [](const Path& path, const PlayOptions& options) {
    SimDevice device(test::true_device());
    return play(device, plan_playback(device.info(), path, options), options, StopRequest{});
  };
  const PlayResult exact = followed(movement, everything()), counted = followed(recording, everything());
  EXPECT_EQ(exact.plan.path->smoothing(), 0);
  EXPECT_GT(counted.plan.path->smoothing(), 1e-3);
  EXPECT_LT(counted.last.rms_error, 1.3 * exact.last.rms_error);
  EXPECT_LT(counted.last.force_ripple, 1.3 * exact.last.force_ripple);

  PlayOptions as_it_is = everything();
  as_it_is.smoothing = 0;
  EXPECT_GT(followed(recording, as_it_is).last.force_ripple, 5 * counted.last.force_ripple)
      << "ripple without smoothing";
  as_it_is.smoothing = -1;
  EXPECT_THAT(test::error_of([&] { (void)followed(recording, as_it_is); }), HasSubstr("the smoothing is -1 s"));
}

TEST(Play, SendsIdenticalForcesToADeviceThatShowsOnlyItsMeasurements) {
  SimDevice seen(test::true_device()), hidden(test::true_device());
  test::BlindDevice blind(hidden);
  Log one, other;
  played_circle(seen, everything(), &one);
  played_circle(blind, everything(), &other);
  ASSERT_GT(one.samples.size(), 3000U);
  ASSERT_EQ(one.samples.size(), other.samples.size());
  for (std::size_t i = 0; i < one.samples.size(); ++i) ASSERT_EQ(one.samples[i].force, other.samples[i].force) << i;
}

/// Counts the allocations of a tick, from the device's state to the pushed row.
class Counting final : public Device, public SampleSink {
 public:
  explicit Counting(Device& device) : device_(device) {}
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return device_.info(); }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
    const Status status = device_.exchange(wrench, dt, state);
    before_ = test::allocations();
    return status;
  }
  void close() noexcept override { device_.close(); }
  using SampleSink::push;
  void push(const Sample&) noexcept override {
    allocated += test::allocations() - before_;
    ++ticks;
  }
  void between_ticks(bool) noexcept override {}

  std::size_t allocated = 0, ticks = 0;

 private:
  Device& device_;
  std::size_t before_ = 0;
};

TEST(Play, AllocatesNothingInATickWithEveryCompensationOn) {
  SimDevice device(test::true_device());
  Counting counting(device);
  PlayOptions options = everything();
  options.sinks = {&counting};
  const PlayResult result = played_circle(counting, options);
  EXPECT_EQ(result.lessons.size(), 2U);
  EXPECT_GT(counting.ticks, 3000U);
  EXPECT_EQ(counting.allocated, 0U);
}

TEST(Play, FollowsMoreCloselyFromTheFirstRepetitionWhenItKnowsTheAxesOfTheActuators) {
  SimSpec spec = test::true_device();
  spec.rotation = Vec3(0.3, -0.5, 0.4);
  spec.cogging.setZero();
  const auto error = [&](bool axes, int learn) {
    SimDevice device(spec);
    PlayOptions options = everything();
    options.learn = learn;
    options.playback.repetitions = 1;
    if (axes)
      options.identified->plant.actuators =
          ActuatorFriction{.axes = device.plant().rotation(), .coulomb = spec.coulomb};
    return played_circle(device, options).last.rms_error;
  };
  for (const int learn : {0, 1}) EXPECT_LT(error(true, learn), 0.9 * error(false, learn)) << learn;
}

/// Cables of 1 N every 3 mm along turned actuators.
SimSpec with_cables() {
  SimSpec spec = test::true_device();
  spec.rotation = Vec3(0.3, -0.5, 0.4);
  spec.cogging = Vec3::Constant(1);
  spec.cogging_period = 3e-3;
  return spec;
}

/// Returns the force of the spec's cables, with the amplitude and the phase wrong by `share` and `phase`.
Cogging cables_of(const SimSpec& spec, double share, double phase) {
  const Eigen::Matrix3d axes = SimDevice(spec).plant().rotation();
  Cogging cogging;
  for (int axis = 0; axis < 3; ++axis)
    cogging.waves.push_back({.wave_number = 2 * std::numbers::pi / spec.cogging_period * Vec3(axes.row(axis)),
                             .cosine = -(1 + share) * spec.cogging[axis] * std::sin(phase),
                             .sine = -(1 + share) * spec.cogging[axis] * std::cos(phase)});
  return cogging;
}

TEST(Play, FollowsMoreCloselyWhenItKnowsTheCablesAlsoWhileItLearns) {
  const SimSpec spec = with_cables();
  const auto error = [&](bool known, int learn) {
    SimDevice device(spec);
    PlayOptions options = everything();
    options.identified = test::identified_in_a_hand();
    options.learn = learn;
    if (known) options.identified->plant.cogging = cables_of(spec, -0.1, 0.1);
    return played_circle(device, options).last.rms_error;
  };
  for (const int learn : {0, 2}) EXPECT_LT(error(true, learn), 0.7 * error(false, learn)) << learn;
}

TEST(PlayPlan, ComposesTheTermOfTheCoggingOnlyWhereItIsKnownAndNotLeftOut) {
  PlayOptions options = everything();
  options.identified->plant.cogging = cables_of(with_cables(), 0, 0);
  EXPECT_THAT(composed(options), ElementsAre("inertia", "cogging", "observer", "learning"))
      << "learning is too slow for it";
  options.compensations.cogging = false;
  EXPECT_THAT(composed(options), ElementsAre("inertia", "observer", "learning"));
}

TEST(Play, DoesNotDriveAnAxisWithoutMotorWhateverItsGains) {
  SimSpec spec = test::true_device();
  spec.axes = {true, true, false};
  spec.gravity_bias.z() = 0;
  PlantModel plant = test::known_plant();
  plant.mass.z() = plant.viscous.z() = plant.coulomb.z() = plant.gravity.z() = 0;
  PlayOptions options = everything();
  options.identified = test::identified(plant);
  options.gains = PdGains{Vec3::Constant(2000), Vec3::Constant(20)};
  SimDevice device(spec);
  Log log;
  EXPECT_EQ(played_circle(device, options, &log).session.servo.cause, StopCause::finished);
  for (const Sample& sample : log.samples) ASSERT_EQ(sample.force.z(), 0);
}

TEST(Play, TakesAChangeOfTuningWithoutAStepInTheForce) {
  // A hand holds the tool 2 mm beside a point path: the force depends only on the gains, the shares and gravity.
  Path point;
  point.name = "point";
  point.time = {0};
  point.position = {Vec3::Zero()};
  const IdentifiedDevice known = test::identified(test::known_plant());
  ForceTerms terms;
  terms.push_back(std::make_unique<GravityFeedforward>(known.plant));
  terms.push_back(
      std::make_unique<ObserverPd>(ObserverPd::Options{.design = known.design, .position_resolution = 5e-5}));
  Tuning tuning{.gains = {Vec3::Constant(1000), Vec3::Constant(10)}};
  Mailbox<Tuning> mailbox(tuning);
  PlaybackController controller(Trajectory(point, Interpolation::linear), std::move(terms), tuning, {.hold = 1000},
                                &mailbox);
  State state;
  state.position = Vec3(2e-3, 0, 0);
  controller.start(state);
  state.dt = 1e-3;
  Vec3 before = Vec3::Zero();
  double largest = 0, stiff = 0;
  for (int i = 0; i < 6000; ++i) {
    if (i == 2000) mailbox.post(tuning = {.gains = {Vec3::Constant(4000), Vec3::Constant(40)}});
    if (i == 3000) mailbox.post(tuning = {.gains = tuning.gains, .gravity = 0, .observer = 0});
    if (i == 4000) mailbox.post(tuning = {.gains = {Vec3::Constant(10), Vec3::Zero()}, .observer_hz = 100});
    const Vec3 force = controller.update(state).wrench.force;
    state.force_applied = force;
    if (i > 1900) largest = std::max(largest, (force - before).norm());
    before = force;
    if (i == 2999) stiff = force.x();
  }
  EXPECT_LT(stiff, -0.9 * 8) << "it is taken";
  // The stiffness changes the force by 6 N, the load by 6 N and gravity by 1.5 N, at most a fiftieth of that per tick.
  EXPECT_LT(largest, 0.02 * 14);
}

TEST(Tuning, IsApproachedByAllButTwoPerCentInAFifthOfASecond) {
  Tuning tuning{.gains = {Vec3::Constant(1000), Vec3::Constant(10)}, .observer_hz = 6};
  const Tuning target{.gains = {Vec3::Constant(2000), Vec3::Constant(30)},
                      .inertia = 0,
                      .gravity = 0,
                      .friction = 0,
                      .observer = 0,
                      .observer_hz = 26,
                      .learning = 0};
  for (int i = 0; i < 200; ++i) tuning.approach(target, 1e-3);
  EXPECT_NEAR(tuning.gains.kp.x(), 2000 - 18.3, 0.1);
  EXPECT_NEAR(tuning.gains.kd.z(), 30 - 0.366, 0.01);
  for (const double share : {tuning.inertia, tuning.gravity, tuning.friction, tuning.observer, tuning.learning})
    EXPECT_NEAR(share, 0.0183, 1e-4);
  EXPECT_NEAR(tuning.observer_hz, 26 - 0.366, 0.01);
  const Tuning before = tuning;
  tuning.approach(target, 0);
  EXPECT_EQ(tuning.gains.kp, before.gains.kp);
}

}  // namespace
}  // namespace haptrace
