#include "metrics/deviation.h"

#include "base/error.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

void require_equal(std::size_t rows, std::size_t column, const char* name) {
  if (column != rows)
    throw input_error(
        fmt::format("a movement with {} times has {} {}; all columns must have the same length", rows, column, name));
}

void require_increasing(std::span<const double> time) {
  for (std::size_t i = 1; i < time.size(); ++i)
    if (!(time[i] > time[i - 1]))
      throw input_error(fmt::format("sample {} of a movement: time {} s is not later than {} s; the time must increase",
                                    i + 1, time[i], time[i - 1]));
}

std::vector<Vec3> points_at(const Polyline& curve, std::span<const double> arc) {
  std::vector<Vec3> points(arc.size(), nan3());
  for (std::size_t i = 0; i < arc.size(); ++i)
    if (std::isfinite(arc[i])) points[i] = curve.at(arc[i]);
  return points;
}

}  // namespace

std::optional<Deviation> deviation(std::span<const double> time, std::span<const Vec3> position,
                                   std::span<const Vec3> reference) {
  require_equal(time.size(), position.size(), "positions");
  require_equal(time.size(), reference.size(), "references");
  require_increasing(time);
  double squares = 0, total = 0, peak = -1;
  for (std::size_t i = 0; i < time.size(); ++i) {
    const double error = (position[i] - reference[i]).norm();
    if (!std::isfinite(error)) continue;
    peak = std::max(peak, error);
    const auto counts = [&](std::size_t k) { return is_finite(position[k]) && is_finite(reference[k]); };
    double weight = 0;
    if (i > 0 && counts(i - 1)) weight += (time[i] - time[i - 1]) / 2;
    if (i + 1 < time.size() && counts(i + 1)) weight += (time[i + 1] - time[i]) / 2;
    squares += weight * error * error;
    total += weight;
  }
  if (peak < 0) return std::nullopt;
  // Isolated rows have no duration: only the largest error is known.
  return Deviation{.rms = total > 0 ? std::sqrt(squares / total) : peak, .peak = peak};
}

std::optional<Deviation> contour_deviation(std::span<const double> time, std::span<const Vec3> position,
                                           const Polyline& curve, std::span<const double> arc) {
  require_equal(time.size(), arc.size(), "arc lengths");
  return deviation(time, position, points_at(curve, arc));
}

std::vector<Vec3> force_by_arc_length(std::span<const double> arc, std::span<const Vec3> force, double length,
                                      double spacing, std::span<const std::size_t> jumps) {
  constexpr double kMostCells = 1e7;
  require_equal(arc.size(), force.size(), "forces");
  if (!(length >= 0) || !(spacing > 0) || !(length / spacing < kMostCells))
    throw input_error(fmt::format("a curve of {} m cannot be divided into cells of {} m", length, spacing));
  const auto cells = static_cast<std::size_t>(std::max(std::ceil(length / spacing), 1.0));
  std::vector<Vec3> sum(cells, Vec3::Zero());
  std::vector<double> passed(cells, 0);
  for (std::size_t i = 1; i < arc.size(); ++i) {
    if (std::binary_search(jumps.begin(), jumps.end(), i)) continue;
    if (!std::isfinite(arc[i]) || !std::isfinite(arc[i - 1]) || !is_finite(force[i]) || !is_finite(force[i - 1]))
      continue;
    // Goes from the smaller arc length to the larger, whatever the direction of the movement.
    const bool forwards = arc[i] >= arc[i - 1];
    const std::size_t a = forwards ? i - 1 : i, b = forwards ? i : i - 1;
    const double from = std::clamp(arc[a], 0.0, length), to = std::clamp(arc[b], 0.0, length);
    for (auto cell = static_cast<std::size_t>(from / spacing); cell < cells; ++cell) {
      const double begin = std::max(from, static_cast<double>(cell) * spacing);
      const double end = std::min(to, static_cast<double>(cell + 1) * spacing);
      if (!(end > begin)) break;
      const double middle = ((begin + end) / 2 - arc[a]) / (arc[b] - arc[a]);
      sum[cell] += (end - begin) * (force[a] + middle * (force[b] - force[a]));
      passed[cell] += end - begin;
    }
  }
  for (std::size_t cell = 0; cell < cells; ++cell)
    sum[cell] = passed[cell] > 0 ? Vec3(sum[cell] / passed[cell]) : nan3();
  return sum;
}

std::optional<ForceDeviation> force_deviation(std::span<const Vec3> trainee, std::span<const Vec3> expert) {
  if (trainee.size() != expert.size())
    throw input_error(fmt::format("forces in {} and {} cells cannot be compared; compute both along the same curve",
                                  trainee.size(), expert.size()));
  double squares = 0, peak = 0, compared = 0;
  for (std::size_t cell = 0; cell < trainee.size(); ++cell) {
    const double error = (trainee[cell] - expert[cell]).norm();
    if (!std::isfinite(error)) continue;
    squares += error * error;
    peak = std::max(peak, error);
    ++compared;
  }
  if (compared == 0) return std::nullopt;
  return ForceDeviation{.error = {.rms = std::sqrt(squares / compared), .peak = peak},
                        .compared = compared / static_cast<double>(trainee.size())};
}

}  // namespace haptrace
