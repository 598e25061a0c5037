#include "player/playback/playback.h"

#include "base/enum_names.h"
#include "base/error.h"
#include "base/json_reader.h"
#include "control/feedforward.h"
#include "control/hand_watch.h"
#include "control/iterative_learning.h"
#include "control/lqg_law.h"
#include "control/observer_pd.h"
#include "control/oscillation_monitor.h"
#include "control/path/trajectory.h"
#include "control/pd.h"
#include "control/stand_in_law.h"
#include "devices/loop/servo_loop.h"
#include "formats/path/path_thinning.h"
#include "player/device_path.h"
#include "player/motor_limit.h"
#include "player/playback/learning.h"
#include "player/playback/playback_controller.h"
#include "player/playback/reference_stream.h"
#include "player/playback/speed_limit.h"
#include "player/playback/tracking_guard.h"
#include "player/playback/tracking_metrics.h"
#include "player/tuning/live_session.h"
#include "player/tuning/live_tuning.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <functional>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>

namespace haptrace {
namespace {

constexpr EnumNames<TrackingLaw, 2> kTrackingLaws{"law", {"observer", "lqg"}};

constexpr double kSoftenedLaw = 0.09;  // share of a law after two steps of ReactionLadder
constexpr double kWindow = 0.01;       // window of speed estimates, so that one noisy sample does not count [s]

/// Peak speed and excursion of a trajectory between the samples of its path.
struct Excursion {
  double peak_speed = 0;  ///< [m/s]
  double outside = 0;     ///< largest distance outside the workspace [m]

