#include "scene/shape/mesh_topology.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace haptrace {
namespace {

/// The edge of a triangle from corner i to i + 1, in the list of the lower of its vertices.
struct HalfEdge {
  std::uint32_t other;  ///< the higher vertex
  std::uint32_t triangle;
  std::uint8_t corner;
  bool forwards;  ///< from the lower vertex to the higher one
};

/// Returns the angle of a triangle at a corner [rad].
double angle_at(const Face& face, std::size_t corner) {
  const Vec3 ab = face.corners[(corner + 1) % 3] - face.corners[corner];
  const Vec3 ac = face.corners[(corner + 2) % 3] - face.corners[corner];
  return std::atan2(face.double_area, ab.dot(ac));
}

void join(TriangleTree& tree, const HalfEdge& one, const HalfEdge& other) {
  tree.face(one.triangle).neighbours[one.corner] = other.triangle;
  tree.face(other.triangle).neighbours[other.corner] = one.triangle;
}

/// Joins the triangles at an edge in pairs. Returns how many stay without a neighbour.
std::size_t join_edge(TriangleTree& tree, HalfEdge* edges, std::size_t count) {
  if (count == 2 && edges[0].forwards != edges[1].forwards) {
    join(tree, edges[0], edges[1]);
    return 0;
  }
  if (count < 4 || count % 2 != 0) return count;
  // In the order of their angles around the edge, the outside lies between one that runs forwards and the next, which
  // runs backwards.
  struct Wing {
    HalfEdge edge;
    double angle;
  };
  const Face& first = tree.face(edges[0].triangle);
  const Vec3 &low = first.corners[edges[0].corner], &high = first.corners[(edges[0].corner + 1U) % 3];
  const Vec3 axis = ((edges[0].forwards ? 1 : -1) * (high - low)).stableNormalized();
  const Vec3 x = axis.unitOrthogonal(), y = axis.cross(x);
  std::vector<Wing> wings;
  for (std::size_t i = 0; i < count; ++i) {
    const Face& face = tree.face(edges[i].triangle);
    const Vec3 out = face.corners[(edges[i].corner + 2U) % 3] - low;
    wings.push_back({edges[i], std::atan2(out.dot(y), out.dot(x))});
  }
  std::sort(wings.begin(), wings.end(), [](const Wing& a, const Wing& b) {
    return a.angle != b.angle ? a.angle < b.angle : a.edge.forwards > b.edge.forwards;
  });
  for (std::size_t i = 0; i < count; ++i)
    if (wings[i].edge.forwards == wings[(i + 1) % count].edge.forwards) return count;
  for (std::size_t i = 0; i < count; ++i)
    if (wings[i].edge.forwards) join(tree, wings[i].edge, wings[(i + 1) % count].edge);
  return 0;
}

/// Joins all triangles at their edges. Returns how many edges of triangles stay without a neighbour.
std::size_t join_edges(const TriangleMesh& mesh, TriangleTree& tree) {
  const std::size_t vertices = mesh.vertices.size();
  std::vector<std::uint32_t> first(vertices + 1, 0);  // of the edges at every lower vertex
  for (const auto& t : mesh.triangles)
    for (std::size_t i = 0; i < 3; ++i) ++first[std::min(t[i], t[(i + 1) % 3]) + 1];
  for (std::size_t v = 0; v < vertices; ++v) first[v + 1] += first[v];
  std::vector<HalfEdge> edges(first.back());
  std::vector<std::uint32_t> next(first.begin(), first.end() - 1);
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t)
    for (std::uint8_t i = 0; i < 3; ++i) {
      const std::uint32_t from = mesh.triangles[t][i], to = mesh.triangles[t][(i + 1U) % 3];
      edges[next[std::min(from, to)]++] = {std::max(from, to), t, i, from < to};
    }
  std::size_t open = 0;
  for (std::size_t v = 0; v < vertices; ++v) {
    HalfEdge* const begin = edges.data() + first[v];
    HalfEdge* const end = edges.data() + first[v + 1];
    std::sort(begin, end, [](const HalfEdge& a, const HalfEdge& b) {
      return a.other != b.other ? a.other < b.other : a.triangle < b.triangle;
    });
    for (HalfEdge* at = begin; at != end;) {
      HalfEdge* same = at + 1;
      while (same != end && same->other == at->other) ++same;
      open += join_edge(tree, at, static_cast<std::size_t>(same - at));
      at = same;
    }
  }
  return open;
}

/// Numbers the fans of triangles around the vertices: a vertex at which surfaces only touch has several. Returns how
/// many there are.
std::uint32_t number_fans(const TriangleMesh& mesh, TriangleTree& tree) {
  std::uint32_t fans = 0;
  for (std::uint32_t t = 0; t < tree.size(); ++t) tree.face(t).vertices.fill(Face::kNone);
  for (std::uint32_t t = 0; t < tree.size(); ++t)
    for (std::size_t i = 0; i < 3; ++i) {
      if (tree.face(t).vertices[i] != Face::kNone) continue;
      const std::uint32_t vertex = mesh.triangles[t][i], fan = fans++;
      tree.face(t).vertices[i] = fan;
      // Around it both ways: over the edges that begin and that end at the vertex.
      for (const std::size_t turn : {std::size_t{0}, std::size_t{2}}) {
        std::uint32_t at = tree.face(t).neighbours[(i + turn) % 3];
        while (at != Face::kNone) {
          const auto& corners = mesh.triangles[at];
          const auto corner =
              static_cast<std::size_t>(std::find(corners.begin(), corners.end(), vertex) - corners.begin());
          if (tree.face(at).vertices[corner] != Face::kNone) break;
          tree.face(at).vertices[corner] = fan;
          at = tree.face(at).neighbours[(corner + turn) % 3];
        }
      }
    }
  return fans;
}

}  // namespace

MeshTopology::MeshTopology(const TriangleMesh& mesh, TriangleTree& tree) {
  open_edges = join_edges(mesh, tree);
  const std::uint32_t fans = number_fans(mesh, tree);
  first_of.assign(std::size_t{fans} + 1, 0);
  vertex_normals.assign(fans, Vec3::Zero());
  for (std::uint32_t t = 0; t < tree.size(); ++t) {
    const Face& face = tree.face(t);
    for (std::size_t i = 0; i < 3; ++i) {
      ++first_of[face.vertices[i] + 1];
      vertex_normals[face.vertices[i]] += angle_at(face, i) * face.normal;
    }
  }
  for (Vec3& normal : vertex_normals) normal = normal.stableNormalized();
  for (std::size_t v = 0; v < fans; ++v) first_of[v + 1] += first_of[v];
  around.resize(3 * std::size_t{tree.size()});
  std::vector<std::uint32_t> next(first_of.begin(), first_of.end() - 1);
  for (std::uint32_t t = 0; t < tree.size(); ++t)
    for (const std::uint32_t vertex : tree.face(t).vertices) around[next[vertex]++] = t;
}

}  // namespace haptrace
