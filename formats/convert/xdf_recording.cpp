// Streams of an XDF file as a recording: one clock, channels by their labels, SI units, markers as events.
#include "base/error.h"
#include "base/rfc3339.h"
#include "base/suggest.h"
#include "base/text_file.h"
#include "base/units.h"
#include "formats/convert/sample_text.h"
#include "formats/convert/xdf_file.h"
#include "formats/path/csv_stamp.h"
#include "formats/recording/recording_formats.h"
#include "formats/recording/recording_layout.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace haptrace {
namespace {

constexpr double kStale = 1;        // [s]; an older held value is not used
constexpr double kSameTime = 1e-6;  // [s]; stamps that differ by less are equal up to rounding

/// Returns the letters and digits in lower case: "Pos X" -> "posx".
std::string plain(std::string_view label) {
  std::string text;
  for (const char each : label) {
    const auto c = static_cast<unsigned char>(each);
    if (std::isalnum(c) != 0) text += static_cast<char>(std::tolower(c));
  }
  return text;
}

/// A cell of a row by its CSV name, without time, gains, phase, latency and tick, and the channel labels that match it.
struct Target {
  std::string name;
  std::size_t cell;
  std::string units;  ///< SI unit
  std::vector<std::string> labels;
};

const std::vector<Target>& targets() {
  static const std::vector<Target> all = [] {
    const std::map<std::string_view, std::vector<std::string>> words{
        {"position", {"", "pos", "position", "p"}},
        {"velocity", {"v", "vel", "velocity"}},
        {"force", {"f", "force"}},
        {"orientation", {"q", "quat", "quaternion", "orientation"}},
        {"torque", {"t", "torque", "moment"}},
        {"force_measured", {"forcemeasured", "measuredforce"}},
    };
    std::vector<Target> list;
    for (const TextColumn& column : text_columns()) {
      const std::string_view of = column.column->name;
      if (of == "time" || of == "gains" || of == "phase" || of == "latency" || of == "tick") continue;
      for (std::size_t i = 0; i < column.width(); ++i) {
        Target target{std::string(column.names.at(i)), column.first + i, column.column->units, {}};
        // A channel called mx is usually a moment, so a measured force needs --map.
        if (of != "force_measured") target.labels.push_back(target.name);
        if (const auto found = words.find(of); found != words.end()) {
          const std::string axis(1, target.name.back());
          for (const std::string& word : found->second) {
            target.labels.push_back(word + axis);
            target.labels.push_back(axis + word);
          }
        }
        list.push_back(std::move(target));
      }
    }
    return list;
  }();
  return all;
}

/// Cell and conversion factor of a channel that is read.
struct Mapping {
  std::size_t channel, cell;
  double factor;
};

/// Reads the samples of one stream in order, with stamps on the recorder's clock.
class StreamCursor {
 public:
  StreamCursor(const std::string& file, const xdf::StreamInfo& info, const xdf::ClockMap& clock)
      : walk_(file), info_(&info), clock_(&clock) {}

  /// Moves to the next sample. Returns false at the end.
  bool next() {
    std::optional<double> stamp;
    for (;;) {
      if (samples_.next(stamp, values_, texts_)) break;
      if (!samples_.complete()) ++broken_chunks_;
      samples_ = {};
      do {
        if (!walk_.next()) return false;
      } while (walk_.tag() != xdf::Tag::samples || walk_.stream() != info_->id);
      samples_ = xdf::SampleWalk(info_, walk_.content());
    }
    raw_ = stamp ? *stamp : raw_ + (info_->nominal_rate > 0 ? 1 / info_->nominal_rate : 0);
    time_ = clock_->to_recorder(raw_);
    return true;
  }

  [[nodiscard]] double time() const { return time_; }
  [[nodiscard]] const std::vector<double>& values() const { return values_; }
  [[nodiscard]] const std::vector<std::string>& texts() const { return texts_; }
  [[nodiscard]] double fraction() const { return walk_.fraction(); }
  [[nodiscard]] std::uint64_t broken_chunks() const { return broken_chunks_; }

