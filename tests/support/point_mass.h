// A device for tests of higher layers: a point mass with faults on demand.
#pragma once

#include "control/sample.h"
#include "devices/device.h"

#include <cstdint>
#include <limits>
#include <vector>

namespace haptrace::test {

/// Moves as m x'' = F - b x' in semi-implicit steps of dt, and keeps every force.
class PointMass final : public Device {
 public:
  static constexpr std::uint64_t kNever = std::numeric_limits<std::uint64_t>::max();

  /// Exchanges at which faults occur, counted from 0.
  struct Faults {
    std::uint64_t lost_at = kNever;
    std::uint64_t away_from = kNever;
    std::uint64_t away_until = kNever;
    Vec3 moved_while_away = Vec3::Zero();
    std::uint64_t nan_at = kNever;
    std::uint64_t jump_at = kNever;  ///< the position jumps by 30 mm
    std::uint64_t ready_from = 0;
    std::uint64_t ready_until = kNever;
    bool pushes_back = false;  ///< moves against the force, as with a wrong sign
  };

  explicit PointMass(double mass = 0.5, double viscous = 2) : PointMass(mass, viscous, Faults{}) {}
  PointMass(double mass, double viscous, const Faults& faults) : mass_(mass), viscous_(viscous), faults_(faults) {
    info_.name = "point mass";
    info_.backend = "test";
    info_.model = "point mass";
    info_.virtual_time = true;
    info_.workspace_min = Vec3::Constant(-0.2);
    info_.workspace_max = Vec3::Constant(0.2);
    info_.max_force = 10;
    forces_.reserve(1 << 20);
  }

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }

  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
    const std::uint64_t call = calls_++;
    if (closed_ || call >= faults_.lost_at) return Status::lost;
    if (call >= faults_.away_from && call < faults_.away_until) {
      if (!wrench.force.isZero(0) && call > faults_.away_from) force_while_away_ = true;
      return Status::away;
    }
    if (call == faults_.away_until) {
      position_ += faults_.moved_while_away;
      velocity_.setZero();
    }
    if (forces_.size() < forces_.capacity()) forces_.push_back(wrench.force);
    velocity_ += dt / mass_ * ((faults_.pushes_back ? -1 : 1) * wrench.force - viscous_ * velocity_);
    position_ += dt * velocity_;
    if (call == faults_.jump_at) position_.x() += 0.03;
    state.position = call == faults_.nan_at ? nan3() : position_;
    state.ready = call >= faults_.ready_from && call < faults_.ready_until;
    return Status::ok;
  }

  void close() noexcept override { closed_ = true; }
  [[nodiscard]] std::string not_ready_reason() const override { return "its lid is open"; }

  DeviceInfo& mutable_info() { return info_; }
  void place(const Vec3& position) { position_ = position; }
  void throw_at(const Vec3& velocity) { velocity_ = velocity; }

  /// Returns every force sent, in order [N].
  [[nodiscard]] const std::vector<Vec3>& forces() const { return forces_; }
  /// Returns whether it was sent a force after it had reported that it was away.
  [[nodiscard]] bool force_while_away() const { return force_while_away_; }

 private:
  DeviceInfo info_;
  double mass_, viscous_;
  Faults faults_;
  Vec3 position_ = Vec3::Zero(), velocity_ = Vec3::Zero();
  std::uint64_t calls_ = 0;
  bool closed_ = false, force_while_away_ = false;
  std::vector<Vec3> forces_;
};

/// Keeps all samples and events of the servo loop.
class Log final : public SampleSink {
 public:
  Log() {
    samples.reserve(1 << 18);
    events.reserve(1 << 12);
  }
  void push(const Sample& sample) noexcept override { samples.push_back(sample); }
  void push(const Event& event) noexcept override { events.push_back(event); }

  [[nodiscard]] bool has(EventCode code) const {
    for (const Event& event : events)
      if (event.code == code) return true;
    return false;
  }

  std::vector<Sample> samples;
  std::vector<Event> events;
};

}  // namespace haptrace::test
