#include "player/programme/reach_controller.h"

#include "base/error.h"
#include "control/norm.h"
#include "control/pd.h"
#include "control/resistance_timer.h"

#include <algorithm>
#include <fmt/format.h>
#include <utility>

namespace haptrace {
namespace {

constexpr double kLongestReachStep = 5;  // most that one tick counts [ticks]
constexpr double kFarthestReach = 10;    // [m]
constexpr double kQuiet = 0.5,
                 kQuietShare = 0.2;  // force of the lock on a hand that waits [N], and share of its largest
constexpr double kCarries = 0.9;     // share of the break-out within which a lock carries an arm
constexpr double kTankIsLow = 0.5;   // share of the field below which the tank counts as empty

}  // namespace

ReachController::ReachController(const ReachTrial& trial, const ReachForces::Options& forces, const ReachCourse& course,
                                 const PdGains& pull, const HandWatchOptions& hand)
    : geometry_(trial.geometry),
      goal_(trial.goal),
      track_(trial.track),
      forces_(trial.geometry, forces),
      course_(course),
      pull_gains_(pull),
      hand_(hand),
      phases_(1, is_held(goal_) ? std::max(course.hold, ReachForces::kDecay) : course.hold, course.approach_speed) {
  validate(pull);
  check_range("the hold in the start", course.start_hold, 0, 60, "s");
  check_range("the hold in the target", course.target_hold, 0, 60, "s");
  check_range("the time limit of a reach", course.time_limit, 0.1, 1e5, "s");
  check_range("the pause after a reach", course.hold, 0, 3600, "s");
  check_range("the speed of the approach", course.approach_speed, 1e-3, 10, "m/s");
  check_range("the largest deviation", course.max_deviation, 1e-3, 100, "m");
  if (goal_ == ReachGoal::track && (track_.frequency.empty() || track_.frequency.size() != track_.phase.size()))
    throw input_error("the movement of the target needs at least one sine, and a phase for each");
  if (goal_ != ReachGoal::target) return;
  if (const std::string why = too_near(geometry_.distance(), geometry_.start_radius, geometry_.target_radius);
      !why.empty())
    throw input_error(fmt::format("a target {}; move it, or make the radii smaller", why));
}

void ReachController::start(const State& first) noexcept {
  requests_ = RequestFollower(mailbox_, true);
  resume(first);
}

void ReachController::resume(const State& first) noexcept {
  hand_.reset();
  waited_ = 0;
  if (!phases_.finished()) begin_approach(first.position);
}

void ReachController::begin_approach(const Vec3& from) noexcept {
  phases_.begin_approach(from, geometry_.start);
  forces_.begin();
  leads_ = course_.pull;
  arrived_ = false;
  pull_ = Ramp(0);
  held_ = away_ = empty_ = 0;
  farthest_ = kNaN;
  let_go_ = false;
  told_broken_ = told_empty_ = false;
}

bool ReachController::follow_requests(const State& state) noexcept {
  requests_.update(state.dt);
  phases_.add(requests_.take_repeats());
  if (requests_.take_skip()) phases_.skip();
  const bool was_paused = std::exchange(paused_, requests_.paused());
  if (was_paused && !paused_ && phases_.phase() != Phase::hold) resume(state);
  return paused_;
}

void ReachController::end_run(Command& command, bool reached, const Vec3& position) noexcept {
  const double most = goal_ == ReachGoal::target ? geometry_.distance() : kFarthestReach;
  if (!reached)
    command.event = Event{
        .code = EventCode::time_over,
        .values = {std::clamp((position - geometry_.start).dot(geometry_.along()), 0.0, most),
                   goal_ == ReachGoal::target ? most : kNaN, phases_.phase() == Phase::approach ? waited_ : kNaN}};
  held_ = 0;
  phases_.begin_hold();
}

void ReachController::advance_start(const State& state, Command& command) noexcept {
  const double dt = std::min(state.dt, kLongestReachStep / course_.rate_hz);
  waited_ += dt;
  // An arm that rests before the cue lies deeper in the lock.
  const double radius = goal_ == ReachGoal::weigh && arrived_ && forces_.options().clamp
                            ? std::max(geometry_.start_radius, kCarries * forces_.options().clamp->break_out)
                            : geometry_.start_radius;
  const bool inside = norm_of(state.position - geometry_.start) <= radius;
  if (inside && (!leads_ || phases_.approached())) {
    arrived_ = true;
    leads_ = false;
  }
  away_ = inside ? 0 : away_ + dt;
  // A lock that a hand pressed off before the cue, or that has held it for too long, comes on again in the start.
  let_go_ = (let_go_ && !(inside && forces_.force().isZero(0))) || forces_.lets_go();
  if (forces_.broken() && inside && forces_.force().isZero(0)) forces_.begin();
  // The hold counts without the force that led the hand.
  // A hand that presses already waits for no cue.
  const bool presses = goal_ == ReachGoal::press && forces_.options().clamp &&
                       norm_of(forces_.force()) > std::max(kQuiet, kQuietShare * forces_.options().max_force);
  held_ = inside && arrived_ && pull_.value() == 0 && !presses ? held_ + dt : 0;
  if (arrived_ && course_.pull && away_ >= kAway) begin_approach(state.position);
  if (waited_ >= kLongestStart) {
    end_run(command, false, geometry_.start);  // the reach did not begin
  } else if (held_ >= course_.start_hold && arrived_) {
    held_ = 0;
    forces_.hold_anew();
    phases_.end_approach();
    command.event = phases_.repetition_event();
  }
}

bool ReachController::holds(const Vec3& position) noexcept {
  if (goal_ == ReachGoal::target) return norm_of(position - geometry_.target) <= geometry_.target_radius;
  if (goal_ != ReachGoal::range) return false;
  const double came = (position - geometry_.start).dot(geometry_.along());
  const bool stays = came <= farthest_ + kFarther && came >= farthest_ - kSteady;
  if (!stays) farthest_ = came;
  return stays && came > geometry_.start_radius;
}

void ReachController::advance_run(const State& state, Command& command) noexcept {
  const bool inside = holds(state.position), over = phases_.elapsed() >= course_.time_limit;
  held_ = inside ? held_ + std::min(state.dt, kLongestReachStep / course_.rate_hz) : 0;
  const bool lasts = is_held(goal_) || goal_ == ReachGoal::track;
  const double hold = goal_ == ReachGoal::range ? std::max(course_.target_hold, kShortestStay) : course_.target_hold;
  if ((inside && held_ >= hold) || (lasts && (over || forces_.broken() || forces_.lets_go())))
    end_run(command, true, state.position);
  else if (over)
    end_run(command, false, state.position);
}

Vec3 ReachController::goal() const noexcept {
  if (phases_.phase() == Phase::approach || is_held(goal_)) return geometry_.start;
  if (goal_ != ReachGoal::track) return geometry_.target;
  const double time = phases_.phase() == Phase::run ? phases_.elapsed() : course_.time_limit;
  return geometry_.start + track_.at(time) * (geometry_.target - geometry_.start);
}

void ReachController::advance(const State& state, Command& command) noexcept {
  if (follow_requests(state)) return;
  phases_.pass(std::min(state.dt, kLongestReachStep / course_.rate_hz));
  switch (phases_.phase()) {
    case Phase::approach:
      return advance_start(state, command);
    case Phase::run:
      return advance_run(state, command);
    default:
      if (phases_.next_repetition()) resume(state);
  }
}

bool ReachController::add_pull(const State& state, Command& command) noexcept {
  const bool leads = leads_ && phases_.phase() == Phase::approach && !paused_;
  const double share = requests_.share() * pull_.advance(leads ? 1 : 0, state.dt, kBlend);
  const Reference way = phases_.approach().at(phases_.elapsed());
  if (leads) {
    command.reference = way;
    command.patience = kPatience;
    (void)hand_.update(state.force_applied, way.position - state.position, nan3(), state.dt);
    command.resisted = hand_.resists();
    if (const double off = norm_of(way.position - state.position); off > course_.max_deviation) {
      command.status = Command::Status::deviation;
      command.event = Event{.code = EventCode::deviation_limit, .values = {off, course_.max_deviation, kNaN}};
    }
  }
  if (!(share > 0)) return false;
  Reference held = way;
  if (!leads) held.velocity = state.velocity;  // the law does not brake a hand that moves on
  command.wrench.force += share * pd_force(pull_gains_, state, held);
  return true;
}

void ReachController::watch_forces(const State& state, Command& command) noexcept {
  if (command.event) return;
  if (forces_.broken() && !std::exchange(told_broken_, true)) {
    const double off = norm_of(forces_.off(state.position - geometry_.start));
    command.event = Event{.code = EventCode::deviation_over,
                          .values = {off, forces_.options().clamp->break_out, is_held(goal_) ? 2.0 : 1.0}};
    return;
  }
  const double share = forces_.options().clamp ? 1 : forces_.tank().share();
  empty_ = share < kTankIsLow ? empty_ + state.dt : 0;
  if (empty_ >= kEmptyLasts && !std::exchange(told_empty_, true))
    command.event = Event{.code = EventCode::tank_empty, .values = {empty_, share, 1}};
}

Command ReachController::update(const State& state) noexcept {
  Command command;
  advance(state, command);
  const Phase phase = phases_.phase();
  command.reference = {.position = goal(), .velocity = Vec3::Zero(), .acceleration = Vec3::Zero()};
  const bool pulled = add_pull(state, command);
  const bool holds = phase == Phase::approach && arrived_ && !leads_ && !let_go_;
  const bool acts = !paused_ && (phase == Phase::run || (holds && forces_.options().clamp));
  // A press and an arm are meant to load the lock, which lets go by itself.
  if (acts && !is_held(goal_)) command.patience = kPatience;
  command.wrench.force += forces_.update(state, acts, requests_.share(), !pulled);
  if (phase == Phase::run && !paused_) watch_forces(state, command);
  command.phase = phases_.phase();
  if (phases_.finished() && command.status == Command::Status::working) command.status = Command::Status::finished;
  return command;
}

}  // namespace haptrace
