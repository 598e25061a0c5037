#include "devices/servo_loop.h"

#include "control/budgets.h"
#include "control/error.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace haptrace {
namespace {

constexpr double kFlightRecord = 0.2;     // [s]
constexpr double kFaultFade = 0.05;       // over which the last good force fades after a deviation stop [s]
constexpr double kEventSpacing = 1.0;     // between two events of a limit that binds again and again [s]
constexpr double kLongestWait = 86400;    // for a device that is away or not ready [s]
constexpr std::int64_t kTicksApart = 10;  // a tick follows another no sooner than this part of the period
constexpr double kReleasedForce = 1e-3;   // below which there is nothing left to fade [N]
constexpr double kReleasedTorque = 1e-5;  // [N m]

/// Keeps the last samples of a session in memory that is allocated at its start.
class FlightRecorder {
 public:
  explicit FlightRecorder(std::size_t rows) : rows_(std::max<std::size_t>(rows, 1)) {}

  void push(const Sample& sample) noexcept { rows_[count_++ % rows_.size()] = sample; }

  [[nodiscard]] std::vector<Sample> samples() const {
    const std::size_t kept = std::min(count_, rows_.size());
    std::vector<Sample> result;
    result.reserve(kept);
    for (std::size_t i = count_ - kept; i < count_; ++i) result.push_back(rows_[i % rows_.size()]);
    return result;
  }

 private:
  std::vector<Sample> rows_;
  std::size_t count_ = 0;
};

/// What is not finite was not measured.
Vec3 as_measured(const Vec3& v) noexcept {
  return v.array().isFinite().select(v, nan3());
}
Quat as_measured(const Quat& q) noexcept {
  return q.coeffs().allFinite() ? q : nan_quat();
}

/// What a controller's answer ends the session with, if it does.
std::optional<StopCause> fault_of(Command::Status status) noexcept {
  switch (status) {
    case Command::Status::deviation:
      return StopCause::deviation;
    case Command::Status::oscillation:
      return StopCause::oscillation;
    case Command::Status::no_path:
      return StopCause::no_path;
    case Command::Status::working:
    case Command::Status::finished:
      break;
  }
  return std::nullopt;
}

}  // namespace

const char* to_string(StopCause cause) noexcept {
  switch (cause) {
    case StopCause::finished:
      return "finished";
    case StopCause::interrupted:
      return "interrupted";
    case StopCause::deviation:
      return "deviation";
    case StopCause::oscillation:
      return "oscillation";
    case StopCause::no_path:
      return "no_path";
    case StopCause::velocity:
      return "velocity";
    case StopCause::not_finite:
      return "not_finite";
    case StopCause::device_not_ready:
      return "device_not_ready";
    case StopCause::device_lost:
      return "device_lost";
  }
  return "unknown";
}

void ServoLoop::validate(const DeviceInfo& device, const Options& options) {
  if (!(options.rate_hz >= kLowestRate && options.rate_hz <= kHighestRate))
    throw input_error(
        fmt::format("the rate is {} Hz; it must be from {} to {} Hz", options.rate_hz, kLowestRate, kHighestRate));
  if (options.virtual_time && !device.virtual_time)
    throw input_error(fmt::format("the device {} lives in real time; use --clock real", device.name));
  check_range("the time to wait until a device is ready", options.ready_timeout, 0, kLongestWait, "s");
  if (!(options.away_timeout >= 0 && options.away_timeout <= kLongestWait))
    throw input_error(fmt::format("the time to wait for a lost device is {} s; it must be from 0 (not at all) to {} s",
                                  options.away_timeout, kLongestWait));
  haptrace::validate(options.limits);
}

