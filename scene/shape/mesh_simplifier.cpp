#include "scene/shape/mesh_simplifier.h"

#include "control/norm.h"

#include <algorithm>
#include <cmath>
#include <meshoptimizer.h>
#include <numeric>
#include <set>
#include <unordered_map>
#include <utility>

namespace haptrace {
namespace {

constexpr double kBoldest = 0.25;      // share of the triangles that a stage keeps at least
constexpr double kMostCareful = 0.97;  // and at most, before no more stage is tried
constexpr int kMostAttempts = 8;       // at a stage
constexpr double kKnife = -0.985;      // cosine between the normals at an edge of 10 degrees

/// The places where a mesh is broken: its vertices.
using Faults = std::vector<std::uint32_t>;

/// A mesh in which every vertex has one fan of triangles, and what must stay as it is.
class Sound {
 public:
  Sound(const TriangleTree& tree, const MeshTopology& topology)
      : whole_(tree), closed_(topology.open_edges == 0), on_border_(topology.vertex_normals.size(), false) {
    const auto vertices = static_cast<std::uint32_t>(on_border_.size());
    mesh_.vertices.resize(vertices);
    part_of_.resize(vertices);
    std::iota(part_of_.begin(), part_of_.end(), 0U);
    for (std::uint32_t t = 0; t < tree.size(); ++t) {
      const Face& face = tree.face(t);
      mesh_.triangles.push_back(face.vertices);
      for (std::size_t i = 0; i < 3; ++i) {
        const std::uint32_t from = face.vertices[i], to = face.vertices[(i + 1) % 3];
        mesh_.vertices[from] = face.corners[i];
        size_ = std::max(size_, face.corners[i].cwiseAbs().maxCoeff());
        if (face.neighbours[i] == Face::kNone) on_border_[from] = on_border_[to] = true;
        part_of_[root(from)] = root(to);
      }
    }
    for (std::uint32_t v = 0; v < vertices; ++v) part_of_[v] = root(v);
    characteristic_ = characteristics(mesh_.triangles, edges_of(mesh_.triangles));
    sharpest_ = std::min(kKnife, sharpest_edge(tree) - 1e-9);
    if (closed_)
      for (std::uint32_t t = 0; t < tree.size(); ++t) sides_.insert(sides_of(tree, t));
  }

  [[nodiscard]] const TriangleMesh& mesh() const noexcept { return mesh_; }

  /// Returns the vertices where other triangles over the same vertices are not sound; none if they are.
  [[nodiscard]] Faults faults_of(const std::vector<std::array<std::uint32_t, 3>>& triangles) const {
    Faults faults;
    const auto add = [&](const std::array<std::uint32_t, 3>& t) { faults.insert(faults.end(), t.begin(), t.end()); };
    for (const auto& t : triangles)
      if (is_flat(mesh_, t)) add(t);
    const std::vector<Edge> edges = edges_of(triangles);
    for (std::size_t i = 0, end = 0; i < edges.size(); i = end) {
      const Edge& edge = edges[i];
      while (end < edges.size() && edges[end].low == edge.low && edges[end].high == edge.high) ++end;
      const bool joined = end - i == 2 && edge.forwards != edges[i + 1].forwards;
      const bool border = end - i == 1 && on_border_[edge.low] && on_border_[edge.high];
      if (!joined && !border) faults.insert(faults.end(), {edge.low, edge.high});
    }
    if (!faults.empty()) return faults;

    TriangleMesh mesh{mesh_.vertices, triangles};
    TriangleTree tree(mesh);
    const MeshTopology topology(mesh, tree);
    std::vector<std::uint32_t> fan_of(mesh.vertices.size(), Face::kNone);
    for (std::uint32_t t = 0; t < tree.size(); ++t) {
      const Face& face = tree.face(t);
      for (std::size_t i = 0; i < 3; ++i) {
        std::uint32_t& fan = fan_of[mesh.triangles[t][i]];
        if (fan == Face::kNone) fan = face.vertices[i];
        if (fan != face.vertices[i]) faults.push_back(mesh.triangles[t][i]);
        if (sharpness(tree, t, i) < sharpest_) add(mesh.triangles[t]);
      }
      if (closed_ ? !sides_.contains(sides_of(tree, t)) : !faces_as_before(face)) add(mesh.triangles[t]);
    }
    if (!faults.empty()) return faults;
    // No single place is to blame.
    const std::vector<Characteristic> now = characteristics(triangles, edges);
    for (std::uint32_t v = 0; v < part_of_.size(); ++v)
      if (now[part_of_[v]] != characteristic_[part_of_[v]]) faults.push_back(v);
    return faults;
  }

