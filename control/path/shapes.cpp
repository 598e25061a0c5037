#include "control/path/shapes.h"

#include "base/error.h"
#include "control/path/min_jerk.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <functional>
#include <numbers>

namespace haptrace {
namespace {

using Eigen::Vector2d;
using std::numbers::pi;

constexpr double kMostSamples = 1e8;

/// A point of a plane curve and the unit tangent there.
struct CurvePoint {
  Vector2d position, tangent;
};

/// Progress along a curve: the fraction of its length, and its derivative with respect to the fraction of the duration.
struct Progress {
  double lap, rate;
};

/// A plane curve parameterised by arc length, from 0 to `length` [m], relative to the centre.
struct Curve {
  double length;
  std::function<CurvePoint(double)> at;
  bool closed;                                ///< several turns are possible
  bool rests_halfway = false;                 ///< one movement out and one back, instead of one movement for all turns
  std::function<Progress(double)> pace = {};  ///< over the fraction of the duration; empty: minimum jerk along the arc
};

/// Inverts the arc length of a curve whose speed with respect to its parameter is known. The arc length is tabulated by
/// Gauss-Legendre integration with five points per cell; Newton's method refines the inverse to rounding error.
class ArcLength {
 public:
  ArcLength(std::function<double(double)> speed, double end, int cells)
      : speed_(std::move(speed)), cell_(end / cells), arc_(static_cast<std::size_t>(cells) + 1, 0.0) {
    for (std::size_t i = 1; i < arc_.size(); ++i) {
      const double from = cell_ * static_cast<double>(i - 1);
      arc_[i] = arc_[i - 1] + integral(from, from + cell_);
    }
  }

  [[nodiscard]] double length() const { return arc_.back(); }

  [[nodiscard]] double at(double q) const {
    const auto i = std::min(static_cast<std::size_t>(q / cell_), arc_.size() - 2);
    return arc_[i] + integral(cell_ * static_cast<double>(i), q);
  }

  [[nodiscard]] double parameter_at(double arc) const {
    const auto above = std::upper_bound(arc_.begin() + 1, arc_.end() - 1, arc);
    const auto i = static_cast<std::size_t>(above - arc_.begin()) - 1;
    const double from = cell_ * static_cast<double>(i);
    double q = from + cell_ * (arc - arc_[i]) / (arc_[i + 1] - arc_[i]);
    for (int k = 0; k < 4; ++k) q -= (arc_[i] + integral(from, q) - arc) / speed_(q);
    return q;
  }

 private:
  [[nodiscard]] double integral(double from, double to) const {
    constexpr std::array kNode{0.0, 0.53846931010568309, 0.90617984593866399};
    constexpr std::array kWeight{0.56888888888888889, 0.47862867049936647, 0.23692688505618909};
    const double middle = 0.5 * (from + to), half = 0.5 * (to - from);
    double sum = kWeight[0] * speed_(middle);
    for (std::size_t i = 1; i < kNode.size(); ++i)
      sum += kWeight[i] * (speed_(middle - half * kNode[i]) + speed_(middle + half * kNode[i]));
    return half * sum;
  }

