// A simulated device in a hand for tests of identification.
#pragma once

#include "control/design/identification.h"

#include <cmath>
#include <deque>
#include <numbers>
#include <random>
#include <vector>

namespace haptrace {

/// A device in a hand that differs from the simulator's: coupled inertia, whole delays, friction along axes that are
/// not those of W, a hand with other constants in every direction, first-order drift and a tremor at one frequency.
struct HeldBench {
  static constexpr double kServoRate = 1000, kFullTurn = 2 * std::numbers::pi;

  Eigen::Matrix3d turn = Eigen::AngleAxisd(0.6, Vec3(1, -2, 1).normalized()).toRotationMatrix();
  Eigen::Matrix3d mass = turn.transpose() * Vec3(0.3, 0.4, 0.5).asDiagonal() * turn;
  double viscous = 1, coulomb = 0.1, lag = 0.5e-3, quantum = 2e-5;
  int delay = 1;
  bool holds = true;
  Vec3 hand{0.15, 0.18, 0.14}, grip{800, 700, 900}, grip_damping{4, 5, 4};
  double arm = 40, arm_damping = 2, relaxation = 0.5;
  double drift = 0.15, drift_hz = 0.8, tremor = 0.04, tremor_hz = 8.5;
  double tremor_damping = HandNoise::kTremorDamping;  ///< 0: a sine
  LinkModel link;
  double excitation = 1;  ///< rms [N]
  unsigned seed = 1;

  Multisine dither{4, 120, 1.5, {true, true, true}};
  std::vector<TickRow> rows;
  std::vector<Stretch> dithered;

  [[nodiscard]] HeldIdentification identified(int windows = 2) {
    const double period = dither.period(), lead = 1;
    const auto ticks = static_cast<std::size_t>((lead + windows * period) * kServoRate);
    for (std::size_t k = 0; k < ticks; ++k) tick();
    dithered = {{static_cast<std::size_t>(lead * kServoRate), ticks}};
    return held();
  }

  [[nodiscard]] Experiment experiment() const {
    return {.rows = rows, .rate_hz = kServoRate, .dither = &dither, .dithered = dithered, .sweeps = {}};
  }

  [[nodiscard]] HeldIdentification held() const { return identify_held(experiment(), identify(experiment())); }

  [[nodiscard]] Vec3 apparent_mass() const { return mass.inverse().diagonal().cwiseInverse(); }

 private:
  void tick() {
    const double time = static_cast<double>(rows.size()) / kServoRate;
    const double angle = kFullTurn * 2 / dither.period() * time, size = 0.01 * std::min(time / 0.3, 1.0);
    const Vec3 wanted = size * Vec3(std::cos(angle), std::sin(angle), 0.5 * std::sin(2 * angle));
    Vec3 seen = x_;
    if (quantum > 0)
      for (double& value : seen) value = quantum * std::round(value / quantum);
    const double bandwidth = std::min(50.0, 0.4 / (delay / kServoRate + lag + 2e-3));
    const Vec3 diagonal = mass.diagonal();
    Vec3 force = bandwidth * bandwidth * diagonal.cwiseProduct(wanted - seen) - bandwidth * diagonal.cwiseProduct(v_);
    force += excitation * dither.value(time);
    rows.push_back({time, seen, force});
    sent_.push_front(force);
    if (sent_.size() > 12) sent_.pop_back();
    const auto late = static_cast<std::size_t>(delay);
    const Vec3 command = late < sent_.size() ? sent_[late] : Vec3(Vec3::Zero());
    // The hand's own force.
    const double dt = 1 / kServoRate, corner = kFullTurn * drift_hz, w = kFullTurn * tremor_hz, zeta = tremor_damping;
    for (int axis = 0; axis < 3; ++axis) {
      drift_[axis] += -dt * corner * drift_[axis] + drift * std::sqrt(2 * corner * dt) * normal_(random_);
      rate_[axis] += dt * (-2 * zeta * w * rate_[axis] - w * w * shake_[axis]) +
                     tremor * std::sqrt(4 * zeta * w * w * w * dt) * normal_(random_);
      shake_[axis] += dt * rate_[axis];
      if (zeta == 0) shake_[axis] = std::sqrt(2) * tremor * std::sin(w * time + 1.1 * axis);
    }
    constexpr int kSteps = 40;
    const double h = dt / kSteps, decay = std::exp(-h / lag), arm_decay = std::exp(-h / relaxation);
    for (int step = 0; step < kSteps; ++step) {
      const Vec3 lacking = f_ - command;
      f_ = command + decay * lacking;
      Vec3 on_device = command + (1 - decay) * lag / h * lacking - viscous * v_;
      const Vec3 along = turn * v_;
      on_device -= turn.transpose() * Vec3(coulomb * (along / 0.002).array().tanh());
      Vec3 grip_force = Vec3::Zero();
      Vec3 &held = link.mass > 0 ? x2_ : x_, &held_v = link.mass > 0 ? v2_ : v_;
      if (holds) {
        grip_force = grip.cwiseProduct(held - xh_) + grip_damping.cwiseProduct(held_v - vh_);
        arm_ = arm_decay * arm_ - h * arm * vh_;
        vh_ += h * (grip_force + arm_ - arm_damping * vh_ + drift_ + shake_).cwiseQuotient(hand);
        xh_ += h * vh_;
      }
      if (link.mass > 0) {
        const Vec3 stretch = link.stiffness * (x_ - x2_) + link.damping * (v_ - v2_);
        on_device -= stretch;
        v2_ += h / link.mass * (stretch - grip_force);
        x2_ += h * v2_;
      } else {
        on_device -= grip_force;
      }
      const Vec3 before = v_;
      v_ += h * (inverse_ * on_device);
      x_ += 0.5 * h * (before + v_);
    }
  }

  Eigen::Matrix3d inverse_ = Eigen::Matrix3d::Zero();
  Vec3 x_ = Vec3::Zero(), v_ = Vec3::Zero(), f_ = Vec3::Zero(), xh_ = Vec3::Zero(), vh_ = Vec3::Zero();
  Vec3 x2_ = Vec3::Zero(), v2_ = Vec3::Zero(), arm_ = Vec3::Zero();
  Vec3 drift_ = Vec3::Zero(), shake_ = Vec3::Zero(), rate_ = Vec3::Zero();
  std::deque<Vec3> sent_;
  std::mt19937 random_{seed};
  std::normal_distribution<double> normal_;

 public:
  HeldBench& with_mass(const Eigen::Matrix3d& m) {
    mass = m;
    inverse_ = m.inverse();
    return *this;
  }
  HeldBench() { with_mass(mass); }
};

}  // namespace haptrace
