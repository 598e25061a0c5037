#include "cli/verb.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "base/output_file.h"
#include "base/printable.h"
#include "base/suggest.h"
#include "base/text_file.h"
#include "base/units.h"
#include "base/vectors.h"
#include "cli/help.h"
#include "cli/input_options.h"
#include "cli/terminal.h"
#include "devices/device_spec.h"
#include "devices/loop/recovering_device.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fmt/format.h>
#include <limits>
#include <set>
#include <unistd.h>

namespace haptrace::cli {
namespace {

StopRequest* raised_by_signals = nullptr;

/// Counts stop requests. The first one fades the force out, and the second one ends the session at its next tick. If no
/// tick comes because a driver does not return, the third one ends the process; the device or its guardian must then
/// remove the force.
void on_signal(int signal) {
  if (raised_by_signals == nullptr) return;
  raised_by_signals->raise();
  if (raised_by_signals->count() < 3) return;
  ::signal(signal, SIG_DFL);
  ::raise(signal);
}

std::string text_of(const nlohmann::json& value) {
  return value.is_string() ? value.get<std::string>() : value.dump();
}

/// Returns a number, true or false if the text is one, else the text.
nlohmann::json value_of(const std::string& text) {
  const nlohmann::json parsed = nlohmann::json::parse(text, nullptr, false);
  return parsed.is_number() || parsed.is_boolean() ? parsed : nlohmann::json(text);
}

/// The options that --config gave, not the command line.
std::set<const CLI::Option*>& configured() {
  static std::set<const CLI::Option*> options;
  return options;
}

/// Returns the key and the value of "KEY=VALUE".
std::pair<std::string, std::string> split_meta(const std::string& text) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0)
    throw input_error(fmt::format("--meta '{}' is not KEY=VALUE, as in --meta hand=left", text));
  return {text.substr(0, equals), text.substr(equals + 1)};
}

/// Returns the values of the template, completed and overridden by the given ones.
std::map<std::string, std::string> metadata(const std::string& file, const std::vector<std::string>& given) {
  std::map<std::string, std::string> meta;
  std::vector<std::string> wanted;
  if (!file.empty()) {
    const nlohmann::json json = load_json(file);
    if (!json.is_object())
      throw input_error(fmt::format("{}: the template must be a JSON object of keys and values", file));
    for (const auto& [key, value] : json.items()) {
      if (value.is_null())
        wanted.push_back(key);
      else if (value.is_structured())
        throw input_error(
            fmt::format("{}: key '{}': the value must be a string, a number, true, false or null", file, key));
      else
        meta[key] = text_of(value);
    }
  }
  for (const std::string& text : given) {
    const auto [key, value] = split_meta(text);
    meta[key] = value;
  }
  std::erase_if(wanted, [&](const std::string& key) { return meta.contains(key); });
  if (!wanted.empty())
    throw input_error(fmt::format("{} requires {}: give {} with --meta {}=...", file, fmt::join(wanted, ", "),
                                  wanted.size() > 1 ? "them" : "it", wanted.front()));
  return meta;
}

bool is_verb(const CLI::App& app, const std::string& name) {
  const auto verbs = app.get_subcommands([&](const CLI::App* verb) { return verb->get_name() == name; });
  return !verbs.empty();
}

}  // namespace

void Output::tell(const nlohmann::json& json_result, const std::string& text) const {
  if (json)
    write_out(stdout, with_input_names(printable_json(json_result), true) + "\n");
  else if (!quiet)
    write_out(stdout, printable_lines(with_input_names(text)));
}

void Output::remark(const std::string& text) const {
  if (!quiet) fault(text);
}

void Output::fault(const std::string& text) const {
  write_out(stderr, fmt::format("haptrace: {}\n", printable_lines(with_input_names(text))));
}

void Output::warn(const Warning& warning) const {
  if (warning.severity == Severity::problem)
    fault(warning.text);
  else
    remark(warning.text);
}

void SessionArguments::add_to(CLI::App& app) {
  app.add_option("-d,--device", device, "device, with options as key=value,... (`haptrace devices` lists all)")
      ->type_name("NAME[:...]");
  add_loop_to(app);
  add_safety_to(app);
  add_metadata_to(app);
  add_storage_to(app);
  add_marks_to(app);
  app.add_flag("--overwrite", overwrite, "replace an existing file")->group("Recording");
}

