#include "base/json_reader.h"
#include "base/printable.h"
#include "base/rfc3339.h"
#include "cli/input_options.h"
#include "cli/read_progress.h"
#include "formats/documents/device_profile.h"
#include "formats/documents/warning_json.h"
#include "formats/path/path_file.h"
#include "formats/recording/recording_summary.h"

#include <cmath>
#include <fmt/format.h>

namespace haptrace::cli {
namespace {

std::string millimetres(const Box& box) {
  const Vec3 size = 1e3 * box.size(), center = 1e3 * box.center();
  return fmt::format("{:.4g} x {:.4g} x {:.4g} mm around {:.4g}, {:.4g}, {:.4g} mm", size.x(), size.y(), size.z(),
                     center.x(), center.y(), center.z());
}

int tell_of_path(const InputFile& input, const Output& output) {
  const auto source = open_path(input.path(), {}, {}, input.csv());
  const std::string& file = input.name();
  const PathFacts& path = source->facts();
  const Box& box = path.bounds;
  const double rate = path.duration() > 0 ? static_cast<double>(path.rows - 1) / path.duration() : 0;
  std::string text =
      fmt::format("{}: a path\n  {:<20} {}\n  {:<20} {:.3f} s\n  {:<20} {:.1f} Hz on average\n  {:<20} {}\n", file,
                  "samples", path.rows, "duration", path.duration(), "rate", rate, "size", millimetres(box));
  text += fmt::format("  {:<20} {}{}\n", "columns", path.velocity ? "position, velocity" : "position",
                      path.force ? ", force" : "");
  for (const std::string& note : path.notes) text += fmt::format("  {:<20} {}\n", "note", printable(note));
  output.tell({{"file", file},
               {"kind", "path"},
               {"samples", path.rows},
               {"duration_s", path.duration()},
               {"mean_rate_hz", rate},
               {"position_min_m", json_of(box.min)},
               {"position_max_m", json_of(box.max)},
               {"has_velocity", path.velocity},
               {"has_force", path.force},
               {"notes", path.notes}},
              text);
  return kDone;
}

/// Returns the wall-clock time of the first sample and the accuracy of that clock; null without readings.
nlohmann::json clocks_of(const RecordingReader& reader) {
  const std::vector<ClockReading> clocks = reader.clocks();
  if (clocks.empty()) return nullptr;
  const ClockReading& first = clocks.front();
  const std::int64_t at_zero = first.realtime_ns - first.time_ns;
  nlohmann::json json{{"time_0", rfc3339_nanoseconds(at_zero)},
                      {"time_0_realtime_ns", at_zero},
                      {"time_0_monotonic_ns", first.monotonic_ns - first.time_ns},
                      {"uncertainty_s", 1e-9 * static_cast<double>(first.uncertainty_ns)},
                      {"readings", clocks.size()}};
  if (const double drift = clock_drift(clocks); std::isfinite(drift)) json["drift"] = drift;
  return json;
}

/// The contents of a recording, as far as the verb prints them.
struct RecordingContents {
  const std::string& file;  ///< name for messages
  const RecordingReader& reader;
  RecordingHeader header;
  RecordingSummary summary;
  std::vector<StoredEvent> events;
  nlohmann::json clocks;
};

std::string text_of(const RecordingContents& contents) {
  const auto& [file, reader, header, summary, events, clocks] = contents;
  std::string text = fmt::format("{}: a recording{}\n", file, header.complete ? "" : ", not finished");
  const auto line = [&](const char* key, const std::string& value) {
    if (!value.empty()) text += fmt::format("  {:<20} {}\n", printable(key), printable(value));
  };
  line("title", header.title);
  line("subject", header.subject);
  line("operator", header.operator_name);
  line("notes", header.notes);
  for (const auto& [key, value] : header.meta)
    line(key.c_str(), key == kDynamicsKey ? "the model of the device, from its profile" : value);
  if (const auto of = header.meta.find("input"); of != header.meta.end() && of->second == "view")
    line("note", "a person steered a simulated hand through the live view: not a measure of skill");
  line("created", header.created);
  if (!clocks.is_null())
    line("time 0", fmt::format("{}, within {:.3g} us{}", clocks["time_0"].get<std::string>(),
                               1e6 * clocks["uncertainty_s"].get<double>(),
                               clocks.contains("drift")
                                   ? fmt::format("; the wall clock drifted by {:+.3g} ppm from the monotonic clock",
                                                 1e6 * clocks["drift"].get<double>())
                                   : std::string()));
  line("device", header.device_model.empty() ? header.device_name
                                             : fmt::format("{} ({})", header.device_name, header.device_model));
  line("samples", fmt::format("{} in {:.3f} s", summary.rows, summary.duration()));
  line("rate", fmt::format("{:.2f} Hz on average, {:g} Hz requested, {} clock", summary.mean_rate(), header.rate_hz,
                           header.clock));
  if (header.part == 1 && reader.parts() > 1) line("parts", fmt::format("{} files", reader.parts()));
  for (const std::string& missing : reader.missing_parts()) line("missing", missing);
  if (header.part > 1) line("part", fmt::format("{} of the recording {}", header.part, header.part_of));
  line("gaps", fmt::format("{} ({} ticks missed), longest interval {:.3f} ms", summary.gaps, summary.missed,
                           1e3 * summary.longest_interval));
  if (summary.rows > 0) line("size", millimetres(summary.bounds));
  line("force", fmt::format("up to {:.3f} N", summary.max_force));
  if (summary.tracked > 0)
    line("tracking error", fmt::format("rms {:.3f} mm, peak {:.3f} mm over {} samples", 1e3 * summary.rms_error(),
                                       1e3 * summary.peak_error(), summary.tracked));
  for (const Warning& warning : warnings_from(header.warnings)) line(to_string(warning.severity), warning.text);
  for (const StoredEvent& event : events) line("event", fmt::format("{:.3f} s  {}", event.time, event.text));
  return text;
}

nlohmann::json to_json(const RecordingContents& contents) {
  const auto& [file, reader, header, summary, events, clocks] = contents;
  nlohmann::json list = nlohmann::json::array();
  for (const StoredEvent& event : events)
    list.push_back({{"time_s", event.time}, {"code", event.code}, {"text", event.text}});
  nlohmann::json json{{"file", file},
                      {"kind", "recording"},
                      {"format_version", header.format_version},
                      {"uuid", header.uuid},
                      {"created", header.created},
                      {"software", header.software},
                      {"title", header.title},
                      {"subject", header.subject},
                      {"operator", header.operator_name},
                      {"notes", header.notes},
                      {"meta", header.meta},
                      {"parts", reader.parts()},
                      {"complete", header.complete},
                      {"clock", header.clock},
                      {"rate_hz", header.rate_hz},
                      {"device_name", header.device_name},
                      {"device_model", header.device_model},
                      {"device_serial", header.device_serial},
                      {"device_backend", header.device_backend},
                      {"samples", summary.rows},
                      {"duration_s", summary.duration()},
                      {"mean_rate_hz", summary.mean_rate()},
                      {"gaps", summary.gaps},
                      {"missed", summary.missed},
                      {"longest_interval_s", summary.longest_interval},
                      {"max_force_n", summary.max_force},
                      {"events", std::move(list)},
                      {"warnings", json_of(warnings_from(header.warnings))},
                      {"config", header.config}};
  if (!reader.missing_parts().empty()) json["missing_parts"] = reader.missing_parts();
  if (!clocks.is_null()) json["clocks"] = clocks;
  if (summary.rows > 0) {
    json["position_min_m"] = json_of(summary.bounds.min);
    json["position_max_m"] = json_of(summary.bounds.max);
    json["path_length_m"] = summary.path_length;
  }
  if (summary.tracked > 0) {
    json["rms_error_m"] = summary.rms_error();
    json["peak_error_m"] = summary.peak_error();
  }
  return json;
}

int tell_of_recording(const InputFile& input, bool partial, const Output& output) {
  const std::string& file = input.name();
  if (!input.csv().empty()) (void)open_path(input.path(), {}, {}, input.csv());  // reports why it rejects them
  const RecordingReader reader(input.path(), parts_of(partial));
  const auto summarised = [&] {
    ReadProgress progress(output, file, reader.rows());
    return summarise(reader, progress.callback());
  };
  const RecordingContents contents{file, reader, reader.header(), summarised(), reader.events(), clocks_of(reader)};
  output.tell(to_json(contents), text_of(contents));
  return kDone;
}

}  // namespace

Verb add_info(CLI::App& app) {
  const auto file = std::make_shared<std::string>();
  const auto partial = std::make_shared<bool>(false);
  const auto csv = std::make_shared<CsvOptions>();
  CLI::App* verb = app.add_subcommand("info", "print the contents of a recording or a path");
  verb->footer(
      "Also reads unfinished recordings, and never changes a file. FILE may be - for standard input.\n"
      "  haptrace info played.h5\n"
      "  haptrace info played.h5 --json");
  verb->add_option("file", *file, "recording (HDF5) or path (CSV)")->type_name("FILE");
  add_partial(*verb, *partial);
  add_input_options(*verb, *csv);
  return {verb, [verb, file, partial, csv](const Output& output) {
            require(*verb, "file");
            const InputFile input(*file, *csv);
            return is_hdf5(input.path()) ? tell_of_recording(input, *partial, output) : tell_of_path(input, output);
          }};
}

}  // namespace haptrace::cli
