#include "formats/path/path_source.h"

#include "base/error.h"
#include "control/event_words.h"
#include "control/rotation.h"
#include "formats/path/path_blocks.h"
#include "formats/recording/recording_summary.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr std::array<std::string_view, 6> kRecordedColumns{"time",  "position", "velocity",
                                                           "force", "support",  "orientation"};
constexpr std::array<std::string_view, 6> kMeasuredColumns{"time",           "position", "velocity",
                                                           "force_measured", "support",  "orientation"};
constexpr std::array<std::string_view, 6> kFigureColumns{"time", "tick", "position", "velocity", "force", "phase"};
constexpr std::array<std::string_view, 1> kPhase{"phase"};

/// Half-open range of rows.
struct Rows {
  std::uint64_t begin = 0, end = 0;
  [[nodiscard]] std::uint64_t size() const { return end > begin ? end - begin : 0; }
};

double seconds(std::int64_t ns) {
  return 1e-9 * static_cast<double>(ns);
}

void check(const PathSelection& selection, const std::string& name) {
  if (!(selection.from <= selection.to))
    throw input_error(
        fmt::format("{}: from {} s to {} s is not a valid time range", name, selection.from, selection.to));
}

Error nothing_between(const PathSelection& selection, const std::string& name, double begin, double end) {
  return input_error(
      fmt::format("{}: has no sample from {} s {}; its path lasts from {:.3f} s to {:.3f} s", name, selection.from,
                  std::isfinite(selection.to) ? fmt::format("to {} s", selection.to) : "on", begin, end));
}

class MemoryPath final : public PathSource {
 public:
  MemoryPath(Path path, const PathSelection& selection) : path_(std::move(path)) {
    validate(path_);
    check(selection, path_.name);
    if (selection.repetition)
      throw input_error(fmt::format("{}: a repetition can only be chosen from a recording", path_.name));
    cut(selection);

    facts_.name = path_.name;
    facts_.begin = path_.time.front();
    facts_.end = path_.time.back();
    facts_.velocity = !path_.velocity.empty();
    facts_.force = !path_.force.empty();
    facts_.orientation = !path_.orientation.empty();
    facts_.notes = path_.notes;
    measure();
  }

  [[nodiscard]] Path read(std::uint64_t first, std::uint64_t count) const override {
    const std::size_t begin = std::min<std::size_t>(first, path_.size() - 1);
    const std::size_t end = begin + std::min<std::size_t>(count, path_.size() - begin);
    const auto part = [&]<class T>(const std::vector<T>& column) {
      if (column.empty()) return column;
      return std::vector<T>(column.begin() + static_cast<std::ptrdiff_t>(begin),
                            column.begin() + static_cast<std::ptrdiff_t>(end));
    };
    return {.name = path_.name,
            .time = part(path_.time),
            .position = part(path_.position),
            .velocity = part(path_.velocity),
            .force = part(path_.force),
            .orientation = part(path_.orientation)};
  }

  [[nodiscard]] std::uint64_t row_at(double time) const override {
    const auto after = std::upper_bound(path_.time.begin(), path_.time.end(), time);
    return after == path_.time.begin() ? 0 : static_cast<std::uint64_t>(after - path_.time.begin() - 1);
  }

 private:
  void cut(const PathSelection& selection) {
    const auto begin = std::lower_bound(path_.time.begin(), path_.time.end(), selection.from);
    const auto end = std::upper_bound(path_.time.begin(), path_.time.end(), selection.to);
    if (begin >= end) throw nothing_between(selection, path_.name, path_.time.front(), path_.time.back());
    const std::ptrdiff_t first = begin - path_.time.begin(), last = end - path_.time.begin();
    if (first == 0 && end == path_.time.end()) return;
    const auto keep = [&](auto& column) {
      if (column.empty()) return;
      column.erase(column.begin() + last, column.end());
      column.erase(column.begin(), column.begin() + first);
    };
    keep(path_.position);
    keep(path_.velocity);
    keep(path_.force);
    keep(path_.orientation);
    keep(path_.time);
  }

