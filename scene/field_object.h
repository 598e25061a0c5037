// An object that is felt all through a volume, without a surface.
#pragma once

#include "base/json_reader.h"
#include "scene/object.h"
#include "scene/shape/volume.h"

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace haptrace {

/// A smooth function through given points: a monotone cubic between them (Fritsch and Carlson 1980), so that it leaves
/// the range of no two neighbours, and constant beyond them. Its slope is continuous and zero at both ends.
class TransferFunction {
 public:
  struct Point {
    double at = 0, value = 0;
  };
  struct Value {
    double value = 0, first = 0, second = 0;  ///< with its derivatives
  };

  TransferFunction() = default;  ///< zero
  /// `points` ascend in `at`; there are at least two.
  explicit TransferFunction(std::vector<Point> points);

  [[nodiscard]] Value operator()(double at) const noexcept;
  [[nodiscard]] bool empty() const noexcept { return points_.empty(); }

 private:
  std::vector<Point> points_;
  std::vector<double> slopes_;
};

/// Transfer functions from the value s of a volume (Avila and Sobierajski 1996).
struct FieldSpec {
  TransferFunction energy;  ///< U [J], not negative
  TransferFunction drag;    ///< b [N s/m], not negative
};

/// Reads the keys `energy` and `drag`, of which one is required. Throws Error(input) naming the key.
FieldSpec read_field(JsonReader reader);

/// Makes an object whose force at a place x with the velocity v is
///
///     F = -grad(w U(s)) - w b(s) v      stored energy w U
///
/// with s the tricubic B-spline through the volume's values and w a window that falls to 0 within the outer two samples
/// of the grid (C2), so that the force is continuous everywhere, bounded, and conservative but for the drag, which only
/// takes energy. Outside the grid it is zero. The contact states the stiffness along the force, d^2(w U), and the
/// damping w b; its proxy is where a spring of that stiffness rests, at most kReach away. The tool's radius has no
/// meaning here. The surface of the volume at iso is only shown.
std::unique_ptr<Object> make_field_object(std::string name, std::string kind, std::unique_ptr<Volume> volume,
                                          FieldSpec spec, const std::optional<Pose>& pose);

}  // namespace haptrace
