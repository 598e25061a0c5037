#include "player/session.h"

#include "control/error.h"
#include "formats/json_reader.h"
#include "formats/suggest.h"

#include <array>
#include <chrono>
#include <fmt/format.h>
#include <future>
#include <thread>

namespace haptrace {
namespace {

bool choose_virtual(ClockChoice choice, const DeviceInfo& info) {
  return choice == ClockChoice::virtual_time || (choice == ClockChoice::automatic && info.virtual_time);
}

RecordingHeader header_for(const SessionOptions& options, const DeviceInfo& info, bool virtual_time) {
  const SessionOptions::Recording& recording = *options.recording;
  RecordingHeader header;
  header.software = software_name();
  header.title = recording.title;
  header.subject = recording.subject;
  header.operator_name = recording.operator_name;
  header.notes = recording.notes;
  header.meta = recording.meta;
  header.rate_hz = options.rate_hz;
  header.clock = virtual_time ? "virtual" : "monotonic";
  header.config = recording.config;
  header.device_name = info.name;
  header.device_model = info.model;
  header.device_serial = info.serial;
  header.device_backend = info.backend;
  header.position_resolution_m = info.position_resolution;
  header.max_force_n = info.max_force;
  return header;
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

/// Looks at a running session for a person.
class Watch {
 public:
  Watch(Recorder* recorder, LiveMonitor& monitor, const SessionOptions& options, const Progress& progress,
        SessionResult& result)
      : recorder_(recorder), monitor_(monitor), options_(options), progress_(progress), result_(result) {}

  void look() {
    SessionView view{.live = monitor_.latest()};
    if (recorder_ != nullptr) {
      view.recording = recorder_->status();
      view.notices = recorder_->take_notices();
      tell_of_losses(view);
      disk_is_low_ = view.recording->disk_low;
    }
    tell_of_device(view);
    if (options_.notices)
      for (std::string& notice : options_.notices()) view.notices.push_back(std::move(notice));
    result_.notices.insert(result_.notices.end(), view.notices.begin(), view.notices.end());
    if (progress_) progress_(view);
  }

  [[nodiscard]] bool disk_is_low() const noexcept { return disk_is_low_; }

 private:
  /// Of a device that is waited for, and of its return.
  void tell_of_device(SessionView& view) {
    if (options_.away_timeout > 0 && view.live.losses > losses_told_) {
      view.notices.push_back(
          fmt::format("the device was lost; it is waited for, up to {:g} s, without force", options_.away_timeout));
      away_told_ = true;
    }
    losses_told_ = view.live.losses;
    if (away_told_ && !view.live.away) {
      view.notices.emplace_back("the device is back; the session goes on");
      away_told_ = false;
    }
  }

  /// The writer cannot tell them itself while it waits for the disk. Once a second.
  void tell_of_losses(SessionView& view) {
    const auto now = std::chrono::steady_clock::now();
    if (now - told_ < std::chrono::seconds(1)) return;
    const Recorder::Status& status = *view.recording;
    if (status.lost > lost_told_ && !status.failed) {
      view.notices.push_back(
          fmt::format("{}: {} samples lost so far: the disk does not keep up", recorder_->file(), status.lost));
      lost_told_ = status.lost;
      told_ = now;
    } else if (status.stalled > 1) {
      view.notices.push_back(fmt::format("{}: the disk has not answered for {:.0f} s; samples wait in memory",
                                         recorder_->file(), status.stalled));
      told_ = now;
    }
  }

  Recorder* recorder_;
  LiveMonitor& monitor_;
  const SessionOptions& options_;
  const Progress& progress_;
  SessionResult& result_;
  std::chrono::steady_clock::time_point told_;
  std::uint64_t lost_told_ = 0, losses_told_ = 0;
  bool away_told_ = false;
  bool disk_is_low_ = false;
};

}  // namespace

ClockChoice parse_clock(std::string_view name) {
  static const std::vector<std::string> names{"auto", "real", "virtual"};
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) throw input_error(fmt::format("unknown clock '{}'{}", name, suggestion(name, names)));
  return static_cast<ClockChoice>(found - names.begin());
}

const char* software_name() noexcept {
  return "haptrace " HAPTRACE_VERSION;
}

SessionResult run_session(Device& device, Controller& controller, RecordingColumns columns,
                          std::span<SampleSink* const> extra_sinks, const SessionOptions& options,
                          const StopRequest& stop, const Progress& progress) {
  const DeviceInfo& info = device.info();
  SessionResult result;
  result.virtual_time = choose_virtual(options.clock, info);

  const ServoLoop::Options loop_options{.rate_hz = options.rate_hz,
                                        .virtual_time = result.virtual_time,
                                        .realtime = options.realtime,
                                        .limits = options.limits,
                                        .watch_vibration = options.watch_vibration,
                                        .away_timeout = options.away_timeout};
  // Before the recorder is there, so that a wrong option leaves no file behind.
  ServoLoop::validate(info, loop_options);
  const auto estimator = make_velocity_estimator(options.velocity, options.rate_hz, info.position_resolution);
  LiveMonitor monitor;
  std::vector<SampleSink*> sinks(extra_sinks.begin(), extra_sinks.end());
  sinks.push_back(&monitor);

  std::optional<Recorder> recorder;
  if (options.recording) {
    columns.orientation = info.measures_orientation;
    columns.torque = info.takes_torque();
    columns.force_measured = info.measures_force;
    recorder.emplace(options.recording->file, header_for(options, info, result.virtual_time), columns,
                     options.recording->options);
    sinks.push_back(&*recorder);
  }
  ServoLoop loop(device, controller, *estimator, sinks, loop_options);

  StopRequest ours(&stop);
  Watch watch(recorder ? &*recorder : nullptr, monitor, options, progress, result);
  std::promise<ServoReport> promise;
  std::future<ServoReport> report = promise.get_future();
  std::jthread servo([&] { promise.set_value(loop.run(ours)); });
  while (report.wait_for(std::chrono::milliseconds(100)) != std::future_status::ready) {
    watch.look();
    if (!watch.disk_is_low() || !options.recording->end_when_disk_is_low || result.ended_by_disk) continue;
    result.ended_by_disk = true;
    ours.raise();
  }
  result.servo = report.get();
  servo.join();
  if (result.servo.lacks_states())
    result.remarks.push_back(fmt::format(
        "the device took only {:.0f} samples per second, the loop asked for {:g}; look at its cable and, on "
        "a serial port, at the latency timer (haptrace doctor), or ask for a lower --rate",
        result.servo.achieved_rate(), result.servo.asked_rate));

  if (recorder) {
    try {
      recorder->finish();
    } catch (const Error& error) {
      result.recording_error = error.what();
    }
    result.recording = recorder->status();
  }
  watch.look();
  return result;
}

nlohmann::json to_json(const DurationHistogram& durations) {
  return {{"p50", durations.quantile(0.5)},
          {"p99", durations.quantile(0.99)},
          {"p999", durations.quantile(0.999)},
          {"max", durations.max()}};
}

nlohmann::json to_json(const VibrationSummary& vibration) {
  constexpr std::array kRules{"energy", "half_cycles", "contacts", "slow", "torque"};
  static_assert(kRules.size() == kVibrationRules);
  nlohmann::json json{{"share", vibration.share},
                      {"worst_ripple_n", vibration.worst_ripple},
                      {"frequency_hz", vibration.frequency_hz},
                      {"ended", vibration.ended}};
  for (std::size_t i = 0; i < kRules.size(); ++i) json["steps"][kRules[i]] = vibration.steps[i];
  return json;
}

nlohmann::json to_json(const SessionResult& result) {
  const ServoReport& servo = result.servo;
  nlohmann::json json{{"samples", servo.samples},
                      {"ticks", servo.samples + servo.stale},
                      {"missed", servo.missed},
                      {"overruns", servo.overruns},
                      {"returns", servo.returns},
                      {"gaps", servo.gaps},
                      {"duration_s", servo.duration},
                      {"away_s", servo.away},
                      {"asked_rate_hz", servo.asked_rate},
                      {"achieved_rate_hz", servo.achieved_rate()},
                      {"tick_rate_hz", servo.exchange_rate()},
                      {"max_force_n", servo.max_force},
                      {"latency_s", to_json(servo.latency)},
                      {"tick_s", to_json(servo.tick_time)},
                      {"stopped_by", to_string(servo.cause)},
                      {"clock", result.virtual_time ? "virtual" : "monotonic"},
                      {"realtime",
                       {{"scheduler", result.virtual_time ? "none (virtual time)" : servo.realtime.scheduler},
                        {"memory_locked", servo.realtime.memory_locked}}}};
  if (servo.vibration.watched) json["vibration"] = to_json(servo.vibration);
  if (!servo.detail.empty()) json["stopped_because"] = servo.detail;
  if (!servo.realtime.reason.empty()) json["realtime"]["reason"] = servo.realtime.reason;
  if (!servo.flight_record.empty()) json["flight_record"] = flight_record(servo.flight_record);
  if (result.recording) {
    json["recorded"] = result.recording->written;
    json["lost"] = result.recording->lost;
    json["parts"] = result.recording->parts;
    if (result.recording->disk_seconds > 0) json["disk_lasts_s"] = result.recording->disk_seconds;
  }
  for (const TouchFigures& touch : result.touches)
    json["touches"].push_back({{"object", touch.name},
                               {"times", touch.times},
                               {"seconds", touch.seconds},
                               {"max_force_n", touch.max_force},
                               {"max_depth_m", touch.max_depth}});
  if (!result.notices.empty()) json["notices"] = result.notices;
  for (const std::string& remark : result.remarks) json["notices"].push_back(remark);
  if (!result.recording_error.empty()) json["recording_error"] = result.recording_error;
  return json;
}

}  // namespace haptrace
