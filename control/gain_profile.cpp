#include "control/gain_profile.h"

#include "control/filters.h"

#include <algorithm>
#include <utility>

namespace haptrace {

PdGains GainTable::at(double time) const noexcept {
  const double last = static_cast<double>(gains.size() - 1);
  const double place = time > 0 ? std::min(time / step, last) : 0;
  const auto i = static_cast<std::size_t>(place);
  if (i + 1 >= gains.size()) return gains.back();
  const double share = place - static_cast<double>(i);
  return {gains[i].kp + share * (gains[i + 1].kp - gains[i].kp), gains[i].kd + share * (gains[i + 1].kd - gains[i].kd)};
}

PdGains GainTable::largest() const noexcept {
  PdGains largest;
  for (const PdGains& one : gains) largest = {largest.kp.cwiseMax(one.kp), largest.kd.cwiseMax(one.kd)};
  return largest;
}

GainSchedule::GainSchedule(GainTable table) : table_(std::move(table)), largest_(table_.largest()) {
  reset(0);
}

PdGains GainSchedule::shares_at(double time) const noexcept {
  const PdGains gains = table_.at(time);
  const auto share = [](const Vec3& gain, const Vec3& largest) {
    Vec3 shares = Vec3::Ones();
    for (int axis = 0; axis < 3; ++axis)
      if (largest[axis] > 0) shares[axis] = gain[axis] / largest[axis];
    return shares;
  };
  return {share(gains.kp, largest_.kp), share(gains.kd, largest_.kd)};
}

PdGains GainSchedule::advance(const PdGains& gains, double time, double dt) noexcept {
  const PdGains wanted = shares_at(time);
  const double blend = setting_share(dt);
  now_.kp += blend * (wanted.kp - now_.kp);
  now_.kd += blend * (wanted.kd - now_.kd);
  return {gains.kp.cwiseProduct(now_.kp), gains.kd.cwiseProduct(now_.kd)};
}

}  // namespace haptrace
