#include "player/programme/reach_session.h"

#include "base/error.h"
#include "control/hand_watch.h"
#include "control/pd.h"
#include "devices/loop/servo_loop.h"
#include "player/device_path.h"
#include "player/guidance/guide.h"
#include "player/guidance/live_guidance.h"
#include "player/passivity_defaults.h"
#include "player/supporting_controller.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

constexpr double kPullShare = 0.5;                // of the cautious gains: the pull back is soft
constexpr double kSlowestRise = 1.5;              // of a clamp [s]
constexpr double kStrongestShare = 0.8;           // of the device's peak force
constexpr double kUsualForce = 5;                 // of a device whose peak force is unknown [N]
constexpr double kBeforeBreak = 0.8;              // share of the break-out at which a lock has its largest force
constexpr double kHeldShare = 0.75;               // of the continuous force, with which a lock carries an arm
constexpr double kLongerThanTrial = 2;            // [s]
constexpr double kWorkless = 0.1;                 // share of the energy for a field that does no work
constexpr double kLeastArm = 50, kMostArm = 400;  // stiffness of an arm [N/m]

double largest_force(const DeviceInfo& device, const SessionOptions& session) {
  double force = device.max_force > 0 ? kStrongestShare * device.max_force : kUsualForce;
  if (const double limit = session.loop.limits.max_force; limit > 0) force = std::min(force, kStrongestShare * limit);
  return force;
}

/// Returns the largest damping that is stable on a device whose mass m a force reaches after the time t [N s/m]: b v(t)
/// on a free mass oscillates without end at b = pi m / (2 t), so this is a third of it. A device that is not calibrated
/// counts as light.
double largest_stable_damping(const std::optional<IdentifiedDevice>& identified, double rate_hz, double delay) {
  constexpr double kLightest = 0.06, kEstimate = 2e-3;  // mass [kg], delay of the velocity's estimate [s]
  const double mass = identified ? identified->plant.mass.minCoeff() : kLightest;
  return 0.5 * mass / (delay + 0.5 / rate_hz + kEstimate);
}

/// Returns a channel that is stable on the device, with warnings if it is softer than what was asked for.
ClampOptions stable_clamp(const DeviceInfo& device, const ReachOptions& options, ReachPlan& plan) {
  const double stable = largest_stable_stiffness(options.identified, options.session.loop.rate_hz, plan.forces.delay);
  ClampOptions clamp{.stiffness = options.clamp_stiffness.value_or(stable),
                     .damping = options.clamp_damping,
                     .rise = std::clamp(options.shortest_start_hold, 0.1, kSlowestRise),
                     .break_out = options.break_out};
  if (clamp.stiffness > stable) {
    plan.warnings.push_back(fmt::format("{} is not stable with a clamp of {:.0f} N/m; it is limited to {:.0f} N/m",
                                        device.model, clamp.stiffness, stable));
    clamp.stiffness = stable;
  }
  if (const double most = largest_stable_damping(options.identified, options.session.loop.rate_hz, plan.forces.delay);
      clamp.damping > most) {
    plan.warnings.push_back(fmt::format(
        "{} is not stable with a clamp whose damping is {:.3g} N s/m; it is limited to {:.2g} N s/m{}", device.model,
        clamp.damping, most, options.identified ? "" : "; calibrate the device to allow more"));
    clamp.damping = most;
  }
  return clamp;
}

void plan_clamp(const DeviceInfo& device, const ReachOptions& options, ReachPlan& plan) {
  const ClampOptions clamp = stable_clamp(device, options, plan);
  const auto share = [&](double arm) { return 100 * clamp.stiffness / (clamp.stiffness + arm); };
  plan.notes.push_back(
      fmt::format("an error clamp of {:.0f} N/m shows {:.0f} to {:.0f} % of the true adaptation, for arms of {:.0f} to "
                  "{:.0f} N/m",
                  clamp.stiffness, share(kMostArm), share(kLeastArm), kLeastArm, kMostArm));
  plan.forces.clamp = clamp;
}

/// Plans the lock of a press, or that which carries an arm.
void plan_lock(const DeviceInfo& device, const ReachOptions& options, ReachPlan& plan) {
  ClampOptions lock = stable_clamp(device, options, plan);
  lock.locks = true;
  if (options.trial.goal == ReachGoal::weigh) {
    // The lock holds the arm for the whole trial, with a force that the motors can hold.
    lock.holds = options.course.time_limit + kLongerThanTrial;
    const double continuous = ServoLoop::in_force(device, options.session.loop.limits).max_continuous_force;
    if (continuous > 0) plan.forces.max_force = std::min(plan.forces.max_force, kHeldShare * continuous);
  }
  // The spring has its largest force before it goes off.
  plan.forces.max_force = std::min(plan.forces.max_force, kBeforeBreak * lock.stiffness * lock.break_out);
  plan.trial.largest = plan.forces.max_force;
  plan.notes.push_back(
      fmt::format("the lock has {:.2g} N, at which the hand is {:.0f} mm from its start, and goes off at {:.0f} mm; a "
                  "{} is reported as a lower bound{}",
                  plan.forces.max_force, 1e3 * plan.forces.max_force / lock.stiffness, 1e3 * lock.break_out,
                  options.trial.goal == ReachGoal::press ? "stronger press" : "heavier arm",
                  device.measures_force ? "" : "; without a force sensor, the friction of the device is not included"));
  plan.forces.clamp = lock;
}