 private:
  xdf::ChunkWalk walk_;
  const xdf::StreamInfo* info_;
  const xdf::ClockMap* clock_;
  xdf::SampleWalk samples_;
  double raw_ = 0, time_ = 0;
  std::vector<double> values_;
  std::vector<std::string> texts_;
  std::uint64_t broken_chunks_ = 0;
};

/// Even clock for the samples from `first` on: a + b (i - first), fitted to their stamps.
struct EvenPart {
  std::uint64_t first = 0;
  double count = 0, i = 0, t = 0, ii = 0, it = 0;  ///< means and sums about them, updated one by one (Welford)
  double a = 0, b = 0;

  void add(double index, double time) {
    count += 1;
    const double di = index - i, dt = time - t;
    i += di / count;
    t += dt / count;
    ii += di * (index - i);
    it += di * (time - t);
  }
  void fit() {
    b = ii > 0 ? it / ii : 0;
    a = t - b * i;
  }
};

class XdfSource final : public RecordingSource {
 public:
  XdfSource(const std::string& file, const SourceOptions& options) : file_(file), options_(options) {
    read_index();
    choose_streams();
    for (Stream* stream : chosen_) map_channels(*stream);
    check_mapping();
    if (options.dejitter) fit_even_clock();
    for (Stream* stream : chosen_) cursors_.push_back({stream, {file, stream->info, stream->clock}});
    for (std::size_t i = 1; i < cursors_.size(); ++i) cursors_[i].more = cursors_[i].cursor.next();
    read_block();
    if (block_.empty() && rows_ > 0)
      throw input_error(
          fmt::format("{}: no sample of stream '{}' has {} at its time; choose other streams with --stream", file,
                      main().info.name, fmt::join(whole_names(), " and ")));
    if (block_.empty()) throw input_error(fmt::format("{}: stream '{}' has no sample", file, main().info.name));
    read_markers();

    header_.software = "haptrace";
    header_.clock = "virtual";
    header_.complete = true;
    header_.title = main().info.name;
    header_.rate_hz = main().info.nominal_rate;
    if (const std::int64_t span = block_.back().time_ns - block_.front().time_ns; header_.rate_hz == 0 && span > 0)
      header_.rate_hz = 1e9 * static_cast<double>(block_.size() - 1) / static_cast<double>(span);
  }

  [[nodiscard]] const RecordingHeader& header() const override { return header_; }
  [[nodiscard]] const RecordingColumns& columns() const override { return columns_; }
  [[nodiscard]] std::vector<StoredEvent> events() const override { return events_; }
  [[nodiscard]] double fraction() const override { return cursors_.front().cursor.fraction(); }

  std::span<const Sample> next() override {
    if (std::exchange(first_taken_, true)) read_block();
    return block_;
  }

  [[nodiscard]] std::vector<std::string> notes() const override {
    std::vector<std::string> notes = notes_;
    if (left_out_ > 0)
      notes.push_back(
          fmt::format("{} samples left out: there is no {} at their time (streams begin and end at different "
                      "times, and a value is held for {:g} s)",
                      left_out_, fmt::join(whole_names(), " or no "), kStale));
    for (const Reading& reading : cursors_)
      if (reading.cursor.broken_chunks() > 0)
        notes.push_back(
            fmt::format("stream '{}': {} chunks of samples are damaged or cut off; their readable samples were kept",
                        reading.stream->info.name, reading.cursor.broken_chunks()));
    return notes;
  }

 private:
  struct Stream {
    xdf::StreamInfo info;
    xdf::ClockMap clock;
    std::vector<Mapping> mappings;
  };
  struct Reading {
    Stream* stream;
    StreamCursor cursor;
    bool more = false;   ///< the cursor is at a sample that was not used yet
    double time = kNaN;  ///< time of the held sample [s]
    std::vector<double> held;
  };

  [[nodiscard]] const Stream& main() const { return *chosen_.front(); }

