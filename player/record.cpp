#include "player/record.h"

#include "base/error.h"
#include "player/motor_limit.h"
#include "player/record_controllers.h"
#include "player/tuning/live_session.h"
#include "scene/scene.h"

#include <algorithm>
#include <filesystem>
#include <fmt/format.h>
#include <utility>

namespace haptrace {
namespace {

void check(const Trials& trials, const RecordOptions& options) {
  if (trials.count < 1 || trials.count > kMostTrials)
    throw input_error(fmt::format("the number of trials is {}; it must be from 1 to {}", trials.count, kMostTrials));
  if (!(trials.pause >= 0 && trials.pause <= 86400))
    throw input_error(fmt::format("the pause between trials is {} s; it must be from 0 to 86400 s", trials.pause));
  const SessionOptions::Recording& recording = *options.session.recording;
  if (trials.count == 1 || recording.options.overwrite) return;
  for (int trial = 1; trial <= trials.count; ++trial)
    if (const std::string file = trial_file(recording.file, trial, trials.count); std::filesystem::exists(file))
      throw input_error(fmt::format(
          "{}: exists already and would be replaced by trial {}; choose another name, or allow this with --overwrite",
          file, trial));
}

}  // namespace

SessionResult record(Device& device, const RecordOptions& options, const StopRequest& stop, const Progress& progress) {
  double duration = options.duration;
  if (!(duration >= 0 && duration <= 1e7))
    throw input_error(fmt::format("the duration is {} s; it must be from 0 (until stopped) to 1e7 s", duration));
  if (duration == 0) duration = device.info().natural_duration;
  const bool real = options.session.clock == ClockChoice::real || !device.info().virtual_time;
  if (duration == 0 && !real)
    throw input_error(
        fmt::format("{} advances in virtual time and would be recorded without end; limit the recording with "
                    "--duration, or use --clock real",
                    device.info().name));
  if (options.trigger && options.trigger->needs_force_sensor() && !device.info().measures_force)
    throw input_error(
        fmt::format("{} has no force sensor, which the trigger needs; use the trigger speed or button, or a device "
                    "with a force sensor",
                    device.info().name));
  SessionOptions session = options.session;
  std::vector<SampleSink*> sinks;
  const Scene* const scene = session.touch.scene.get();
  const bool supports = session.support.acts();
  if (scene != nullptr || supports) {
    const bool needs_plant = supports || scene->options().passivity;
    if (needs_plant && options.identified) session.touch.plant = options.identified(device.info());
    if (session.touch.plant) (void)bound_by_motors(session, device.info(), *session.touch.plant);
  } else {
    // Only zero force is sent, so the speed of the hand needs no limit.
    session.loop.limits.max_velocity = 0;
  }
  if (options.live != nullptr) attach(*options.live, device.info(), session, sinks);
  PassiveController passive;
  TimedController controller(passive, duration, options.trigger);
  return run_session(device, controller, {}, sinks, session, stop, progress);
}

std::string trial_file(const std::string& file, int trial, int count) {
  if (count == 1) return file;
  std::filesystem::path path(file);
  const std::string stem = path.stem().string(), ending = path.extension().string();
  return path.replace_filename(fmt::format("{}-{:03}{}", stem, trial, ending)).string();
}

std::vector<SessionResult> record_trials(const Trials& trials, const RecordOptions& options, const StopRequest& stop,
                                         const Progress& progress) {
  check(trials, options);
  std::vector<SessionResult> results;
  MotorHeat motors;
  std::unique_ptr<Device> device = trials.open(1);
  for (int trial = 1; trial <= trials.count; ++trial) {
    if (trial > 1 && trials.pause > 0) {
      // The loop keeps serving the device, so that it neither sleeps nor loses its home position.
      RecordOptions rest{.duration = trials.pause, .session = options.session};
      rest.session.loop.motors = &motors;
      rest.session.recording.reset();
      rest.session.observer = nullptr;
      rest.session.touch = {};
      rest.live = nullptr;
      if (record(*device, rest, stop, {}).servo.cause != StopCause::finished) break;
    }
    if (trial > 1 && device->info().natural_duration > 0) {
      device.reset();
      device = trials.open(trial);
    }
    const std::string file = trial_file(options.session.recording->file, trial, trials.count);
    if (trials.begin) trials.begin(trial, *device, file);
    RecordOptions one = options;
    one.session.loop.motors = &motors;
    SessionOptions::Recording& recording = *one.session.recording;
    recording.file = file;
    if (trials.count > 1) {
      recording.meta["trial"] = std::to_string(trial);
      recording.meta["trials"] = std::to_string(trials.count);
    }
    results.push_back(record(*device, one, stop, progress));
    const SessionResult& result = results.back();
    if (result.servo.cause != StopCause::finished || !result.recording_error.empty() || result.ended_by_disk) break;
  }
  return results;
}

}  // namespace haptrace