void SessionArguments::add_loop_to(CLI::App& app) {
  app.add_option("--rate", rate_hz, "servo rate [Hz], 10 to 20000")->capture_default_str()->group("Loop");
  app.add_option("--clock", clock,
                 "clock of the loop: real | virtual (reproducible, as fast as the machine allows) | auto (virtual for "
                 "simulated devices)")
      ->capture_default_str()
      ->group("Loop");
  app.add_option("--velocity", velocity,
                 "velocity estimator: difference | lowpass:HZ | foaw:SAMPLES | least-squares:SAMPLES | "
                 "alpha-beta-gamma:HZ")
      ->capture_default_str()
      ->group("Loop");
  app.add_option("--seed", seed, "random seed of a simulated device")->group("Loop");
  app.add_flag("--no-realtime", no_realtime, "do not request real-time scheduling and locked memory")->group("Loop");
}

void SessionArguments::add_safety_to(CLI::App& app) {
  app.add_option("--max-force", limits.max_force, "force limit [N] (0: the device's limit)")
      ->capture_default_str()
      ->group("Safety");
  app.add_option("--max-continuous-force", limits.max_continuous_force,
                 "rms force limit over 10 s [N] (0: the device's limit, or 0.3 of its peak force over 20 s)")
      ->capture_default_str()
      ->group("Safety");
  app.add_option("--max-velocity", limits.max_velocity, "tool speed above which the session stops [m/s] (0: off)")
      ->capture_default_str()
      ->group("Safety");
  app.add_option("--soft-start", limits.soft_start, "time over which forces fade in [s]")
      ->capture_default_str()
      ->group("Safety");
  app.add_option("--release", limits.release, "time over which forces fade out [s]")
      ->capture_default_str()
      ->group("Safety");
}

void SessionArguments::add_metadata_to(CLI::App& app) {
  app.add_option("--title", title, "title, stored in the recording")->group("Recording");
  app.add_option("--subject", subject, "participant, stored in the recording")->group("Recording");
  app.add_option("--operator", operator_name, "operator, stored in the recording")->group("Recording");
  app.add_option("--notes", notes, "notes, stored in the recording")->group("Recording");
  app.add_option("--meta", meta, "further metadata of the recording; may be repeated")
      ->type_name("KEY=VALUE")
      ->group("Recording");
  app.add_option("--meta-file", meta_file,
                 "template of the metadata: a JSON object; a key whose value is null must be given with --meta")
      ->type_name("FILE.json")
      ->group("Recording");
}

void SessionArguments::add_storage_to(CLI::App& app) {
  app.add_option("--split", split,
                 "start a new file every 30min, 2h or 1GiB; all verbs read the files as one recording")
      ->type_name("TIME|SIZE")
      ->group("Recording");
  app.add_option("--sync", sync,
                 "interval of forced writes to the disk, against power cuts [s] (0: the system decides)")
      ->capture_default_str()
      ->group("Recording");
  app.add_option("--precision", precision,
                 "largest rounding errors of stored values, as in 1um,1mN (m, m/s, N, Nm) (default: exact)")
      ->type_name("BOUNDS")
      ->group("Recording");
  app.add_option("--compress", compress, "compression level, 1 to 9 (0: none)")
      ->capture_default_str()
      ->group("Recording");
}

void SessionArguments::add_marks_to(CLI::App& app) {
  app.add_flag("--mark-buttons", mark_buttons, "set a mark when a button of the device is pressed")->group("Recording");
  app.add_option("--mark-texts", mark_texts, "texts of the mark keys 1 to 9, separated by commas")
      ->delimiter(',')
      ->group("Recording");
  app.add_flag("--keys", keys, "read keys even if standard input is not a terminal")->group("Recording");
}

void SessionArguments::add_wait_to(CLI::App& app) {
  app.add_option("--wait-for-device", wait_for_device,
                 "wait this long for a lost device to return, with zero force [s] (0: end the session at once)")
      ->capture_default_str()
      ->group("Safety");
}

void SessionArguments::add_support_to(CLI::App& app) {
  app.add_option("--support", support, "part of the arm's weight that the device carries [N] (0: none)")
      ->capture_default_str()
      ->group("Arm");
  app.add_option("--up", up, "direction upwards, for --support")
      ->type_name("X,Y,Z")
      ->capture_default_str()
      ->group("Arm");
}

std::uint64_t SessionArguments::first_seed() const {
  return DeviceSpec::parse(device).number<std::uint64_t>("seed", 0, std::numeric_limits<std::uint64_t>::max(),
                                                         seed.value_or(1));
}

