#include "base/error.h"
#include "cli/input_options.h"
#include "cli/read_progress.h"
#include "cli/verb.h"
#include "formats/path/path_file.h"
#include "formats/recording/recording_summary.h"
#include "player/guidance/averaged_expert.h"

#include <algorithm>
#include <filesystem>
#include <fmt/format.h>
#include <iterator>

namespace haptrace::cli {
namespace {

struct AverageArguments {
  std::vector<std::string> files;
  std::string file, title;
  std::optional<double> smoothing;
  bool overwrite = false;
  CsvOptions csv;
};

using Experts = std::vector<std::shared_ptr<const PathSource>>;

std::shared_ptr<const PathSource> open_expert(const std::string& file, const PathSelection& selection, CsvOptions csv,
                                              const std::string& name, const Output& output) {
  if (is_hdf5(file)) csv = {};
  csv.name = name;
  ReadProgress progress(output, name);
  return open_path(file, selection, progress.callback(), csv);
}

/// Returns the recordings to average: one of each file, or all repetitions of a single file.
Experts open_experts(const AverageArguments& arguments, const Output& output) {
  Experts experts;
  if (arguments.files.size() > 1) {
    std::error_code error;
    for (auto one = arguments.files.begin(); one != arguments.files.end(); ++one)
      for (auto other = std::next(one); other != arguments.files.end(); ++other)
        if (*one == *other || std::filesystem::equivalent(*one, *other, error))
          throw input_error(fmt::format(
              "{} is given twice. Each recording counts once: a copy of it would make the experts look more alike",
              *other));
    for (const std::string& file : arguments.files)
      experts.push_back(open_expert(file, {}, arguments.csv, file, output));
    return experts;
  }
  const std::string& file = arguments.files.front();
  RecordingSummary whole;
  if (is_hdf5(file))
    for (const RecordingSummary& block : RecordingReader(file).overview()) whole.join(block);
  if (whole.runs < 2)
    throw input_error(
        fmt::format("{} holds one repetition; name further recordings of the same task, or one with several "
                    "repetitions",
                    file));
  for (std::uint64_t run = 1; run <= whole.runs; ++run) {
    auto expert = open_expert(file, {.repetition = static_cast<int>(run)}, {},
                              fmt::format("{}, repetition {}", file, run), output);
    if (expert->facts().cut_short)
      output.remark(fmt::format("{} is left out: it was cut short", expert->facts().name));
    else
      experts.push_back(std::move(expert));
  }
  if (experts.size() < 2)
    throw input_error(fmt::format("{} holds {} repetition{} that {} not cut short, but an average needs at least two",
                                  file, experts.size(), experts.size() == 1 ? "" : "s",
                                  experts.size() == 1 ? "was" : "were"));
  return experts;
}

nlohmann::json to_json(const AveragedExpert& expert) {
  const AveragedPath& average = expert.average;
  nlohmann::json json{{"copies", nlohmann::json::array()},
                      {"pauses", nlohmann::json::array()},
                      {"length_m", average.arc.back()},
                      {"duration_s", expert.path.duration()},
                      {"spread_m", average.overall_spread},
                      {"directions", average.directions},
                      {"radius_m", expert.typical_radius},
                      {"forces", !expert.path.force.empty()},
                      {"notes", expert.notes}};
  for (std::size_t i = 0; i < expert.copies.size(); ++i)
    json["copies"].push_back({{"name", expert.copies[i]},
                              {"distance_m", average.agreement[i].distance},
                              {"length_ratio", average.agreement[i].length_ratio},
                              {"medoid", i == average.medoid}});
  for (const AveragedPath::Pause& pause : average.pauses)
    json["pauses"].push_back({{"arc_m", pause.arc}, {"duration_s", pause.duration}, {"copies", pause.copies}});
  return json;
}

std::string summary(const AveragedExpert& expert, const std::string& file) {
  const AveragedPath& average = expert.average;
  const auto [least, most] = std::minmax_element(expert.radius.begin(), expert.radius.end());
  std::string text = fmt::format(
      "{}: the average of {} recordings, {:.0f} mm in {:.1f} s without pauses\n"
      "  spread across the path {:.2f} mm (standard deviation); the radius that holds the next repetition with 95 % "
      "probability is {:.1f} mm, {:.1f} to {:.1f} mm along the path\n",
      file, expert.copies.size(), 1e3 * average.arc.back(), expert.path.duration(), 1e3 * average.overall_spread,
      1e3 * expert.typical_radius, 1e3 * *least, 1e3 * *most);
  for (std::size_t i = 0; i < expert.copies.size(); ++i)
    text += fmt::format("  {}: {:.2f} mm (rms) from the average, {:.2f} times as long\n", expert.copies[i],
                        1e3 * average.agreement[i].distance, average.agreement[i].length_ratio);
  for (const AveragedPath::Pause& pause : average.pauses)
    text += fmt::format("  {} of {} rest for {:.1f} s (median) at {:.0f} mm\n", pause.copies, expert.copies.size(),
                        pause.duration, 1e3 * pause.arc);
  return text;
}

int average(const AverageArguments& arguments, const Output& output) {
  const Experts experts = open_experts(arguments, output);
  AveragedExpert expert = average_experts(experts, arguments.smoothing);
  for (const auto& one : experts)
    for (const std::string& note : one->facts().notes)
      expert.notes.push_back(fmt::format("{}: {}", one->facts().name, note));
  save_average(expert, arguments.file, arguments.title, arguments.overwrite,
               is_hdf5(arguments.files.front()) ? arguments.files.front() : "");
  for (const std::string& note : expert.notes) output.remark(note);
  nlohmann::json json = to_json(expert);
  json["file"] = arguments.file;
  output.tell(json, summary(expert, arguments.file));
  return kDone;
}

}  // namespace

Verb add_average(CLI::App& app) {
  const auto arguments = std::make_shared<AverageArguments>();
  AverageArguments& a = *arguments;
  CLI::App* verb = app.add_subcommand("average", "average several recordings of one task into one path");
  verb->footer(
      "The average does not depend on the speed or the pauses of the recordings. It stores the spread of the\n"
      "recordings as a radius along the path, which guide takes with --radius auto. A recording of another\n"
      "movement (another direction, another number of laps) is refused by name. A single file gives all its\n"
      "repetitions; each of several files gives its last one.\n"
      "  haptrace average first.h5 second.h5 third.h5 -o expert.h5\n"
      "  haptrace guide expert.h5 -d falcon --radius auto");
  verb->add_option("files", a.files, "recordings (HDF5) or paths (HDF5, CSV)")->type_name("FILE");
  verb->add_option("-o,--output", a.file, "recording to write (.h5)")->type_name("OUT.h5");
  verb->add_option("--title", a.title, "title of the recording that is written");
  verb->add_option("--smoothing", a.smoothing,
                   "time constant of the smoothing of the recordings [s] (default: from their noise)");
  verb->add_flag("--overwrite", a.overwrite, "replace an existing file");
  add_input_options(*verb, a.csv);
  return {verb, [verb, arguments](const Output& output) {
            require(*verb, "files");
            require(*verb, "--output");
            keep_inputs(arguments->file, arguments->files);
            clean_up(output, arguments->file);
            return average(*arguments, output);
          }};
}

}  // namespace haptrace::cli
