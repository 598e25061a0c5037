#include "control/design/identification.h"

#include "control/design/inertia_identification.h"
#include "control/feedforward.h"

#include <Eigen/Geometry>

#include <cmath>
#include <deque>
#include <gtest/gtest.h>
#include <numbers>
#include <random>
#include <utility>

namespace haptrace {
namespace {

constexpr double kRate = 1000;

/// A simulated device of known parameters in closed loop, and the rows of an experiment with it.
struct Bench {
  Vec3 mass{0.3, 0.5, 0.4}, viscous{1, 2, 1.5}, coulomb{0.5, 0.8, 0.3}, gravity{0.4, -1.2, 0.8};
  double gradient = -20;  ///< Gradient of gravity along each axis, without coupling between axes [N/m].
  double delay = 1.3e-3;
  double quantum = 0;
  double cable = 0;                      ///< Amplitude of a position-dependent force [N].
  double cable_period = 0.012;           ///< [m]
  double shake = 0;                      ///< Force of first-order noise, rms per axis [N].
  double stiffness = 800, damping = 12;  ///< Of the law that holds the device [N/m, N s/m].
  double shake_hz = 8;                   ///< Its corner.
  std::array<bool, 3> axes{true, true, true};
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();  ///< From W to the axes of all vectors above.

  Multisine dither{15, 120, 2, {true, true, true}};
  std::vector<TickRow> rows;
  std::vector<Stretch> dithered;
  std::array<std::vector<Stretch>, 3> sweeps;
  std::vector<ExperimentPlace> places;

  Bench& run() {
    dithered.push_back(move(
        0.5, 4,
        [&](double t) {
          const double a = kTwoPi * t;
          return Vec3(0.02 * std::cos(a), 0.02 * std::sin(a), 0.01 * std::sin(2 * a));
        },
        true));
    for (int axis = 0; axis < 3; ++axis)
      sweeps[static_cast<std::size_t>(axis)].push_back(move(
          0.5, 2,
          [&](double t) {
            const double size = std::fmod(t, 1) < 0.5 ? 0.015 : 0.0075;
            return Vec3(size * std::asin(0.97 * std::sin(2 * kTwoPi * t)) / 1.32 * Vec3::Unit(axis));
          },
          false));
    return *this;
  }

  /// Goes round `place` as round the centre, with the excitation signal, as a device whose mass there is `factor` times
  /// that at the centre.
  Bench& visit(const Vec3& place, const Vec3& factor) {
    const Vec3 own = std::exchange(mass, mass.cwiseProduct(factor));
    const Vec3 from = places.empty() ? Vec3(Vec3::Zero()) : places.back().position;
    (void)move(
        0, 1, [&](double t) { return Vec3(from + t * (place - from)); }, false);
    const auto round = [&](double t) {
      const double a = kTwoPi * t;
      return Vec3(place + 0.02 * Vec3(std::cos(a), std::sin(a), 0.5 * std::sin(2 * a)));
    };
    const Stretch stretch = move(0.5, dither.period(), round, true);
    places.push_back({place, stretch});
    mass = own;
    return *this;
  }

  [[nodiscard]] Identification identified() const { return identify(experiment()); }

  [[nodiscard]] Experiment experiment() const {
    return {.rows = rows,
            .rate_hz = kRate,
            .axes = axes,
            .dither = &dither,
            .dithered = dithered,
            .places = places,
            .sweeps = sweeps};
  }

 private:
  /// Runs the loop for `lead + duration` seconds and returns the stretch of rows after `lead`.
  template <class Place>
  Stretch move(double lead, double duration, const Place& place, bool hum) {
    const std::size_t begin = rows.size() + static_cast<std::size_t>(lead * kRate);
    for (double t = 0; t < lead + duration; t += 1 / kRate) tick(place(t), hum);
    return {begin, rows.size()};
  }

