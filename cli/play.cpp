#include "cli/read_progress.h"
#include "cli/tuning.h"
#include "control/error.h"
#include "formats/json_reader.h"
#include "formats/path_file.h"
#include "player/playback.h"

#include <fmt/format.h>

namespace haptrace::cli {
namespace {

struct Arguments {
  SessionArguments session;
  TuningArguments tuning;
  std::string path, record, gains;
  std::optional<double> kp, kd;
  PathSelection selection;
  double speed = 1, hold = 0.5, approach_speed = 0.1, max_deviation = 0.03;
  int repeat = 1;
  bool loop = false, fit = false;
  std::string on_deviation = "stop", interpolation = "cubic";
};

std::optional<PdGains> gains_from(const Arguments& arguments) {
  if (!arguments.gains.empty()) {
    if (arguments.kp || arguments.kd) throw input_error("--gains and --kp, --kd both give the gains; use one of them");
    return gains_from_json(load_json(arguments.gains), arguments.gains);
  }
  if (!arguments.kp && !arguments.kd) return std::nullopt;
  if (!arguments.kp || !arguments.kd) throw input_error("--kp and --kd go together: give both, or neither");
  return PdGains{Vec3::Constant(*arguments.kp), Vec3::Constant(*arguments.kd)};
}

double expected_duration(const PlayPlan& plan, const PlaybackOptions& options) {
  return options.repetitions * (plan.path.duration() / options.speed + options.hold + 0.5);
}

/// What of the session can be tuned: the gains of its PD law, which is all that a playback is composed of.
LiveTuning tuning_of(const Arguments& arguments, const PlayPlan& plan, const DeviceInfo& device,
                     const SessionOptions& session) {
  LiveTuning::Options options{.remedy = "haptrace play has no compensations yet: kp, kd and gains can be tuned"};
  if (!arguments.tuning.expert) options.limits = limits_of_unidentified(device.max_force, session.rate_hz);
  if (session.recording) options.annotations = session.recording->options.annotations;
  return {plan.tuning, std::move(options)};
}

std::string summary(const Arguments& arguments, const PlayResult& result, const DeviceInfo& device) {
  std::string text = fmt::format("{}: played on {}\n", arguments.path, device.name);
  if (result.plan.fit) text += fmt::format("  fitted into the workspace: {}\n", describe(*result.plan.fit));
  for (std::size_t i = 0; i < result.repetitions.size(); ++i) {
    const TrackingFigures& figures = result.repetitions[i];
    text += fmt::format("  {}rms error {:.3f} mm, peak {:.3f} mm, force ripple {:.3f} N, force up to {:.2f} N\n",
                        result.repetitions.size() > 1 ? fmt::format("repetition {}: ", i + 1) : "",
                        1e3 * figures.rms_error, 1e3 * figures.peak_error, figures.force_ripple, figures.max_force);
  }
  text += session_summary(result.session);
  if (!arguments.record.empty()) text += fmt::format("  recorded in {}\n", arguments.record);
  return text;
}

}  // namespace

Verb add_play(CLI::App& app) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* verb = app.add_subcommand("play", "play a recording or a path back through a device");
  verb->footer(
      "The device moves to the start of the path, follows it at the path's own time stamps, holds, and lets go.\n"
      "Keys: + or ] stiffer and - or [ softer by 10 %, o the observer, l what was learned, f feedforward on and off, "
      "r back to the start's, q end;\n"
      "while it is recorded: m or space a mark, 1 to 9 a mark with one of --mark-texts, t a mark with a text.\n"
      "  haptrace play square.h5 --device sim:preset=falcon,hand=relaxed --kp 1500 --kd 15 --record played.h5\n"
      "  haptrace play stroke.csv --device sim:preset=touch --fit --speed 0.5 --repeat 3");
  verb->add_option("path", arguments->path, "recording (HDF5) or path (HDF5, CSV with t,x,y,z)")->type_name("PATH");
  verb->add_option("--record", arguments->record, "keep the session as a recording")->type_name("OUT.h5");
  verb->add_flag("--fit", arguments->fit, "move and scale the path into the workspace")->group("Path");
  verb->add_option("--from", arguments->selection.from, "begin at this time of the recording [s]")->group("Path");
  verb->add_option("--to", arguments->selection.to, "end at this time of the recording [s]")->group("Path");
  verb->add_option("--repetition", arguments->selection.repetition,
                   "of a recording of several: which to play, from 1; without it, the last")
      ->group("Path");
  verb->add_option("--speed", arguments->speed, "times the path's own speed")->capture_default_str()->group("Path");
  verb->add_option("--repeat", arguments->repeat, "repetitions")->capture_default_str()->group("Path");
  verb->add_flag("--loop", arguments->loop, "repeat until Ctrl+C")->group("Path");
  verb->add_option("--hold", arguments->hold, "rest at the end of a repetition [s]")
      ->capture_default_str()
      ->group("Path");
  verb->add_option("--interpolation", arguments->interpolation, "between samples: hold | linear | cubic | quintic")
      ->capture_default_str()
      ->group("Path");
  verb->add_option("--approach-speed", arguments->approach_speed, "peak speed of the way to the start [m/s]")
      ->capture_default_str()
      ->group("Path");
  verb->add_option("--gains", arguments->gains, R"(gains from a file: {"kp": 1500, "kd": [15, 15, 10]})")
      ->type_name("FILE.json")
      ->group("Control");
  verb->add_option("--kp", arguments->kp, "proportional gain [N/m]; without any gains: cautious ones for the device")
      ->group("Control");
  verb->add_option("--kd", arguments->kd, "derivative gain [N s/m]")->group("Control");
  verb->add_option("--max-deviation", arguments->max_deviation, "tracking error limit [m]")
      ->capture_default_str()
      ->group("Safety");
  verb->add_option("--on-deviation", arguments->on_deviation,
                   "beyond the limit: stop | pause (the path waits) | soften (the force grows no further)")
      ->capture_default_str()
      ->group("Safety");
  arguments->tuning.add_to(*verb);
  arguments->session.add_to(*verb);

