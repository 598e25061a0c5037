#include "studies/guidance_draw.h"

#include "control/path/min_jerk.h"
#include "control/path/shapes.h"
#include "control/path/trajectory.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace haptrace {
namespace {

using std::numbers::pi;

constexpr double kStep = 1e-3;                         // time step of intents and paths [s]
constexpr std::uint64_t kOther = 0x67756964'616e6365;  // separates these random numbers from those of the devices

/// Slow, aperiodic movement: three sines per axis, guidance_ensemble::kWander rms.
class Wandering {
 public:
  explicit Wandering(std::uint64_t seed) {
    Lot lot(seed, 1);
    for (auto& axis : sines_)
      for (auto& [frequency, phase] : axis) {
        frequency = lot.in({0.3, 3});
        phase = lot.in({0, 2 * pi});
      }
  }
  [[nodiscard]] Vec3 at(double t) const {
    Vec3 sum = Vec3::Zero();
    for (std::size_t axis = 0; axis < 3; ++axis)
      for (const auto& [frequency, phase] : sines_[axis])
        sum[static_cast<Eigen::Index>(axis)] += std::sin(2 * pi * frequency * t + phase);
    return guidance_ensemble::kWander * std::sqrt(2.0 / 3) * sum;
  }

 private:
  struct Sine {
    double frequency = 0, phase = 0;  // [Hz], [rad]
  };
  std::array<std::array<Sine, 3>, 3> sines_;
};

/// Returns a minimum-jerk movement along the curve `at`, whose argument runs from 0 to 1.
template <class At>
Path drawn(const std::string& name, double duration, const At& at) {
  Path path{.name = name};
  for (int i = 0; i * kStep <= duration; ++i) {
    path.time.push_back(kStep * i);
    path.position.push_back(at(MinJerk::at(kStep * i / duration).s));
  }
  return path;
}

/// Returns the position on an inward spiral of four turns, whose lobes touch the previous ones.
Vec3 lobed_spiral(double u) {
  const double angle = 4 * 2 * pi * u, r = 0.045 * (1 - u) * (1 + 0.3 * std::cos(3 * angle));
  return {r * std::cos(angle), r * std::sin(angle), 0.01 * u};
}

/// Returns the position on a polyline with acute, right and obtuse corners.
Vec3 corners(double u) {
  static const std::array<Vec3, 7> kCorners{Vec3(-0.04, -0.03, 0), Vec3(0.04, -0.03, 0),   Vec3(-0.02, -0.015, 0),
                                            Vec3(-0.02, 0.03, 0),  Vec3(0.01, 0.03, 0.01), Vec3(0.03, 0.01, 0.01),
                                            Vec3(0.045, 0.045, 0)};
  const double s = std::min(u, 1.0) * (kCorners.size() - 1);
  const std::size_t i = std::min(static_cast<std::size_t>(s), kCorners.size() - 2);
  return kCorners[i] + (s - static_cast<double>(i)) * (kCorners[i + 1] - kCorners[i]);
}

Whim draw_whim(Lot& lot, const guidance_ensemble::Range& way) {
  return {.at = lot.in(guidance_ensemble::kPlace),
          .lasts = lot.in(guidance_ensemble::kWhile),
          .way = lot.in(way)*lot.direction()};
}

}  // namespace

std::vector<Path> guidance_paths() {
  const auto shape = [](const char* name, double duration) {
    return make_shape(name, {.size = 0.08, .duration = duration, .blend = 0});
  };
  std::vector<Path> paths{shape("figure8", 4),
                          shape("line", 3),
                          shape("square", 4),
                          shape("script", 6),
                          drawn("spiral", 8, lobed_spiral),
                          shape("circle", 4),
                          drawn("corners", 4, corners)};
  for (Path& path : paths) {
    path.velocity.clear();
    for (const double t : path.time) {
      const double turn = 2 * pi * t / path.duration();
      path.force.emplace_back(1.5 * std::cos(turn), 1.5 * std::sin(3 * turn), 1 + 0.5 * std::sin(2 * turn));
    }
  }
  return paths;
}

