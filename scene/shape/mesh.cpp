#include "scene/shape/mesh.h"

#include "base/error.h"
#include "control/norm.h"
#include "formats/mesh/mesh_file.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace haptrace {
namespace {

using On = TrianglePoint::On;
constexpr std::uint32_t kNone = MeshTopology::kNone;
constexpr int kLongestWalk = 4096;  // steps; each goes downhill, so only a huge jump needs many
constexpr double kOverlap = 1e-7;   // clearance or overlap of a ball that touches, as a share of its radius
constexpr int kMostParts = 256;     // of the way of a ball in a tick

/// Returns the angle of a triangle at corner i [rad].
double angle_at(const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3 ab = b - a, ac = c - a;
  return std::atan2(ab.cross(ac).norm(), ab.dot(ac));
}

}  // namespace

MeshTopology::MeshTopology(const TriangleMesh& mesh) {
  const std::size_t count = mesh.triangles.size();
  neighbours.assign(count, {kNone, kNone, kNone});
  face_normals.reserve(count);
  vertex_normals.assign(mesh.vertices.size(), Vec3::Zero());
  first_of.assign(mesh.vertices.size() + 1, 0);

  struct Edge {
    std::uint64_t key;
    std::uint32_t triangle;
    std::uint8_t corner;
    bool forwards;
  };
  std::vector<Edge> edges;
  edges.reserve(3 * count);
  for (std::uint32_t t = 0; t < count; ++t) {
    const auto& corners = mesh.triangles[t];
    const Vec3 &a = mesh.vertices[corners[0]], &b = mesh.vertices[corners[1]], &c = mesh.vertices[corners[2]];
    const Vec3 normal = (b - a).cross(c - a).stableNormalized();
    face_normals.push_back(normal);
    for (std::uint8_t i = 0; i < 3; ++i) {
      const std::uint32_t from = corners[i], to = corners[(i + 1U) % 3];
      edges.push_back({(static_cast<std::uint64_t>(std::min(from, to)) << 32U) | std::max(from, to), t, i, from < to});
      vertex_normals[from] +=
          angle_at(mesh.vertices[from], mesh.vertices[to], mesh.vertices[corners[(i + 2U) % 3]]) * normal;
      ++first_of[from + 1];
    }
  }
  for (Vec3& normal : vertex_normals) normal = normal.stableNormalized();
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) first_of[v + 1] += first_of[v];
  around.resize(3 * count);
  std::vector<std::uint32_t> next(first_of.begin(), first_of.end() - 1);
  for (std::uint32_t t = 0; t < count; ++t)
    for (const std::uint32_t corner : mesh.triangles[t]) around[next[corner]++] = t;

  std::sort(edges.begin(), edges.end(),
            [](const Edge& a, const Edge& b) { return std::pair(a.key, a.triangle) < std::pair(b.key, b.triangle); });
  for (std::size_t i = 0; i < edges.size();) {
    std::size_t end = i + 1;
    while (end < edges.size() && edges[end].key == edges[i].key) ++end;
    if (end - i == 2 && edges[i].forwards != edges[i + 1].forwards) {
      neighbours[edges[i].triangle][edges[i].corner] = edges[i + 1].triangle;
      neighbours[edges[i + 1].triangle][edges[i + 1].corner] = edges[i].triangle;
    } else {
      open_edges += end - i;
    }
    i = end;
  }
}

Mesh::Mesh(TriangleMesh mesh, std::vector<std::string> remarks)
    : mesh_(std::move(mesh)), topology_(mesh_), tree_(mesh_), remarks_(std::move(remarks)) {
  for (const Vec3& vertex : mesh_.vertices) bounds_.include(vertex);
}

std::vector<Knob> Mesh::knobs() const {
  return {{"verify", "", {0, 1}, verify_ ? 1.0 : 0.0, 0, 1},
          {"rounds", "", {1, 2, 4, 8}, static_cast<double>(rounds_), 1, 16}};
}

void Mesh::set(const std::string& knob, double level) {
  if (knob == "verify") verify_ = level >= 0.5;
  if (knob == "rounds") rounds_ = static_cast<int>(std::lround(level));
}

void Mesh::follow(const ToolStep& step, Proxy& proxy) const noexcept {
  if (!is_finite(step.to)) return;
  if (step.radius > 0)
    follow_ball(step, proxy);
  else
    follow_point(step, proxy);
}

