#include "devices/check/doctor.h"

#include "base/error.h"
#include "base/statistics.h"
#include "cli/terminal.h"
#include "cli/verb.h"
#include "devices/check/usb_devices.h"
#include "player/playback/playback.h"
#include "recorder/disk_check.h"
#include "recorder/recorder.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <unistd.h>

namespace haptrace::cli {
namespace {

struct DoctorArguments {
  double rate_hz = 1000;
  double duration = 10;
  std::string folder = ".";
  bool cyclictest = false;
  bool udev_rules = false;
};

/// Shows the current measurement on standard error, if that is a terminal.
class Stage {
 public:
  explicit Stage(const Output& output) : shown_(!output.quiet && isatty(STDERR_FILENO) != 0) {}
  ~Stage() { show(""); }
  Stage(const Stage&) = delete;
  Stage& operator=(const Stage&) = delete;
  void show(const std::string& text) const {
    if (shown_) show_line(text);
  }

 private:
  bool shown_;
};

/// The same loop measured by Debian's cyclictest, or the reason why there is no result.
struct Comparison {
  DurationHistogram latency;
  std::vector<double> p999_of_turns;  ///< [s]
  std::string refusal;                ///< empty: it ran
};

/// Measures in turns of a second, at least four. With cyclictest, the two alternate and swap their order, so that
/// neither gets only the quiet times of the machine.
void measure(const DoctorArguments& arguments, const StopRequest& stop, const Stage& stage, LoopMeasurement& loop,
             Comparison* comparison) {
  const int turns = std::max(4, static_cast<int>(std::lround(arguments.duration)));
  const double span = arguments.duration / turns;
  const auto theirs = [&] {
    if (comparison == nullptr || !comparison->refusal.empty() || stop.count() > 0) return;
    try {
      const DurationHistogram turn = measure_cyclictest(arguments.rate_hz, span);
      comparison->latency.merge(turn);
      comparison->p999_of_turns.push_back(turn.quantile(0.999));
    } catch (const Error& error) {
      comparison->refusal = error.what();
    }
  };
  for (int turn = 0; turn < turns && stop.count() == 0; ++turn) {
    stage.show(fmt::format("servo loop{}: {:.0f} of {:g} s", comparison != nullptr ? " and cyclictest in turns" : "",
                           turn * span, arguments.duration));
    if (turn % 2 == 1) theirs();
    measure_loop(loop, span, stop);
    if (turn % 2 == 0) theirs();
  }
}

nlohmann::json to_json(const LoopMeasurement& loop) {
  nlohmann::json json{{"duration_s", loop.duration},
                      {"samples", loop.samples},
                      {"missed", loop.missed},
                      {"missed_fraction", loop.missed_fraction()},
                      {"overruns", loop.overruns},
                      {"latency_s", haptrace::to_json(loop.latency)},
                      {"scheduler", loop.realtime.scheduler},
                      {"memory_locked", loop.realtime.memory_locked},
                      {"timer_slack_s", 1e-9 * static_cast<double>(loop.timer_slack_ns)}};
  if (loop.stolen) json["stolen_s"] = *loop.stolen;
  return json;
}

nlohmann::json to_json(const DiskMeasurement& disk) {
  return {{"folder", disk.folder},
          {"write_s", haptrace::to_json(disk.write)},
          {"sync_s", haptrace::to_json(disk.sync)},
          {"session_s_per_write", disk.flush_period},
          {"free_bytes", disk.free_bytes},
          {"recording_bytes_per_s", disk.bytes_per_hour / 3600},
          {"recording_s", 3600 * disk.hours()}};
}

std::string table_of(const std::vector<Diagnosis>& diagnoses) {
  std::size_t widest = 0;
  for (const Diagnosis& diagnosis : diagnoses) widest = std::max(widest, diagnosis.check.size());
  std::string text;
  for (const Diagnosis& diagnosis : diagnoses) {
    text +=
        fmt::format("{:<8} {:<{}}  {}\n", to_string(diagnosis.severity), diagnosis.check, widest, diagnosis.measured);
    if (!diagnosis.remedy.empty()) text += fmt::format("{:<8} {:<{}}  -> {}\n", "", "", widest, diagnosis.remedy);
  }
  return text;
}

std::vector<Diagnosis> look_at_disk(const DoctorArguments& arguments, nlohmann::json& json) {
  try {
    const DiskMeasurement disk = measure_disk(arguments.folder, arguments.rate_hz);
    json["disk"] = to_json(disk);
    return examine_disk(disk, RecorderOptions{}.ring_seconds);
  } catch (const Error& error) {
    json["disk"] = {{"folder", arguments.folder}, {"error", error.what()}};
    return {{Severity::problem, "disk write", error.what(), "haptrace doctor --folder DIR"}};
  }
}

/// Throws Error(input) if an option is out of its range, or the folder does not exist.
void check_arguments(const DoctorArguments& arguments) {
  std::error_code error;
  if (!std::filesystem::is_directory(arguments.folder, error))
    throw input_error(fmt::format("--folder {}: there is no such folder", arguments.folder));
  ServoLoop::validate({}, {.rate_hz = arguments.rate_hz});
  if (!(arguments.duration > 0 && arguments.duration <= 86400))
    throw input_error(fmt::format("--duration is {} s; it must be above 0 and at most a day", arguments.duration));
}

/// Compares the wake-up latency of the loop with that of cyclictest, and adds both to `json`.
Diagnosis compare(const LoopMeasurement& loop, const Comparison& comparison, nlohmann::json& json) {
  Diagnosis compared{Severity::note, "cyclictest", comparison.refusal, ""};
  if (comparison.refusal.empty()) {
    // Disturbances of a few turns do not change the median.
    const double ours = median(loop.p999_of_turns), theirs = median(comparison.p999_of_turns);
    const double ratio = ours / std::max(theirs, 1e-9);
    compared.measured = fmt::format("{}; the servo loop's p99.9 is {:.2f} times as long (medians of {} turns)",
                                    quantiles_text(comparison.latency), ratio, loop.p999_of_turns.size());
    json["cyclictest"] = {{"samples", comparison.latency.count()},
                          {"latency_s", haptrace::to_json(comparison.latency)},
                          {"median_p999_s", {{"loop", ours}, {"cyclictest", theirs}}},
                          {"p999_ratio", ratio}};
  } else {
    json["cyclictest"] = {{"error", comparison.refusal}};
  }
  return compared;
}

nlohmann::json to_json(const std::vector<Diagnosis>& diagnoses) {
  nlohmann::json list = nlohmann::json::array();
  for (const Diagnosis& diagnosis : diagnoses)
    list.push_back({{"severity", to_string(diagnosis.severity)},
                    {"check", diagnosis.check},
                    {"measured", diagnosis.measured},
                    {"remedy", diagnosis.remedy}});
  return list;
}

int examine(const DoctorArguments& arguments, const Output& output) {
  check_arguments(arguments);
  nlohmann::json json{
      {"rate_hz", arguments.rate_hz},
      {"criterion", {{"missed_fraction", kMostMissed}, {"latency_p999_s", kLatestWakeUp / arguments.rate_hz}}}};
  LoopMeasurement loop{.rate_hz = arguments.rate_hz};
  Comparison comparison;
  std::vector<Diagnosis> diagnoses = examine_system();
  const auto add = [&](const std::vector<Diagnosis>& more) {
    diagnoses.insert(diagnoses.end(), more.begin(), more.end());
  };
  const Signals signals;
  {
    const Stage stage(output);
    stage.show("disk");
    add(look_at_disk(arguments, json));
    measure(arguments, signals.stop(), stage, loop, arguments.cyclictest ? &comparison : nullptr);
  }
  if (signals.stop().count() > 0) {
    output.remark("interrupted");
    return kInterrupted;
  }
  add(examine_loop(loop));

  if (arguments.cyclictest) diagnoses.push_back(compare(loop, comparison, json));

  json["holds_rate"] = loop.holds_rate();
  json["loop"] = to_json(loop);
  json["findings"] = to_json(diagnoses);
  const auto problems = std::count_if(diagnoses.begin(), diagnoses.end(), [](const Diagnosis& diagnosis) {
    return diagnosis.severity == Severity::problem;
  });
  output.tell(json, table_of(diagnoses) + fmt::format("this machine {} {:g} Hz; problems: {}\n",
                                                      loop.holds_rate() ? "sustains" : "does not sustain", loop.rate_hz,
                                                      problems));
  return problems == 0 ? kDone : kStopped;
}

}  // namespace

Verb add_doctor(CLI::App& app) {
  const auto arguments = std::make_shared<DoctorArguments>();
  CLI::App* verb =
      app.add_subcommand("doctor", "check whether this machine can sustain the servo rate, and how to fix it if not");
  verb->footer(fmt::format(
      "Runs the servo loop on a simulated device in real time, writes to the disk as the recorder does, and checks\n"
      "the settings of the system. Every result is ok, a note, a warning or a problem, with the command that fixes\n"
      "it. The exit code is 1 if there is a problem: more than {:g} % of the ticks missed, p99.9 of the wake-up\n"
      "latency above {:g} of a period, a disk too slow for the recorder, or a known device that is plugged in but\n"
      "that you have no permission to open.\n"
      "  haptrace doctor\n"
      "  haptrace doctor --cyclictest --duration 60",
      100 * kMostMissed, kLatestWakeUp));
  verb->add_option("--rate", arguments->rate_hz, "servo rate to sustain [Hz], 10 to 20000")->capture_default_str();
  verb->add_option("--duration", arguments->duration, "duration of the measurement of the loop [s]")
      ->capture_default_str();
  verb->add_option("--folder", arguments->folder, "folder of the recordings; its disk is measured")
      ->type_name("DIR")
      ->capture_default_str();
  verb->add_flag("--cyclictest", arguments->cyclictest,
                 "run Debian's cyclictest (package rt-tests) in turns with the loop, and compare the latencies");
  verb->add_flag("--udev-rules", arguments->udev_rules, "print the udev rules of every known device, and nothing else");
  return {verb, [arguments](const Output& output) {
            if (!arguments->udev_rules) return examine(*arguments, output);
            nlohmann::json list = nlohmann::json::array();
            for (const KnownUsbDevice& device : known_usb_devices()) list.push_back(device.udev_rule());
            output.tell({{"udev_rules", std::move(list)}}, udev_rules_file());
            return static_cast<int>(kDone);
          }};
}

}  // namespace haptrace::cli
