#include "formats/path_file.h"

#include "control/error.h"
#include "formats/csv.h"
#include "formats/recording.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <map>

namespace haptrace {
namespace {

constexpr std::uint64_t kNotedRows = 65'536;  // of a recording, which is told of by its first ones

std::string ending(const std::string& file) {
  std::string text = std::filesystem::path(file).extension().string();
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

bool ends_like_hdf5(const std::string& file) {
  const std::string text = ending(file);
  return text == ".h5" || text == ".hdf5";
}

/// Steps between time stamps, the commonest first, as "1 ms (80 %)".
std::string commonest(const std::vector<double>& steps) {
  constexpr double kQuantum = 1e-5;  // [s]
  std::map<std::int64_t, std::size_t> counts;
  for (const double step : steps) ++counts[std::llround(step / kQuantum)];
  std::vector<std::pair<std::size_t, std::int64_t>> order;
  for (const auto& [step, count] : counts) order.emplace_back(count, step);
  std::sort(order.rbegin(), order.rend());
  order.resize(std::min<std::size_t>(order.size(), 3));
  std::vector<std::string> parts;
  for (const auto& [count, step] : order)
    parts.push_back(fmt::format("{:.4g} ms ({:.0f} %)", 1e3 * kQuantum * static_cast<double>(step),
                                100 * static_cast<double>(count) / static_cast<double>(steps.size())));
  return fmt::format("{}", fmt::join(parts, ", "));
}

void note_sampling(const Path& path, std::vector<std::string>& notes) {
  if (path.size() < 3) return;
  std::vector<double> steps(path.size() - 1);
  for (std::size_t i = 0; i < steps.size(); ++i) steps[i] = path.time[i + 1] - path.time[i];
  std::vector<double> sorted = steps;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  const double median = *middle;

  if (median >= 0.5 && path.size() > 20)
    notes.push_back(
        fmt::format("the median step of time is {:.4g} s; is t in milliseconds? It is taken as seconds", median));

  const auto [least, most] = std::minmax_element(steps.begin(), steps.end());
  if (*most - *least <= 0.01 * median) return;
  std::string note =
      fmt::format("time stamps are uneven and kept as they are: {:.4g} Hz on average, commonest steps {}",
                  static_cast<double>(steps.size()) / path.duration(), commonest(steps));
  const auto gaps = std::count_if(steps.begin(), steps.end(), [&](double step) { return step > 5 * median; });
  if (gaps > 0)
    note += fmt::format("; {} gap{} longer than 5 median steps, the longest {:.4g} s before sample {}", gaps,
                        gaps > 1 ? "s" : "", *most, most - steps.begin() + 2);
  notes.push_back(note);
}

void note_held_force(const Path& path, std::vector<std::string>& notes) {
  std::size_t moved = 0, held = 0;
  for (std::size_t i = 1; i < path.force.size(); ++i) {
    if (path.position[i] == path.position[i - 1]) continue;
    ++moved;
    if (path.force[i] == path.force[i - 1] && !path.force[i].isZero(0)) ++held;
  }
  if (5 * held > moved && held > 0)
    notes.push_back(fmt::format(
        "the force stays the same in {:.0f} % of the steps in which the position moves: its sensor is slower "
        "than the samples",
        100 * static_cast<double>(held) / static_cast<double>(moved)));
}

void write_recording(const Path& path, const std::string& file, const std::string& title, bool overwrite) {
  RecordingHeader header;
  header.software = "haptrace";
  header.title = title;
  header.clock = "virtual";
  if (path.size() > 1) header.rate_hz = static_cast<double>(path.size() - 1) / path.duration();

  std::vector<Sample> samples(path.size());
  for (std::size_t i = 0; i < samples.size(); ++i) {
    Sample& sample = samples[i];
    sample.tick = i;
    sample.time_ns = std::llround((path.time[i] - path.time.front()) * 1e9);
    if (i > 0 && sample.time_ns <= samples[i - 1].time_ns)
      throw input_error(
          fmt::format("{}: sample {} comes less than 1 ns after the one before; a recording keeps "
                      "nanoseconds. Is time in seconds?",
                      path.name, i + 1));
    sample.position = path.position[i];
    sample.velocity = path.velocity.empty() ? nan3() : path.velocity[i];
    sample.force = path.force.empty() ? nan3() : path.force[i];
    sample.phase = Phase::run;
  }
  RecordingWriter writer(
      file, header, {},
      {.overwrite = overwrite, .storage = {.rows_per_chunk = std::min<std::size_t>(path.size(), 2048)}});
  writer.append(samples);
  writer.finish();
}

}  // namespace

std::shared_ptr<const PathSource> open_path(const std::string& file, const PathSelection& selection,
                                            const RowsDone& progress) {
  namespace fs = std::filesystem;
  std::error_code error;
  const fs::file_status status = fs::status(file, error);
  if (!fs::exists(status)) throw input_error(file + ": no such file");
  if (fs::is_directory(status)) throw input_error(file + ": is a folder, not a path");

  const bool recorded = is_hdf5(file) || ends_like_hdf5(file);
  std::shared_ptr<PathSource> source =
      recorded ? source_of(RecordingReader(file), file, selection, progress) : source_of(read_csv(file), selection);
  const bool whole = !recorded || source->facts().rows <= kNotedRows;
  const Path noted = source->read(0, whole ? source->facts().rows : kNotedRows);
  std::vector<std::string> notes;
  note_sampling(noted, notes);
  note_held_force(noted, notes);
  for (const std::string& note : notes)
    source->note(whole ? note : fmt::format("the first {} samples: {}", kNotedRows, note));
  if (const double longest = source->facts().longest_interval;
      !whole && longest > 5 * noted.duration() / static_cast<double>(noted.size()))
    source->note(fmt::format("the longest interval between two samples is {:.4g} s", longest));
  return source;
}

Path load_path(const std::string& file) {
  const auto source = open_path(file);
  Path path = source->read(0, source->facts().rows);
  path.notes = source->facts().notes;
  return path;
}

void save_path(const Path& path, const std::string& file, const std::string& title, bool overwrite) {
  validate(path);
  if (ends_like_hdf5(file)) return write_recording(path, file, title, overwrite);
  if (ending(file) == ".csv") return write_csv(path, file, overwrite);
  throw input_error(fmt::format("{}: a path is written as .csv or .h5", file));
}

}  // namespace haptrace
