#include "cli/verb.h"
#include "control/error.h"
#include "player/playback.h"

#include <fmt/format.h>

namespace haptrace::cli {

Verb add_record(CLI::App& app) {
  struct Arguments {
    SessionArguments session;
    std::string file;
    double duration = 0;
    bool fit = false;
  };
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* verb = app.add_subcommand("record", "record what the hand does with a device");
  verb->footer(
      "The hand moves freely: no force is sent. Ctrl+C ends the recording and keeps every sample.\n"
      "  haptrace record out.h5 --device falcon --duration 10\n"
      "  haptrace record out.h5 --device sim:preset=omega3,hand=firm,intent=stroke.csv --fit");
  verb->add_option("file", arguments->file, "recording to make (HDF5)")->type_name("OUT.h5");
  verb->add_option("--duration", arguments->duration, "[s]; 0: what the device has to show, or until Ctrl+C")
      ->capture_default_str();
  verb->add_flag("--fit", arguments->fit, "move and scale what the simulated hand intends into the workspace");
  arguments->session.add_to(*verb);

  return {verb, [verb, arguments](const Output& output) {
            require(*verb, "file");
            require(*verb, "--device");
            std::vector<std::pair<std::string, std::string>> extra;
            if (arguments->fit) extra.emplace_back("fit", "true");
            const auto device = arguments->session.open(extra);

            for (const std::string& note : device->info().notes) output.remark(note);
            const RecordOptions options{
                .duration = arguments->duration,
                .session = arguments->session.options(arguments->file, effective_config(*verb))};
            const Signals signals;
            const double expected = options.duration > 0 ? options.duration : device->info().natural_duration;
            const SessionResult result = record(*device, options, signals.stop(), progress_bar(output, expected));

            nlohmann::json json = to_json(result);
            json["file"] = arguments->file;
            json["notes"] = device->info().notes;
            const int code = conclude(output, result);
            output.tell(json, fmt::format("{}: recorded from {}\n{}", arguments->file, device->info().name,
                                          session_summary(result)));
            return code;
          }};
}

}  // namespace haptrace::cli
