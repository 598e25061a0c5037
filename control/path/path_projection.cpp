#include "control/path/path_projection.h"

#include "control/norm.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace haptrace {
namespace {

constexpr double kSpeedTime = 0.02;    // time constant of the place's speed [s]
constexpr double kPreference = 0.02;   // spacings by which what lies beyond a rise of the distance has to be nearer
constexpr double kLeap = 1e-3;         // of the place in a tick, beyond what the tool moved [m]
constexpr double kAhead = 40;          // spacings within which the place passes a corner that was cut: 10 mm
constexpr double kCut = 5e-4;          // by which what comes after the corner has to be nearer [m]
constexpr double kMostSegments = 128;  // looked at in a tick: it must cost little on the finest paths too

}  // namespace

void PathProjection::start(double s) noexcept {
  foot_ = {};
  foot_.s = std::clamp(s, 0.0, path_->length());
  foot_.place = path_->at(foot_.s);
}

const PathProjection::Foot& PathProjection::update(const Vec3& position, double dt) noexcept {
  if (!is_finite(position)) return foot_;
  // However long a tick is, no farther beyond what the tool moved than kLeap: round a corner the place would jump.
  const double moved = (position - foot_.place.position - foot_.offset).norm();
  const double reach = std::min({options_.max_speed * dt, moved + kLeap, kMostSegments * path_->spacing()});
  // The present place is preferred where nothing is nearer: so that it rests where it has no reason to move.
  ArcPath::Nearest best{foot_.s, (position - path_->position_at(foot_.s)).squaredNorm()};
  look(foot_.s, std::min(foot_.s + reach, path_->length()), false, position, best);
  // At the turn of a retraced stroke both ways are as near: forward it goes.
  if (options_.allow_back) look(std::max(foot_.s - reach, 0.0), foot_.s, true, position, best);
  // Who cuts a corner, or turns before the end of a stroke, is nearer to what comes after it: there the place slides.
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
