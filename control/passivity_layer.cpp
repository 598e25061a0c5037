#include "control/passivity_layer.h"

#include "base/error.h"
#include "control/design/loop_analysis.h"

namespace haptrace {
namespace {

const PassivityLayer::Options& checked_layer(const PassivityLayer::Options& options) {
  check_range("the delay", options.delay, 0, 0.1, "s");
  check_range("the rate", options.rate_hz, 10, 20000, "Hz");
  check_range("the damping of the passivity layer", options.max_damping, 0, 1e6, "N s/m");
  check_range("the resolution", options.resolution, 0, 0.01, "m");
  return options;
}

}  // namespace

int PassivityLayer::held_ticks(double rate_hz, double resolution) noexcept {
  return std::max(1, static_cast<int>(std::ceil(resolution * rate_hz / kSlowQuantum - 1e-9)));
}

PassivityLayer::PassivityLayer(const Options& options)
    : options_(checked_layer(options)),
      account_(options.delay, options.rate_hz),
      held_ticks_(held_ticks(options.rate_hz, options.resolution)),
      on_its_way_(static_cast<std::size_t>(std::lround(options.delay * options.rate_hz)), Vec3::Zero()) {}

void PassivityLayer::reset() noexcept {
  account_.reset();
  energy_ = 0;
  direction_.setZero();
  begin_at(Vec3::Zero());
  std::fill(on_its_way_.begin(), on_its_way_.end(), Vec3::Zero());
  pending_.setZero();
}

Vec3 PassivityLayer::send(const Vec3& force) noexcept {
  if (on_its_way_.empty()) return force;
  pending_ += force - on_its_way_[next_];
  on_its_way_[next_] = force;
  next_ = (next_ + 1) % on_its_way_.size();
  return force;
}

void PassivityLayer::begin_at(const Vec3& position) noexcept {
  damping_ = span_ = 0;
  ticks_ = 0;
  from_ = position;
  force_.setZero();
}

Vec3 PassivityLayer::update(const State& state, double stored) noexcept {
  if (!is_finite(state.position) || !is_finite(state.force_applied) || !std::isfinite(stored)) {
    damping_ = 0;
    return send(Vec3::Zero());
  }
  const std::optional<double> given = account_.update(state.position, state.force_applied, stored);
  if (!given || !(state.dt > 0)) {
    begin_at(state.position);
    return send(force_);
  }

  energy_ += *given;
  if (const double force = account_.force().norm(); force > 0)
    direction_ = account_.force() / force;
  else if (stored == 0)
    energy_ = std::max(energy_, 0.0);
  span_ += state.dt;
  if (++ticks_ < held_ticks_) return send(force_);

  const Vec3 velocity = (state.position - from_).dot(direction_) / span_ * direction_;
  // The forces under way will take their part if the hand continues to move like this.
  const double rest = energy_ + pending_.dot(velocity) / options_.rate_hz;
  damping_ = recovering_damping(rest, velocity, options_.rate_hz / held_ticks_, options_.max_damping);
  force_ = -damping_ * velocity;
  from_ = state.position;
  ticks_ = 0;
  span_ = 0;
  return send(force_);
}

double bearable_damping(LoopModel device) {
  device.velocity = "difference";
  device.rate_hz /= PassivityLayer::held_ticks(device.rate_hz, device.resolution);
  device.resolution = 0;
  // Almost free: without any stiffness, a pole of the loop is on the unit circle.
  const double slack = 1e-9 * device.mass * device.rate_hz * device.rate_hz;
  return 0.5 * LoopAnalysis(device).most_damped(slack);
}

PassivityLayer::Options passivity_layer_for(LoopModel device) {
  const double delay = device.delay + device.lag;
  device.delay = std::min(device.delay, LoopAnalysis::kLongestDelay / device.rate_hz);
  return {.delay = delay,
          .rate_hz = device.rate_hz,
          .max_damping = bearable_damping(device),
          .resolution = device.resolution};
}

}  // namespace haptrace