std::unique_ptr<Device> SessionArguments::open(const std::vector<std::pair<std::string, std::string>>& extra,
                                               std::uint64_t number) const {
  DeviceSpec spec = DeviceSpec::parse(device);
  const auto& backends = device_backends();
  const auto backend =
      std::find_if(backends.begin(), backends.end(), [&](const auto& b) { return b.name == spec.name; });
  const auto known = [&](const std::string& key) {
    if (backend == backends.end()) return false;  // open_device reports the error
    return std::ranges::any_of(backend->options, [&](const auto& o) { return o.key == key; });
  };
  const auto put = [&](const std::string& key, const std::string& value) {
    if (known(key)) spec.options.emplace(key, value);
  };
  if (seed) put("seed", std::to_string(*seed));
  if (number > 0 && known("seed")) spec.options["seed"] = std::to_string(first_seed() + number);
  for (const auto& [key, value] : extra) put(key, value);
  if (wait_for_device > 0) return std::make_unique<RecoveringDevice>([spec] { return open_device(spec); });
  return open_device(spec);
}

SessionOptions SessionArguments::options(const std::string& file, const nlohmann::json& config) const {
  SessionOptions options;
  options.loop.rate_hz = rate_hz;
  options.clock = parse_clock(clock);
  options.velocity = velocity;
  options.loop.limits = limits;
  options.loop.realtime = !no_realtime;
  options.loop.away_timeout = wait_for_device;
  options.support.force = support;
  options.support.up = parse_direction(up, "--up");
  if (file.empty()) return options;

  // Formats of other programs, which could not read HDF5 under these names.
  constexpr std::string_view kOthers[] = {".csv", ".tsv", ".txt", ".json", ".jsonl", ".xdf", ".mat", ".png", ".svg"};
  if (std::find(std::begin(kOthers), std::end(kOthers), file_ending(file)) != std::end(kOthers))
    throw input_error(
        fmt::format("{}: a session is recorded as HDF5. Name the file {}; haptrace convert writes other formats", file,
                    std::filesystem::path(file).replace_extension(".h5").string()));
  // Values in the device description, such as the simulated hand's path or the recording of a replay device.
  std::vector<std::string> of_device;
  for (std::size_t at = device.find('='); at != std::string::npos; at = device.find('=', at + 1))
    of_device.push_back(device.substr(at + 1, device.find(',', at) - at - 1));
  keep_inputs(file, of_device);
  constexpr std::size_t kMarkKeys = 9;
  if (mark_texts.size() > kMarkKeys)
    throw input_error(
        fmt::format("--mark-texts has {} texts, but there are {} keys for them, 1 to 9", mark_texts.size(), kMarkKeys));
  for (const std::string& text : mark_texts)
    if (text.size() > kLongestEventText)
      throw input_error(fmt::format("--mark-texts: '{}' has {} bytes; a text may have at most {}", text, text.size(),
                                    kLongestEventText));

  SessionOptions::Recording recording{.file = file, .config = config};
  recording.options.overwrite = overwrite;
  recording.options.sync_period = sync;
  recording.options.storage = {.deflate = compress, .precision = parse_precision(precision)};
  if (!split.empty()) recording.options.split = parse_split(split);
  recording.options.capture.mark_buttons = mark_buttons;
  recording.options.annotations = std::make_shared<Annotations>();
  recording.meta = metadata(meta_file, meta);
  // Four keys have options of their own, which take precedence.
  for (const auto& [key, given, kept] : {std::tuple{"title", &title, &recording.title},
                                         {"subject", &subject, &recording.subject},
                                         {"operator", &operator_name, &recording.operator_name},
                                         {"notes", &notes, &recording.notes}}) {
    auto found = recording.meta.extract(key);
    *kept = given->empty() && found ? found.mapped() : *given;
  }
  options.recording = std::move(recording);
  return options;
}

void require(const CLI::App& verb, const std::string& option) {
  const CLI::Option* needed = verb.get_option(option);
  if (needed->count() > 0) return;
  // A positional argument has no name that a user types.
  throw input_error(fmt::format("haptrace {} needs {}; see haptrace {} --help", full_name(verb),
                                needed->get_lnames().empty() ? needed->get_type_name() : option, full_name(verb)));
}

