// The servo loop: recording, playback, guidance and programmes differ only in their controller.
//
//     device.exchange(force) -> State -> controller.update(State) -> Force -> limits -> device.exchange(force)
//                                  \-> Sample -> sinks
#pragma once

#include "base/stop_request.h"
#include "control/controller.h"
#include "devices/device.h"
#include "devices/loop/servo_session.h"
#include "devices/loop/tick_pulse.h"

#include <span>
#include <string>
#include <vector>

namespace haptrace {

class VelocityEstimator;

/// Returns the age beyond which a state is stale [ns]: 20 ms, or three periods (at most 1 s) if these are longer.
[[nodiscard]] std::int64_t stale_after_ns(double rate_hz) noexcept;

/// Drives one device with one controller at a fixed rate.
///
/// The loop protects the user in every session, whatever the controller. It rejects positions and forces that are not
/// finite. It limits the peak force, the continuous force and the tool's speed. It softens a force that vibrates, and
/// ends the session if the vibration stays (ForceGuard). It fades forces in and out, and sends zero force however a
/// session ends. The continuous limit is the device's; if neither the device nor the session states one, it is a
/// cautious one (kCautiousShare). It accounts for the time for which each force really acted. If a hand resists more
/// than this limit allows, the session ends after Command::patience. The loop counts late ticks as missed and never
/// catches up with them: they leave a gap in tick and time, and an event.
///
/// A state that the device only repeats (DeviceState::sequence) is not a sample. The loop stores nothing, estimates no
/// velocity, does not call the controller, and holds the last force. The velocity estimate uses the time between the
/// samples, not between the ticks that saw them. After stale_after_ns() without a fresh state, the force fades to zero
/// within kStaleFade; after kSilence the device counts as away. When fresh states return, the loop continues as after a
/// device's return: it computes nothing from earlier states, and forces fade in from zero. The same holds when no tick
/// ran for as long, for example because the process was stopped. If more time passes in such gaps than between them, a
/// force would never fade in. A session that asks for a force then ends after 1 s of that; a session that asks for none
/// continues.
///
/// A position farther from the centre of the workspace than ten of its diagonals plus one metre ends the session: no
/// hand reaches that far. After a limit or a fault stops a session, the loop stops calling the controller and logs one
/// event.
///
/// The loop can wait for a device that is away (Device::Status). Ticks and time continue, without samples: the loop
/// does not invent positions. It sends zero force until the device is back and ready. Then it restarts the velocity
/// estimate, the controller resumes, and forces fade in from zero. The continuous limit does not count this time as
/// cooling of the motors, because the force that acted is unknown.
class ServoLoop {
 public:
  static constexpr double kStaleFade = 0.01;  ///< [s]
  static constexpr double kSilence = 0.25;    ///< time without a fresh state, and at least five periods [s]

  /// Throws Error(input) if an option is out of range, or if virtual time is requested for a device in real time.
  static void validate(const DeviceInfo& device, const ServoOptions& options);

  /// Returns the limits that hold on a device: a session may lower those of the device. If neither states a continuous
  /// force, it is a cautious share of the peak force (kCautiousShare).
  [[nodiscard]] static SafetyLimits in_force(const DeviceInfo& device, SafetyLimits limits) noexcept;

  /// Borrows all arguments; they must outlive run(). Throws what validate throws.
  ServoLoop(Device& device, Controller& controller, VelocityEstimator& estimator, std::span<SampleSink* const> sinks,
            const ServoOptions& options);

  /// Runs one session in the calling thread until the controller is finished, `stop` is raised or a limit stops the
  /// session. Sends zero force before it returns. Does not throw.
  ServoReport run(const StopRequest& stop) noexcept;

  /// Returns the pulse of the thread that runs the session, for a Watchdog.
  [[nodiscard]] const TickPulse& pulse() const noexcept { return pulse_; }

 private:
  class Session;

  [[nodiscard]] std::string not_ready_hint() const;  ///< the end of a sentence

  Device& device_;
  Controller& controller_;
  VelocityEstimator& estimator_;
  std::vector<SampleSink*> sinks_;
  ServoOptions options_;
  TickPulse pulse_;
  double assumed_continuous_force_ = 0;  ///< used if neither the device nor the session states one [N]
};

}  // namespace haptrace