 private:
  struct Edge {
    std::uint32_t low, high;
    bool forwards;
  };
  /// Returns the edges of all triangles, those between the same vertices one after another.
  static std::vector<Edge> edges_of(const std::vector<std::array<std::uint32_t, 3>>& triangles) {
    std::vector<Edge> edges;
    edges.reserve(3 * triangles.size());
    for (const auto& t : triangles)
      for (std::size_t i = 0; i < 3; ++i) {
        const std::uint32_t from = t[i], to = t[(i + 1) % 3];
        edges.push_back({std::min(from, to), std::max(from, to), from < to});
      }
    std::sort(edges.begin(), edges.end(),
              [](const Edge& a, const Edge& b) { return a.low != b.low ? a.low < b.low : a.high < b.high; });
    return edges;
  }

  /// Euler's characteristic of a part: it changes if a hole through it or in it closes.
  struct Characteristic {
    bool exists = false;
    int value = 0;
    bool operator==(const Characteristic&) const = default;
  };
  [[nodiscard]] std::vector<Characteristic> characteristics(const std::vector<std::array<std::uint32_t, 3>>& triangles,
                                                            const std::vector<Edge>& edges) const {
    std::vector<Characteristic> parts(part_of_.size());
    std::vector<bool> used(part_of_.size(), false);
    for (const auto& t : triangles) {
      Characteristic& part = parts[part_of_[t[0]]];
      part.exists = true;
      ++part.value;
      for (const std::uint32_t vertex : t) {
        part.value += used[vertex] ? 0 : 1;
        used[vertex] = true;
      }
    }
    for (std::size_t i = 0; i < edges.size(); ++i)
      if (i == 0 || edges[i].low != edges[i - 1].low || edges[i].high != edges[i - 1].high)
        --parts[part_of_[edges[i].low]].value;
    return parts;
  }

  std::uint32_t root(std::uint32_t vertex) {
    while (part_of_[vertex] != vertex) vertex = part_of_[vertex] = part_of_[part_of_[vertex]];
    return vertex;
  }

  /// Returns the cosine between the normals at an edge; 1 at an open one.
  static double sharpness(const TriangleTree& tree, std::uint32_t triangle, std::size_t edge) {
    const Face& face = tree.face(triangle);
    const std::uint32_t other = face.neighbours[edge];
    return other == Face::kNone ? 1 : face.normal.dot(tree.face(other).normal);
  }
  static double sharpest_edge(const TriangleTree& tree) {
    double least = 1;
    for (std::uint32_t t = 0; t < tree.size(); ++t)
      for (std::size_t i = 0; i < 3; ++i) least = std::min(least, sharpness(tree, t, i));
    return least;
  }

  /// Returns how many times the mesh winds around places just in front of a triangle and just behind it.
  [[nodiscard]] std::pair<int, int> sides_of(const TriangleTree& tree, std::uint32_t triangle) const {
    const Face& face = tree.face(triangle);
    const Vec3 middle = (face.corners[0] + face.corners[1] + face.corners[2]) / 3;
    const Vec3 out = 1e4 * std::numeric_limits<double>::epsilon() * size_ * face.normal;
    return {tree.winding(middle + out), tree.winding(middle - out)};
  }

  /// Returns whether a triangle faces the same way as the whole mesh beside its middle.
  [[nodiscard]] bool faces_as_before(const Face& face) const {
    const Vec3 middle = (face.corners[0] + face.corners[1] + face.corners[2]) / 3;
    return face.normal.dot(whole_.face(whole_.nearest(middle).triangle).normal) > 0;
  }

  const TriangleTree& whole_;
  TriangleMesh mesh_;
  bool closed_;
  std::vector<bool> on_border_;
  std::vector<std::uint32_t> part_of_;  // a vertex of the part that a vertex belongs to
  std::vector<Characteristic> characteristic_;
  double size_ = 0;  // [m]
  double sharpest_ = 1;
  std::set<std::pair<int, int>> sides_;
};

/// Simplifies the triangles of a mesh in stages, because a result that is checked often has few faults. Around the
/// faults of a stage the triangles are left as they are, and the others are simplified once more.
class Simplifier {
 public:
  explicit Simplifier(const Sound& sound) : sound_(sound), triangles_(sound.mesh().triangles) {
    Box box;
    for (const Vec3& vertex : sound.mesh().vertices) box.include(vertex);
    const Vec3 middle = 0.5 * (box.min + box.max);
    const double size = box.size().maxCoeff();
    for (const Vec3& vertex : sound.mesh().vertices) {
      const Eigen::Vector3f place = ((vertex - middle) / size).cast<float>();
      places_.insert(places_.end(), {place.x(), place.y(), place.z()});
    }
  }

