// Interface of controllers, which compute the force to send next.
#pragma once

#include "base/types.h"
#include "control/sample.h"

#include <optional>
#include <span>

namespace haptrace {

/// Input of a controller at a tick.
struct State {
  std::uint64_t tick = 0;
  std::int64_t time_ns = 0;      ///< time since the session's first tick [ns]
  double dt = 0;                 ///< time since the previous update [s], never negative; 0 at first and after a gap
  Vec3 position = Vec3::Zero();  ///< p_WT [m]
  Vec3 velocity = Vec3::Zero();  ///< estimated from position, in W [m/s]
  Quat orientation = nan_quat();
  Vec3 force_measured = nan3();       ///< NaN if the device has no force sensor [N]
  Vec3 force_applied = Vec3::Zero();  ///< force sent at the previous tick, after all limits [N]
  double share_applied = 1;           ///< share of the last command's feedback force in it: softening, fades and limits
  bool softened = false;              ///< a monitor has softened that feedback force
  bool vibrated = false;              ///< because it vibrated, not because loop or hand swayed
  Vec3 force_touched = Vec3::Zero();  ///< part of it that the objects of a scene exerted, beside this controller [N]
  std::uint32_t buttons = 0;
};

/// Desired state of the tool.
struct Reference {
  Vec3 position = nan3();      ///< [m]
  Vec3 velocity = nan3();      ///< [m/s]
  Vec3 acceleration = nan3();  ///< [m/s^2]
  double time = kNaN;          ///< time along the path [s]; NaN during the approach
};

/// Output of a controller. The loop applies its own limits to `wrench` before it sends anything.
struct Command {
  enum class Status : std::uint8_t {
    working,
    finished,     ///< the task is done: the loop fades the force out and ends the session
    deviation,    ///< the tracking error exceeds its limit: the servo loop stops; `event` holds the values
    oscillation,  ///< the control loop oscillates: the servo loop stops; `event` holds the values
    no_path,      ///< the next part of the path is not available: the servo loop stops; `event` says where
  };

  Wrench wrench;
  Vec3 feedforward = Vec3::Zero();  ///< part of wrench.force that is known beforehand: the loop never softens it [N]
  Vec3 support = nan3();            ///< part of `feedforward` that carries the arm; NaN if none can [N]
  double vibration = 0;             ///< amplitude of an intended vibration in wrench.force [N]
  Reference reference;              ///< NaN if there is none
  Vec3 reference_force = nan3();    ///< [N]
  Quat reference_orientation = nan_quat();
  double progress = kNaN;       ///< arc length of the projection on the path [m]
  double tunnel_radius = kNaN;  ///< radius of the tunnel at that place [m]
  /// Gains of the feedback in wrench.force on each axis of W [N/m], [N s/m]; NaN if it follows no reference. The loop
  /// scales them like that force.
  Vec3 kp = nan3(), kd = nan3();
  /// True at the tick from which on another law, or gentler gains, compute the feedback: what was softened because the
  /// one before vibrated is given back (ReactionLadder::renew).
  bool renewed = false;
  Phase phase = Phase::idle;
  Status status = Status::working;
  /// Time for which the hand may resist before the loop ends the session [s]; 0: no limit. The hand resists while it
  /// makes the force exceed the limit for continuous forces, or while `resisted` is set.
  double patience = 0;
  /// True while the hand does not yield: the controller detects its resistance, or waits or softens because the hand is
  /// off the reference. Counts against `patience` like a force that the limits reduce, even if it may act for ever.
  bool resisted = false;
  std::optional<Event> event;               ///< event to report; the loop stamps its time
  std::span<const ContactSample> contacts;  ///< to report; valid until the next update; the loop stamps tick and time
};

/// Computes the force of a session. Only the servo loop calls it, in its own thread.
///
/// Real-time: start, resume and update must not allocate, lock, throw or do I/O.
class Controller {
 public:
  virtual ~Controller() = default;

  /// Called with the first state of a session, before the first update.
  virtual void start(const State& first) noexcept { (void)first; }

  /// Called with the first state after a gap, before its update. A gap means that the device was lost and is back, that
  /// it took no new samples for a while, or that no ticks ran. The tool may have moved, and forces fade in from zero as
  /// at the start.
  virtual void resume(const State& first) noexcept { start(first); }

  /// Returns the force for the coming tick. The loop also calls it while it releases the force at the end.
  [[nodiscard]] virtual Command update(const State& state) noexcept = 0;

  /// Called after every tick, outside of it, like SampleSink::between_ticks. May wait only if `may_wait` is set, that
  /// is, if time stands still meanwhile.
  virtual void between_ticks(bool may_wait) noexcept { (void)may_wait; }
};

}  // namespace haptrace
