// Recording what a hand does.
#pragma once

#include "control/design/plant_model.h"
#include "control/trigger.h"
#include "player/session.h"
#include "scene/scene_controller.h"

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// Sends no force: the hand moves freely, and the loop records it.
class PassiveController final : public Controller {
 public:
  [[nodiscard]] Command update(const State&) noexcept override { return {}; }
};

/// Ends what another controller does in time, and tells when its trigger fires.
class TimedController final : public Controller {
 public:
  /// Ends `duration` [s] after the start or, with one, after the trigger, which it tells as an event; 0: never. `inner`
  /// must outlive it.
  TimedController(Controller& inner, double duration, std::optional<Trigger> trigger = std::nullopt)
      : inner_(inner), duration_(duration), trigger_(std::move(trigger)), waits_(trigger_.has_value()) {}

  void start(const State& first) noexcept override { inner_.start(first); }
  void resume(const State& first) noexcept override { inner_.resume(first); }
  [[nodiscard]] Command update(const State& state) noexcept override;
  void between_ticks(bool may_wait) noexcept override { inner_.between_ticks(may_wait); }

 private:
  Controller& inner_;
  double duration_;
  std::optional<Trigger> trigger_;
  bool waits_;  ///< for the trigger
  std::int64_t begin_ns_ = 0;
  std::optional<Event> kept_;  ///< of the inner one, that had to wait for the trigger's
};

struct RecordOptions {
  double duration =
      0;  ///< [s], from the trigger where there is one; 0: the device's natural duration, or until stopped
  std::optional<Trigger> trigger;              ///< needs session.recording->options.capture.pre, 0 at least
  std::shared_ptr<Scene> scene;                ///< what the hand can touch; null: nothing, and no force is sent
  std::optional<SlowSceneOptions> slow_scene;  ///< it is slower than the loop
  /// What calibration found out about the device, for a scene with a passivity layer; without it, nothing.
  std::function<std::optional<PlantModel>(const DeviceInfo&)> identified;
  SessionOptions session;
};

/// The passivity layer of a scene on a device of this resolution [m], of which calibration found out `plant`. A device
/// that nobody calibrated is taken to be as late as guidance takes it to be, and light: kUnknownDelay, kUnknownMass.
/// That is safe: who takes forces to be later than they are believes that more was created.
PassivityLayer::Options passivity_for(const std::optional<PlantModel>& plant, double rate_hz, double resolution);

inline constexpr double kUnknownMass = 0.1;  ///< [kg]

/// Lets the hand move freely, or touch the scene, and records it. Throws Error(input) when a session in virtual time
/// would never end, when the trigger asks for a sensor that the device does not have, or as make_scene_controller does.
SessionResult record(Device& device, const RecordOptions& options, const StopRequest& stop,
                     const Progress& progress = {});

/// Repeated recordings of the same kind.
struct Trials {
  int count = 1;
  double pause = 0;  ///< between two, in which nothing is recorded [s]

  /// Opens the device: once, or before each trial where it has something of its own to show (a natural duration).
  /// Trials count from 1.
  std::function<std::unique_ptr<Device>(int trial)> open;

  /// Called with the device before a trial begins; `file` is its recording.
  std::function<void(int trial, const Device& device, const std::string& file)> begin;
};

inline constexpr int kMostTrials = 100'000;

/// The file of a trial: that of the recording where there is one trial, else with -001 and so on before its ending.
std::string trial_file(const std::string& file, int trial, int count);

/// Records trial after trial until all are done, one is stopped or faults, or the disk refuses. The number of a trial
/// is in its metadata (trial, trials). Throws what record throws, and Error(input) before the first trial when an
/// option is out of range or the file of any trial exists.
std::vector<SessionResult> record_trials(const Trials& trials, const RecordOptions& options, const StopRequest& stop,
                                         const Progress& progress = {});

}  // namespace haptrace
