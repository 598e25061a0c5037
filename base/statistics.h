// Order statistics.
#pragma once

#include <vector>

namespace haptrace {

/// Returns the mean of the two middle values where their number is even, NaN where there are none. No value may be NaN.
double median(std::vector<double> values);

/// Returns the value that a fraction `q`, 0 to 1, of the values lies below, by linear interpolation between order
/// statistics (type 7 of Hyndman and Fan, "Sample quantiles in statistical packages", 1996): median() at 0.5. NaN where
/// there are no values; none of them may be NaN.
double quantile(std::vector<double> values, double q);

}  // namespace haptrace
