#include "metrics/learning_curve.h"

#include "base/error.h"

#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <boost/math/tools/minima.hpp>
#include <cmath>
#include <fmt/format.h>
#include <numeric>
#include <vector>

namespace haptrace {
namespace {

constexpr std::size_t kFewest = 4;

struct Point {
  double n = 0, figure = 0;
};

std::vector<Point> measured(std::span<const double> figure) {
  std::vector<Point> points;
  for (std::size_t i = 0; i < figure.size(); ++i)
    if (std::isfinite(figure[i])) points.push_back({static_cast<double>(i + 1), figure[i]});
  return points;
}

/// Returns the weight of `first` at repetition n: 1 at the first, 0 at infinity.
double left(LearningLaw law, double rate, double n) {
  return law == LearningLaw::power ? std::pow(n, -rate) : std::exp(-rate * (n - 1));
}

double squares_about_mean(const std::vector<Point>& points) {
  double mean = 0, squares = 0;
  for (const Point& p : points) mean += p.figure / static_cast<double>(points.size());
  for (const Point& p : points) squares += (p.figure - mean) * (p.figure - mean);
  return squares;
}

double residual(const std::vector<Point>& points, const LearningCurve& curve) {
  double squares = 0;
  for (const Point& p : points) squares += std::pow(p.figure - curve.at(p.n), 2);
  return squares;
}

/// Returns the best curve of this rate: e = first * w + plateau * (1 - w), both at least `least`.
LearningCurve best_of_rate(const std::vector<Point>& points, LearningLaw law, double rate, double least) {
  double ww = 0, wu = 0, uu = 0, we = 0, ue = 0;
  for (const Point& p : points) {
    const double w = left(law, rate, p.n), u = 1 - w;
    ww += w * w;
    wu += w * u;
    uu += u * u;
    we += w * p.figure;
    ue += u * p.figure;
  }
  LearningCurve curve{.law = law, .rate = rate};
  const double determinant = ww * uu - wu * wu;
  curve.first = (we * uu - ue * wu) / determinant;
  curve.plateau = (ue * ww - we * wu) / determinant;
  // If one unknown crosses its bound, it stays on the bound, and the other becomes a problem of one unknown.
  if (curve.plateau < least) {
    curve.plateau = least;
    curve.first = std::max((we - least * wu) / ww, least);
  } else if (curve.first < least) {
    curve.first = least;
    curve.plateau = std::max((ue - least * wu) / uu, least);
  }
  return curve;
}

}  // namespace

double LearningCurve::at(double n) const {
  return plateau + (first - plateau) * left(law, rate, n);
}

std::optional<LearningCurve> fit_learning_curve(std::span<const double> figure, LearningLaw law,
                                                const LearningBounds& bounds) {
  if (!(bounds.slowest > 0) || !(bounds.fastest > bounds.slowest) || !std::isfinite(bounds.fastest) ||
      std::isnan(bounds.least))
    throw input_error(fmt::format(
        "the bounds of the learning rate are {} and {}; they must be positive and the first must be smaller",
        bounds.slowest, bounds.fastest));
  std::vector<Point> points = measured(figure);
  if (points.size() < kFewest) return std::nullopt;
  // Scales by the largest value, so that no metric is too small or too large to be squared.
  double size = 0;
  for (const Point& p : points) size = std::max(size, std::abs(p.figure));
  if (size == 0) return std::nullopt;
  for (Point& p : points) p.figure /= size;
  const double total = squares_about_mean(points);
  constexpr double kRounding = 1e-24;
  if (total < kRounding * static_cast<double>(points.size())) return std::nullopt;

  const auto best_at = [&](double log_rate) {
    return best_of_rate(points, law, std::clamp(std::exp(log_rate), bounds.slowest, bounds.fastest),
                        bounds.least / size);
  };
  const auto left_over = [&](double log_rate) { return residual(points, best_at(log_rate)); };
  constexpr int kSteps = 200;
  const double begin = std::log(bounds.slowest), step = std::log(bounds.fastest / bounds.slowest) / kSteps;
  int best = 0;
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i <= kSteps; ++i)
    if (const double squares = left_over(begin + i * step); squares < least) {
      least = squares;
      best = i;
    }
  constexpr int kBits = 26;  // a double resolves the minimum of a parabola no better
  const double log_rate = boost::math::tools::brent_find_minima(left_over, begin + std::max(best - 1, 0) * step,
                                                                begin + std::min(best + 1, kSteps) * step, kBits)
                              .first;
  LearningCurve curve = best_at(log_rate);
  curve.r_squared = 1 - residual(points, curve) / total;
  curve.first *= size;
  curve.plateau *= size;
  return curve;
}

std::optional<LearningTrend> fit_trend(std::span<const double> figure) {
  std::vector<double> at(figure.size());
  std::iota(at.begin(), at.end(), 1.0);
  std::optional<LearningTrend> trend = fit_trend(at, figure);
  if (!trend) return trend;
  const auto first = std::find_if(figure.begin(), figure.end(), [](double v) { return std::isfinite(v); });
  trend->first -= trend->slope * static_cast<double>(first - figure.begin());
  return trend;
}

std::optional<LearningTrend> fit_trend(std::span<const double> at, std::span<const double> figure) {
  if (at.size() != figure.size())
    throw input_error(
        fmt::format("a trend has {} places and {} values; give one place for each value", at.size(), figure.size()));
  std::vector<Point> points;
  for (std::size_t i = 0; i < at.size(); ++i)
    if (std::isfinite(at[i]) && std::isfinite(figure[i])) points.push_back({at[i], figure[i]});
  if (points.size() < kFewest) return std::nullopt;
  const auto count = static_cast<double>(points.size());
  double n_mean = 0, mean = 0;
  for (const Point& p : points) {
    n_mean += p.n / count;
    mean += p.figure / count;
  }
  double nn = 0, ne = 0, residuals = 0;
  for (const Point& p : points) {
    nn += (p.n - n_mean) * (p.n - n_mean);
    ne += (p.n - n_mean) * (p.figure - mean);
  }
  if (!(nn > 0)) return std::nullopt;
  LearningTrend trend{.slope = ne / nn};
  trend.first = mean + trend.slope * (points.front().n - n_mean);
  for (const Point& p : points)
    residuals += std::pow(p.figure - trend.first - trend.slope * (p.n - points.front().n), 2);
  const boost::math::students_t distribution(count - 2);
  trend.slope_half_width = boost::math::quantile(distribution, 0.975) * std::sqrt(residuals / (count - 2) / nn);
  if (const double total = squares_about_mean(points); total > 0) trend.r_squared = 1 - residuals / total;
  return trend;
}

}  // namespace haptrace