void refuse_useless(const CLI::App& verb, std::span<const Dependence> dependences) {
  for (const Dependence& one : dependences) {
    const CLI::Option* option = verb.get_option(one.option);
    if (!one.works && option->count() > 0 && !configured().contains(option))
      throw input_error(
          fmt::format("{} has no effect without {}: leave it out, or give {}", one.option, one.needs, one.needs));
  }
}

void refuse_unrecorded(const CLI::App& verb, bool recorded) {
  for (const char* option : {"--subject", "--operator", "--notes", "--meta", "--meta-file", "--split", "--sync",
                             "--precision", "--compress"})
    refuse_useless(verb, std::to_array<Dependence>({{option, recorded, "--record"}}));
}

void keep_inputs(const std::string& output, std::span<const std::string> inputs) {
  std::error_code none;
  for (const std::string& input : inputs)
    if (!output.empty() && !input.empty() && std::filesystem::equivalent(output, input, none))
      throw input_error(
          fmt::format("{} is an input of this command and would be overwritten; choose another name", output));
}

void clean_up(const Output& output, const std::string& file) {
  for (const std::string& left : remove_leftovers(file))
    output.remark(
        fmt::format("removed {}, which was left unfinished by a process that no longer runs", printable(left)));
}

void apply_config(CLI::App& verb, const std::string& file) {
  apply_config(verb, load_json(file), file);
}

void apply_config(CLI::App& verb, const nlohmann::json& config, const std::string& file) {
  if (!config.is_object())
    throw input_error(fmt::format("{}: the configuration must be a JSON object of options", file));
  // The output of `info --json` has the configuration of a recording among other facts.
  if (const auto recorded = config.find("config"); recorded != config.end() && recorded->is_object()) {
    nlohmann::json again = *recorded;
    again.erase("overwrite");  // the file that it would replace is the one that it came from
    return apply_config(verb, again, file + ": config");
  }
  std::vector<std::string> known;
  std::vector<CLI::Option*> options;  // one per name
  for (CLI::Option* option : verb.get_options()) {
    std::vector<std::string> spellings = option->get_lnames();
    if (spellings.empty()) spellings.push_back(option->get_name());
    known.insert(known.end(), spellings.begin(), spellings.end());
    options.insert(options.end(), spellings.size(), option);
  }

  // Options for this verb alone come before those for all verbs.
  const std::string name = full_name(verb);
  if (const auto own = config.find(name); own != config.end() && own->is_object())
    apply_config(verb, *own, fmt::format("{}: {}", file, name));
  for (const auto& [key, value] : config.items()) {
    if (key == "verb") {
      if (value != name)
        throw input_error(fmt::format("{}: this configuration is for haptrace {}", file, text_of(value)));
      continue;
    }
    if (value.is_object() && is_verb(root_of(verb), key)) continue;
    const auto found = std::find(known.begin(), known.end(), key);
    if (found == known.end())
      throw input_error(fmt::format("{}: unknown key '{}'{}", file, key, suggestion(key, known)));
    CLI::Option* option = options[static_cast<std::size_t>(found - known.begin())];
    if (option->count() > 0) continue;
    try {
      if (value.is_array())
        for (const auto& item : value) option->add_result(text_of(item));
      else
        option->add_result(text_of(value));
      option->run_callback();
      configured().insert(option);
    } catch (const CLI::ParseError& error) {
      throw input_error(fmt::format("{}: key '{}': {}", file, key, explained(error)));
    }
  }
}

nlohmann::json effective_config(const CLI::App& verb) {
  nlohmann::json config{{"verb", full_name(verb)}};
  for (const CLI::Option* option : verb.get_options()) {
    const std::string name = option->get_lnames().empty() ? option->get_name() : option->get_lnames().front();
    if (name == "help" || name == "config" || name == "json" || name == "quiet") continue;
    if (option->count() > 1)
      for (const std::string& item : option->results()) config[name].push_back(value_of(item));
    else if (option->count() == 1)
      config[name] = value_of(option->results().front());
    else if (!option->get_default_str().empty())
      config[name] = value_of(option->get_default_str());
  }
  return config;
}

