// The solids of the tests, with knowledge of their surfaces that does not come from the shapes themselves.
#pragma once

#include "base/json_reader.h"
#include "base/triangle_mesh.h"
#include "scene/shape/shape.h"
#include "scene/shape/shape_kinds.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <functional>
#include <map>
#include <memory>
#include <string>

namespace haptrace::test {

/// Returns a shape, as in a scene file.
inline std::unique_ptr<Shape> shape_of(const std::string& json) {
  const nlohmann::json object = parse_json(json, "test");
  JsonReader reader(object, "test");
  SceneFiles files;
  const ShapeKind& kind = read_kind(reader);
  std::unique_ptr<Shape> shape = kind.read(reader, files);
  reader.finish();
  shape->prepare(0);
  return shape;
}

using Distance = std::function<double(const Vec3&)>;

inline Distance box_distance(const Vec3& half) {
  return [half](const Vec3& p) {
    const Vec3 q = p.cwiseAbs() - half;
    return q.cwiseMax(0).norm() + std::min(q.maxCoeff(), 0.0);
  };
}

inline Distance cylinder_distance(double radius, double height) {
  return [=](const Vec3& p) {
    const double a = std::sqrt(p.x() * p.x() + p.y() * p.y()) - radius, b = std::abs(p.z()) - height / 2;
    return std::min(std::max(a, b), 0.0) + std::sqrt(std::pow(std::max(a, 0.0), 2) + std::pow(std::max(b, 0.0), 2));
  };
}

/// Distance from two line segments in the half plane of the meridian, with the sign of the place.
inline Distance cone_distance(double radius, double height) {
  return [=](const Vec3& p) {
    const double rho = std::sqrt(p.x() * p.x() + p.y() * p.y());
    const auto from_segment = [&](double ax, double ay, double bx, double by) {
      const double dx = bx - ax, dy = by - ay;
      const double t = std::clamp(((rho - ax) * dx + (p.z() - ay) * dy) / (dx * dx + dy * dy), 0.0, 1.0);
      return std::hypot(rho - ax - t * dx, p.z() - ay - t * dy);
    };
    const double least = std::min(from_segment(0, 0, radius, 0), from_segment(radius, 0, 0, height));
    return p.z() > 0 && rho < radius * (1 - p.z() / height) ? -least : least;
  };
}

inline Distance torus_distance(double radius, double tube) {
  return [=](const Vec3& p) {
    return std::sqrt(std::pow(std::sqrt(p.x() * p.x() + p.y() * p.y()) - radius, 2) + p.z() * p.z()) - tube;
  };
}

/// By Newton's method, in long double: the excess of |x / a|^2 over 1 falls with l, and is convex.
inline Distance ellipsoid_distance(const Vec3& radii) {
  return [radii](const Vec3& p) {
    using Real = long double;
    Real l = -1;
    for (int i = 0; i < 3; ++i) l = std::max<Real>(l, Real(radii[i]) * (std::abs(p[i]) - Real(radii[i])));
    for (int step = 0; step < 100; ++step) {
      Real excess = -1, slope = 0;
      for (int i = 0; i < 3; ++i) {
        const Real a = radii[i], u = a * p[i] / (a * a + l);
        excess += u * u;
        slope -= 2 * u * u / (a * a + l);
      }
      if (!(excess > 1e-18L) || !(slope < 0)) break;
      l -= excess / slope;
    }
    Real square = 0;
    for (int i = 0; i < 3; ++i) {
      const Real away = l * p[i] / (Real(radii[i]) * radii[i] + l);
      square += away * away;
    }
    const bool inside = p.cwiseQuotient(radii).squaredNorm() < 1;
    return static_cast<double>(inside ? -std::sqrt(square) : std::sqrt(square));
  };
}

/// A solid whose signed distance is known.
struct SolidCase {
  std::string name;
  std::string json;
  Distance distance;  ///< [m], negative inside
  double thin = 0;    ///< smallest length of the solid [m]
  double wide = 0;    ///< largest distance of the solid from the origin [m]
};

inline void PrintTo(const SolidCase& solid, std::ostream* out) {
  *out << solid.name;
}

inline std::vector<SolidCase> every_solid() {
  const auto at = [](const Vec3& centre, Distance distance) -> Distance {
    return [centre, distance = std::move(distance)](const Vec3& p) { return distance(p - centre); };
  };
  const auto disc = Vec3(0.03, 0.02, 0.0005);
  return {
      {"Box", R"({"kind": "box", "size": [0.06, 0.04, 0.05]})", box_distance({0.03, 0.02, 0.025}), 0.04, 0.05},
      {"BoxElsewhere", R"({"kind": "box", "size": 0.05, "centre": [0.01, -0.02, 0.005]})",
       at({0.01, -0.02, 0.005}, box_distance(Vec3::Constant(0.025))), 0.05, 0.07},
      {"PlateBox", R"({"kind": "box", "size": [0.06, 0.05, 0.001]})", box_distance({0.03, 0.025, 0.0005}), 0.001, 0.04},
      {"Cylinder", R"({"kind": "cylinder", "radius": 0.025, "height": 0.06})", cylinder_distance(0.025, 0.06), 0.05,
       0.04},
      {"DiscCylinder", R"({"kind": "cylinder", "radius": 0.03, "height": 0.001})", cylinder_distance(0.03, 0.001),
       0.001, 0.03},
      {"RodCylinder", R"({"kind": "cylinder", "radius": 0.001, "height": 0.06})", cylinder_distance(0.001, 0.06), 0.002,
       0.03},
      {"Cone", R"({"kind": "cone", "radius": 0.03, "height": 0.05})", cone_distance(0.03, 0.05), 0.03, 0.05},
      {"FlatCone", R"({"kind": "cone", "radius": 0.03, "height": 0.002})", cone_distance(0.03, 0.002), 0.001, 0.03},
      {"SteepCone", R"({"kind": "cone", "radius": 0.004, "height": 0.06, "centre": [0.01, 0, 0]})",
       at({0.01, 0, 0}, cone_distance(0.004, 0.06)), 0.004, 0.06},
      {"Torus", R"({"kind": "torus", "radius": 0.03, "tube": 0.01})", torus_distance(0.03, 0.01), 0.02, 0.04},
      {"TightTorus", R"({"kind": "torus", "radius": 0.02, "tube": 0.018})", torus_distance(0.02, 0.018), 0.02, 0.04},
      {"Ball", R"({"kind": "ellipsoid", "radii": 0.03})", ellipsoid_distance(Vec3::Constant(0.03)), 0.06, 0.03},
      {"Ellipsoid", R"({"kind": "ellipsoid", "radii": [0.02, 0.03, 0.04]})", ellipsoid_distance({0.02, 0.03, 0.04}),
       0.04, 0.04},
      {"DiscEllipsoid", R"({"kind": "ellipsoid", "radii": [0.03, 0.02, 0.0005]})", ellipsoid_distance(disc), 0.001,
       0.03},
      {"RoundDiscEllipsoid", R"({"kind": "ellipsoid", "radii": [0.002, 0.03, 0.03]})",
       ellipsoid_distance({0.002, 0.03, 0.03}), 0.004, 0.03},
      {"RodEllipsoid", R"({"kind": "ellipsoid", "radii": [0.003, 0.003, 0.04]})",
       ellipsoid_distance({0.003, 0.003, 0.04}), 0.006, 0.04},
  };
}

/// Returns the gradient by central differences.
inline Vec3 gradient_of(const Distance& f, const Vec3& p, double h) {
  Vec3 gradient;
  for (int i = 0; i < 3; ++i) gradient[i] = (f(p + h * Vec3::Unit(i)) - f(p - h * Vec3::Unit(i))) / (2 * h);
  return gradient;
}

/// A god object that is moved by brute force: short steps towards the tool, and out of the solid by its distance
/// function. Slow, and knows nothing but this function.
class GodObject {
 public:
  /// `step`: longest move, well below the thinnest part of the solid [m].
  GodObject(Distance distance, double step) : distance_(std::move(distance)), step_(step) {}

