#include "cli/input_options.h"
#include "cli/read_progress.h"
#include "cli/verb.h"
#include "formats/recording/recording.h"

#include <algorithm>
#include <fmt/format.h>

namespace haptrace::cli {
Verb add_check(CLI::App& app) {
  const auto file = std::make_shared<std::string>();
  const auto partial = std::make_shared<bool>(false);
  CLI::App* verb = app.add_subcommand("check", "check a recording against the file format");
  verb->footer(
      "Prints each finding and its location: a note, a warning or a problem. The exit code is 2 if there is a\n"
      "problem.\n"
      "  haptrace check played.h5");
  verb->add_option("file", *file, "recording (HDF5)")->type_name("FILE.h5");
  add_partial(*verb, *partial);
  return {
      verb, [verb, file, partial](const Output& output) {
        require(*verb, "file");
        std::vector<Finding> findings;
        const InputFile input(*file, {});
        {
          ReadProgress progress(output, input.name());
          findings = check_recording(input.path(), progress.share_callback(), *partial);
        }
        nlohmann::json list = nlohmann::json::array();
        std::string text;
        for (const Finding& finding : findings) {
          list.push_back({{"severity", to_string(finding.severity)}, {"where", finding.where}, {"what", finding.what}});
          text +=
              fmt::format("{}: {}: {}: {}\n", input.name(), to_string(finding.severity), finding.where, finding.what);
        }
        const auto problems = std::count_if(findings.begin(), findings.end(), [](const Finding& finding) {
          return finding.severity == Severity::problem;
        });
        text += problems > 0 ? fmt::format("{}: {} problem{}\n", input.name(), problems, problems == 1 ? "" : "s")
                             : fmt::format("{}: valid\n", input.name());
        output.tell({{"file", *file}, {"valid", problems == 0}, {"findings", std::move(list)}}, text);
        return problems > 0 ? kBadInput : kDone;
      }};
}

}  // namespace haptrace::cli