Signals::Signals() {
  static StopRequest request;
  raised_by_signals = &request;
  const auto set = [this](int signal, void (*handler)(int)) {
    struct sigaction action {};
    action.sa_handler = handler;
    struct sigaction old {};
    if (sigaction(signal, &action, &old) == 0) before_.emplace_back(signal, old);
  };
  // By default each of these ends or stops the process, and a stopped process leaves its force in the motors.
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGTSTP, SIGUSR1, SIGUSR2, SIGALRM, SIGVTALRM, SIGPROF,
                           SIGXCPU, SIGPOLL, SIGPWR, SIGSTKFLT})
    set(signal, on_signal);
  for (int signal = SIGRTMIN; signal <= SIGRTMAX; ++signal) set(signal, on_signal);
  // A file size limit, a closed pipe and a terminal that refuses a background process become errors of a call.
  for (const int signal : {SIGXFSZ, SIGPIPE, SIGTTOU, SIGTTIN}) set(signal, SIG_IGN);
}

Signals::~Signals() {
  for (const auto& [signal, old] : before_) sigaction(signal, &old, nullptr);
}

const StopRequest& Signals::stop() const noexcept {
  return *raised_by_signals;
}

namespace {

/// Returns the parts of a progress line, in order. The parts that a user acts on stay longest.
std::vector<LinePart> bar_of(const SessionView& view, double duration) {
  const LiveStatus& live = view.live;
  std::vector<LinePart> parts;
  if (duration > 0) parts.push_back({5, meter(live.time / duration)});
  parts.push_back(
      {0, duration > 0 ? fmt::format("{:5.1f}/{:.1f} s", live.time, duration) : fmt::format("{:8.1f} s", live.time)});
  std::string state = to_string(live.phase);
  if (view.recording && view.recording->armed) state = "armed";
  if (view.recording && view.recording->paused) state = "paused";
  if (view.recording && view.recording->interrupted) state = "NOT RECORDING";
  if (live.away) state = "LOST";
  parts.push_back({0, fmt::format("{:<8}", state)});
  parts.push_back({4, fmt::format("{:6.1f} Hz", live.rate)});
  parts.push_back({7, fmt::format("jitter {:5.0f} us", 1e6 * live.jitter)});
  parts.push_back({1, fmt::format("force {:5.2f} N", live.force)});
  if (std::isfinite(live.deviation)) parts.push_back({2, fmt::format("off {:6.2f} mm", 1e3 * live.deviation)});
  if (live.overruns > 0) parts.push_back({3, fmt::format("{} overruns", live.overruns)});
  if (view.recording && view.recording->lost > 0) parts.push_back({1, fmt::format("{} LOST", view.recording->lost)});
  return parts;
}

}  // namespace

std::string meter(double share) {
  constexpr int kWidth = 24;
  const int full = static_cast<int>(std::lround(kWidth * std::clamp(share, 0.0, 1.0)));
  std::string text;
  for (int i = 0; i < kWidth; ++i) text += i < full ? "█" : "░";
  return text;
}

Progress progress_bar(const Output& output, double duration, const Keys* keys, const LiveSession* live) {
  const bool terminal = !output.quiet && isatty(STDERR_FILENO) != 0;
  return [output, duration, terminal, keys, live](const SessionView& view) {
    if (terminal && !view.warnings.empty()) clear_line();
    for (const Warning& warning : view.warnings) output.warn(warning);
    if (!terminal) return;
    if (const std::string typing = keys != nullptr ? keys->typing() : std::string(); !typing.empty())
      return show_line(typing);
    std::vector<LinePart> parts = bar_of(view, duration);
    if (live != nullptr) {
      parts.push_back({6, live->summary()});
      if (keys != nullptr && keys->active()) parts.push_back({8, fmt::format("[{}]", keys->letters())});
    }
    show_line(std::move(parts));
  };
}

void note_before(const Output& output, SessionOptions& session, const char* code, std::span<const std::string> texts,
                 Severity severity) {
  for (Warning& warning : known_warnings(severity, code, texts)) {
    output.warn(warning);
    session.known.push_back(std::move(warning));
  }
}

void note_limits(const Output& output, SessionOptions& session, const DeviceInfo& device) {
  const SafetyLimits& limits = session.loop.limits;
  if (!(limits.max_velocity > 0)) {
    const std::string text =
        "there is no speed limit, because --max-velocity is 0: nothing stops a tool that runs away";
    note_before(output, session, "limits", std::span(&text, 1), Severity::warning);
  }
  if (device.max_force > 0 && limits.max_force > device.max_force) {
    const std::string text = fmt::format("--max-force {:.4g} N is above the largest force of {}: {:.4g} N holds",
                                         limits.max_force, device.model, device.max_force);
    note_before(output, session, "limits", std::span(&text, 1));
  }
}