  void measure() {
    PathBlocks blocks;
    for (std::size_t i = 0; i < path_.size(); ++i) blocks.add(path_.time[i], path_.position[i]);
    blocks_ = blocks.blocks();
    for (const PathBlock& block : blocks_) join_block(facts_, block);
  }

  Path path_;
};

class RecordedPath final : public PathSource {
 public:
  RecordedPath(RecordingReader reader, const std::string& name, const PathSelection& selection,
               const RowsDone& progress)
      : reader_(std::move(reader)), measured_(selection.measured), negated_(selection.negated) {
    facts_.name = name;
    check(selection, name);
    if (reader_.rows() == 0) throw input_error(fmt::format("{}: the path has no samples", name));
    facts_.supported = reader_.columns().support;
    const std::vector<RecordingSummary> overview = reader_.overview(progress);
    RecordingSummary whole;
    for (const RecordingSummary& block : overview) whole.join(block);
    if (!reader_.header().complete) note("the recording was not finished; the samples in the file were read");

    rows_ = choose(overview, whole, selection);
    if (rows_.size() < whole.rows && whole.runs > 0)
      note(fmt::format("{} of {} samples are in phase run{}; the others were left out", whole.run_rows, whole.rows,
                       whole.runs > 1 ? fmt::format(", in {} repetitions", whole.runs) : ""));
    if (facts_.cut_short) note("this repetition was cut short by a time limit, a stop or a fault");
    cut(selection);
    measure(overview, whole.runs > 0);
  }

  [[nodiscard]] Path read(std::uint64_t first, std::uint64_t count) const override {
    constexpr std::uint64_t kRowsAtOnce = 16'384;
    first = std::min(first, rows_.size() - 1);
    const std::uint64_t end = rows_.begin + first + std::min(count, rows_.size() - first);
    Path path{.name = facts_.name};
    for (std::uint64_t row = rows_.begin + first; row < end; row += kRowsAtOnce)
      for (const Sample& sample : reader_.read(row, std::min(kRowsAtOnce, end - row), columns())) {
        path.time.push_back(seconds(sample.time_ns));
        path.position.push_back(sample.position);
        if (facts_.velocity) path.velocity.push_back(sample.velocity);
        if (facts_.force) path.force.push_back(force_of(sample));
        if (facts_.orientation) path.orientation.push_back(sample.orientation);
      }
    fill_gaps(path.orientation, rows_.begin + first);
    validate(path, rows_.begin + first);
    return path;
  }

  [[nodiscard]] std::uint64_t row_at(double time) const override {
    const std::uint64_t row = last_row_until(time);
    return row < rows_.begin ? 0 : std::min(row, rows_.end - 1) - rows_.begin;
  }

 private:
  /// Returns the force of the path: that of the recording without the support of the arm.
  [[nodiscard]] Vec3 force_of(const Sample& sample) const {
    Vec3 recorded = measured_ ? sample.force_measured : sample.force;
    if (!facts_.supported || !sample.support.allFinite()) return recorded;
    return recorded - (measured_ && negated_ ? -1.0 : 1.0) * sample.support;
  }

  /// Returns the last row of the recording that is not after `time`.
  [[nodiscard]] std::uint64_t last_row_until(double time) const {
    constexpr double kFarthest = 9e9;  // [s], well within 63 bits of nanoseconds
    return reader_.row_at(std::llround(1e9 * std::clamp(time, -kFarthest, kFarthest)));
  }

  [[nodiscard]] double time_of(std::uint64_t row) const {
    return seconds(reader_.read(row, 1, std::span(kRecordedColumns).first(1)).front().time_ns);
  }