// --- A point ---

Mesh::Foot Mesh::foot_on(std::uint32_t triangle, const Vec3& place) const noexcept {
  return {triangle,
          closest_on_triangle(place, tree_.corner(triangle, 0), tree_.corner(triangle, 1), tree_.corner(triangle, 2))};
}

Mesh::Foot Mesh::walk(Foot foot, const Vec3& to) const noexcept {
  foot = foot_on(foot.triangle, to);
  double square = (foot.point.position - to).squaredNorm();
  for (int step = 0; step < kLongestWalk && foot.point.on != On::inside; ++step) {
    Foot best = foot;
    const auto look_at = [&](std::uint32_t triangle) {
      if (triangle == kNone || triangle == foot.triangle) return;
      const Foot other = foot_on(triangle, to);
      const double other_square = (other.point.position - to).squaredNorm();
      if (other_square < square) {
        square = other_square;
        best = other;
      }
    };
    if (foot.point.on == On::edge) {
      look_at(topology_.neighbours[foot.triangle][foot.point.corner]);
    } else {
      const std::uint32_t vertex = mesh_.triangles[foot.triangle][foot.point.corner];
      for (std::uint32_t i = topology_.first_of[vertex]; i < topology_.first_of[vertex + 1]; ++i)
        look_at(topology_.around[i]);
    }
    if (best.triangle == foot.triangle) break;
    foot = best;
  }
  return foot;
}

Vec3 Mesh::pseudo_normal(const Foot& foot) const noexcept {
  switch (foot.point.on) {
    case On::edge: {
      const std::uint32_t other = topology_.neighbours[foot.triangle][foot.point.corner];
      if (other == kNone) break;
      return topology_.face_normals[foot.triangle] + topology_.face_normals[other];
    }
    case On::corner:
      return topology_.vertex_normals[mesh_.triangles[foot.triangle][foot.point.corner]];
    case On::inside:
      break;
  }
  return topology_.face_normals[foot.triangle];
}

/// Returns whether the tool has slid off the mesh: its foot is on an open edge, and it is further out.
bool Mesh::beyond_open_edge(const Foot& foot, const Vec3& to) const noexcept {
  if (topology_.open_edges == 0 || foot.point.on == On::inside) return false;
  const auto is_open = [&](std::uint32_t triangle, std::size_t corner) {
    if (topology_.neighbours[triangle][corner] != kNone) return false;
    const Vec3 &a = tree_.corner(triangle, corner), &b = tree_.corner(triangle, (corner + 1) % 3);
    return (b - a).cross(topology_.face_normals[triangle]).dot(to - a) > 0;
  };
  if (foot.point.on == On::edge) return is_open(foot.triangle, foot.point.corner);
  const std::uint32_t vertex = mesh_.triangles[foot.triangle][foot.point.corner];
  for (std::uint32_t i = topology_.first_of[vertex]; i < topology_.first_of[vertex + 1]; ++i) {
    const std::uint32_t triangle = topology_.around[i];
    const auto& corners = mesh_.triangles[triangle];
    for (std::size_t corner = 0; corner < 3; ++corner)
      if ((corners[corner] == vertex || corners[(corner + 1) % 3] == vertex) && is_open(triangle, corner)) return true;
  }
  return false;
}

void Mesh::stand(const Foot& foot, const ToolStep& step, Proxy& proxy) const noexcept {
  const Vec3& place = foot.point.position;
  const Vec3 back = place - step.to;
  const Vec3 outward = pseudo_normal(foot);
  const double distance = norm_of(back), side = back.dot(outward);
  const bool lasts = side >= 0 || distance <= step.reach;
  if (!lasts || beyond_open_edge(foot, step.to)) return release(proxy);
  proxy.position = place;
  const Vec3& face = topology_.face_normals[foot.triangle];
  // On a face the normal is the face's, to the last digit; on edges and corners it is the way that the tool is held
  // back.
  proxy.normal = foot.point.on == On::inside || !(distance > 0) ? face : Vec3((side >= 0 ? 1 : -1) / distance * back);
  proxy.depth = side >= 0 ? (foot.point.on == On::inside ? face.dot(back) : distance) : -distance;
  proxy.known = proxy.touching = true;
  proxy.memory.index = {foot.triangle, static_cast<std::uint32_t>(foot.point.on) * 4 + foot.point.corner};
}

