#include "control/path/orientation_trajectory.h"

#include "control/norm.h"

#include <algorithm>

namespace haptrace {
namespace {

/// Returns J(r) v with the left Jacobian J of SO(3). Small angles use the series of the coefficients.
Vec3 left_jacobian(const Vec3& r, const Vec3& v) {
  const double angle = r.norm(), square = angle * angle;
  const bool small = angle < 1e-3;
  const double a = small ? 0.5 - square / 24 : (1 - std::cos(angle)) / square;
  const double b = small ? 1.0 / 6 - square / 120 : (angle - std::sin(angle)) / (square * angle);
  const Vec3 once = r.cross(v);
  return v + a * once + b * r.cross(once);
}

/// Returns J(r)^-1 w for an angle of at most pi.
Vec3 left_jacobian_inverse(const Vec3& r, const Vec3& w) {
  const double angle = r.norm(), square = angle * angle;
  const double half = 0.5 * angle;
  const double c = angle < 1e-3 ? 1.0 / 12 + square / 720 : (1 - half / std::tan(half)) / square;
  const Vec3 once = r.cross(w);
  return w - 0.5 * once + c * r.cross(once);
}

}  // namespace

OrientationTrajectory::OrientationTrajectory(const Path& piece, Interpolation interpolation, double begin, double end)
    : interpolation_(interpolation) {
  const std::size_t n = piece.size();
  for (std::size_t i = 0; i < n; ++i) {
    time_.push_back(piece.time[i] - begin);
    orientation_.push_back(piece.orientation[i].normalized());
    if (i > 0 && orientation_[i].dot(orientation_[i - 1]) < 0) orientation_[i].coeffs() *= -1;
  }
  if (interpolation == Interpolation::hold || interpolation == Interpolation::linear) return;

  const auto chord = [&](std::size_t i) -> Vec3 {
    return rotation_between(orientation_[i], orientation_[i + 1]) / (time_[i + 1] - time_[i]);
  };
  rate_.assign(n, Vec3::Zero());
  if (n < 2) return;
  if (piece.time.front() > begin) rate_.front() = chord(0);
  if (piece.time.back() < end) rate_.back() = chord(n - 2);
  for (std::size_t i = 1; i + 1 < n; ++i) {
    const Vec3 before = chord(i - 1), after = chord(i);
    const double span_before = time_[i] - time_[i - 1], span_after = time_[i + 1] - time_[i];
    rate_[i] = shortened((span_after * before + span_before * after) / (span_before + span_after),
                         3 * std::min(before.norm(), after.norm()));
  }
}

OrientationReference OrientationTrajectory::sample(double t, Trajectory::Cursor& cursor) const noexcept {
  if (time_.empty()) return {};
  if (!(t >= time_.front())) return {orientation_.front(), Vec3::Zero()};
  if (t >= time_.back()) return {orientation_.back(), Vec3::Zero()};

  std::size_t i = std::min(cursor.segment, time_.size() - 2);
  if (!(time_[i] <= t && t < time_[i + 1])) {
    const auto after = std::upper_bound(time_.begin() + 1, time_.end() - 1, t);
    i = static_cast<std::size_t>(after - time_.begin()) - 1;
  }
  cursor.segment = i;
  if (interpolation_ == Interpolation::hold) return {orientation_[i], Vec3::Zero()};

  const double h = time_[i + 1] - time_[i], u = (t - time_[i]) / h;
  const Vec3 turn = rotation_between(orientation_[i], orientation_[i + 1]);
  if (interpolation_ == Interpolation::linear) return {quaternion(u * turn) * orientation_[i], turn / h};

  const double w = 1 - u;
  const Vec3 a = h * rate_[i], b = left_jacobian_inverse(turn, h * rate_[i + 1]);
  const Vec3 r = u * u * (3 - 2 * u) * turn + u * w * w * a - u * u * w * b;
  const Vec3 slope = 6 * u * w * turn + w * (1 - 3 * u) * a + u * (3 * u - 2) * b;
  return {quaternion(r) * orientation_[i], left_jacobian(r, slope) / h};
}

}  // namespace haptrace
