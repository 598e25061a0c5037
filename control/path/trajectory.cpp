#include "control/path/trajectory.h"

#include "base/error.h"
#include "control/path/min_jerk.h"
#include "control/path/path_smoothing.h"

#include <algorithm>
#include <array>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr double kShortestStep = 1e-9;  // [s]
constexpr double kLongestPath = 1e9;    // [s]

// Derivatives at the end of x = L (t / h)^3, the steepest movement allowed between two samples.
constexpr double kMaxVelocity = 3;      // [L / h]
constexpr double kMaxAcceleration = 6;  // [L / h^2]

std::vector<double> time_from(double begin, const Path& path, std::uint64_t rows_before) {
  std::vector<double> time(path.size());
  for (std::size_t i = 0; i < time.size(); ++i) {
    time[i] = path.time[i] - begin;
    if (i > 0 && !(time[i] - time[i - 1] >= kShortestStep))
      throw input_error(fmt::format(
          "{}: sample {}: time is {} s after the previous sample; steps must be at least 1 ns. Is time in seconds?",
          path.name, rows_before + i + 1, time[i] - time[i - 1]));
  }
  if (!(time.back() <= kLongestPath))
    throw input_error(
        fmt::format("{}: the path lasts {:.3g} s, over 30 years. Is time in seconds?", path.name, time.back()));
  return time;
}

/// Returns the slopes at the knots of the C2 cubic spline through `value` over `time`, given the slopes at both ends.
///
/// At every inner knot i, with h_i = t_{i+1} - t_i, chords d_i and w = h_i / (h_{i-1} + h_i), continuity of the second
/// derivative is  w m_{i-1} + 2 m_i + (1 - w) m_{i+1} = 3 (w d_{i-1} + (1 - w) d_i)  (de Boor, ch. IV). This system is
/// diagonally dominant for any steps, so elimination without pivoting is stable.
std::vector<Vec3> spline_slopes(const std::vector<double>& time, const std::vector<Vec3>& value, const Vec3& first,
                                const Vec3& last) {
  const std::size_t n = time.size();
  std::vector<Vec3> slope(n);
  std::vector<double> upper(n, 0.0);
  slope.front() = first;
  slope.back() = last;
  for (std::size_t i = 1; i + 1 < n; ++i) {
    const double before = time[i] - time[i - 1], after = time[i + 1] - time[i];
    const double w = after / (before + after);
    const Vec3 right = 3 * (w * (value[i] - value[i - 1]) / before + (1 - w) * (value[i + 1] - value[i]) / after);
    const double pivot = 2 - w * upper[i - 1];
    upper[i] = (1 - w) / pivot;
    slope[i] = (right - w * slope[i - 1]) / pivot;
  }
  for (std::size_t i = n - 1; i-- > 1;) slope[i] -= upper[i] * slope[i + 1];
  return slope;
}

/// Bending of the curve on the path's own velocities, the least possible bending, and the bending of a millionth of the
/// speed. A straight line has no other bending, and rounding must not decide the comparison.
struct Bending {
  double own = 0, least = 0, rounding = 0;
};

void add_bending(const Path& path, Bending& sum) {
  const std::vector<double>& time = path.time;
  const std::vector<Vec3>& position = path.position;
  const std::vector<Vec3> smoothest = spline_slopes(time, position, path.velocity.front(), path.velocity.back());
  for (std::size_t i = 0; i + 1 < time.size(); ++i) {
    const double h = time[i + 1] - time[i];
    const Vec3 chord = (position[i + 1] - position[i]) / h;
    const auto bending = [&](const std::vector<Vec3>& slope) {
      const Vec3 a = slope[i] - chord, b = slope[i + 1] - chord;
      return 4 / h * (a.squaredNorm() + a.dot(b) + b.squaredNorm());
    };
    sum.own += bending(path.velocity);
    sum.least += bending(smoothest);
    sum.rounding += 12 / h * chord.squaredNorm() * 1e-12;
  }
}

/// Returns the second derivative of the cubic Hermite curve at its end `here`. `h` is the time from `here` to `there`,
/// negative at the far end.
Vec3 end_acceleration(const Vec3& here, const Vec3& there, const Vec3& v_here, const Vec3& v_there, double h) {
  return (6 * (there - here) / h - 4 * v_here - 2 * v_there) / h;
}

/// Scales every derivative down to at most `largest` / h^power, where h is the longer of the two adjacent steps.
void bound(std::vector<Vec3>& derivative, const std::vector<double>& time, double largest, int power) {
  for (std::size_t i = 0; i < derivative.size(); ++i) {
    const double before = i > 0 ? time[i] - time[i - 1] : 0;
    const double after = i + 1 < time.size() ? time[i + 1] - time[i] : 0;
    const double limit = largest / std::pow(std::max(before, after), power);
    const double length = derivative[i].norm();
    if (length > limit) derivative[i] *= limit / length;
  }
}

/// The quintic Hermite functions of the end at u = 0, with w = 1 - u, for unit velocity and for unit acceleration
/// there, and their derivatives with respect to u. Both vanish with two derivatives at u = 1.
struct QuinticEnd {
  double v, dv, ddv, a, da, dda;

  static constexpr QuinticEnd at(double u, double w) noexcept {
    const double w2 = w * w;
    return {u * w2 * w * (1 + 3 * u), w2 * (1 - 3 * u) * (1 + 5 * u), -12 * u * w * (3 - 5 * u),
            0.5 * u * u * w2 * w,     0.5 * u * w2 * (2 - 5 * u),     w * (1 - 8 * u + 10 * u * u)};
  }
};

