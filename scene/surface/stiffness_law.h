// Force of a surface against the depth of a contact.
#pragma once

#include "base/json_reader.h"

#include <vector>

namespace haptrace {

/// A law's force and slope at one depth.
struct Elastic {
  double force = 0;      ///< [N]
  double stiffness = 0;  ///< slope of the force [N/m]
  double stored = 0;     ///< its integral from zero [J]
};

/// A stiffness law other than a linear one: zero force at depth zero, never falling with depth.
class StiffnessLaw {
 public:
  /// Returns F = 4/3 E sqrt(R) d^1.5, the force of Hertz (1881) between a ball and a body.
  /// `modulus` E [Pa]: 1/E = sum (1 - nu^2) / E_i over both bodies; `radius` R [m]: of the ball.
  static StiffnessLaw hertz(double modulus, double radius);

  /// Returns the line through points (depth [m], force [N]), continued with its last slope. Throws Error(input) unless
  /// the first is (0, 0), depths increase, and forces do not fall.
  static StiffnessLaw table(const std::vector<std::pair<double, double>>& points);

  /// Real-time. `depth` > 0.
  [[nodiscard]] Elastic at(double depth) const noexcept;

 private:
  struct Piece {
    double depth = 0, force = 0, slope = 0, stored = 0;  ///< at its beginning, and the slope from there on
  };
  double hertz_ = 0;  ///< 4/3 E sqrt(R) [N/m^1.5]; 0: a table
  std::vector<Piece> pieces_;
};

/// Reads {"hertz": {"modulus": Pa, "radius": m}} or {"table": [[m, N], ...]} if one of the keys is there.
std::optional<StiffnessLaw> read_stiffness_law(JsonReader& reader);

}  // namespace haptrace