ServoLoop::ServoLoop(Device& device, Controller& controller, VelocityEstimator& estimator,
                     std::span<SampleSink* const> sinks, const Options& options)
    : device_(device),
      controller_(controller),
      estimator_(estimator),
      sinks_(sinks.begin(), sinks.end()),
      options_(options) {
  validate(device_.info(), options_);
  // What the device bears is the ceiling; a session may only ask for less.
  const auto ceiling = [](double& limit, double most) {
    if (most > 0) limit = limit > 0 ? std::min(limit, most) : most;
  };
  ceiling(options_.limits.max_force, device_.info().max_force);
  ceiling(options_.limits.max_continuous_force, device_.info().max_continuous_force);
  ceiling(options_.limits.max_torque, device_.info().max_torque);
}

/// One run of the loop: the state that its ticks share.
class ServoLoop::Session {
 public:
  Session(ServoLoop& loop, ServoClock& clock, ServoReport& report)
      : loop_(loop),
        clock_(clock),
        report_(report),
        period_ns_(std::llround(1e9 / loop.options_.rate_hz)),
        limiter_(loop.options_.limits),
        guard_(guard_of(loop)),
        flight_(static_cast<std::size_t>(std::ceil(kFlightRecord * loop.options_.rate_hz))) {}

  void run(const StopRequest& stop) noexcept {
    loop_.estimator_.reset();
    start_ns_ = clock_.now();
    deadline_ns_ = last_ns_ = start_ns_;
    if (wait_until_ready(stop)) {
      while (!ended_) {
        clock_.wait_until(deadline_ns_);
        // Time never goes back, whatever the clock does.
        const std::int64_t woke_ns = last_ns_ = std::max(last_ns_, clock_.now());
        // The session's time begins at its first tick, not while a device was homing.
        if (first_) start_ns_ = woke_ns;
        tick(woke_ns, stop);
        schedule_next(woke_ns);
      }
    }
    send_zero();
    if (guard_) report_.vibration = guard_->summary();
  }

  /// The last samples before the end, oldest first.
  [[nodiscard]] std::vector<Sample> flight_record() const { return flight_.samples(); }

  /// Why there is no device, in words.
  [[nodiscard]] std::string lost_reason() const {
    std::string reason = loop_.device_.lost_reason();
    if (answers_) reason = "it answers again, but does not allow forces" + loop_.not_ready_hint();
    if (waited_in_vain_ > 0) reason += fmt::format("; it was waited for {:.3g} s", waited_in_vain_);
    return reason;
  }

  /// The event that says what stopped the session, if a limit or a fault did.
  [[nodiscard]] const std::optional<Event>& fault() const noexcept { return fault_; }

 private:
  enum class Mode { running, releasing, fading };

  /// None where there is no force limit: what is a large force there?
  static std::optional<ForceGuard> guard_of(const ServoLoop& loop) {
    const Options& options = loop.options_;
    if (!options.watch_vibration || !(options.limits.max_force > 0)) return std::nullopt;
    const double resolution = loop.device_.info().position_resolution;
    return ForceGuard({.monitor = {.rate_hz = options.rate_hz,
                                   .max_force = options.limits.max_force,
                                   .position_resolution = resolution > 0 && resolution < 1 ? resolution : 0},
                       .max_torque = loop.device_.info().takes_torque() ? options.limits.max_torque : 0});
  }

  /// Exchanges zero force until the device allows forces.
  bool wait_until_ready(const StopRequest& stop) noexcept {
    const auto patience_ns = static_cast<std::int64_t>(1e9 * loop_.options_.ready_timeout);
    for (double dt = 0;; dt = 1e-9 * static_cast<double>(period_ns_)) {
      const Device::Status status = loop_.device_.exchange({}, dt, device_state_);
      const bool answers = status == Device::Status::ok;
      if (answers && device_state_.ready) {
        away_since_ns_.reset();
        return true;
      }
      if (stop.count() > 0) return fail(StopCause::interrupted);
      if (!answers && is_given_up(status, deadline_ns_)) return fail(StopCause::device_lost);
      if (answers && deadline_ns_ - start_ns_ > patience_ns) return fail(StopCause::device_not_ready);
      if (dt == 0) push_event(0, {.code = EventCode::device_not_ready});
      loop_.device_.between_ticks(loop_.options_.virtual_time);
      deadline_ns_ += period_ns_;
      clock_.wait_until(deadline_ns_);
    }
  }

