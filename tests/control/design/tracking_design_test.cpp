#include "control/design/tracking_design.h"

#include "control/filters.h"
#include "control/observer_pd.h"
#include "devices/sim/sim_device.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

PlantModel plant_of(double mass, double delay, double resolution = 0) {
  PlantModel plant;
  plant.mass = Vec3(mass, 0.8 * mass, 0.6 * mass);
  plant.delay = delay;
  plant.position_resolution = resolution;
  return plant;
}

/// A simulated device in closed loop with the law that is designed for its plant.
struct DesignedLoop {
  DesignedLoop(const SimSpec& spec, const PlantModel& plant, const TrackingDesign& design, double rate_hz)
      : device(spec),
        law({.design = design, .rate_hz = rate_hz, .position_resolution = plant.position_resolution}),
        period(1 / rate_hz) {
    tuning.gains = design.gains;
    tuning.observer_hz = design.load_hz;
  }

  /// Runs one tick towards `reference`, with an additional external force `push` [N].
  void tick(const Reference& reference, const Vec3& push = Vec3::Zero()) {
    DeviceState answer;
    const double dt = first ? 0 : period;
    (void)device.exchange({.force = force + push}, dt, answer);
    State state;
    state.dt = dt;
    state.position = answer.position;
    state.force_applied = force;
    if (first) law.start(state);
    first = false;
    force = law.force({state, reference, tuning});
  }

  SimDevice device;
  ObserverPd law;
  Tuning tuning;
  double period;
  Vec3 force = Vec3::Zero();
  bool first = true;
};

/// Returns a device that is lighter than the design assumes and half a tick later.
SimSpec real_device(PlantModel plant, double rate_hz) {
  for (int axis = 0; axis < 3; ++axis) plant.mass[axis] = plant.mass[axis] > 0 ? 0.8 * plant.mass[axis] : 0.1;
  plant.delay += 0.5 / rate_hz;
  return sim_spec_of(plant, 1e6);
}

struct Extreme {
  double mass, delay_ticks, rate_hz, resolution;
  bool two_axes;
};

std::vector<Extreme> extremes() {
  std::vector<Extreme> all;
  for (const double rate : {100.0, 1000.0, 4000.0, 20000.0})
    for (const double delay : {0.0, 2.0, 16.0, 60.0})
      for (const double mass : {0.045, 5.0})
        for (const double resolution : {0.0, 5e-4}) {
          if (delay > StateObserver::kLongestDelay && resolution > 0) continue;  // the loop hunts by a few counts
          all.push_back({mass, delay, rate, resolution, mass < 1});
        }
  return all;
}

TEST(TrackingDesign, IsValidAndCalmsALighterAndLaterDeviceAtEveryExtreme) {
  for (const Extreme& extreme : extremes()) {
    SCOPED_TRACE(testing::Message() << extreme.mass << " kg, " << extreme.delay_ticks << " ticks, " << extreme.rate_hz
                                    << " Hz, resolution " << extreme.resolution << " m");
    PlantModel plant = plant_of(extreme.mass, extreme.delay_ticks / extreme.rate_hz, extreme.resolution);
    if (extreme.two_axes) plant.mass.z() = 0;
    const TrackingDesign design = design_tracking(plant, {.rate_hz = extreme.rate_hz, .max_force = 10});
    EXPECT_NO_THROW(validate(design.gains));
    EXPECT_NO_THROW(validate(design.largest));
    EXPECT_NO_THROW(validate(design.plain));
    EXPECT_GT(design.gains.kp.x(), 0);
    EXPECT_TRUE((design.largest.kp.array() >= design.gains.kp.array()).all());
    EXPECT_TRUE((design.largest.kd.array() >= design.gains.kd.array()).all());
    EXPECT_EQ(design.gains.kp.z() == 0, extreme.two_axes);
    EXPECT_DOUBLE_EQ(design.authority, 7);
    for (const double figure : {design.observer_hz, design.load_hz, design.ripple, design.delay})
      EXPECT_TRUE(std::isfinite(figure));
    EXPECT_GT(design.observer_hz, 0);

    // Push, then leave the loop time to settle, in units of its own time constant.
    DesignedLoop loop(real_device(plant, extreme.rate_hz), plant, design, extreme.rate_hz);
    const double w = std::sqrt(design.gains.kp.x() / plant.mass.x());
    const auto ticks =
        static_cast<int>(std::ceil(40 / w * extreme.rate_hz)) + 4 * static_cast<int>(extreme.delay_ticks);
    const double slow = std::max(1.0, 0.36 * extreme.rate_hz / ticks);  // the load filter needs time too
    const Vec3 push = 5e-3 * design.gains.kp;
    const Reference rest{Vec3::Zero(), Vec3::Zero(), Vec3::Zero(), 0};
    double pushed = 0, after = 0;
    const auto n = static_cast<int>(slow * ticks);
    for (int i = 0; i < 3 * n; ++i) {
      loop.tick(rest, i < n / 8 ? push : Vec3::Zero());
      const double distance = loop.device.true_position().norm();
      ASSERT_TRUE(std::isfinite(distance));
      if (i < n) pushed = std::max(pushed, distance);
      if (i >= 2 * n) after = std::max(after, distance);
    }
    EXPECT_LT(after, std::max(0.04 * pushed, 6 * extreme.resolution)) << "pushed by " << pushed;
  }
}

