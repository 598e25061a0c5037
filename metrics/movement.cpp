#include "metrics/movement.h"

#include "base/error.h"
#include "control/zero_phase.h"
#include "metrics/even_trial.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <vector>

namespace haptrace {
namespace {

constexpr double kStepsPerCutoff = 100;  // even samples per period of the cut-off
constexpr double kMostSteps = 1e8;

/// Even instants.
struct Grid {
  double begin = 0, step = 0;  ///< [s]
  std::size_t size = 0;

  [[nodiscard]] double at(std::size_t k) const { return begin + static_cast<double>(k) * step; }
  [[nodiscard]] double end() const { return at(size - 1); }
};

/// The measured rows of a column.
struct Column {
  std::vector<double> time;
  std::vector<Vec3> value;

  Column(std::span<const double> times, std::span<const Vec3> values) {
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (!is_finite(values[i])) continue;
      time.push_back(times[i]);
      value.push_back(values[i]);
    }
  }

  /// Returns whether no gap between rows, from `begin` to `end`, is longer than `gap`.
  [[nodiscard]] bool covers(double begin, double end, double gap) const {
    if (time.empty() || time.front() - begin > gap || end - time.back() > gap) return false;
    return std::adjacent_find(time.begin(), time.end(), [gap](double a, double b) { return b - a > gap; }) ==
           time.end();
  }
};

/// Interpolates a column linearly between its rows, with constant values before and after, and integrates it.
class Lines {
 public:
  explicit Lines(const Column& column) : column_(column), integral_(column.time.size(), Vec3::Zero()) {
    for (std::size_t i = 0; i + 1 < integral_.size(); ++i)
      integral_[i + 1] = integral_[i] + area(i, column.time[i + 1]);
  }

  /// Returns the integral from the first row to t. Queries come in order; `row` remembers the last.
  [[nodiscard]] Vec3 integral(double t, std::size_t& row) const {
    if (t <= column_.time.front()) return (t - column_.time.front()) * column_.value.front();
    if (t >= column_.time.back()) return integral_.back() + (t - column_.time.back()) * column_.value.back();
    while (column_.time[row + 1] < t) ++row;
    return integral_[row] + area(row, t);
  }

  [[nodiscard]] Vec3 value(double t) const {
    const auto after = std::upper_bound(column_.time.begin(), column_.time.end(), t);
    if (after == column_.time.begin()) return column_.value.front();
    if (after == column_.time.end()) return column_.value.back();
    const auto i = static_cast<std::size_t>(after - column_.time.begin()) - 1;
    return column_.value[i] + (t - column_.time[i]) * slope(i);
  }

 private:
  [[nodiscard]] Vec3 slope(std::size_t i) const {
    return (column_.value[i + 1] - column_.value[i]) / (column_.time[i + 1] - column_.time[i]);
  }
  [[nodiscard]] Vec3 area(std::size_t i, double t) const {
    const double dt = t - column_.time[i];
    return dt * (column_.value[i] + 0.5 * dt * slope(i));
  }