  /// Reads the headers and clock offsets, which may be anywhere in the file.
  void read_index() {
    xdf::ChunkWalk walk(file_);
    std::map<std::uint32_t, xdf::ClockMap> clocks;
    while (walk.next()) {
      if (walk.tag() == xdf::Tag::stream_header) {
        const bool known = std::any_of(streams_.begin(), streams_.end(),
                                       [&](const auto& stream) { return stream->info.id == walk.stream(); });
        if (known) continue;
        auto stream = std::make_unique<Stream>();
        try {
          stream->info = xdf::parse_stream_header(walk.stream(), walk.content());
        } catch (const Error& error) {  // the stream may not be needed
          unreadable_ += fmt::format("; {}", error.what());
          continue;
        }
        streams_.push_back(std::move(stream));
      } else if (walk.tag() == xdf::Tag::clock_offset) {
        const std::string content = walk.content();
        double numbers[2];
        if (content.size() < sizeof numbers) continue;
        std::memcpy(numbers, content.data(), sizeof numbers);
        clocks[walk.stream()].add(numbers[0], numbers[1]);
      } else if (walk.tag() == xdf::Tag::file_header) {
        const std::string written = xdf::file_header_text(walk.content(), "datetime");
        if (const auto created = parse_date_stamp(written, true))
          header_.created = rfc3339(std::chrono::system_clock::time_point(
              std::chrono::floor<std::chrono::seconds>(std::chrono::nanoseconds(*created))));
        else if (!written.empty())
          notes_.push_back(
              fmt::format("the file's date '{}' was left out: it is not a time with a zone, as in "
                          "2026-03-01T12:00:00+01:00",
                          shown(written)));
      }
    }
    for (const auto& stream : streams_) {
      stream->clock = std::move(clocks[stream->info.id]);
      stream->clock.fit();
      if (stream->clock.parts() > 1)
        notes_.push_back(
            fmt::format("the clock of stream '{}' was reset {} times", stream->info.name, stream->clock.parts() - 1));
    }
    if (!unreadable_.empty()) notes_.push_back("left out: " + unreadable_.substr(2));
    notes_.insert(notes_.end(), walk.notes().begin(), walk.notes().end());
  }

  [[nodiscard]] std::string listed() const {
    std::vector<std::string> lines;
    for (const auto& stream : streams_) {
      std::vector<std::string> labels;
      for (const xdf::Channel& channel : stream->info.channels) labels.push_back(channel.label);
      lines.push_back(fmt::format(
          "'{}' ({}) with {}", stream->info.name, stream->info.type,
          stream->info.format == xdf::Format::text ? "markers" : fmt::format("{}", fmt::join(labels, ", "))));
    }
    return (lines.empty() ? "it has no stream" : fmt::format("it has {}", fmt::join(lines, "; "))) + unreadable_;
  }

  /// Returns the channel of `stream` for `target`, if there is one.
  [[nodiscard]] std::optional<std::size_t> channel_of(const Stream& stream, const Target& target) const {
    const auto& channels = stream.info.channels;
    const auto named = options_.channels.find(target.name);
    for (std::size_t i = 0; i < channels.size(); ++i) {
      const bool fits = named != options_.channels.end() ? channels[i].label == named->second
                                                         : std::find(target.labels.begin(), target.labels.end(),
                                                                     plain(channels[i].label)) != target.labels.end();
      if (fits) return i;
    }
    return {};
  }

  [[nodiscard]] bool has_position(const Stream& stream) const {
    return stream.info.format != xdf::Format::text &&
           std::all_of(targets().begin(), targets().begin() + 3,
                       [&](const Target& target) { return channel_of(stream, target).has_value(); });
  }

  void choose_streams() {
    for (const std::string& name : options_.streams) {
      std::vector<Stream*> found;
      for (const auto& stream : streams_)
        if (stream->info.name == name || stream->info.type == name) found.push_back(stream.get());
      if (found.size() == 1 && found.front()->info.format == xdf::Format::text)
        throw input_error(fmt::format(
            "{}: stream '{}' holds markers, which become events automatically; remove it from --stream", file_, name));
      if (found.size() != 1)
        throw input_error(fmt::format("{}: {} streams have the name or type '{}'; {}", file_,
                                      found.empty() ? "no" : fmt::format("{}", found.size()), name, listed()));
      chosen_.push_back(found.front());
    }
    if (!chosen_.empty()) return;
    for (const auto& stream : streams_)
      if (has_position(*stream)) chosen_.push_back(stream.get());
    if (chosen_.size() != 1)
      throw input_error(fmt::format(
          "{}: {} with channels x, y and z; choose one with --stream NAME and, if labels differ, --map x=LABEL,...; {}",
          file_, chosen_.empty() ? "there is no stream" : "there are several streams", listed()));
  }

