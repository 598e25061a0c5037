// How a figure changes over repetitions: learning curves and the straight line.
#pragma once

#include <limits>
#include <optional>
#include <span>

namespace haptrace {

/// The law that a learning curve follows; n = 1, 2, ... counts repetitions.
enum class LearningLaw {
  power,        ///< e(n) = plateau + (first - plateau) n^-rate                 (Newell and Rosenbloom 1981)
  exponential,  ///< e(n) = plateau + (first - plateau) exp(-rate (n - 1))      (Heathcote, Brown, Mewhort 2000)
};

struct LearningCurve {
  LearningLaw law = LearningLaw::power;
  double first = 0;      ///< e(1), in the unit of the figure
  double plateau = 0;    ///< e(infinity)
  double rate = 0;       ///< no unit, or per repetition
  double r_squared = 0;  ///< share of the variance that the curve explains

  [[nodiscard]] double at(double n) const;
};

struct LearningBounds {
  /// Below which neither `first` nor `plateau` can be: 0 for an error. A figure such as SPARC has no such bound.
  double least = 0;
  double slowest = 1e-2, fastest = 10;  ///< rate
};

/// The curve through a figure of repetitions 1, 2, ..., least squares within the bounds: for a given rate, first and
/// plateau are a linear problem of two unknowns; the rate that leaves least is looked for on a grid and then between
/// its points (variable projection, Golub and Pereyra 1973). Figures that fall and figures that rise.
///
/// NaN is a repetition that was not measured; it keeps its number. Undefined for fewer than 4 measured repetitions, and
/// when all are equal. Of four points, three parameters leave little to judge by: read r_squared with that in mind.
/// Throws Error(input) when the bounds are not in order.
///
/// Threads: free functions without state.
std::optional<LearningCurve> fit_learning_curve(std::span<const double> figure, LearningLaw law,
                                                const LearningBounds& bounds = {});

/// A straight line over repetitions.
struct LearningTrend {
  double first = 0;             ///< of the line, at repetition 1
  double slope = 0;             ///< per repetition
  double slope_half_width = 0;  ///< of its 95 % interval, by Student's t with N - 2 degrees of freedom
  double r_squared = 0;         ///< 0 when all are equal
};

/// Ordinary least squares. NaN as above; undefined for fewer than 4 measured repetitions.
std::optional<LearningTrend> fit_trend(std::span<const double> figure);

}  // namespace haptrace