  void reduce_to(std::size_t most) {
    for (double share = kBoldest; triangles_.size() > most && share < kMostCareful;) {
      const auto before = static_cast<double>(triangles_.size());
      reduce_once(std::max(most, static_cast<std::size_t>(share * before)));
      const bool good = before - static_cast<double>(triangles_.size()) >= 0.5 * (1 - share) * before;
      share = good ? std::max(kBoldest, share * share) : std::sqrt(share);
    }
  }

  [[nodiscard]] const std::vector<std::array<std::uint32_t, 3>>& triangles() const noexcept { return triangles_; }

 private:
  using Triangles = std::vector<std::array<std::uint32_t, 3>>;

  /// Goes towards this number of triangles. They stay as they are if every attempt breaks the mesh.
  void reduce_once(std::size_t most) {
    std::vector<bool> kept(sound_.mesh().vertices.size(), false);
    for (int attempt = 0; attempt < kMostAttempts; ++attempt) {
      Triangles rest, result;
      for (const auto& t : triangles_) (kept[t[0]] || kept[t[1]] || kept[t[2]] ? result : rest).push_back(t);
      if (rest.size() < result.size()) return;
      // The others do not make up for those that are kept: a later stage may.
      collapse(rest, rest.size() * most / triangles_.size(), !result.empty());
      result.insert(result.end(), rest.begin(), rest.end());
      turn_edges_of_flat(result);
      const Faults faults = sound_.faults_of(result);
      if (faults.empty()) {
        triangles_ = std::move(result);
        return;
      }
      keep_around(faults, attempt, kept);
    }
  }

  /// The simplifier leaves triangles without an area on flat ground: a vertex on the edge of a neighbour. The edge
  /// turns to the opposite corner of the neighbour, which changes no place of the surface.
  void turn_edges_of_flat(Triangles& triangles) const {
    constexpr int kMostRounds = 8;
    for (int round = 0; round < kMostRounds; ++round) {
      std::vector<std::uint32_t> flat;
      for (std::uint32_t t = 0; t < triangles.size(); ++t)
        if (is_flat(sound_.mesh(), triangles[t])) flat.push_back(t);
      if (flat.empty()) return;
      const auto key = [](std::uint32_t from, std::uint32_t to) {
        return (static_cast<std::uint64_t>(from) << 32U) | to;
      };
      std::unordered_map<std::uint64_t, std::uint32_t> triangle_at;
      for (std::uint32_t t = 0; t < triangles.size(); ++t)
        for (std::size_t i = 0; i < 3; ++i) triangle_at[key(triangles[t][i], triangles[t][(i + 1) % 3])] = t;
      std::vector<bool> turned(triangles.size(), false);
      for (const std::uint32_t t : flat) {
        const std::size_t longest = longest_edge(triangles[t]);
        const std::uint32_t from = triangles[t][longest], to = triangles[t][(longest + 1) % 3],
                            own = triangles[t][(longest + 2) % 3];
        const auto found = triangle_at.find(key(to, from));
        if (found == triangle_at.end() || turned[t] || turned[found->second]) continue;
        auto& other = triangles[found->second];
        const std::uint32_t opposite = other[0] ^ other[1] ^ other[2] ^ from ^ to;
        if (opposite == own || triangle_at.contains(key(own, opposite)) || triangle_at.contains(key(opposite, own)))
          continue;
        turned[t] = turned[found->second] = true;
        triangles[t] = {own, from, opposite};
        other = {opposite, to, own};
      }
    }
  }

  [[nodiscard]] std::size_t longest_edge(const std::array<std::uint32_t, 3>& t) const {
    const std::vector<Vec3>& place = sound_.mesh().vertices;
    std::array<double, 3> square{};
    for (std::size_t i = 0; i < 3; ++i) square[i] = (place[t[(i + 1) % 3]] - place[t[i]]).squaredNorm();
    return static_cast<std::size_t>(std::max_element(square.begin(), square.end()) - square.begin());
  }