  void map_channels(Stream& stream) {
    for (const Target& target : targets()) {
      if (mapped_[target.name]) continue;
      const std::optional<std::size_t> channel = channel_of(stream, target);
      if (!channel) continue;
      mapped_[target.name] = true;
      stream.mappings.push_back({*channel, target.cell, factor(stream.info.channels[*channel], target)});
    }
  }

  double factor(const xdf::Channel& channel, const Target& target) {
    if (channel.unit.empty() || target.units == "1") return 1;
    if (const Unit* unit = find_unit(channel.unit, target.units)) return 1 / unit->per_si;
    notes_.push_back(fmt::format("channel '{}' is in '{}', which is not a unit of {}; its values are read as {}",
                                 channel.label, channel.unit, target.name, target.units));
    return 1;
  }

  void check_mapping() {
    for (const auto& [name, label] : options_.channels) {
      std::vector<std::string> known;
      for (const Target& target : targets()) known.push_back(target.name);
      if (std::find(known.begin(), known.end(), name) == known.end())
        throw input_error(
            fmt::format("--map {}={}: '{}' is not a column{}", name, label, name, suggestion(name, known)));
      if (!mapped_[name])
        throw input_error(fmt::format("--map {}={}: no channel of the chosen streams has this label; {} {}", name,
                                      label, file_, listed()));
    }
    if (!mapped_["x"] || !mapped_["y"] || !mapped_["z"])
      throw input_error(
          fmt::format("{}: the chosen streams have no channels x, y and z; name them with "
                      "--map x=LABEL,y=LABEL,z=LABEL; {}",
                      file_, listed()));
    for (const TextColumn& column : text_columns()) {
      if (!mapped_[std::string(column.names[0])]) continue;
      if (column.column->option != nullptr) columns_.*column.column->option = true;
      for (const std::string_view name : {"position", "velocity", "force"})
        if (column.column->name == name) whole_.push_back(&column);
    }
  }

  /// Fits an even clock to stamps that a network and a busy machine made uneven, and that scatter about it. A gap of
  /// more than a second and 500 samples starts a new clock.
  void fit_even_clock() {
    const double period = main().info.nominal_rate > 0 ? 1 / main().info.nominal_rate : 0;
    if (period == 0)
      throw input_error(fmt::format("{}: --dejitter: stream '{}' declares an irregular rate, so it has no even clock",
                                    file_, main().info.name));
    StreamCursor cursor(file_, main().info, main().clock);
    double before = 0;
    for (std::uint64_t i = 0; cursor.next(); ++i) {
      const double step = cursor.time() - before;
      if (i == 0 || std::abs(step) > std::max(1.0, 500 * period)) even_.emplace_back().first = i;
      before = cursor.time();
      even_.back().add(static_cast<double>(i - even_.back().first), before);
    }
    for (EvenPart& part : even_) part.fit();
  }

  [[nodiscard]] double even_time(std::uint64_t row) const {
    const auto after = std::upper_bound(even_.begin(), even_.end(), row,
                                        [](std::uint64_t r, const EvenPart& part) { return r < part.first; });
    const EvenPart& part = *std::prev(after);
    return part.a + part.b * static_cast<double>(row - part.first);
  }

  void read_block() {
    const auto refuse = [&](const TextColumn& column, std::size_t, const std::string& what) {
      throw input_error(fmt::format("{}: sample {}: {}: {}", file_, rows_, column.column->name, what));
    };
    Reading& first = cursors_.front();
    while (parser_.rows() < kSourceBlock && first.cursor.next()) {
      const double time = even_.empty() ? first.cursor.time() : even_time(rows_);
      ++rows_;
      cells_ = unknown_;
      put(*first.stream, first.cursor.values());
      for (std::size_t i = 1; i < cursors_.size(); ++i) put_held(cursors_[i], time);
      if (incomplete()) {
        ++left_out_;
        continue;
      }
      if (!start_) {
        start_ = time;
        first_row_ = rows_;
      }
      cells_[0] = time - *start_;
      if (!(std::abs(cells_[0]) < layout::kLongestTime))
        throw input_error(fmt::format("{}: sample {} has the stamp {}, which is not a time", file_, rows_, time));
      cells_[phase_] = static_cast<double>(Phase::run);
      cells_[tick_] = static_cast<double>(rows_ - first_row_);
      parser_.add(cells_, refuse);
    }
    block_ = parser_.take();
    if (!options_.any_order) check_order(block_, before_, file_);
  }

