#include "control/stand_in_law.h"

#include "control/pd.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace haptrace {
namespace {

Vec3 ratio(const Vec3& of, const Vec3& over) {
  return (over.array() > 0).select(of.cwiseQuotient(over), Vec3::Zero());
}

}  // namespace

StandInLaw::StandInLaw(std::unique_ptr<ForceTerm> law, const PdGains& own, const PdGains& plain)
    : law_(std::move(law)), share_{ratio(plain.kp, own.kp), ratio(plain.kd, own.kd)} {}

void StandInLaw::start(const State& first) noexcept {
  law_->start(first);
  on_path_ = false;
}

Vec3 StandInLaw::force(const TermInput& input) noexcept {
  const bool was_on_path = std::exchange(on_path_, std::isfinite(input.reference.time));
  renewed_ = !stands_in_ && was_on_path && !on_path_ && input.state.vibrated;
  stands_in_ |= renewed_;
  if (!stands_in_) return law_->force(input);
  weight_ = std::min(1.0, weight_ + input.state.dt / kBlend);
  Vec3 plain = pd_force(plain_of(input.tuning), input.state, input.reference);
  if (weight_ == 1) return plain;
  return (1 - weight_) * law_->force(input) + weight_ * plain;
}

PdGains StandInLaw::gains(const Tuning& tuning) const noexcept {
  const PdGains own = law_->gains(tuning), plain = plain_of(tuning);
  return {(1 - weight_) * own.kp + weight_ * plain.kp, (1 - weight_) * own.kd + weight_ * plain.kd};
}

}  // namespace haptrace