  /// Adds the vertices of faults, and those that are this many edges away from them.
  void keep_around(const Faults& faults, int edges, std::vector<bool>& kept) const {
    std::vector<bool> around(kept.size(), false);
    for (const std::uint32_t vertex : faults) around[vertex] = true;
    for (int edge = 0; edge < edges; ++edge) {
      const std::vector<bool> inner = around;
      for (const auto& t : triangles_)
        if (inner[t[0]] || inner[t[1]] || inner[t[2]]) around[t[0]] = around[t[1]] = around[t[2]] = true;
    }
    for (std::size_t v = 0; v < kept.size(); ++v) kept[v] = kept[v] || around[v];
  }

  void collapse(Triangles& triangles, std::size_t most, bool lock_border) const {
    if (triangles.empty()) return;
    constexpr float kAnyError = 1e9F;
    std::vector<std::uint32_t> corners;
    corners.reserve(3 * triangles.size());
    for (const auto& t : triangles) corners.insert(corners.end(), t.begin(), t.end());
    std::vector<std::uint32_t> result(corners.size());
    const std::size_t count =
        meshopt_simplify(result.data(), corners.data(), corners.size(), places_.data(), places_.size() / 3,
                         3 * sizeof(float), 3 * most, kAnyError, lock_border ? meshopt_SimplifyLockBorder : 0, nullptr);
    triangles.clear();
    for (std::size_t i = 0; i < count; i += 3) triangles.push_back({result[i], result[i + 1], result[i + 2]});
  }

  const Sound& sound_;
  std::vector<float> places_;  // of the vertices, from -0.5 to 0.5
  Triangles triangles_;
};

/// Adds the distances of points of a surface from another to a sum of squares, and finds the largest. The points share
/// the area equally. Returns their number.
std::size_t add_distances(const TriangleTree& from, const TriangleTree& to, double& squares, double& largest2) {
  constexpr std::uint32_t kPoints = 40'000, kCorners = 40'000;
  double area = 0;
  for (std::uint32_t t = 0; t < from.size(); ++t) area += from.face(t).double_area;
  std::size_t count = 0;
  double reached = 0;
  for (std::uint32_t t = 0; t < from.size(); ++t) {
    const Face& face = from.face(t);
    for (reached += face.double_area; (static_cast<double>(count) + 0.5) * area < reached * kPoints; ++count) {
      // Roberts' sequence of plane points, folded into the triangle.
      double unused = 0, u = std::modf(0.7548776662466927 * static_cast<double>(count), &unused),
             v = std::modf(0.5698402909980532 * static_cast<double>(count), &unused);
      if (u + v > 1) {
        u = 1 - u;
        v = 1 - v;
      }
      const Vec3 place =
          face.corners[0] + u * (face.corners[1] - face.corners[0]) + v * (face.corners[2] - face.corners[0]);
      const double distance2 = to.nearest(place).distance2;
      squares += distance2;
      largest2 = std::max(largest2, distance2);
    }
  }
  for (std::uint32_t t = 0; t < from.size(); t += 1 + from.size() / kCorners)
    for (const Vec3& corner : from.face(t).corners) largest2 = std::max(largest2, to.nearest(corner).distance2);
  return count;
}

}  // namespace

TriangleMesh simplified(const TriangleMesh& mesh, const TriangleTree& tree, const MeshTopology& topology,
                        std::size_t most) {
  if (mesh.triangles.size() <= most) return mesh;
  const Sound sound(tree, topology);
  Simplifier simplifier(sound);
  simplifier.reduce_to(most);
  // Parts that touch have the same vertex again.
  std::vector<std::uint32_t> vertex_of(sound.mesh().vertices.size());
  for (std::uint32_t t = 0; t < tree.size(); ++t)
    for (std::size_t i = 0; i < 3; ++i) vertex_of[tree.face(t).vertices[i]] = mesh.triangles[t][i];
  TriangleMesh result;
  std::vector<std::uint32_t> index(mesh.vertices.size(), Face::kNone);
  for (auto triangle : simplifier.triangles()) {
    for (std::uint32_t& corner : triangle) {
      std::uint32_t& at = index[vertex_of[corner]];
      if (at == Face::kNone) {
        at = static_cast<std::uint32_t>(result.vertices.size());
        result.vertices.push_back(mesh.vertices[vertex_of[corner]]);
      }
      corner = at;
    }
    result.triangles.push_back(triangle);
  }
  return result;
}

SurfaceDistance distance_between(const TriangleTree& one, const TriangleTree& other) {
  double squares = 0, largest2 = 0;
  const std::size_t count = add_distances(one, other, squares, largest2) + add_distances(other, one, squares, largest2);
  return {std::sqrt(squares / static_cast<double>(std::max<std::size_t>(1, count))), std::sqrt(largest2)};
}

}  // namespace haptrace
