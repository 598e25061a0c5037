// Changes of a metric over repetitions: learning curves and the straight line.
#pragma once

#include <limits>
#include <optional>
#include <span>

namespace haptrace {

/// The law of a learning curve; n = 1, 2, ... counts repetitions.
enum class LearningLaw {
  power,        ///< e(n) = plateau + (first - plateau) n^-rate                 (Newell and Rosenbloom 1981)
  exponential,  ///< e(n) = plateau + (first - plateau) exp(-rate (n - 1))      (Heathcote, Brown, Mewhort 2000)
};

struct LearningCurve {
  LearningLaw law = LearningLaw::power;
  double first = 0;      ///< e(1), in the unit of the metric
  double plateau = 0;    ///< e(infinity)
  double rate = 0;       ///< dimensionless, or per repetition
  double r_squared = 0;  ///< fraction of the variance that the curve explains

  [[nodiscard]] double at(double n) const;
};

struct LearningBounds {
  /// Lower bound of `first` and `plateau`: 0 for an error. A metric such as SPARC has none.
  double least = 0;
  double slowest = 1e-2, fastest = 10;  ///< bounds of the rate
};

/// Fits a curve to a metric of repetitions 1, 2, ... by least squares within the bounds. For a given rate, first and
/// plateau are a linear problem of two unknowns. The rate with the smallest residual is found on a grid and then
/// between its points (variable projection, Golub and Pereyra 1973). The metric may fall or rise.
///
/// NaN marks a repetition that was not measured; it keeps its number. Returns nothing for fewer than 4 measured
/// repetitions, and when all are equal. With four points for three parameters, r_squared says little. Throws
/// Error(input) when the bounds are not in order.
///
/// Threads: free functions without state.
std::optional<LearningCurve> fit_learning_curve(std::span<const double> figure, LearningLaw law,
                                                const LearningBounds& bounds = {});

/// A straight line over repetitions.
struct LearningTrend {
  double first = 0;             ///< value of the line at repetition 1
  double slope = 0;             ///< per repetition
  double slope_half_width = 0;  ///< half width of the 95 % confidence interval (Student's t, N - 2 degrees of freedom)
  double r_squared = 0;         ///< 0 when all are equal
};

/// Fits a straight line by ordinary least squares. NaN as above; returns nothing for fewer than 4 measured repetitions.
std::optional<LearningTrend> fit_trend(std::span<const double> figure);

/// Fits a straight line to a metric at other places than 1, 2, ..., as days. `first` is the value of the line at the
/// first place with a measured value, and the slope is per unit of `at`. Also returns nothing when all places are
/// equal. Throws Error(input) when the lengths differ.
std::optional<LearningTrend> fit_trend(std::span<const double> at, std::span<const double> figure);

}  // namespace haptrace
