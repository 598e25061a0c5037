// What one tick leaves behind: the row that a recording keeps and the events beside it.
#pragma once

#include "base/types.h"

#include <array>
#include <string>

namespace haptrace {

/// One tick of a session, plain data of fixed size. "Not measured" and "no reference" are NaN.
struct Sample {
  std::uint64_t tick = 0;     ///< the servo loop's index; a gap in it is a tick that was missed
  std::int64_t time_ns = 0;   ///< since the session's first tick, from the clock
  Vec3 position = nan3();     ///< p_WT [m]
  Vec3 velocity = nan3();     ///< the estimate that the controller used [m/s]
  Vec3 force = Vec3::Zero();  ///< sent to the device, after all limits [N]
  Quat orientation = nan_quat();
  Vec3 torque = nan3();          ///< sent to the device [N m]
  Vec3 force_measured = nan3();  ///< by the device's own sensor [N]
  Vec3 reference_position = nan3();
  Vec3 reference_velocity = nan3();
  Vec3 reference_force = nan3();  ///< the expert's force at the present point of the path [N]
  Quat reference_orientation = nan_quat();
  double progress = kNaN;       ///< arc length of the projection on the path [m]
  double tunnel_radius = kNaN;  ///< of the tunnel at that place [m]
  std::uint32_t buttons = 0;
  Phase phase = Phase::idle;
  float latency = 0;  ///< wake-up minus deadline [s]
};

/// The kinds of event, as stored in /events/code. Append only: files keep the numbers.
enum class EventCode : std::int32_t {
  started = 1,
  finished = 2,
  interrupted = 3,         ///< SIGINT, SIGTERM or the caller asked to stop
  overrun = 10,            ///< values: missed ticks, lateness [s], time of the exchange [s] where that is why
  samples_lost = 11,       ///< values: samples that found the ring full
  recovered = 12,          ///< by haptrace recover; values: samples kept, samples that could not be read
  force_limit = 20,        ///< values: asked [N], allowed [N]
  continuous_limit = 21,   ///< values: allowed [N, N m]; continuous force that was assumed [N]; 1 for torque
  velocity_limit = 22,     ///< values: speed [m/s], limit [m/s]
  deviation_limit = 23,    ///< values: deviation [m], limit [m]
  deviation_over = 24,     ///< values: deviation [m]; the session goes on
  oscillation = 25,        ///< values: amplitude [m], frequency [Hz], share of the gains; NaN: not softened
  warming = 26,            ///< values: heat of the motors over that from which they are limited, time until then [s]
  hand_resists = 27,       ///< values: opposing force [N], for how long [s]
  hand_let_go = 28,        ///< values: how much the load fell [N], from what [N]
  oscillation_stays = 29,  ///< values: amplitude [m], frequency [Hz], share of the gains, which is the least
  not_finite = 30,         ///< values: 0 the device's position, 1 the controller's force
  device_not_ready = 31,   ///< forces are not allowed by the device
  device_ready = 32,
  device_lost = 33,  ///< values: how long it was waited for in vain [s]; NaN when it was just lost
  repetition = 40,   ///< values: index from 0
  mark = 50,
  paused = 51,
  resumed = 52,
  triggered = 53,          ///< values: 0 force, 1 speed, 2 button; how much [N, m/s, bits]; over what
  path_waits = 60,         ///< values: time of the path [s]; it stands still until what follows was read
  path_unreadable = 61,    ///< values: time of the path [s]
  device_found = 62,       ///< the device that was lost is back; values: how long it was away [s]
  time_over = 63,          ///< of a repetition; values: how far the trainee came [m], of what length [m]
  rotation_limit = 64,     ///< values: deviation of the orientation [rad], limit [rad]
  touched = 65,            ///< values: index of the scene's object from 0, its force [N]
  left = 66,               ///< by the tool; values: index of the object, largest depth [m], how long it was touched [s]
  reference_waits = 67,    ///< a playback's reference waits for the hand; values: deviation [m], limit [m]
  reference_goes_on = 68,  ///< the hand is back
  states_stopped = 69,     ///< no fresh state of the device; values: for how long so far [s]. Force fades to zero
  states_resumed = 70,     ///< values: how long there was no fresh state, or no tick [s]. Forces fade in again
  outside_workspace =
      71,  ///< a position that no hand can reach; values: distance from the workspace's centre [m], bound [m]
  force_resisted = 72,    ///< for a while; values: allowed force [N] if limits bind, time until the end [s]
  resistance_limit = 73,  ///< values: for how long the force was resisted [s]
  // Each is a step of ReactionLadder; values: vibrating force [N], frequency [Hz], share of the feedback that is left.
  vibrates = 74,            ///< by the energy rule of VibrationMonitor
  vibrates_regularly = 75,  ///< by its rule of half cycles
  bounces = 76,             ///< by its contact rule
  sways = 77,               ///< by its slow hint
  vibration_stays = 78,     ///< with the least share: the session ends
  torque_vibrates = 79,     ///< by the energy rule on the torque; values: [N m], [Hz], share
  sway_over = 84,  ///< the share that the slow hint took is back; values: since its last step [s], quiet [s], share
  recording_resumed = 85,  ///< in a further file; values: how long the disk refused [s], samples that are missing
  recording_ended = 86,    ///< before the session did: no room is left for the file
  values_lost = 87,        ///< by haptrace recover; its text says of which rows and columns
  force_held = 88,         ///< the loop or the device stood still; values: for how long [s], with which force [N]
};

/// Something that happened at a tick. Plain data: its text is made outside the tick by describe().
struct Event {
  std::int64_t time_ns = 0;
  EventCode code = EventCode::mark;
  std::array<double, 3> values{kNaN, kNaN, kNaN};  ///< meaning by code, see EventCode
};

/// Returns true for the events that say that the loop oscillates. The slow hint is not one: a hand may do the same.
constexpr bool is_oscillation(EventCode code) noexcept {
  return code == EventCode::oscillation || code == EventCode::oscillation_stays ||
         (code >= EventCode::vibrates && code <= EventCode::torque_vibrates && code != EventCode::sways);
}

/// One line for people, at most 127 bytes of UTF-8. Not for the tick: it allocates.
std::string describe(const Event& event);

/// Takes what the servo loop produces, in its thread.
///
/// Real-time: push must not allocate, lock, throw or wait on a real-time clock.
class SampleSink {
 public:
  virtual ~SampleSink() = default;

  /// Called before the first push of a session in real time: what CLOCK_MONOTONIC said at the session's time 0 [ns].
  virtual void start(std::int64_t monotonic_ns) noexcept { (void)monotonic_ns; }
  virtual void push(const Sample& sample) noexcept = 0;
  virtual void push(const Event& event) noexcept { (void)event; }

  /// Called after every tick, outside of it. On the virtual clock, where time stands still meanwhile, a sink may wait
  /// here for a slower thread; on the monotonic clock it must return at once.
  virtual void between_ticks(bool may_wait) noexcept { (void)may_wait; }
};

}  // namespace haptrace