std::vector<std::string> note_device_and_path(const Output& output, SessionOptions& session, const DeviceInfo& device,
                                              const std::string& path, std::span<const std::string> of_path) {
  note_limits(output, session, device);
  std::vector<std::string> notes = device.notes;
  for (const std::string& note : of_path) notes.push_back(fmt::format("{}: {}", path, note));
  note_before(output, session, "device", device.notes);
  note_before(output, session, "path", std::span(notes).subspan(device.notes.size()), Severity::warning);
  return notes;
}

int conclude(const Output& output, const SessionResult& result) {
  if (!output.quiet && isatty(STDERR_FILENO) != 0) clear_line();
  if (!result.recording_error.empty()) output.fault(result.recording_error);
  if (result.ended_by_disk) output.fault("the session ended because the disk is almost full");
  if (result.servo.stopped_by_fault())
    output.fault(fmt::format("{}{}{}", result.servo.detail.empty() ? "" : result.servo.detail + "; ",
                             describe(result.zero_force),
                             result.recording ? "; the recording keeps what happened" : ""));
  else if (result.zero_force == ZeroForce::failed)
    output.fault(describe(result.zero_force));

  if (result.servo.cause == StopCause::device_lost || result.zero_force == ZeroForce::failed) return kNoDevice;
  if (result.servo.stopped_by_fault() || !result.recorded_all()) return kStopped;
  if (result.servo.cause == StopCause::interrupted) return kInterrupted;
  return kDone;
}

void add_partial(CLI::App& verb, bool& partial) {
  verb.add_flag("--partial", partial, "read a split recording even if parts are missing");
}

RecordingReader::Parts parts_of(bool partial) {
  return partial ? RecordingReader::Parts::present : RecordingReader::Parts::all;
}

std::string session_summary(const SessionResult& result) {
  const ServoReport& servo = result.servo;
  std::string text =
      fmt::format("  {} samples in {:.3f} s, {:.1f} Hz achieved of {:g} Hz requested, {} ticks missed in {} overruns\n",
                  servo.samples, servo.duration, servo.achieved_rate(), servo.asked_rate, servo.missed, servo.overruns);
  if (result.virtual_time)
    text += fmt::format("  virtual time; tick p50 {}, p99 {}\n", duration_text(servo.tick_time.quantile(0.5)),
                        duration_text(servo.tick_time.quantile(0.99)));
  else
    text += fmt::format("  {}{}; wake-up latency p50 {}, p99 {}, p99.9 {}, max {}\n", servo.realtime.scheduler,
                        servo.realtime.memory_locked ? ", memory locked" : "",
                        duration_text(servo.latency.quantile(0.5)), duration_text(servo.latency.quantile(0.99)),
                        duration_text(servo.latency.quantile(0.999)), duration_text(servo.latency.max()));
  if (servo.stale > 0)
    text +=
        fmt::format("  {} of {} ticks had no new sample from the device\n", servo.stale, servo.samples + servo.stale);
  if (servo.gaps > 0)
    text += fmt::format("  {} gaps without a new sample; the force faded in from zero after each\n", servo.gaps);
  if (servo.returns > 0)
    text += fmt::format("  {:.3f} s without the device, which was lost and reconnected{}\n", servo.away,
                        servo.returns > 1 ? fmt::format(" {} times", servo.returns) : "");
  if (result.support > 0) text += fmt::format("  the support of the arm was {:.2g} N\n", result.support);
  for (const TouchFigures& touch : result.touches)
    text += touch.times == 0
                ? fmt::format("  {}: not touched\n", touch.name)
                : fmt::format("  {}: touched {} for {:.3f} s, force up to {:.2f} N, penetration up to {:.2f} mm\n",
                              touch.name, touch.times == 1 ? "once" : fmt::format("{} times", touch.times),
                              touch.seconds, touch.max_force, 1e3 * touch.max_depth);
  if (result.recording && result.recording->written != servo.samples)
    text += fmt::format("  {} of these samples are in the recording\n", result.recording->written);
  if (result.recording && result.recording->parts > 1)
    text += fmt::format("  the recording has {} files\n", result.recording->parts);
  if (result.recording && result.recording->lost > 0)
    text += fmt::format("  {} samples LOST: the disk {}\n", result.recording->lost,
                        result.recording->failed ? "returned an error" : "could not keep up");
  for (const Warning& warning : result.warnings)
    if (warning.severity != Severity::note)
      text += fmt::format("  {}: {}\n", to_string(warning.severity), warning.text);
  return text;
}

}  // namespace haptrace::cli
