#include "player/playback/playback_controller.h"

#include "base/enum_names.h"
#include "base/error.h"
#include "control/norm.h"
#include "control/resistance_timer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace haptrace {
namespace {

constexpr double kPauseTime = 0.1;  // time in which the reference stops or resumes its speed [s]
constexpr double kLongestStep = 5;  // largest step of the path's time [ticks]

}  // namespace

PlaybackController::PlaybackController(ReferenceStream path, ForceTerms terms, const Tuning& tuning,
                                       const PlaybackOptions& options, Mailbox<Tuning>* changes)
    : path_(std::move(path)),
      terms_(std::move(terms)),
      tuning_(tuning),
      changes_(changes),
      options_(options),
      has_undriven_axes_(std::find(options.axes.begin(), options.axes.end(), false) != options.axes.end()),
      phases_(options.repetitions, options.hold, options.approach_speed) {
  validate(options_);
}

void PlaybackController::start(const State& first) noexcept {
  requests_ = RequestFollower(mailbox_);
  for (const auto& term : terms_) term->start(first);
  if (orientation_) orientation_->start(first);
  if (schedule_) schedule_->reset(0);
  begin_repetition(first.position);
}

void PlaybackController::resume(const State& first) noexcept {
  for (const auto& term : terms_) term->start(first);
  if (orientation_) orientation_->start(first);
  if (guard_) guard_->resume();
  beyond_ = false;
  feedforward_ = Vec3::Zero();
  if (phases_.phase() != Phase::approach) pace_ = Ramp(0);
  phases_.interrupt();
  begin_approach(first.position);
  if (std::exchange(skips_, false)) phases_.skip();
}

void PlaybackController::begin_repetition(const Vec3& from) noexcept {
  path_time_ = RunningTime();
  (void)path_.sample(0, reference_);  // the first piece is always in memory
  begin_approach(from);
}

void PlaybackController::begin_approach(const Vec3& from) noexcept {
  approach_pace_ = Ramp(1);
  const double turning =
      orientation_ ? orientation_->begin_approach(path_.orientation(path_time_.seconds()).orientation) : 0;
  phases_.begin_approach(from, reference_.position, turning);
}

void PlaybackController::between_ticks(bool may_wait) noexcept {
  for (const auto& term : terms_) term->between_ticks(may_wait);
  // The farthest that the next tick can ask for.
  if (may_wait && phases_.phase() == Phase::run)
    path_.wait(path_time_.seconds() + options_.speed * kLongestStep / options_.rate_hz);
}

void PlaybackController::follow_requests(double dt) noexcept {
  requests_.update(dt);
  phases_.add(requests_.take_repeats());
  if (!requests_.take_skip()) return;
  if (phases_.phase() == Phase::run)
    skips_ = true;
  else
    phases_.skip();
}

void PlaybackController::follow_hand(const State& state, Reference& reference) const noexcept {
  for (int axis = 0; axis < 3; ++axis) {
    if (options_.axes[static_cast<std::size_t>(axis)]) continue;
    reference.position[axis] = state.position[axis];
    reference.velocity[axis] = state.velocity[axis];
    reference.acceleration[axis] = 0;
  }
}

Command PlaybackController::update(const State& state) noexcept {
  Command command;
  follow_requests(state.dt);
  Reference reference = advance(std::min(state.dt, kLongestStep / options_.rate_hz), command);
  if (has_undriven_axes_) follow_hand(state, reference);

  const double scale = command.status == Command::Status::working ? watch_deviation(state, reference, command) : 1;
  if (changes_ != nullptr) tuning_.approach(changes_->latest(), state.dt);
  Tuning tuning = tuning_;
  if (schedule_) tuning.gains = schedule_->advance(tuning_.gains, path_time_.seconds(), state.dt);
  PdGains gains;
  for (const auto& term : terms_) {
    const Vec3 force = term->force({state, reference, tuning, command.wrench.force});
    command.wrench.force += force;
    if (!term->feeds_back()) {
      command.feedforward += force;
      continue;
    }
    command.renewed |= term->renewed();
    const PdGains own = term->gains(tuning);
    gains = {gains.kp + own.kp, gains.kd + own.kd};
  }
  const double share = requests_.share();
  double softened = share;
  if (share < 1) {
    Vec3 feedback = share * (command.wrench.force - command.feedforward);
    const double most = share * options_.softened_force, size = norm_of(feedback);
    if (most > 0 && size > most) {
      feedback *= most / size;
      softened *= most / size;
    }
    command.wrench.force = command.feedforward + feedback;
  }
  command.wrench.force *= scale;
  command.feedforward *= scale;
  command.kp = softened * scale * gains.kp;
  command.kd = softened * scale * gains.kd;
  if (orientation_) turn_tool(state, share * scale, command);
  if (guard_) keep_guard(state, reference, command);
  command.reference = reference;
  command.phase = phases_.phase();
  command.patience = options_.on_deviation == DeviationPolicy::pause ? kPatienceOfPause : kPatience;
  command.resisted = (beyond_ && command.status == Command::Status::working) || (guard_ && guard_->hand_resists());
  if (phases_.finished() && command.status == Command::Status::working) command.status = Command::Status::finished;
  return command;
}

