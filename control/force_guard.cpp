#include "control/force_guard.h"

namespace haptrace {
namespace {

constexpr double kTorqueCutoff = 20;     // [Hz]
constexpr double kLargestTorque = 1e12;  // largest torque that single precision can square [N m]

}  // namespace

ForceGuard::ForceGuard(const ForceGuardOptions& options)
    : monitor_(options.monitor), torque_limit_(static_cast<float>(0.2 * options.max_torque)) {
  if (options.max_torque > 0) torque_.emplace(kTorqueCutoff, options.monitor.rate_hz);
}

std::optional<Event> ForceGuard::watch(const Wrench& sent, const Vec3& position, double declared, double dt) noexcept {
  std::optional<VibrationAlarm> alarm = monitor_.update(sent.force, position, declared, dt);
  if (torque_ && is_finite(sent.torque)) {
    const Vec3 torque = sent.torque.cwiseMax(-kLargestTorque).cwiseMin(kLargestTorque);
    const Eigen::Array4f x(static_cast<float>(torque.x()), static_cast<float>(torque.y()),
                           static_cast<float>(torque.z()), 0.0F);
    const bool vibrates = torque_->update(x, torque_limit_, 0.5F * torque_limit_, static_cast<float>(dt));
    const bool remains = !vibrates && ladder_.softened() && torque_->remains();
    if ((vibrates || remains) && (!alarm || alarm->rule == VibrationRule::slow))
      alarm = VibrationAlarm{.rule = VibrationRule::torque,
                             .frequency_hz = torque_->frequency(),
                             .ripple = torque_->rms(),
                             .remains = remains};
  }
  if (ladder_.softened() && (!alarm || alarm->rule == VibrationRule::slow))
    if (const auto rest = monitor_.remaining()) alarm = rest;
  const std::optional<Event> event = ladder_.update(alarm, dt);
  if (event && event->code != EventCode::sway_over) {
    summary_.ripple = event->values[0];
    summary_.frequency_hz = event->values[1];
  }
  return event;
}

std::optional<Event> ForceGuard::renew() noexcept {
  const double before = ladder_.target();
  ladder_.renew();
  if (ladder_.target() == before) return std::nullopt;
  return Event{.code = EventCode::feedback_renewed, .values = {before, ladder_.target(), kNaN}};
}

const VibrationSummary& ForceGuard::summary() noexcept {
  summary_.watched = true;
  summary_.share = ladder_.target();
  summary_.worst_ripple = monitor_.worst_ripple();
  summary_.steps = ladder_.steps();
  summary_.ended = ladder_.beyond_help();
  return summary_;
}

}  // namespace haptrace
