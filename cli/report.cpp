#include "base/error.h"
#include "base/printable.h"
#include "base/text_file.h"
#include "cli/read_progress.h"
#include "cli/terminal.h"
#include "report/page.h"
#include "report/report_table.h"

#include <filesystem>
#include <fmt/format.h>
#include <optional>
#include <unistd.h>

namespace haptrace::cli {
namespace {

/// Returns the name of the page: in a session's folder, or beside a recording.
std::string page_beside(const std::string& input) {
  const std::filesystem::path path(input);
  if (!is_session(input)) return std::filesystem::path(path).replace_extension(".report.html").string();
  return ((std::filesystem::is_directory(path) ? path : path.parent_path()) / "report.html").string();
}

/// Standard output; nothing else is then printed there.
constexpr const char* kStandardOutput = "-";

struct ReportArguments {
  std::vector<std::string> inputs;
  std::string page, table, norms;
  bool no_page = false, overwrite = false;

  [[nodiscard]] bool table_out() const { return table == kStandardOutput; }
};

/// Throws Error(input) if two outputs exclude each other, or there is none.
void check_arguments(const ReportArguments& arguments, const Output& output) {
  if (arguments.table_out() && output.json)
    throw input_error("--csv - and --json both write to standard output; give --csv a file");
  if (arguments.no_page && !arguments.page.empty()) throw input_error("--no-page and --output exclude each other");
  if (arguments.no_page && arguments.table.empty() && !output.json)
    throw input_error("--no-page leaves nothing to write; add --json or --csv");
}

/// The files of a report. They are opened before hours of recordings are read, and written together.
class ReportFiles {
 public:
  /// Throws Error(input) if a file cannot be written.
  explicit ReportFiles(const ReportArguments& arguments) : arguments_(arguments) {
    const bool table = !arguments.table.empty() && !arguments.table_out();
    std::vector<std::string> outputs;
    if (!arguments.no_page) outputs.push_back(arguments.page);
    if (table) outputs.push_back(arguments.table);
    check_report_outputs(outputs, arguments.inputs);
    if (!arguments.no_page) page_.emplace(arguments.page, arguments.overwrite);
    if (table) table_.emplace(arguments.table, arguments.overwrite);
  }

  /// Writes the files, adds their names to `json`, and returns the names as lines.
  std::string write(const Report& report, nlohmann::json& json) {
    if (page_) page_->text() = report_page(report);
    if (table_) table_->text() = report_table(report);
    std::string names;
    if (page_) {
      page_->commit();
      json["file"] = arguments_.page;
      names += arguments_.page + "\n";
    }
    if (table_) {
      table_->commit();
      json["csv"] = arguments_.table;
      names += arguments_.table + "\n";
    }
    return names;
  }

 private:
  const ReportArguments& arguments_;
  std::optional<TextWriter> page_, table_;
};

/// Runs the verb and returns its exit code.
int report_command(const CLI::App& verb, ReportArguments& arguments, const Output& output) {
  require(verb, "session");
  check_arguments(arguments, output);
  if (arguments.page.empty()) arguments.page = page_beside(arguments.inputs.front());
  ReportFiles files(arguments);

  const std::optional<Norms> norms =
      arguments.norms.empty() ? std::nullopt : std::optional(load_norms(arguments.norms));
  ReadProgress progress(output, "recordings");
  Report report =
      gather_report(arguments.inputs, [&](const std::string& file, double done) { progress.tell_share(done, file); });
  if (norms) set_norms(report, *norms);
  if (norms && !norms_hold(report))
    output.remark(arguments.norms +
                  ": holds for no exercise of this report; compare its device, task and mode with the page");
  nlohmann::json json = to_json(report);
  const std::string written = files.write(report, json);
  if (arguments.table_out()) {
    // A terminal gets no control characters; a program gets the table exactly as in a file.
    const std::string rows = report_table(report);
    write_out(stdout, isatty(STDOUT_FILENO) != 0 ? printable_lines(rows) : rows);
  } else {
    output.tell(json, written);
  }
  return kDone;
}

}  // namespace

Verb add_report(CLI::App& app) {
  const auto arguments = std::make_shared<ReportArguments>();
  CLI::App* verb = app.add_subcommand("report", "write an HTML report of sessions and recordings");
  verb->footer(
      "The page needs no network. It shows the exercises, deviation and force along the path, every repetition,\n"
      "one summary per session with its date, a comparison of unguided tests, stops and warnings, and room for a\n"
      "signature. Several participants have a part each. A change is claimed only beyond the error of --norms.\n"
      "--json and --csv contain the numbers for statistics, in SI units.\n"
      "  haptrace report sessions/ada-monday sessions/ada-friday -o ada.html\n"
      "  haptrace report trainee.h5 --no-page --csv -");
  verb->add_option("session", arguments->inputs,
                   "sessions of programmes (folders, or their session.json) and recordings (HDF5)")
      ->type_name("SESSION");
  verb->add_option("-o,--output", arguments->page,
                   "page to write (default: report.html in the first session's folder, or x.report.html beside x.h5)")
      ->type_name("FILE.html");
  verb->add_option("--csv", arguments->table, "also write a table, one row per repetition (-: standard output)")
      ->type_name("FILE.csv");
  verb->add_option("--norms", arguments->norms,
                   "norms and test-retest error, so that changes between sessions are judged (docs/report.md)")
      ->type_name("FILE.json");
  verb->add_flag("--no-page", arguments->no_page, "write the numbers only, with --json or --csv");
  verb->add_flag("--overwrite", arguments->overwrite, "replace existing files");
  return {verb, [verb, arguments](const Output& output) { return report_command(*verb, *arguments, output); }};
}

}  // namespace haptrace::cli
