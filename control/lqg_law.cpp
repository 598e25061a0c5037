#include "control/lqg_law.h"

#include "control/filters.h"
#include "control/norm.h"
#include "control/state_observer.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace haptrace {
namespace {

constexpr double kLoadAtStandstill = 0.5;  // bandwidth of the load at standstill [Hz]
constexpr double kNothing = 1e-100;        // in any unit

}  // namespace

LqgFeedback::LqgFeedback(const LqgAxis& law)
    : transition_(law.model.transition),
      newer_(law.model.newer),
      older_(law.model.older),
      kalman_(law.kalman),
      state_gain_(law.state.transpose()),
      together_(law.model.together),
      balanced_(law.model.balanced),
      ripple_gain_(law.ripple.transpose()),
      load_gain_(law.load),
      stiffness_(law.stiffness),
      period_(1 / law.model.rate_hz),
      delay_(law.model.delay),
      drift_(law.model.drift),
      gains_(static_cast<int>(law.sent.size())),
      x_(State::Zero(law.model.states())) {
  const RippleModel ripple(law.model.rate_hz);
  ripple_step_ = ripple.a;
  ripple_in_ = ripple.b;
  sent_gain_.head(gains_) = law.sent.transpose();
}

void LqgFeedback::start(double error) noexcept {
  x_ = error * together_;
  ripple_.setZero();
  sent_.setZero();
}

void LqgFeedback::push(double sent) noexcept {
  const Eigen::Vector4d before = ripple_;
  ripple_ = ripple_step_ * before + sent * ripple_in_;
  std::copy_backward(sent_.data(), sent_.data() + gains_, sent_.data() + gains_ + 1);
  sent_[0] = std::abs(sent) < kNothing ? 0 : sent;
}

void LqgFeedback::predict() noexcept {
  const State before = x_;
  x_ = sent_[delay_] * newer_ + sent_[delay_ + 1] * older_;
  for (Eigen::Index i = 0; i < before.size(); ++i) x_ += before[i] * transition_.col(i);
}

/// States that fade for minutes would cost denormal arithmetic.
void LqgFeedback::flush() noexcept {
  if (x_.squaredNorm() < kNothing * kNothing) x_.setZero();
  if (ripple_.squaredNorm() < kNothing * kNothing) ripple_.setZero();
}

void LqgFeedback::update(double error, double dt, double sent) noexcept {
  if (x_.size() == 0) return;
  const bool passes = dt > 0, anew = dt > StateObserver::kLongestGap * period_;
  const int ticks =
      passes ? std::max(1, static_cast<int>(std::lround(std::min<double>(dt / period_, AxisModel::kLongestDelay)))) : 1;
  for (int tick = 0; tick < ticks; ++tick) {
    push(sent);
    if (passes && !anew) predict();
  }
  if (!passes) return;
  if (anew) {
    const double load = drift_ >= 0 ? x_[drift_] : 0;
    x_ = error * together_ + load * balanced_;
    return;
  }
  // The model's period is exact; the loop's is not quite.
  x_[0] += (dt - ticks * period_) * x_[1];
  x_ += (error - x_[0]) * kalman_;
  flush();
}

LqgFeedback::Forces LqgFeedback::forces() const noexcept {
  if (x_.size() == 0) return {};
  const double total =
      -(state_gain_.dot(x_) + sent_gain_.head(gains_).dot(sent_.head(gains_)) + ripple_gain_.dot(ripple_));
  const double load = drift_ >= 0 ? -load_gain_ * x_[drift_] : 0, spring = -stiffness_ * x_[0];
  return {.spring = spring, .other = total - load - spring, .load = load};
}

PdGains gains_of(const std::array<std::optional<LqgLaws>, 3>& laws) noexcept {
  PdGains gains;
  for (std::size_t i = 0; i < 3; ++i) {
    if (!laws[i]) continue;
    gains.kp[static_cast<Eigen::Index>(i)] = laws[i]->moving.stiffness;
    gains.kd[static_cast<Eigen::Index>(i)] = laws[i]->moving.damping;
  }
  return gains;
}

