#include "devices/haply/homing.h"

namespace haptrace {
namespace {

/// Returns the angles of the arms, positive outward.
Vec2 outward(const Vec2& angles) {
  return {angles[0], -angles[1]};
}

}  // namespace

void StopHoming::update(const Vec2& counted, std::int64_t now_ns) noexcept {
  if (homed_) return;
  const Vec2 out = outward(counted);
  if (!begun_) {
    begun_ = true;
    outermost_ = out;
    resting_ = counted;
    resting_since_ns_ = now_ns;
  }
  outermost_ = outermost_.cwiseMax(out);
  for (int arm = 0; arm < 2; ++arm)
    if (outermost_[arm] - out[arm] > kSwing) swung_[static_cast<std::size_t>(arm)] = true;

  const bool outside = (outermost_ - out).maxCoeff() < kNear;
  if (!outside || (counted - resting_).cwiseAbs().maxCoeff() > kNear) {
    resting_ = counted;
    resting_since_ns_ = now_ns;
  }
  if (!swung_[0] || !swung_[1] || 1e-9 * static_cast<double>(now_ns - resting_since_ns_) < kRest) return;
  correction_ = stops_ - counted;
  homed_ = true;
}

double StopHoming::beyond(const Vec2& counted) const noexcept {
  if (!homed_) return 0;
  const double most = outward(angles(counted) - stops_).maxCoeff();
  return most > kBeyond ? most : 0;
}

}  // namespace haptrace