  bool fail(StopCause cause) noexcept {
    report_.cause = cause;
    ended_ = true;
    return false;
  }

  void tick(std::int64_t woke_ns, const StopRequest& stop) noexcept {
    const TickScope scope;
    const std::int64_t began_ns = monotonic_ns();

    State state;
    state.tick = tick_;
    state.time_ns = woke_ns - start_ns_;
    state.dt = exchanged_ns_ ? 1e-9 * static_cast<double>(woke_ns - *exchanged_ns_) : 0;
    state.force_applied = wrench_.force;

    const Device::Status status = loop_.device_.exchange(wrench_, state.dt, device_state_);
    exchanged_ns_ = woke_ns;
    // One that was away and is not homed yet still is.
    if (status != Device::Status::ok || (away_since_ns_ && !device_state_.ready)) {
      do_without(status, woke_ns, state.time_ns, stop);
      return;
    }
    state.position = device_state_.position;
    state.orientation = as_measured(device_state_.orientation);
    state.force_measured = as_measured(device_state_.force);
    state.buttons = device_state_.buttons;

    if (!is_finite(state.position)) {
      // No row for this tick: a position that was not taken is not invented, and nothing may be computed from it.
      stop_now(StopCause::not_finite, {.code = EventCode::not_finite, .values = {0, kNaN, kNaN}}, state.time_ns);
      return;
    }
    if (away_since_ns_) come_back(state, woke_ns);
    state.velocity = loop_.estimator_.update(state.position, state.dt);
    keep(state, decide(state, stop), woke_ns);
    report_.tick_time.record(monotonic_ns() - began_ns);
  }

  /// Whether a device that answers `status` is no longer waited for.
  bool is_given_up(Device::Status status, std::int64_t now_ns) noexcept {
    if (!away_since_ns_) away_since_ns_ = now_ns;
    const double away = 1e-9 * static_cast<double>(now_ns - *away_since_ns_);
    const bool impatient = away >= loop_.options_.away_timeout;
    if (impatient) waited_in_vain_ = away;
    answers_ = status == Device::Status::ok;
    return impatient || status == Device::Status::lost;
  }

  /// A tick without the device: no row, and nothing but zero force for it to find when it is back.
  void do_without(Device::Status status, std::int64_t woke_ns, std::int64_t time_ns, const StopRequest& stop) noexcept {
    const bool just_lost = !away_since_ns_;
    wrench_ = {};
    fade_ = Ramp();
    // Where forces were on their way out, there is nothing to go on with.
    if (is_given_up(status, woke_ns) || mode_ != Mode::running) {
      const double waited = waited_in_vain_ > 0 ? waited_in_vain_ : kNaN;
      stop_now(StopCause::device_lost, {.code = EventCode::device_lost, .values = {waited, kNaN, kNaN}}, time_ns);
    } else {
      if (just_lost) push_event(time_ns, {.code = EventCode::device_lost});
      if (stop.count() > 0) stop_now(StopCause::interrupted, {.code = EventCode::interrupted}, time_ns);
    }
  }

  /// It may have been moved meanwhile: nothing may be computed from what was before.
  void come_back(State& state, std::int64_t woke_ns) noexcept {
    const double gap = 1e-9 * static_cast<double>(woke_ns - *away_since_ns_);
    away_since_ns_.reset();
    push_event(state.time_ns, {.code = EventCode::device_found, .values = {gap, kNaN, kNaN}});
    ++report_.returns;
    if (first_) return;
    report_.away += gap;
    resumes_ = true;
    state.dt = 0;
    loop_.estimator_.reset();
  }

