#include "metrics/reaching.h"

#include "metrics/even_trial.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

/// Returns the time at which a minimum-jerk movement with the rise to the first peak of this speed starts, after the
/// trial's first position [s]. Nothing if the rise has too few rows.
std::optional<double> back_fitted_start(const EvenTrial& trial, std::size_t peak) {
  constexpr double kLow = 0.1, kHigh = 0.6;  // shares of the peak
  const double top = trial.speed[peak];
  std::size_t low = peak;
  while (low > 0 && trial.speed[low - 1] >= kLow * top) --low;
  double n = 0, sum_w = 0, sum_t = 0, sum_ww = 0, sum_wt = 0;
  for (std::size_t i = low; i < peak && trial.speed[i] <= kHigh * top; ++i) {
    const double w = 0.5 * (1 - std::sqrt(1 - std::sqrt(trial.speed[i] / top)));
    const double t = static_cast<double>(i) * trial.step;
    n += 1;
    sum_w += w;
    sum_t += t;
    sum_ww += w * w;
    sum_wt += w * t;
  }
  const double spread = n * sum_ww - sum_w * sum_w;
  if (n < 3 || !(spread > 0)) return std::nullopt;
  const double slope = (n * sum_wt - sum_w * sum_t) / spread;
  return (sum_t - slope * sum_w) / n;
}

std::optional<double> reaction_time(const EvenTrial& trial, std::size_t peak) {
  const std::optional<double> start = back_fitted_start(trial, peak);
  return start && *start >= ReachFigures::kFastest && *start <= ReachFigures::kSlowest ? start : std::nullopt;
}

std::optional<double> field_share(const EvenTrial& trial, const Eigen::Matrix3d& field) {
  if (!trial.force) return std::nullopt;
  double sent = 0, whole = 0;
  for (std::size_t k = trial.first; k <= trial.last; ++k) {
    const Vec3 ideal = field * trial.velocity[k];
    sent += (*trial.force)[k].dot(ideal);
    whole += ideal.squaredNorm();
  }
  return whole > 0 ? std::optional(sent / whole) : std::nullopt;
}

/// Adds the adaptation index, or why there is none.
void add_index(ReachFigures& figures, const EvenTrial& trial, const ReachTrial& reach, const std::string& spoiled) {
  const std::optional<std::vector<Vec3>>& force = trial.measured ? trial.measured : trial.force;
  if (reach.field.isZero(0)) {
    figures.refused = "the clamp has no adaptation index: the exercise has no force field";
    return;
  }
  if (!force) {
    figures.refused = "the clamp has no adaptation index: the recording has no force";
    return;
  }
  if (!spoiled.empty()) {
    figures.refused = "the clamp has no adaptation index: " + spoiled;
    return;
  }
  if (figures.lateral_play > ReachFigures::kMostPlay) {
    figures.refused = fmt::format(
        "the clamp has no adaptation index: its lateral play was {:.1f} mm, and at most {:.0f} mm are allowed; a "
        "stiffer clamp or a weaker field lowers it",
        1e3 * figures.lateral_play, 1e3 * ReachFigures::kMostPlay);
    return;
  }
  const Vec3 along = reach.geometry.along();
  const double gain = reach.geometry.lateral.dot(reach.field * along);  // [N s/m]
  double n = 0, sum_m = 0, sum_i = 0, sum_mm = 0, sum_ii = 0, sum_mi = 0;
  for (std::size_t k = trial.first; k <= trial.last; ++k) {
    const double measured = (*force)[k].dot(reach.geometry.lateral), ideal = gain * trial.velocity[k].dot(along);
    n += 1;
    sum_m += measured;
    sum_i += ideal;
    sum_mm += measured * measured;
    sum_ii += ideal * ideal;
    sum_mi += measured * ideal;
  }
  if (!(sum_ii > 0)) {
    figures.refused = "the clamp has no adaptation index: the field has no lateral force along this reach";
    return;
  }
  figures.adaptation_index = sum_mi / sum_ii;
  const double spread = (n * sum_mm - sum_m * sum_m) * (n * sum_ii - sum_i * sum_i);
  if (spread > 0) figures.adaptation_r = (n * sum_mi - sum_m * sum_i) / std::sqrt(spread);
}

}  // namespace

std::optional<ReachFigures> reach_figures(const Trial& trial, const ReachTrial& reach, const std::string& spoiled,
                                          const MovementOptions& options) {
  const std::optional<EvenTrial> even = even_trial(trial, options);
  if (!even) return std::nullopt;
  const ReachGeometry& geometry = reach.geometry;
  const std::size_t peak = first_speed_peak(*even, std::max(options.prominence * even->peak, options.least_speed));
  const auto fastest =
      static_cast<std::size_t>(std::max_element(even->speed.begin(), even->speed.end()) - even->speed.begin());
  ReachFigures figures{.reaction_time = reaction_time(*even, peak), .refused = ""};
  const Vec3 aimed = even->position[peak] - even->position[even->first];
  if (aimed.norm() > 0) {
    const double left = aimed.dot(geometry.lateral), ahead = aimed.dot(geometry.along());
    figures.initial_direction_error = std::atan2(left, ahead);
  }
  double length = 0;
  for (std::size_t i = even->first; i <= even->last; ++i) {
    if (i > even->first) length += (even->position[i] - even->position[i - 1]).norm();
    figures.lateral_play = std::max(figures.lateral_play, geometry.across(even->position[i] - geometry.start).norm());
  }
  figures.path_ratio = length / geometry.distance();
  figures.lateral_deviation = geometry.deviation(even->position[fastest]);
  figures.end_error = (even->position[even->last] - geometry.target).norm();
  if (reach.field_acts() && !reach.field.isZero(0)) figures.field_share = field_share(*even, reach.field);
  if (reach.kind == ReachKind::clamp) add_index(figures, *even, reach, spoiled);
  return figures;
}

}  // namespace haptrace
