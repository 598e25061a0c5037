#include "player/playback.h"

#include "control/error.h"
#include "formats/json_reader.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

/// What a trajectory does between the samples of its path, looked at every 10 ms: what a hand would feel, not what one
/// noisy sample says.
struct Excursion {
  double peak_speed = 0;  ///< [m/s]
  double outside = 0;     ///< farthest from the workspace [m]
};

Excursion look_ahead(const Trajectory& trajectory, const Box& workspace) {
  constexpr double kWindow = 0.01;  // [s]
  Trajectory::Cursor cursor;
  Excursion excursion;
  Vec3 before = trajectory.sample(0, cursor).position;
  for (double t = kWindow; t < trajectory.duration() + kWindow; t += kWindow) {
    const Vec3 now = trajectory.sample(t, cursor).position;
    excursion.peak_speed = std::max(excursion.peak_speed, (now - before).norm() / kWindow);
    excursion.outside = std::max(excursion.outside, distance_outside(now, workspace));
    before = now;
  }
  return excursion;
}

/// Where the device has no motor the path has no say: it lies in the middle of what the device can do.
void flatten(Path& path, const DeviceInfo& device) {
  const Vec3 middle = 0.5 * (device.workspace_min + device.workspace_max);
  for (int axis = 0; axis < 3; ++axis) {
    if (device.force_axes[static_cast<std::size_t>(axis)]) continue;
    for (Vec3& p : path.position) p[axis] = middle[axis];
    for (Vec3& v : path.velocity) v[axis] = 0;
  }
}

nlohmann::json to_json(const TrackingFigures& figures) {
  return {{"samples", figures.samples},
          {"duration_s", figures.duration},
          {"rms_error_m", figures.rms_error},
          {"peak_error_m", figures.peak_error},
          {"force_ripple_n", figures.force_ripple},
          {"max_force_n", figures.max_force}};
}

nlohmann::json flight_record(const std::vector<Sample>& samples) {
  nlohmann::json rows = nlohmann::json::array();
  for (const Sample& s : samples)
    rows.push_back({{"tick", s.tick},
                    {"time_s", 1e-9 * static_cast<double>(s.time_ns)},
                    {"position_m", json_of(s.position)},
                    {"velocity_m_per_s", json_of(s.velocity)},
                    {"force_n", json_of(s.force)},
                    {"reference_position_m", json_of(s.reference_position)},
                    {"phase", to_string(s.phase)}});
  return rows;
}

}  // namespace

SessionResult record(Device& device, const RecordOptions& options, const StopRequest& stop, const Progress& progress) {
  double duration = options.duration;
  if (!(duration >= 0 && duration <= 1e7))
    throw input_error(fmt::format("the duration is {} s; it must be from 0 (until stopped) to 1e7 s", duration));
  if (duration == 0) duration = device.info().natural_duration;
  const bool real = options.session.clock == ClockChoice::real || !device.info().virtual_time;
  if (duration == 0 && !real)
    throw input_error(fmt::format(
        "{} advances in virtual time and would be recorded without end; say how long with --duration, or --clock real",
        device.info().name));
  // Zero force is all that is ever sent, so that no speed of the hand is too fast to be recorded.
  RecordOptions free = options;
  free.session.limits.max_velocity = 0;
  PassiveController controller(duration);
  return run_session(device, controller, {}, {}, free.session, stop, progress);
}

PlayPlan plan_playback(const DeviceInfo& device, Path path, const PlayOptions& options) {
  validate(path);
  validate(options.playback);
  PlayPlan plan;
  plan.gains = options.gains.value_or(cautious_gains(device.max_force, options.session.rate_hz));
  validate(plan.gains);

  flatten(path, device);
  const Box workspace{device.workspace_min, device.workspace_max};
  if (const double outside = distance_outside(path, workspace); outside > 0) {
    if (!options.fit)
      throw input_error(fmt::format("{} leaves the workspace of {} by {:.1f} mm; use --fit to move and scale it inside",
                                    path.name, device.model, 1e3 * outside));
    plan.fit = fit_into(path, workspace);
    apply(*plan.fit, path);
  }

  plan.trajectory = Trajectory(path, options.interpolation);
  const Excursion excursion = look_ahead(plan.trajectory, workspace);
  if (excursion.outside > 0)
    throw input_error(fmt::format(
        "{} leaves the workspace of {} by {:.1f} mm between its samples, where they are far apart; use --interpolation "
        "linear",
        path.name, device.model, 1e3 * excursion.outside));
  plan.peak_speed = options.playback.speed * excursion.peak_speed;
  const double limit = options.session.limits.max_velocity;
  if (limit > 0 && plan.peak_speed > 0.9 * limit)
    throw input_error(
        fmt::format("{} moves at up to {:.2f} m/s, too near the velocity limit of {:.2f} m/s; play it slower (--speed "
                    "{:.2f}) or raise --max-velocity",
                    path.name, plan.peak_speed, limit,
                    std::floor(100 * options.playback.speed * 0.9 * limit / plan.peak_speed) / 100));
  plan.path = std::move(path);
  return plan;
}

