#include "control/path/arc_path.h"

#include "base/error.h"
#include "control/path/path.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr double kSpacing = 2.5e-4;     // knot spacing for desktop devices [m]
constexpr double kFewestSegments = 64;  // minimum number of knots along the diagonal of a path's box

}  // namespace

double ArcPath::spacing_for(double extent) {
  return extent > 0 ? std::min(kSpacing, extent / kFewestSegments) : kSpacing;
}

ArcPath::Builder::Builder(double spacing) : spacing_(spacing) {
  if (!(spacing > 0 && std::isfinite(spacing)))
    throw input_error(fmt::format("the spacing of a path is {} m; it must be greater than 0, and finite", spacing));
}

void ArcPath::Builder::close_segment() {
  const Vec3 mean = duration_ > 0 ? Vec3(impulse_ / duration_) : last_force_;
  force_.emplace_back(mean.cast<float>());
  impulse_.setZero();
  duration_ = 0;
}

void ArcPath::Builder::add(double time, const Vec3& position, const Vec3& force) {
  if (position_.empty()) {
    position_.push_back(position);
    time_.push_back(time);
    last_ = position;
    last_force_ = force;
    last_time_ = time;
    return;
  }
  const Vec3 from = last_, way = position - from, change = force - last_force_;
  const double duration = time - last_time_;
  double share = 0;  // fraction of this move that is already added
  const auto walk_to = [&](double to) {
    const double elapsed = (to - share) * duration;
    impulse_ += elapsed * (last_force_ + 0.5 * (share + to) * change);
    duration_ += elapsed;
    share = to;
  };
  // Whether another knot follows is asked of the end of the move. The move itself may be so short that its square is 0,
  // and the equation below then has no solution.
  while ((position - position_.back()).norm() > spacing_) {
    // Solves for the point where the move leaves the sphere around the last knot: |from + u way - knot| = spacing.
    const Vec3 offset = from - position_.back();
    const double a = way.squaredNorm(), b = offset.dot(way), c = offset.squaredNorm() - spacing_ * spacing_;
    const double leaves = (-b + std::sqrt(std::max(b * b - a * c, 0.0))) / a;
    walk_to(leaves > share ? std::min(leaves, 1.0) : share);
    position_.emplace_back(from + share * way);
    time_.push_back(last_time_ + share * duration);
    close_segment();
  }
  walk_to(1);
  last_ = position;
  last_force_ = force;
  last_time_ = time;
}

ArcPath ArcPath::Builder::finish(double radius) {
  if (position_.empty()) throw input_error("a path without samples cannot guide a hand");
  // Adds the end point unless it coincides with the last knot. A path without length still needs one force.
  const double rest = (last_ - position_.back()).norm();
  if (rest > 1e-6 * spacing_) {
    position_.push_back(last_);
    time_.push_back(last_time_);
    close_segment();
  } else if (force_.empty()) {
    close_segment();
  }

  ArcPath path;
  path.spacing_ = spacing_;
  if (const std::size_t n = position_.size(); n > 1)
    path.length_ = spacing_ * static_cast<double>(n - 2) + (position_[n - 1] - position_[n - 2]).norm();
  Box box;
  for (const Vec3& p : position_) box.include(p);
  path.diagonal_ = box.size().norm();
  path.position_ = std::move(position_);
  path.force_ = std::move(force_);
  path.time_ = std::move(time_);
  path.radius_.assign(path.position_.size(), static_cast<float>(radius));
  return path;
}

void ArcPath::set_radius(const std::vector<double>& radius) {
  if (radius.size() != knots())
    throw input_error(fmt::format("{} radii were given for {} knots of a path", radius.size(), knots()));
  for (const double r : radius)
    if (!(r >= 0)) throw input_error(fmt::format("a tunnel has a radius of {} m; it must be at least 0", r));
  std::transform(radius.begin(), radius.end(), radius_.begin(), [](double r) { return static_cast<float>(r); });
}

