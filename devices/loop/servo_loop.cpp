#include "devices/loop/servo_loop.h"

#include "base/enum_names.h"
#include "base/error.h"
#include "control/budgets.h"
#include "control/force_guard.h"
#include "control/limits.h"
#include "control/norm.h"
#include "control/resistance_timer.h"
#include "control/velocity_estimator.h"
#include "devices/loop/clock.h"
#include "devices/loop/realtime.h"
#include "devices/rest_watch.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace haptrace {
namespace {

// While forces fade, an absurd request must not reach the limit at once. A law may ask for more than the limit, since
// only a part of it acts.
constexpr double kMostAsked = 4;                         // share of the limit
constexpr double kFlightRecord = 0.2;                    // [s]
constexpr double kFaultFade = 0.05;                      // time over which the last good force fades after a fault [s]
constexpr double kEventSpacing = 1.0;                    // time between two events of a limit that binds repeatedly [s]
constexpr double kLongestRelease = 2;                    // longest fade after a request to stop [s]
constexpr double kLongestWait = 86400;                   // longest wait for a device that is away or not ready [s]
constexpr std::int64_t kTicksApart = 10;                 // shortest time between two ticks: the period divided by this
constexpr double kSteadyTime = 0.3, kSteadyShare = 0.5;  // of a resisted force: low pass [s], share of its norm
constexpr double kSparse = 1;                            // longest time in gaps beyond the time between them [s]
constexpr double kReleasedForce = 1e-3;                  // force below which nothing is left to fade [N]
constexpr double kReleasedTorque = 1e-5;                 // [N m]
constexpr const char* kMoves = "its handle does not come to rest: hold it still, or let go of it";

/// Keeps the last samples of a session in memory that it allocates at the start.
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

/// Returns the farthest distance from the workspace's centre that a hand reaches and a velocity estimator accepts [m].
double farthest_reach(const DeviceInfo& info, const Vec3& centre) noexcept {
  const double reach = 10 * norm_of(info.workspace_max - info.workspace_min) + 1;
  return std::min(reach, kFarthestPosition - centre.cwiseAbs().maxCoeff());
}

/// Replaces a value that is not finite with NaN, the value of a quantity without a measurement.
Vec3 as_measured(const Vec3& v) noexcept {
  return v.array().isFinite().select(v, nan3());
}
Quat as_measured(const Quat& q) noexcept {
  return q.coeffs().allFinite() ? q : nan_quat();
}

/// Returns the cause with which a controller's answer ends the session, if it does.
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
  static constexpr EnumNames<StopCause, 11> kCauses{
      "cause",
      {"finished", "interrupted", "deviation", "resistance", "oscillation", "no_path", "velocity", "not_finite",
       "outside_workspace", "device_not_ready", "device_lost"}};
  return kCauses.name(cause);
}

std::int64_t stale_after_ns(double rate_hz) noexcept {
  constexpr double kAge = 0.02, kPeriods = 3, kLongest = 1;
  return static_cast<std::int64_t>(1e9 * std::max(kAge, std::min(kPeriods / rate_hz, kLongest)));
}

void ServoLoop::validate(const DeviceInfo& device, const ServoOptions& options) {
  if (!(options.rate_hz >= kLowestRate && options.rate_hz <= kHighestRate))
    throw input_error(
        fmt::format("the rate is {} Hz; it must be from {} to {} Hz", options.rate_hz, kLowestRate, kHighestRate));
  if (options.virtual_time && !device.virtual_time)
    throw input_error(fmt::format("the device {} runs in real time; use --clock real", device.name));
  check_range("the time to wait until a device is ready", options.ready_timeout, 0, kLongestWait, "s");
  if (!(options.away_timeout >= 0 && options.away_timeout <= kLongestWait))
    throw input_error(fmt::format("the time to wait for a lost device is {} s; it must be from 0 (not at all) to {} s",
                                  options.away_timeout, kLongestWait));
  haptrace::validate(options.limits);
}

SafetyLimits ServoLoop::in_force(const DeviceInfo& device, SafetyLimits limits) noexcept {
  const auto ceiling = [](double& limit, double most) {
    if (most > 0) limit = limit > 0 ? std::min(limit, most) : most;
  };
  ceiling(limits.max_force, device.max_force);
  ceiling(limits.max_continuous_force, device.max_continuous_force);
  ceiling(limits.max_torque, device.max_torque);
  if (const double peak = device.max_force > 0 ? device.max_force : limits.max_force;
      limits.max_continuous_force == 0 && peak > 0) {
    limits.max_continuous_force = kCautiousShare * peak;
    limits.continuous_time = kCautiousTime;
  }
  return limits;
}

ServoLoop::ServoLoop(Device& device, Controller& controller, VelocityEstimator& estimator,
                     std::span<SampleSink* const> sinks, const ServoOptions& options)
    : device_(device),
      controller_(controller),
      estimator_(estimator),
      sinks_(sinks.begin(), sinks.end()),
      options_(options) {
  validate(device_.info(), options_);
  const bool stated = options_.limits.max_continuous_force > 0 || device_.info().max_continuous_force > 0;
  options_.limits = in_force(device_.info(), options_.limits);
  if (!stated) assumed_continuous_force_ = options_.limits.max_continuous_force;
}