  void include(const Excursion& other) {
    peak_speed = std::max(peak_speed, other.peak_speed);
    outside = std::max(outside, other.outside);
  }
};

Excursion look_ahead(const TrajectoryPiece& piece, const Box& workspace) {
  Trajectory::Cursor cursor;
  Excursion excursion;
  Vec3 before = piece.trajectory.sample(piece.begin, cursor).position;
  for (double t = piece.begin + kWindow; t < piece.end + kWindow; t += kWindow) {
    const Vec3 now = piece.trajectory.sample(t, cursor).position;
    excursion.peak_speed = std::max(excursion.peak_speed, (now - before).norm() / kWindow);
    excursion.outside = std::max(excursion.outside, distance_outside(now, workspace));
    before = now;
  }
  return excursion;
}

/// Returns true when the bounds of a block alone show that the curve through it stays in the workspace and below
/// `limit` [m/s]. The slopes of a spline are at most three times its steepest chord (they solve a diagonally dominant
/// system), so the curve leaves a chord by no more than the chord's length. Samples closer than the window are judged
/// over a whole window.
bool cleared(const PathBlock& block, Interpolation interpolation, const Box& workspace, double limit) {
  double reach = 0, faster = 1;
  if (interpolation == Interpolation::hold) {
    faster = std::max(1.0, block.longest_interval / kWindow);
  } else if (interpolation != Interpolation::linear) {
    reach = std::max(block.longest_interval, kWindow) * block.peak_speed;
    if (block.longest_interval > 1.5 * kWindow) faster = 3;
  }
  return (block.bounds.min.array() - reach >= workspace.min.array()).all() &&
         (block.bounds.max.array() + reach <= workspace.max.array()).all() && faster * block.peak_speed <= limit;
}

/// Returns the excursion of the whole path. Uses the bounds of a block where they are conclusive, else its curve.
Excursion look_ahead(const TrajectoryPieces& pieces, Interpolation interpolation, const Box& workspace, double limit) {
  Excursion excursion = look_ahead(*pieces.first(), workspace);
  if (pieces.count() == 1) return excursion;
  for (const PathBlock& block : pieces.source().blocks()) {
    if (cleared(block, interpolation, workspace, limit)) {
      excursion.include({.peak_speed = block.peak_speed});
    } else {
      const std::uint64_t last = std::min(block.first + block.rows, pieces.source().facts().rows - 1);
      if (last > block.first) excursion.include(look_ahead(pieces.through(block.first, last), workspace));
    }
  }
  return excursion;
}

/// Returns a check for the pieces that the plan did not examine.
ReferenceStream::Check check_of(const DeviceInfo& device, const PlayPlan& plan, const PlayOptions& options) {
  const double limit = options.session.loop.limits.max_velocity;
  return [name = plan.path->source().facts().name, model = device.model, workspace = workspace_of(device), limit,
          speed = options.playback.speed](const TrajectoryPiece& piece) {
    const Excursion excursion = look_ahead(piece, workspace);
    if (excursion.outside > 0)
      throw Error(Error::Kind::fault, fmt::format("{} leaves the workspace of {} by {:.1f} mm between its samples",
                                                  name, model, 1e3 * excursion.outside));
    if (limit > 0 && speed * excursion.peak_speed > limit)
      throw Error(Error::Kind::fault,
                  fmt::format("{} moves at up to {:.2f} m/s, above the velocity limit of {:.2f} m/s", name,
                              speed * excursion.peak_speed, limit));
  };
}

IterativeLearning::Options learning_of(const PlayPlan& plan, const PlayOptions& options) {
  IterativeLearning::Options learning{.mass = options.identified->design.mass,
                                      .delay = options.identified->design.delay,
                                      .rate_hz = options.session.loop.rate_hz,
                                      .speed = options.playback.speed,
                                      .duration = plan.path->duration()};
  if (plan.lqg) {
    learning.mass = options.identified->plant.mass;
    learning.inertia = options.identified->held->inertia;
    learning.cutoff_hz = kMostLearning;
    for (const auto& laws : *plan.lqg)
      if (laws) learning.cutoff_hz = std::min(learning.cutoff_hz, laws->learning_hz);
  }
  return learning;
}

/// Returns no guard for a device with unknown largest force: the guard judges forces relative to it.
std::optional<TrackingGuard::Options> guard_of(const DeviceInfo& device, const PlayOptions& options) {
  if (!options.guard || !(device.max_force > 0)) return std::nullopt;
  TrackingGuard::Options guard{.oscillation = std::nullopt, .hand = hand_watch_of(device.max_force)};
  OscillationMonitorOptions oscillation{.rate_hz = options.session.loop.rate_hz,
                                        .max_force = device.max_force,
                                        .delay = 1 / options.session.loop.rate_hz,
                                        .position_resolution = device.position_resolution};
  if (options.identified) {
    const PlantModel& plant = options.identified->plant;
    oscillation.delay = plant.delay;
    oscillation.position_resolution = std::max(plant.position_resolution, device.position_resolution);
    double lightest = std::numeric_limits<double>::infinity();
    for (const double mass : plant.mass)
      if (mass > 0) lightest = std::min(lightest, mass);
    oscillation.mass = lightest;
    guard.hand.needed = plant.coulomb.norm() + plant.gravity.norm();
  }
  if (!options.watch_release) guard.hand.held = HandWatchOptions::kNever;
  if (options.find_oscillations) guard.oscillation = oscillation;
  return guard;
}

/// Returns the load along the path according to the model, as the starting point of learning.
ForceTable load_along(const PlayPlan& plan, const PlayOptions& options) {
  GravityFeedforward gravity(options.identified->plant);
  FrictionFeedforward friction(options.identified->plant);
  const double speed = options.playback.speed, step = 0.004 * speed;
  const Tuning tuning{.gravity = options.compensations.gravity ? 1.0 : 0.0,
                      .friction = options.compensations.friction ? 1.0 : 0.0};
  const State state;
  ForceTable table{.step = step, .force = {}};
  double t = 0;
  for (std::size_t i = 0; i < plan.path->count(); ++i) {
    const TrajectoryPiece piece = plan.path->make(i);
    Trajectory::Cursor cursor;
    const bool last = i + 1 == plan.path->count();
    for (; last ? t < piece.end + step : t < piece.end; t = step * static_cast<double>(table.force.size())) {
      Reference reference = piece.trajectory.sample(t, cursor);
      reference.velocity *= speed;
      const TermInput input{state, reference, tuning};
      table.force.push_back(gravity.force(input) + friction.force(input));
    }
  }
  return table;
}

/// Returns the gains of plain PD control that stands in for a law with gains `own` if that vibrates: if the device bore
/// them in the trials of its calibration, and they are not softer than the law is once softened. If the operator chose
/// the gains, nothing stands in for them.
std::optional<PdGains> stand_in_for(const PdGains& own, const PlayOptions& options) {
  const TrackingDesign& design = options.identified->design;
  const PdGains& plain = design.plain;
  const bool firm = (plain.kp.array() >= kSoftenedLaw * own.kp.array()).all();
  if (!design.plain_calm || !firm || options.gains || options.impedance) return std::nullopt;
  return plain;
}

/// Returns true if plain PD control was chosen for the device, which was less accurate with the model's feedforward.
bool goes_bare(const Compensations& composed, const PlayOptions& options) {
  return !composed.observer && options.compensations.observer && !options.gains && !options.impedance &&
         options.identified->design.plain_bare;
}

std::unique_ptr<ForceTerm> with_stand_in(std::unique_ptr<ForceTerm> law, const PdGains& own, const PlayPlan& plan) {
  if (!plan.stand_in) return law;
  return std::make_unique<StandInLaw>(std::move(law), own, *plan.stand_in);
}

/// Creates the terms of the law. Each term receives the sum of those before it, hence the order: known load, feedback,
/// inertia; an LQG law comes last.
ForceTerms compose(const DeviceInfo& device, const PlayPlan& plan, const PlayOptions& options,
                   LearningTerm*& learning) {
  const Compensations& with = plan.composed;
  ForceTerms terms;
  if (with.gravity) terms.push_back(std::make_unique<GravityFeedforward>(options.identified->plant));
  if (with.friction) terms.push_back(std::make_unique<FrictionFeedforward>(options.identified->plant));
  if (with.cogging) {
    const PlantModel& plant = options.identified->plant;
    const double lead = plant.delay + 0.5 / options.session.loop.rate_hz;
    terms.push_back(std::make_unique<CoggingFeedforward>(*plant.cogging, lead));
  }
  if (with.learning) {
    const bool from_before = !options.learned.force.empty();
    auto term = std::make_unique<LearningTerm>(LearningTerm::Options{.law = learning_of(plan, options),
                                                                     .known = from_before ? options.learned
                                                                              : goes_bare(with, options)
                                                                                  ? ForceTable{}
                                                                                  : load_along(plan, options),
                                                                     .known_counts = from_before ? 1 : 0,
                                                                     .repetitions = options.learn});
    learning = term.get();
    terms.push_back(std::move(term));
  }
  const auto resolution = [&] {
    return std::max(options.identified->plant.position_resolution, device.position_resolution);
  };
  if (plan.lqg) {  // which takes all that comes before it for feedforward
    const auto& inertia = options.identified->held->inertia;
    if (with.inertia) terms.push_back(std::make_unique<InertiaFeedforward>(options.identified->plant.mass, inertia));
    auto law = std::make_unique<LqgLaw>(LqgLaw::Options{.axes = *plan.lqg,
                                                        .position_resolution = resolution(),
                                                        .authority = options.identified->design.authority,
                                                        .inertia = inertia,
                                                        .designed_for = options.identified->held->designed_for});
    terms.push_back(with_stand_in(std::move(law), gains_of(*plan.lqg), plan));
    return terms;
  }
  if (with.observer) {
    auto law = std::make_unique<ObserverPd>(ObserverPd::Options{.design = options.identified->design,
                                                                .rate_hz = options.session.loop.rate_hz,
                                                                .position_resolution = resolution()});
    terms.push_back(with_stand_in(std::move(law), options.identified->design.gains, plan));
  } else {
    terms.push_back(std::make_unique<PdLaw>());
  }
  if (with.inertia) terms.push_back(std::make_unique<InertiaFeedforward>(options.identified->design.mass));
  return terms;
}

/// Decides whether and how the playback follows the path's orientations. Adds a note with the reason if the device
/// takes torque but the playback cannot follow them.
void plan_turn(const DeviceInfo& device, const PathFacts& path, const PlayOptions& options, PlayPlan& plan) {
  const TurnOptions& turn = options.turn;
  check_range("the deviation limit of the orientation", turn.max_deviation, 0.01, 3, "rad");
  if (turn.gains) {
    check_range("the gain of the orientation (kp-rotation)", turn.gains->kp, 0, kLargestKp, "N m/rad");
    check_range("the gain of the orientation (kd-rotation)", turn.gains->kd, 0, kLargestKd, "N m s/rad");
  }
  if (turn.off || !path.orientation || !device.takes_torque()) return;
  const auto refuse = [&](const std::string& why) {
    plan.notes.push_back(fmt::format("the path's orientations are not followed: {}", why));
  };
  if (!device.measures_orientation) return refuse(fmt::format("{} does not measure orientation", device.model));
  if (std::find(device.torque_axes.begin(), device.torque_axes.end(), false) != device.torque_axes.end())
    return refuse(fmt::format("{} has no motor about some of its axes", device.model));
  const double own = device.max_torque, asked = options.session.loop.limits.max_torque;
  const double most = own > 0 && asked > 0 ? std::min(own, asked) : std::max(own, asked);
  if (!(most > 0))
    return refuse(fmt::format("{} does not state its largest torque; give it with --max-torque", device.model));
  plan.turn = OrientationOptions{.gains = turn.gains.value_or(cautious_orientation_gains(most)),
                                 .max_deviation = turn.max_deviation,
                                 .rate_hz = options.session.loop.rate_hz};
}

/// Returns the gains along the path as it will be played.
GainTable schedule_of(const PlayPlan& plan, const ImpedanceProfile& profile) {
  GainTable table{.step = kWindow, .gains = {}};
  double t = 0, length = 0;
  std::optional<Vec3> before;
  for (std::size_t i = 0; i < plan.path->count(); ++i) {
    const TrajectoryPiece piece = plan.path->make(i);
    Trajectory::Cursor cursor;
    const bool last = i + 1 == plan.path->count();
    for (; last ? t < piece.end + table.step : t < piece.end;
         t = table.step * static_cast<double>(table.gains.size())) {
      const Vec3 position = piece.trajectory.sample(t, cursor).position;
      if (before) length += (position - *before).norm();
      before = position;
      table.gains.push_back(profile.gains_at(profile.by_place ? length : plan.stretch.before(t)));
    }
  }
  return table;
}

/// The law of a playback of an identified device.
struct ChosenLaw {
  bool observer = true;         ///< the load is cancelled; else plain PD control
  std::optional<Firmness> lqg;  ///< by an LQG law of this firmness
  std::vector<std::string> notes{};
};

/// Says of a law that it was refused, where, and why.
std::string refusal_text(const std::string& law, const LawVerdict& verdict) {
  return fmt::format("in {}, {} was refused: {}",
                     verdict.since.empty() ? "the trial of the calibration" : "a playback at " + verdict.since, law,
                     verdict.refused);
}

}  // namespace

std::string stiff_text(const TrackingDesign& design) {
  if (!(design.stiff_error > 0 && design.stiff_error < 1)) return {};
  const PdGains stiff = stiff_gains();
  return fmt::format(
      "in the trials of the calibration, before any learning, stiff PD control (--kp {:.0f} --kd {:.0f}) was {:.1f} "
      "times closer than the law that playbacks choose, but its force vibrated with {:.2f} N rms",
      stiff.kp.x(), stiff.kd.x(), 1 / design.stiff_error, design.stiff_ripple);
}

namespace {

/// Chooses among the laws of a device's profile: what the options ask for, or the first that was not refused.
ChosenLaw chosen_law(const PlayOptions& options) {
  const auto& held = options.identified->held;
  const LawVerdict& of_observer = options.identified->design.verdict;
  if (!options.compensations.observer || options.gains || options.impedance) return {};
  const auto name_of = [](Firmness firmness) { return fmt::format("the LQG law of firmness {}", to_string(firmness)); };
  constexpr const char* kObserver = "the law with an observer";
  ChosenLaw chosen;
  if (options.law || options.firmness) {
    const bool lqg = held && options.law.value_or(TrackingLaw::lqg) == TrackingLaw::lqg;
    const Firmness firmness = options.firmness.value_or(Firmness::normal);
    if (lqg) chosen.lqg = firmness;
    const LawVerdict& verdict = lqg ? held->design(firmness).verdict : of_observer;
    if (!verdict.refused.empty()) chosen.notes.push_back(refusal_text(lqg ? name_of(firmness) : kObserver, verdict));
    return chosen;
  }
  if (const std::string closer = stiff_text(options.identified->design); !closer.empty())
    chosen.notes.push_back(closer);
  bool vibrated = false;
  if (held) {
    for (const Firmness firmness : {Firmness::normal, Firmness::quiet}) {
      const LawVerdict& verdict = held->design(firmness).verdict;
      if (verdict.refused.empty() && (verdict.tried || firmness == Firmness::normal)) {
        chosen.lqg = firmness;
        return chosen;
      }
      if (!verdict.refused.empty()) chosen.notes.push_back(refusal_text(name_of(firmness), verdict));
    }
    vibrated = !held->design(Firmness::normal).verdict.since.empty();
  }
  // A law that nothing has tried is no remedy for one that vibrated.
  chosen.observer = of_observer.refused.empty() && (of_observer.tried || !vibrated);
  if (!chosen.observer) {
    if (!of_observer.refused.empty()) chosen.notes.push_back(refusal_text(kObserver, of_observer));
    chosen.notes.emplace_back("this playback therefore uses plain PD control");
  }
  return chosen;
}

bool follows_orientation(const DeviceInfo& device, const PlayOptions& options) {
  return !options.turn.off && device.takes_torque() && device.measures_orientation;
}

PlaybackController controller_of(const DeviceInfo& device, const PlayPlan& plan, const PlayOptions& options,
                                 LearningTerm*& learning) {
  PlaybackOptions playback = options.playback;
  const double asked = options.session.loop.limits.max_force;
  playback.softened_force = asked > 0 ? asked : device.max_force;
  playback.rate_hz = options.session.loop.rate_hz;
  playback.axes = device.force_axes;
  PlaybackController controller({*plan.path, check_of(device, plan, options), playback.speed},
                                compose(device, plan, options, learning), plan.tuning, playback,
                                options.tuning != nullptr ? &options.tuning->mailbox() : nullptr);
  if (const auto guard = guard_of(device, options)) controller.guard(*guard);
  if (plan.turn) controller.turn(*plan.turn);
  if (plan.schedule) controller.schedule(*plan.schedule);
  return controller;
}

/// Stretches the time of the plan's path so that the playback stays below `fastest` [m/s]. Leaves the plan as it is if
/// that takes more than kMostStretch. `trajectory` makes the trajectory of `source` and of other sources.
template <class MakeTrajectory>
void keep_below(double fastest, const Box& workspace, const PlayOptions& options,
                const std::shared_ptr<const PathSource>& source, const MakeTrajectory& trajectory, PlayPlan& plan) {
  constexpr double kRamp = 0.1;  // in which the reference slows down or speeds up [s]
  const double speed = options.playback.speed;
  // The curve through the stretched samples is another one, and may be faster between them.
  for (const double share : {0.99, 0.96, 0.9}) {
    TimeStretch stretch = stretch_below(*plan.path, share * fastest / speed, kRamp * speed);
    const auto places = stretch.places();
    if (std::any_of(places.begin(), places.end(), [](const auto& place) { return place.factor > kMostStretch; }))
      return;
    const auto path = trajectory(stretched(source, stretch));
    const Excursion excursion = look_ahead(*path, options.interpolation, workspace, fastest / speed);
    if (excursion.outside > 0 || speed * excursion.peak_speed > fastest) continue;
    plan.notes.push_back(fmt::format(
        "{} would move at up to {:.2f} m/s; to stay below {:.2f} m/s, 0.9 of the velocity limit, its time is stretched "
        "{}; it lasts {:.2f} s instead of {:.2f} s",
        path->source().facts().name, plan.peak_speed, fastest, describe(stretch), path->duration() / speed,
        plan.path->duration() / speed));
    plan.peak_speed = speed * excursion.peak_speed;
    plan.path = path;
    plan.stretch = std::move(stretch);
    return;
  }
}

/// Notes that the motors will get too warm for the plan, if its law takes as much force as in its trial.
void foresee_heat(const DeviceInfo& device, const PlayOptions& options, PlayPlan& plan) {
  if (!plan.lqg && !plan.composed.observer) return;
  const IdentifiedDevice& identified = *options.identified;
  const LawVerdict& trial = plan.lqg ? identified.held->design(plan.firmness).verdict : identified.design.verdict;
  const int repetitions = options.playback.repetitions;
  const double duration = repetitions > 0 ? repetitions * plan.path->duration() / options.playback.speed
                                          : std::numeric_limits<double>::infinity();
  if (std::string heat = heat_foreseen(device, options.session.loop, trial.force, duration); !heat.empty())
    plan.notes.push_back(std::move(heat));
}

/// The law of a playback with its gains and terms.
struct PlannedLaw {
  Tuning tuning;
  Compensations composed;
  std::optional<std::array<std::optional<LqgLaws>, 3>> lqg;
  std::optional<PdGains> stand_in;
  Firmness firmness = Firmness::normal;
  std::vector<std::string> notes;
};

/// Returns the law that the options and the device's profile choose, with its own gains.
PlannedLaw planned_law(const DeviceInfo& device, const PlayOptions& options) {
  PlannedLaw planned;
  if (!options.identified) {
    planned.tuning.gains = cautious_gains(device.max_force, options.session.loop.rate_hz);
    return planned;
  }
  planned.tuning.gains = options.identified->design.gains;
  planned.tuning.observer_hz = options.identified->design.load_hz;
  Compensations& composed = planned.composed;
  composed = options.compensations;
  composed.learning = composed.learning && (options.learn > 0 || !options.learned.force.empty());
  composed.cogging = composed.cogging && options.identified->plant.cogging;
  // Learning covers the whole load and starts from the model's estimate of it. Cogging is too fast for it.
  if (composed.learning) composed.gravity = composed.friction = false;
  ChosenLaw law = chosen_law(options);
  planned.notes = std::move(law.notes);
  composed.observer = composed.observer && law.observer;
  if (!composed.observer) planned.tuning.gains = options.identified->design.plain;
  if (goes_bare(composed, options)) {
    planned.notes.emplace_back(
        "in the trial, plain PD control was less accurate with the feedforward of the model: it goes without");
    composed.gravity = composed.friction = composed.cogging = false;
    composed.inertia = composed.inertia && composed.learning;  // which learns the load beside it
  }
  if (law.lqg) {
    planned.lqg = lqg_laws(*options.identified->held, *law.lqg, options.session.loop.rate_hz);
    planned.firmness = *law.lqg;
    planned.tuning.gains = gains_of(*planned.lqg);
  }
  if (composed.observer) planned.stand_in = stand_in_for(planned.tuning.gains, options);
  return planned;
}

/// Throws Error(input) if the options ask for what this device, or the scene, does not allow, or contradict each other.
void check_requests(const DeviceInfo& device, const PlayOptions& options, const Compensations& composed) {
  check_range("the number of repetitions to learn from (learn)", options.learn, 0, kMostLearned);
  if (options.learn > 0 && !composed.learning)
    throw input_error(options.identified
                          ? "the options both request learning and switch it off; remove one of them"
                          : fmt::format("{} must be calibrated before it can learn: haptrace calibrate --device {}",
                                        device.model, device.name));
  if (options.learn > 0 && options.session.touch.scene)
    throw input_error(
        "a scene's objects hold the tool off the path, and the force that it needs there is not the load along the "
        "path: use --learn without --scene. Later sessions with the scene then use the learned force");
  if (options.gains && options.impedance)
    throw input_error("the gains are given both for the whole path and along it; remove one of them");
}

}  // namespace

const char* to_string(TrackingLaw law) noexcept {
  return kTrackingLaws.name(law);
}

TrackingLaw parse_tracking_law(std::string_view name) {
  return kTrackingLaws.parse(name);
}

PlayPlan plan_playback(const DeviceInfo& device, std::shared_ptr<const PathSource> path, const PlayOptions& options) {
  validate(options.playback);
  PlannedLaw law = planned_law(device, options);
  check_requests(device, options, law.composed);
  if (options.gains) law.tuning.gains = *options.gains;
  validate(law.tuning.gains);

  const Box workspace = workspace_of(device);
  const DevicePath played = path_for(device, thinned(std::move(path), options.thin), options.fit);
  const std::string name = played.source->facts().name;

  const auto trajectory = [&](std::shared_ptr<const PathSource> source) {
    return std::make_shared<const TrajectoryPieces>(
        std::move(source), options.interpolation,
        TrajectoryPieces::Options{.smoothing = options.smoothing, .orientation = follows_orientation(device, options)});
  };
  PlayPlan plan{.path = trajectory(played.source),
                .fit = played.fit,
                .stretch = {},
                .tuning = law.tuning,
                .schedule = {},
                .composed = law.composed,
                .lqg = std::move(law.lqg),
                .stand_in = law.stand_in,
                .firmness = law.firmness,
                .turn = {},
                .notes = std::move(law.notes)};
  if (played.fit && options.session.touch.scene) plan.notes.emplace_back(kFitMovesNoScene);
  plan_turn(device, played.source->facts(), options, plan);
  const double limit = options.session.loop.limits.max_velocity, speed = options.playback.speed;
  const double fastest = limit > 0 ? 0.9 * limit : std::numeric_limits<double>::infinity();
  const Excursion excursion = look_ahead(*plan.path, options.interpolation, workspace, fastest / speed);
  if (excursion.outside > 0)
    throw input_error(fmt::format(
        "{} leaves the workspace of {} by {:.1f} mm between its samples, where they are far apart; use --interpolation "
        "linear",
        name, device.model, 1e3 * excursion.outside));
  plan.peak_speed = speed * excursion.peak_speed;
  if (plan.peak_speed > fastest && options.interpolation != Interpolation::hold)
    keep_below(fastest, workspace, options, played.source, trajectory, plan);
  if (options.impedance) {
    plan.schedule = schedule_of(plan, *options.impedance);
    plan.tuning.gains = plan.schedule->largest();
    validate(plan.tuning.gains);
  }
  if (plan.composed.learning) (void)IterativeLearning(learning_of(plan, options));  // throws when it is too long
  foresee_heat(device, options, plan);
  if (plan.peak_speed > fastest)
    throw input_error(fmt::format(
        "{} moves at up to {:.2f} m/s, too close to the velocity limit of {:.2f} m/s; play it slower (--speed "
        "{:.2f}) or raise --max-velocity",
        name, plan.peak_speed, limit, std::floor(100 * speed * fastest / plan.peak_speed) / 100));
  return plan;
}

FollowedPath followed_path(const TrajectoryPieces& pieces) {
  FollowedPath followed;
  const PathSource& source = pieces.source();
  const auto points =
      static_cast<std::size_t>(std::min<std::uint64_t>(source.facts().rows, FollowedPath::kMostPathPoints));
  Trajectory::Cursor cursor;
  for (std::size_t i = 0; i < points; ++i) {
    if (pieces.count() == 1) {
      const double share = points > 1 ? static_cast<double>(i) / static_cast<double>(points - 1) : 0;
      followed.time.push_back(share * pieces.duration());
      followed.position.push_back(pieces.first()->trajectory.sample(followed.time.back(), cursor).position);
      continue;
    }
    // Only rows: the curve between them would cost a piece of the path for every point.
    const Path row = source.read(i * (source.facts().rows - 1) / (points - 1), 1);
    followed.time.push_back(row.time.front() - source.facts().begin);
    followed.position.push_back(row.position.front());
  }
  return followed;
}

PlayPlan plan_playback(const DeviceInfo& device, Path path, const PlayOptions& options) {
  return plan_playback(device, source_of(std::move(path)), options);
}

PlaybackController playback_controller(const DeviceInfo& device, const PlayPlan& plan, const PlayOptions& options) {
  LearningTerm* learning = nullptr;
  return controller_of(device, plan, options, learning);
}

PlayResult play(Device& device, const PlayPlan& plan, const PlayOptions& options, const StopRequest& stop,
                const Progress& progress) {
  ServoLoop::validate(device.info(), {.rate_hz = options.session.loop.rate_hz,
                                      .limits = options.session.loop.limits,
                                      .away_timeout = options.session.loop.away_timeout});
  LearningTerm* learning = nullptr;
  PlaybackController controller = controller_of(device.info(), plan, options, learning);

  LiveSession* live = options.tuning != nullptr ? options.tuning : options.live;
  TrackingMetrics metrics(
      options.session.loop.rate_hz,
      static_cast<std::size_t>(options.playback.repetitions + (live != nullptr ? LiveSession::kMostRepeats : 0)));
  std::vector<SampleSink*> sinks = options.sinks;
  sinks.push_back(&metrics);
  SessionOptions session_options = options.session;
  session_options.loop.watch_vibration &= options.guard;
  if (session_options.observer != nullptr) session_options.followed = followed_path(*plan.path);
  if (options.identified) session_options.touch.plant = options.identified->plant;
  // Not for gains that nothing has tried.
  if (options.identified && !options.gains && !options.impedance) {
    double& tremor = session_options.loop.tremor;
    tremor = std::max(tremor, options.identified->design.tremor);
    if (const auto& held = options.identified->held) tremor = std::max(tremor, answer_to_tremor(held->model));
  }
  if (live != nullptr) {
    controller.obey(live->requests());
    attach(*live, device.info(), session_options, sinks);
  }
  SessionResult session = run_session(
      device, controller, {.reference = true, .reference_orientation = plan.turn.has_value(), .gains = true}, sinks,
      session_options, stop, progress);
  if (session.servo.cause == StopCause::no_path) session.servo.detail += ": " + controller.path().error();
  PlayResult result{.session = std::move(session),
                    .plan = plan,
                    .repetitions = metrics.repetitions(),
                    .last = metrics.last(),
                    .tuning = options.tuning != nullptr ? options.tuning->wanted() : plan.tuning};
  result.stood_in = metrics.renewed_after();
  if (learning != nullptr) {
    learning->finish();
    result.lessons = learning->lessons();
    result.learned = learning->table();
  }
  return result;
}

PdGains PlayResult::gains_in_force() const {
  const auto shared = [this](const Vec3& tuned, const Vec3& own, const Vec3& stand_in) -> Vec3 {
    if (!stood_in) return session.gain_share * tuned;
    const Vec3 ratio = (own.array() > 0).select(tuned.cwiseQuotient(own), Vec3::Zero());
    return session.gain_share * ratio.cwiseProduct(stand_in);
  };
  const PdGains& own = plan.tuning.gains;
  const PdGains other = plan.stand_in.value_or(PdGains{Vec3::Zero(), Vec3::Zero()});
  return {shared(tuning.gains.kp, own.kp, other.kp), shared(tuning.gains.kd, own.kd, other.kd)};
}

std::string refuse_vibrated(const PlayResult& result, const PlayOptions& options, const std::string& now,
                            IdentifiedDevice& device) {
  const VibrationSummary& vibration = result.session.servo.vibration;
  const auto steps = [&](VibrationRule rule) { return vibration.steps[static_cast<std::size_t>(rule)]; };
  const bool own = result.plan.lqg || result.plan.composed.observer,
             changed = options.gains || options.impedance || (options.tuning != nullptr && options.tuning->changed());
  if (!own || changed || options.session.touch.scene ||
      steps(VibrationRule::energy) + steps(VibrationRule::half_cycles) == 0)
    return "";
  LawVerdict& verdict = result.plan.lqg ? device.held->design(result.plan.firmness).verdict : device.design.verdict;
  if (!verdict.refused.empty()) return "";
  const std::string done = fmt::format("vibrated at {:.0f} Hz", vibration.frequency_hz);
  verdict.refused = "it " + done;
  verdict.since = now;
  return fmt::format(
      "the law {}, and the profile refuses it from now on. If the device or the hand was not as in the calibration, "
      "calibrate again",
      done);
}

nlohmann::json to_json(const PdGains& gains) {
  return {{"kp", json_of(gains.kp)}, {"kd", json_of(gains.kd)}};
}

PdGains gains_from_json(const nlohmann::json& json, const std::string& where) {
  JsonReader reader(json, where);
  for (const char* key : {"kp", "kd"})
    if (!reader.has(key)) throw input_error(fmt::format("{}: gains need '{}'", where, key));
  PdGains gains{reader.vector("kp", Vec3::Zero(), 0, kLargestKp), reader.vector("kd", Vec3::Zero(), 0, kLargestKd)};
  reader.finish();
  return gains;
}

nlohmann::json to_json(const PlayResult& result) {
  nlohmann::json json = to_json(result.session);
  // The top level holds the metrics of the last repetition, `repetitions` those of each; max_force_n is the session's.
  json["rms_error_m"] = result.last.rms_error;
  json["peak_error_m"] = result.last.peak_error;
  json["force_ripple_n"] = result.last.force_ripple;
  json["repetitions"] = nlohmann::json::array();
  for (const TrackingFigures& figures : result.repetitions) json["repetitions"].push_back(to_json(figures));
  if (std::isfinite(result.last.rms_rotation_error)) {
    json["rms_rotation_error_rad"] = result.last.rms_rotation_error;
    json["peak_rotation_error_rad"] = result.last.peak_rotation_error;
  }
  const PlayPlan& plan = result.plan;
  json["law"] = plan.lqg                 ? to_string(TrackingLaw::lqg)
                : plan.composed.observer ? to_string(TrackingLaw::observer)
                                         : "pd";
  if (plan.lqg) json["firmness"] = to_string(plan.firmness);
  if (result.stood_in) json["pd_after_repetitions"] = *result.stood_in;
  json["gains"] = to_json(plan.tuning.gains);
  if (result.plan.turn)
    json["orientation_gains"] = {{"kp", result.plan.turn->gains.kp}, {"kd", result.plan.turn->gains.kd}};
  json["gains_in_force"] = to_json(result.gains_in_force());
  json["compensations"] = names_of(result.plan.composed);
  if (!result.lessons.empty()) {
    json["learning"] = nlohmann::json::array();
    for (const Lesson& lesson : result.lessons)
      json["learning"].push_back({{"outcome", to_string(lesson.outcome)}, {"rms_error_m", lesson.rms_error}});
  }
  if (!result.plan.stretch.is_identity()) {
    json["stretched"] = nlohmann::json::array();
    for (const TimeStretch::Place& place : result.plan.stretch.places())
      json["stretched"].push_back({{"from_s", place.begin}, {"to_s", place.end}, {"factor", place.factor}});
  }
  json["path_smoothing_s"] = result.plan.path->smoothing();
  json["peak_speed_m_per_s"] = result.plan.peak_speed;
  if (result.plan.fit)
    json["fit"] = {{"scale", result.plan.fit->scale}, {"offset_m", json_of(result.plan.fit->offset)}};
  return json;
}

}  // namespace haptrace
