#include "formats/path/csv_names.h"

#include "base/text_file.h"
#include "formats/convert/sample_text.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <fmt/format.h>
#include <optional>
#include <span>

namespace haptrace {
namespace {

using Words = std::vector<std::string>;

struct QuantityWord {
  std::string_view word, column;
};
constexpr auto kQuantityWords = std::to_array<QuantityWord>({
    {"p", "position"},
    {"pos", "position"},
    {"position", "position"},
    {"positions", "position"},
    {"loc", "position"},
    {"location", "position"},
    {"coord", "position"},
    {"coordinate", "position"},
    {"coordinates", "position"},
    {"translation", "position"},
    {"point", "position"},
    {"v", "velocity"},
    {"vel", "velocity"},
    {"velocity", "velocity"},
    {"velocities", "velocity"},
    {"speed", "velocity"},
    {"linear", "velocity"},
    {"geschwindigkeit", "velocity"},
    {"f", "force"},
    {"force", "force"},
    {"forces", "force"},
    {"kraft", "force"},
    {"q", "orientation"},
    {"quat", "orientation"},
    {"quaternion", "orientation"},
    {"orientation", "orientation"},
    {"rotation", "orientation"},
    {"rot", "orientation"},
    {"torque", "torque"},
    {"moment", "torque"},
    {"tau", "torque"},
    {"drehmoment", "torque"},
});

/// Words for the hand or tool itself, as opposed to its target.
constexpr auto kPlaceWords = std::to_array<std::string_view>(
    {"hand", "tool", "tip", "tcp", "ee", "end", "effector", "endeffector", "stylus", "handle", "pen", "probe", "actual",
     "current", "measured", "robot", "device", "haptic", "wrist"});
/// Words for things that are not measured, or are not vectors of these quantities.
constexpr auto kOtherThings = std::to_array<std::string_view>(
    {"target", "desired", "reference", "ref",        "setpoint", "commanded", "cmd",          "goal",
     "error",  "err",     "angular",   "covariance", "std",      "var",       "acceleration", "acc",
     "accel",  "gyro",    "delta",     "reaction",   "response", "duration"});
constexpr auto kTimeWords = std::to_array<std::string_view>({"t", "time", "times", "timestamp", "timestamps", "elapsed",
                                                             "elapsedtime", "datetime", "unixtime", "epoch", "zeit",
                                                             "zeitstempel", "temps", "tiempo", "stamp"});

template <class Range>
bool holds(const Range& range, std::string_view word) {
  return std::find(std::begin(range), std::end(range), word) != std::end(range);
}

/// Splits a name: "HandPosX", "hand_pos_x" and "hand.pos.X" are hand, pos, x.
Words words_in(std::string_view name) {
  Words words;
  bool apart = true, lower_before = false;
  for (const char each : name) {
    const auto c = static_cast<unsigned char>(each);
    const bool letter = std::isalnum(c) != 0 || c >= 0x80;
    const bool upper = std::isupper(c) != 0;
    if (letter && (apart || (upper && lower_before))) words.emplace_back();
    if (letter) words.back() += each;
    apart = !letter;
    lower_before = letter && !upper;
  }
  for (std::string& word : words) word = lower_case(word);
  return words;
}

std::string joined(std::span<const std::string> words, std::string_view between = "") {
  return fmt::format("{}", fmt::join(words, between));
}

std::string_view quantity_of(std::string_view word) {
  const auto* const found = std::find_if(kQuantityWords.begin(), kQuantityWords.end(),
                                         [&](const QuantityWord& each) { return each.word == word; });
  return found == kQuantityWords.end() ? std::string_view() : found->column;
}

/// Returns the cell of a column's component along an axis; kUnknown if the column has no such axis.
std::size_t cell_of(std::string_view column, std::string_view axis) {
  const TextColumn& of = text_columns()[text_column(column)];
  if (column == "orientation") {
    constexpr std::string_view kAxes = "wxyz";
    const std::size_t at = axis.size() == 1 ? kAxes.find(axis) : std::string_view::npos;
    return at == std::string_view::npos ? CsvName::kUnknown : of.first + at;
  }
  for (const std::string_view axes : {"xyz", "123"})
    if (const std::size_t at = axis.size() == 1 ? axes.find(axis) : std::string_view::npos;
        at != std::string_view::npos)
      return of.first + at;
  return CsvName::kUnknown;
}

CsvName axis_of(std::string_view column, std::string_view axis, std::span<const std::string> other, int rank) {
  if (column.empty() || std::any_of(other.begin(), other.end(), [](const auto& w) { return holds(kOtherThings, w); }))
    return {};
  CsvName result;
  result.cell = cell_of(column, axis);
  result.rank = other.empty() ? rank : std::max(rank, 2);
  result.group = std::string(column) + '/' + joined(other, " ") + (std::isdigit(axis.front()) != 0 ? "/number" : "");
  return result;
}

CsvName read_time(std::span<const std::string> words) {
  CsvName result;
  const auto is = [&](int rank, bool date = false) {
    result.cell = 0;
    result.rank = rank;
    result.date = date;
    return result;
  };
  const std::string all = joined(words);
  if (holds(kTimeWords, all)) return is(1);
  if (all == "date" || all == "datum") return is(3, true);
  if (std::any_of(words.begin(), words.end(), [](const auto& w) { return holds(kOtherThings, w); })) return result;
  if (words.size() < 2) return result;
  for (const std::string_view word : {"time", "timestamp", "stamp", "zeit"}) {
    if (words.back() == word) return is(2);
    if (words.front() == word && words.back().size() > 1) return is(3);
  }
  return result;
}

/// Interprets a name without its unit.
CsvName read_words(std::span<const std::string> words) {
  if (words.empty()) return {};
  if (CsvName time = read_time(words); time.cell != CsvName::kUnknown) return time;
  const std::string& last = words.back();
  const auto before = words.first(words.size() - 1);

  if (last.size() == 1) {  // pos x, field.pose.position.x, x
    if (before.empty()) return last == "w" ? CsvName{} : axis_of("position", last, {}, 1);
    if (const auto column = quantity_of(before.back()); !column.empty())
      return axis_of(column, last, before.first(before.size() - 1), 1);
    if (std::isalpha(static_cast<unsigned char>(last.front())) != 0 &&
        std::all_of(before.begin(), before.end(), [](const std::string& w) { return holds(kPlaceWords, w); }))
      return axis_of("position", last, before, 3);
  } else if (std::isalpha(static_cast<unsigned char>(last.back())) != 0) {  // posx
    if (CsvName fused = axis_of(quantity_of(std::string_view(last).substr(0, last.size() - 1)),
                                std::string_view(last).substr(last.size() - 1), before, 1);
        fused.cell != CsvName::kUnknown)
      return fused;
  }
  // x pos
  if (words.size() > 1 && words.front().size() == 1 && std::isalpha(static_cast<unsigned char>(words[0][0])) != 0)
    return axis_of(quantity_of(last), words.front(), words.subspan(1, words.size() - 2), 1);
  return {};
}

}  // namespace

const std::vector<std::string_view>& cell_names() {
  static const std::vector<std::string_view> names = [] {
    std::vector<std::string_view> all;
    for (const TextColumn& column : text_columns())
      all.insert(all.end(), column.names.begin(), column.names.begin() + static_cast<std::ptrdiff_t>(column.width()));
    return all;
  }();
  return names;
}

std::string_view si_of_cell(std::size_t cell) {
  for (const TextColumn& column : text_columns())
    if (cell >= column.first && cell < column.first + column.width()) return column.column->units;
  return {};
}

namespace {

/// Returns the column of a name in lower case that haptrace itself writes.
std::optional<CsvName> own_name(std::string_view low) {
  const auto& own = cell_names();
  const auto at = std::find(own.begin(), own.end(), low);
  if (at == own.end()) return std::nullopt;
  CsvName result;
  result.cell = static_cast<std::size_t>(at - own.begin());
  const auto columns = text_columns();
  const auto of = std::find_if(columns.begin(), columns.end(),
                               [&](const TextColumn& column) { return result.cell < column.first + column.width(); });
  result.group = std::string(of->column->name) + '/';
  return result;
}

/// A text in brackets, which is a unit, or other words.
struct Bracketed {
  std::string text;     ///< empty: there is none
  bool square = false;  ///< the name has a [
};

/// Takes the first pair of brackets out of a name.
Bracketed take_brackets(std::string& name) {
  Bracketed result;
  const std::size_t open = name.find_first_of("([{");
  if (open == std::string::npos) return result;
  result.square = name[open] == '[';
  const std::size_t close = name.find(name[open] == '(' ? ')' : name[open] == '[' ? ']' : '}', open);
  if (close == std::string::npos) return result;
  result.text = std::string(trim(std::string_view(name).substr(open + 1, close - open - 1)));
  name.replace(open, close - open + 1, " ");
  return result;
}

/// Interprets words with a text in brackets. Returns none if this text is further words.
std::optional<CsvName> read_with_brackets(const Words& words, const Bracketed& brackets) {
  CsvName result = read_words(words);
  if (result.cell == CsvName::kUnknown) return result;
  result.unit = find_unit(brackets.text, si_of_cell(result.cell));
  if (result.unit != nullptr || brackets.text == "-" || brackets.text == "1") return result;
  if (!brackets.square || std::isdigit(static_cast<unsigned char>(brackets.text.front())) != 0) return std::nullopt;
  result.unknown_unit = brackets.text;
  return result;
}

/// Interprets words that end in a unit: vx_mm_s, x_mm.
std::optional<CsvName> read_with_unit_at_end(std::span<const std::string> words) {
  for (const std::size_t of_unit : {2U, 1U}) {
    if (words.size() <= of_unit) continue;
    const std::string unit = joined(words.last(of_unit), "/");
    if (unit == "in" || unit == "min") continue;  // usually words
    CsvName result = read_words(words.first(words.size() - of_unit));
    if (result.cell == CsvName::kUnknown) continue;
    result.unit = find_unit(unit, si_of_cell(result.cell));
    if (result.unit != nullptr) return result;
  }
  return std::nullopt;
}

/// Interprets a name that is only a unit of time, as "seconds".
std::optional<CsvName> read_unit_of_time(std::span<const std::string> words) {
  if (words.size() != 1 || words[0].size() <= 1 || words[0] == "min") return std::nullopt;
  const Unit* const unit = find_unit(words[0], "s");
  if (unit == nullptr) return std::nullopt;
  CsvName result;
  result.cell = 0;
  result.rank = 2;
  result.unit = unit;
  return result;
}

}  // namespace

CsvName read_csv_name(std::string_view name, bool own_only) {
  if (const std::optional<CsvName> own = own_name(lower_case(trim(name)))) return *own;
  if (own_only) return {};
  std::string text(name);
  const Bracketed brackets = take_brackets(text);
  Words words = words_in(text);
  constexpr std::size_t kMostWords = 12;
  if (words.empty() || words.size() > kMostWords) return {};
  if (!brackets.text.empty()) {
    if (const std::optional<CsvName> found = read_with_brackets(words, brackets)) return *found;
    // "x (left)" is another column than "x (right)".
    const Words more = words_in(brackets.text);
    words.insert(words.begin(), more.begin(), more.end());
    if (words.size() > kMostWords) return {};
  }
  if (const std::optional<CsvName> found = read_with_unit_at_end(words)) return *found;
  if (const std::optional<CsvName> found = read_unit_of_time(words)) return *found;
  return read_words(words);
}

}  // namespace haptrace
