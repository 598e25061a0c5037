#include "formats/convert/sample_text.h"

#include "base/error.h"
#include "base/json_reader.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fmt/format.h>

namespace haptrace {
namespace {

using layout::Element;

std::vector<TextColumn> make_text_columns() {
  struct Named {
    std::string_view column;
    decltype(TextColumn::names) names;
  };
  constexpr Named kNamed[] = {{"time", {"t"}},
                              {"position", {"x", "y", "z"}},
                              {"velocity", {"vx", "vy", "vz"}},
                              {"force", {"fx", "fy", "fz"}},
                              {"orientation", {"qw", "qx", "qy", "qz"}},
                              {"torque", {"tx", "ty", "tz"}},
                              {"force_measured", {"mx", "my", "mz"}},
                              {"support", {"sx", "sy", "sz"}},
                              {"reference_position", {"rx", "ry", "rz"}},
                              {"reference_velocity", {"rvx", "rvy", "rvz"}},
                              {"reference_orientation", {"rqw", "rqx", "rqy", "rqz"}},
                              {"reference_force", {"rfx", "rfy", "rfz"}},
                              {"progress", {"progress"}},
                              {"tunnel_radius", {"tunnel_radius"}},
                              {"gains", {"kpx", "kpy", "kpz", "kdx", "kdy", "kdz"}},
                              {"buttons", {"buttons"}},
                              {"phase", {"phase"}},
                              {"latency", {"latency"}},
                              {"tick", {"tick"}}};
  std::vector<TextColumn> columns;
  std::size_t first = 0;
  for (const Named& named : kNamed) {
    const auto all = layout::columns();
    const auto found = std::find_if(all.begin(), all.end(), [&](const auto& c) { return c.name == named.column; });
    columns.push_back({&*found, named.names, first});
    first += found->width;
  }
  return columns;
}

/// Returns the largest integer of an element type that a double holds exactly.
double largest(Element element) {
  if (element == Element::uint64) return 9007199254740992.0;  // 2^53
  return element == Element::uint32 ? 4294967295.0 : 255.0;
}

template <class Value>
Value load(const std::byte* bytes) {
  Value value;
  std::memcpy(&value, bytes, sizeof value);
  return value;
}

double number_of(Element element, const std::byte* bytes) {
  switch (element) {
    case Element::float64:
      return load<double>(bytes);
    case Element::float32:
      return static_cast<double>(load<float>(bytes));
    case Element::uint64:
      return static_cast<double>(load<std::uint64_t>(bytes));
    case Element::uint32:
      return load<std::uint32_t>(bytes);
    case Element::uint8:
      return load<std::uint8_t>(bytes);
  }
  return kNaN;
}

template <class Value>
void push(std::vector<std::byte>& bytes, Value value) {
  const auto* begin = reinterpret_cast<const std::byte*>(&value);
  bytes.insert(bytes.end(), begin, begin + sizeof value);
}

/// Appends a time in seconds: 12.003 for 12 003 000 000 ns.
void append_time(std::string& text, std::int64_t ns) {
  constexpr std::uint64_t kSecond = 1'000'000'000;
  const std::uint64_t magnitude = ns < 0 ? 0 - static_cast<std::uint64_t>(ns) : static_cast<std::uint64_t>(ns);
  fmt::format_to(std::back_inserter(text), "{}{}", ns < 0 ? "-" : "", magnitude / kSecond);
  if (magnitude % kSecond == 0) return;
  fmt::format_to(std::back_inserter(text), ".{:09}", magnitude % kSecond);
  text.erase(text.find_last_not_of('0') + 1);
}

}  // namespace

std::span<const TextColumn> text_columns() {
  static const std::vector<TextColumn> columns = make_text_columns();
  return columns;
}

std::size_t text_column(std::string_view name) {
  const auto columns = text_columns();
  return static_cast<std::size_t>(
      std::find_if(columns.begin(), columns.end(), [&](const TextColumn& c) { return c.column->name == name; }) -
      columns.begin());
}

std::size_t cell_count() {
  return text_columns().back().first + text_columns().back().width();
}

std::vector<double> unknown_cells() {
  std::vector<double> cells(cell_count(), 0);
  for (const TextColumn& column : text_columns())
    if (column.column->element == Element::float64)
      std::fill_n(cells.begin() + static_cast<std::ptrdiff_t>(column.first), column.width(), kNaN);
  return cells;
}

void SamplePrinter::take(std::span<const Sample> samples) {
  samples_ = samples;
  packed_.resize(text_columns().size());
  for (std::size_t i = 0; i < packed_.size(); ++i) {
    const layout::Column& column = *text_columns()[i].column;
    packed_[i].resize(samples.size() * column.row_bytes());
    column.pack(samples, packed_[i].data());
  }
}

void SamplePrinter::append(std::string& text, std::size_t row, const TextColumn& column, std::size_t component) const {
  const auto index = static_cast<std::size_t>(&column - text_columns().data());
  if (index == 0) return append_time(text, samples_[row].time_ns);
  const Element element = column.column->element;
  const std::byte* cell =
      packed_[index].data() + row * column.column->row_bytes() + component * layout::size_of(element);
  if (element == Element::uint64) {
    fmt::format_to(std::back_inserter(text), "{}", load<std::uint64_t>(cell));
    return;
  }
  const double value = number_of(element, cell);
  if (std::isnan(value)) {
    text += none_;
  } else if (element == Element::float32) {
    // Nine digits identify every float, even if a reader parses them as a double first.
    fmt::format_to(std::back_inserter(text), "{:.9g}", value);
  } else if (element == Element::float64 && digits_ > 0) {
    fmt::format_to(std::back_inserter(text), "{:.{}g}", value, digits_);
  } else {
    fmt::format_to(std::back_inserter(text), "{}", value);
  }
}

bool SamplePrinter::all_nan(std::size_t row, const TextColumn& column) const {
  const auto index = static_cast<std::size_t>(&column - text_columns().data());
  for (std::size_t i = 0; i < column.width(); ++i)
    if (!std::isnan(number_of(column.column->element, packed_[index].data() + row * column.column->row_bytes() +
                                                          i * layout::size_of(column.column->element))))
      return false;
  return true;
}

void SampleParser::add(std::span<const double> cells,
                       const std::function<void(const TextColumn&, std::size_t, const std::string&)>& refuse) {
  packed_.resize(text_columns().size());
  for (std::size_t index = 0; index < packed_.size(); ++index) {
    const TextColumn& column = text_columns()[index];
    const Element element = column.column->element;
    std::vector<std::byte>& bytes = packed_[index];
    for (std::size_t i = 0; i < column.width(); ++i) {
      const double value = cells[column.first + i];
      if (!layout::is_float(element) && !(value >= 0 && value <= largest(element) && value == std::floor(value)))
        refuse(column, i, fmt::format("{} is not a whole number from 0 to {:.0f}", value, largest(element)));
      switch (element) {
        case Element::float64:
          push(bytes, value);
          break;
        case Element::float32:
          push(bytes, static_cast<float>(value));
          break;
        case Element::uint64:
          push(bytes, static_cast<std::uint64_t>(value));
          break;
        case Element::uint32:
          push(bytes, static_cast<std::uint32_t>(value));
          break;
        case Element::uint8:
          push(bytes, static_cast<std::uint8_t>(value));
          break;
      }
    }
  }
  ++rows_;
}

std::span<const Sample> SampleParser::take() {
  samples_.assign(rows_, Sample{});
  for (std::size_t index = 0; index < packed_.size(); ++index) {
    text_columns()[index].column->unpack(packed_[index].data(), samples_);
    packed_[index].clear();
  }
  rows_ = 0;
  return samples_;
}

nlohmann::json json_of(const RecordingHeader& header) {
  nlohmann::json json = nlohmann::json::object();
  for (const layout::Attribute& attribute : layout::attributes())
    if (!attribute.of_parts) std::visit([&](auto member) { json[attribute.name] = header.*member; }, attribute.member);
  if (!header.meta.empty()) json["meta"] = header.meta;
  return json;
}

nlohmann::json json_of(const RecordingColumns& columns) {
  nlohmann::json names = nlohmann::json::array();
  for (const layout::Column& column : layout::columns())
    if (column.in(columns)) names.push_back(column.name);
  return names;
}

nlohmann::json json_of(const ClockReading& reading) {
  return {{"time_ns", reading.time_ns},
          {"realtime_ns", reading.realtime_ns},
          {"monotonic_ns", reading.monotonic_ns},
          {"uncertainty_ns", reading.uncertainty_ns}};
}

nlohmann::json json_of(const StoredEvent& event) {
  return {{"time", event.time}, {"code", event.code}, {"text", event.text}};
}

RecordingHeader header_from_json(const nlohmann::json& json, const std::string& where) {
  RecordingHeader header;
  JsonReader reader(json, where);
  for (const layout::Attribute& attribute : layout::attributes()) {
    const std::string name = attribute.name;
    if (attribute.of_parts || !reader.has(name) || json[name].is_null()) continue;
    std::visit(
        [&](auto member) {
          auto& value = header.*member;
          using Value = std::remove_cvref_t<decltype(value)>;
          if constexpr (std::is_same_v<Value, std::string>)
            value = reader.text(name, value);
          else if constexpr (std::is_same_v<Value, bool>)
            value = reader.boolean(name, value);
          else if constexpr (std::is_same_v<Value, nlohmann::json>)
            value = json[name];
          else
            value = static_cast<Value>(reader.number(name, static_cast<double>(value)));
        },
        attribute.member);
  }
  if (auto meta = reader.object("meta"))
    for (const auto& [key, value] : json["meta"].items()) header.meta[key] = meta->text(key, "");
  return header;
}

ClockReading clock_from_json(const nlohmann::json& json, const std::string& where) {
  JsonReader reader(json, where);
  const auto nanoseconds = [&](const char* key) {
    const nlohmann::json value = reader.require(key).value(key);
    if (!value.is_number_integer()) throw input_error(fmt::format("{}: {}: must be a whole number", where, key));
    return value.get<std::int64_t>();  // a double cannot hold the nanoseconds since 1970
  };
  return {nanoseconds("time_ns"), nanoseconds("realtime_ns"), nanoseconds("monotonic_ns"),
          nanoseconds("uncertainty_ns")};
}

StoredEvent event_from_json(const nlohmann::json& json, const std::string& where) {
  JsonReader reader(json, where);
  StoredEvent event;
  event.time = reader.number("time", 0);
  event.code = static_cast<std::int32_t>(reader.number("code", 0, -2147483648.0, 2147483647.0));
  event.text = reader.text("text", "");
  return event;
}

std::string dump(const nlohmann::json& json) {
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

}  // namespace haptrace
