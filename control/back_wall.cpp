#include "control/back_wall.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace haptrace {
namespace {

constexpr double kAtStop = 1e-3;  // [m]

}  // namespace

BackWall::BackWall(std::shared_ptr<const ArcPath> path, const BackWallOptions& options)
    : path_(std::move(path)), options_(options) {
  validate(options_);
  find_stops();
  begin();
}

void BackWall::find_stops() {
  const ArcPath& path = *path_;
  const std::size_t segments = path.knots() - 1;
  const auto time = [&](std::size_t knot) { return path.time_at(path.knot_at(knot)); };
  const auto speed = [&](std::size_t i) {
    const double duration = time(i + 1) - time(i);
    return duration > 0 ? (path.knot_at(i + 1) - path.knot_at(i)) / duration : 0;
  };
  double fastest = 0;
  for (std::size_t i = 0; i < segments; ++i) fastest = std::max(fastest, speed(i));
  constexpr double kStill = 5e-3, kStillShare = 0.05;  // [m/s], of the largest speed
  const double still = std::min(kStill, kStillShare * fastest);

  stops_ = {Stop{}};
  for (std::size_t i = 0; i < segments; ++i) {
    if (speed(i) >= still) continue;
    std::size_t end = i;
    while (end < segments && speed(end) < still) ++end;
    if (i == 0)
      stops_.front().leaves = time(end);
    else if (end < segments && time(end) - time(i) >= kShortestStop)
      stops_.push_back({path.knot_at(i), time(end)});
    i = end;
  }
}

void BackWall::begin() noexcept {
  next_ = 1;
  waits_ = true;
  pushes_ = pushed_ = begun_ = settled_ = false;
  waited_ = fast_for_ = still_for_ = from_ = time_ = place_ = push_ = 0;
  force_ = acted_ = Vec3::Zero();
  initiation_ = {};
}

bool BackWall::moves(const PathProjection::Foot& foot, double dt) noexcept {
  if (foot.s < stop().s - kAtStop) return false;
  fast_for_ = foot.speed > kOnsetSpeed ? fast_for_ + dt : 0;
  return fast_for_ >= kOnsetTime || foot.s - from_ > kOnsetWay;
}

bool BackWall::settles(const PathProjection::Foot& foot, double dt) noexcept {
  const bool fast = foot.speed > kOnsetSpeed;
  still_for_ = fast || initiation_.waited < kForceGoes ? 0 : still_for_ + dt;
  fast_for_ = fast ? fast_for_ + dt : 0;
  if (still_for_ >= kComesToRest) {
    from_ = foot.s;
    return true;
  }
  if (initiation_.waited < kRecoils && foot.s <= kRecoilWay) return false;
  // A hand that has been under way since then left by itself, when it began to.
  if (fast) initiation_.waited -= fast_for_;
  return true;
}

void BackWall::travel(double reach, double dt) noexcept {
  time_ += options_.pace * dt;
  place_ = path_->place_at(time_);
  if (place_ > reach) {
    place_ = std::max(reach, 0.0);
    time_ = path_->time_at(place_);
  }
  if (next_ == stops_.size() || place_ < stops_[next_].s) return;
  place_ = from_ = stops_[next_++].s;
  waits_ = true;
  waited_ = fast_for_ = 0;
}

void BackWall::update(const PathProjection::Foot& foot, const Vec3& position, double dt) noexcept {
  if (!is_finite(position)) return;
  if (begun_) initiation_.work += acted_.dot(position - position_);
  position_ = position;
  begun_ = true;

  waited_ += dt;
  if (initiation_.initiator == Initiator::none) {
    initiation_.waited += dt;
    if (!settled_ && !(settled_ = settles(foot, dt))) return;
  }
  const bool first = initiation_.initiator == Initiator::none;
  const bool moved = (waits_ || first) && moves(foot, dt);
  if (first && moved) initiation_.initiator = pushed_ ? Initiator::helped : Initiator::self;
  if (waits_ && (moved || waited_ >= options_.wait)) {
    waits_ = false;
    pushes_ = true;
    time_ = stop().leaves;
  }
  const double reach = foot.s + options_.max_force / options_.stiffness;
  if (waits_ && next_ > 1 && reach < stop().s) {  // the hand went back: arrive at the stop with it again
    --next_;
    waits_ = false;
  }
  if (!waits_) travel(reach, dt);
  push_ = pushes_ ? std::clamp(options_.stiffness * (place_ - foot.s), 0.0, options_.max_force) : 0;
  pushed_ = pushed_ || push_ > 0;
}

void BackWall::rest(double dt) noexcept {
  push_ = std::max(0.0, push_ - dt / kRelease * options_.max_force);
  begun_ = false;
}

Vec3 BackWall::force(const GuideInput& input) noexcept {
  const PathProjection::Foot& foot = input.foot;
  force_ = input.gate * foot.heading_certainty * input.tuning.assist * push_ * foot.place.tangent;
  return force_;
}

}  // namespace haptrace
