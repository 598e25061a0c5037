// Data of one tick: the sample that a recording stores, and the events beside it.
#pragma once

#include "base/stop_request.h"
#include "base/types.h"

#include <array>
#include <string>

namespace haptrace {

/// One tick of a session, as plain data of fixed size. NaN means "not measured" or "no reference".
struct Sample {
  std::uint64_t tick = 0;     ///< index of the servo loop; a gap in it is a missed tick
  std::int64_t time_ns = 0;   ///< clock time since the session's first tick [ns]
  Vec3 position = nan3();     ///< p_WT [m]
  Vec3 velocity = nan3();     ///< estimate that the controller used [m/s]
  Vec3 force = Vec3::Zero();  ///< sent to the device, after all limits [N]
  Quat orientation = nan_quat();
  Vec3 torque = nan3();          ///< sent to the device [N m]
  Vec3 force_measured = nan3();  ///< from the device's own sensor [N]
  Vec3 support = nan3();         ///< part of `force` that carried the arm [N]
  Vec3 reference_position = nan3();
  Vec3 reference_velocity = nan3();
  Vec3 reference_force = nan3();  ///< expert's force at the present point of the path [N]
  Quat reference_orientation = nan_quat();
  double progress = kNaN;       ///< arc length of the projection on the path [m]
  double tunnel_radius = kNaN;  ///< radius of the tunnel at that place [m]
  Vec3 kp = nan3();             ///< stiffness of the feedback in `force`, on each axis of W [N/m]
  Vec3 kd = nan3();             ///< its damping [N s/m]
  std::uint32_t buttons = 0;
  Phase phase = Phase::idle;
  float latency = 0;  ///< wake-up minus deadline [s]
};

/// A contact of the tool with an object of a scene at one tick, as plain data.
struct ContactSample {
  std::uint64_t tick = 0;     ///< tick and time of the sample
  std::int64_t time_ns = 0;   ///< [ns]
  std::uint32_t object = 0;   ///< index in the scene
  Vec3 proxy = nan3();        ///< where the surface holds the tool back, in W [m]
  Vec3 normal = nan3();       ///< unit normal, out of the object
  double depth = 0;           ///< of the tool behind the proxy [m]
  Vec3 force = Vec3::Zero();  ///< of this object on the hand, before fades and limits [N]
};

/// Kinds of events, as stored in /events/code. Append only: files store the numbers.
enum class EventCode : std::int32_t {
  started = 1,
  finished = 2,
  interrupted = 3,         ///< something asks to stop; values: the StopSource
  overrun = 10,            ///< values: missed ticks, lateness [s], time of the exchange [s] if that is the cause
  samples_lost = 11,       ///< values: number of samples that found the ring full
  recovered = 12,          ///< from haptrace recover; values: samples kept, samples that could not be read
  force_limit = 20,        ///< values: force asked [N], force allowed [N]
  continuous_limit = 21,   ///< values: allowed [N, N m]; assumed continuous force [N]; 1 for torque
  velocity_limit = 22,     ///< values: speed [m/s], limit [m/s]
  deviation_limit = 23,    ///< values: deviation [m], limit [m]
  deviation_over = 24,     ///< values: deviation [m], limit [m]; the session continues
  oscillation = 25,        ///< values: amplitude [m], frequency [Hz], share of the gains; NaN: not softened
  warming = 26,            ///< values: heat of the motors over the heat that limits them, time until then [s]
  hand_resists = 27,       ///< values: opposing force [N], duration [s]
  hand_let_go = 28,        ///< values: decrease of the load [N], load before [N]
  oscillation_stays = 29,  ///< values: amplitude [m], frequency [Hz], share of the gains, which is the least
  not_finite = 30,         ///< values: 0 for the device's position, 1 for the controller's force
  device_not_ready = 31,   ///< the device does not allow forces
  device_ready = 32,       ///< values: time that the session waited for it, before its time 0 [s]
  device_lost = 33,        ///< values: time waited in vain [s]; NaN when the device was just lost
  repetition = 40,         ///< values: index from 0
  mark = 50,
  paused = 51,
  resumed = 52,
  triggered = 53,          ///< values: 0 force, 1 speed, 2 button; measured value [N, m/s, bits]; threshold
  path_waits = 60,         ///< values: time of the path [s]; it stands still until the next part is read
  path_unreadable = 61,    ///< values: time of the path [s]
  device_found = 62,       ///< the lost device is back; values: time away [s]
  time_over = 63,          ///< the time of a repetition is over; values: distance reached [m], length [m]
  rotation_limit = 64,     ///< values: deviation of the orientation [rad], limit [rad]
  touched = 65,            ///< values: index of the scene's object from 0, its force [N]
  left = 66,               ///< the tool left an object; values: its index, largest depth [m], duration [s]
  reference_waits = 67,    ///< the reference of a playback waits for the hand; values: deviation [m], limit [m]
  reference_goes_on = 68,  ///< the hand is back
  states_stopped = 69,     ///< no fresh state of the device, the force fades to zero; values: time so far [s]
  states_resumed = 70,     ///< forces fade in again; values: time without a fresh state or tick [s]
  outside_workspace = 71,  ///< beyond a hand's reach; values: distance from the workspace's centre [m], bound [m]
  force_resisted = 72,     ///< values: allowed force [N] if limits apply, time until the session ends [s]
  resistance_limit = 73,   ///< values: time for which the hand resisted the force [s]
  // Each is a step of ReactionLadder; values: vibrating force [N], frequency [Hz], remaining share of the feedback.
  vibrates = 74,            ///< energy rule of VibrationMonitor
  vibrates_regularly = 75,  ///< half-cycle rule
  bounces = 76,             ///< contact rule
  sways = 77,               ///< slow hint
  vibration_stays = 78,     ///< the vibration persists at the least share: the session ends
  torque_vibrates = 79,     ///< energy rule on the torque; values: [N m], [Hz], share
  sway_over = 84,           ///< the slow hint's share is back; values: since its last step [s], quiet [s], share
  recording_resumed = 85,   ///< the recording continues in a further file; values: time of refusal [s], missing samples
  recording_ended = 86,     ///< the recording ends before the session: no space is left for the file
  values_lost = 87,         ///< from haptrace recover; its text names the rows and columns
  force_held = 88,          ///< the loop or the device stood still; values: duration [s], force kept [N]
  shown_go = 90,            ///< a page of the view showed "go" to the trainee; its text names the trial and the frame
  shown_done = 91,          ///< a page showed "done"
  input = 92,  ///< what a person steers a simulated hand with; values: 1 mouse, 2 pen, 3 touch, 4 gamepad, 5 keys;
               ///< depth 0 from a plane, 1 from the path
  began_inside = 94,  ///< the tool was inside an object when the session started; values: its index, depth [m]
  initiation = 95,  ///< how a repetition with a back wall began; values: Initiator, waiting time [s], work of the wall
                    ///< on the hand until the repetition's end [J]
  place_in_doubt = 100,  ///< the trainee's place on the path is undecidable, the expert's force fades; values: time so
                         ///< far [s], present place [m], other place [m]
  tank_empty = 101,      ///< the energy tank of guidance is empty; values: time so far [s], share of the active forces
  feedback_renewed = 102,  ///< other feedback replaces one that vibrated; values: share so far, share from now on
};

/// An event at a tick. Plain data: describe() makes its text outside the tick.
struct Event {
  std::int64_t time_ns = 0;
  EventCode code = EventCode::mark;
  std::array<double, 3> values{kNaN, kNaN, kNaN};  ///< meaning by code, see EventCode
};

/// Returns true for events that report an oscillation of the loop. The slow hint is not one: a hand may cause it.
constexpr bool is_oscillation(EventCode code) noexcept {
  return code == EventCode::oscillation || code == EventCode::oscillation_stays ||
         (code >= EventCode::vibrates && code <= EventCode::torque_vibrates && code != EventCode::sways);
}

/// Returns the end of a session in words: "interrupted", and by what unless by the user.
const char* interruption_text(StopSource source) noexcept;
const char* to_string(StopSource source) noexcept;  ///< for programs: "user" | "page" | "lost_page" | "command"

/// Returns one line of text, at most 127 bytes of UTF-8. Not for the tick: it allocates.
std::string describe(const Event& event);

/// Takes the samples and events of the servo loop, in its thread.
///
/// Real-time: push must not allocate, lock, throw or wait on a real-time clock.
class SampleSink {
 public:
  virtual ~SampleSink() = default;

  /// Called before the first push in real time. `monotonic_ns` is CLOCK_MONOTONIC at the session's time 0 [ns].
  virtual void start(std::int64_t monotonic_ns) noexcept { (void)monotonic_ns; }
  virtual void push(const Sample& sample) noexcept = 0;
  virtual void push(const Event& event) noexcept { (void)event; }
  /// Takes a contact. Those of a tick come before its sample.
  virtual void push_contact(const ContactSample& contact) noexcept { (void)contact; }

  /// Called after every tick, outside of it. On the virtual clock, where time stands still meanwhile, a sink may wait
  /// here for a slower thread; on the monotonic clock it must return at once.
  virtual void between_ticks(bool may_wait) noexcept { (void)may_wait; }
};

}  // namespace haptrace
