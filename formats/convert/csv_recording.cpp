// Recordings as CSV: the comments `# haptrace {header}`, `# event {...}` and `# clock {...}`, the header row, and one
// row per sample.
#include "base/error.h"
#include "base/json_reader.h"
#include "formats/path/csv.h"
#include "formats/recording/recording_formats.h"
#include "formats/recording/recording_layout.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace haptrace {
namespace {

constexpr std::string_view kHeader = "haptrace ", kEvent = "event ", kClock = "clock ";

class CsvSource final : public RecordingSource {
 public:
  CsvSource(const std::string& file, const SourceOptions& options)
      : any_order_(options.any_order),
        reader_(file, {.columns = text_columns().size(),
                       .ordered = !options.any_order,
                       .remedy = kResampleRemedy,
                       .csv = options.csv}) {
    const std::string& name = reader_.lines().file();
    const std::string where = name + ": header";
    for (const std::string& comment : reader_.comments()) {
      if (comment.starts_with(kHeader) && !recording_) {
        recording_ = true;
        header_ = header_from_json(parse_json(comment.substr(kHeader.size()), where), where);
      } else if (comment.starts_with(kEvent)) {
        const std::string of_event = name + ": event";
        events_.push_back(event_from_json(parse_json(comment.substr(kEvent.size()), of_event), of_event));
      } else if (comment.starts_with(kClock)) {
        const std::string of_clock = name + ": clock";
        clocks_.push_back(clock_from_json(parse_json(comment.substr(kClock.size()), of_clock), of_clock));
      }
    }
    for (std::size_t i = 0; i < text_columns().size(); ++i)
      if (const auto option = text_columns()[i].column->option; option != nullptr && reader_.has(i))
        columns_.*option = true;
    if (!recording_) look_for_gaps(file, options.csv);
    read_block();
    if (!recording_) {
      header_.software = "haptrace";
      header_.clock = "virtual";
      header_.complete = true;
      if (block_.size() > 1 && block_.back().time_ns > block_.front().time_ns)
        header_.rate_hz = 1e9 * static_cast<double>(block_.size() - 1) /
                          static_cast<double>(block_.back().time_ns - block_.front().time_ns);
    }
  }

  [[nodiscard]] const RecordingHeader& header() const override { return header_; }
  [[nodiscard]] const RecordingColumns& columns() const override { return columns_; }
  [[nodiscard]] std::vector<StoredEvent> events() const override { return events_; }
  [[nodiscard]] std::vector<ClockReading> clocks() const override { return clocks_; }
  [[nodiscard]] double fraction() const override { return reader_.lines().fraction(); }

  std::span<const Sample> next() override {
    if (std::exchange(first_taken_, true)) read_block();
    return block_;
  }

  [[nodiscard]] std::vector<std::string> notes() const override {
    std::vector<std::string> notes = reader_.notes();
    notes.insert(notes.end(), left_out_notes_.begin(), left_out_notes_.end());
    if (!header_.complete) notes.emplace_back("the recording was not finished; the samples in the file were read");
    return notes;
  }

 private:
  /// Finds velocity or force columns that some rows lack, to leave them out: a recording has each in every row or in
  /// none.
  void look_for_gaps(const std::string& file, const CsvOptions& options) {
    std::vector<const TextColumn*> all_or_none;
    for (const char* name : {"velocity", "force"})
      if (const std::size_t column = text_column(name); reader_.has(column))
        all_or_none.push_back(&text_columns()[column]);
    if (all_or_none.empty()) return;
    CsvReader rows(file, {.columns = kPathColumns, .ordered = false, .remedy = "", .csv = options});
    std::vector<std::uint64_t> lacking(all_or_none.size(), 0);
    std::uint64_t count = 0;
    for (; rows.next(); ++count)
      for (std::size_t i = 0; i < all_or_none.size(); ++i) {
        const auto cells = rows.cells().subspan(all_or_none[i]->first, all_or_none[i]->width());
        if (std::any_of(cells.begin(), cells.end(), [](double value) { return std::isnan(value); })) ++lacking[i];
      }
    for (std::size_t i = 0; i < all_or_none.size(); ++i) {
      if (lacking[i] == 0) continue;
      left_out_.push_back(all_or_none[i]);
      if (lacking[i] < count)
        left_out_notes_.push_back(
            fmt::format("{} left out: {} of {} samples lack it", all_or_none[i]->column->name, lacking[i], count));
    }
  }