Mesh::Foot Mesh::foot_of(const Proxy& proxy) const noexcept {
  return {proxy.memory.index[0],
          {proxy.position, static_cast<On>(proxy.memory.index[1] / 4),
           static_cast<std::uint8_t>(proxy.memory.index[1] % 4)}};
}

void Mesh::follow_point(const ToolStep& step, Proxy& proxy) const noexcept {
  if (!proxy.touching) {
    if (std::isnan(step.from.x())) return begin_inside(step, proxy);
    const TriangleTree::Hit hit = tree_.sweep(step.from, step.to);
    proxy.known = false;
    if (!hit) return;
    const Vec3 crossed = step.from + hit.share * (step.to - step.from);
    Proxy begun;
    begun.touching = true;
    const Foot first = foot_on(hit.triangle, crossed);
    begun.position = first.point.position;
    begun.memory.index = {hit.triangle, static_cast<std::uint32_t>(first.point.on) * 4 + first.point.corner};
    proxy = begun;
  }
  const Foot before = foot_of(proxy);
  const Foot foot = walk(before, step.to);
  if (verify_) {
    const Vec3 held = held_back(before.point.position, foot, step.to, proxy);
    if (!held.isApprox(foot.point.position, 0)) return;  // `proxy` stands there
  }
  const bool inside = proxy.began_inside;
  stand(foot, step, proxy);
  proxy.began_inside = inside && proxy.touching;
}

/// Sweeps from the last place of the proxy to the new one. Where another part of the mesh is in the way, the proxy
/// stands at the place nearest to the tool that this part and the face below allow.
Vec3 Mesh::held_back(const Vec3& from, Foot foot, const Vec3& to, Proxy& proxy) const noexcept {
  const std::uint32_t own = proxy.memory.index[0];
  ConstraintPlanes planes;
  const Vec3 base = topology_.face_normals[foot.triangle];
  planes.normal[0] = base;
  planes.height[0] = base.dot(foot.point.position);
  planes.count = 1;
  Vec3 goal = foot.point.position;
  Vec3 place = from;
  for (int round = 0; round < 3; ++round) {
    // A little above the surface, so that the faces walked over are not in the way: by the rounding of their place.
    const double rounding = 1e-12 * (bounds_.size().maxCoeff() + goal.cwiseAbs().maxCoeff());
    const Vec3 lift = rounding * base;
    const auto hit = tree_.sweep(place + lift, goal + lift, [&](std::uint32_t triangle) {
      return triangle == own || triangle == foot.triangle ||
             std::find(topology_.neighbours[foot.triangle].begin(), topology_.neighbours[foot.triangle].end(),
                       triangle) != topology_.neighbours[foot.triangle].end();
    });
    if (!hit) break;
    const Vec3& normal = topology_.face_normals[hit.triangle];
    // The walk itself crosses convex parts from inside; only a face that looks against the way stops it.
    place = place + hit.share * (goal - place);
    if (planes.count == 3) break;
    planes.normal[planes.count] = normal;
    planes.height[planes.count++] = normal.dot(tree_.corner(hit.triangle, 0)) + rounding;
    goal = nearest_in_front(to, planes);
  }
  if (planes.count == 1) return foot.point.position;
  const Vec3 back = goal - to;
  const double distance = norm_of(back);
  proxy.position = goal;
  proxy.normal = distance > 0 ? Vec3(back / distance) : base;
  proxy.depth = distance;
  proxy.known = proxy.touching = true;
  // It stands on the face below as far as the walk of the next tick is concerned.
  proxy.memory.index = {foot.triangle, 0};
  return goal;
}

/// Begins a contact with a tool that is inside a closed mesh when it is first seen.
void Mesh::begin_inside(const ToolStep& step, Proxy& proxy) const noexcept {
  proxy = {};
  const TriangleTree::Nearest nearest = tree_.nearest(step.to);
  if (!(nearest.distance2 < std::numeric_limits<double>::infinity()) || topology_.open_edges > 0) return;
  const Foot foot{nearest.triangle, nearest.point};
  if (!((foot.point.position - step.to).dot(pseudo_normal(foot)) > 0)) return;
  stand(foot, step, proxy);
  proxy.began_inside = proxy.touching;
}

