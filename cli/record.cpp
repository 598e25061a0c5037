#include "player/record.h"

#include "base/error.h"
#include "cli/live_page.h"
#include "cli/profile.h"
#include "cli/scene_options.h"
#include "cli/verb.h"
#include "player/supporting_controller.h"
#include "player/tuning/live_recording.h"

#include <array>
#include <fmt/format.h>

namespace haptrace::cli {
namespace {

struct RecordArguments {
  SessionArguments session;
  ViewArguments view;
  TouchArguments scene;
  std::string file, trigger;
  double duration = 0, pre = 0, pause = 0;
  int count = 1;
  bool fit = false;
};

RecordOptions options_of(const RecordArguments& arguments, const CLI::App& verb) {
  RecordOptions options{.duration = arguments.duration,
                        .session = arguments.session.options(arguments.file, effective_config(verb))};
  SessionOptions::Recording& recording = *options.session.recording;
  recording.end_when_disk_is_low = true;
  if (!arguments.trigger.empty()) {
    options.trigger = Trigger::parse(arguments.trigger);
    recording.options.capture.pre = arguments.pre;
  } else if (arguments.pre != 0) {
    throw input_error("--pre keeps samples from before the trigger; give a --trigger as well");
  }
  return options;
}

/// Opens the device for one trial, with --fit and a seed of its own.
std::unique_ptr<Device> open_for(const RecordArguments& arguments, int trial) {
  std::vector<std::pair<std::string, std::string>> extra;
  if (arguments.fit) extra.emplace_back("fit", "true");
  return arguments.session.open(extra, static_cast<std::uint64_t>(trial - 1));
}

nlohmann::json json_of_trials(const std::vector<SessionResult>& results, const RecordArguments& arguments) {
  nlohmann::json json = to_json(results.back());
  const auto file = [&](std::size_t i) { return trial_file(arguments.file, static_cast<int>(i) + 1, arguments.count); };
  json["file"] = file(results.size() - 1);
  if (arguments.count == 1) return json;
  json["trials"] = nlohmann::json::array();
  for (std::size_t i = 0; i < results.size(); ++i) {
    nlohmann::json trial = to_json(results[i]);
    trial["file"] = file(i);
    json["trials"].push_back(std::move(trial));
  }
  return json;
}

/// Prints the notes on each trial before it begins, and keeps them for the result.
class TrialNotes {
 public:
  /// Borrows everything. `of_scene`: notes on the scene.
  TrialNotes(const RecordArguments& arguments, std::vector<std::string> of_scene, RecordOptions& options,
             const Output& output)
      : arguments_(arguments),
        of_scene_(std::move(of_scene)),
        options_(options),
        output_(output),
        expected_(options.duration) {}

  void begin(int trial, const Device& device, const std::string& file) {
    const DeviceInfo& info = device.info();
    expected_ = options_.duration > 0 ? options_.duration : info.natural_duration;
    notes_ = info.notes;
    notes_.insert(notes_.end(), of_scene_.begin(), of_scene_.end());
    for (std::string& note : notes_on_reach(options_.session, info)) notes_.push_back(std::move(note));
    if (trial == 1 && (options_.session.touch.scene || options_.session.support.force > 0))
      note_limits(output_, options_.session, info);
    if (trial == 1) note_before(output_, options_.session, "plan", notes_);
    if (arguments_.count > 1) output_.remark(fmt::format("trial {} of {}: {}", trial, arguments_.count, file));
  }

  /// Returns the notes of the present trial.
  [[nodiscard]] const std::vector<std::string>& notes() const noexcept { return notes_; }
  /// Returns the expected duration of the present trial [s]; 0: unknown.
  [[nodiscard]] double expected() const noexcept { return expected_; }