Path intent_of(const Trainee& trainee, const Path& expert) {
  const Trajectory way(expert, Interpolation::linear);
  const Wandering wandering(trainee.seed);
  Path intent{.name = "trainee"};
  double place = 0;  // the expert's time [s]
  std::array<double, 4> begun{};
  begun.fill(kNaN);
  for (int i = 0; place < way.duration(); ++i) {
    const double t = kStep * i;
    /// Returns the progress of a deviation, 0 to 1; NaN while it is not active.
    const auto progress = [&](std::size_t n, const Whim& whim) {
      if (std::isnan(begun[n]) && place >= whim.at * way.duration()) begun[n] = t;
      const double share = (t - begun[n]) / whim.lasts;
      return share < 1 ? share : kNaN;
    };
    // Moves aside and back within the duration. A small `rise` moves quickly and stays aside for most of it.
    const auto aside = [&](const Whim& whim, double share, double rise) -> Vec3 {
      if (std::isnan(share)) return Vec3::Zero();
      return MinJerk::at(std::min({share, 1 - share, rise}) / rise).s * whim.way;
    };
    const double stops = progress(0, trainee.stops), returns = progress(1, trainee.returns);
    const Vec3 away = aside(trainee.leaves, progress(2, trainee.leaves), 0.5) +
                      aside(trainee.pushes, progress(3, trainee.pushes), 0.3);
    intent.time.push_back(t);
    intent.position.push_back(way.sample(place).position + std::min(t / kTraineeWaits, 1.0) * wandering.at(t) + away);
    if (t < kTraineeWaits || !std::isnan(stops)) continue;
    place = std::max(place + (std::isnan(returns) ? 1 : -1) * trainee.speed * kStep, 0.0);
  }
  return intent;
}

GuidanceDraw draw_guidance(std::uint64_t seed, std::uint64_t index) {
  GuidanceDraw draw{.index = index, .device = draw_device(seed, index)};
  Lot lot(seed ^ kOther, index);
  SimSpec& spec = draw.device.spec;
  spec.delay += lot.in(guidance_ensemble::kFurtherDelay);

  GuideOptions& guide = draw.guide;
  guide.session.loop.rate_hz = lot.in_logarithm(guidance_ensemble::kRate);
  guide.session.loop.limits.max_velocity = 1.5;  // as haptrace guide has it [m/s]
  const double radius = lot.in(guidance_ensemble::kRadius);
  guide.radius = lot.happens(guidance_ensemble::kNoRadius) ? 0 : radius;
  guide.stiffness = lot.in_logarithm(guidance_ensemble::kStiffness);
  guide.onset = lot.in(guidance_ensemble::kOnset);
  guide.damping = lot.in(guidance_ensemble::kWallDamping);
  guide.force_scale = lot.in(guidance_ensemble::kForceScale);
  guide.feel = lot.happens(0.5) ? Feel::active : Feel::resist;
  guide.pace =
      PaceHelpOptions{.pace = lot.in(guidance_ensemble::kPace), .max_force = lot.in(guidance_ensemble::kPaceForce)};
  guide.resistance = lot.in(guidance_ensemble::kResistance);
  guide.viscosity = lot.in(guidance_ensemble::kViscosity);
  guide.amplify = lot.in(guidance_ensemble::kAmplify);
  guide.amplify_force = lot.in(guidance_ensemble::kAmplifyForce);
  guide.guidance.cursor = lot.happens(guidance_ensemble::kCursor);
  guide.guidance.speed = lot.in(guidance_ensemble::kCursorSpeed);
  guide.guidance.wait = lot.happens(0.5) ? 0 : 0.02;
  guide.guidance.max_deviation = 1;  // a trainee who leaves the path may return
  guide.guidance.allow_back = lot.happens(0.5);
  const double lag = 1 / (2 * pi * spec.actuator_bandwidth_hz);
  guide.identified = IdentifiedDevice{.plant = {.mass = spec.mass,
                                                .viscous = spec.viscous,
                                                .coulomb = spec.coulomb,
                                                .delay = lot.in(guidance_ensemble::kKnownDelay) * (spec.delay + lag)}};
  if (!lot.happens(guidance_ensemble::kCalibrated)) guide.identified.reset();

  const double hand_mass = lot.in_logarithm(guidance_ensemble::kHandMass),
               stiffness = lot.in_logarithm(guidance_ensemble::kIntentStiffness),
               damping = lot.in(guidance_ensemble::kIntentDamping),
               tremor = lot.in_logarithm(guidance_ensemble::kTremor);
  if (HandSpec* hand = spec.hand ? &*spec.hand : nullptr) {
    hand->mass = hand_mass;
    hand->tremor = tremor;
    hand->intent_stiffness = stiffness;
    hand->intent_damping = 2 * damping * std::sqrt(stiffness * hand_mass);
  }
  draw.trainee.speed = lot.in_logarithm(guidance_ensemble::kSpeed);
  draw.trainee.stops = draw_whim(lot, {0, 0});
  draw.trainee.returns = draw_whim(lot, {0, 0});
  draw.trainee.leaves =
      draw_whim(lot, {guide.radius + guidance_ensemble::kLeaves.low, guide.radius + guidance_ensemble::kLeaves.high});
  draw.trainee.pushes =
      draw_whim(lot, {guide.radius + guidance_ensemble::kPushes.low, guide.radius + guidance_ensemble::kPushes.high});
  const double lets_go = lot.in(guidance_ensemble::kPlace);
  if (lot.happens(guidance_ensemble::kLetsGo)) draw.trainee.lets_go = lets_go;
  draw.trainee.seed = lot.seed();
  return draw;
}

}  // namespace haptrace
