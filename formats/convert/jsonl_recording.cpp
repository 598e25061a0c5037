// Recordings as JSON lines: one object for the header, and one for every event, clock reading and sample.
#include "base/error.h"
#include "base/json_reader.h"
#include "base/suggest.h"
#include "base/text_file.h"
#include "formats/convert/sample_text.h"
#include "formats/recording/recording_formats.h"
#include "formats/recording/recording_layout.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

using nlohmann::json;

class JsonlSource final : public RecordingSource {
 public:
  JsonlSource(const std::string& file, const SourceOptions& options)
      : any_order_(options.any_order), lines_(file, "JSON lines"), unknown_(unknown_cells()) {
    json first = next_line();
    if (!first.is_object() || first.value("format", json()) != layout::kFormat)
      throw input_error(
          fmt::format(R"({}: the first line must be the header, {{"format":"{}",...}})", file, layout::kFormat));
    header_ = header_from_json(first, place());
    read_columns(first.value("columns", json::array()));
    for (sample_ = next_line(); sample_.is_object(); sample_ = next_line()) {
      if (sample_.contains("event"))
        events_.push_back(event_from_json(sample_["event"], place() + ": event"));
      else if (sample_.contains("clock"))
        clocks_.push_back(clock_from_json(sample_["clock"], place() + ": clock"));
      else
        break;
    }
  }

  [[nodiscard]] const RecordingHeader& header() const override { return header_; }
  [[nodiscard]] const RecordingColumns& columns() const override { return columns_; }
  [[nodiscard]] std::vector<StoredEvent> events() const override { return events_; }
  [[nodiscard]] std::vector<ClockReading> clocks() const override { return clocks_; }
  [[nodiscard]] double fraction() const override { return lines_.fraction(); }

  std::span<const Sample> next() override {
    const auto refuse = [&](const TextColumn& column, std::size_t, const std::string& what) {
      throw lines_.error(fmt::format("{}: {}", column.column->name, what));
    };
    for (; !sample_.is_null() && parser_.rows() < kSourceBlock; sample_ = next_line()) {
      read_sample(sample_);
      parser_.add(cells_, refuse);
    }
    const std::span<const Sample> samples = parser_.take();
    if (!any_order_) check_order(samples, before_, lines_.file());
    return samples;
  }

  [[nodiscard]] std::vector<std::string> notes() const override {
    if (header_.complete) return {};
    return {"the recording was not finished; the samples in the file were read"};
  }

 private:
  [[nodiscard]] std::string place() const { return fmt::format("{}:{}", lines_.file(), lines_.number()); }

  /// Returns the next line that is not blank; null at the end.
  json next_line() {
    std::string_view line;
    while (lines_.next(line))
      if (!trim(line).empty()) return parse_json(std::string(line), place());
    return {};
  }

  void read_columns(const json& names) {
    for (const json& name : names)
      for (const layout::Column& column : layout::columns())
        if (name == column.name && column.option != nullptr) columns_.*column.option = true;
  }

  void read_sample(const json& object) {
    if (!object.is_object()) throw lines_.error("a sample must be a JSON object");
    for (const char* kind : {"event", "clock"})
      if (object.contains(kind))
        throw lines_.error(fmt::format("{}s must come after the header and before the samples", kind));
    cells_ = unknown_;
    for (const auto& item : object.items()) {
      const std::string& key = item.key();
      const auto column = std::find_if(text_columns().begin(), text_columns().end(),
                                       [&](const auto& c) { return c.column->name == key; });
      if (column == text_columns().end()) {
        std::vector<std::string> known;
        for (const TextColumn& each : text_columns()) known.emplace_back(each.column->name);
        throw lines_.error(fmt::format("'{}' is not a column{}", key, suggestion(key, known)));
      }
      read_column(*column, item.value());
    }
    if (!(std::abs(cells_[0]) < layout::kLongestTime))
      throw lines_.error("time is missing or is not a time in seconds");
    if (!object.contains("tick")) cells_[tick_] = static_cast<double>(rows_);
    if (!object.contains("phase")) cells_[phase_] = static_cast<double>(Phase::run);
    ++rows_;
  }

