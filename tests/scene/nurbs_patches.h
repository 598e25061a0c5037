// NURBS patches for tests, as in scene files.
#pragma once

#include "base/types.h"

#include <cmath>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <vector>

namespace haptrace::test {

using Json = nlohmann::json;

/// Points of a circle of radius 1 in quarters from the direction of x, as [x, y, weight]; `quarters` 1 to 4.
inline std::vector<Vec3> arc_points(int quarters, double from = 0) {
  std::vector<Vec3> points;
  for (int i = 0; i <= 2 * quarters; ++i) {
    const double angle = from + i * std::numbers::pi / 4, size = i % 2 == 0 ? 1 : std::sqrt(2);
    points.emplace_back(size * std::cos(angle), size * std::sin(angle), i % 2 == 0 ? 1 : std::sqrt(0.5));
  }
  return points;
}

inline Json arc_knots(int quarters) {
  Json knots{0, 0, 0};
  for (int i = 1; i < quarters; ++i) knots.insert(knots.end(), {i, i});
  knots.insert(knots.end(), {quarters, quarters, quarters});
  return knots;
}

/// The surface that a profile [rho, z, weight], of quarters of a circle, sweeps round the axis z.
inline Json revolved_patch(const std::vector<Vec3>& profile, const Json& knots, int degree, double scale,
                           int quarters = 4) {
  Json rows = Json::array();
  for (const Vec3& round : arc_points(quarters)) {
    Json row = Json::array();
    for (const Vec3& p : profile)
      row.push_back({scale * round.x() * p.x(), scale * round.y() * p.x(), scale * p.y(), round.z() * p.z()});
    rows.push_back(row);
  }
  return {{"degree", {2, degree}}, {"knots_u", arc_knots(quarters)}, {"knots_v", knots}, {"points", rows}};
}

/// A sphere around the origin, outside outwards.
inline Json sphere_patch(double radius) {
  return revolved_patch(arc_points(2, -std::numbers::pi / 2), arc_knots(2), 2, radius);
}

/// The lower half of a sphere.
inline Json half_sphere_patch(double radius) {
  return revolved_patch(arc_points(1, -std::numbers::pi / 2), arc_knots(1), 2, radius);
}

/// A rectangle of a plane z = height, with corners at `low` and `high`; outside upwards. The domain is the unit square.
inline Json plate_patch(const Eigen::Vector2d& low, const Eigen::Vector2d& high, double height) {
  return {{"degree", 1},
          {"knots_u", {0, 0, 1, 1}},
          {"knots_v", {0, 0, 1, 1}},
          {"points",
           {{{low.x(), low.y(), height}, {low.x(), high.y(), height}},
            {{high.x(), low.y(), height}, {high.x(), high.y(), height}}}}};
}

/// A bicubic patch z = bend (x^3 - 3 x y^2), a monkey saddle, over x from x0 to x1 and y from y0 to y1: a polynomial
/// of degree 3, which such a patch meets exactly.
inline Json monkey_patch(double x0, double x1, double y0, double y1, double bend) {
  // Blossoms of x^3, x y^2, y.
  const auto along = [](double a, double b, int i) {
    return std::array{a + (b - a) * (i > 0), a + (b - a) * (i > 1), a + (b - a) * (i > 2)};
  };
  Json rows = Json::array();
  for (int i = 0; i < 4; ++i) {
    Json row = Json::array();
    for (int j = 0; j < 4; ++j) {
      const auto x = along(x0, x1, i), y = along(y0, y1, j);
      const double cube = x[0] * x[1] * x[2], mean_x = (x[0] + x[1] + x[2]) / 3, mean_y = (y[0] + y[1] + y[2]) / 3;
      const double yy = (y[0] * y[1] + y[1] * y[2] + y[2] * y[0]) / 3;
      row.push_back({mean_x, mean_y, bend * (cube - 3 * mean_x * yy)});
    }
    rows.push_back(row);
  }
  return {
      {"degree", 3}, {"knots_u", {0, 0, 0, 0, 1, 1, 1, 1}}, {"knots_v", {0, 0, 0, 0, 1, 1, 1, 1}}, {"points", rows}};
}

inline std::string nurbs_object(const std::vector<Json>& patches, const Json& more = Json::object()) {
  Json object{{"kind", "nurbs"}, {"patches", patches}};
  object.update(more);
  return object.dump();
}

}  // namespace haptrace::test