/// One run of the loop, with the state that its ticks share.
class ServoLoop::Session {
 public:
  Session(ServoLoop& loop, ServoClock& clock, ServoReport& report)
      : loop_(loop),
        clock_(clock),
        report_(report),
        period_ns_(std::llround(1e9 / loop.options_.rate_hz)),
        stale_after_ns_(stale_after_ns(loop.options_.rate_hz)),
        centre_(0.5 * (loop.device_.info().workspace_min + loop.device_.info().workspace_max)),
        farthest_(farthest_reach(loop.device_.info(), centre_)),
        takes_torque_(loop.device_.info().takes_torque()),
        limiter_(loop.options_.limits),
        torque_limiter_(loop.options_.limits.max_torque, kCautiousShare * loop.options_.limits.max_torque,
                        kCautiousTime),
        guard_(guard_of(loop)),
        flight_(static_cast<std::size_t>(std::ceil(kFlightRecord * loop.options_.rate_hz))) {
    if (const MotorHeat* heat = loop.options_.motors) {
      limiter_.warm(heat->force, heat->rested);
      torque_limiter_.warm(heat->torque, heat->rested);
    }
  }

  void run(const StopRequest& stop) noexcept {
    loop_.estimator_.reset();
    start_ns_ = clock_.now();
    deadline_ns_ = last_ns_ = start_ns_;
    if (wait_until_ready(stop)) {
      while (!ended_) {
        clock_.wait_until(deadline_ns_);
        // Time never runs backwards, whatever the clock does.
        std::int64_t woke_ns = last_ns_ = std::max(last_ns_, clock_.now());
        // The session's time starts at its first tick, after homing.
        if (first_) start_ns_ = woke_ns;
        tick(woke_ns, stop);
        schedule_next(woke_ns);
      }
    }
    send_zero();
    if (loop_.options_.motors != nullptr)
      *loop_.options_.motors = {.force = limiter_.mean_square(), .torque = torque_limiter_.mean_square()};
    if (guard_) report_.vibration = guard_->summary();
  }

  /// Returns the last samples before the end, oldest first.
  [[nodiscard]] std::vector<Sample> flight_record() const { return flight_.samples(); }

  /// Returns why the device was lost, in words.
  [[nodiscard]] std::string lost_reason() const {
    std::string reason = loop_.device_.lost_reason();
    if (silent_) reason = "it answers, but measures no new sample";
    if (sparse_gap_)
      reason = fmt::format("its samples come {:.0f} ms apart; a force needs one every {:.0f} ms", 1e3 * *sparse_gap_,
                           1e-6 * static_cast<double>(stale_after_ns_));
    if (answers_ && moves_) reason = fmt::format("it answers again, but {}", kMoves);
    if (answers_ && !moves_) reason = "it answers again, but does not allow forces" + loop_.not_ready_hint();
    if (waited_in_vain_ > 0) reason += fmt::format("; the session waited {:.3g} s for it", waited_in_vain_);
    return reason;
  }

  /// Returns true if the device allows forces but its handle has not come to rest.
  [[nodiscard]] bool moves() const noexcept { return moves_; }

  /// Returns the event of the limit or fault that stopped the session, if one did.
  [[nodiscard]] const std::optional<Event>& fault() const noexcept { return fault_; }

 private:
  enum class Mode { running, releasing, fading };

  /// Returns no guard without a force limit, because the guard has no scale for forces then.
  static std::optional<ForceGuard> guard_of(const ServoLoop& loop) {
    const ServoOptions& options = loop.options_;
    if (!options.watch_vibration || !(options.limits.max_force > 0)) return std::nullopt;
    const double resolution = loop.device_.info().position_resolution;
    return ForceGuard({.monitor = {.rate_hz = options.rate_hz,
                                   .max_force = options.limits.max_force,
                                   .position_resolution = resolution > 0 && resolution < 1 ? resolution : 0,
                                   .tremor = options.tremor},
                       .max_torque = loop.device_.info().takes_torque() ? options.limits.max_torque : 0});
  }

  Device::Status exchange(const Wrench& wrench, double dt) noexcept {
    loop_.pulse_.at(TickPulse::Place::device);
    const Device::Status status = loop_.device_.exchange(wrench, dt, device_state_);
    loop_.pulse_.at(TickPulse::Place::outside);
    return status;
  }