  const Column& column_;
  std::vector<Vec3> integral_;
};

std::vector<Vec3> resampled(const Column& column, const Grid& grid) {
  const Lines lines(column);
  std::vector<Vec3> even(grid.size);
  std::size_t lower = 0, upper = 0;
  for (std::size_t k = 0; k < grid.size; ++k) {
    // At the ends the interval shrinks to a point, because it must not cover one side only.
    const double t = grid.at(k), half = k == 0 || k + 1 == grid.size ? 0 : grid.step / 2;
    even[k] = half == 0 ? lines.value(t)
                        : Vec3((lines.integral(t + half, upper) - lines.integral(t - half, lower)) / (2 * half));
  }
  return even;
}

std::vector<Vec3> central_differences(const std::vector<Vec3>& x, double step) {
  std::vector<Vec3> v(x.size());
  for (std::size_t i = 0; i < x.size(); ++i) {
    const std::size_t before = i == 0 ? 0 : i - 1, after = std::min(i + 1, x.size() - 1);
    v[i] = (x[after] - x[before]) / (static_cast<double>(after - before) * step);
  }
  return v;
}

/// Counts the maxima that rise above both adjacent valleys by `prominence`.
int count_peaks(std::span<const double> speed, double prominence) {
  int peaks = 0;
  bool rising = false;  // above the last valley by at least the prominence
  double lowest = speed.front(), highest = speed.front();
  for (const double v : speed) {
    if (rising) {
      highest = std::max(highest, v);
      if (v > highest - prominence) continue;
      ++peaks;
      rising = false;
      lowest = v;
    } else {
      lowest = std::min(lowest, v);
      if (v < lowest + prominence) continue;
      rising = true;
      highest = v;
    }
  }
  return peaks;
}

/// Returns the integral of `rate` from onset to end, by the trapezoidal rule.
template <class Rate>
double integral(const EvenTrial& movement, const Rate& rate) {
  double sum = 0;
  for (std::size_t i = movement.first; i <= movement.last; ++i)
    sum += (i == movement.first || i == movement.last ? 0.5 : 1) * rate(i);
  return sum * movement.step;
}

/// Returns the time below the threshold [s]; the speed is linear between rows.
double dwell_time(const EvenTrial& movement) {
  double steps = 0;
  for (std::size_t i = movement.first; i < movement.last; ++i) {
    const auto [least, most] = std::minmax({movement.speed[i] - movement.slow, movement.speed[i + 1] - movement.slow});
    if (least < 0) steps += most < 0 ? 1 : -least / (most - least);
  }
  return steps * movement.step;
}

ForceFigures force_figures(const EvenTrial& movement, const std::vector<Vec3>& force) {
  ForceFigures figures;
  const auto moves = [&](std::size_t i) { return movement.speed[i] >= movement.slow; };
  const auto across = [&](std::size_t i) {
    const Vec3 along = movement.velocity[i] / movement.speed[i];
    return (force[i] - along.dot(force[i]) * along).norm();
  };
  const auto power = [&](std::size_t i) { return force[i].dot(movement.velocity[i]); };
  const double time = integral(movement, [](std::size_t) { return 1; });
  const double moving = integral(movement, [&](std::size_t i) { return moves(i) ? 1 : 0; });
  figures.mean = integral(movement, [&](std::size_t i) { return force[i].norm(); }) / time;
  figures.mean_across = integral(movement, [&](std::size_t i) { return moves(i) ? across(i) : 0; }) / moving;
  figures.assist = integral(movement, [&](std::size_t i) { return std::max(power(i), 0.0); });
  figures.resist = integral(movement, [&](std::size_t i) { return std::max(-power(i), 0.0); });
  return figures;
}

double person_work(const EvenTrial& movement, const PlantModel& plant, const ForceFigures& device) {
  const auto kinetic = [&](std::size_t i) { return 0.5 * plant.mass.dot(movement.velocity[i].cwiseAbs2()); };
  const double friction = integral(movement, [&](std::size_t i) {
    const Vec3& v = movement.velocity[i];
    return plant.viscous.dot(v.cwiseAbs2()) + plant.coulomb.dot(v.cwiseAbs());
  });
  const double gravity = integral(movement, [&](std::size_t i) {
    return (plant.gravity + plant.gravity_gradient * movement.position[i]).dot(movement.velocity[i]);
  });
  return kinetic(movement.last) - kinetic(movement.first) + friction - gravity - (device.assist - device.resist);
}

/// Computes SPARC. Every eighth sample of a longer movement is enough: that is 12 samples in a period of the low pass.
std::optional<double> sparc_of(std::span<const double> speed, double step, const MovementOptions& options) {
  constexpr std::size_t kEnough = 256, kMostStride = 8;
  const std::size_t stride = std::clamp<std::size_t>(speed.size() / kEnough, 1, kMostStride);
  std::vector<double> fewer;
  for (std::size_t i = 0; i < speed.size(); i += stride) fewer.push_back(speed[i]);
  return sparc(fewer, 1 / (static_cast<double>(stride) * step), options.sparc);
}

void validate(const Trial& trial) {
  const std::size_t rows = trial.time.size();
  const auto equal = [&](std::span<const Vec3> column) { return column.empty() || column.size() == rows; };
  if (trial.position.size() != rows || !equal(trial.force) || !equal(trial.measured))
    throw input_error(
        fmt::format("a trial with {} times has {} positions, {} forces and {} measured forces; all columns must have "
                    "the same length, but forces may be empty",
                    rows, trial.position.size(), trial.force.size(), trial.measured.size()));
  for (std::size_t i = 0; i < rows; ++i)
    if (!std::isfinite(trial.time[i]) || (i > 0 && !(trial.time[i] > trial.time[i - 1])))
      throw input_error(fmt::format("sample {} of a trial: time {} s is not later than {} s; the time must increase",
                                    i + 1, trial.time[i], i > 0 ? trial.time[i - 1] : kNaN));
}

void validate(const MovementOptions& options) {
  const auto positive = [](double x) { return std::isfinite(x) && x > 0; };
  const auto share = [](double x) { return x > 0 && x < 1; };
  if (!positive(options.cutoff_hz) || !positive(options.least_speed) || !positive(options.max_gap) ||
      !share(options.threshold) || !share(options.prominence) ||
      (options.reference_length && !positive(*options.reference_length)))
    throw input_error(
        "movement metrics: the cut-off, the least speed, the longest gap and the reference length must be positive; "
        "the threshold and the prominence must be between 0 and 1");
}

}  // namespace

