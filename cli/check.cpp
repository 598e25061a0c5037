#include "cli/read_progress.h"
#include "cli/verb.h"
#include "formats/recording.h"

#include <algorithm>
#include <fmt/format.h>

namespace haptrace::cli {
Verb add_check(CLI::App& app) {
  const auto file = std::make_shared<std::string>();
  CLI::App* verb = app.add_subcommand("check", "validate a recording against the file format");
  verb->footer("Says what is wrong, and where. Exit code 2 when anything is an error.");
  verb->add_option("file", *file, "recording (HDF5)")->type_name("FILE.h5");
  return {
      verb, [verb, file](const Output& output) {
        require(*verb, "file");
        std::vector<Finding> findings;
        {
          ReadProgress progress(output, *file);
          findings = check_recording(*file, progress.share_callback());
        }
        nlohmann::json list = nlohmann::json::array();
        std::string text;
        for (const Finding& finding : findings) {
          list.push_back({{"severity", to_string(finding.severity)}, {"where", finding.where}, {"what", finding.what}});
          text += fmt::format("{}: {}: {}: {}\n", *file, to_string(finding.severity), finding.where, finding.what);
        }
        const auto errors = std::count_if(findings.begin(), findings.end(), [](const Finding& finding) {
          return finding.severity == Finding::Severity::error;
        });
        text += errors > 0 ? fmt::format("{}: {} errors\n", *file, errors) : fmt::format("{}: valid\n", *file);
        output.tell({{"file", *file}, {"valid", errors == 0}, {"findings", std::move(list)}}, text);
        return errors > 0 ? kBadInput : kDone;
      }};
}

}  // namespace haptrace::cli