  return {verb, [verb, arguments](const Output& output) {
            require(*verb, "path");
            require(*verb, "--device");
            PlayOptions options;
            options.gains = gains_from(*arguments);
            options.interpolation = parse_interpolation(arguments->interpolation);
            options.fit = arguments->fit;
            options.playback = {.speed = arguments->speed,
                                .repetitions = arguments->loop ? 0 : arguments->repeat,
                                .hold = arguments->hold,
                                .approach_speed = arguments->approach_speed,
                                .max_deviation = arguments->max_deviation,
                                .on_deviation = parse_deviation_policy(arguments->on_deviation)};
            if (!arguments->loop && arguments->repeat < 1)
              throw input_error(fmt::format("--repeat is {}; it must be at least 1, or use --loop", arguments->repeat));
            options.session = arguments->session.options(arguments->record, effective_config(*verb));

            const auto path = [&] {
              ReadProgress progress(output, arguments->path);
              return open_path(arguments->path, arguments->selection, progress.callback());
            }();
            const auto device = arguments->session.open();
            std::vector<std::string> notes = device->info().notes;
            for (const std::string& note : path->facts().notes)
              notes.push_back(fmt::format("{}: {}", arguments->path, note));
            for (const std::string& note : notes) output.remark(note);
            const PlayPlan plan = plan_playback(device->info(), path, options);
            if (arguments->loop && options.session.clock != ClockChoice::real && device->info().virtual_time)
              output.remark("looping in virtual time until Ctrl+C");

            LiveTuning tuning = tuning_of(*arguments, plan, device->info(), options.session);
            options.tuning = &tuning;
            const TuningInputs inputs(arguments->tuning, tuning);
            if (inputs.port())
              output.remark(fmt::format(
                  "tune on port {0} of this machine: printf 'kp 800\\nquit\\n' | nc 127.0.0.1 {0}", *inputs.port()));

            const Signals signals;
            const Keys keys(options.session.recording ? options.session.recording->options.annotations : nullptr,
                            arguments->session.mark_texts, false, arguments->session.keys, &tuning);
            const double expected = expected_duration(plan, options.playback);
            const PlayResult result =
                play(*device, plan, options, signals.stop(), progress_bar(output, expected, &keys, &tuning));

            nlohmann::json json = to_json(result);
            json["tuning"] = tuning.history();
            json["notes"] = notes;
            if (!arguments->record.empty()) json["file"] = arguments->record;
            const int code = conclude(output, result.session);
            output.tell(json, summary(*arguments, result, device->info()));
            return code;
          }};
}

}  // namespace haptrace::cli