PlayResult play(Device& device, PlayPlan plan, const PlayOptions& options, const StopRequest& stop,
                const Progress& progress) {
  PlaybackOptions playback = options.playback;
  playback.rate_hz = options.session.rate_hz;
  playback.axes = device.info().force_axes;

  std::vector<std::unique_ptr<ForceTerm>> terms;
  terms.push_back(std::make_unique<PdLaw>(plan.gains));
  PlaybackController controller(std::move(plan.trajectory), std::move(terms), playback);

  TrackingMetrics metrics(options.session.rate_hz, static_cast<std::size_t>(playback.repetitions));
  SampleSink* const sinks[] = {&metrics};
  PlayResult result;
  result.session = run_session(device, controller, {.reference = true}, sinks, options.session, stop, progress);
  result.plan = std::move(plan);
  result.repetitions = metrics.repetitions();
  result.last = metrics.last();
  return result;
}

nlohmann::json to_json(const PdGains& gains) {
  return {{"kp", json_of(gains.kp)}, {"kd", json_of(gains.kd)}};
}

PdGains gains_from_json(const nlohmann::json& json, const std::string& where) {
  JsonReader reader(json, where);
  for (const char* key : {"kp", "kd"})
    if (!reader.has(key)) throw input_error(fmt::format("{}: gains need '{}'", where, key));
  PdGains gains{reader.vector("kp", Vec3::Zero(), 0, kLargestKp), reader.vector("kd", Vec3::Zero(), 0, kLargestKd)};
  reader.finish();
  return gains;
}

nlohmann::json to_json(const DurationHistogram& durations) {
  return {{"p50", durations.quantile(0.5)},
          {"p99", durations.quantile(0.99)},
          {"p999", durations.quantile(0.999)},
          {"max", durations.max()}};
}

nlohmann::json to_json(const SessionResult& result) {
  const ServoReport& servo = result.servo;
  nlohmann::json json{{"samples", servo.samples},
                      {"missed", servo.missed},
                      {"overruns", servo.overruns},
                      {"duration_s", servo.duration},
                      {"asked_rate_hz", servo.asked_rate},
                      {"achieved_rate_hz", servo.achieved_rate()},
                      {"max_force_n", servo.max_force},
                      {"latency_s", to_json(servo.latency)},
                      {"tick_s", to_json(servo.tick_time)},
                      {"stopped_by", to_string(servo.cause)},
                      {"clock", result.virtual_time ? "virtual" : "monotonic"},
                      {"realtime",
                       {{"scheduler", result.virtual_time ? "none (virtual time)" : servo.realtime.scheduler},
                        {"memory_locked", servo.realtime.memory_locked}}}};
  if (!servo.detail.empty()) json["stopped_because"] = servo.detail;
  if (!servo.realtime.reason.empty()) json["realtime"]["reason"] = servo.realtime.reason;
  if (!servo.flight_record.empty()) json["flight_record"] = flight_record(servo.flight_record);
  if (result.recording) {
    json["recorded"] = result.recording->written;
    json["lost"] = result.recording->lost;
  }
  if (!result.recording_error.empty()) json["recording_error"] = result.recording_error;
  return json;
}

nlohmann::json to_json(const PlayResult& result) {
  nlohmann::json json = to_json(result.session);
  // One set of figures for the last repetition at the top, each repetition below; max_force_n is the session's.
  json["rms_error_m"] = result.last.rms_error;
  json["peak_error_m"] = result.last.peak_error;
  json["force_ripple_n"] = result.last.force_ripple;
  json["repetitions"] = nlohmann::json::array();
  for (const TrackingFigures& figures : result.repetitions) json["repetitions"].push_back(to_json(figures));
  json["gains"] = to_json(result.plan.gains);
  json["peak_speed_m_per_s"] = result.plan.peak_speed;
  if (result.plan.fit)
    json["fit"] = {{"scale", result.plan.fit->scale}, {"offset_m", json_of(result.plan.fit->offset)}};
  return json;
}

}  // namespace haptrace
