// The controller: what force to send next.
#pragma once

#include "base/types.h"
#include "control/sample.h"

#include <optional>

namespace haptrace {

/// What the servo loop knows at a tick.
struct State {
  std::uint64_t tick = 0;
  std::int64_t time_ns = 0;      ///< since the session's first tick
  double dt = 0;                 ///< since the previous update [s], never negative; 0 at the first, also after a gap
  Vec3 position = Vec3::Zero();  ///< p_WT [m]
  Vec3 velocity = Vec3::Zero();  ///< estimated from position, in W [m/s]
  Quat orientation = nan_quat();
  Vec3 force_measured = nan3();       ///< NaN when the device has no sensor [N]
  Vec3 force_applied = Vec3::Zero();  ///< what the previous tick sent, after all limits [N]
  std::uint32_t buttons = 0;
};

/// Where the tool should be.
struct Reference {
  Vec3 position = nan3();      ///< [m]
  Vec3 velocity = nan3();      ///< [m/s]
  Vec3 acceleration = nan3();  ///< [m/s^2]
  double time = kNaN;          ///< of the path that is followed [s]; NaN on the way to its start
};

/// What a controller answers. The loop applies its own limits to `wrench` before anything is sent.
struct Command {
  enum class Status : std::uint8_t {
    working,
    finished,     ///< the task is done: the loop fades the force out and ends
    deviation,    ///< the tracking error passed its limit: the loop stops; `event` holds the figures
    oscillation,  ///< the loop oscillates: the loop stops; `event` holds the figures
    no_path,      ///< what is to be followed next cannot be had: the loop stops; `event` says where
  };

  Wrench wrench;
  Vec3 feedforward = Vec3::Zero();  ///< part of wrench.force that is known beforehand: the loop never softens it [N]
  double vibration = 0;             ///< amplitude of an effect in wrench.force that vibrates on purpose [N]
  Reference reference;              ///< NaN when there is none
  Vec3 reference_force = nan3();    ///< [N]
  Quat reference_orientation = nan_quat();
  double progress = kNaN;       ///< [m]
  double tunnel_radius = kNaN;  ///< at that place [m]
  Phase phase = Phase::idle;
  Status status = Status::working;
  /// How long a hand may resist before the loop ends the session [s]; 0: for ever. It resists when it makes the force
  /// more than the limits allow for long, or when `resisted` says so.
  double patience = 0;
  /// The hand does not yield: the controller sees it resist, or waits or softens because it is off the reference.
  /// Counts against `patience` as what the limits hold back does, also where the force itself may be held for ever.
  bool resisted = false;
  std::optional<Event> event;  ///< something to tell; the loop stamps its time
};

/// Called by the one servo loop, in its thread.
///
/// Real-time: start, resume and update allocate nothing, lock nothing, throw nothing, do no I/O.
class Controller {
 public:
  virtual ~Controller() = default;

  /// The first state of a session, before the first update.
  virtual void start(const State& first) noexcept { (void)first; }

  /// The first state after a gap, before its update: the device was lost and is found again, took no new samples for a
  /// while, or no ticks ran. The tool may be somewhere else, and forces fade in from zero as at the start.
  virtual void resume(const State& first) noexcept { start(first); }

  /// The force for the coming tick. Goes on being called while the loop fades the force out.
  [[nodiscard]] virtual Command update(const State& state) noexcept = 0;

  /// As for SampleSink: after every tick, outside of it; may wait only where time stands still meanwhile.
  virtual void between_ticks(bool may_wait) noexcept { (void)may_wait; }
};

}  // namespace haptrace