 private:
  const RecordArguments& arguments_;
  const std::vector<std::string> of_scene_;
  RecordOptions& options_;
  const Output& output_;
  std::vector<std::string> notes_;
  double expected_;
};

/// Runs the verb and returns its exit code.
int record_command(const CLI::App& verb, const RecordArguments& arguments, const Output& output) {
  require(verb, "file");
  require(verb, "--device");
  refuse_useless(verb, std::to_array<Dependence>({{"--pause", arguments.count > 1, "--count"},
                                                  {"--up", arguments.session.support > 0, "--support"}}));
  RecordOptions options = options_of(arguments, verb);
  TrialNotes notes(arguments, arguments.scene.apply(options.session, output), options, output);
  std::optional<DeviceProfile> profile;  // of the device of all trials
  options.identified = [&profile](const DeviceInfo&) { return profile ? std::optional(profile->plant) : std::nullopt; };
  Trials trials{.count = arguments.count, .pause = arguments.pause, .open = [&](int trial) {
                  return open_for(arguments, trial);
                }};
  const Signals signals;
  StopRequest stop(&signals.stop());
  LivePage page(arguments.view, arguments.session, output, "record", stop);
  LiveRecording commands(options.session.recording->options.annotations, stop);
  trials.begin = [&](int trial, const Device& device, const std::string& file) {
    page.expect_more(trial < arguments.count);
    const DeviceInfo& info = device.info();
    const bool needs_model = info.measures_force || options.session.touch.scene || options.session.support.force > 0;
    if (trial == 1 && needs_model)
      profile = profile_for(info, "", options.session.loop.rate_hz, output, &options.session.known);
    if (trial == 1 && profile) take_motor_limit(*profile, info, output, options.session);
    keep_dynamics(options.session, info, profile);
    notes.begin(trial, device, file);
  };
  page.watch(options.session);
  options.live = &commands;
  const LivePage::Use use(page, commands);
  const Keys keys(options.session.recording->options.annotations, arguments.session.mark_texts, arguments.session.keys,
                  commands);
  const Progress progress = [&](const SessionView& view) { progress_bar(output, notes.expected(), &keys)(view); };
  const std::vector<SessionResult> results = record_trials(trials, options, stop, progress);

  nlohmann::json json = json_of_trials(results, arguments);
  json["notes"] = notes.notes();
  const int code = conclude(output, results.back());
  output.tell(json, fmt::format("{}: recorded from {}\n{}", json["file"].get<std::string>(), arguments.session.device,
                                session_summary(results.back())));
  return code;
}

}  // namespace

Verb add_record(CLI::App& app) {
  const auto arguments = std::make_shared<RecordArguments>();
  CLI::App* verb = app.add_subcommand("record", "record the hand's movement and force");
  verb->footer(
      "The hand moves freely: without --scene and --support, no force is sent. Ctrl+C ends the recording and keeps\n"
      "every sample.\n"
      "Keys: m or space sets a mark, 1 to 9 a mark with one of --mark-texts, t a mark with a typed text; p pauses\n"
      "and resumes; q ends the recording.\n"
      "  haptrace record out.h5 -d falcon --duration 10\n"
      "  haptrace record out.h5 -d sim:preset=omega3,hand=firm,intent=stroke.csv --fit\n"
      "  haptrace record felt.h5 -d falcon --scene samples/scenes/sphere.json --duration 20\n"
      "  haptrace record reach.h5 -d falcon --trigger 'speed>0.02|button' --pre 2 --duration 5 --count 20 --pause 3");
  verb->add_option("file", arguments->file, "recording to write (HDF5)")->type_name("OUT.h5");
  verb->add_option("--duration", arguments->duration,
                   "duration from the start or the trigger [s] (0: until the device's own movement ends, or Ctrl+C)")
      ->capture_default_str();
  verb->add_flag("--fit", arguments->fit, "move and scale the simulated hand's path into the workspace");
  verb->add_option("--trigger", arguments->trigger,
                   "start at this condition: force>0.5N, speed>0.02m/s, button or button2; join several with |")
      ->group("Capture");
  verb->add_option("--pre", arguments->pre, "time before the trigger to keep [s]")
      ->capture_default_str()
      ->group("Capture");
  verb->add_option("--count", arguments->count, "number of trials, written to OUT-001.h5, OUT-002.h5, ...")
      ->capture_default_str()
      ->group("Capture");
  verb->add_option("--pause", arguments->pause, "time between two trials [s]")->capture_default_str()->group("Capture");
  arguments->scene.add_to(*verb);
  arguments->view.add_to(*verb);
  arguments->session.add_to(*verb);
  arguments->session.add_wait_to(*verb);
  arguments->session.add_support_to(*verb);

  return {verb, [verb, arguments](const Output& output) { return record_command(*verb, *arguments, output); }};
}

}  // namespace haptrace::cli