  /// The controller's answer, with everything that can end the session looked at. Sets wrench_.
  Command decide(const State& state, const StopRequest& stop) noexcept {
    if (first_) {
      loop_.controller_.start(state);
      push_event(state.time_ns, {.code = EventCode::started});
    } else if (std::exchange(resumes_, false)) {
      loop_.controller_.resume(state);
    }
    const double speed = state.velocity.stableNorm();
    const SafetyLimits& limits = loop_.options_.limits;

    Command command = loop_.controller_.update(state);
    if (command.event) push_event(state.time_ns, *command.event);

    if (!device_state_.ready) {
      stop_now(StopCause::device_not_ready, {.code = EventCode::device_not_ready}, state.time_ns);
    } else if (limits.max_velocity > 0 && speed > limits.max_velocity) {
      stop_now(StopCause::velocity, {.code = EventCode::velocity_limit, .values = {speed, limits.max_velocity, kNaN}},
               state.time_ns);
    } else if (!is_finite(command.wrench.force) || !is_finite(command.wrench.torque)) {
      stop_now(StopCause::not_finite, {.code = EventCode::not_finite, .values = {1, kNaN, kNaN}}, state.time_ns);
    } else if (stop.count() > 1) {
      stop_now(StopCause::interrupted, {.code = EventCode::interrupted}, state.time_ns);
    } else if (mode_ == Mode::running) {
      if (const auto fault = fault_of(command.status)) {
        mode_ = Mode::fading;
        report_.cause = *fault;
        fault_ = command.event;
      } else if (stop.count() > 0) {
        begin_release(StopCause::interrupted, EventCode::interrupted, state.time_ns);
      } else if (command.status == Command::Status::finished) {
        begin_release(StopCause::finished, EventCode::finished, state.time_ns);
      }
    }
    if (!ended_) shape(command, state);
    if (mode_ == Mode::releasing) command.phase = Phase::release;
    if (mode_ == Mode::fading || report_.stopped_by_fault()) command.phase = Phase::stopped;
    return command;
  }

  void begin_release(StopCause cause, EventCode code, std::int64_t time_ns) noexcept {
    mode_ = Mode::releasing;
    report_.cause = cause;
    push_event(time_ns, {.code = code});
  }

  /// From the force that was asked for to the force that is sent: fade, then limits.
  void shape(const Command& command, const State& state) noexcept {
    const SafetyLimits& limits = loop_.options_.limits;
    const double dt = first_ ? 0 : state.dt;
    Wrench asked = guard_ ? guard_->soften(command.wrench, command.feedforward) : command.wrench;
    double scale = 1;
    switch (mode_) {
      case Mode::running:
        scale = fade_.advance(1, dt, limits.soft_start);
        break;
      case Mode::releasing:
        scale = fade_.advance(0, dt, limits.release);
        break;
      case Mode::fading:
        // What the controller asks for is no longer trusted; what was last sent is, and it fades.
        if (!fault_wrench_) {
          fault_wrench_ = wrench_;
          fade_ = Ramp(1);
        }
        scale = fade_.advance(0, dt, kFaultFade);
        asked = *fault_wrench_;
        break;
    }
    // Where there is no motor nothing is asked for: it would use up the limit of the others.
    for (int axis = 0; axis < 3; ++axis) {
      const auto i = static_cast<std::size_t>(axis);
      if (!loop_.device_.info().force_axes[i]) asked.force[axis] = 0;
      if (!loop_.device_.info().torque_axes[i]) asked.torque[axis] = 0;
    }
    wrench_.torque = limited_torque(scale * asked.torque);
    const ForceLimiter::Result limited = limiter_.limit(scale * asked.force, 1e-9 * static_cast<double>(period_ns_));
    wrench_.force = limited.force;
    if (limited.verdict != ForceLimiter::Verdict::free) tell_of_limit(limited, state.time_ns);
    if (const auto event = budget_.update(limiter_, wrench_.force.stableNorm())) push_event(state.time_ns, *event);
    if (guard_ && mode_ != Mode::fading) watch_vibration(command, scale * asked.force, scale, state);

    if (mode_ != Mode::running && (scale == 0 || is_released(wrench_))) {
      wrench_ = {};
      ended_ = true;
    }
  }