// --- A ball ---

/// Moves the centre of a ball of this radius towards `target` until it touches. Samples lie less than two radii apart,
/// so that nothing thin is between them. Returns whether it got there.
bool Mesh::advance_ball(Vec3& centre, const Vec3& target, double radius) const noexcept {
  const Vec3 way = target - centre;
  const double length = norm_of(way);
  if (!(length > 0)) return true;
  const Vec3 direction = way / length;
  const double touching = radius * (1 - kOverlap);
  double done = 0, step = std::min(length, radius);
  for (int part = 0; part < kMostParts && done < length; ++part) {
    step = std::min(step, length - done);
    const Vec3 next = centre + step * direction;
    const TriangleTree::Nearest nearest = tree_.nearest(next, std::pow(2 * radius + step, 2));
    const double distance = std::sqrt(nearest.distance2);
    if (distance >= touching) {
      centre = next;
      done += step;
      // As far as the distance to that part allows, at the rate at which it falls.
      const double rate = nearest.distance2 < std::numeric_limits<double>::infinity() && distance > 0
                              ? -(next - nearest.point.position).dot(direction) / distance
                              : 0;
      const double clearance = distance - radius;
      step = rate > 1e-3 ? std::clamp(clearance / rate, kOverlap * radius, radius) : radius;
      if (rate > 1e-3 && clearance <= kOverlap * radius) return done >= length;
      continue;
    }
    if (step <= kOverlap * radius) return false;
    // Too far: back to where the last known part would be touched.
    const double overlap = radius - distance;
    const double rate = distance > 0 ? -(next - nearest.point.position).dot(direction) / distance : 1;
    const double back = rate > 0.05 ? overlap / rate : step;
    step = back < step ? std::max(step - back, 0.1 * step) : 0.5 * step;
  }
  return done >= length;
}

/// Returns the planes at which a ball is held on its way to `goal`.
ConstraintPlanes Mesh::planes_of_ball(const Vec3& centre, const Vec3& goal, double radius) const noexcept {
  ConstraintPlanes planes;
  tree_.each_within(centre, radius * (1 + 4 * kOverlap), [&](std::uint32_t, const TrianglePoint& point) {
    const Vec3 out = centre - point.position;
    const double distance = norm_of(out);
    if (!(distance > 0) || planes.count == planes.normal.size()) return;
    const Vec3 normal = out / distance;
    if ((goal - centre).dot(normal) >= 0) return;
    for (std::size_t i = 0; i < planes.count; ++i)
      if (planes.normal[i].dot(normal) > 1 - 1e-9) return;
    planes.normal[planes.count] = normal;
    planes.height[planes.count++] = normal.dot(point.position) + radius;
  });
  return planes;
}

void Mesh::follow_ball(const ToolStep& step, Proxy& proxy) const noexcept {
  const double radius = step.radius;
  Vec3 centre = proxy.touching ? proxy.position : step.from;
  bool inside = proxy.touching && proxy.began_inside;
  if (std::isnan(centre.x())) {
    // First seen: a ball that touches the surface or is behind it begins at the nearest place that is free.
    const TriangleTree::Nearest nearest = tree_.nearest(step.to);
    proxy = {};
    if (!(nearest.distance2 < std::numeric_limits<double>::infinity())) return;
    const Foot foot{nearest.triangle, nearest.point};
    const Vec3 normal = pseudo_normal(foot).stableNormalized();
    const Vec3 out = step.to - foot.point.position;
    const double distance = out.dot(normal) >= 0 ? norm_of(out) : -norm_of(out);
    if (distance >= radius || (distance < 0 && topology_.open_edges > 0)) return;
    centre = foot.point.position + radius * normal;
    inside = true;
  }

  const Vec3& goal = step.to;
  for (int round = 0; round < rounds_; ++round) {
    if (advance_ball(centre, goal, radius)) return release(proxy);
    const ConstraintPlanes planes = planes_of_ball(centre, goal, radius);
    if (planes.count == 0) break;
    const Vec3 target = nearest_in_front(goal, planes);
    const Vec3 before = centre;
    (void)advance_ball(centre, target, radius);
    if ((centre - before).norm() <= kOverlap * radius) break;
  }
  if (advance_ball(centre, goal, radius)) return release(proxy);
  const Vec3 back = centre - goal;
  const double distance = norm_of(back);
  proxy.position = centre;
  proxy.normal = back / distance;
  proxy.depth = distance;
  proxy.known = proxy.touching = true;
  proxy.began_inside = inside;
}

