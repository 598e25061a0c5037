// A simulated participant of reaching studies, whose knowledge of a force field is known.
#pragma once

#include "base/types.h"
#include "control/path/min_jerk.h"
#include "devices/device.h"

#include <cmath>
#include <memory>

namespace haptrace::test {

/// A hand of mass m on the handle. It intends straight minimum-jerk reaches, compensates for the share `learned` of a
/// curl field, and learns from the deviation that it makes:
///
///     F = m a_d + K (x_d - x) + D (v_d - v) - learned b v_d x n
///     learned <- retention learned - rate deviation,   deviation at peak speed, to the left [m]
class Participant {
 public:
  double learned = 0;
  double retention = 0.995, rate = 8;             ///< rate [1/m]
  double mass = 1, stiffness = 60, damping = 15;  ///< [kg], [N/m], [N s/m]
  double b = 13;                                  ///< of the field that it may learn [N s/m]
  double duration = 0.5;                          ///< of a reach [s]

  /// Sits at `start` and will reach for `target` after `when` [s].
  void begin(const Vec3& start, const Vec3& target, double when) {
    start_ = position = start;
    way_ = target - start;
    velocity.setZero();
    time_ = 0;
    when_ = when;
    fastest_ = deviation_ = 0;
    realised_ = ideal_ = 0;
  }

  /// Moves for `dt` [s] under the device's force on the hand [N].
  void step(const Vec3& device, double dt) {
    time_ += dt;
    const MinJerk blend = MinJerk::at(std::clamp((time_ - when_) / duration, 0.0, 1.0));
    const Vec3 place = start_ + blend.s * way_, speed = blend.ds / duration * way_,
               pull = blend.dds / (duration * duration) * way_;
    const Vec3 hand = mass * pull + stiffness * (place - position) + damping * (speed - velocity) -
                      learned * b * speed.cross(Vec3(Vec3::UnitZ()));
    velocity += dt / mass * (device + hand);
    position += dt * velocity;
    const Vec3 along = way_.normalized(), left = Vec3::UnitZ().cross(along);
    if (velocity.norm() > fastest_) {
      fastest_ = velocity.norm();
      deviation_ = (position - start_).dot(left);
    }
    // The channel's force on the hand balances the hand's force on the channel.
    const double ideal = -b * velocity.dot(along);
    realised_ -= hand.dot(left) * ideal;
    ideal_ += ideal * ideal;
  }

  /// Learns from the reach, unless a channel took its error away.
  void learn(bool clamped) {
    learned *= retention;
    if (!clamped) learned -= rate * deviation_;
  }

  /// Returns the share of the field against which the hand really pushed, over the reach.
  [[nodiscard]] double realised() const { return realised_ / ideal_; }
  [[nodiscard]] double deviation() const { return deviation_; }

  Vec3 position = Vec3::Zero(), velocity = Vec3::Zero();  ///< [m], [m/s]

 private:
  Vec3 start_ = Vec3::Zero(), way_ = Vec3::Zero();
  double time_ = 0, when_ = 0, fastest_ = 0, deviation_ = 0, realised_ = 0, ideal_ = 0;
};

/// The handle of a participant, as a device.
class ParticipantDevice final : public Device {
 public:
  explicit ParticipantDevice(std::shared_ptr<Participant> participant) : participant_(std::move(participant)) {
    info_.name = info_.backend = info_.model = "participant";
    info_.virtual_time = true;
    info_.workspace_min = Vec3::Constant(-0.2);
    info_.workspace_max = Vec3::Constant(0.2);
    info_.max_force = 12;
  }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
    participant_->step(wrench.force, dt);
    state.position = participant_->position;
    largest_ = std::max(largest_, wrench.force.norm());
    return Status::ok;
  }
  void close() noexcept override {}
  [[nodiscard]] double largest_force() const { return largest_; }  ///< [N]

 private:
  DeviceInfo info_;
  std::shared_ptr<Participant> participant_;
  double largest_ = 0;
};

}  // namespace haptrace::test