TEST(TrackingDesign, CalmsALightDeviceInAHeavyHandOnAStiffGrip) {
  PlantModel plant = plant_of(0.25, 2e-3, 5e-5);
  plant.mass = Vec3::Constant(0.2);
  const TrackingDesign design = design_tracking(plant, {.rate_hz = 1000, .max_force = 8.9});
  SimSpec spec = sim_spec_of(plant, 100);
  spec.position_resolution = 0;
  spec.hand = HandSpec{.mass = 0.3, .grip_stiffness = 1500, .grip_damping = 3};
  plant.position_resolution = 0;
  DesignedLoop loop(spec, plant, design, 1000);
  // The reference moves slowly, so that the law does not enter its rest state.
  const Reference reference{Vec3::Zero(), Vec3(2e-4, 0, 0), Vec3::Zero(), 0};
  double early = 0, late = 0;
  for (int i = 0; i < 700; ++i) {
    loop.tick(reference, i < 20 ? Vec3(2, 0, 0) : Vec3(0, 0, 0));
    double& fastest = i < 300 ? early : late;
    if ((i >= 100 && i < 300) || i >= 500) fastest = std::max(fastest, loop.device.true_velocity().norm());
  }
  EXPECT_LT(late, 0.75 * early) << "a compensation of 12 Hz gives a ratio of 1.2";
}

TEST(TrackingDesign, IsStifferForMoreMassAndSofterForMoreDelay) {
  const auto kp = [](double mass, double delay) {
    return design_tracking(plant_of(mass, delay), {.rate_hz = 1000, .max_force = 8}).gains.kp.x();
  };
  EXPECT_NEAR(kp(0.8, 2e-3) / kp(0.4, 2e-3), 2, 1e-9);
  double before = kp(0.4, 0);
  for (const double delay : {0.5e-3, 1e-3, 2e-3, 4e-3, 8e-3, 16e-3}) {
    const double now = kp(0.4, delay);
    EXPECT_LT(now, before);
    before = now;
  }
}

TEST(TrackingDesign, FollowsItsFormulaWhereNothingLimitsIt) {
  const PlantModel plant = plant_of(0.4, 2e-3);
  const TrackingDesign design = design_tracking(plant, {.rate_hz = 1000, .max_force = 8});
  const double w = 0.4 / 3e-3;
  EXPECT_NEAR(design.gains.kp.x(), 0.4 * w * w, 1e-6);
  EXPECT_NEAR(design.gains.kd.x(), 0.4 * 1.5 * w, 1e-9);
  EXPECT_NEAR(design.observer_hz, 1.5 * w / (2 * M_PI), 1e-9);
  EXPECT_TRUE(design.mass.isApprox(1.1 * plant.mass, 1e-12));
  EXPECT_EQ(design.delay, 2e-3);
  EXPECT_EQ(design.ripple, 0);
}

/// Returns the rms of the command above 25 Hz along a slow curve that crosses many encoder counts [N].
double measured_ripple(const PlantModel& plant, const TrackingDesign& design, double rate_hz) {
  DesignedLoop loop(sim_spec_of(plant, 1e6), plant, design, rate_hz);
  std::vector<Butterworth2> filters(6, Butterworth2(Butterworth2::Kind::high_pass, 25, rate_hz));
  const double radius = 0.03, w = 1.3;
  double sum = 0;
  int count = 0;
  for (int i = 0; i < static_cast<int>(4 * rate_hz); ++i) {
    const double a = w * i / rate_hz;
    const Vec3 c(std::sin(a), 1 - std::cos(a), 0.7 * std::sin(1.7 * a)),
        s(std::cos(a), std::sin(a), 0.7 * 1.7 * std::cos(1.7 * a));
    loop.tick({radius * c, radius * w * s, Vec3::Zero(), 0});
    double square = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double high = filters[2 * axis + 1].update(filters[2 * axis].update(loop.force[static_cast<int>(axis)]));
      square += high * high;
    }
    if (i < static_cast<int>(rate_hz)) continue;
    sum += square;
    ++count;
  }
  return std::sqrt(sum / count);
}