  /// Lets the guard see what is sent. A limit cuts feedforward and feedback alike.
  void watch_vibration(const Command& command, const Vec3& asked, double scale, const State& state) noexcept {
    Wrench feedback = wrench_;
    if (!command.feedforward.isZero(0)) {
      const double norm = asked.stableNorm();
      if (norm > 0) feedback.force -= wrench_.force.stableNorm() / norm * scale * command.feedforward;
    }
    const auto event = guard_->watch(feedback, state.position, command.vibration, state.dt);
    if (!event) return;
    if (guard_->beyond_help() && mode_ == Mode::running) {
      mode_ = Mode::fading;
      report_.cause = StopCause::oscillation;
    }
    push_event(state.time_ns, *event);
  }

  /// Its magnitude within the limit, its axis kept.
  [[nodiscard]] Vec3 limited_torque(const Vec3& torque) const noexcept {
    const double most = loop_.options_.limits.max_torque, asked = torque.stableNorm();
    return most > 0 && asked > most ? Vec3(torque * (most / asked)) : torque;
  }

  static bool is_released(const Wrench& wrench) noexcept {
    return wrench.force.stableNorm() < kReleasedForce && wrench.torque.stableNorm() < kReleasedTorque;
  }

  void tell_of_limit(const ForceLimiter::Result& limited, std::int64_t time_ns) noexcept {
    const bool bound_before = time_ns - limit_told_ns_ < static_cast<std::int64_t>(1e9 * kEventSpacing);
    if (bound_before && limit_told_) return;
    limit_told_ = true;
    limit_told_ns_ = time_ns;
    if (limited.verdict == ForceLimiter::Verdict::peak)
      push_event(time_ns, {.code = EventCode::force_limit, .values = {limited.asked, limited.allowed, kNaN}});
    else
      push_event(time_ns, {.code = EventCode::continuous_limit, .values = {limited.allowed, kNaN, kNaN}});
  }

  /// Ends the session at this tick with zero force.
  void stop_now(StopCause cause, const Event& event, std::int64_t time_ns) noexcept {
    report_.cause = cause;
    wrench_ = {};
    ended_ = true;
    push_event(time_ns, event);
  }

  /// The row of this tick, to everyone who wants it.
  void keep(const State& state, const Command& command, std::int64_t woke_ns) noexcept {
    const std::int64_t latency_ns = woke_ns - deadline_ns_;
    Sample sample;
    sample.tick = state.tick;
    sample.time_ns = state.time_ns;
    sample.position = state.position;
    sample.velocity = state.velocity;
    sample.force = wrench_.force;
    sample.orientation = state.orientation;
    if (loop_.device_.info().takes_torque()) sample.torque = wrench_.torque;
    sample.force_measured = state.force_measured;
    sample.reference_position = command.reference.position;
    sample.reference_velocity = command.reference.velocity;
    sample.reference_force = command.reference_force;
    sample.reference_orientation = command.reference_orientation;
    sample.progress = command.progress;
    sample.tunnel_radius = command.tunnel_radius;
    sample.buttons = state.buttons;
    sample.phase = ended_ && report_.stopped_by_fault() ? Phase::stopped : command.phase;
    sample.latency = 1e-9F * static_cast<float>(latency_ns);

    for (SampleSink* sink : loop_.sinks_) sink->push(sample);
    flight_.push(sample);

    report_.latency.record(latency_ns);
    report_.max_force = std::max(report_.max_force, wrench_.force.stableNorm());
    ++report_.samples;
    report_.duration = 1e-9 * static_cast<double>(state.time_ns);
    first_ = false;
  }