void PlaybackController::turn_tool(const State& state, double scale, Command& command) noexcept {
  OrientationReference reference;
  if (phases_.phase() == Phase::approach) {
    const double duration = phases_.approach().duration();
    reference = orientation_->approach(phases_.elapsed() / duration, duration);
    reference.angular_velocity *= approach_pace_.value();
  } else {
    reference = path_.orientation(path_time_.seconds());
    reference.angular_velocity *= pace();
  }
  command.wrench.torque = scale * orientation_->torque(state, reference);
  command.reference_orientation = reference.orientation;

  const double deviation = orientation_->deviation(), limit = orientation_->options().max_deviation;
  if (deviation <= limit) return;
  if (options_.on_deviation != DeviationPolicy::stop) {
    command.wrench.torque *= limit / deviation;
  } else if (command.status == Command::Status::working) {
    command.status = Command::Status::deviation;
    command.event = Event{.code = EventCode::rotation_limit, .values = {deviation, limit, kNaN}};
  }
}

void PlaybackController::keep_guard(const State& state, const Reference& reference, Command& command) noexcept {
  guard_->watch(state, reference, state.force_applied - feedforward_);
  feedforward_ = command.feedforward;
  if (!command.event) command.event = guard_->take_event();
}

void PlaybackController::follow(const RunningTime& time, Command& command) noexcept {
  switch (path_.sample(time.seconds(), reference_)) {
    case ReferenceStream::Answer::ready:
      path_time_ = time;
      waiting_ = false;
      return;
    case ReferenceStream::Answer::waiting:
      if (!waiting_) command.event = Event{.code = EventCode::path_waits, .values = {path_time_.seconds(), kNaN, kNaN}};
      break;
    case ReferenceStream::Answer::unreadable:
      command.status = Command::Status::no_path;
      command.event = Event{.code = EventCode::path_unreadable, .values = {path_time_.seconds(), kNaN, kNaN}};
      break;
  }
  waiting_ = true;
  pace_ = Ramp(0);  // the reference accelerates again when it resumes
  reference_.velocity = reference_.acceleration = Vec3::Zero();
}

Reference PlaybackController::advance(double step, Command& command) noexcept {
  switch (phases_.phase()) {
    case Phase::approach: {
      const double rate = approach_pace_.advance(wanted_pace(), step, kPauseTime);
      phases_.pass(rate * step);
      if (!phases_.approached()) {
        Reference reference = phases_.approach().at(phases_.elapsed());
        reference.velocity *= rate;
        reference.acceleration *= rate * rate;
        if (phases_.interrupted()) reference.time = path_time_.seconds();
        return reference;
      }
      if (!phases_.interrupted()) command.event = phases_.repetition_event();
      phases_.end_approach();
      break;
    }
    case Phase::run:
      if (path_time_.seconds() >= path_.duration()) {
        skips_ = false;
        phases_.begin_hold();
      } else {
        pace_.advance(wanted_pace(), step, kPauseTime);
        if (skips_ && pace_.value() == 0) {
          skips_ = false;
          phases_.skip();
          break;
        }
        const RunningTime next = path_time_.after(options_.speed * pace_.value() * step);
        follow(next.seconds() < path_.duration() ? next : RunningTime(path_.duration()), command);
      }
      break;
    default:
      if (requests_.paused()) break;
      phases_.pass(step);
      // From the reference, not from the hand: the force goes on without a step.
      if (phases_.next_repetition()) {
        const Vec3 from = reference_.position;
        begin_repetition(from);
        return {.position = from, .velocity = Vec3::Zero(), .acceleration = Vec3::Zero()};
      }
  }

  const double rate = pace();
  return {reference_.position, rate * reference_.velocity, rate * rate * reference_.acceleration, path_time_.seconds()};
}

double PlaybackController::watch_deviation(const State& state, const Reference& reference, Command& command) noexcept {
  const double deviation = norm_of(reference.position - state.position);
  const double limit = options_.max_deviation;
  const bool was_beyond = beyond_;
  beyond_ = deviation > (was_beyond ? 0.5 * limit : limit);
  if (!beyond_) {
    if (was_beyond && options_.on_deviation == DeviationPolicy::pause)
      command.event = Event{.code = EventCode::reference_goes_on};
    return 1;
  }
  if (options_.on_deviation == DeviationPolicy::stop) {
    command.status = Command::Status::deviation;
    command.event = Event{.code = EventCode::deviation_limit, .values = {deviation, limit, kNaN}};
    return 1;
  }
  if (!was_beyond) {
    const bool pauses = options_.on_deviation == DeviationPolicy::pause;
    command.event = Event{.code = pauses ? EventCode::reference_waits : EventCode::deviation_over,
                          .values = {deviation, limit, kNaN}};
  }
  return options_.on_deviation == DeviationPolicy::soften ? std::min(1.0, limit / deviation) : 1;
}

}  // namespace haptrace