  void read_block() {
    const auto refuse = [&](const TextColumn& column, std::size_t component, const std::string& what) {
      throw reader_.lines().error(fmt::format("column {}: {}", column.names.at(component), what));
    };
    while (parser_.rows() < kSourceBlock && reader_.next()) {
      cells_.assign(reader_.cells().begin(), reader_.cells().end());
      if (!recording_) {
        if (rows_ == 0) start_ = cells_[0];
        cells_[0] -= start_;
      }
      if (!reader_.has(tick_)) cells_[text_columns()[tick_].first] = static_cast<double>(rows_);
      if (!reader_.has(phase_)) cells_[text_columns()[phase_].first] = static_cast<double>(Phase::run);
      for (const TextColumn* column : left_out_)
        std::fill_n(cells_.begin() + static_cast<std::ptrdiff_t>(column->first), column->width(), kNaN);
      if (!(std::abs(cells_[0]) < layout::kLongestTime))
        throw reader_.lines().error(fmt::format("column t: {} s is over 290 years. Is time in seconds?", cells_[0]));
      parser_.add(cells_, refuse);
      ++rows_;
    }
    block_ = parser_.take();
    if (!any_order_) check_order(block_, before_, reader_.lines().file());
  }

  bool any_order_;
  std::size_t tick_ = text_column("tick"), phase_ = text_column("phase");
  CsvReader reader_;
  RecordingHeader header_;
  RecordingColumns columns_;
  std::vector<StoredEvent> events_;
  std::vector<ClockReading> clocks_;
  SampleParser parser_;
  std::vector<double> cells_;
  std::vector<const TextColumn*> left_out_;
  std::vector<std::string> left_out_notes_;
  std::span<const Sample> block_;
  std::optional<Sample> before_;
  double start_ = 0;
  std::uint64_t rows_ = 0;
  bool recording_ = false, first_taken_ = false;
};

class CsvSink final : public RecordingSink {
 public:
  CsvSink(const std::string& file, const RecordingHeader& header, const RecordingColumns& columns,
          const std::vector<StoredEvent>& events, const SinkOptions& options)
      : writer_(file == kStandardOutput ? TextWriter::to_standard_output()
                                        : std::make_unique<TextWriter>(file, options.overwrite)),
        printer_("", options.digits) {
    std::string& text = writer_->text();
    text = fmt::format("# {}{}\n", kHeader, dump(json_of(header)));
    for (const StoredEvent& event : events) text += fmt::format("# {}{}\n", kEvent, dump(json_of(event)));
    for (const ClockReading& reading : options.clocks) text += fmt::format("# {}{}\n", kClock, dump(json_of(reading)));
    std::string separator;
    for (const TextColumn& column : text_columns()) {
      if (!column.column->in(columns)) continue;
      columns_.push_back(&column);
      for (std::size_t i = 0; i < column.width(); ++i) {
        text += separator;
        text += column.names.at(i);
        separator = ",";
      }
    }
    text += '\n';
  }

  void append(std::span<const Sample> samples) override {
    printer_.take(samples);
    std::string& text = writer_->text();
    for (std::size_t row = 0; row < samples.size(); ++row) {
      for (const TextColumn* column : columns_)
        for (std::size_t i = 0; i < column->width(); ++i) {
          if (column != columns_.front()) text += ',';
          printer_.append(text, row, *column, i);
        }
      text += '\n';
      writer_->save();
    }
  }

  void finish() override { writer_->commit(); }

 private:
  std::unique_ptr<TextWriter> writer_;
  SamplePrinter printer_;
  std::vector<const TextColumn*> columns_;  ///< time, of width 1, is the first
};

}  // namespace

std::unique_ptr<RecordingSource> open_csv(const std::string& file, const SourceOptions& options) {
  return std::make_unique<CsvSource>(file, options);
}

std::unique_ptr<RecordingSink> create_csv(const std::string& file, const RecordingHeader& header,
                                          const RecordingColumns& columns, const std::vector<StoredEvent>& events,
                                          const SinkOptions& options) {
  return std::make_unique<CsvSink>(file, header, columns, events, options);
}

}  // namespace haptrace
