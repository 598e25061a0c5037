#include "control/zero_phase.h"

#include "control/filters.h"

#include <algorithm>
#include <cstddef>

namespace haptrace {
void zero_phase_low_pass(std::vector<Vec3>& rows, double cutoff_hz, double rate_hz) {
  if (rows.size() < 2) return;
  const std::size_t last = rows.size() - 1, period = 2 * last;
  // A cut-off far below one over the duration leaves hardly more than the straight line, however long the filter
  // settles.
  constexpr double kMostPeriods = 16;
  const auto settling =
      static_cast<std::size_t>(std::min(3 * rate_hz / cutoff_hz, kMostPeriods * static_cast<double>(period)));
  const Vec3 begin = rows.front(), slope = (rows.back() - rows.front()) / static_cast<double>(last);
  for (std::size_t i = 0; i <= last; ++i) rows[i] -= begin + static_cast<double>(i) * slope;

  // An odd function of this period about both ends.
  std::vector<Vec3> line(rows.size() + 2 * settling);
  for (std::size_t i = 0; i < line.size(); ++i) {
    const std::size_t k = (i + (settling / period + 1) * period - settling) % period;
    line[i] = k <= last ? rows[k] : Vec3(-rows[period - k]);
  }
  BasicButterworth2<Vec3> filter(FilterKind::low_pass, cutoff_hz / kTwoPasses, rate_hz);
  for (Vec3& y : line) y = filter.update(y);
  filter.reset();
  for (auto y = line.rbegin(); y != line.rend(); ++y) *y = filter.update(*y);
  for (std::size_t i = 0; i <= last; ++i) rows[i] = line[i + settling] + begin + static_cast<double>(i) * slope;
}

}  // namespace haptrace