  /// The first deadline that is still to come. Those that passed are missed, and one that follows a late tick at its
  /// heels: they would see a device that had no time to move, and differentiate the position over microseconds.
  void schedule_next(std::int64_t woke_ns) noexcept {
    loop_.device_.between_ticks(loop_.options_.virtual_time);
    loop_.controller_.between_ticks(loop_.options_.virtual_time);
    for (SampleSink* sink : loop_.sinks_) sink->between_ticks(loop_.options_.virtual_time);
    const std::int64_t earliest_ns = std::max(clock_.now(), woke_ns + period_ns_ / kTicksApart);
    const std::int64_t late = std::max<std::int64_t>(earliest_ns - (deadline_ns_ + period_ns_), 0);
    const std::int64_t missed = (late + period_ns_ - 1) / period_ns_;
    tick_ += 1 + static_cast<std::uint64_t>(missed);
    deadline_ns_ += (1 + missed) * period_ns_;
    if (missed > 0 && !ended_) {
      report_.missed += static_cast<std::uint64_t>(missed);
      ++report_.overruns;
      push_event(woke_ns - start_ns_,
                 {.code = EventCode::overrun,
                  .values = {static_cast<double>(missed), 1e-9 * static_cast<double>(late), kNaN}});
    }
  }

  void push_event(std::int64_t time_ns, Event event) noexcept {
    event.time_ns = time_ns;
    if (!fault_ && report_.stopped_by_fault()) fault_ = event;
    for (SampleSink* sink : loop_.sinks_) sink->push(event);
  }

  /// The force that leaves last. A device that is lost cannot be told; its own watchdog has to.
  void send_zero() noexcept {
    wrench_ = {};
    (void)loop_.device_.exchange(wrench_, 0, device_state_);
  }

  ServoLoop& loop_;
  ServoClock& clock_;
  ServoReport& report_;
  const std::int64_t period_ns_;
  ForceLimiter limiter_;
  MotorBudget budget_;
  std::optional<ForceGuard> guard_;
  FlightRecorder flight_;

  Mode mode_ = Mode::running;
  bool ended_ = false;
  bool first_ = true;
  std::uint64_t tick_ = 0;
  std::int64_t start_ns_ = 0, deadline_ns_ = 0;
  std::int64_t last_ns_ = 0;                   ///< when the last tick woke
  std::optional<std::int64_t> exchanged_ns_;   ///< the tick of the last exchange
  std::optional<std::int64_t> away_since_ns_;  ///< the first tick without the device
  double waited_in_vain_ = 0;                  ///< for a device that is away [s]
  bool answers_ = false;                       ///< although it is away: it is not ready
  bool resumes_ = false;                       ///< at this tick
  std::optional<Event> fault_;
  DeviceState device_state_;
  Wrench wrench_;  ///< to be sent at the next exchange
  Ramp fade_;
  std::optional<Wrench> fault_wrench_;  ///< the last that was sent before it
  bool limit_told_ = false;
  std::int64_t limit_told_ns_ = 0;
};

std::string ServoLoop::not_ready_hint() const {
  const std::string reason = device_.not_ready_reason();
  return reason.empty() ? "; is it homed?" : ": " + reason;
}

ServoReport ServoLoop::run(const StopRequest& stop) noexcept {
  ServoReport report;
  report.asked_rate = options_.rate_hz;
  if (!options_.virtual_time && options_.realtime) report.realtime = request_realtime();
  const FlushDenormals flush;

  MonotonicClock monotonic;
  VirtualClock virtual_time;
  ServoClock& own = options_.virtual_time ? static_cast<ServoClock&>(virtual_time) : monotonic;
  ServoClock& clock = options_.clock != nullptr ? *options_.clock : own;
  Session session(*this, clock, report);
  session.run(stop);

  if (report.stopped_by_fault()) {
    report.flight_record = session.flight_record();
    if (session.fault()) report.detail = describe(*session.fault());
    if (report.cause == StopCause::device_lost) report.detail = "the device was lost: " + session.lost_reason();
    if (report.cause == StopCause::device_not_ready)
      report.detail =
          (report.samples == 0 ? fmt::format("the device did not become ready within {} s", options_.ready_timeout)
                               : "the device does not allow forces any more") +
          not_ready_hint();
  } else if (report.cause == StopCause::interrupted) {
    report.detail = "interrupted";
  }
  return report;
}

}  // namespace haptrace
