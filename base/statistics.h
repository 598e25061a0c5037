// Order statistics, and a quantile of the normal distribution.
#pragma once

#include <vector>

namespace haptrace {

/// Half of the 95 % confidence interval of a normal variable [standard deviations].
inline constexpr double kInterval95 = 1.96;

/// Returns the median: the mean of the two middle values if their number is even, NaN if there are none. NaN is not
/// allowed as a value.
double median(std::vector<double> values);

/// Returns the value below which a fraction `q`, 0 to 1, of the values lies, by linear interpolation between order
/// statistics (type 7 of Hyndman and Fan, "Sample quantiles in statistical packages", 1996). At 0.5 this is median().
/// Returns NaN if there are no values. NaN is not allowed as a value.
double quantile(std::vector<double> values, double q);

}  // namespace haptrace