  void tick(const Vec3& wanted, bool hum) {
    const double time = static_cast<double>(rows.size()) / kRate;
    Vec3 seen = turn.transpose() * x_;
    if (quantum > 0)
      for (double& value : seen) value = quantum * std::round(value / quantum);
    Vec3 force = stiffness * (wanted - seen) - damping * (turn.transpose() * v_);
    if (hum) force += 0.8 * dither.value(time);
    for (int axis = 0; axis < 3; ++axis)
      if (!axes[static_cast<std::size_t>(axis)]) force[axis] = 0;
    rows.push_back({time, seen, force});
    sent_.push_back(force);
    if (shake > 0) {
      const double keep = std::exp(-kTwoPi * shake_hz / kRate);
      for (double& value : noise_) value = keep * value + shake * std::sqrt(1 - keep * keep) * normal_(random_);
    }
    if (sent_.size() > 20) sent_.pop_front();
    constexpr int kSteps = 100;
    const double h = 1 / kRate / kSteps;
    for (int step = 0; step < kSteps; ++step) {
      const auto late = static_cast<std::size_t>(std::ceil((delay - (step + 0.5) * h) * kRate));
      const Vec3 u = turn * (late < sent_.size() ? sent_[sent_.size() - 1 - late] : Vec3(Vec3::Zero()));
      for (int axis = 0; axis < 3; ++axis) {
        const double w = h / mass[axis];
        const double free = v_[axis] + w * (u[axis] + gravity[axis] + gradient * x_[axis] +
                                            cable * std::sin(kTwoPi * x_[axis] / cable_period) + noise_[axis] -
                                            viscous[axis] * v_[axis]);
        const double next = std::copysign(std::max(std::abs(free) - w * coulomb[axis], 0.0), free);
        x_[axis] += 0.5 * h * (v_[axis] + next);
        v_[axis] = next;
      }
    }
  }

