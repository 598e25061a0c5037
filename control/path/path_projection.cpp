#include "control/path/path_projection.h"

#include "control/norm.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace haptrace {
namespace {

constexpr double kSpeedTime = 0.02;    // time constant of the foot point's speed [s]
constexpr double kPreference = 0.02;   // a point beyond a rise of the distance must be nearer by this [spacings]
constexpr double kLeap = 1e-3;         // largest move of the foot point in a tick beyond the tool's own move [m]
constexpr double kAhead = 40;          // distance within which the foot point passes a cut corner: 10 mm [spacings]
constexpr double kCut = 5e-4;          // a point beyond a cut corner must be nearer by this [m]
constexpr double kMostSegments = 128;  // searched per tick; limits the cost on the finest paths

}  // namespace

void PathProjection::start(double s) noexcept {
  foot_ = {};
  foot_.s = std::clamp(s, 0.0, path_->length());
  foot_.place = path_->at(foot_.s);
}

const PathProjection::Foot& PathProjection::update(const Vec3& position, double dt) noexcept {
  if (!is_finite(position)) return foot_;
  // In a long tick the foot point may move at most kLeap farther than the tool; otherwise it would jump round a corner.
  const double moved = (position - foot_.place.position - foot_.offset).norm();
  const double reach = std::min({options_.max_speed * dt, moved + kLeap, kMostSegments * path_->spacing()});
  // Keeps the current foot point unless another point is nearer, so that it rests unless the tool moves.
  ArcPath::Nearest best{foot_.s, (position - path_->position_at(foot_.s)).squaredNorm()};
  look(foot_.s, std::min(foot_.s + reach, path_->length()), false, position, best);
  // At the turn of a retraced stroke both directions are equally near. The forward direction wins.
  if (options_.allow_back) look(std::max(foot_.s - reach, 0.0), foot_.s, true, position, best);
  // A tool that cuts a corner, or turns before the end of a stroke, is nearer to the path after it. The foot point
  // slides there.
  if (const double off = std::sqrt(best.squared_distance); off > kCut) {
    ArcPath::Nearest ahead{foot_.s, (off - kCut) * (off - kCut)};
    look(foot_.s, std::min(foot_.s + kAhead * path_->spacing(), path_->length()), false, position, ahead);
    if (ahead.s > foot_.s) best.s = std::min(ahead.s, foot_.s + reach);
  }
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
    const double blend = -std::expm1(-dt / kSpeedTime);
    foot_.speed += blend * ((s - before) / dt - foot_.speed);
    foot_.expert_speed += blend * (foot_.place.speed - foot_.expert_speed);
  }
  foot_.offset = position - foot_.place.position;
  foot_.distance = norm_of(foot_.offset);
  foot_.outwards = foot_.distance > 0 ? Vec3(foot_.offset / foot_.distance) : Vec3::Zero();
  return foot_;
}

}  // namespace haptrace