  /// Exchanges zero force until the device allows forces.
  bool wait_until_ready(const StopRequest& stop) noexcept {
    const auto patience_ns = static_cast<std::int64_t>(1e9 * loop_.options_.ready_timeout);
    for (double dt = 0;; dt = 1e-9 * static_cast<double>(period_ns_)) {
      const Device::Status status = exchange({}, dt);
      const bool answers = status == Device::Status::ok;
      if (answers && is_settled(deadline_ns_)) {
        away_since_ns_.reset();
        if (dt > 0)
          push_event(0, {.code = EventCode::device_ready,
                         .values = {1e-9 * static_cast<double>(deadline_ns_ - start_ns_), kNaN, kNaN}});
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

  /// Returns true if the device allows forces and its handle rests; a device that was ready from the start need not
  /// rest.
  bool is_settled(std::int64_t now_ns) noexcept {
    if (!device_state_.ready) rest_.begin();
    moves_ = device_state_.ready && !rest_.update(device_state_.position, now_ns);
    return device_state_.ready && !moves_;
  }

  bool fail(StopCause cause) noexcept {
    report_.cause = cause;
    ended_ = true;
    return false;
  }

  /// Moves `woke_ns` to the end of the exchange if that took longer than a period.
  void tick(std::int64_t& woke_ns, const StopRequest& stop) noexcept {
    const TickScope scope;
    const std::int64_t began_ns = monotonic_ns(), asked_ns = woke_ns;
    const double dt = exchanged_ns_ ? 1e-9 * static_cast<double>(woke_ns - *exchanged_ns_) : 0;
    State state = state_before_exchange(woke_ns, dt);
    const Device::Status status = exchange(wrench_, dt);
    const bool blocked = move_past_blocked_exchange(woke_ns, state);
    acting_ = wrench_;
    exchanged_ns_ = woke_ns;
    // A device that was away stays away until it is homed and its handle rests.
    if (status != Device::Status::ok || (away_since_ns_ && !is_settled(woke_ns))) {
      silent_ = false;
      sequence_ = 0;  // it may be another device
      do_without(status, woke_ns, state.time_ns, stop);
      return;
    }
    if (!device_state_.ready) {
      // A device that is not ready guarantees nothing about its position.
      stop_now(StopCause::device_not_ready, {.code = EventCode::device_not_ready}, state.time_ns);
      return;
    }
    std::int64_t age_ns = this->age_ns();
    if (!is_fresh(age_ns)) {
      endure_stale(woke_ns, dt, state.time_ns, stop);
      report_.latency.record(woke_ns - deadline_ns_);
      report_.tick_time.record(monotonic_ns() - began_ns);
      return;
    }
    state.dt = updated_ns_ ? 1e-9 * static_cast<double>(woke_ns - *updated_ns_) : 0;
    if (!take_measured(state)) return;
    account_for_gap(state, woke_ns);
    if (blocked && age_ns == 0) age_ns = likely_age_ns(state.position, asked_ns, woke_ns);
    state.velocity = velocity_ = loop_.estimator_.update(state.position, sample_dt(woke_ns - age_ns));
    position_ = state.position;
    updated_ns_ = woke_ns;
    sequence_ = device_state_.sequence;
    stale_ = false;
    silence_ = 0;
    keep(state, decide(state, stop), woke_ns);
    report_.tick_time.record(monotonic_ns() - began_ns);
  }

  /// Returns the state of a tick without measured values: its time, and the force that the exchange sends. `dt` is the
  /// time since the last exchange [s].
  [[nodiscard]] State state_before_exchange(std::int64_t woke_ns, double dt) noexcept {
    State state;
    state.tick = tick_;
    state.time_ns = woke_ns - start_ns_;
    if (!exchanged_ns_) begun_ns_ = woke_ns;
    // After a time without ticks the hand may be anywhere, so the last force no longer fits.
    if (woke_ns - exchanged_ns_.value_or(woke_ns) > stale_after_ns_) {
      tell_of_held_force(dt, state.time_ns);
      wrench_ = {};
    }
    state.force_applied = wrench_.force;
    state.share_applied = share_;
    state.softened = guard_ && guard_->share() < 1;
    state.vibrated = guard_ && guard_->vibrated();

    // The force on a device that is away is unknown, so this time does not count as cooling of its motors.
    if (!away_since_ns_) {
      limiter_.acted(acting_.force, dt);
      if (takes_torque_) torque_limiter_.acted(acting_.torque, dt);
    }
    return state;
  }

  /// Returns true if the exchange that just ended took longer than a period. Moves the tick to its end then.
  [[nodiscard]] bool move_past_blocked_exchange(std::int64_t& woke_ns, State& state) noexcept {
    const std::int64_t took_ns = clock_.now() - woke_ns;
    if (took_ns <= period_ns_ || first_) return false;
    // The state is no older than the end of the exchange, and the next tick is due later.
    woke_ns = last_ns_ = woke_ns + took_ns;
    state.time_ns = woke_ns - start_ns_;
    took_ = 1e-9 * static_cast<double>(took_ns);
    if (took_ns > stale_after_ns_) tell_of_held_force(took_, state.time_ns);
    return true;
  }

  /// Copies the measured values into `state`. Ends the session and returns false if the position is invalid.
  [[nodiscard]] bool take_measured(State& state) noexcept {
    state.position = device_state_.position;
    state.orientation = as_measured(device_state_.orientation);
    state.force_measured = as_measured(device_state_.force);
    state.buttons = device_state_.buttons;

    if (!is_finite(state.position)) {
      // Store no sample for this tick: the loop does not invent a position, and nothing may be computed from this one.
      stop_now(StopCause::not_finite, {.code = EventCode::not_finite, .values = {0, kNaN, kNaN}}, state.time_ns);
      return false;
    }
    if (const double distance = norm_of(state.position - centre_); !(distance <= farthest_)) {
      stop_now(StopCause::outside_workspace,
               {.code = EventCode::outside_workspace, .values = {distance, farthest_, kNaN}}, state.time_ns);
      return false;
    }
    return true;
  }

  /// Handles the time since the last fresh state: a return of the device, a gap, or a usual step.
  void account_for_gap(State& state, std::int64_t woke_ns) noexcept {
    if (away_since_ns_) {
      come_back(state, woke_ns);
    } else if (updated_ns_ && woke_ns - *updated_ns_ > stale_after_ns_) {
      (void)ends_in_gap();  // store this sample: it holds the force that was sent last
      catch_up_after_gap(state);
    } else {
      sparse_ = std::max(sparse_ - state.dt, 0.0);
    }
  }

  /// Returns the age of the state that was just exchanged. An age that is negative or NaN counts as 0.
  [[nodiscard]] std::int64_t age_ns() const noexcept {
    constexpr double kLongest = 3600;  // [s]
    return device_state_.age > 0 ? static_cast<std::int64_t>(1e9 * std::min(device_state_.age, kLongest)) : 0;
  }

  /// Returns true if the state is a new sample and young enough.
  [[nodiscard]] bool is_fresh(std::int64_t age_ns) const noexcept {
    return (device_state_.sequence == 0 || device_state_.sequence != sequence_) && age_ns <= stale_after_ns_;
  }

  /// Returns the time between the sample taken at `taken_ns` and the last one [s]. If the arrival of samples defines
  /// their time, two of them may arrive in less than half a period, although the device did not take them so fast. Such
  /// a sample counts as taken later, which makes the next interval shorter by the same amount.
  [[nodiscard]] double sample_dt(std::int64_t taken_ns) noexcept {
    if (device_state_.sequence != 0 && updated_ns_) taken_ns = std::max(taken_ns, taken_ns_ + period_ns_ / 2);
    return 1e-9 * static_cast<double>(taken_ns - std::exchange(taken_ns_, taken_ns));
  }

  /// Estimates the age of a state that an exchange from `asked_ns` to `now_ns` returned, if the hand kept its speed.
  /// The true time in that interval is unknown. If the age were underestimated, the hand would seem to stop and then to
  /// jump in the next tick.
  [[nodiscard]] std::int64_t likely_age_ns(const Vec3& position, std::int64_t asked_ns, std::int64_t now_ns) noexcept {
    const double along = (position - position_).dot(velocity_), speed2 = velocity_.squaredNorm();
    if (!(along > 0) || !(speed2 > 0) || resumes_) return 0;
    const auto moved_for_ns = static_cast<std::int64_t>(std::min(1e9 * along / speed2, 1e12));
    return now_ns - std::clamp(taken_ns_ + moved_for_ns, asked_ns, now_ns);
  }

  /// Logs that the motors held the last force while nothing could be sent.
  void tell_of_held_force(double seconds, std::int64_t time_ns) noexcept {
    if (const double force = norm_of(acting_.force); force > kReleasedForce)
      push_event(time_ns, {.code = EventCode::force_held, .values = {seconds, force, kNaN}});
  }

  /// Handles a tick without a fresh state: holds the last force for a while, then fades it.
  void endure_stale(std::int64_t woke_ns, double dt, std::int64_t time_ns, const StopRequest& stop) noexcept {
    ++report_.stale;
    const std::int64_t silent_ns = woke_ns - updated_ns_.value_or(begun_ns_);
    const double stale_after = 1e-9 * static_cast<double>(stale_after_ns_);
    silence_ += std::min(dt, stale_after);  // without ticks the device could not answer
    if (silent_ns > stale_after_ns_) {
      if (!std::exchange(stale_, true)) {
        stale_wrench_ = wrench_;
        stale_fade_ = Ramp(1);
        if (!away_since_ns_)
          push_event(time_ns, {.code = EventCode::states_stopped,
                               .values = {1e-9 * static_cast<double>(silent_ns), kNaN, kNaN}});
      }
      const double share = stale_fade_.advance(0, dt, kStaleFade);
      wrench_ = {share * stale_wrench_.force, share * stale_wrench_.torque};
    }
    if (stop.count() > 1 || (stop.count() > 0 && mode_ == Mode::running && is_released(wrench_))) {
      stop_now(StopCause::interrupted, interruption(stop), time_ns);
    } else if (is_released(wrench_) && ends_in_gap()) {
      return;
    } else if (silence_ > std::max(kSilence, 1e-9 * static_cast<double>(kSilentPeriods * period_ns_))) {
      silent_ = true;
      do_without(Device::Status::away, woke_ns, time_ns, stop);
    }
  }

  /// Ends the session and returns true if its forces were already fading out: after the gap they are zero.
  bool ends_in_gap() noexcept {
    if (mode_ == Mode::running) return false;
    wrench_ = {};
    return ended_ = true;
  }

  /// Handles the first fresh state after a gap without fresh states or ticks.
  void catch_up_after_gap(State& state) noexcept {
    push_event(state.time_ns, {.code = EventCode::states_resumed, .values = {state.dt, kNaN, kNaN}});
    ++report_.gaps;
    report_.away += state.dt;
    // Count only the part of the gap that the device caused: it was asked, or it delayed an exchange. A single gap,
    // however long, says nothing about the samples that follow.
    last_gap_ = state.dt;
    sparse_ += std::min(std::isfinite(took_) ? took_ : silence_, kSilence);
    start_anew(state);
  }

  /// Discards all state from before a gap, because the hand may have moved. Forces fade in from zero.
  void start_anew(State& state) noexcept {
    resumes_ = true;
    wrench_ = {};
    fade_ = Ramp();
    state.dt = 0;
    state.force_applied = Vec3::Zero();
    state.share_applied = 0;
    loop_.estimator_.reset();
  }

  /// Returns true if the loop no longer waits for a device that answers `status`.
  bool is_given_up(Device::Status status, std::int64_t now_ns) noexcept {
    if (!away_since_ns_) away_since_ns_ = now_ns;
    const double away = 1e-9 * static_cast<double>(now_ns - *away_since_ns_);
    const bool impatient = away >= loop_.options_.away_timeout;
    if (impatient) waited_in_vain_ = away;
    answers_ = status == Device::Status::ok;
    return impatient || status == Device::Status::lost;
  }

  /// Handles a tick without the device: stores no sample, and leaves zero force for the device's return.
  void do_without(Device::Status status, std::int64_t woke_ns, std::int64_t time_ns, const StopRequest& stop) noexcept {
    const bool just_lost = !away_since_ns_;
    wrench_ = {};
    // If forces were already fading out, there is nothing to continue.
    if (is_given_up(status, woke_ns) || mode_ != Mode::running) {
      const double waited = waited_in_vain_ > 0 ? waited_in_vain_ : kNaN;
      stop_now(StopCause::device_lost, {.code = EventCode::device_lost, .values = {waited, kNaN, kNaN}}, time_ns);
    } else {
      if (just_lost) push_event(time_ns, {.code = EventCode::device_lost});
      if (stop.count() > 0) stop_now(StopCause::interrupted, interruption(stop), time_ns);
    }
  }

  void come_back(State& state, std::int64_t woke_ns) noexcept {
    const double gap = 1e-9 * static_cast<double>(woke_ns - *away_since_ns_);
    away_since_ns_.reset();
    push_event(state.time_ns, {.code = EventCode::device_found, .values = {gap, kNaN, kNaN}});
    ++report_.returns;
    if (first_) return;
    report_.away += gap;
    start_anew(state);
  }

  /// Returns the controller's answer after checking everything that can end the session. Sets wrench_.
  Command decide(const State& state, const StopRequest& stop) noexcept {
    loop_.pulse_.at(TickPulse::Place::controller);
    if (first_) {
      loop_.controller_.start(state);
      push_event(state.time_ns, {.code = EventCode::started});
    } else if (std::exchange(resumes_, false)) {
      loop_.controller_.resume(state);
    }
    stop_before_the_controller(state, stop);
    // After a limit trips, the loop stops calling the controller.
    Command command = ended_ || mode_ == Mode::fading ? stopped_ : loop_.controller_.update(state);
    // When the loop itself takes the force away, the load falls although no hand lets go.
    if (mode_ != Mode::running && command.event && command.event->code == EventCode::hand_let_go) command.event.reset();
    if (command.event) push_event(state.time_ns, *command.event);

    if (!is_finite(command.wrench.force) || !is_finite(command.wrench.torque)) {
      stop_now(StopCause::not_finite, {.code = EventCode::not_finite, .values = {1, kNaN, kNaN}}, state.time_ns);
    } else if (mode_ == Mode::running && !ended_) {
      if (const auto fault = fault_of(command.status)) {
        begin_fading(*fault, command);
        fault_ = command.event;
      } else if (stop.count() > 0) {
        begin_release(StopCause::interrupted, interruption(stop), state.time_ns);
      } else if (command.status == Command::Status::finished) {
        begin_release(StopCause::finished, {.code = EventCode::finished}, state.time_ns);
      }
    }
    // The force would restart its fade-in after every gap and never arrive, while the session would seem to play.
    if (sparse_ > kSparse && mode_ == Mode::running && !ended_ && !is_released(command.wrench)) {
      sparse_gap_ = last_gap_;
      stop_now(StopCause::device_lost, {.code = EventCode::device_lost}, state.time_ns);
    }
    hurries_ = stop.count() > 0;
    if (!ended_) shape(command, state);
    if (mode_ == Mode::releasing) command.phase = Phase::release;
    if (mode_ == Mode::fading || report_.stopped_by_fault()) command.phase = Phase::stopped;
    return command;
  }

  /// Ends the session if the state or the caller requires it, whatever the controller would answer.
  void stop_before_the_controller(const State& state, const StopRequest& stop) noexcept {
    const double speed = norm_of(state.velocity), fastest = loop_.options_.limits.max_velocity;
    if (fastest > 0 && speed > fastest)
      stop_now(StopCause::velocity, {.code = EventCode::velocity_limit, .values = {speed, fastest, kNaN}},
               state.time_ns);
    else if (stop.count() > 1)
      stop_now(StopCause::interrupted, interruption(stop), state.time_ns);
  }

  /// Returns the event of a stop that was asked for.
  static Event interruption(const StopRequest& stop) noexcept {
    return {.code = EventCode::interrupted, .values = {static_cast<double>(stop.source()), kNaN, kNaN}};
  }

  void begin_release(StopCause cause, const Event& event, std::int64_t time_ns) noexcept {
    mode_ = Mode::releasing;
    report_.cause = cause;
    push_event(time_ns, event);
  }

  /// Turns the requested force into the force to send: fades it, then limits it.
  void shape(const Command& command, const State& state) noexcept {
    const SafetyLimits& limits = loop_.options_.limits;
    const double dt = first_ ? 0 : state.dt;
    if (command.renewed && guard_)
      if (const auto event = guard_->renew()) push_event(state.time_ns, *event);
    Wrench asked = guard_ ? guard_->soften(command.wrench, command.feedforward) : command.wrench;
    double scale = 1;
    switch (mode_) {
      case Mode::running:
        scale = fade_.advance(1, dt, limits.soft_start);
        break;
      case Mode::releasing:
        // A user's request to stop takes effect quickly, whatever the session's own fade is.
        scale = fade_.advance(0, dt, hurries_ ? std::min(limits.release, kLongestRelease) : limits.release);
        break;
      case Mode::fading:
        // The controller's force is no longer trusted. Fade the force that was sent last.
        if (!fault_wrench_) {
          fault_wrench_ = wrench_;
          fault_support_ = support_;
          fade_ = Ramp(1);
        }
        scale = fade_.advance(0, dt, kFaultFade);
        asked = *fault_wrench_;
        break;
    }
    // Request nothing on axes without a motor: it would use up the limit of the others.
    const DeviceInfo& device = loop_.device_.info();
    for (int axis = 0; axis < 3; ++axis) {
      const auto i = static_cast<std::size_t>(axis);
      if (!device.force_axes[i]) asked.force[axis] = 0;
      if (!device.torque_axes[i]) asked.torque[axis] = 0;
    }
    ForceLimiter::Result torque{Vec3::Zero(), 0, 0, ForceLimiter::Verdict::free};
    if (takes_torque_) torque = torque_limiter_.limit(scale * asked.torque);
    if (scale < 1 && limits.max_force > 0) asked.force = shortened(asked.force, kMostAsked * limits.max_force);
    const auto [force, share] =
        limited(scale * asked.force, scale * (fault_wrench_ ? fault_support_ : command.support));
    wrench_ = {force.force, torque.force};
    share_ = scale * share * (guard_ ? guard_->share() : 1);
    if (force.verdict != ForceLimiter::Verdict::free) tell_of_limit(force, state.time_ns);
    if (torque.verdict == ForceLimiter::Verdict::continuous) tell_of_torque(torque, state.time_ns);
    if (const auto event = budget_.update(limiter_, norm_of(wrench_.force))) push_event(state.time_ns, *event);
    if (mode_ == Mode::running) {
      // A force that reverses several times a second does not come from a hand: the loop oscillates.
      steady_ += std::min(dt / kSteadyTime, 1.0) * (wrench_.force - steady_);
      const bool steady = norm_of(steady_) > kSteadyShare * norm_of(wrench_.force);
      const bool held_back = (limiter_.holds_back(force) && steady) || torque_limiter_.holds_back(torque);
      const auto verdict = resistance_.update(held_back || command.resisted, command.patience, dt);
      watch_resistance(verdict, held_back, command, state.time_ns);
    }
    if (guard_ && mode_ != Mode::fading)
      watch_vibration(command, share * (scale * (asked.force - command.feedforward)), state);

    if (mode_ != Mode::running && (scale == 0 || is_released(wrench_))) {
      wrench_ = {};
      ended_ = true;
    }
  }

  struct Limited {
    ForceLimiter::Result force;
    double share;  ///< of the force beside the support that may be sent
  };

  /// Limits a force with `support` in it, which may be NaN, and sets the part of it that carries an arm. An arm must
  /// not drop because something else asks for much: the limit reduces the rest first.
  [[nodiscard]] Limited limited(const Vec3& force, const Vec3& support) noexcept {
    Limited result{limiter_.limit(force), 1};
    support_ = support;
    if (result.force.verdict == ForceLimiter::Verdict::free) return result;
    const double allowed = result.force.allowed;
    result.share = allowed / result.force.asked;
    if (!is_finite(support) || support.isZero(0) || !(norm_of(support) < allowed)) {
      support_ *= result.share;
      return result;
    }
    // |support + share rest| = allowed
    const Vec3 rest = force - support;
    const double a = rest.squaredNorm(), b = support.dot(rest), c = support.squaredNorm() - allowed * allowed;
    result.share = (std::sqrt(b * b - a * c) - b) / a;
    result.force.force = support + result.share * rest;
    return result;
  }

  /// Starts the end after a fault: the last force fades, and the loop stops calling the controller.
  void begin_fading(StopCause cause, const Command& command) noexcept {
    mode_ = Mode::fading;
    report_.cause = cause;
    stopped_ = command;
    stopped_.event.reset();
  }

  /// Reports a hand that does not yield, and ends the session when the controller's patience is over.
  void watch_resistance(ResistanceTimer::Verdict verdict, bool held_back, const Command& command,
                        std::int64_t time_ns) noexcept {
    if (verdict == ResistanceTimer::Verdict::none) return;
    if (verdict == ResistanceTimer::Verdict::begins) {
      const double settles = std::min(limiter_.allowed(), loop_.options_.limits.max_continuous_force);
      push_event(time_ns, {.code = EventCode::force_resisted,
                           .values = {held_back ? settles : kNaN, command.patience - resistance_.count(), kNaN}});
      return;
    }
    begin_fading(StopCause::resistance, command);
    push_event(time_ns, {.code = EventCode::resistance_limit, .values = {resistance_.count(), kNaN, kNaN}});
  }

  /// Passes the sent force to the guard. `sent` is the part of it that is no feedforward.
  void watch_vibration(const Command& command, const Vec3& sent, const State& state) noexcept {
    Wrench feedback = wrench_;
    if (!command.feedforward.isZero(0)) feedback.force = sent;
    const auto event = guard_->watch(feedback, state.position, command.vibration, state.dt);
    if (!event) return;
    if (guard_->beyond_help() && mode_ == Mode::running) begin_fading(StopCause::oscillation, command);
    push_event(state.time_ns, *event);
  }

  static bool is_released(const Wrench& wrench) noexcept {
    return norm_of(wrench.force) < kReleasedForce && norm_of(wrench.torque) < kReleasedTorque;
  }

  void tell_of_limit(const ForceLimiter::Result& limited, std::int64_t time_ns) noexcept {
    if (!is_time_to_tell(force_told_ns_, time_ns)) return;
    if (limited.verdict == ForceLimiter::Verdict::peak) {
      push_event(time_ns, {.code = EventCode::force_limit, .values = {limited.asked, limited.allowed, kNaN}});
    } else {
      // Report the source of the limit only once.
      const double assumed = std::exchange(assumed_continuous_force_, kNaN);
      push_event(time_ns, {.code = EventCode::continuous_limit, .values = {limited.allowed, assumed, kNaN}});
    }
  }

  void tell_of_torque(const ForceLimiter::Result& limited, std::int64_t time_ns) noexcept {
    if (is_time_to_tell(torque_told_ns_, time_ns))
      push_event(time_ns, {.code = EventCode::continuous_limit, .values = {limited.allowed, kNaN, 1}});
  }

  /// Returns true if the last report of this limit is old enough, and then counts the limit as reported now.
  static bool is_time_to_tell(std::optional<std::int64_t>& told_ns, std::int64_t time_ns) noexcept {
    if (told_ns && time_ns - *told_ns < static_cast<std::int64_t>(1e9 * kEventSpacing)) return false;
    told_ns = time_ns;
    return true;
  }

  /// Ends the session at this tick with zero force. If the session already ends for this cause or for a limit, only the
  /// loss of the device is reported in addition.
  void stop_now(StopCause cause, const Event& event, std::int64_t time_ns) noexcept {
    wrench_ = {};
    ended_ = true;
    const bool ends_already = mode_ == Mode::fading || (mode_ == Mode::releasing && report_.cause == cause);
    if (ends_already && cause != StopCause::device_lost) return;
    report_.cause = cause;
    push_event(time_ns, event);
  }

  /// Passes the sample of this tick to all sinks.
  void keep(const State& state, const Command& command, std::int64_t woke_ns) noexcept {
    const std::int64_t latency_ns = woke_ns - deadline_ns_;
    Sample sample;
    sample.tick = state.tick;
    sample.time_ns = state.time_ns;
    sample.position = state.position;
    sample.velocity = state.velocity;
    sample.force = wrench_.force;
    sample.orientation = state.orientation;
    if (takes_torque_) sample.torque = wrench_.torque;
    sample.force_measured = state.force_measured;
    sample.support = ended_ ? Vec3(0 * support_) : support_;
    sample.reference_position = command.reference.position;
    sample.reference_velocity = command.reference.velocity;
    sample.reference_force = command.reference_force;
    sample.reference_orientation = command.reference_orientation;
    sample.progress = command.progress;
    sample.tunnel_radius = command.tunnel_radius;
    // A force that fades after a fault, or that ended, does not respond to the position.
    const double feedback = mode_ == Mode::fading || ended_ ? 0 : share_;
    sample.kp = feedback * command.kp;
    sample.kd = feedback * command.kd;
    sample.buttons = state.buttons;
    sample.phase = ended_ && report_.stopped_by_fault() ? Phase::stopped : command.phase;
    sample.latency = 1e-9F * static_cast<float>(latency_ns);

    loop_.pulse_.at(TickPulse::Place::sinks);
    if (first_ && !loop_.options_.virtual_time)
      for (SampleSink* sink : loop_.sinks_) sink->start(start_ns_);
    for (ContactSample contact : command.contacts) {
      contact.tick = sample.tick;
      contact.time_ns = sample.time_ns;
      for (SampleSink* sink : loop_.sinks_) sink->push_contact(contact);
    }
    for (SampleSink* sink : loop_.sinks_) sink->push(sample);
    loop_.pulse_.at(TickPulse::Place::outside);
    flight_.push(sample);

    report_.latency.record(latency_ns);
    report_.max_force = std::max(report_.max_force, norm_of(wrench_.force));
    ++report_.samples;
    report_.duration = 1e-9 * static_cast<double>(state.time_ns);
    first_ = false;
  }

  /// Moves to the first deadline that is still to come, and counts those before it as missed. A tick right after a late
  /// one is missed too: the device would have had no time to move, and the position would be differentiated over
  /// microseconds.
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
                  .values = {static_cast<double>(missed), 1e-9 * static_cast<double>(late), took_}});
    }
    took_ = kNaN;
  }

  void push_event(std::int64_t time_ns, Event event) noexcept {
    event.time_ns = time_ns;
    if (!fault_ && report_.stopped_by_fault()) fault_ = event;
    for (SampleSink* sink : loop_.sinks_) sink->push(event);
  }

  /// Sends the last force of the session. A lost device does not receive it; its own watchdog must act.
  void send_zero() noexcept {
    wrench_ = {};
    (void)exchange(wrench_, 0);
  }

  ServoLoop& loop_;
  ServoClock& clock_;
  ServoReport& report_;
  static constexpr std::int64_t kSilentPeriods = 5;

  const std::int64_t period_ns_, stale_after_ns_;
  const Vec3 centre_;      ///< centre of the workspace [m]
  const double farthest_;  ///< largest distance of a valid position from there [m]
  bool takes_torque_;      ///< the device takes a torque about some axis
  ForceLimiter limiter_, torque_limiter_;
  MotorBudget budget_;
  ResistanceTimer resistance_;
  std::optional<ForceGuard> guard_;
  FlightRecorder flight_;

  Mode mode_ = Mode::running;
  bool ended_ = false;
  bool first_ = true;
  std::uint64_t tick_ = 0;
  std::int64_t start_ns_ = 0, deadline_ns_ = 0;
  std::int64_t last_ns_ = 0;                  ///< wake-up of the last tick
  std::optional<std::int64_t> exchanged_ns_;  ///< tick of the last exchange
  std::optional<std::int64_t> updated_ns_;    ///< tick of the last fresh state
  std::int64_t begun_ns_ = 0;                 ///< first tick
  std::int64_t taken_ns_ = 0;                 ///< time at which the device took that state
  std::uint64_t sequence_ = 0;                ///< sequence number of that state
  double silence_ = 0;                        ///< time without a fresh state while ticks ran [s]
  double sparse_ = 0, last_gap_ = 0;          ///< time in gaps beyond the time between them, and the last gap [s]
  std::optional<double> sparse_gap_;          ///< gap between samples that ended the session [s]
  bool stale_ = false;                        ///< no fresh state for so long that the force fades
  Wrench stale_wrench_;                       ///< force from which it fades
  Ramp stale_fade_{1};
  std::optional<std::int64_t> away_since_ns_;  ///< first tick without the device
  double waited_in_vain_ = 0;                  ///< time that the loop waited for a device that stayed away [s]
  bool answers_ = false;                       ///< the device answers again, but is not ready
  bool silent_ = false;                        ///< the device answers, but with the same state
  RestWatch rest_;
  bool moves_ = false;    ///< the handle moves, although the device is ready
  bool resumes_ = false;  ///< the controller resumes at this tick
  bool hurries_ = false;  ///< the user asked for the end, before it or during the fade
  std::optional<Event> fault_;
  DeviceState device_state_;
  Wrench wrench_;                               ///< wrench for the next exchange
  double share_ = 0;                            ///< share of the command's feedback force in it
  Wrench acting_;                               ///< wrench of the last exchange
  Vec3 steady_ = Vec3::Zero();                  ///< sent force after a low pass [N]
  Vec3 position_ = nan3(), velocity_ = nan3();  ///< position and velocity of the last fresh state
  double took_ = kNaN;  ///< duration of this tick's exchange, if it was longer than a period [s]
  Ramp fade_;
  std::optional<Wrench> fault_wrench_;  ///< last wrench before the fault
  Vec3 support_ = nan3();               ///< part of wrench_ that carries the arm [N]
  Vec3 fault_support_ = nan3();         ///< ... before the fault
  Command stopped_;                     ///< the controller's last answer, after it stopped the session
  std::optional<std::int64_t> force_told_ns_, torque_told_ns_;  ///< last reports of a limit that binds
  double assumed_continuous_force_ = loop_.assumed_continuous_force_ > 0 ? loop_.assumed_continuous_force_ : kNaN;
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
      report.detail = report.samples > 0
                          ? "the device no longer allows forces" + not_ready_hint()
                          : fmt::format("the device did not become ready within {} s{}", options_.ready_timeout,
                                        session.moves() ? fmt::format("; {}", kMoves) : not_ready_hint());
  } else if (report.cause == StopCause::interrupted) {
    report.stopped_from = stop.source();
    report.detail = interruption_text(report.stopped_from);
  }
  return report;
}

}  // namespace haptrace
