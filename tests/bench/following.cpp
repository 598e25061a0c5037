// Compares tracking laws on simulated devices whose dynamics are given, not identified: the mass with an error of 6 %,
// the hand with one of 25 % (standard deviations), delay and friction axes exactly.
//
//     haptrace_following [DRAWS [SEED]]
//
// The devices are those of the studies' ensemble (studies/ensemble_draw.h), always held, with a delay of 1 to 2.4 ms, a
// lag of 0.5 ms, without stiction and with an arm that yields as that of HandModel. Prints the median over the draws of
// the true error, and how many times smaller it is than that of a stiff PD law (3000 N/m, 25 N s/m, velocity low pass
// of 100 Hz), after five repetitions.
#include "base/statistics.h"
#include "control/design/held_model.h"
#include "control/design/lqg_search.h"
#include "control/feedforward.h"
#include "control/iterative_learning.h"
#include "control/lqg_law.h"
#include "control/observer_pd.h"
#include "control/path/min_jerk.h"
#include "control/path/shapes.h"
#include "control/path/trajectory.h"
#include "control/pd.h"
#include "control/ripple.h"
#include "control/velocity_estimator.h"
#include "devices/sim/sim_device.h"
#include "studies/ensemble_draw.h"

#include <Eigen/LU>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

namespace haptrace {
namespace {

constexpr double kRate = 1000, kPeriod = 1 / kRate;
constexpr double kLag = 0.5e-3;
constexpr int kRepetitions = 5;

/// Knowledge of a device when its law is designed.
struct Known {
  PlantModel plant;
  std::array<std::optional<AxisModel>, 3> axes;
  Eigen::Matrix3d actuators;  ///< from W to the actuator axes
  Vec3 viscous, coulomb;      ///< along the actuator axes
};

Known known_of(const SimSpec& spec, Gaussian& gaussian) {
  Known known;
  const double angle = spec.rotation.norm();
  known.actuators = angle > 0 ? Eigen::AngleAxisd(angle, spec.rotation / angle).toRotationMatrix()
                              : Eigen::Matrix3d(Eigen::Matrix3d::Identity());
  known.viscous = spec.viscous;
  known.coulomb = spec.coulomb;
  const Eigen::Matrix3d mobility =
      known.actuators.transpose() * spec.mass.cwiseInverse().asDiagonal() * known.actuators;
  known.plant.delay = spec.delay + kLag;
  known.plant.position_resolution = spec.position_resolution;
  known.plant.gravity = 0.9 * spec.gravity_bias;
  known.plant.gravity_gradient = spec.gravity_gradient;
  known.plant.viscous = Vec3::Constant(spec.viscous.mean());
  known.plant.coulomb = Vec3::Constant(spec.coulomb.mean());
  const auto off = [&](double value, double error) { return value * std::exp(error * gaussian()); };
  const HandModel hand{.mass = off(spec.hand->mass, 0.25),
                       .grip_stiffness = off(spec.hand->grip_stiffness, 0.25),
                       .grip_damping = off(spec.hand->grip_damping, 0.25)};
  for (int axis = 0; axis < 3; ++axis) known.plant.mass[axis] = off(1 / mobility(axis, axis), 0.06);
  known.axes = axis_models(held_model(known.plant, hand, kLag), measured_noise(known.plant), kRate);
  return known;
}

/// Friction along the actuator axes, from the reference.
class ActuatorFriction final : public ForceTerm {
 public:
  explicit ActuatorFriction(const Known& known) : known_(known) {}
  [[nodiscard]] Vec3 force(const TermInput& input) noexcept override {
    const Vec3 v = known_.actuators * input.reference.velocity;
    Vec3 force;
    for (int i = 0; i < 3; ++i)
      force[i] = known_.viscous[i] * v[i] + known_.coulomb[i] * std::tanh(v[i] / FrictionFeedforward::kTransition);
    return known_.actuators.transpose() * force;
  }

