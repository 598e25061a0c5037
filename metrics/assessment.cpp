#include "metrics/assessment.h"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <deque>
#include <fmt/format.h>
#include <numbers>
#include <vector>

namespace haptrace {
namespace {

/// Returns true if the workspace ends in the direction, within the margin of a place.
bool near_end(const Box& workspace, const Vec3& place, const Vec3& direction) {
  constexpr double kAlong = 0.2;  // share of the direction along an axis whose end can stop the hand
  if (!is_finite(workspace.min) || !is_finite(workspace.max)) return false;
  for (int axis = 0; axis < 3; ++axis) {
    if (direction[axis] > kAlong && workspace.max[axis] - place[axis] < RangeFigures::kMargin) return true;
    if (direction[axis] < -kAlong && place[axis] - workspace.min[axis] < RangeFigures::kMargin) return true;
  }
  return false;
}

/// Returns the largest distance from the first position [m].
double largest_movement(std::span<const Vec3> positions) {
  double largest = 0;
  std::optional<Vec3> first;
  for (const Vec3& p : positions) {
    if (!is_finite(p)) continue;
    if (!first) first = p;
    largest = std::max(largest, (p - *first).norm());
  }
  return largest;
}

/// Sines of a movement along a line, one for each frequency: a sin(w t) + b cos(w t).
struct Line {
  double omega, a, b;
};

/// Fits a constant and the sines of the target to places along the line (least squares). Nothing without enough rows.
std::vector<Line> lines_of(const std::vector<double>& time, const std::vector<double>& place,
                           const std::vector<double>& frequency) {
  const auto rows = static_cast<Eigen::Index>(time.size()),
             unknowns = static_cast<Eigen::Index>(1 + 2 * frequency.size());
  if (rows < 2 * unknowns) return {};
  Eigen::MatrixXd model(rows, unknowns);
  Eigen::VectorXd values(rows);
  for (Eigen::Index i = 0; i < rows; ++i) {
    const auto at = static_cast<std::size_t>(i);
    model(i, 0) = 1;
    for (std::size_t k = 0; k < frequency.size(); ++k) {
      const double angle = 2 * std::numbers::pi * frequency[k] * time[at];
      model(i, static_cast<Eigen::Index>(1 + 2 * k)) = std::sin(angle);
      model(i, static_cast<Eigen::Index>(2 + 2 * k)) = std::cos(angle);
    }
    values[i] = place[at];
  }
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> solver(model);
  if (solver.rank() < unknowns) return {};
  const Eigen::VectorXd fit = solver.solve(values);
  std::vector<Line> lines;
  for (std::size_t k = 0; k < frequency.size(); ++k)
    lines.push_back({2 * std::numbers::pi * frequency[k], fit[static_cast<Eigen::Index>(1 + 2 * k)],
                     fit[static_cast<Eigen::Index>(2 + 2 * k)]});
  return lines;
}

/// Adds gain and delay. `size` is that of each sine of the target [m].
void add_gain(TrackFigures& figures, const std::vector<Line>& lines, const std::vector<double>& phase, double size) {
  if (lines.empty()) return;
  // Correlation of the hand's sines with those of a target that is late by tau.
  const auto gain_at = [&](double tau) {
    double sum = 0;
    for (std::size_t k = 0; k < lines.size(); ++k) {
      const double late = phase[k] - lines[k].omega * tau;
      sum += lines[k].a * std::cos(late) + lines[k].b * std::sin(late);
    }
    return sum / (size * static_cast<double>(lines.size()));
  };
  constexpr double kStep = 1e-3;  // [s]
  double best = TrackFigures::kEarliest, gain = gain_at(best);
  for (double tau = best; tau <= TrackFigures::kLatest; tau += kStep)
    if (const double other = gain_at(tau); other > gain) {
      gain = other;
      best = tau;
    }
  figures.gain = gain;
  const bool inside = best > TrackFigures::kEarliest + 0.5 * kStep && best < TrackFigures::kLatest - 0.5 * kStep;
  if (gain >= TrackFigures::kLeastGain && inside) figures.delay = best;
}

}  // namespace

std::optional<RangeFigures> range_figures(const Trial& trial, const ReachTrial& reach) {
  const Vec3 along = reach.geometry.along();
  std::optional<RangeFigures> figures;
  // Rows of the window whose places are the smallest ones from there on, nearest first.
  std::deque<std::size_t> least;
  const auto place = [&](std::size_t i) { return (trial.position[i] - reach.geometry.start).dot(along); };
  std::optional<double> begin;  // of the positions without a gap
  for (std::size_t i = 0; i < trial.position.size(); ++i) {
    constexpr double kLongestGap = 0.1;  // [s]
    if (!is_finite(trial.position[i]) || (i > 0 && trial.time[i] - trial.time[i - 1] > kLongestGap)) {
      least.clear();
      begin.reset();
      if (!is_finite(trial.position[i])) continue;
    }
    if (!begin) begin = trial.time[i];
    while (!least.empty() && place(least.back()) >= place(i)) least.pop_back();
    least.push_back(i);
    while (trial.time[i] - trial.time[least.front()] > reach.hold) least.pop_front();
    if (trial.time[i] - *begin < reach.hold) continue;
    const std::size_t nearest = least.front();
    if (figures && place(nearest) <= figures->distance) continue;
    // A hand that goes the other way has not come at all.
    const double distance = std::max(place(nearest), 0.0);
    figures = RangeFigures{.distance = distance,
                           .at_limit = distance > 0 && near_end(reach.workspace, trial.position[nearest], along)};
  }
  return figures;
}

namespace {

/// Integral of the force of the hand along a direction, by trapezoids; rows without a force are left out.
struct HandForce {
  std::vector<std::size_t> rows;
  std::vector<double> integral;  ///< from the first of these rows [N s]