  /// Takes the god object along with a step of the tool. Returns where it is.
  Vec3 follow(const Vec3& from, const Vec3& to) {
    if (free_) place_ = from;
    for (int i = 0; i < kMostMoves; ++i) {
      Vec3 move = to - place_;
      // On the surface, only along it: a move into the solid could leave it through another face.
      const double off = distance_(place_);
      double longest = step_;
      if (off < kOn) {
        const Vec3 normal = gradient_of(distance_, place_, kOn).stableNormalized();
        const double into = move.dot(normal);
        if (into < 0) {
          move = 0.5 * (move - into * normal);
          holds_ = true;
        } else {
          holds_ = false;
        }
      } else {
        holds_ = false;
        longest = off;  // up to where it may hit
      }
      left_ = move.norm();
      if (left_ < kSettled) break;
      if (left_ > longest) move *= longest / left_;
      place_ += move;
      for (int push = 0; push < 8; ++push) {
        const double outside = distance_(place_);
        if (outside >= 0) break;
        place_ -= outside * gradient_of(distance_, place_, kOn).stableNormalized();
      }
    }
    free_ = !holds_ && settled();
    return place_;
  }
  /// Takes the god object elsewhere, to see whether it stays there.
  void put(const Vec3& place) {
    place_ = place;
    free_ = false;
  }
  /// Returns whether it has arrived, after so many moves.
  [[nodiscard]] bool settled() const { return left_ < kSettled; }

 private:
  static constexpr int kMostMoves = 3000;
  static constexpr double kOn = 1e-9, kSettled = 1e-8;  // [m]
  Distance distance_;
  double step_, left_ = 0;
  Vec3 place_ = Vec3::Zero();
  bool holds_ = false, free_ = true;
};

/// Returns how often each edge of a mesh is used in its direction, minus how often against it: all zero when closed.
inline bool closed(const TriangleMesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  for (const auto& t : mesh.triangles)
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t a = t[i], b = t[(i + 1) % 3];
      edges[std::minmax(a, b)] += a < b ? 1 : -1;
    }
  return !mesh.triangles.empty() &&
         std::all_of(edges.begin(), edges.end(), [](const auto& e) { return e.second == 0; });
}

/// Returns the volume inside a closed mesh [m^3]: positive if its triangles look outwards.
inline double volume(const TriangleMesh& mesh) {
  double sum = 0;
  for (const auto& t : mesh.triangles)
    sum += mesh.vertices[t[0]].dot(mesh.vertices[t[1]].cross(mesh.vertices[t[2]])) / 6;
  return sum;
}

}  // namespace haptrace::test
