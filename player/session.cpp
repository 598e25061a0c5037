#include "player/session.h"

#include "base/enum_names.h"
#include "base/error.h"
#include "base/file_hash.h"
#include "base/json_reader.h"
#include "base/suggest.h"
#include "control/event_words.h"
#include "control/velocity_estimator.h"
#include "devices/loop/watchdog.h"
#include "devices/registry.h"
#include "devices/sim/sim_device.h"
#include "formats/documents/warning_json.h"
#include "metrics/touches.h"
#include "player/supporting_controller.h"
#include "player/touching_controller.h"
#include "player/tuning/live_monitor.h"
#include "recorder/recorder.h"
#include "scene/slow_scene.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <filesystem>
#include <fmt/format.h>
#include <future>
#include <mutex>
#include <thread>
#include <utility>

namespace haptrace {
namespace {

bool choose_virtual(ClockChoice choice, const DeviceInfo& info) {
  return choice == ClockChoice::virtual_time || (choice == ClockChoice::automatic && info.virtual_time);
}

/// Returns what a recording keeps of a scene. Files in the scene's folder are named as seen from there, so that the
/// names hold on another machine.
RecordedScene recorded(const Scene& scene) {
  namespace fs = std::filesystem;
  const SceneSource& source = scene.options().source;
  const std::string folder = (source.folder.empty() ? fs::current_path() : fs::absolute(source.folder)).string();
  RecordedScene kept{.text = source.text, .objects = scene.names(), .files = {}, .folder = folder};
  for (const std::string& file : source.files) {
    std::string name = file;
    for (const std::string& prefix : {source.folder + "/", folder + "/"})
      if (prefix.size() > 1 && name.starts_with(prefix)) name.erase(0, prefix.size());
    kept.files[name] = file_hash(file);
  }
  return kept;
}

RecordingHeader header_for(const SessionOptions& options, const Device& device, const SessionResult& result,
                           const SupportPlan* support) {
  const SessionOptions::Recording& recording = *options.recording;
  const DeviceInfo& info = device.info();
  RecordingHeader header;
  header.software = software_name();
  header.title = recording.title;
  header.subject = recording.subject;
  header.operator_name = recording.operator_name;
  header.notes = recording.notes;
  header.meta = recording.meta;
  if (options.touch.scene) header.scene = recorded(*options.touch.scene);
  header.rate_hz = options.loop.rate_hz;
  header.clock = result.virtual_time ? "virtual" : "monotonic";
  header.config = recording.config;
  header.device_name = info.name;
  header.device_model = info.model;
  header.device_serial = info.serial;
  header.device_backend = info.backend;
  header.position_resolution_m = info.position_resolution;
  header.max_force_n = info.max_force;
  if (steering_of(device) != nullptr) header.meta["input"] = kIntentOfView;
  if (support != nullptr) header.config["support"] = support->support.force;
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

/// Collects the warnings of a running session and passes its status to the Progress callback.
class Watch {
 public:
  Watch(Recorder* recorder, LiveMonitor& monitor, EventTally& tally, const SessionOptions& options,
        const Progress& progress, SessionResult& result)
      : recorder_(recorder),
        monitor_(monitor),
        tally_(tally),
        options_(options),
        progress_(progress),
        result_(result) {}

  void look() {
    const std::scoped_lock lock(looking_);
    SessionView view{.live = monitor_.latest()};
    warn_of_device(view);  // before the event of its return
    take_events(view);
    if (recorder_ != nullptr) {
      view.recording = recorder_->status();
      add(view, recorder_->take_warnings());
      warn_of_losses(view);
      disk_is_low_ = view.recording->disk_low;
    }
    if (options_.warnings) add(view, options_.warnings());
    add(view, std::exchange(late_, {}));
    if (options_.observer != nullptr) options_.observer->shows(view);
    if (progress_) progress_(view);
  }

  /// Adds a warning to the next view.
  void warn(Warning warning) { late_.push_back(std::move(warning)); }

  /// Notes that the session ends, and returns true once, when the disk is almost full and the session asked for that.
  bool ends_for_disk() {
    if (!disk_is_low_ || !options_.recording->end_when_disk_is_low || result_.ended_by_disk) return false;
    return result_.ended_by_disk = true;
  }

  /// Returns a function that completes the recording when the session cannot end by itself; empty without a recording.
  /// If the thread that watches the session hangs as well, its warnings are left out.
  [[nodiscard]] std::function<void(const std::string&)> keep_when_ended() {
    if (recorder_ == nullptr) return {};
    return [this](const std::string& words) {
      const std::unique_lock lock(looking_, std::chrono::seconds(1));
      std::vector<Warning> warnings = lock ? result_.warnings : std::vector<Warning>();
      warnings.push_back({Severity::problem, "process_ended", kNaN, words});
      recorder_->finish(json_of(warnings));
    };
  }

 private:
  using Clock = std::chrono::steady_clock;

  struct Kind {
    std::uint64_t count = 0;  ///< events counted in the warning
    std::size_t entry = 0;    ///< index of the warning in the list
    Clock::time_point shown;
  };

  void add(SessionView& view, std::vector<Warning> warnings) {
    for (Warning& warning : warnings) {
      result_.warnings.push_back(warning);
      view.warnings.push_back(std::move(warning));
    }
  }

  /// Merges the events of each kind into one warning. Shows it when the first event occurs; warnings about changed
  /// gains are shown again, at most once a second.
  void take_events(SessionView& view) {
    const EventTally::Counts& counts = tally_.latest();
    const auto now = Clock::now();
    for (std::size_t row = 0; row < event_words().size(); ++row) {
      const EventCount& events = counts[row];
      Kind& kind = kinds_[row];
      if (events.count == kind.count) continue;
      const EventWords& words = event_words()[row];
      const Warning warning = warning_of(words, events);
      const bool first = kind.count == 0;
      kind.count = events.count;
      if (first) {
        kind.entry = result_.warnings.size();
        result_.warnings.push_back(warning);
      } else {
        result_.warnings[kind.entry] = warning;
      }
      if (words.share >= 0) result_.gain_share = events.last.values[static_cast<std::size_t>(words.share)];
      if (!first && (words.share < 0 || now - kind.shown < std::chrono::seconds(1))) continue;
      kind.shown = now;
      view.warnings.push_back(warning);
    }
  }

  /// Warns when the loop starts to wait for a lost device. Its return is an event.
  void warn_of_device(SessionView& view) {
    if (options_.loop.away_timeout > 0 && view.live.losses > losses_told_)
      add(view, {{Severity::warning, "device_lost", view.live.time,
                  fmt::format("the device was lost; the session waits up to {:g} s for its return, with zero force",
                              options_.loop.away_timeout)}});
    losses_told_ = view.live.losses;
  }

  /// Warns of lost samples and a stalled disk, at most once a second. The writer cannot warn while it waits for the
  /// disk.
  void warn_of_losses(SessionView& view) {
    const auto now = Clock::now();
    if (now - told_ < std::chrono::seconds(1)) return;
    const RecorderStatus& status = *view.recording;
    // A single stalled reading does not count: after a stop of the whole process, the writer soon answers again.
    const bool still_stalled = std::exchange(stalled_, status.stalled > 1) && stalled_;
    if (status.lost > lost_told_ && !status.failed) {
      add(view,
          {{Severity::warning, "samples_lost", view.live.time,
            fmt::format("{}: {} samples were lost so far: the disk is too slow", recorder_->file(), status.lost)}});
      lost_told_ = status.lost;
      told_ = now;
    } else if (still_stalled) {
      add(view, {{Severity::warning, "disk_stalled", view.live.time,
                  fmt::format("{}: the disk has not answered for {:.0f} s; samples wait in memory", recorder_->file(),
                              status.stalled)}});
      told_ = now;
    }
  }

  Recorder* recorder_;
  LiveMonitor& monitor_;
  EventTally& tally_;
  const SessionOptions& options_;
  const Progress& progress_;
  SessionResult& result_;
  std::array<Kind, kMostEventKinds> kinds_{};  ///< indexed by row of event_words()
  std::vector<Warning> late_;
  Clock::time_point told_;
  std::uint64_t lost_told_ = 0, losses_told_ = 0;
  bool disk_is_low_ = false, stalled_ = false;
  std::timed_mutex looking_;  ///< protects the list of warnings from the watchdog
};

/// Returns a warning if the machine caused missed ticks on the real clock. `doctor` allows a thousandth of the ticks.
std::optional<Warning> overruns_of(const SessionResult& result) {
  constexpr double kMostMissed = 1e-3;  // share of all ticks
  const ServoReport& servo = result.servo;
  if (result.virtual_time || servo.overruns == 0) return std::nullopt;
  const bool many = static_cast<double>(servo.missed) > kMostMissed * static_cast<double>(servo.samples + servo.missed);
  if (!many && servo.realtime.reason.empty()) return std::nullopt;
  return Warning{
      many ? Severity::warning : Severity::note, "overruns", kNaN,
      fmt::format("{} of {} ticks were missed in {} overruns; {}", servo.missed, servo.samples + servo.missed,
                  servo.overruns,
                  servo.realtime.reason.empty() ? "run haptrace doctor to find the cause" : servo.realtime.reason)};
}

/// Adds warnings about the cause of the session's end. conclude() reports it to the user.
void warn_of_end(SessionResult& result) {
  const ServoReport& servo = result.servo;
  if (result.ended_by_disk)
    result.warn(Severity::problem, "disk_full", "the session ended because the disk is almost full");
  if (servo.stopped_by_fault())
    result.warnings.push_back(
        {Severity::problem, "stopped", servo.duration,
         servo.detail.empty() ? std::string("stopped: ") + to_string(servo.cause) : servo.detail});
  if (result.zero_force == ZeroForce::failed)
    result.warn(Severity::problem, "force_not_zero", describe(result.zero_force));
}

/// Returns the state of the motors. If a device was lost, perhaps with a force in its motors, waits for its return to
/// remove that force.
ZeroForce zero_after(Device& device, const ServoReport& servo, Watch& watch) {
  const ZeroForce zero = device.zero_force();
  if (zero == ZeroForce::confirmed || servo.cause != StopCause::device_lost) return zero;
  device.close();
  if (!can_be_zeroed_again(device.info())) return zero;
  watch.warn({Severity::warning, "device_lost", servo.duration,
              fmt::format("the device was lost, perhaps with a force in its motors; if it returns within {:g} s, it is "
                          "opened only to remove this force",
                          kZeroingWindow)});
  watch.look();
  return std::min(zero, zero_when_back(device.info()));
}

/// The controller of a session with what acts beside it: the support of the arm, and the scene.
class ActingController {
 public:
  /// Borrows everything. Throws what plan_support and make_scene_controller throw.
  ActingController(Controller& controller, const SessionOptions& options, const DeviceInfo& info)
      : outermost_(&controller) {
    if (options.support.acts()) {
      plan_ = plan_support(info, options);
      outermost_ = &supporting_.emplace(controller, plan_.support, options.touch);
    }
    if (options.touch.scene) outermost_ = &touching_.emplace(*outermost_, options.touch, info, options.loop.rate_hz);
  }

  /// Returns the controller that the loop calls.
  [[nodiscard]] Controller& outermost() noexcept { return *outermost_; }
  /// Returns the support of the arm, if there is one.
  [[nodiscard]] const SupportPlan* support() const noexcept { return supporting_ ? &plan_ : nullptr; }
  /// Returns the force that carries the arm once it has risen, as commands left it [N].
  [[nodiscard]] double support_force() const noexcept { return supporting_ ? supporting_->force() : 0; }
  /// Returns the controller that renders the scene, if there is one.
  [[nodiscard]] const TouchingController* touching() const noexcept { return touching_ ? &*touching_ : nullptr; }

 private:
  Controller* outermost_;
  SupportPlan plan_;
  std::optional<SupportingController> supporting_;
  std::optional<TouchingController> touching_;
};

/// Adds the columns of the scene, of the support and of the device to those of the controller.
RecordingColumns with_device_columns(RecordingColumns columns, const DeviceInfo& info, const SessionOptions& options) {
  if (options.touch.scene) columns.contacts = true;
  columns.support = options.support.acts();
  columns.orientation = info.measures_orientation;
  columns.torque = info.takes_torque();
  columns.force_measured = info.measures_force;
  return columns;
}

/// Returns the warnings that are known before the first tick.
std::vector<Warning> first_warnings(const SessionOptions& options) {
  std::vector<Warning> warnings = options.known;
  const TouchOptions& touch = options.touch;
  if (!touch.scene) return warnings;
  const auto note = [&](const std::vector<std::string>& texts) {
    std::ranges::move(known_warnings(Severity::note, "scene", texts), std::back_inserter(warnings));
  };
  note(touch.scene->notes());
  if (touch.slow) note(notes_on_prediction(*touch.scene, touch.slow->prediction));
  return warnings;
}

/// Runs the loop to its end in a thread of its own, with a watchdog, and looks at the session meanwhile.
ServoReport run_watched(ServoLoop& loop, Device& device, const ServoOptions& options, Watch& watch,
                        const StopRequest& stop) {
  StopRequest ours(&stop);
  std::promise<ServoReport> promise;
  std::future<ServoReport> report = promise.get_future();
  std::jthread servo([&] {
    const SignalStack stack;
    promise.set_value(loop.run(ours));
  });
  std::optional<Watchdog> watchdog;
  watchdog.emplace(Watchdog::Session{.pulse = loop.pulse(),
                                     .device = device,
                                     .stop = ours,
                                     .keep = watch.keep_when_ended(),
                                     .realtime = options.realtime && !options.virtual_time,
                                     .virtual_time = options.virtual_time});
  while (report.wait_for(std::chrono::milliseconds(100)) != std::future_status::ready) {
    watch.look();
    if (watch.ends_for_disk()) ours.raise();
  }
  ServoReport ended = report.get();
  servo.join();
  watchdog.reset();
  return ended;
}

/// Warns of a device and of a machine that did not keep up with the loop.
void warn_of_rate(const SessionResult& result, Watch& watch) {
  const ServoReport& servo = result.servo;
  if (servo.lacks_states())
    watch.warn({Severity::warning, "few_states", kNaN,
                fmt::format("the device delivered only {:.0f} samples per second; the loop requested {:g}; check its "
                            "cable and, on a serial port, the latency timer (haptrace doctor), or set a lower --rate",
                            servo.achieved_rate(), servo.asked_rate)});
  if (auto overruns = overruns_of(result)) watch.warn(std::move(*overruns));
}

/// Completes the recording with the warnings of the session. The result reports an error.
void finish_recording(Recorder& recorder, SessionResult& result) {
  try {
    recorder.finish(json_of(result.warnings));
  } catch (const Error& error) {
    result.recording_error = error.what();
    result.warn(Severity::problem, "recording_failed", error.what());
  }
  result.recording = recorder.status();
}

}  // namespace

void SessionOptions::also_warn(std::function<std::vector<Warning>()> more) {
  if (!warnings) {
    warnings = std::move(more);
    return;
  }
  warnings = [first = std::move(warnings), more = std::move(more)] {
    std::vector<Warning> all = first();
    std::ranges::move(more(), std::back_inserter(all));
    return all;
  };
}

ClockChoice parse_clock(std::string_view name) {
  static constexpr EnumNames<ClockChoice, 3> kClocks{"clock", {"auto", "real", "virtual"}};
  return kClocks.parse(name);
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

  ServoOptions loop_options = options.loop;
  loop_options.virtual_time = result.virtual_time;
  // Before the recorder is there, so that a wrong option leaves no file behind.
  ServoLoop::validate(info, loop_options);
  const auto estimator = make_velocity_estimator(options.velocity, options.loop.rate_hz, info.position_resolution);
  ActingController acting(controller, options, info);
  if (acting.support() != nullptr) {
    loop_options.limits.release = std::max(loop_options.limits.release, kSupportedRelease);
  }
  result.warnings = first_warnings(options);
  columns = with_device_columns(columns, info, options);

  LiveMonitor monitor;
  EventTally tally;
  std::vector<SampleSink*> sinks(extra_sinks.begin(), extra_sinks.end());
  sinks.push_back(&monitor);
  sinks.push_back(&tally);
  std::optional<Recorder> recorder;
  if (options.recording)
    sinks.push_back(&recorder.emplace(options.recording->file, header_for(options, device, result, acting.support()),
                                      columns, options.recording->options));
  if (options.observer != nullptr) {
    sinks.push_back(&options.observer->sink());
    options.observer->begins(device, options, columns, result.virtual_time);
  }
  ServoLoop loop(device, acting.outermost(), *estimator, sinks, loop_options);

  Watch watch(recorder ? &*recorder : nullptr, monitor, tally, options, progress, result);
  const auto warn_all = [&](const char* code, const std::vector<std::string>& texts) {
    for (Warning& warning : known_warnings(Severity::warning, code, texts)) watch.warn(std::move(warning));
  };
  if (acting.support() != nullptr) warn_all("support", acting.support()->warnings);
  result.servo = run_watched(loop, device, loop_options, watch, stop);
  result.zero_force = zero_after(device, result.servo, watch);
  result.support = acting.support_force();
  if (result.servo.vibration.watched) result.gain_share = result.servo.vibration.share;
  warn_of_rate(result, watch);
  if (acting.touching() != nullptr) {
    result.touches = acting.touching()->scene().figures();
    warn_all("scene_rate", acting.touching()->scene().remarks());
  }
  watch.look();
  warn_of_end(result);
  if (recorder) {
    finish_recording(*recorder, result);
    watch.look();
  }
  if (options.observer != nullptr) options.observer->ends(result);
  return result;
}

std::vector<Warning> known_warnings(Severity severity, const char* code, std::span<const std::string> texts) {
  std::vector<Warning> warnings;
  for (const std::string& text : texts) warnings.push_back({severity, code, kNaN, text});
  return warnings;
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
  // "samples" counts those in the file if there is a recording.
  nlohmann::json json{
      {"samples", result.recording ? result.recording->written : servo.samples},
      {"session_samples", servo.samples},
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
      {"stopped_from",
       servo.cause == StopCause::interrupted ? nlohmann::json(to_string(servo.stopped_from)) : nlohmann::json()},
      {"zero_force", to_string(result.zero_force)},
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
  if (!result.touches.empty()) json["touches"] = json_of(result.touches);
  json["warnings"] = json_of(result.warnings);
  for (const Warning& warning : result.warnings) json["notices"].push_back(warning.text);
  json["gain_share"] = result.gain_share;
  if (result.support > 0) json["support_n"] = result.support;
  if (!result.recording_error.empty()) json["recording_error"] = result.recording_error;
  return json;
}

}  // namespace haptrace
