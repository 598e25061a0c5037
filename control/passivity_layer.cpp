#include "control/passivity_layer.h"

#include "control/error.h"

namespace haptrace {
namespace {

const PassivityLayer::Options& checked_layer(const PassivityLayer::Options& options) {
  check_range("the delay", options.delay, 0, 0.1, "s");
  check_range("the rate", options.rate_hz, 10, 20000, "Hz");
  check_range("the damping of the passivity layer", options.max_damping, 0, 1e6, "N s/m");
  return options;
}

}  // namespace

PassivityLayer::PassivityLayer(const Options& options)
    : options_(checked_layer(options)), account_(options.delay, options.rate_hz) {}

void PassivityLayer::reset() noexcept {
  account_.reset();
  energy_ = damping_ = 0;
  direction_.setZero();
}

Vec3 PassivityLayer::update(const State& state, double stored) noexcept {
  damping_ = 0;
  if (!is_finite(state.position) || !is_finite(state.force_applied) || !std::isfinite(stored)) return Vec3::Zero();
  const std::optional<double> given = account_.update(state, stored);
  const Vec3 moved = state.position - position_;
  position_ = state.position;
  if (!given || !(state.dt > 0)) return Vec3::Zero();

  energy_ += *given;
  if (const double force = account_.force().norm(); force > 0)
    direction_ = account_.force() / force;
  else if (stored == 0)
    energy_ = std::max(energy_, 0.0);
  const Vec3 velocity = moved.dot(direction_) / state.dt * direction_;
  damping_ = recovering_damping(energy_, velocity, options_.rate_hz, options_.max_damping);
  return -damping_ * velocity;
}

double bearable_damping(LoopModel device) {
  device.velocity = "difference";
  device.resolution = 0;
  // All but free: without any stiffness a pole of the loop is on the unit circle.
  const double slack = 1e-9 * device.mass * device.rate_hz * device.rate_hz;
  return 0.5 * LoopAnalysis(device).most_damped(slack);
}

}  // namespace haptrace