bool uses_velocities(Interpolation interpolation) {
  return interpolation == Interpolation::cubic || interpolation == Interpolation::quintic;
}

Reference rest(const Vec3& position) {
  return {position, Vec3::Zero(), Vec3::Zero()};
}

}  // namespace

bool Trajectory::agree(std::span<const Path> stretches) {
  Bending sum;
  for (const Path& stretch : stretches) {
    if (stretch.velocity.empty()) return false;
    add_bending(stretch, sum);
  }
  return sum.own <= kBendingTolerance * sum.least + sum.rounding;
}

Trajectory::Trajectory(const Path& path, Interpolation interpolation)
    : Trajectory(path, interpolation, whole(path, interpolation)) {}

Trajectory::Whole Trajectory::whole(const Path& path, Interpolation interpolation) {
  validate(path);
  return {.begin = path.time.front(),
          .end = path.time.back(),
          .extent = path.bounds().size().norm(),
          .own_velocities = uses_velocities(interpolation) && agree({&path, 1})};
}

Trajectory::Trajectory(const Path& piece, Interpolation interpolation, const Whole& whole)
    : interpolation_(interpolation) {
  validate(piece, whole.rows_before);
  time_ = time_from(whole.begin, piece, whole.rows_before);
  position_ = piece.position;
  if (size() == 1 || !uses_velocities(interpolation)) return;

  const std::size_t n = size();
  // The whole path starts and ends at rest; a piece of it continues.
  const bool starts = piece.time.front() <= whole.begin, ends = piece.time.back() >= whole.end;
  const bool own_velocities = whole.own_velocities && whole.smoothing == 0;
  if (own_velocities) {
    velocity_ = piece.velocity;
  } else {
    position_ = smooth_positions(piece, whole.smoothing, {.begins_at_rest = starts, .ends_at_rest = ends});
    const auto slope = [&](std::size_t i) -> Vec3 {
      return (position_[i + 1] - position_[i]) / (time_[i + 1] - time_[i]);
    };
    velocity_ = spline_slopes(time_, position_, starts ? Vec3::Zero() : slope(0), ends ? Vec3::Zero() : slope(n - 2));
  }
  bound(velocity_, time_, kMaxVelocity * whole.extent, 1);
  if (interpolation == Interpolation::cubic) return;

  Vec3 first = Vec3::Zero(), last = Vec3::Zero();
  if (own_velocities) {
    first = end_acceleration(position_[0], position_[1], velocity_[0], velocity_[1], time_[1] - time_[0]);
    last = end_acceleration(position_[n - 1], position_[n - 2], velocity_[n - 1], velocity_[n - 2],
                            time_[n - 2] - time_[n - 1]);
  }
  acceleration_ = spline_slopes(time_, velocity_, first, last);
  bound(acceleration_, time_, kMaxAcceleration * whole.extent, 2);
}

std::size_t Trajectory::segment_at(double t, std::size_t guess) const noexcept {
  const std::size_t last = size() - 2;
  for (std::size_t i = guess; i <= last && i <= guess + 1; ++i)
    if (time_[i] <= t && t < time_[i + 1]) return i;
  const auto after = std::upper_bound(time_.begin() + 1, time_.end() - 1, t);
  return static_cast<std::size_t>(after - time_.begin()) - 1;
}

Reference Trajectory::sample(double t, Cursor& cursor) const noexcept {
  if (time_.empty()) return {};
  if (!(t >= time_.front())) return rest(position_.front());
  if (t > time_.back() || size() == 1) return rest(position_.back());

  const std::size_t i = cursor.segment = segment_at(t, cursor.segment);
  const double h = time_[i + 1] - time_[i];
  const double u = (t - time_[i]) / h, w = 1 - u;
  const Vec3& p = position_[i];
  const Vec3 d = position_[i + 1] - p;
  Reference r = rest(p);
  switch (interpolation_) {
    case Interpolation::hold:
      break;
    case Interpolation::linear:
      r.position += u * d;
      r.velocity = d / h;
      break;
    case Interpolation::cubic: {
      // The Hermite basis of degree 3, written for the chord d and the end velocities times h.
      const Vec3 a = h * velocity_[i], b = h * velocity_[i + 1];
      r.position += u * u * (3 - 2 * u) * d + u * w * w * a - u * u * w * b;
      r.velocity = (6 * u * w * d + w * (1 - 3 * u) * a + u * (3 * u - 2) * b) / h;
      r.acceleration = ((6 - 12 * u) * d + (6 * u - 4) * a + (6 * u - 2) * b) / (h * h);
      break;
    }
    case Interpolation::quintic: {
      // The Hermite basis of degree 5, written as the rest-to-rest blend s plus the contributions of velocities and
      // accelerations at both ends. The far end is the near end mirrored, t -> -t.
      const MinJerk s = MinJerk::at(u);
      const Vec3 a = h * velocity_[i], b = h * velocity_[i + 1];
      const Vec3 aa = h * h * acceleration_[i], bb = h * h * acceleration_[i + 1];
      const QuinticEnd near = QuinticEnd::at(u, w), far = QuinticEnd::at(w, u);
      r.position += s.s * d + near.v * a - far.v * b + near.a * aa + far.a * bb;
      r.velocity = (s.ds * d + near.dv * a + far.dv * b + near.da * aa - far.da * bb) / h;
      r.acceleration = (s.dds * d + near.ddv * a - far.ddv * b + near.dda * aa + far.dda * bb) / (h * h);
      break;
    }
  }
  // The position at a stamp is bit-exact. Only the last stamp is at the far end of a segment.
  if (t == time_.back()) r.position = position_.back();
  return r;
}

}  // namespace haptrace