std::optional<EvenTrial> even_trial(const Trial& trial, const MovementOptions& options) {
  validate(options);
  validate(trial);
  const Column positions(trial.time, trial.position);
  if (positions.time.size() < 3) return std::nullopt;
  const double begin = positions.time.front(), end = positions.time.back();
  if (!positions.covers(begin, end, options.max_gap)) return std::nullopt;

  const double rate = kStepsPerCutoff * options.cutoff_hz;
  if ((end - begin) * rate > kMostSteps)
    throw input_error(
        fmt::format("the trial lasts {} s, which is too long for the low-pass at {} Hz; its times must be in seconds",
                    end - begin, options.cutoff_hz));
  const auto steps = std::max(std::round((end - begin) * rate), 2.0);
  const Grid grid{.begin = begin, .step = (end - begin) / steps, .size = static_cast<std::size_t>(steps) + 1};
  const auto even = [&](const Column& column) {
    std::vector<Vec3> x = resampled(column, grid);
    zero_phase_low_pass(x, options.cutoff_hz, 1 / grid.step);
    return x;
  };

  EvenTrial movement{.step = grid.step, .duration = end - begin, .position = even(positions)};
  movement.velocity = central_differences(movement.position, grid.step);
  std::vector<double>& speed = movement.speed;
  for (const Vec3& v : movement.velocity) speed.push_back(v.norm());
  movement.peak = *std::max_element(speed.begin(), speed.end());
  if (movement.peak < options.least_speed) return std::nullopt;

  movement.slow = options.threshold * movement.peak;
  const auto moves = [&](double v) { return v >= movement.slow; };
  movement.first = static_cast<std::size_t>(std::find_if(speed.begin(), speed.end(), moves) - speed.begin());
  movement.last = static_cast<std::size_t>(speed.rend() - std::find_if(speed.rbegin(), speed.rend(), moves)) - 1;
  // Interpolates between this slower row and the next one towards the movement.
  const auto crossing = [&](std::size_t slow, std::size_t fast) {
    const double u = (movement.slow - speed[slow]) / (speed[fast] - speed[slow]);
    return grid.at(slow) - begin + u * (grid.at(fast) - grid.at(slow));
  };
  movement.onset = movement.first == 0 ? 0 : crossing(movement.first - 1, movement.first);
  movement.end = movement.last + 1 == grid.size ? movement.duration : crossing(movement.last + 1, movement.last);
  const auto covered = [&](std::span<const Vec3> values) -> std::optional<std::vector<Vec3>> {
    const Column column(trial.time, values);
    return column.covers(begin, end, options.max_gap) ? std::optional(even(column)) : std::nullopt;
  };
  movement.force = covered(trial.force);
  movement.measured = covered(trial.measured);
  return movement;
}

std::size_t first_speed_peak(const EvenTrial& trial, double prominence) {
  std::size_t highest = trial.first;
  for (std::size_t i = trial.first; i <= trial.last; ++i) {
    if (trial.speed[i] > trial.speed[highest]) highest = i;
    if (trial.speed[i] <= trial.speed[highest] - prominence) break;
  }
  return highest;
}

std::optional<MovementFigures> movement_figures(const Trial& trial, const MovementOptions& options) {
  const std::optional<EvenTrial> even = even_trial(trial, options);
  if (!even) return std::nullopt;
  const EvenTrial& movement = *even;
  const std::vector<double>& speed = movement.speed;
  MovementFigures figures;
  figures.duration = movement.duration;
  figures.onset = movement.onset;
  figures.end = movement.end;
  figures.movement_time = figures.end - figures.onset;
  figures.dwell_time = dwell_time(movement);
  figures.path_length = integral(movement, [&](std::size_t i) { return speed[i]; });
  figures.mean_speed = figures.path_length / figures.movement_time;
  figures.peak_speed = movement.peak;
  figures.speed_peaks = count_peaks(speed, std::max(options.prominence * movement.peak, options.least_speed));
  if (options.reference_length) figures.normalised_length = figures.path_length / *options.reference_length;

  const std::span<const double> moving(speed.data() + movement.first, movement.last - movement.first + 1);
  figures.sparc = sparc_of(moving, movement.step, options);
  figures.log_jerk = log_dimensionless_jerk(moving, 1 / movement.step);
  figures.log_jerk_vector = log_dimensionless_jerk(
      std::span<const Vec3>(movement.velocity.data() + movement.first, moving.size()), 1 / movement.step);

  const auto figures_of = [&](const std::optional<std::vector<Vec3>>& low_passed,
                              std::span<const Vec3> rows) -> std::optional<ForceFigures> {
    if (!low_passed) return std::nullopt;
    ForceFigures result = force_figures(movement, *low_passed);
    for (const Vec3& force : rows)
      if (is_finite(force)) result.peak = std::max(result.peak, force.norm());
    return result;
  };
  figures.force = figures_of(movement.force, trial.force);
  figures.measured = figures_of(movement.measured, trial.measured);
  if (options.plant && figures.force)
    figures.person_work_estimate = person_work(movement, *options.plant, *figures.force);
  return figures;
}

}  // namespace haptrace