  /// Returns the rows of the path, and sets facts_.cut_short.
  [[nodiscard]] Rows choose(const std::vector<RecordingSummary>& overview, const RecordingSummary& whole,
                            const PathSelection& selection) {
    if (!selection.repetition && whole.runs == 0) return {0, whole.rows};
    if (whole.runs == 1 && selection.repetition.value_or(1) == 1) return find_run(overview, 1);
    const std::vector<StoredEvent> events = reader_.events();
    if (selection.repetition) {
      const auto asked = static_cast<std::uint64_t>(std::max(*selection.repetition, 0));
      if (asked < 1 || asked > whole.runs)
        throw input_error(fmt::format("{}: there is no repetition {}; the recording has {}", facts_.name,
                                      *selection.repetition, whole.runs));
      const Rows run = find_run(overview, asked);
      facts_.cut_short = is_cut_short(run, events);
      return run;
    }
    for (std::uint64_t number = whole.runs; number > 0; --number) {
      const Rows run = find_run(overview, number);
      if (is_cut_short(run, events)) continue;
      note(fmt::format("the path is the last of {} repetitions{}; choose another with --repetition 1 to {}", whole.runs,
                       number < whole.runs ? fmt::format(" that was not cut short, number {}", number) : "",
                       whole.runs));
      return run;
    }
    facts_.cut_short = true;
    note(fmt::format("the path is the last of {} repetitions; choose another with --repetition 1 to {}", whole.runs,
                     whole.runs));
    return find_run(overview, whole.runs);
  }

  /// Returns whether an event of a time limit, a stop or a fault ended a run.
  [[nodiscard]] bool is_cut_short(const Rows& run, std::span<const StoredEvent> events) const {
    constexpr double kAround = 5e-3;  // the event is of the tick that ends the run, or of the next [s]
    const double end = time_of(run.end - 1);
    return std::any_of(events.begin(), events.end(), [&](const StoredEvent& event) {
      const EventWords* words = words_of(static_cast<EventCode>(event.code));
      return words != nullptr && words->stops && std::abs(event.time - end) <= kAround;
    });
  }

  /// Returns the rows of run `number`, from 1. Reads only the blocks in which the run begins and ends.
  [[nodiscard]] Rows find_run(const std::vector<RecordingSummary>& overview, std::uint64_t number) const {
    std::uint64_t row = 0, begun = 0;
    bool in_run = false;  // at the end of the previous block
    auto block = overview.begin();
    for (; block != overview.end(); ++block) {
      const std::uint64_t begin_here = block->runs - (in_run && block->begins_in_run ? 1 : 0);
      if (begun + begin_here >= number) break;
      begun += begin_here;
      in_run = block->ends_in_run;
      row += block->rows;
    }

    Rows run{row, row};
    bool found = false;
    for (; block != overview.end(); row += block->rows, ++block) {
      // After the start of the run, a block that is all of phase run belongs to it.
      if (found && block->run_rows == block->rows) {
        run.end = row + block->rows;
        continue;
      }
      const std::vector<Sample> samples = reader_.read(row, block->rows, kPhase);
      for (std::size_t i = 0; i < samples.size(); ++i) {
        const bool is_run = samples[i].phase == Phase::run;
        if (!found && is_run && !in_run && ++begun == number) {
          found = true;
          run.begin = row + i;
        }
        if (found && !is_run) return {run.begin, row + i};
        in_run = is_run;
      }
      run.end = row + block->rows;
    }
    return run;
  }

  void cut(const PathSelection& selection) {
    Rows rows = rows_;
    if (std::isfinite(selection.from)) {
      const std::uint64_t row = last_row_until(selection.from);
      rows.begin = std::max(rows.begin, time_of(row) < selection.from ? row + 1 : row);
    }
    if (std::isfinite(selection.to)) {
      const std::uint64_t row = last_row_until(selection.to);
      rows.end = std::min(rows.end, time_of(row) > selection.to ? row : row + 1);
    }
    if (rows.size() == 0) throw nothing_between(selection, facts_.name, time_of(rows_.begin), time_of(rows_.end - 1));
    rows_ = rows;
  }