  void read_column(const TextColumn& column, const json& value) {
    if (value.is_null()) return;
    if (column.width() > 1 && (!value.is_array() || value.size() != column.width()))
      throw lines_.error(fmt::format("{} must be an array of {} numbers", column.column->name, column.width()));
    for (std::size_t i = 0; i < column.width(); ++i)
      cells_[column.first + i] = number(column, column.width() > 1 ? value[i] : value);
  }

  [[nodiscard]] double number(const TextColumn& column, const json& value) const {
    if (value.is_null()) return kNaN;
    if (value.is_number()) return value.get<double>();
    if (value == "inf") return std::numeric_limits<double>::infinity();
    if (value == "-inf") return -std::numeric_limits<double>::infinity();
    throw lines_.error(fmt::format("{}: '{}' is not a number", column.column->name, shown(dump(value))));
  }

  bool any_order_;
  std::size_t tick_ = text_columns()[text_column("tick")].first, phase_ = text_columns()[text_column("phase")].first;
  std::uint64_t rows_ = 0;
  LineReader lines_;
  RecordingHeader header_;
  RecordingColumns columns_;
  std::vector<StoredEvent> events_;
  std::vector<ClockReading> clocks_;
  json sample_;  ///< next sample; null at the end
  SampleParser parser_;
  std::vector<double> cells_, unknown_;
  std::optional<Sample> before_;
};

class JsonlSink final : public RecordingSink {
 public:
  JsonlSink(const std::string& file, const RecordingHeader& header, const RecordingColumns& columns,
            const std::vector<StoredEvent>& events, const SinkOptions& options)
      : writer_(file, options.overwrite), printer_("null", options.digits) {
    json first = json_of(header);
    first["format"] = layout::kFormat;
    first["columns"] = json_of(columns);
    std::string& text = writer_.text();
    text = dump(first) + '\n';
    for (const StoredEvent& event : events) text += dump({{"event", json_of(event)}}) + '\n';
    for (const ClockReading& reading : options.clocks) text += dump({{"clock", json_of(reading)}}) + '\n';
    for (const TextColumn& column : text_columns())
      if (column.column->in(columns)) columns_.push_back(&column);
  }

  void append(std::span<const Sample> samples) override {
    printer_.take(samples);
    std::string& text = writer_.text();
    for (std::size_t row = 0; row < samples.size(); ++row) {
      char separator = '{';
      for (const TextColumn* column : columns_) {
        text += separator;
        separator = ',';
        fmt::format_to(std::back_inserter(text), "\"{}\":", column->column->name);
        append_value(row, *column);
      }
      text += "}\n";
      writer_.save();
    }
  }

  void finish() override { writer_.commit(); }

 private:
  void append_value(std::size_t row, const TextColumn& column) {
    std::string& text = writer_.text();
    if (printer_.all_nan(row, column)) {
      text += "null";
      return;
    }
    char separator = '[';
    for (std::size_t i = 0; i < column.width(); ++i) {
      if (column.width() > 1) text += separator;
      separator = ',';
      const std::size_t begin = text.size();
      printer_.append(text, row, column, i);
      const std::string_view number = std::string_view(text).substr(begin);
      if (number == "-0") {  // JSON readers take it for an integer, which has no negative zero
        text += ".0";
      } else if (number.ends_with("inf")) {  // JSON has no infinity
        text.insert(begin, 1, '"');
        text += '"';
      }
    }
    if (column.width() > 1) text += ']';
  }

  TextWriter writer_;
  SamplePrinter printer_;
  std::vector<const TextColumn*> columns_;
};

}  // namespace

std::unique_ptr<RecordingSource> open_jsonl(const std::string& file, const SourceOptions& options) {
  return std::make_unique<JsonlSource>(file, options);
}

std::unique_ptr<RecordingSink> create_jsonl(const std::string& file, const RecordingHeader& header,
                                            const RecordingColumns& columns, const std::vector<StoredEvent>& events,
                                            const SinkOptions& options) {
  return std::make_unique<JsonlSink>(file, header, columns, events, options);
}

}  // namespace haptrace
