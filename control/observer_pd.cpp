#include "control/observer_pd.h"

#include "control/filters.h"
#include "control/norm.h"

#include <numbers>

namespace haptrace {

ObserverPd::ObserverPd(const Options& options)
    : observer_({.mass = options.design.mass,
                 .delay = options.design.delay,
                 .bandwidth_hz = options.design.observer_hz,
                 .rate_hz = options.rate_hz}),
      driven_((options.design.mass.array() > 0).cast<double>()),
      observer_hz_(options.design.observer_hz),
      authority_(options.design.authority),
      rest_(driven_, options.position_resolution, (1 - kStandingGains) / (1 - kRestGains)) {}

void ObserverPd::start(const State& first) noexcept {
  observer_.start(first.position);
  observer_.set_bandwidth(observer_hz_);
  known_ = load_ = Vec3::Zero();
  rest_.start();
}

Vec3 ObserverPd::force(const TermInput& input) noexcept {
  const auto& [state, reference, tuning, before] = input;
  observer_.update(state.position, state.dt, state.force_applied, known_);
  known_ = before;
  const StateObserver::Estimate estimate = observer_.ahead();

  const double lead = observer_.lead();
  const Vec3 position = reference.position + lead * reference.velocity + 0.5 * lead * lead * reference.acceleration;
  const Vec3 velocity = reference.velocity + lead * reference.acceleration;
  const Vec3 spring = tuning.gains.kp.cwiseProduct(position - estimate.position);
  const Vec3 damping = tuning.gains.kd.cwiseProduct(velocity - estimate.velocity);

  rest_.watch(state, reference);
  const double bandwidth = (rest_.stands() ? Rest::kLeisure : 1.0) * tuning.observer_hz;  // [Hz]
  load_ += low_pass_share(state.dt, 1 / (2 * std::numbers::pi * bandwidth)) * (estimate.load - load_);
  auto [feedback, load] = rest_.forces({spring, damping}, {kRestGains * spring, kRestGains * damping}, load_, state.dt);
  // The force is as noisy as under full gains, and a swing of the device on the friction bristles is noticed in half
  // the time.
  observer_.set_bandwidth(observer_hz_ / gain_share());
  if (const double magnitude = norm_of(load); magnitude > authority_) load *= authority_ / magnitude;
  return driven_.cwiseProduct(feedback) + tuning.observer * load;
}

PdGains ObserverPd::gains(const Tuning& tuning) const noexcept {
  const Vec3 share = gain_share() * driven_;
  return {share.cwiseProduct(tuning.gains.kp), share.cwiseProduct(tuning.gains.kd)};
}

}  // namespace haptrace
