#include "report/thinning.h"

#include "control/path/path.h"

#include <algorithm>
#include <boost/geometry/algorithms/simplify.hpp>
#include <boost/geometry/geometries/linestring.hpp>
#include <boost/geometry/geometries/point.hpp>
#include <boost/geometry/strategies/strategies.hpp>
#include <cmath>

namespace haptrace {
namespace {

using CurvePoint = boost::geometry::model::point<double, 3, boost::geometry::cs::cartesian>;
using Curve = boost::geometry::model::linestring<CurvePoint>;

Vec3 vector_of(const CurvePoint& p) {
  return {p.get<0>(), p.get<1>(), p.get<2>()};
}

}  // namespace

std::vector<Vec3> thinned(std::span<const Vec3> points, std::size_t most) {
  Box box;
  for (const Vec3& p : points)
    if (p.allFinite()) box.include(p);
  if (box.min.x() > box.max.x()) return {};

  double tolerance = box.size().maxCoeff() / 2000;
  // Rest, and tremor within the tolerance, become one point. This keeps the quadratic worst case below away.
  Curve curve;
  for (const Vec3& p : points)
    if (p.allFinite() && (curve.empty() || (p - vector_of(curve.back())).norm() > tolerance / 2))
      curve.emplace_back(p.x(), p.y(), p.z());
  Curve thin;
  for (tolerance /= 2;; tolerance *= 2) {
    thin.clear();
    boost::geometry::simplify(curve, thin, tolerance);
    if (thin.size() <= std::max<std::size_t>(most, 2)) break;
    curve = thin;
  }
  std::vector<Vec3> result;
  for (const CurvePoint& p : thin) result.push_back(vector_of(p));
  return result;
}

ReportLine thinned(std::span<const double> arc, std::span<const double> value, std::size_t most) {
  double longest = 0, largest = 0;
  for (std::size_t i = 0; i < arc.size(); ++i) {
    if (std::isfinite(arc[i])) longest = std::max(longest, std::abs(arc[i]));
    if (std::isfinite(value[i])) largest = std::max(largest, std::abs(value[i]));
  }
  const double x = longest > 0 ? longest : 1, y = largest > 0 ? largest : 1;
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < arc.size(); ++i) points.emplace_back(arc[i] / x, value[i] / y, 0);
  ReportLine line;
  for (const Vec3& p : thinned(points, most)) {
    line.arc.push_back(p.x() * x);
    line.value.push_back(p.y() * y);
  }
  return line;
}

}  // namespace haptrace