  /// Reads blocks that the path covers in part, and uses the stored summaries of the others.
  void measure(const std::vector<RecordingSummary>& overview, bool of_runs) {
    std::uint64_t row = 0, with_velocity = 0, with_force = 0;
    std::vector<Rows> without_position;
    std::optional<std::int64_t> last_ns;
    for (const RecordingSummary& block : overview) {
      const Rows all{row, row + block.rows};
      const Rows ours{std::max(all.begin, rows_.begin), std::min(all.end, rows_.end)};
      row = all.end;
      if (ours.size() == 0) continue;
      const RecordingSummary figures = ours.size() == block.rows ? block : summary_of(ours);
      if (last_ns)
        blocks_.back().longest_interval =
            std::max(blocks_.back().longest_interval, seconds(figures.first_ns - *last_ns));
      else
        facts_.begin = seconds(figures.first_ns);
      last_ns = figures.last_ns;
      with_velocity += figures.with_velocity;
      with_force += figures.with_force;
      if (figures.without_position > 0) without_position.push_back(ours);
      blocks_.push_back({.first = ours.begin - rows_.begin,
                         .rows = ours.size(),
                         .bounds = figures.bounds,
                         .peak_speed = of_runs ? figures.run_peak_speed : figures.peak_speed,
                         .longest_interval = figures.longest_interval});
    }
    for (const PathBlock& block : blocks_) join_block(facts_, block);
    facts_.end = seconds(last_ns.value_or(0));
    // Reading these rows reports which one it is.
    for (const Rows& rows : without_position) (void)read(rows.begin - rows_.begin, rows.size());
    validate_size(facts_.name, facts_.bounds);
    facts_.velocity = usable(with_velocity, "velocity");
    facts_.measured = reader_.columns().force_measured;
    facts_.force =
        measured_ ? facts_.measured && usable(rows_with_measured(), "measured force") : usable(with_force, "force");
    facts_.contacts = !reader_.header().scene.empty();
    facts_.orientation = reader_.columns().orientation && is_finite(first_orientation());
  }

  /// Returns the columns that are read for every row.
  [[nodiscard]] std::span<const std::string_view> columns() const {
    return std::span(measured_ ? kMeasuredColumns : kRecordedColumns).first(facts_.orientation ? 6 : 5);
  }

  /// Reads the column: the stored summaries do not count it.
  [[nodiscard]] std::uint64_t rows_with_measured() const {
    constexpr std::uint64_t kRowsAtOnce = 65'536;
    std::uint64_t known = 0;
    for (std::uint64_t row = rows_.begin; row < rows_.end; row += kRowsAtOnce)
      for (const Sample& sample :
           reader_.read(row, std::min(kRowsAtOnce, rows_.end - row), std::span(kMeasuredColumns).subspan(3, 1)))
        known += is_finite(sample.force_measured) ? 1 : 0;
    return known;
  }

  [[nodiscard]] Quat first_orientation() const {
    return reader_.read(rows_.begin, 1, std::span(kRecordedColumns).last(1)).front().orientation;
  }

  /// Replaces unknown orientations by the last known one, or by the first known one at the beginning of a piece.
  void fill_gaps(std::vector<Quat>& orientation, std::uint64_t first_row) const {
    if (orientation.empty()) return;
    const auto known = [](const Quat& q) { return is_finite(q); };
    const auto first = std::find_if(orientation.begin(), orientation.end(), known);
    if (first == orientation.end())
      throw input_error(
          fmt::format("{}: from sample {} on, {} samples have no orientation; --position-only plays "
                      "the path without orientation",
                      facts_.name, first_row + 1, orientation.size()));
    Quat last = *first;
    for (Quat& q : orientation) {
      if (!known(q)) q = last;
      last = q;
    }
  }

  [[nodiscard]] RecordingSummary summary_of(const Rows& rows) const {
    Summariser summariser;
    summariser.add(reader_.read(rows.begin, rows.size(), kFigureColumns));
    return summariser.take();
  }

  /// Returns true if every row has a value. Adds a note if only some rows have one.
  bool usable(std::uint64_t known, const char* name) {
    if (known > 0 && known < rows_.size())
      note(fmt::format("{} left out: {} of {} samples lack it", name, rows_.size() - known, rows_.size()));
    return known == rows_.size();
  }

  RecordingReader reader_;
  bool measured_;  ///< the force is the measured one
  bool negated_;   ///< ... of the hand on the device
  Rows rows_;      ///< rows of the recording
};

}  // namespace

std::unique_ptr<PathSource> source_of(Path path, const PathSelection& selection) {
  return std::make_unique<MemoryPath>(std::move(path), selection);
}

std::unique_ptr<PathSource> source_of(RecordingReader reader, const std::string& name, const PathSelection& selection,
                                      const RowsDone& progress) {
  return std::make_unique<RecordedPath>(std::move(reader), name, selection, progress);
}

}  // namespace haptrace