TEST(TrackingDesign, StatesTheRippleThatIsMeasured) {
  for (const double rate : {500.0, 1000.0, 4000.0})
    for (const double delay : {0.0, 1.5e-3, 4e-3})
      for (const double resolution : {1e-5, 5e-5, 2e-4}) {
        // Quantisation errors are white only if the device crosses a count every few ticks, here at some 40 mm/s.
        if (resolution * rate > 0.25) continue;
        const PlantModel plant = plant_of(0.4, delay, resolution);
        const TrackingDesign design = design_tracking(plant, {.rate_hz = rate, .max_force = 8});
        const double measured = measured_ripple(plant, design, rate);
        EXPECT_LT(measured, 1.3 * design.ripple) << rate << " Hz, " << delay << " s, " << resolution << " m";
        EXPECT_GT(measured, design.ripple / 1.5) << rate << " Hz, " << delay << " s, " << resolution << " m";
      }
}

TEST(TrackingDesign, KeepsTheRippleWithinItsLimit) {
  const PlantModel plant = plant_of(0.4, 1e-3, 5e-5);
  double stiffer = std::numeric_limits<double>::infinity();
  for (const double allowed : {0.5, 0.1, 0.02}) {
    const TrackingDesign design = design_tracking(plant, {.rate_hz = 1000, .max_force = 8, .max_ripple = allowed});
    EXPECT_LE(design.ripple, allowed);
    EXPECT_LT(measured_ripple(plant, design, 1000), 1.3 * allowed);
    EXPECT_LE(design.gains.kp.x(), stiffer);
    stiffer = design.gains.kp.x();
  }
  EXPECT_GT(stiffer, 0);
}

TEST(TrackingDesign, KeepsAShareOfItsBandwidthForAPlantThatIsKnownBadly) {
  const PlantModel plant = plant_of(0.4, 1e-3, 5e-5);
  const TrackingDesign whole = design_tracking(plant, {.rate_hz = 1000, .max_force = 8});
  const TrackingDesign half = design_tracking(plant, {.rate_hz = 1000, .max_force = 8, .bandwidth = 0.5});
  EXPECT_NEAR(half.gains.kp.x(), 0.25 * whole.gains.kp.x(), 1e-9 * whole.gains.kp.x());
  EXPECT_NEAR(half.gains.kd.x(), 0.5 * whole.gains.kd.x(), 1e-9 * whole.gains.kd.x());
  EXPECT_NEAR(half.observer_hz, 0.5 * whole.observer_hz, 1e-9);
  EXPECT_LT(half.ripple, 0.5 * whole.ripple);
}

TEST(TrackingDesign, IsStableUnderStiffPdControlOnlyWithMassAndWithoutDelay) {
  EXPECT_TRUE(is_stable(plant_of(0.5, 1e-3), stiff_gains(), 1.2, 1000));
  EXPECT_FALSE(is_stable(plant_of(0.5, 8e-3), stiff_gains(), 1.2, 1000)) << "it is late";
  EXPECT_FALSE(is_stable(plant_of(0.05, 1e-3), stiff_gains(), 1.2, 1000)) << "it is light";
  EXPECT_FALSE(is_stable(plant_of(0.5, 1e-3), stiff_gains(), 50, 1000)) << "nothing has such a margin";
  PlantModel planar = plant_of(0.5, 1e-3);
  planar.mass.z() = 0;
  EXPECT_TRUE(is_stable(planar, stiff_gains(), 1.2, 1000)) << "an axis without a motor does not count";
}

TEST(TrackingDesign, NeedsAMass) {
  EXPECT_THAT(test::error_of([] { (void)design_tracking(PlantModel{}, {}); }), testing::HasSubstr("no mass"));
  const auto late = [](double rate_hz) {
    return test::error_of([&] { (void)design_tracking(plant_of(0.4, 15e-3), {.rate_hz = rate_hz, .max_force = 8}); });
  };
  EXPECT_THAT(late(20000), testing::AllOf(testing::HasSubstr("15 ms is 300 ticks at 20000 Hz"),
                                          testing::HasSubstr("at most 4267 Hz")));
  EXPECT_EQ(late(4000), "no error");
}

}  // namespace
}  // namespace haptrace