// --- What others ask ---

SurfacePoint Mesh::nearest(const Vec3& place) const noexcept {
  const TriangleTree::Nearest nearest = tree_.nearest(place);
  if (!(nearest.distance2 < std::numeric_limits<double>::infinity())) return {};
  const Foot foot{nearest.triangle, nearest.point};
  const Vec3 outward = pseudo_normal(foot).stableNormalized();
  const Vec3 out = place - nearest.point.position;
  const double distance = std::sqrt(nearest.distance2);
  const bool behind = out.dot(outward) < 0;
  return {nearest.point.position, distance > 0 ? Vec3((behind ? -1 : 1) / distance * out) : outward,
          behind ? -distance : distance};
}

Eigen::Matrix3d Mesh::slide(const Proxy& proxy) const noexcept {
  if (radius_ > 0) return Shape::slide(proxy);
  const Foot foot = foot_of(proxy);
  if (foot.point.on == On::corner) return Eigen::Matrix3d::Zero();
  if (foot.point.on == On::inside) {
    const Vec3& normal = topology_.face_normals[foot.triangle];
    return Eigen::Matrix3d::Identity() - normal * normal.transpose();
  }
  const Vec3 along =
      (tree_.corner(foot.triangle, (foot.point.corner + 1U) % 3) - tree_.corner(foot.triangle, foot.point.corner))
          .stableNormalized();
  return along * along.transpose();
}

Vec3 Mesh::smooth(const Proxy& proxy, double crease) const noexcept {
  if (radius_ > 0) return proxy.normal;
  const std::uint32_t triangle = proxy.memory.index[0];
  const Vec3& face = topology_.face_normals[triangle];
  const auto& corners = mesh_.triangles[triangle];
  const Vec3 &a = mesh_.vertices[corners[0]], &b = mesh_.vertices[corners[1]], &c = mesh_.vertices[corners[2]];
  const Vec3 across = (b - a).cross(c - a);
  const double area2 = across.squaredNorm();
  if (!(area2 > 0)) return face;
  const Vec3 p = proxy.position;
  const Vec3 weights =
      Vec3((b - p).cross(c - p).dot(across), (c - p).cross(a - p).dot(across), (a - p).cross(b - p).dot(across)) /
      area2;
  const double limit = std::cos(crease);
  Vec3 sum = Vec3::Zero();
  for (int i = 0; i < 3; ++i) {
    // At a crease the vertex keeps the normal of the faces on this side of it.
    const std::uint32_t vertex = corners[static_cast<std::size_t>(i)];
    Vec3 normal = topology_.vertex_normals[vertex];
    bool creased = false;
    for (std::uint32_t k = topology_.first_of[vertex]; k < topology_.first_of[vertex + 1]; ++k)
      creased = creased || topology_.face_normals[topology_.around[k]].dot(face) < limit;
    if (creased) {
      normal.setZero();
      for (std::uint32_t k = topology_.first_of[vertex]; k < topology_.first_of[vertex + 1]; ++k)
        if (const Vec3& other = topology_.face_normals[topology_.around[k]]; other.dot(face) >= limit) normal += other;
      normal = normal.stableNormalized();
    }
    sum += std::max(0.0, weights[i]) * normal;
  }
  const double size = norm_of(sum);
  return size > 0 ? Vec3(sum / size) : face;
}

TriangleMesh Mesh::tessellated(double, const Box&) const {
  return mesh_;
}

std::unique_ptr<Shape> read_mesh(JsonReader& reader, SceneFiles& files) {
  const std::string file = files.find(reader.require("file").text("file", ""));
  const std::string unit = reader.text("unit", "m");
  MeshLoad load = load_mesh(file, unit);
  auto mesh = std::make_unique<Mesh>(std::move(load.mesh), std::move(load.remarks));
  if (reader.boolean("verify", false)) mesh->set("verify", 1);
  return mesh;
}

}  // namespace haptrace
