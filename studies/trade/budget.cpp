#include "studies/trade/budget.h"

#include "base/error.h"
#include "base/number.h"
#include "base/suggest.h"
#include "base/text_file.h"
#include "base/units.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <fmt/format.h>
#include <limits>

namespace haptrace {
namespace {

/// How many of SI, of instructions a second or of bytes an hour a unit is; nothing when it does not measure the
/// quantity that is shown in `shown`.
std::optional<double> factor_of(std::string_view unit, std::string_view shown) {
  if (unit == "GB/h" && shown == "MB/h") return 1e9;
  if (shown == "MIPS" || shown == "MB/h" || shown.empty())
    return unit != shown ? std::nullopt : std::optional(shown.empty() ? 1 : 1e6);
  const Unit* other = find_unit(shown, "");
  const Unit* named = other != nullptr ? find_unit(unit, other->si) : nullptr;
  return named != nullptr ? std::optional(1 / named->per_si) : std::nullopt;
}

Bound parse_bound(const std::string& text) {
  const auto wrong = [&](const std::string& why) { return input_error(fmt::format("--budget: '{}': {}", text, why)); };
  const std::size_t sign = text.find_first_of("<>");
  if (sign == std::string::npos || sign + 1 >= text.size() || text[sign + 1] != '=')
    throw wrong("a bound is a measure, <= or >=, and a number, as in error<=0.1mm");
  const std::string name(trim(std::string_view(text).substr(0, sign)));
  std::vector<std::string> known;
  for (const MeasureFacts& facts : measures()) known.emplace_back(facts.name);
  const auto found = std::find(known.begin(), known.end(), name);
  if (found == known.end()) throw wrong(fmt::format("unknown measure '{}'{}", name, suggestion(name, known)));
  const MeasureFacts& facts = measures()[static_cast<std::size_t>(found - known.begin())];
  if ((text[sign] == '<') != facts.at_most)
    throw wrong(fmt::format("{} is bounded by {}", name, facts.at_most ? "<=" : ">="));

  std::string_view end = trim(std::string_view(text).substr(sign + 2));
  const auto number = take_number<double>(end);
  if (!number || !std::isfinite(*number) || *number <= 0) throw wrong("its limit must be a positive number");
  const std::string_view shown = facts.unit;
  const std::optional<double> factor = factor_of(trim(end), shown);
  if (!factor)
    throw wrong(shown.empty() ? "it has no unit"
                              : fmt::format("write its unit, as in {}{}1{}", name, facts.at_most ? "<=" : ">=", shown));
  return {facts.measure, *number * *factor};
}

}  // namespace

double Bound::ratio(const Outcome& outcome) const {
  const double value = value_of(outcome, measure);
  if (!std::isfinite(value)) return std::numeric_limits<double>::infinity();
  if (facts_of(measure).at_most) return value / limit;
  return value > 0 ? limit / value : std::numeric_limits<double>::infinity();
}

bool Budget::bounds_accuracy() const {
  return std::any_of(bounds.begin(), bounds.end(), [](const Bound& b) { return facts_of(b.measure).accuracy; });
}

bool Budget::limits(Measure measure) const {
  return std::any_of(bounds.begin(), bounds.end(), [&](const Bound& b) { return b.measure == measure; });
}

std::optional<Budget::Tightest> Budget::tightest(const Outcome& outcome) const {
  std::optional<Tightest> tightest;
  for (const Bound& bound : bounds)
    if (const double ratio = bound.ratio(outcome); !tightest || ratio > tightest->ratio) tightest = {&bound, ratio};
  return tightest;
}

bool Budget::kept(const Outcome& outcome) const {
  const auto worst = tightest(outcome);
  return outcome.ran() && (!worst || worst->ratio <= 1);
}

Budget parse_budget(std::string_view text) {
  Budget budget;
  std::size_t begin = 0;
  while (begin <= text.size()) {
    const std::size_t comma = std::min(text.find(',', begin), text.size());
    const std::string part(trim(text.substr(begin, comma - begin)));
    if (part.empty()) throw input_error(fmt::format("--budget '{}': a bound is missing", text));
    const Bound bound = parse_bound(part);
    if (budget.limits(bound.measure))
      throw input_error(fmt::format("--budget '{}': {} is bounded twice", text, facts_of(bound.measure).name));
    budget.bounds.push_back(bound);
    begin = comma + 1;
  }
  return budget;
}

void check_counted(const Budget& budget) {
  for (const Measure measure : {Measure::instructions, Measure::load})
    if (budget.limits(measure))
      throw input_error(fmt::format(
          "--budget: {} is bounded, but no instructions are counted here; bound `tick`, which is a time, or count "
          "instructions: leave out --no-instructions, on a system that lets a process trace its child",
          facts_of(measure).name));
}

std::string to_string(const Bound& bound) {
  const MeasureFacts& facts = facts_of(bound.measure);
  return fmt::format("{}{}{:g}{}", facts.name, facts.at_most ? "<=" : ">=", bound.limit / facts.scale, facts.unit);
}

std::string to_string(const Budget& budget) {
  std::string text;
  for (const Bound& bound : budget.bounds) text += (text.empty() ? "" : ", ") + to_string(bound);
  return text;
}

}  // namespace haptrace
