#include "player/supporting_controller.h"

#include "base/error.h"
#include "control/tunnel_wall.h"
#include "devices/device.h"
#include "devices/loop/servo_loop.h"
#include "player/device_path.h"
#include "player/passivity_defaults.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {

SupportingController::SupportingController(Controller& inner, const ArmSupport::Options& support,
                                           const TouchOptions& touch)
    : inner_(inner),
      support_(support),
      planned_(support.force),
      mailbox_(touch.requests),
      rests_in_pause_(touch.rests_in_pause) {}

void SupportingController::forget() noexcept {
  support_.begin();
  carried_.setZero();
}

void SupportingController::start(const State& first) noexcept {
  requests_ = RequestFollower(mailbox_, rests_in_pause_);
  inner_.start(first);
  forget();
}

void SupportingController::resume(const State& first) noexcept {
  inner_.resume(first);
  forget();
}

Command SupportingController::update(const State& state) noexcept {
  requests_.update(state.dt);
  State seen = state;
  if (!state.force_applied.isZero(0)) seen.force_applied -= carried_;  // else nothing acted, as after a gap
  Command command = inner_.update(seen);
  const double asked = requests_.support();
  carried_ = support_.update(state, requests_.wanted_share() > 0, std::isfinite(asked) ? asked : planned_);
  command.wrench.force += carried_;
  command.feedforward += carried_;
  command.support = carried_;
  return command;
}

SupportPlan plan_support(const DeviceInfo& device, const SessionOptions& options) {
  constexpr double kMost = 1000, kStiffest = 150;  // [N], of the end at the top [N/m]
  const SupportOptions& asked = options.support;
  check_range("--support", asked.force, 0, kMost, "N");
  check_motors(device, asked.up, "the support of the arm");
  SupportPlan plan{.support = {.force = asked.force, .up = asked.up}, .because = "largest support", .warnings = {}};
  const SafetyLimits limits = ServoLoop::in_force(device, options.loop.limits);
  const double held = kSupportShare * limits.max_continuous_force, allowed = kSupportShare * limits.max_force;
  const bool holds_less = held > 0 && (allowed <= 0 || held < allowed);
  const double most = holds_less ? held : allowed;
  plan.most = most > 0 ? most : kMost;
  if (most > 0) plan.because = holds_less ? "force that this device can hold for long" : "share of the session's force";
  if (most > 0 && asked.force > most) {
    plan.support.force = most;
    plan.warnings.push_back(fmt::format(
        "the arm is supported with {:.3g} N instead of {:.3g} N: {}", most, asked.force,
        holds_less ? device.model + " can hold no more for long"
                   : fmt::format("the session has {:.3g} N, of which the rest needs some", limits.max_force)));
  }
  const Box workspace = workspace_of(device);
  plan.support.top = asked.up.cwiseProduct(workspace.min).cwiseMax(asked.up.cwiseProduct(workspace.max)).sum();
  const double delay = options.touch.plant ? options.touch.plant->delay : kUnknownDelay;
  plan.support.stiffness = std::clamp(largest_wall_stiffness(options.loop.rate_hz, delay), 1.0, kStiffest);
  return plan;
}

}  // namespace haptrace