/// Returns what a view draws: the circle of the start, the line in the direction of the target, and by the goal its
/// circle, or the whole line on which it moves.
FollowedPath shown_path(const ReachTrial& trial) {
  constexpr int kPoints = 48;
  const ReachGeometry& geometry = trial.geometry;
  FollowedPath followed{.mode = trial.goal == ReachGoal::target ? "reach" : to_string(trial.goal)};
  const Vec3 along = geometry.along();
  const auto add = [&](const Vec3& place) {
    followed.time.push_back(static_cast<double>(followed.time.size()));
    followed.position.push_back(place);
  };
  const auto circle = [&](const Vec3& centre, double radius, double sign) {
    for (int i = 0; i <= kPoints; ++i) {
      const double angle = 2 * std::numbers::pi * i / kPoints;
      add(centre + sign * radius * (std::cos(angle) * along + std::sin(angle) * geometry.lateral));
    }
  };
  if (trial.goal == ReachGoal::track) add(2 * geometry.start - geometry.target);
  circle(geometry.start, geometry.start_radius, 1);
  if (trial.goal == ReachGoal::target)
    circle(geometry.target, geometry.target_radius, -1);
  else
    add(geometry.target);
  return followed;
}

}  // namespace

void check_press(const DeviceInfo& device, const Vec3& direction, bool locked) {
  if (!locked) return check_motors(device, direction.normalized(), "the lock");
  if (!device.measures_force)
    throw input_error(
        fmt::format("{} has no force sensor, so nothing measures a press against a locked handle: remove locked, or "
                    "use a device with a sensor",
                    device.model));
}

ReachPlan plan_reach(const DeviceInfo& device, const ReachOptions& options) {
  const ReachTrial& trial = options.trial;
  ReachPlan plan{.trial = trial, .forces = {}, .notes = {}, .warnings = {}};
  if (trial.goal == ReachGoal::range) plan.trial.workspace = workspace_of(device);
  plan.forces.max_force = largest_force(device, options.session);
  plan.forces.energy = options.energy;
  plan.forces.delay = options.identified ? options.identified->plant.delay : kUnknownDelay;
  plan.forces.rate_hz = options.session.loop.rate_hz;
  const bool clamp = trial.kind == ReachKind::clamp, field = trial.field_acts() && !trial.field.isZero(0);
  if ((clamp || field || options.course.pull) &&
      !(device.force_axes[0] || device.force_axes[1] || device.force_axes[2]))
    throw input_error(
        fmt::format("{} has no motors: remove field, clamps and pull, or use a device with motors", device.model));
  if (is_held(trial.goal)) {
    check_press(device, trial.geometry.along(), options.locked);
    if (!options.locked) plan_lock(device, options, plan);
  }
  if (clamp) plan_clamp(device, options, plan);
  if (!field) return plan;
  plan.forces.field = trial.field;
  // A curl does no work but for the delay, some millijoules in the grip of an arm; what it gives to a light grip is a
  // kick.
  if ((trial.field + trial.field.transpose()).isZero(1e-9)) plan.forces.energy *= kWorkless;
  const double gain = Eigen::JacobiSVD<Eigen::Matrix3d>(trial.field).singularValues()[0];
  plan.notes.push_back(
      fmt::format("the force field of {:.3g} N s/m is limited to {:.2g} N, which it reaches at {:.2g} m/s", gain,
                  plan.forces.max_force, plan.forces.max_force / gain));
  return plan;
}

SessionResult reach(Device& device, const ReachPlan& plan, const ReachOptions& options, const StopRequest& stop,
                    const Progress& progress) {
  const DeviceInfo& info = device.info();
  SessionOptions session = options.session;
  PdGains pull = cautious_gains(info.max_force, session.loop.rate_hz);
  pull.kp *= kPullShare;
  pull.kd *= kPullShare;
  ReachCourse course = options.course;
  course.rate_hz = session.loop.rate_hz;
  ReachController controller(plan.trial, plan.forces, course, pull, hand_watch_of(info.max_force));
  std::vector<SampleSink*> sinks = options.sinks;
  if (options.identified) session.touch.plant = options.identified->plant;
  if (options.live != nullptr) {
    controller.obey(options.live->requests());
    session.touch.rests_in_pause = true;
    attach(*options.live, info, session, sinks);
  }
  // An arm that rests on the lock must not drop, however the trial ends.
  if (plan.trial.goal == ReachGoal::weigh)
    session.loop.limits.release = std::max(session.loop.limits.release, kSupportedRelease);
  if (session.observer != nullptr) session.followed = shown_path(plan.trial);
  return run_session(device, controller, {.reference = true}, sinks, session, stop, progress);
}

}  // namespace haptrace