 private:
  const Known& known_;
};

/// Mass times the acceleration of the reference at the middle of the period in which the force acts.
class TimelyInertia final : public ForceTerm {
 public:
  TimelyInertia(const Known& known, const Trajectory& trajectory)
      : mass_(known.plant.mass), lead_(known.plant.delay + 0.5 * kPeriod), trajectory_(trajectory) {}
  [[nodiscard]] Vec3 force(const TermInput& input) noexcept override {
    const double time = input.reference.time;
    return mass_.cwiseProduct(std::isfinite(time) ? trajectory_.sample(time + lead_, cursor_).acceleration
                                                  : input.reference.acceleration);
  }

 private:
  Vec3 mass_;
  double lead_;
  const Trajectory& trajectory_;
  Trajectory::Cursor cursor_;
};

enum class Law { stiff, observer, quiet, normal, exact };
constexpr std::array kLaws{Law::stiff, Law::observer, Law::quiet, Law::normal, Law::exact};
constexpr std::array kNames{"stiff PD", "observer", "LQG quiet", "LQG normal", "LQG exact"};

struct Figures {
  double error = 0, ripple = 0;  ///< [m], [N]
  bool oscillates = false;
};

ForceTable load_along(const Known& known, const Trajectory& trajectory, bool friction) {
  ForceTable table{.step = 0.004, .force = {}};
  GravityFeedforward gravity(known.plant);
  FrictionFeedforward rubs(known.plant);
  const State state;
  const Tuning tuning;
  Trajectory::Cursor cursor;
  for (double t = 0; t < trajectory.duration() + table.step; t += table.step) {
    const Reference reference = trajectory.sample(t, cursor);
    table.force.push_back(gravity.force({state, reference, tuning}));
    if (friction) table.force.back() += rubs.force({state, reference, tuning});
  }
  return table;
}

/// Plays the trajectory five times, and returns the figures of the last.
Figures played(const SimSpec& spec, std::uint64_t seed, const Known& known, const Trajectory& trajectory, Law which,
               const std::array<std::optional<LqgLaws>, 3>& laws) {
  SimDevice device(spec, {.seed = seed});
  const bool lqg = which >= Law::quiet, learns = which != Law::stiff;
  Tuning tuning;
  ForceTerms terms;
  LearnedForce* learned = nullptr;
  const double duration = trajectory.duration();
  IterativeLearning learning(
      {.mass = known.plant.mass, .delay = known.plant.delay, .cutoff_hz = lqg ? 30.0 : 15.0, .duration = duration},
      load_along(known, trajectory, !lqg));
  if (lqg) terms.push_back(std::make_unique<ActuatorFriction>(known));
  if (learns) {
    auto term = std::make_unique<LearnedForce>(duration, static_cast<std::size_t>(duration * kRate) + 1000);
    learned = term.get();
    learned->use(&learning.table());
    terms.push_back(std::move(term));
  }
  if (which == Law::stiff) {
    tuning.gains = {Vec3::Constant(3000), Vec3::Constant(25)};
    terms.push_back(std::make_unique<PdLaw>());
  } else if (which == Law::observer) {
    const TrackingDesign design = design_tracking(known.plant, {.max_force = spec.max_force});
    tuning.gains = design.gains;
    tuning.observer_hz = design.load_hz;
    terms.push_back(std::make_unique<ObserverPd>(
        ObserverPd::Options{.design = design, .position_resolution = spec.position_resolution}));
    terms.push_back(std::make_unique<InertiaFeedforward>(design.mass));
  } else {
    tuning.gains = gains_of(laws);
    terms.push_back(std::make_unique<TimelyInertia>(known, trajectory));
    terms.push_back(std::make_unique<LqgLaw>(LqgLaw::Options{
        .axes = laws, .position_resolution = spec.position_resolution, .authority = 0.7 * spec.max_force}));
  }

  const auto velocity = make_velocity_estimator("lowpass:100", kRate, spec.position_resolution);
  State state;
  DeviceState answer;
  Trajectory::Cursor cursor;
  Ripple force_ripple(kRippleCutoff, kRate), place_ripple(kRippleCutoff, kRate);
  Figures figures;
  double error2 = 0, ripple2 = 0, rippled = 0;
  int ticks = 0;
  bool first = true;
  const auto tick = [&](const Reference& reference, bool judged) {
    state.dt = first ? 0 : kPeriod;
    (void)device.exchange({.force = state.force_applied}, state.dt, answer);
    state.position = answer.position;
    state.velocity = velocity->update(state.position, kPeriod);
    if (first)
      for (const auto& term : terms) term->start(state);
    first = false;
    Vec3 force = Vec3::Zero();
    for (const auto& term : terms) force += term->force({state, reference, tuning, force});
    if (force.norm() > spec.max_force) force *= spec.max_force / force.norm();
    state.force_applied = force;
    const Vec3 error = device.true_position() - reference.position;
    const double in_force = force_ripple.update(force), in_place = place_ripple.update(error);
    constexpr double kQuarter = 0.25, kOscillates = 0.06e-3;
    rippled += (in_place - rippled) * kPeriod / kQuarter;
    if (!judged) return;
    error2 += error.squaredNorm();
    ripple2 += in_force;
    figures.oscillates |= std::sqrt(rippled) > kOscillates;
    ++ticks;
  };
  RepetitionLog log;
  if (learns) log.reserve(static_cast<std::size_t>(duration * kRate) + 1000);
  Vec3 from = Vec3::Zero();
  for (int repetition = 0; repetition < kRepetitions; ++repetition) {
    const Vec3 to = trajectory.sample(0, cursor).position;
    constexpr double kApproach = 1.5, kHold = 0.5;
    for (int i = 0; i < static_cast<int>(kApproach * kRate); ++i) {
      const MinJerk at = MinJerk::at(i * kPeriod / kApproach);
      tick({from + at.s * (to - from), at.ds / kApproach * (to - from), at.dds / (kApproach * kApproach) * (to - from)},
           false);
    }
    const bool last = repetition + 1 == kRepetitions;
    const int count = static_cast<int>(duration * kRate);
    for (int i = 0; i < count + static_cast<int>(kHold * kRate); ++i) {
      const double time = std::min(i * kPeriod, duration);
      Reference reference = trajectory.sample(time, cursor);
      reference.time = time;
      if (i >= count) reference.velocity = reference.acceleration = Vec3::Zero();
      tick(reference, last && i < count);
    }
    from = trajectory.sample(duration, cursor).position;
    if (learned != nullptr && learned->take_repetition(log)) {
      (void)learning.learn(log);
      learned->use(&learning.table());
    }
  }
  figures.error = std::sqrt(error2 / ticks);
  figures.ripple = std::sqrt(ripple2 / ticks);
  return figures;
}

/// A path, and a change of the device that the laws do not know.
struct Trial {
  const char* name;
  Path path;
  void (*change)(SimSpec& spec, double stiction);
};

std::vector<Trial> trials() {
  const Path circle = make_shape("circle", {.size = 0.08, .duration = 4});
  static constexpr auto scaled = [](SimSpec& spec, double factor) {
    spec.hand->mass *= factor;
    spec.hand->grip_stiffness *= factor;
    spec.hand->grip_damping *= factor;
  };
  return {{"circle", circle, [](SimSpec&, double) {}},
          {"square", make_shape("square", {.size = 0.1, .duration = 8}), [](SimSpec&, double) {}},
          {"script", make_shape("script", {.size = 0.108, .duration = 6}), [](SimSpec&, double) {}},
          {"circle, nobody", circle, [](SimSpec& spec, double) { spec.hand.reset(); }},
          {"circle, firmer", circle, [](SimSpec& spec, double) { scaled(spec, 4); }},
          {"circle, looser", circle, [](SimSpec& spec, double) { scaled(spec, 0.25); }},
          {"circle, sticks", circle, [](SimSpec& spec, double stiction) { spec.static_ratio = stiction; }}};
}

int run(int draws, std::uint64_t seed) {
  const std::vector<Trial> all_trials = trials();
  // By law, trial and draw.
  std::vector<std::vector<std::vector<Figures>>> all(kLaws.size(),
                                                     std::vector<std::vector<Figures>>(all_trials.size()));
  for (int draw = 0; draw < draws; ++draw) {
    EnsembleDraw drawn;
    Gaussian gaussian(seed, static_cast<std::uint64_t>(draw));
    SplitMix64 bits(seed, 1000 + static_cast<std::uint64_t>(draw));
    // The first held device from here on.
    for (std::uint64_t index = static_cast<std::uint64_t>(draw) * 100; !drawn.spec.hand; ++index)
      drawn = draw_device(seed, index);
    SimSpec& spec = drawn.spec;
    spec.delay = bits.between(1e-3, 2.4e-3);
    spec.actuator_bandwidth_hz = 1 / (2 * std::numbers::pi * kLag);
    const double stiction = std::exchange(spec.static_ratio, 1);
    spec.hand->arm_stiffness = HandModel{}.arm_stiffness;
    spec.hand->arm_damping = HandModel{}.arm_damping;
    spec.hand->arm_relaxation = HandModel{}.arm_relaxation_s;
    const Known known = known_of(spec, gaussian);
    for (std::size_t law = 0; law < kLaws.size(); ++law) {
      std::array<std::optional<LqgLaws>, 3> laws;
      if (kLaws[law] >= Law::quiet) {
        const auto firmness = static_cast<Firmness>(law - static_cast<std::size_t>(Law::quiet));
        const auto found = search_lqg(known.axes, {.firmness = firmness}, StopRequest{});
        for (std::size_t axis = 0; axis < 3; ++axis) {
          laws[axis] = (*found)[axis]->laws;
          for (const std::string& unmet : (*found)[axis]->unmet)
            std::printf("draw %d, %s, axis %zu: %s\n", draw, kNames[law], axis, unmet.c_str());
        }
      }
      for (std::size_t i = 0; i < all_trials.size(); ++i) {
        SimSpec changed = spec;
        all_trials[i].change(changed, stiction);
        const Trajectory trajectory(all_trials[i].path, Interpolation::cubic);
        all[law][i].push_back(played(changed, drawn.noise_seed, known, trajectory, kLaws[law], laws));
      }
    }
    std::fprintf(stderr, "%d of %d\r", draw + 1, draws);
  }
  for (std::size_t i = 0; i < all_trials.size(); ++i)
    for (std::size_t law = 0; law < kLaws.size(); ++law) {
      std::vector<double> errors, ratios, ripples;
      int oscillating = 0;
      for (std::size_t draw = 0; draw < all[law][i].size(); ++draw) {
        const Figures &own = all[law][i][draw], &stiff = all[0][i][draw];
        errors.push_back(1e3 * own.error);
        ratios.push_back(stiff.error / own.error);
        ripples.push_back(own.ripple / stiff.ripple);
        oscillating += own.oscillates;
      }
      const double worst = *std::min_element(ratios.begin(), ratios.end());
      std::printf(
          "%-14s  %-10s  error %.4f mm, %5.1f times below stiff (worst %4.1f), ripple %.2f of stiff, %d oscillate\n",
          all_trials[i].name, kNames[law], median(errors), median(ratios), worst, median(ripples), oscillating);
    }
  return 0;
}

}  // namespace
}  // namespace haptrace

int main(int count, char** arguments) {
  const int draws = count > 1 ? std::atoi(arguments[1]) : 8;
  const std::uint64_t seed = count > 2 ? std::strtoull(arguments[2], nullptr, 10) : 1;
  return haptrace::run(std::max(draws, 1), seed);
}