  std::function<double(double)> speed_;
  double cell_;
  std::vector<double> arc_;
};

Curve square(const ShapeOptions& o) {
  const double half = o.size / 2, r = o.blend, side = o.size - 2 * r, quarter = side + pi / 2 * r;
  const auto at = [=](double arc) {
    const double quarters = std::min(std::floor(arc / quarter), 3.0), along = arc - quarters * quarter;
    CurvePoint p;
    if (along <= side || r == 0) {
      p = {{r - half + along, -half}, {1, 0}};
    } else {
      const double turned = (along - side) / r;
      p.tangent = {std::cos(turned), std::sin(turned)};
      p.position = Vector2d(half - r, r - half) + r * Vector2d(p.tangent.y(), -p.tangent.x());
    }
    // Each quarter is the previous one, turned to the left.
    for (int k = 0; k < static_cast<int>(quarters); ++k) {
      p.position = Vector2d(-p.position.y(), p.position.x());
      p.tangent = Vector2d(-p.tangent.y(), p.tangent.x());
    }
    return p;
  };
  return {4 * quarter, at, true};
}

Curve circle(const ShapeOptions& o) {
  const double r = o.size / 2;
  return {2 * pi * r,
          [=](double arc) {
            const double c = std::cos(arc / r), s = std::sin(arc / r);
            return CurvePoint{{r * c, r * s}, {-s, c}};
          },
          true};
}

Curve line(const ShapeOptions& o) {
  const Vector2d direction(std::cos(o.angle), std::sin(o.angle));
  return {2 * o.size,
          [=](double arc) {
            const bool there = arc < o.size;
            const double along = (there ? arc : 2 * o.size - arc) - o.size / 2;
            return CurvePoint{along * direction, there ? direction : Vector2d(-direction)};
          },
          true, true};
}

Curve figure8(const ShapeOptions& o) {
  const double a = o.size / 2;
  const ArcLength arc_length([=](double q) { return a * std::hypot(std::cos(q), std::cos(2 * q)); }, 2 * pi, 256);
  return {arc_length.length(),
          [=](double arc) {
            const double q = arc_length.parameter_at(arc);
            return CurvePoint{a * std::sin(q) * Vector2d(1, std::cos(q)),
                              Vector2d(std::cos(q), std::cos(2 * q)).normalized()};
          },
          true};
}

Curve reach(const ShapeOptions& o) {
  const Vector2d direction(std::cos(o.angle), std::sin(o.angle));
  return {o.size, [=](double arc) { return CurvePoint{arc * direction, direction}; }, false};
}

Curve spiral(const ShapeOptions& o) {
  const double end = 2 * pi * o.turns, growth = o.size / 2 / end;  // r = growth q
  const ArcLength arc_length([=](double q) { return growth * std::hypot(1, q); }, end, 64 * o.turns);
  return {arc_length.length(),
          [=](double arc) {
            const double q = arc_length.parameter_at(arc), c = std::cos(q), s = std::sin(q);
            return CurvePoint{growth * q * Vector2d(c, s), Vector2d(c - q * s, s + q * c).normalized()};
          },
          false};
}

/// Returns q and dq/du of a movement at a constant rate between rests: q from 0 to `end` over u in [0, 1], with a
/// minimum-jerk blend of the rate over `ramp` at both ends.
std::pair<double, double> even_between_rests(double u, double end, double ramp) {
  const double rate = end / (1 - ramp);
  const auto from_rest = [&](double since) {
    const double x = since / ramp;
    // Up to x = 1 this is the integral of MinJerk::s; after that the rate is constant.
    return x < 1 ? std::pair{rate * ramp * x * x * x * x * (2.5 + x * (x - 3)), rate * MinJerk::at(x).s}
                 : std::pair{rate * (since - 0.5 * ramp), rate};
  };
  if (u <= 0.5) return from_rest(u);
  const auto [left, slope] = from_rest(1 - u);
  return {end - left, slope};
}

Curve script(const ShapeOptions& o) {
  constexpr double kLoops = 11, kRamp = 1.0 / 12, kEnd = 2 * pi * kLoops;
  const double a = o.size / 12, b = o.size / 8, c = (o.size - 2 * a) / kEnd;
  const auto derivative = [=](double q) { return Vector2d(c + a * std::cos(q), b * std::sin(q)); };
  const ArcLength arc_length([=](double q) { return derivative(q).norm(); }, kEnd, 64 * static_cast<int>(kLoops));
  return {
      .length = arc_length.length(),
      .at =
          [=](double arc) {
            const double q = arc_length.parameter_at(arc);
            return CurvePoint{{c * (q - kEnd / 2) + a * std::sin(q), -b * std::cos(q)}, derivative(q).normalized()};
          },
      .closed = false,
      .pace =
          [=](double u) {
            const auto [q, rate] = even_between_rests(u, kEnd, kRamp);
            return Progress{arc_length.at(q) / arc_length.length(), rate * derivative(q).norm() / arc_length.length()};
          }};
}

using MakeCurve = Curve (*)(const ShapeOptions&);
constexpr std::array<std::pair<const char*, MakeCurve>, 7> kShapes{{{"square", square},
                                                                    {"circle", circle},
                                                                    {"line", line},
                                                                    {"figure8", figure8},
                                                                    {"reach", reach},
                                                                    {"spiral", spiral},
                                                                    {"script", script}}};

void check_option(const char* option, double value, double least, double most, const char* unit) {
  if (!(value >= least && value <= most))
    throw input_error(
        fmt::format("shape: {} is {:.6g}{}; it must be {:.6g} to {:.6g}{}", option, value, unit, least, most, unit));
}

void check(std::string_view name, const ShapeOptions& o) {
  check_option("size", o.size, 1e-6, 10, " m");
  check_option("duration", o.duration, 1e-3, 1e6, " s");
  check_option("rate", o.rate_hz, 10, 20000, " Hz");
  check_option("turns", o.turns, 1, name == "reach" || name == "script" ? 1 : 10000, "");
  if (name == "square") check_option("blend", o.blend, 0, o.size / 2, " m");
  for (const double c : o.centre) check_option("centre", c, -10, 10, " m");
  check_option("angle", o.angle, -1e3, 1e3, " rad");
}

}  // namespace

std::pair<Vec3, Vec3> plane_axes(std::string_view plane) {
  if (plane == "xy") return {Vec3::UnitX(), Vec3::UnitY()};
  if (plane == "yz") return {Vec3::UnitY(), Vec3::UnitZ()};
  if (plane == "zx") return {Vec3::UnitZ(), Vec3::UnitX()};
  throw input_error(fmt::format("shape: plane is '{}'; it must be xy, yz or zx", plane));
}

std::vector<std::string> shape_names() {
  std::vector<std::string> names;
  for (const auto& shape : kShapes) names.emplace_back(shape.first);
  return names;
}

Path make_shape(std::string_view name, const ShapeOptions& options) {
  const auto shape = std::find_if(kShapes.begin(), kShapes.end(), [&](const auto& s) { return name == s.first; });
  if (shape == kShapes.end())
    throw input_error(fmt::format("shape '{}' is not known; known: {}", name, fmt::join(shape_names(), ", ")));
  check(name, options);
  const auto [right, up] = plane_axes(options.plane);

  const double total = options.duration * options.turns, steps = std::max(2.0, std::round(total * options.rate_hz));
  if (steps > kMostSamples)
    throw input_error(fmt::format("shape: duration * turns * rate is {:.3g} samples; at most {:.0e} are possible",
                                  steps, kMostSamples));

  const Curve curve = shape->second(options);
  const double laps = curve.closed ? options.turns : 1;
  const double movements = curve.rests_halfway ? 2 * laps : 1;  // from rest to rest

  Path path;
  path.name = shape->first;
  const auto count = static_cast<std::size_t>(steps) + 1;
  path.time.reserve(count);
  path.position.reserve(count);
  path.velocity.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double u = static_cast<double>(i) / steps;
    double lap = laps * u, rate = laps / total;  // laps done and laps per second
    if (!options.constant_speed && curve.pace) {
      const Progress progress = curve.pace(u);
      lap = progress.lap;
      rate = progress.rate / total;
    } else if (!options.constant_speed) {
      const double before = std::floor(movements * u);
      const MinJerk movement = MinJerk::at(movements * u - before);
      lap = laps * (before + movement.s) / movements;
      rate *= movement.ds;
    }
    const double arc = (curve.closed ? lap - std::floor(lap) : lap) * curve.length;
    const CurvePoint p = curve.at(arc);
    const Vector2d v = rate * curve.length * p.tangent;
    path.time.push_back(total * u);
    path.position.push_back(options.centre + p.position.x() * right + p.position.y() * up);
    path.velocity.push_back(v.x() * right + v.y() * up);
  }
  return path;
}

}  // namespace haptrace
