#include "control/hand_watch.h"

#include "base/error.h"
#include "control/filters.h"
#include "control/norm.h"

#include <algorithm>

namespace haptrace {
namespace {

constexpr double kLoadTime = 0.05, kQuickTime = 0.02, kSlowTime = 0.2;  // time constants of the low passes [s]
constexpr double kLetGo = 0.7;                                          // share of the load that falls away
constexpr double kSmallestError = 1e-4;                                 // smallest error with a direction [m]

void low_pass(Vec3& state, const Vec3& input, double dt, double time_constant) noexcept {
  state += low_pass_share(dt, time_constant) * (input - state);
}

}  // namespace

HandWatchOptions hand_watch_of(double max_force) {
  HandWatchOptions options{.needed = 0.25 * max_force};
  options.resisting = std::max(options.resisting, 0.25 * max_force);
  return options;
}

void validate(const HandWatchOptions& options) {
  check_range("hand watch: the needed force [N]", options.needed, 0, 1e3);
  check_range("hand watch: the resisting force [N]", options.resisting, 0.01, 1e3);
  check_range("hand watch: the resistance time [s]", options.resist_time, 0, 60);
  check_range("hand watch: the load that the hand can let go [N]", options.held, 0.01, 1e3);
  check_range("hand watch: the holding time [s]", options.held_time, 0, 60);
}

HandWatch::HandWatch(const HandWatchOptions& options) : options_(options) {
  validate(options_);
}

void HandWatch::reset() noexcept {
  load_ = quick_ = slow_ = Vec3::Zero();
  opposing_ = resisting_for_ = held_for_ = 0;
  resists_ = false;
}

std::optional<Event> HandWatch::update(const Vec3& force, const Vec3& error, const Vec3& disturbance,
                                       double dt) noexcept {
  const Vec3 load = is_finite(disturbance) ? Vec3(-disturbance) : force;
  if (!is_finite(load) || !is_finite(error) || !(dt > 0)) return std::nullopt;
  low_pass(load_, load, dt, kLoadTime);
  low_pass(quick_, load, dt, kQuickTime);
  low_pass(slow_, load, dt, kSlowTime);

  // Only the load along the direction to the reference is resistance.
  const double distance = norm_of(error);
  opposing_ = distance > kSmallestError ? std::max(0.0, load_.dot(error) / distance - options_.needed) : 0;
  std::optional<Event> event;
  if (opposing_ < 0.5 * options_.resisting) resists_ = false;
  resisting_for_ = opposing_ > (resisting_for_ > 0 ? 0.5 : 1) * options_.resisting ? resisting_for_ + dt : 0;
  if (!resists_ && resisting_for_ > options_.resist_time) {
    resists_ = true;
    event = Event{.code = EventCode::hand_resists, .values = {opposing_, resisting_for_, kNaN}};
  }

  const double held = slow_.norm();
  const double left = held > 0 ? quick_.dot(slow_) / held : 0;
  if (held_for_ > options_.held_time && held - left > kLetGo * held) {
    event = Event{.code = EventCode::hand_let_go, .values = {held - left, held, kNaN}};
    held_for_ = 0;
    slow_ = quick_;
  } else {
    held_for_ = held > options_.held && left > 0.5 * options_.held ? held_for_ + dt
                : held > options_.held                             ? held_for_
                                                                   : 0;
  }
  return event;
}

}  // namespace haptrace
