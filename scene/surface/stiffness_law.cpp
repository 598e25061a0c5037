#include "scene/surface/stiffness_law.h"

#include "base/error.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr double kMostForce = 1e9;  // [N]

}  // namespace

StiffnessLaw StiffnessLaw::hertz(double modulus, double radius) {
  check_range("hertz: modulus", modulus, 1, 1e13, "Pa");
  check_range("hertz: radius", radius, 1e-6, 100, "m");
  StiffnessLaw law;
  law.hertz_ = 4.0 / 3 * modulus * std::sqrt(radius);
  return law;
}

StiffnessLaw StiffnessLaw::table(const std::vector<std::pair<double, double>>& points) {
  if (points.size() < 2) throw input_error("table: needs at least two points [depth, force]");
  if (points.front() != std::pair(0.0, 0.0))
    throw input_error("table[0]: the table begins at [0, 0]: no force at no depth");
  StiffnessLaw law;
  double stored = 0;
  for (std::size_t i = 1; i < points.size(); ++i) {
    const auto [d0, f0] = points[i - 1];
    const auto [d1, f1] = points[i];
    if (!(d1 > d0))
      throw input_error(fmt::format("table[{}]: the depth {} m is not above the one before, {} m", i, d1, d0));
    if (!(f1 >= f0 && f1 <= kMostForce))
      throw input_error(fmt::format("table[{}]: the force {} N is below the one before, {} N, or above {:g} N", i, f1,
                                    f0, kMostForce));
    law.pieces_.push_back({d0, f0, (f1 - f0) / (d1 - d0), stored});
    stored += 0.5 * (f0 + f1) * (d1 - d0);
  }
  return law;
}

Elastic StiffnessLaw::at(double depth) const noexcept {
  if (hertz_ > 0) {
    const double root = std::sqrt(depth);
    const double force = hertz_ * depth * root;
    return {force, 1.5 * hertz_ * root, 0.4 * force * depth};
  }
  const auto after = std::upper_bound(pieces_.begin() + 1, pieces_.end(), depth,
                                      [](double d, const Piece& piece) { return d < piece.depth; });
  const Piece& piece = *std::prev(after);
  const double further = depth - piece.depth;
  return {piece.force + piece.slope * further, piece.slope,
          piece.stored + (piece.force + 0.5 * piece.slope * further) * further};
}

std::optional<StiffnessLaw> read_stiffness_law(JsonReader& reader) {
  if (reader.has("hertz") && reader.has("table"))
    throw input_error(reader.where() + ": 'hertz' and 'table' are two laws; keep one of them");
  if (std::optional<JsonReader> hertz = reader.object("hertz")) {
    const double modulus = hertz->require("modulus").number("modulus", 0, 1, 1e13);
    const double radius = hertz->require("radius").number("radius", 0, 1e-6, 100);
    hertz->finish();
    return StiffnessLaw::hertz(modulus, radius);
  }
  const nlohmann::json table = reader.value("table");
  if (table.is_null()) return std::nullopt;
  std::vector<std::pair<double, double>> points;
  const auto is_point = [](const nlohmann::json& row) {
    return row.is_array() && row.size() == 2 && row[0].is_number() && row[1].is_number();
  };
  if (!table.is_array() || !std::all_of(table.begin(), table.end(), is_point))
    throw input_error(reader.where() + ".table: expected a list of points [depth in m, force in N]");
  for (const nlohmann::json& row : table) points.emplace_back(row[0].get<double>(), row[1].get<double>());
  return StiffnessLaw::table(points);
}

}  // namespace haptrace