LqgLaw::LqgLaw(const Options& options)
    : driven_([&] {
        Vec3 driven;
        for (int axis = 0; axis < 3; ++axis) driven[axis] = options.axes[static_cast<std::size_t>(axis)] ? 1 : 0;
        return driven;
      }()),
      authority_(options.authority),
      rest_(driven_, options.position_resolution, 1),
      inertia_(options.inertia),
      per_mass_(options.designed_for.cwiseInverse()) {
  for (std::size_t i = 0; i < 3; ++i) {
    const auto& laws = options.axes[i];
    if (!laws) continue;
    moving_[i] = LqgFeedback(laws->moving);
    resting_[i] = LqgFeedback(laws->resting);
    inverse_stiffness_[static_cast<Eigen::Index>(i)] = 1 / laws->moving.stiffness;
    inverse_damping_[static_cast<Eigen::Index>(i)] = 1 / laws->moving.damping;
    at_rest_.kp[static_cast<Eigen::Index>(i)] = laws->resting.stiffness / laws->moving.stiffness;
    at_rest_.kd[static_cast<Eigen::Index>(i)] = laws->resting.damping / laws->moving.damping;
  }
}

void LqgLaw::start(const State&) noexcept {
  starts_ = true;
  rest_.start();
  known_ = slow_ = offset_ = Vec3::Zero();
}

PdGains LqgLaw::gains(const Tuning& tuning) const noexcept {
  const Vec3 moving = (1 - rest_.weight()) * driven_.cwiseProduct(scale_);
  const Vec3 resting = rest_.weight() * driven_.cwiseProduct(scale_);
  return {(moving + resting.cwiseProduct(at_rest_.kp)).cwiseProduct(tuning.gains.kp),
          (moving + resting.cwiseProduct(at_rest_.kd)).cwiseProduct(tuning.gains.kd)};
}

Vec3 LqgLaw::force(const TermInput& input) noexcept {
  const auto& [state, reference, tuning, before] = input;
  const Vec3 error = state.position - reference.position;
  const Vec3 sent = (state.force_applied - known_).cwiseQuotient(sent_scale_);
  known_ = before;
  if (inertia_) scale_ = inertia_->at(reference.position).cwiseProduct(per_mass_);
  sent_scale_ = scale_;
  Rest::Feedback moving, resting;
  Vec3 load;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto axis = static_cast<Eigen::Index>(i);
    for (LqgFeedback* law : {&moving_[i], &resting_[i]}) {
      if (starts_)
        law->start(error[axis]);
      else
        law->update(error[axis], state.dt, sent[axis]);
    }
    const double stiffness = inverse_stiffness_[axis] * tuning.gains.kp[axis];
    const double damping = inverse_damping_[axis] * tuning.gains.kd[axis];
    const auto in_movement = moving_[i].forces(), at_rest = resting_[i].forces();
    moving.spring[axis] = stiffness * in_movement.spring;
    moving.other[axis] = damping * in_movement.other;
    resting.spring[axis] = stiffness * at_rest.spring;
    resting.other[axis] = damping * at_rest.other;
    load[axis] = in_movement.load;
  }
  starts_ = false;

  rest_.watch(state, reference);
  if (rest_.stands()) {
    slow_ += low_pass_share_at(kLoadAtStandstill, state.dt) * (load - slow_);
    offset_ = slow_ - load;
  } else {
    offset_ *= std::exp(-state.dt / Rest::kAwakening);
    slow_ = load + offset_;
  }
  auto [feedback, cancelling] = rest_.forces(moving, resting, slow_, state.dt);
  cancelling = scale_.cwiseProduct(cancelling);
  if (const double magnitude = norm_of(cancelling); magnitude > authority_) cancelling *= authority_ / magnitude;
  return driven_.cwiseProduct(scale_.cwiseProduct(feedback)) + tuning.observer * cancelling;
}

}  // namespace haptrace
