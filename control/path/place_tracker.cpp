#include "control/path/place_tracker.h"

#include "control/norm.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace haptrace {
namespace {

// Lengths are those of a path with a diagonal of 110 mm.
constexpr double kFine = 4e-3;                      // distance of the foot point from the anchor [m]
constexpr double kNear = 8e-3;                      // range of places that are near the foot point [m]
constexpr double kRival = 15e-3;                    // a rival is farther away [m]
constexpr double kFar = 60e-3;                      // the foot point moves farther only without forces [m]
constexpr double kRemote = 30e-3;                   // beyond this distance a place must be better ...
constexpr double kBetter = 0.5, kBetterRemote = 1;  // ... by the larger of these costs
constexpr double kDoubt = 0.5, kCertain = 1.5;      // margins at which certainty is 0 and 1
constexpr double kFadeDown = 0.1, kFadeUp = 0.3;    // of the certainty from 1 to 0 and back [s]
constexpr double kSameForce = 0.1;                  // relative difference of forces that agree
constexpr double kSameWay = 0.7;                    // cosine between directions that agree
constexpr double kLap = 1, kOtherLap = 2;           // excess of distance costs at which certainty is 1 and 0

double faded(double value, double target, double dt) {
  return target < value ? std::max(target, value - dt / kFadeDown) : std::min(target, value + dt / kFadeUp);
}

}  // namespace

PlaceTracker::PlaceTracker(const ArcPath& path, const Options& options)
    : path_(&path),
      options_(options),
      evidence_(path, options.resolution),
      projection_(path, {.max_speed = options.max_speed}) {
  scale_ = evidence_.scale();
  start();
}

void PlaceTracker::start(double s) noexcept {
  projection_.start(s);
  foot_ = projection_.foot();
  begun_ = false;
  anchor_ = foot_.s;
  target_ = rival_ = kNaN;
  far_ = false;
  certainty_ = heading_ = 1;
  union_ = {.place = foot_.s, .floor = foot_.s};
}

void PlaceTracker::weigh_rivals(const PlaceEvidence::Candidate& near) noexcept {
  const ArcPath::Place place = path_->at(foot_.s);
  double margin = kCertain;
  bool same_force = true, same_way = true;
  rival_ = kNaN;
  const double most = near.cost + kCertain;
  for (auto rival = evidence_.next_rival(0, foot_.s, scale_ * kRival, most); std::isfinite(rival.cost);
       rival = evidence_.next_rival(rival.s + evidence_.spacing(), foot_.s, scale_ * kRival, most)) {
    if (rival.cost - near.cost < margin) {
      margin = rival.cost - near.cost;
      rival_ = rival.s;
    }
    const ArcPath::Place there = path_->at(rival.s);
    same_force &= norm_of(there.force - place.force) <= kSameForce * norm_of(place.force);
    same_way &= there.tangent.dot(place.tangent) > kSameWay;
  }
  const double gate = std::clamp((margin - kDoubt) / (kCertain - kDoubt), 0.0, 1.0);
  certainty_ = same_force ? 1 : gate;
  heading_ = same_way ? 1 : gate;
  doubt_laps(place);
}

void PlaceTracker::doubt_laps(const ArcPath::Place& place) noexcept {
  const double here = evidence_.recent(foot_.s);
  if (here < kLap) return;
  const PlaceEvidence::Candidate other = evidence_.nearest_lately(foot_.s, scale_ * kRival, kSameWay);
  const double gate = std::clamp((kOtherLap - (here - other.cost)) / (kOtherLap - kLap), 0.0, 1.0);
  if (gate >= certainty_ || norm_of(path_->at(other.s).force - place.force) <= kSameForce * norm_of(place.force))
    return;
  certainty_ = gate;
  rival_ = other.s;
}

void PlaceTracker::look_about() noexcept {
  const PlaceEvidence::Candidate best = evidence_.best(), near = evidence_.best_within(foot_.s, scale_ * kNear);
  const double away = std::abs(best.s - foot_.s);
  anchor_ = near.s;
  weigh_rivals(near);
  if (near.cost > (away > scale_ * kRemote ? kBetterRemote : kBetter)) {
    target_ = best.s;
    far_ = away >= scale_ * kFar;
  } else {
    target_ = kNaN;
  }
}