  /// Returns the time from entry `first` to entry `last` [s].
  [[nodiscard]] double lasts(const Trial& trial, std::size_t first, std::size_t last) const {
    return trial.time[rows[last]] - trial.time[rows[first]];
  }
};

/// The force is the measured one if the trial has it, else the sent one, and opposite to that of the device.
HandForce force_of_hand(const Trial& trial, const Vec3& along) {
  const std::span<const Vec3> force = trial.measured.empty() ? trial.force : trial.measured;
  HandForce hand;
  for (std::size_t i = 0; i < force.size(); ++i) {
    if (!is_finite(force[i])) continue;
    if (hand.rows.empty()) {
      hand.integral.push_back(0);
    } else {
      const std::size_t before = hand.rows.back();
      hand.integral.push_back(hand.integral.back() -
                              0.5 * (force[i] + force[before]).dot(along) * (trial.time[i] - trial.time[before]));
    }
    hand.rows.push_back(i);
  }
  return hand;
}

/// Returns true if a lock had no more force in too many of the rows from `first` to `last`.
bool was_limited(const Trial& trial, double largest, std::size_t first, std::size_t last) {
  if (!(largest > 0) || trial.force.empty()) return false;
  std::size_t limited = 0;
  for (std::size_t i = first; i <= last; ++i)
    limited += trial.force[i].norm() >= PressFigures::kNearLimit * largest ? 1 : 0;
  return static_cast<double>(limited) > PressFigures::kLimited * static_cast<double>(last - first + 1);
}

}  // namespace

std::optional<PressFigures> press_figures(const Trial& trial, const ReachTrial& reach, const std::string& spoiled) {
  const HandForce hand = force_of_hand(trial, reach.geometry.along());
  std::optional<PressFigures> figures;
  std::size_t first_of_best = 0, last_of_best = 0;
  const auto consider = [&](std::size_t first, std::size_t last) {
    const double lasts = hand.lasts(trial, first, last);
    if (!(lasts > 0)) return;
    const double mean = (hand.integral[last] - hand.integral[first]) / lasts;
    if (figures && mean <= figures->force) return;
    figures = PressFigures{.force = mean, .refused = ""};
    first_of_best = hand.rows[first];
    last_of_best = hand.rows[last];
  };
  const auto each_window = [&](double window, std::size_t from) {
    for (std::size_t first = 0, last = 0; last < hand.rows.size(); ++last) {
      // The shortest section that is as long as the window.
      while (first + 1 < last && hand.lasts(trial, first + 1, last) >= window - 1e-9) ++first;
      if (last >= from && hand.lasts(trial, first, last) >= window - 1e-9) consider(first, last);
    }
  };
  each_window(PressFigures::kWindow, 0);
  if (!spoiled.empty() && !hand.rows.empty()) each_window(PressFigures::kBeforeBreak, hand.rows.size() - 1);
  if (!figures) return figures;
  figures->at_limit = was_limited(trial, reach.largest, first_of_best, last_of_best) || !spoiled.empty();
  const double play = reach.largest > 0 ? 0 : largest_movement(trial.position);
  if (play > PressFigures::kLockedPlay)
    figures->refused = fmt::format("the handle moved by {:.0f} mm, so it was not locked", 1e3 * play);
  else if (figures->force < PressFigures::kLeast)
    figures->refused = "the hand did not press in this direction, or the sensor states the force with the other sign";
  return figures;
}

std::optional<WeighFigures> weigh_figures(const Trial& trial, const ReachTrial& reach, const std::string& spoiled) {
  constexpr const char* kNobody = "no arm rested on the device, or the sensor states the force with the other sign";
  // A lock that gave way ends the trial early. The force that it held until then, measured as in a press, is a lower
  // bound.
  if (!spoiled.empty()) {
    const std::optional<PressFigures> borne = press_figures(trial, reach, spoiled);
    if (!borne) return std::nullopt;
    return WeighFigures{
        .weight = borne->force, .at_limit = true, .refused = borne->force < WeighFigures::kLeast ? kNobody : ""};
  }
  const HandForce hand = force_of_hand(trial, reach.geometry.along());
  if (hand.rows.empty()) return std::nullopt;
  const std::size_t last = hand.rows.size() - 1;
  std::size_t first = 0;
  while (first + 1 < last && hand.lasts(trial, first + 1, last) >= WeighFigures::kWindow - 1e-9) ++first;
  const double lasts = hand.lasts(trial, first, last);
  if (!(lasts >= WeighFigures::kWindow - 1e-9)) return std::nullopt;
  WeighFigures figures{.weight = (hand.integral[last] - hand.integral[first]) / lasts,
                       .at_limit = was_limited(trial, reach.largest, hand.rows[first], hand.rows[last]),
                       .refused = ""};
  const std::span<const Vec3> window =
      trial.position.empty()
          ? trial.position
          : std::span(trial.position).subspan(hand.rows[first], hand.rows[last] - hand.rows[first] + 1);
  if (const double moved = largest_movement(window); moved > WeighFigures::kRests && !figures.at_limit)
    figures.refused = fmt::format("the arm moved by {:.0f} mm, so it did not rest", 1e3 * moved);
  else if (figures.weight < WeighFigures::kLeast)
    figures.refused = kNobody;
  return figures;
}

std::optional<TrackFigures> track_figures(const Trial& trial, const ReachTrial& reach) {
  if (trial.time.empty()) return std::nullopt;
  const Vec3 along = reach.geometry.along();
  const double distance = reach.geometry.distance();
  std::vector<double> time, place;
  double sum = 0;
  for (std::size_t i = 0; i < trial.position.size(); ++i) {
    const double t = trial.time[i] - trial.time.front();
    if (t < reach.track.discard || !is_finite(trial.position[i])) continue;
    const Vec3 way = trial.position[i] - reach.geometry.start;
    sum += (way - distance * reach.track.at(t) * along).squaredNorm();
    time.push_back(t);
    place.push_back(way.dot(along));
  }
  if (time.empty()) return std::nullopt;
  TrackFigures figures{.rms = std::sqrt(sum / static_cast<double>(time.size())), .gain = {}, .delay = {}};
  add_gain(figures, lines_of(time, place, reach.track.frequency), reach.track.phase,
           distance / static_cast<double>(reach.track.frequency.size()));
  return figures;
}

}  // namespace haptrace
