#include "studies/trade/budget.h"

#include "base/error.h"
#include "base/number.h"
#include "base/suggest.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <fmt/format.h>
#include <limits>

namespace haptrace {
namespace {

std::string trimmed(std::string_view text) {
  while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
  while (!text.empty() && text.back() == ' ') text.remove_suffix(1);
  return std::string(text);
}

struct UnitOfBudget {
  const char* name;
  const char* base;  ///< whose multiple it is
  double scale;
};
constexpr std::array kUnits{
    UnitOfBudget{"m", "m", 1},      UnitOfBudget{"mm", "m", 1e-3},  UnitOfBudget{"um", "m", 1e-6},
    UnitOfBudget{"µm", "m", 1e-6},  UnitOfBudget{"N", "N", 1},      UnitOfBudget{"mN", "N", 1e-3},
    UnitOfBudget{"s", "s", 1},      UnitOfBudget{"ms", "s", 1e-3},  UnitOfBudget{"us", "s", 1e-6},
    UnitOfBudget{"µs", "s", 1e-6},  UnitOfBudget{"ns", "s", 1e-9},  UnitOfBudget{"MIPS", "MIPS", 1e6},
    UnitOfBudget{"MB/h", "B", 1e6}, UnitOfBudget{"GB/h", "B", 1e9}, UnitOfBudget{"", "", 1}};

/// The base of the unit in which people are told a measure.
std::string base_unit(const MeasureFacts& facts) {
  for (const UnitOfBudget& unit : kUnits)
    if (facts.unit == std::string_view(unit.name)) return unit.base;
  return "";
}

Bound parse_bound(const std::string& text) {
  const auto wrong = [&](const std::string& why) { return input_error(fmt::format("--budget: '{}': {}", text, why)); };
  const std::size_t sign = text.find_first_of("<>");
  if (sign == std::string::npos || sign + 1 >= text.size() || text[sign + 1] != '=')
    throw wrong("a bound is a measure, <= or >=, and a number, as in error<=0.1mm");
  const std::string name = trimmed(std::string_view(text).substr(0, sign));
  std::vector<std::string> known;
  for (const MeasureFacts& facts : measures()) known.emplace_back(facts.name);
  const auto found = std::find(known.begin(), known.end(), name);
  if (found == known.end())
    throw wrong(
        fmt::format("unknown measure '{}'{}; known: {}", name, suggestion(name, known), fmt::join(known, ", ")));
  const MeasureFacts& facts = measures()[static_cast<std::size_t>(found - known.begin())];
  if ((text[sign] == '<') != facts.at_most)
    throw wrong(fmt::format("{} is bounded by {}", name, facts.at_most ? "<=" : ">="));

  const std::string rest = trimmed(std::string_view(text).substr(sign + 2));
  std::string_view end = rest;
  const auto number = take_number<double>(end);
  if (!number || !std::isfinite(*number) || *number <= 0) throw wrong("its limit is a positive number");
  const std::string unit = trimmed(end);
  const std::string base = base_unit(facts);
  std::vector<std::string> possible;
  for (const UnitOfBudget& candidate : kUnits) {
    if (candidate.base != base) continue;
    if (unit == candidate.name) return {facts.measure, *number * candidate.scale};
    possible.emplace_back(candidate.name);
  }
  throw wrong(
      fmt::format("its unit is {}", base.empty() ? "none" : fmt::format("one of {}", fmt::join(possible, ", "))));
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
    const std::string part = trimmed(text.substr(begin, comma - begin));
    if (part.empty()) throw input_error(fmt::format("--budget '{}': a bound is missing", text));
    const Bound bound = parse_bound(part);
    if (budget.limits(bound.measure))
      throw input_error(fmt::format("--budget '{}': {} is bounded twice", text, facts_of(bound.measure).name));
    budget.bounds.push_back(bound);
    begin = comma + 1;
  }
  return budget;
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
