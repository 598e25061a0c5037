#include "metrics/time_warping.h"

#include "base/error.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <vector>

namespace haptrace {

std::optional<double> warping_distance(const Polyline& a, const Polyline& b, const WarpingOptions& options) {
  constexpr double kWidest = 1e6;  // [points]
  if (!(options.spacing > 0) || !(options.band >= 0) || !(options.band / options.spacing < kWidest))
    throw input_error(
        fmt::format("time warping with points {} m apart in a band of {} m: the spacing must be positive and the band "
                    "must not be negative",
                    options.spacing, options.band));
  if (a.length() == 0 || b.length() == 0) return std::nullopt;
  const std::vector<Vec3> p = a.resampled(options.spacing), q = b.resampled(options.spacing);
  const auto rows = static_cast<std::ptrdiff_t>(p.size()), columns = static_cast<std::ptrdiff_t>(q.size());
  const auto radius = static_cast<std::ptrdiff_t>(std::floor(options.band / options.spacing * (1 + 1e-12)));
  if (std::abs(rows - columns) > radius)
    throw input_error(
        fmt::format("a band of {} m cannot join the ends of paths of {:.4g} and {:.4g} m; it must be wider than the "
                    "difference of their lengths",
                    options.band, a.length(), b.length()));

  // Cell (i, j) is at index j - i + radius + 1 of its row. The cell above is one index further, the previous cell one
  // index back, and the diagonal cell at the same index. A margin of one cell on both sides is out of reach.
  constexpr double kOutOfReach = std::numeric_limits<double>::infinity();
  std::vector<double> above(static_cast<std::size_t>(2 * radius + 3), kOutOfReach), row = above;
  for (std::ptrdiff_t i = 0; i < rows; ++i) {
    for (std::ptrdiff_t j = std::max<std::ptrdiff_t>(i - radius, 0); j <= std::min(i + radius, columns - 1); ++j) {
      const auto here = static_cast<std::size_t>(j - i + radius + 1);
      const double distance = (p[static_cast<std::size_t>(i)] - q[static_cast<std::size_t>(j)]).norm();
      row[here] = i == 0 && j == 0
                      ? 2 * distance
                      : std::min({above[here + 1] + distance, row[here - 1] + distance, above[here] + 2 * distance});
    }
    std::swap(above, row);
  }
  const double sum = above[static_cast<std::size_t>(columns - rows + radius + 1)];
  return sum / static_cast<double>(rows + columns);
}

}  // namespace haptrace
