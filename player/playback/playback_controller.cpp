#include "player/playback/playback_controller.h"

#include "base/error.h"
#include "base/suggest.h"
#include "control/norm.h"
#include "control/resistance_timer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace haptrace {
namespace {

constexpr double kPauseTime = 0.1;  // over which the reference slows down and comes back to speed [s]
constexpr double kLongestStep = 5;  // ticks that the path's time may advance at once

const std::vector<std::string> kPolicies{"stop", "pause", "soften"};

}  // namespace

DeviationPolicy parse_deviation_policy(std::string_view name) {
  const auto found = std::find(kPolicies.begin(), kPolicies.end(), name);
  if (found == kPolicies.end())
    throw input_error(fmt::format("unknown deviation policy '{}'{}", name, suggestion(name, kPolicies)));
  return static_cast<DeviationPolicy>(found - kPolicies.begin());
}

const char* to_string(DeviationPolicy policy) noexcept {
  return kPolicies[static_cast<std::size_t>(policy)].c_str();
}

void validate(const PlaybackOptions& options) {
  check_range("the speed factor", options.speed, 0.001, 100);
  check_range("the number of repetitions", options.repetitions, 0, 1e6);
  check_range("the hold", options.hold, 0, 3600, "s");
  check_range("the approach speed", options.approach_speed, 1e-3, 2, "m/s");
  check_range("the deviation limit", options.max_deviation, 1e-5, 10, "m");
}

PlaybackController::PlaybackController(ReferenceStream path, ForceTerms terms, const Tuning& tuning,
                                       const PlaybackOptions& options, Mailbox<Tuning>* changes)
    : path_(std::move(path)), terms_(std::move(terms)), tuning_(tuning), changes_(changes), options_(options) {
  validate(options_);
  compose();
}

void PlaybackController::compose() noexcept {
  constexpr auto kUpdates = []<unsigned... parts>(std::integer_sequence<unsigned, parts...>) {
    return std::array{&PlaybackController::update_with<parts>...};
  }
  (std::make_integer_sequence<unsigned, kEveryPart + 1>{});
  const auto& axes = options_.axes;
  unsigned parts = 0;
  if (std::find(axes.begin(), axes.end(), false) != axes.end()) parts |= kUndrivenAxes;
  if (changes_ != nullptr) parts |= kLiveTuning;
  if (orientation_) parts |= kOrientation;
  if (guard_) parts |= kGuard;
  update_ = kUpdates[parts];
}

void PlaybackController::start(const State& first) noexcept {
  for (const auto& term : terms_) term->start(first);
  if (orientation_) orientation_->start(first);
  begin_repetition(first.position);
}

void PlaybackController::resume(const State& first) noexcept {
  for (const auto& term : terms_) term->start(first);
  if (orientation_) orientation_->start(first);
  if (guard_) guard_->resume();
  beyond_ = false;
  feedforward_ = Vec3::Zero();
  if (phase_ != Phase::approach) {
    interrupted_ = phase_;
    pace_ = Ramp(0);
  }
  begin_approach(first.position);
}

void PlaybackController::begin_repetition(const Vec3& from) noexcept {
  path_time_ = RunningTime();
  (void)path_.sample(0, reference_);  // the first piece is always there
  begin_approach(from);
}

void PlaybackController::begin_approach(const Vec3& from) noexcept {
  phase_ = Phase::approach;
  elapsed_ = 0;
  approach_pace_ = Ramp(1);
  const double turning =
      orientation_ ? orientation_->begin_approach(path_.orientation(path_time_.seconds()).orientation) : 0;
  approach_ = Approach(from, reference_.position, options_.approach_speed, turning);
}

void PlaybackController::between_ticks(bool may_wait) noexcept {
  for (const auto& term : terms_) term->between_ticks(may_wait);
  // The farthest that the next tick can ask for.
  if (may_wait && phase_ == Phase::run)
    path_.wait(path_time_.seconds() + options_.speed * kLongestStep / options_.rate_hz);
}

void PlaybackController::follow_hand(const State& state, Reference& reference) const noexcept {
  for (int axis = 0; axis < 3; ++axis) {
    if (options_.axes[static_cast<std::size_t>(axis)]) continue;
    reference.position[axis] = state.position[axis];
    reference.velocity[axis] = state.velocity[axis];
    reference.acceleration[axis] = 0;
  }
}

template <unsigned parts>
Command PlaybackController::update_with(const State& state) noexcept {
  Command command;
  Reference reference = advance(std::min(state.dt, kLongestStep / options_.rate_hz), command);
  if constexpr ((parts & kUndrivenAxes) != 0) follow_hand(state, reference);

  const double scale = command.status == Command::Status::working ? watch_deviation(state, reference, command) : 1;
  if constexpr ((parts & kLiveTuning) != 0) tuning_.approach(changes_->latest(), state.dt);
  for (const auto& term : terms_) {
    const Vec3 force = term->force({state, reference, tuning_, command.wrench.force});
    command.wrench.force += force;
    if (!term->feeds_back()) command.feedforward += force;
  }
  command.wrench.force *= scale;
  command.feedforward *= scale;
  if constexpr ((parts & kOrientation) != 0) turn_tool(state, scale, command);
  if constexpr ((parts & kGuard) != 0) keep_guard(state, reference, command);
  command.reference = reference;
  command.phase = phase_;
  command.patience = options_.on_deviation == DeviationPolicy::pause ? kPatienceOfPause : kPatience;
  command.resisted = (beyond_ && command.status == Command::Status::working) || (guard_ && guard_->hand_resists());
  if (finished_ && command.status == Command::Status::working) command.status = Command::Status::finished;
  return command;
}

void PlaybackController::turn_tool(const State& state, double scale, Command& command) noexcept {
  OrientationReference reference;
  if (phase_ == Phase::approach) {
    reference = orientation_->approach(elapsed_ / approach_.duration(), approach_.duration());
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
  pace_ = Ramp(0);  // and up to speed again when it goes on
  reference_.velocity = reference_.acceleration = Vec3::Zero();
}

Reference PlaybackController::advance(double step, Command& command) noexcept {
  if (phase_ == Phase::approach) {
    const double rate = approach_pace_.advance(wanted_pace(), step, kPauseTime);
    elapsed_ += rate * step;
    if (elapsed_ < approach_.duration()) {
      Reference way = approach_.at(elapsed_);
      way.velocity *= rate;
      way.acceleration *= rate * rate;
      if (interrupted_) way.time = path_time_.seconds();
      return way;
    }
    if (!interrupted_)
      command.event = Event{.code = EventCode::repetition, .values = {static_cast<double>(repetition_), kNaN, kNaN}};
    phase_ = std::exchange(interrupted_, std::nullopt).value_or(Phase::run);
  } else if (phase_ == Phase::run) {
    if (path_time_.seconds() >= path_.duration()) {
      phase_ = Phase::hold;
      held_ = 0;
    } else {
      pace_.advance(wanted_pace(), step, kPauseTime);
      const RunningTime next = path_time_.after(options_.speed * pace_.value() * step);
      follow(next.seconds() < path_.duration() ? next : RunningTime(path_.duration()), command);
    }
  } else {
    held_ += step;
    if (held_ >= options_.hold && !finished_) {
      ++repetition_;
      finished_ = options_.repetitions > 0 && repetition_ >= options_.repetitions;
      // From the reference, not from the hand: the force goes on without a step.
      if (!finished_) {
        const Vec3 from = reference_.position;
        begin_repetition(from);
        return {.position = from, .velocity = Vec3::Zero(), .acceleration = Vec3::Zero()};
      }
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
