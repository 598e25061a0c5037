#include "plot/axis.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace haptrace {
namespace {

std::string superscript(int n) {
  constexpr std::array kDigits{"\u2070", "\u00b9", "\u00b2", "\u00b3", "\u2074",
                               "\u2075", "\u2076", "\u2077", "\u2078", "\u2079"};
  std::string text = n < 0 ? "\u207b" : "";
  for (const char c : std::to_string(std::abs(n))) text += kDigits[static_cast<std::size_t>(c - '0')];
  return text;
}

/// Makes the axis for a range of decimal logarithms: decades, and 2 and 5 times these if there is room.
Axis make_log_axis(const Range& range, std::size_t most) {
  constexpr double kBetween[] = {1, 2, 5};
  Axis axis{range, {}, {}, 0};
  const int first = static_cast<int>(std::floor(range.low)), last = static_cast<int>(std::ceil(range.high));
  const std::size_t decades = static_cast<std::size_t>(last - first) + 1;
  const bool all = 3 * decades <= most;
  const int step = static_cast<int>((decades + most - 1) / most);
  for (int decade = first; decade <= last; decade += all ? 1 : step)
    for (const double factor : kBetween) {
      const double tick = decade + std::log10(factor);
      if (tick < range.low - 1e-9 || tick > range.high + 1e-9 || (factor > 1 && !all)) continue;
      axis.ticks.push_back(tick);
      const std::string power = "10" + superscript(decade);
      axis.labels.push_back(decade > -4 && decade < 6 ? fmt::format("{:g}", factor * std::pow(10, decade))
                            : factor == 1             ? power
                                                      : fmt::format("{:g}\u00d7{}", factor, power));
    }
  return axis;
}

}  // namespace

void Range::include(double v) {
  if (!std::isfinite(v)) return;
  low = std::min(low, v);
  high = std::max(high, v);
}

Range Range::padded(double fraction) const {
  if (empty()) return {0, 1};
  const double largest = std::max(std::abs(low), std::abs(high));
  if (size() <= 1e-9 * largest || size() == 0) {
    const double room = largest > 0 ? 0.1 * largest : 1;
    return {low - room, high + room};
  }
  return {low - fraction * size(), high + fraction * size()};
}

std::vector<double> tick_values(double low, double high, std::size_t most) {
  if (!(low < high) || !std::isfinite(high - low) || most == 0) return {};
  const double decade = std::pow(10, std::floor(std::log10((high - low) / static_cast<double>(most))));
  for (const double step : {decade, 2 * decade, 5 * decade, 10 * decade, 20 * decade}) {
    const double first = std::ceil(low / step - 1e-9), last = std::floor(high / step + 1e-9);
    if (!(last - first < static_cast<double>(most))) continue;
    std::vector<double> values;
    for (double k = first; k <= last; ++k) values.push_back(k * step);
    return values;
  }
  return {};
}

Axis make_axis(const Range& range, std::size_t most, bool log) {
  if (log) return make_log_axis(range, most);
  Axis axis{range, tick_values(range.low, range.high, most), {}, 0};
  if (axis.ticks.empty()) return axis;
  const double largest = std::max(std::abs(axis.ticks.front()), std::abs(axis.ticks.back()));
  const double step = axis.ticks.size() > 1 ? axis.ticks[1] - axis.ticks[0] : range.size();
  if (largest >= 1e5 || largest < 1e-3)
    axis.exponent = static_cast<int>(std::floor(std::log10(largest > 0 ? largest : 1)));
  const double unit = std::pow(10, axis.exponent);
  const int decimals = std::clamp(static_cast<int>(-std::floor(std::log10(step / unit) + 1e-6)), 0, 12);
  for (const double v : axis.ticks) {
    std::string label = fmt::format("{:.{}f}", std::abs(v) < 1e-9 * step ? 0.0 : v / unit, decimals);
    if (label[0] == '-') label.replace(0, 1, "\u2212");  // a minus sign, as wide as a plus
    axis.labels.push_back(std::move(label));
  }
  return axis;
}

std::string with_exponent(const std::string& label, const Axis& axis) {
  if (axis.exponent == 0) return label;
  return fmt::format("{}{}\u00d710{}", label, label.empty() ? "" : "   ", superscript(axis.exponent));
}

}  // namespace haptrace
