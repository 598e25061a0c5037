#include "control/gain_softener.h"

#include "control/error.h"

#include <algorithm>

namespace haptrace {

void validate(const GainSoftenerOptions& options) {
  check_range("gain softener: the factor", options.factor, 0.01, 0.99);
  check_range("gain softener: the least share", options.least, 0.001, 1);
  check_range("gain softener: the ramp [s]", options.ramp, 0, 10);
  check_range("gain softener: the wait [s]", options.wait, options.ramp, 60);
  check_range("gain softener: the time before recovery [s]", options.recover_after, 0, 1e6);
  check_range("gain softener: the time of recovery [s]", options.recover_time, 0.1, 1e6);
}

GainSoftener::GainSoftener(const GainSoftenerOptions& options) : options_(options), since_step_(options.wait) {
  validate(options_);
}

std::optional<Event> GainSoftener::update(const std::optional<OscillationVerdict>& verdict, double dt) noexcept {
  since_step_ += dt;
  since_verdict_ = verdict ? 0 : since_verdict_ + dt;

  std::optional<Event> event;
  if (verdict && since_step_ >= options_.wait && !exhausted_) {
    const double target = std::max(options_.factor * target_, options_.least);
    exhausted_ = target == target_;
    step_ = target_ - target;
    target_ = target;
    since_step_ = 0;
    event = Event{.code = exhausted_ ? EventCode::oscillation_stays : EventCode::oscillation,
                  .values = {verdict->amplitude, verdict->frequency_hz, target_}};
  } else if (options_.recover_after > 0 && since_verdict_ > options_.recover_after && target_ < 1) {
    target_ = std::min(1.0, target_ + dt / options_.recover_time);
    exhausted_ = false;
    share_ = std::max(share_, target_);
  }
  if (share_ > target_) share_ = options_.ramp > 0 ? std::max(target_, share_ - step_ * dt / options_.ramp) : target_;
  return event;
}

}  // namespace haptrace
