// Axes of figures and charts: ranges, round ticks and their labels.
#pragma once

#include <cstddef>
#include <limits>
#include <string>
#include <vector>

namespace haptrace {

/// A range of values; empty until one is included.
struct Range {
  double low = std::numeric_limits<double>::infinity(), high = -std::numeric_limits<double>::infinity();

  /// Widens the range to a value; one that is not finite changes nothing.
  void include(double v);
  [[nodiscard]] bool empty() const { return !(low <= high); }
  [[nodiscard]] double size() const { return high - low; }
  [[nodiscard]] double center() const { return low + 0.5 * size(); }

  /// Returns the range widened by a fraction of its size per side. A constant gets room around it.
  [[nodiscard]] Range padded(double fraction) const;
};

/// Labelled ticks of one axis: values divided by 10^exponent, with as many decimals as their step has.
struct Axis {
  Range range;
  std::vector<double> ticks;
  std::vector<std::string> labels;
  int exponent = 0;
};

/// Returns round numbers (1, 2 or 5 times a power of ten apart) within [low, high]: at most `most`, and at least two
/// when `most` allows it. Returns none unless low < high.
std::vector<double> tick_values(double low, double high, std::size_t most);

/// Makes the axis of a range with at most `most` ticks. If `log` is set, the range and the ticks are decimal
/// logarithms.
Axis make_axis(const Range& range, std::size_t most, bool log);

/// Returns the label of an axis with its power of ten, if it has one: "force [N]   x10^3" with signs of its own.
std::string with_exponent(const std::string& label, const Axis& axis);

}  // namespace haptrace
