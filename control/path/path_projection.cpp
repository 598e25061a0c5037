#include "control/path/path_projection.h"

#include "control/filters.h"
#include "control/norm.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace haptrace {
namespace {

constexpr double kSpeedTime = 0.02;    // time constant of the foot point's speed [s]
constexpr double kPreference = 0.02;   // a point beyond a rise of the distance must be nearer by this [spacings]
constexpr double kLeap = 1e-3;         // largest move of the foot point in a tick beyond the tool's own move [m]
constexpr double kMostSegments = 128;  // searched per tick; limits the cost on the finest paths

}  // namespace

void PathProjection::start(double s) noexcept {
  foot_ = {};
  foot_.s = std::clamp(s, 0.0, path_->length());
  foot_.place = path_->at(foot_.s);
}

const PathProjection::Foot& PathProjection::update(const Vec3& position, double dt, double from, double to) noexcept {
  if (!is_finite(position)) return foot_;
  // In a long tick the foot point may move at most kLeap farther than the tool; otherwise it would jump round a corner.
  const double moved = (position - foot_.place.position - foot_.offset).norm();
  const double reach = std::min({options_.max_speed * dt, moved + kLeap, kMostSegments * path_->spacing()});
  const double least = std::max(foot_.s - reach, 0.0), most = std::min(foot_.s + reach, path_->length());
  from = std::clamp(from, least, most);
  to = std::clamp(to, from, most);
  // Keeps the current foot point unless another point is nearer, so that it rests unless the tool moves.
  const double now = std::clamp(foot_.s, from, to);
  ArcPath::Nearest best{now, (position - path_->position_at(now)).squaredNorm()};
  look(now, to, false, position, best);
  // At the turn of a retraced stroke both directions are equally near. The forward direction wins.
  look(from, now, true, position, best);
  return stand_at(best.s, position, dt);
}

void PathProjection::look(double from, double to, bool beyond, const Vec3& position,
                          ArcPath::Nearest& best) const noexcept {
  if (!(to > from)) return;
  const double preference = std::pow(kPreference * path_->spacing(), 2);
  for (std::size_t i = path_->segment_at(from), last = path_->segment_at(to); i <= last; ++i) {
    ArcPath::Nearest nearest = path_->nearest_on(i, position);
    if (nearest.s < from || nearest.s > to) {
      nearest.s = std::clamp(nearest.s, from, to);
      nearest.squared_distance = (position - path_->position_at(nearest.s)).squaredNorm();
    }
    if (nearest.squared_distance < best.squared_distance - (beyond ? preference : 0))
      best = nearest;
    else if (nearest.squared_distance > best.squared_distance)
      beyond = true;
  }
}

const PathProjection::Foot& PathProjection::move_to(double s, const Vec3& position, double dt) noexcept {
  return stand_at(std::clamp(s, 0.0, path_->length()), position, dt);
}

const PathProjection::Foot& PathProjection::stand_at(double s, const Vec3& position, double dt) noexcept {
  const double before = std::exchange(foot_.s, s);
  foot_.place = path_->at(s);
  if (dt > 0) {
    const double blend = low_pass_share(dt, kSpeedTime);
    foot_.speed += blend * ((s - before) / dt - foot_.speed);
    foot_.expert_speed += blend * (foot_.place.speed - foot_.expert_speed);
  }
  foot_.offset = position - foot_.place.position;
  foot_.tube = foot_.tube_before = tube_of(foot_.place.position, foot_.place.radius, position);
  foot_.distance = foot_.tube.distance;
  foot_.outwards = foot_.tube.outwards;
  return foot_;
}

PathProjection::Tube PathProjection::tube_of(const Vec3& centre, double radius, const Vec3& position) noexcept {
  const Vec3 offset = position - centre;
  const double distance = norm_of(offset);
  return {centre, radius, distance, distance > 0 ? Vec3(offset / distance) : Vec3(Vec3::Zero())};
}

}  // namespace haptrace