  Vec3 x_ = Vec3::Zero(), v_ = Vec3::Zero();  ///< Along the axes of `turn`.
  std::deque<Vec3> sent_;
  Vec3 noise_ = Vec3::Zero();
  std::mt19937 random_{11};
  std::normal_distribution<double> normal_;
};

const Bench& bench() {
  static const Bench made = Bench().run();
  return made;
}

void expect_near(const Vec3& found, const Vec3& truth, double share, const char* what) {
  for (int axis = 0; axis < 3; ++axis)
    EXPECT_NEAR(found[axis], truth[axis], share * std::abs(truth[axis])) << what << ' ' << "xyz"[axis];
}

void expect_alike(const Identification& a, const Identification& b, double share) {
  expect_near(a.plant.mass, b.plant.mass, share, "mass");
  expect_near(a.plant.coulomb, b.plant.coulomb, share, "coulomb");
  expect_near(a.plant.viscous, b.plant.viscous, share, "viscous");
  EXPECT_NEAR(a.plant.delay, b.plant.delay, share * 1e-3);
}

TEST(IdentificationLaw, FindsTheTrueParameters) {
  const Identification found = bench().identified();
  EXPECT_TRUE(found.fits) << found.reason;
  expect_near(found.plant.mass, bench().mass, 0.06, "mass");  // the dither reverses the friction at times
  expect_near(found.plant.coulomb, bench().coulomb, 0.05, "coulomb");
  expect_near(found.plant.viscous, bench().viscous, 0.25, "viscous");
  expect_near(found.plant.gravity, bench().gravity, 0.1, "gravity");
  EXPECT_NEAR(found.plant.delay, bench().delay, 0.1e-3);
  EXPECT_EQ(found.plant.position_resolution, 0);
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_LT(std::abs(found.plant.mass[axis] - bench().mass[axis]), found.half_width.mass[axis]);
    EXPECT_LT(std::abs(found.plant.coulomb[axis] - bench().coulomb[axis]), found.half_width.coulomb[axis]);
  }
}

TEST(IdentificationLaw, FindsAMassWithoutFrictionAlmostExactly) {
  Bench smooth;
  smooth.coulomb.setZero();
  const Identification found = smooth.run().identified();
  expect_near(found.plant.mass, smooth.mass, 0.005, "mass");
  EXPECT_LT(found.plant.coulomb.maxCoeff(), 0.02);
  EXPECT_NEAR(found.plant.delay, smooth.delay, 0.05e-3);
}

TEST(IdentificationLaw, ForcesInAnotherUnitScaleEveryParameterOfForceAndNoOther) {
  Bench scaled = bench();
  for (TickRow& row : scaled.rows) row.force *= 3;
  Identification expected = bench().identified();
  expected.plant.mass *= 3;
  expected.plant.coulomb *= 3;
  expected.plant.viscous *= 3;
  expect_alike(scaled.identified(), expected, 1e-4);
}

TEST(IdentificationLaw, LengthsInAnotherUnitScaleMassInverselyAndLeaveFriction) {
  Bench scaled = bench();
  for (TickRow& row : scaled.rows) row.position *= 1.5;
  Identification expected = bench().identified();
  expected.plant.mass /= 1.5;
  expected.plant.viscous /= 1.5;
  expect_alike(scaled.identified(), expected, 0.02);
}

TEST(IdentificationLaw, NeitherTheClockNorTheOriginMatters) {
  Bench moved = bench();
  for (TickRow& row : moved.rows) {
    row.time += 1234.5;
    row.position += Vec3(0.1, -0.3, 0.2);
  }
  expect_alike(moved.identified(), bench().identified(), 1e-3);
}

TEST(IdentificationLaw, TheOrderOfTheAxesDoesNotMatter) {
  Bench turned = bench();
  const auto turn = [](const Vec3& v) { return Vec3(v.y(), v.z(), v.x()); };
  for (TickRow& row : turned.rows) row = {row.time, turn(row.position), turn(row.force)};
  turned.sweeps = {bench().sweeps[1], bench().sweeps[2], bench().sweeps[0]};
  Identification expected = bench().identified();
  expected.plant.mass = turn(expected.plant.mass);
  expected.plant.coulomb = turn(expected.plant.coulomb);
  expected.plant.viscous = turn(expected.plant.viscous);
  expect_alike(turned.identified(), expected, 1e-6);
}

TEST(Identification, FindsMassesAtAResolutionOfATwentiethMillimetre) {
  Bench coarse;
  coarse.quantum = 5e-5;
  coarse.run();
  const Identification found = coarse.identified();
  EXPECT_TRUE(found.fits) << found.reason;
  expect_near(found.plant.mass, coarse.mass, 0.15, "mass");
  expect_near(found.plant.coulomb, coarse.coulomb, 0.08, "coulomb");
  EXPECT_NEAR(found.plant.delay, coarse.delay, 0.3e-3);
  EXPECT_NEAR(found.plant.position_resolution, 5e-5, 1e-9);
}

TEST(Identification, FindsDelaysOfSeveralSamples) {
  for (const double delay : {0.0, 2.5e-3, 6e-3}) {
    Bench late;
    late.delay = delay;
    late.run();
    const Identification found = late.identified();
    EXPECT_NEAR(found.plant.delay, delay, 0.2e-3);
    expect_near(found.plant.mass, late.mass, 0.05, "mass");
  }
}

TEST(Identification, TakesMissedTicksAsGaps) {
  Bench gappy = bench();
  gappy.rows.clear();
  std::mt19937 random(1);
  std::vector<std::size_t> kept(bench().rows.size() + 1, 0);
  for (std::size_t k = 0; k < bench().rows.size(); ++k) {
    kept[k] = gappy.rows.size();
    if (random() % 250 != 0) gappy.rows.push_back(bench().rows[k]);
  }
  kept.back() = gappy.rows.size();
  const auto place = [&](Stretch& stretch) { stretch = {kept[stretch.begin], kept[stretch.end]}; };
  for (Stretch& stretch : gappy.dithered) place(stretch);
  for (auto& axis : gappy.sweeps)
    for (Stretch& stretch : axis) place(stretch);
  const Identification found = gappy.identified();
  expect_near(found.plant.mass, bench().mass, 0.06, "mass");
  expect_near(found.plant.coulomb, bench().coulomb, 0.1, "coulomb");
}

TEST(Identification, LeavesAxesWithoutAMotorOut) {
  Bench planar;
  planar.axes = {true, true, false};
  planar.gravity.z() = 0;
  planar.coulomb = Vec3::Constant(0.2);
  planar.dither = Multisine(15, 120, 2, planar.axes);
  const Identification found = planar.run().identified();
  EXPECT_TRUE(found.fits) << found.reason;
  EXPECT_EQ(found.plant.mass.z(), 0);
  EXPECT_EQ(found.plant.coulomb.z(), 0);
  EXPECT_FALSE(found.plant.actuators);
  for (int axis = 0; axis < 2; ++axis) EXPECT_NEAR(found.plant.mass[axis], planar.mass[axis], 0.1 * planar.mass[axis]);
}

TEST(Identification, ReportsDataThatContainNoInformation) {
  Experiment nothing{.dither = &bench().dither};
  EXPECT_FALSE(identify(nothing).fits);
  EXPECT_NE(identify(nothing).reason, "");

  Bench still = bench();
  for (TickRow& row : still.rows) row.position = Vec3::Zero();
  EXPECT_FALSE(still.identified().fits);

  Bench noise = bench();
  std::mt19937 random(3);
  std::normal_distribution<double> normal(0, 1e-3);
  for (TickRow& row : noise.rows) row.position = Vec3(normal(random), normal(random), normal(random));
  EXPECT_FALSE(noise.identified().fits);
}

TEST(Identification, BearsADeviceThatTremblesThroughItsSweepsAndHardlySlides) {
  // More reversals, and so more cycles, than samples that slide.
  Bench trembling = bench();
  for (auto& axis : trembling.sweeps)
    for (const Stretch& stretch : axis)
      for (std::size_t k = stretch.begin; k < stretch.end; ++k) {
        const double since = trembling.rows[k].time - trembling.rows[stretch.begin].time;
        const double stroke = std::sin(kTwoPi * 2.5 * std::min(since, 0.2));
        trembling.rows[k].position = Vec3::Constant(0.01 * stroke + 5e-5 * std::sin(kTwoPi * 30 * since));
      }
  EXPECT_FALSE(trembling.identified().fits);
}

/// Rms difference of the identified friction from the true one over directions of motion, as a fraction of the latter.
double friction_error(const PlantModel& plant, const Bench& truth) {
  FrictionFeedforward found(plant);
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  double error2 = 0, force2 = 0;
  for (int k = 0; k < 500; ++k) {
    Reference reference;
    reference.velocity = 0.1 * Vec3(normal(random), normal(random), normal(random)).normalized();
    const Vec3 v = truth.turn * reference.velocity;
    const Vec3 force =
        truth.turn.transpose() * (truth.coulomb.cwiseProduct(v.cwiseSign()) + truth.viscous.cwiseProduct(v));
    error2 += (found.force({State{}, reference, Tuning{}}) - force).squaredNorm();
    force2 += force.squaredNorm();
  }
  return std::sqrt(error2 / force2);
}

TEST(FrictionAxes, AreFoundAndMakeTheFrictionOfTurnedActuatorsMoreAccurate) {
  for (const Vec3& coulomb : {Vec3(0.5, 0.8, 0.3), Vec3(0.7, 0.7, 0.7), Vec3(0.15, 0.6, 1.2)})
    for (const double angle : {0.2, 0.6}) {
      SCOPED_TRACE(testing::Message() << coulomb.transpose() << ", " << angle);
      Bench turned;
      turned.coulomb = coulomb;
      turned.turn = Eigen::AngleAxisd(angle, Vec3(1, 2, -1).normalized());
      const Identification found = turned.run().identified();
      ASSERT_TRUE(found.plant.actuators);
      const Eigen::AngleAxisd off(found.plant.actuators->axes * turned.turn.transpose());
      EXPECT_LT(off.angle(), 0.1);
      EXPECT_LT(off.angle(), found.plant.actuators->angle_half + 0.05);
      for (int axis = 0; axis < 3; ++axis)
        EXPECT_NEAR(found.plant.actuators->coulomb[axis], coulomb[axis], 0.2 * coulomb[axis] + 0.03);
      PlantModel along_base = found.plant;
      along_base.actuators.reset();
      EXPECT_LT(friction_error(found.plant, turned), (angle < 0.5 ? 0.8 : 0.33) * friction_error(along_base, turned));
    }
}

TEST(FrictionAxes, AreNotClaimedWhereTheActuatorsAreAlignedOrHaveNoFriction) {
  EXPECT_FALSE(bench().identified().plant.actuators);
  Bench smooth;
  smooth.coulomb.setZero();
  smooth.turn = Eigen::AngleAxisd(0.6, Vec3(1, 2, -1).normalized());
  EXPECT_FALSE(smooth.run().identified().plant.actuators);
}

/// A device like those of an ensemble, at the centre and at places around it.
Bench toured(double cable, double period, double shake, double shake_hz = 8) {
  Bench bench;
  bench.cable = cable;
  bench.cable_period = period;
  bench.shake = shake;
  bench.shake_hz = shake_hz;
  bench.stiffness = 2400;
  bench.damping = 30;
  bench.quantum = 5e-5;
  bench.coulomb = Vec3(0.5, 0.4, 0.3);
  bench.gradient = 0;
  bench.turn = Eigen::AngleAxisd(0.6, Vec3(1, 2, -1).normalized());
  bench.run();
  for (const Vec3& place :
       {Vec3(0.03, 0, 0), Vec3(0, -0.03, 0), Vec3(0, 0, 0.03), Vec3(0.06, 0, 0), Vec3(0, 0.06, 0), Vec3(0, 0, -0.06)})
    bench.visit(place, Vec3::Ones());
  return bench;
}

TEST(Cogging, IsFoundWithItsAmplitudesAndItsPhasesFarFromTheCentre) {
  for (const double period : {3e-3, 4e-3}) {
    SCOPED_TRACE(period);
    const Bench cables = toured(1, period, 0.1);
    const Identification found = cables.identified();
    ASSERT_TRUE(found.fits) << found.reason;
    ASSERT_TRUE(found.plant.cogging);
    const Cogging& cogging = *found.plant.cogging;
    ASSERT_EQ(cogging.waves.size(), 3U);
    for (const CoggingWave& wave : cogging.waves) {
      EXPECT_NEAR(kTwoPi / wave.wave_number.norm(), period, 2e-3 * period);
      EXPECT_NEAR(wave.amplitude(), 1, 0.2);
      EXPECT_LT(wave.amplitude_half, 0.4);
    }
    double error2 = 0, force2 = 0;
    for (int i = 0; i < 200; ++i) {
      const Vec3 x = 0.06 * Vec3(std::cos(i), std::sin(1.7 * i), std::sin(2.3 * i)).normalized();
      const Vec3 truth = cables.turn.transpose() * Vec3((kTwoPi / period * (cables.turn * x)).array().sin());
      error2 += (cogging.force(x) - truth).squaredNorm();
      force2 += truth.squaredNorm();
    }
    EXPECT_LT(std::sqrt(error2 / force2), 0.25);
    // The rest of the model is that of the device without cables.
    const Identification plain = toured(0, period, 0.1).identified();
    expect_near(found.plant.mass, plain.plant.mass, 0.15, "mass");
  }
}

TEST(Cogging, IsNotClaimedWithoutCablesWhateverTheNoise) {
  for (const double shake : {0.0, 0.1, 0.4})
    for (const double corner : {1.0, 8.0, 60.0}) {
      SCOPED_TRACE(testing::Message() << shake << " N, " << corner << " Hz");
      if (shake == 0 && corner > 1) continue;
      EXPECT_FALSE(toured(0, 3e-3, shake, corner).identified().plant.cogging);
    }
  EXPECT_FALSE(bench().identified().plant.cogging) << "in the middle alone";
}

TEST(CoarseIdentification, FindsMassAndDelayWithoutTheLines) {
  struct Case {
    double quantum, cable, delay;
  };
  for (const auto& [quantum, cable, delay] :
       {Case{0, 0, 0.3e-3}, Case{2e-4, 0, 6e-3}, Case{0, 0.6, 3e-3}, Case{2e-4, 0.6, 1.3e-3}}) {
    Bench made;
    made.quantum = quantum;
    made.cable = cable;
    made.delay = delay;
    const Identification found = identify_coarsely(made.run().experiment());
    SCOPED_TRACE(testing::Message() << quantum << " m, " << cable << " N, " << delay << " s");
    EXPECT_TRUE(found.fits) << found.reason;
    EXPECT_TRUE(found.coarse);
    expect_near(found.plant.mass, made.mass, 0.12, "mass");
    if (quantum == 0 && cable == 0) expect_near(found.plant.coulomb, made.coulomb, 0.1, "coulomb");
    EXPECT_NEAR(found.plant.delay, delay, 1e-3);
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_LT(std::abs(found.plant.mass[axis] - made.mass[axis]), found.half_width.mass[axis]);
  }
}

TEST(CoarseIdentification, FindsTheCablesWithTheMassInTurns) {
  for (const double shake : {0.0, 0.3}) {
    SCOPED_TRACE(testing::Message() << shake << " N");
    const auto made = toured(0.6, 3e-3, shake, 8);
    const Identification found = identify_coarsely(made.experiment());
    ASSERT_TRUE(found.fits) << found.reason;
    ASSERT_TRUE(found.plant.cogging);
    for (const CoggingWave& wave : found.plant.cogging->waves) {
      EXPECT_NEAR(wave.wave_number.norm(), kTwoPi / 3e-3, 20);
      EXPECT_NEAR(wave.amplitude(), 0.6, 0.2);
    }
    expect_near(found.plant.mass, made.mass, 0.2, "mass");
  }
  EXPECT_FALSE(identify_coarsely(toured(0, 3e-3, 0.4, 8).experiment()).plant.cogging);
}

TEST(CoarseIdentification, RejectsADeviceThatDoesNotRespondToTheForce) {
  EXPECT_FALSE(identify_coarsely(Experiment{}).fits);
  EXPECT_NE(identify_coarsely(Experiment{}).reason, "");

  Bench still = bench(), noise = bench(), against = bench();
  for (TickRow& row : still.rows) row.position = Vec3::Zero();
  EXPECT_FALSE(identify_coarsely(still.experiment()).fits);
  std::mt19937 random(3);
  std::normal_distribution<double> normal(0, 1e-3);
  for (TickRow& row : noise.rows) row.position = Vec3(normal(random), normal(random), normal(random));
  EXPECT_FALSE(identify_coarsely(noise.experiment()).fits);
  for (TickRow& row : against.rows) row.force *= -1;
  EXPECT_FALSE(identify_coarsely(against.experiment()).fits);
}

TEST(PositionResolution, IsTheStepOfALatticeInAnyOrientation) {
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(0.7, Vec3(1, 2, 3).normalized()).toRotationMatrix();
  std::vector<TickRow> rows;
  for (int k = 0; k < 3000; ++k) {
    const Vec3 p(0.01 * std::sin(0.003 * k), 0.02 * std::cos(0.002 * k), 0.01 * std::sin(0.005 * k));
    rows.push_back({1e-3 * k, turn * (2e-5 * (p / 2e-5).array().round()).matrix(), Vec3::Zero()});
  }
  EXPECT_NEAR(position_quantum(rows), 2e-5, 1e-9);
  for (TickRow& row : rows) row.position = Vec3(std::sin(row.time), std::cos(1.7 * row.time), row.time * row.time);
  EXPECT_EQ(position_quantum(rows), 0);
}

TEST(Multisine, HasAnRmsOfOneALowCrestAndNoLineOfTheSlowMovement) {
  const Multisine dither(15, 120, 2, {true, true, true});
  for (int axis = 0; axis < 3; ++axis) {
    double squares = 0, peak = 0;
    for (int k = 0; k < 8000; ++k) {
      const double value = dither.value(k * 0.25e-3)[axis];
      squares += value * value / 8000;
      peak = std::max(peak, std::abs(value));
    }
    EXPECT_NEAR(squares, 1, 1e-9);
    EXPECT_LT(peak, 2.6);
    for (const SpectralLine& line : dither.lines(axis))
      EXPECT_EQ(std::lround(line.frequency_hz * 2) % 2, 1) << line.frequency_hz;
  }
  EXPECT_TRUE(Multisine(15, 120, 2, {true, false, true}).lines(1).empty());
  EXPECT_THROW(Multisine(15, 18, 2, {true, true, true}), std::exception);
}

TEST(IdentificationOfInertia, FindsHowTheMassVariesAroundTheCentre) {
  Bench bench;
  bench.quantum = 2e-5;
  bench.run();
  const auto factor = [](const Vec3& x) -> Vec3 {
    return {1 - 60 * x.x() * x.x(), 1 + 5 * x.y() - 40 * x.z() * x.z(), 1};
  };
  for (const double side : {0.06, -0.06})
    for (int axis = 0; axis < 3; ++axis) {
      const Vec3 place = side * Vec3::Unit(axis);
      bench.visit(place, factor(place));
    }
  const auto factors = inertia_factors(bench.experiment(), bench.identified());
  ASSERT_TRUE(factors);
  ASSERT_EQ(factors->size(), 6U);
  for (std::size_t i = 0; i < 6; ++i)
    EXPECT_LT(((*factors)[i].factor - factor(bench.places[i].position)).cwiseAbs().maxCoeff(), 0.04)
        << bench.places[i].position.transpose() << ": " << (*factors)[i].factor.transpose();
  const auto map = identify_inertia(bench.experiment(), bench.identified());
  ASSERT_TRUE(map);
  EXPECT_TRUE(map->at(Vec3::Zero()).isApprox(Vec3::Ones()));
  for (const Vec3& place :
       {Vec3(0.05, 0, 0), Vec3(0, -0.05, 0.03), Vec3(-0.03, 0.04, -0.04), Vec3(0.037, 0.037, 0.037)})
    EXPECT_LT((map->at(place) - factor(place)).cwiseAbs().maxCoeff(), 0.08) << place.transpose();
  EXPECT_LT((map->at(Vec3(1, 1, 1)) - map->at(Vec3(0.2, 0.2, 0.2))).norm(), 1e-9)
      << "what is far away was not measured";
  EXPECT_GT(map->at(Vec3(10, 10, 10)).minCoeff(), 0.3);
}

TEST(IdentificationOfInertia, FollowsAMassThatFallsSteeplyBetweenTheCentreAndTheFarthestPlaces) {
  Bench bench;
  bench.quantum = 2e-5;
  bench.run();
  const auto factor = [](const Vec3& x) -> Vec3 {
    return Vec3::Constant((1 + 0.7 * std::cos(std::numbers::pi * x.norm() / 0.06)) / 1.7);
  };
  for (const double side : {0.06, -0.06})
    for (int axis = 0; axis < 3; ++axis) bench.visit(side * Vec3::Unit(axis), factor(side * Vec3::Unit(axis)));
  for (const Vec3& half : {Vec3(0.03, 0, 0), Vec3(0, -0.03, 0), Vec3(0, 0, 0.03)}) bench.visit(half, factor(half));
  const auto map = identify_inertia(bench.experiment(), bench.identified());
  ASSERT_TRUE(map);
  for (const Vec3& way : {Vec3(1, 0, 0), Vec3(0, -1, 1), Vec3(-1, 1, -1)})
    for (const double away : {0.01, 0.02, 0.03, 0.04, 0.05, 0.06}) {
      const Vec3 place = away * way.normalized();
      EXPECT_LT((map->at(place) - factor(place)).cwiseAbs().maxCoeff(), 0.1) << place.transpose();
    }
}

TEST(IdentificationOfInertia, SeesNoVariationWhereThereIsNone) {
  Bench bench;
  bench.quantum = 5e-5;
  bench.run();
  for (const double side : {0.06, -0.06}) bench.visit(side * Vec3::UnitX(), Vec3::Ones());
  EXPECT_FALSE(identify_inertia(bench.experiment(), bench.identified()));
  const auto factors = inertia_factors(bench.experiment(), bench.identified());
  ASSERT_TRUE(factors);
  ASSERT_EQ(factors->size(), 2U);
  for (const InertiaFactor& at : *factors)
    EXPECT_TRUE(((at.factor.array() - 1).abs() < 3 * at.deviation.array()).all()) << at.factor.transpose();
}

TEST(IdentificationOfInertia, NeedsWholePeriodsAtItsPlacesAndAModelAtTheCentre) {
  Bench bench;
  bench.run().visit(Vec3(0.06, 0, 0), Vec3::Constant(0.5));
  EXPECT_FALSE(identify_inertia(bench.experiment(), Identification{}));
  bench.places[0].dithered.end -= 200;
  EXPECT_FALSE(identify_inertia(bench.experiment(), bench.identified()));
}

}  // namespace
}  // namespace haptrace