  /// Returns true if a vector is missing that a recording holds in every row or in none: its stream has not begun yet,
  /// or pauses.
  [[nodiscard]] bool incomplete() const {
    return std::any_of(whole_.begin(), whole_.end(), [&](const TextColumn* column) {
      const auto first = cells_.begin() + static_cast<std::ptrdiff_t>(column->first);
      return std::any_of(first, first + static_cast<std::ptrdiff_t>(column->width()),
                         [](double cell) { return std::isnan(cell); });
    });
  }

  [[nodiscard]] std::vector<std::string_view> whole_names() const {
    std::vector<std::string_view> names;
    for (const TextColumn* column : whole_) names.emplace_back(column->column->name);
    return names;
  }

  void put(const Stream& stream, const std::vector<double>& values) {
    for (const Mapping& mapping : stream.mappings) cells_[mapping.cell] = mapping.factor * values[mapping.channel];
  }

  void put_held(Reading& reading, double time) {
    while (reading.more && reading.cursor.time() <= time + kSameTime) {
      reading.time = reading.cursor.time();
      reading.held = reading.cursor.values();
      reading.more = reading.cursor.next();
    }
    if (time - reading.time <= kStale) put(*reading.stream, reading.held);
  }

  void read_markers() {
    for (const auto& stream : streams_) {
      if (stream->info.format != xdf::Format::text) continue;
      StreamCursor cursor(file_, stream->info, stream->clock);
      while (cursor.next()) {
        std::vector<std::string> texts = cursor.texts();
        std::erase_if(texts, [](const std::string& text) { return text.empty(); });
        // Streams of a fixed rate send an empty text if there is no marker.
        if (texts.empty() && stream->info.nominal_rate > 0) continue;
        events_.push_back({cursor.time() - *start_, static_cast<std::int32_t>(EventCode::mark),
                           fmt::format("{}", fmt::join(texts, ", "))});
      }
    }
    std::erase_if(events_, [](const StoredEvent& event) { return !std::isfinite(event.time); });
    std::stable_sort(events_.begin(), events_.end(), [](const auto& a, const auto& b) { return a.time < b.time; });
  }

  std::string file_;
  SourceOptions options_;
  std::vector<std::string> notes_;
  std::string unreadable_;  ///< streams with invalid headers
  std::vector<std::unique_ptr<Stream>> streams_;
  std::vector<Stream*> chosen_;  ///< the first provides the rows
  std::map<std::string, bool> mapped_;
  std::vector<EvenPart> even_;
  std::vector<Reading> cursors_;  ///< one per stream of chosen_

  RecordingHeader header_;
  RecordingColumns columns_;
  std::vector<StoredEvent> events_;
  SampleParser parser_;
  std::vector<double> cells_, unknown_ = unknown_cells();
  std::size_t phase_ = text_columns()[text_column("phase")].first, tick_ = text_columns()[text_column("tick")].first;
  std::span<const Sample> block_;
  std::optional<Sample> before_;
  std::optional<double> start_;             ///< stamp of the first row that was passed on [s]
  std::uint64_t rows_ = 0, first_row_ = 0;  ///< rows read; number of the first that was passed on, from 1
  std::vector<const TextColumn*> whole_;    ///< mapped columns that a recording holds in every row or in none
  std::uint64_t left_out_ = 0;              ///< rows that lack one of whole_
  bool first_taken_ = false;
};

}  // namespace

std::unique_ptr<RecordingSource> open_xdf(const std::string& file, const SourceOptions& options) {
  return std::make_unique<XdfSource>(file, options);
}

}  // namespace haptrace