void PlaceTracker::fade(double dt) noexcept {
  const bool leaves = far_ && !std::isnan(target_);
  foot_.certainty = faded(foot_.certainty, leaves ? 0 : certainty_, dt);
  foot_.heading_certainty = faded(foot_.heading_certainty, leaves ? 0 : heading_, dt);
}

PathProjection::Tube PlaceTracker::tube_at(const Vec3& position, const Union& tunnels) const noexcept {
  const double h = evidence_.spacing();
  double s = std::max(tunnels.place, tunnels.floor);
  double depth = norm_of(position - path_->position_at(s)) - path_->radius_at(s);
  for (std::size_t i = 0; i < tunnels.count; ++i) {
    const PlaceEvidence::Stretch& stretch = tunnels.stretches[i];
    const double from = std::max(stretch.from, tunnels.floor);
    if (from > stretch.to) continue;
    const PlaceEvidence::Nearest state = evidence_.nearest_in({from, stretch.to}, position);
    if (state.depth > depth + h) continue;
    const double low = std::max(state.s - h, from), high = std::min(state.s + h, stretch.to);
    const ArcPath::Nearest exact = path_->nearest_between(std::min(low, high), high, position);
    const double there = std::sqrt(exact.squared_distance) - path_->radius_at(exact.s);
    if (!(there < depth)) continue;
    depth = there;
    s = exact.s;
  }
  return PathProjection::tube_of(path_->position_at(s), path_->radius_at(s), position);
}

void PlaceTracker::lay_tunnels(const Vec3& position, bool changed) noexcept {
  const Union before = union_;
  if (changed) {
    const auto plausible = evidence_.plausible();
    std::copy(plausible.begin(), plausible.end(), union_.stretches.begin());
    union_.count = plausible.size();
  }
  union_.place = foot_.s;
  union_.floor = options_.allow_back ? 0 : foot_.relocated ? foot_.s : std::max(union_.floor, foot_.s);
  foot_.tube = tube_at(position, union_);
  foot_.tube_before = changed || foot_.relocated ? tube_at(position, before) : foot_.tube;
}

const PlaceTracker::Foot& PlaceTracker::update(const Vec3& position, double dt) noexcept {
  if (!is_finite(position)) return foot_;
  if (!begun_) evidence_.start(foot_.s, position);
  begun_ = true;
  const bool counted = evidence_.update(position, dt);
  if (counted) look_about();
  const bool moves = !std::isnan(target_) && (!far_ || foot_.certainty + foot_.heading_certainty <= 0);
  if (moves && far_)
    take(projection_.move_to(target_, position, 0));
  else if (moves)
    take(projection_.update(position, dt, target_, target_));
  else
    take(projection_.update(position, dt, anchor_ - scale_ * kFine, anchor_ + scale_ * kFine));
  foot_.relocated = moves;
  if (moves && foot_.s == std::clamp(target_, 0.0, path_->length())) {
    anchor_ = target_;
    target_ = kNaN;
  }
  fade(moves && far_ ? 0 : dt);
  lay_tunnels(position, counted);
  return foot_;
}

void PlaceTracker::take(const Foot& foot) noexcept {
  const double certainty = foot_.certainty, heading = foot_.heading_certainty;
  foot_ = foot;
  foot_.certainty = certainty;
  foot_.heading_certainty = heading;
}

const PlaceTracker::Foot& PlaceTracker::hold(const Vec3& position, double dt) noexcept {
  take(projection_.move_to(foot_.s, position, dt));
  foot_.expert_speed = 0;
  const Union before = std::exchange(union_, {.place = foot_.s, .floor = foot_.s});
  if (is_finite(position)) foot_.tube_before = tube_at(position, before);
  return foot_;
}

const PlaceTracker::Foot& PlaceTracker::move_to(double s, const Vec3& position, double dt) noexcept {
  foot_ = projection_.move_to(s, position, dt);
  union_ = {.place = foot_.s, .floor = foot_.s};
  return foot_;
}

}  // namespace haptrace
