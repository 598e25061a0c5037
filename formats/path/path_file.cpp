#include "formats/path/path_file.h"

#include "base/error.h"
#include "base/text_file.h"
#include "formats/path/csv.h"
#include "formats/recording/recording.h"
#include "formats/recording/recording_formats.h"
#include "formats/recording/sampling.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr const char* kCopies = "averaged_copies";  // in /meta: this recording is an average
constexpr std::uint64_t kNotedRows = 16'384;        // first rows of a recording, on which its notes are based

bool ends_like_hdf5(const std::string& file) {
  const std::string text = file_ending(file);
  return text == ".h5" || text == ".hdf5";
}

/// Returns notes about irregular sampling of a path. Without `forces`, those are not judged.
std::vector<std::string> sampling_notes(const Path& path, bool forces) {
  constexpr double kLongest = 9.2e18;  // [ns]
  SamplingReport report;
  Sample sample;
  for (std::size_t i = 0; i < path.size(); ++i) {
    sample.time_ns = std::llround(std::min((path.time[i] - path.time.front()) * 1e9, kLongest));
    sample.position = path.position[i];
    sample.velocity = path.velocity.empty() ? nan3() : path.velocity[i];
    sample.force = path.force.empty() || !forces ? nan3() : path.force[i];
    report.add(sample);
  }
  return notes(report.result());
}

void write_recording(const Path& path, const std::string& file, const std::string& title, bool overwrite,
                     const AverageColumns* average) {
  RecordingHeader header;
  header.software = "haptrace";
  header.title = title;
  header.clock = "virtual";
  if (average != nullptr) {
    header.meta[kCopies] = average->copies;
    header.scene = average->scene;
  }
  if (path.size() > 1) header.rate_hz = static_cast<double>(path.size() - 1) / path.duration();

  std::vector<Sample> samples(path.size());
  for (std::size_t i = 0; i < samples.size(); ++i) {
    Sample& sample = samples[i];
    sample.tick = i;
    sample.time_ns = std::llround((path.time[i] - path.time.front()) * 1e9);
    if (i > 0 && sample.time_ns <= samples[i - 1].time_ns)
      throw input_error(
          fmt::format("{}: sample {} comes less than 1 ns after the previous one; a recording keeps "
                      "nanoseconds. Is time in seconds?",
                      path.name, i + 1));
    sample.position = path.position[i];
    sample.velocity = path.velocity.empty() ? nan3() : path.velocity[i];
    sample.force = path.force.empty() ? nan3() : path.force[i];
    if (!path.orientation.empty()) sample.orientation = path.orientation[i];
    if (average != nullptr) sample.tunnel_radius = average->radius[i];
    sample.phase = Phase::run;
  }
  RecordingWriter writer(
      file, header,
      {.orientation = !path.orientation.empty(), .tunnel = average != nullptr, .contacts = !header.scene.empty()},
      {.overwrite = overwrite, .storage = {.rows_per_chunk = std::min<std::size_t>(path.size(), 2048)}});
  writer.append(samples);
  if (average != nullptr)
    for (const StoredEvent& event : average->events) writer.append(event);
  writer.finish();
}

}  // namespace

std::shared_ptr<const PathSource> open_path(const std::string& file, const PathSelection& selection,
                                            const RowsDone& progress, const CsvOptions& csv) {
  namespace fs = std::filesystem;
  std::error_code error;
  const fs::file_status status = fs::status(file, error);
  if (!fs::exists(status)) throw input_error(file + ": no such file");
  if (fs::is_directory(status)) throw input_error(file + ": is a folder, not a path");

  check(csv);
  const bool recorded = is_hdf5(file) || ends_like_hdf5(file);
  if (recorded) refuse_csv_options(csv, file, "a recording (HDF5)");
  const std::string& name = csv.name.empty() ? file : csv.name;
  std::shared_ptr<PathSource> source = recorded ? source_of(RecordingReader(file), name, selection, progress)
                                                : source_of(read_csv(file, csv), selection);
  const bool whole = !recorded || source->facts().rows <= kNotedRows;
  const Path noted = source->read(0, whole ? source->facts().rows : kNotedRows);
  // A steady support of the arm looks like a sensor that is stuck, and what is left without it, too.
  for (const std::string& note : sampling_notes(noted, !source->facts().supported))
    source->note(whole ? note : fmt::format("the first {} samples: {}", kNotedRows, note));
  if (const double longest = source->facts().longest_interval;
      !whole && longest > 5 * noted.duration() / static_cast<double>(noted.size()))
    source->note(fmt::format("the longest interval between two samples is {:.4g} s", longest));
  return source;
}

Path load_path(const std::string& file, const CsvOptions& csv) {
  const auto source = open_path(file, {}, {}, csv);
  Path path = source->read(0, source->facts().rows);
  path.notes = source->facts().notes;
  return path;
}

void save_path(const Path& path, const std::string& file, const std::string& title, bool overwrite,
               const AverageColumns* average) {
  validate(path);
  if (ends_like_hdf5(file)) return write_recording(path, file, title, overwrite, average);
  if (average != nullptr)
    throw input_error(fmt::format("{}: an average is written as .h5, which has a place for its spread", file));
  if (file_ending(file) == ".csv") return write_csv(path, file, overwrite);
  throw input_error(fmt::format("{}: a path is written as .csv or .h5", file));
}

std::optional<RadiusProfile> averaged_radius(const std::string& file, const PathFacts& facts) {
  constexpr std::uint64_t kRowsAtOnce = 16'384;
  constexpr std::array<std::string_view, 3> kColumns{"time", "position", "tunnel_radius"};
  if (!is_hdf5(file)) return std::nullopt;
  const RecordingReader reader(file);
  if (!reader.columns().tunnel || !reader.header().meta.contains(kCopies)) return std::nullopt;
  RadiusProfile profile;
  Vec3 before = nan3();
  double s = 0;
  for (std::uint64_t row = 0; row < reader.rows(); row += kRowsAtOnce)
    for (const Sample& sample : reader.read(row, kRowsAtOnce, kColumns)) {
      const double time = 1e-9 * static_cast<double>(sample.time_ns);
      if (time < facts.begin || time > facts.end || !is_finite(sample.position)) continue;
      if (is_finite(before)) s += (sample.position - before).norm();
      before = sample.position;
      if (!(sample.tunnel_radius >= 0) || (!profile.s.empty() && !(s > profile.s.back()))) continue;
      profile.s.push_back(s);
      profile.radius.push_back(sample.tunnel_radius);
    }
  if (profile.s.empty()) return std::nullopt;
  return profile;
}

}  // namespace haptrace