std::size_t ArcPath::segment_at(double s) const noexcept {
  if (position_.size() < 2 || !(s > 0)) return 0;
  const double i = std::min(s / spacing_, static_cast<double>(position_.size() - 2));
  return static_cast<std::size_t>(i);
}

ArcPath::Where ArcPath::where(double s) const noexcept {
  if (position_.size() < 2) return {};
  const std::size_t i = segment_at(s);
  const double share = (s - knot_at(i)) / segment_length(i);
  return {i, share > 0 ? std::min(share, 1.0) : 0.0};
}

Vec3 ArcPath::position_at(double s) const noexcept {
  if (position_.size() < 2) return position_.front();
  const auto [i, share] = where(s);
  return position_[i] + share * (position_[i + 1] - position_[i]);
}

double ArcPath::radius_at(double s) const noexcept {
  if (position_.size() < 2) return radius_.front();
  const auto [i, share] = where(s);
  return radius_[i] + share * (radius_[i + 1] - radius_[i]);
}

double ArcPath::time_at(double s) const noexcept {
  if (position_.size() < 2) return 0;
  const auto [i, share] = where(s);
  return time_[i] - time_.front() + share * (time_[i + 1] - time_[i]);
}

double ArcPath::place_at(double time) const noexcept {
  if (position_.size() < 2 || !(time > 0)) return 0;
  const double t = time + time_.front();
  if (t >= time_.back()) return length_;
  const auto after = std::upper_bound(time_.begin() + 1, time_.end() - 1, t);
  const auto i = static_cast<std::size_t>(after - time_.begin()) - 1;
  return knot_at(i) + segment_length(i) * (t - time_[i]) / (time_[i + 1] - time_[i]);
}

ArcPath::Place ArcPath::at(double s) const noexcept {
  Place place{.position = position_.front(), .force = force_.front().cast<double>(), .radius = radius_.front()};
  if (position_.size() < 2) return place;
  const auto [i, share] = where(s);
  const Vec3 way = position_[i + 1] - position_[i];
  const double length = segment_length(i);
  place.position = position_[i] + share * way;
  place.tangent = way / length;
  place.speed = length / (time_[i + 1] - time_[i]);
  place.radius = radius_[i] + share * (radius_[i + 1] - radius_[i]);
  // Forces are linear between the midpoints of the segments.
  const std::size_t before = share < 0.5 && i > 0 ? i - 1 : i, after = std::min(before + 1, force_.size() - 1);
  const double between = share < 0.5 ? share + 0.5 : share - 0.5;
  const Vec3 f = force_[before].cast<double>();
  place.force = i == 0 && share < 0.5 ? f : Vec3(f + between * (force_[after].cast<double>() - f));
  return place;
}

ArcPath::Nearest ArcPath::nearest_on(std::size_t i, const Vec3& point) const noexcept {
  if (position_.size() < 2) return {0, (point - position_.front()).squaredNorm()};
  const Vec3 way = position_[i + 1] - position_[i], offset = point - position_[i];
  const double share = std::clamp(offset.dot(way) / way.squaredNorm(), 0.0, 1.0);
  return {knot_at(i) + share * segment_length(i), (offset - share * way).squaredNorm()};
}

ArcPath::Nearest ArcPath::nearest_between(double from, double to, const Vec3& point) const noexcept {
  Nearest best{from, (point - position_at(from)).squaredNorm()};
  for (std::size_t i = segment_at(from), last = segment_at(to); i <= last; ++i) {
    Nearest nearest = nearest_on(i, point);
    if (nearest.s < from || nearest.s > to) {
      nearest.s = std::clamp(nearest.s, from, to);
      nearest.squared_distance = (point - position_at(nearest.s)).squaredNorm();
    }
    if (nearest.squared_distance < best.squared_distance) best = nearest;
  }
  return best;
}

bool is_at_end(double s, double length) noexcept {
  constexpr double kNear = 2e-3, kShare = 0.05;
  return length - s <= std::min(kNear, kShare * length);
}

}  // namespace haptrace
