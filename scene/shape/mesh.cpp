#include "scene/shape/mesh.h"

#include "control/norm.h"
#include "formats/mesh/mesh_file.h"
#include "scene/shape/mesh_simplifier.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace haptrace {
namespace {

using On = TrianglePoint::On;
constexpr int kLongestWalk = 4096;  // steps; each goes downhill, so only a huge jump needs many
constexpr int kMostRounds = 16;
constexpr int kMostLeaps = 16;  // of a proxy from one part of the surface to another in a tick

}  // namespace

Mesh::Mesh(TriangleMesh mesh, std::vector<std::string> remarks)
    : remarks_(std::move(remarks)),
      given_(mesh.triangles.size()),
      wanted_(std::max(given_, kFewestTriangles)),
      prepared_for_(wanted_) {
  build(std::move(mesh));
}

void Mesh::build(TriangleMesh mesh) {
  mesh_ = std::move(mesh);
  tree_ = TriangleTree(mesh_);
  topology_ = MeshTopology(mesh_, tree_);
  bounds_ = {};
  double largest = 0;
  for (const Vec3& vertex : mesh_.vertices) {
    bounds_.include(vertex);
    largest = std::max(largest, vertex.cwiseAbs().maxCoeff());
  }
  rounding_ = 16 * std::numeric_limits<double>::epsilon() * largest;
}

void Mesh::prepare(double radius) {
  radius_ = radius;
  if (wanted_ == prepared_for_) return;
  if (!whole_.triangles.empty()) build(std::exchange(whole_, {}));
  simplified_.clear();
  if (wanted_ < given_) simplify();
  prepared_for_ = wanted_;
}

void Mesh::simplify() {
  TriangleMesh fewer = simplified(mesh_, tree_, topology_, wanted_);
  const TriangleTree whole_tree = std::move(tree_);
  whole_ = std::move(mesh_);
  build(std::move(fewer));
  const SurfaceDistance moved = distance_between(whole_tree, tree_);
  const std::size_t count = mesh_.triangles.size();
  simplified_ =
      fmt::format("simplified from {} to {} triangles, which moved the surface by {:.2g} mm rms, {:.2g} mm at most",
                  given_, count, 1e3 * moved.rms, 1e3 * moved.largest);
  if (count > wanted_)
    simplified_ += fmt::format(
        "; `triangles` asks for {}, but no fewer than {} were found that neither open nor fold the "
        "surface, and keep its parts and holes",
        wanted_, count);
}

std::vector<std::string> Mesh::remarks() const {
  std::vector<std::string> remarks = remarks_;
  if (!simplified_.empty()) remarks.push_back(simplified_);
  return remarks;
}

std::vector<Knob> Mesh::knobs() const {
  // A quarter of the triangles doubles the error.
  constexpr std::size_t kCoarser = 3, kCoarsest = 100;
  std::vector<double> levels{static_cast<double>(std::max(given_, kFewestTriangles))};
  for (std::size_t count = given_ / 4; levels.size() <= kCoarser && count >= kCoarsest; count /= 4)
    levels.insert(levels.begin(), static_cast<double>(count));
  return {{"triangles", "", std::move(levels), static_cast<double>(wanted_), kFewestTriangles, kMostMeshTriangles},
          {"verify", "", {0, 1}, verify_ ? 1.0 : 0.0, 0, 1},
          {"rounds", "", {1, 2, 4, 8}, static_cast<double>(rounds_), 1, kMostRounds}};
}

void Mesh::set(const std::string& knob, double level) {
  if (knob == "triangles") wanted_ = static_cast<std::size_t>(std::lround(level));
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

/// Returns the foot after one step downhill from a foot that is the closest point of its triangle; the same foot if
/// there is none.
Mesh::Foot Mesh::downhill(const Foot& foot, const Vec3& to) const noexcept {
  Foot best = foot;
  double square = (foot.point.position - to).squaredNorm();
  const auto look_at = [&](std::uint32_t triangle) {
    const Foot other = foot_on(triangle, to);
    const double other_square = (other.point.position - to).squaredNorm();
    // The distances of two feet that are close to each other differ by less than their rounding. A foot in the inside
    // of a triangle that holds the present place is not further away.
    if (other_square < square || (other.point.on == On::inside && best.point.on != On::inside)) {
      square = std::min(square, other_square);
      best = other;
    }
  };
  const Face& face = tree_.face(foot.triangle);
  if (foot.point.on == On::edge) {
    const std::uint32_t other = face.neighbours[foot.point.corner];
    if (other != Face::kNone) look_at(other);
  } else if (foot.point.on == On::corner) {
    const std::uint32_t vertex = face.vertices[foot.point.corner];
    const Vec3 &place = face.corners[foot.point.corner], out = to - place;
    for (std::uint32_t i = topology_.first_of[vertex]; i < topology_.first_of[vertex + 1]; ++i) {
      const std::uint32_t triangle = topology_.around[i];
      if (triangle == foot.triangle) continue;
      // Both edges at the vertex lead uphill: so does the triangle.
      const Face& other = tree_.face(triangle);
      const std::size_t corner = other.vertices[0] == vertex ? 0 : other.vertices[1] == vertex ? 1 : 2;
      if ((other.corners[(corner + 1) % 3] - place).dot(out) <= 0 &&
          (other.corners[(corner + 2) % 3] - place).dot(out) <= 0)
        continue;
      look_at(triangle);
    }
  }
  return best;
}

Mesh::Foot Mesh::walk(Foot foot, const Vec3& to) const noexcept {
  foot = foot_on(foot.triangle, to);
  for (int step = 0; step < kLongestWalk && foot.point.on != On::inside; ++step) {
    const Foot next = downhill(foot, to);
    if (next.triangle == foot.triangle) break;
    foot = next;
  }
  return foot;
}

Vec3 Mesh::pseudo_normal(const Foot& foot) const noexcept {
  const Face& face = tree_.face(foot.triangle);
  switch (foot.point.on) {
    case On::edge: {
      const std::uint32_t other = face.neighbours[foot.point.corner];
      if (other == Face::kNone) break;
      return face.normal + tree_.face(other).normal;
    }
    case On::corner:
      return topology_.vertex_normals[face.vertices[foot.point.corner]];
    case On::inside:
      break;
  }
  return face.normal;
}

/// Returns whether the tool has slid off the mesh: its foot is on an open edge, and it is further out.
bool Mesh::beyond_open_edge(const Foot& foot, const Vec3& to) const noexcept {
  if (is_closed() || foot.point.on == On::inside) return false;
  const auto is_open = [&](const Face& face, std::size_t corner) {
    if (face.neighbours[corner] != Face::kNone) return false;
    const Vec3 &a = face.corners[corner], &b = face.corners[(corner + 1) % 3];
    return (b - a).cross(face.normal).dot(to - a) > 0;
  };
  const Face& own = tree_.face(foot.triangle);
  if (foot.point.on == On::edge) return is_open(own, foot.point.corner);
  const std::uint32_t vertex = own.vertices[foot.point.corner];
  for (std::uint32_t i = topology_.first_of[vertex]; i < topology_.first_of[vertex + 1]; ++i) {
    const Face& face = tree_.face(topology_.around[i]);
    for (std::size_t corner = 0; corner < 3; ++corner)
      if ((face.vertices[corner] == vertex || face.vertices[(corner + 1) % 3] == vertex) && is_open(face, corner))
        return true;
  }
  return false;
}

/// Returns the first surface in the way from a foot to a tool in front of it. The triangles that hold the foot are
/// none.
TriangleTree::Hit Mesh::ahead(const Foot& foot, const Vec3& to) const noexcept {
  const auto& own = mesh_.triangles[foot.triangle];
  return tree_.sweep(foot.point.position, to, [&](std::uint32_t triangle) {
    if (triangle == foot.triangle) return true;
    if (foot.point.on == On::edge) return triangle == tree_.face(foot.triangle).neighbours[foot.point.corner];
    const auto& other = mesh_.triangles[triangle];
    return foot.point.on == On::corner && std::find(other.begin(), other.end(), own[foot.point.corner]) != other.end();
  });
}

void Mesh::stand(const Foot& foot, const Vec3& to, Side side, Proxy& proxy) const noexcept {
  const Vec3& place = foot.point.position;
  const Vec3 back = place - to;
  const double distance = norm_of(back);
  proxy.position = place;
  // On a face the normal is the face's, to the last digit; on edges and corners it is the way that the tool is held
  // back.
  const bool flat = (foot.point.on == On::inside && side != Side::in_crease) || !(distance > 0);
  const double sign = side == Side::in_front ? -1 : 1;
  const Vec3& face = tree_.face(foot.triangle).normal;
  proxy.normal = flat ? face : Vec3(sign / distance * back);
  proxy.depth = flat ? face.dot(back) : sign * distance;
  if (side != Side::in_front) proxy.depth = std::max(0.0, proxy.depth);
  proxy.known = proxy.touching = true;
  proxy.memory.index = {foot.triangle, static_cast<std::uint32_t>(foot.point.on) * 4 + foot.point.corner};
}

Mesh::Foot Mesh::foot_of(const Proxy& proxy) const noexcept {
  return {proxy.memory.index[0],
          {proxy.position, static_cast<On>(proxy.memory.index[1] / 4),
           static_cast<std::uint8_t>(proxy.memory.index[1] % 4)}};
}

void Mesh::follow_point(const ToolStep& step, Proxy& proxy) const noexcept {
  const Vec3& to = step.to;
  Foot foot;
  if (proxy.touching) {
    foot = foot_of(proxy);
  } else {
    if (std::isnan(step.from.x())) return begin_inside(step, proxy);
    const TriangleTree::Hit hit = tree_.sweep(step.from, to);
    proxy.known = false;
    if (!hit) return;
    foot = foot_on(hit.triangle, step.from + hit.share * (to - step.from));
    proxy = {};
  }
  for (int leap = 0; leap < kMostLeaps; ++leap) {
    if (verify_) {
      const Step walked = verified_walk(foot, to);
      foot = walked.foot;
      if (walked.held) return stand(foot, to, Side::in_crease, proxy);
    } else {
      foot = walk(foot, to);
    }
    if (beyond_open_edge(foot, to)) return release(proxy);
    const Vec3 back = foot.point.position - to;
    if (back.dot(pseudo_normal(foot)) >= 0) return stand(foot, to, Side::behind, proxy);
    const TriangleTree::Hit hit = ahead(foot, to);
    if (hit) {
      foot = foot_on(hit.triangle, foot.point.position + hit.share * (to - foot.point.position));
      continue;
    }
    if (norm_of(back) <= step.reach) return stand(foot, to, Side::in_front, proxy);
    if (!is_closed() || tree_.winding(to) == 0) return release(proxy);
    // Rounding hides the surface between the foot and the tool.
    const TriangleTree::Nearest nearest = tree_.nearest(to);
    return stand({nearest.triangle, nearest.point}, to, Side::behind, proxy);
  }
  if (is_closed() && tree_.winding(to) == 0) return release(proxy);
  stand(foot, to, Side::behind, proxy);
}

void Mesh::approach(const ToolStep& step, Proxy& proxy) const noexcept {
  const double most = step.radius + step.reach;
  if (!is_finite(step.to)) return;
  const TriangleTree::Nearest nearest = tree_.nearest(step.to, most * most);
  if (!(nearest.distance2 < most * most)) return;
  const Foot foot{nearest.triangle, nearest.point};
  const Vec3 out = step.to - foot.point.position;
  const Vec3 normal = pseudo_normal(foot);
  // A tool that has come round an open edge is behind the surface.
  if (out.dot(normal) < 0 || beyond_open_edge(foot, step.to)) return;
  proxy = {};
  stand(foot, step.to, Side::in_front, proxy);
  if (!(step.radius > 0)) return;
  const double distance = norm_of(out);
  proxy.normal = distance > 0 ? Vec3(out / distance) : normal.stableNormalized();
  proxy.depth = step.radius - distance;
  // Off the surface by more than rounding, as follow() needs it.
  proxy.position = foot.point.position + step.radius * (1 + 1e-9) * proxy.normal;
}

/// Returns the first part of the surface in the way of a proxy that moves in the plane of a triangle, and along that of
/// another if there is one. Triangles with a common vertex are none: they continue the surface.
TriangleTree::Hit Mesh::obstacle(std::uint32_t triangle, std::uint32_t other, const Vec3& from,
                                 const Vec3& to) const noexcept {
  const auto continues = [this](std::uint32_t one, std::uint32_t two) {
    if (one == Face::kNone) return false;
    const auto &a = mesh_.triangles[one], &b = mesh_.triangles[two];
    return std::any_of(a.begin(), a.end(), [&](std::uint32_t v) { return v == b[0] || v == b[1] || v == b[2]; });
  };
  // In front of the planes by the rounding of places in them.
  Vec3 lift = rounding_ * tree_.face(triangle).normal;
  if (other != Face::kNone) lift += rounding_ * tree_.face(other).normal;
  return tree_.sweep(from + lift, to + lift,
                     [&](std::uint32_t hit) { return continues(triangle, hit) || continues(other, hit); });
}

/// Walks downhill as walk() does, and sweeps every step. Where another part of the surface is in the way, it goes on
/// along that part, or along both as far as that leads towards the tool.
Mesh::Step Mesh::verified_walk(Foot foot, const Vec3& to) const noexcept {
  constexpr double kStandoff = 8;   // roundings between a proxy and the part that holds it
  constexpr int kMostCreases = 16;  // triangles passed along such a part in a tick
  int creases = 0;
  Vec3 from = foot.point.position;
  Foot next = foot_on(foot.triangle, to);
  for (int step = 0; step < kLongestWalk; ++step) {
    TriangleTree::Hit hit = obstacle(next.triangle, Face::kNone, from, next.point.position);
    if (!hit) {
      foot = next;
      if (foot.point.on == On::inside) return {foot, false};
      next = downhill(foot, to);
      if (next.triangle == foot.triangle) return {foot, false};
      from = foot.point.position;
      continue;
    }
    std::uint32_t own = next.triangle;
    Vec3 place = from + hit.share * (next.point.position - from);
    for (;;) {
      const Face &face = tree_.face(own), &wall = tree_.face(hit.triangle);
      ConstraintPlanes planes;
      planes.count = 2;
      planes.normal = {face.normal, wall.normal};
      planes.height = {face.normal.dot(place), wall.normal.dot(wall.corners[0]) + kStandoff * rounding_};
      const Vec3 goal = nearest_in_front(to, planes);
      if (face.normal.dot(goal - place) > kStandoff * rounding_) {
        // It leaves the face, up the part in the way.
        from = place;
        foot = {hit.triangle, {place, On::inside, 0}};
        next = foot_on(hit.triangle, to);
        break;
      }
      // Along both, within the triangle.
      const Foot reached = foot_on(own, goal);
      const TriangleTree::Hit further = obstacle(own, hit.triangle, place, reached.point.position);
      if (further) {
        place += further.share * (reached.point.position - place);
        return {{own, {place, On::inside, 0}}, true};
      }
      place = reached.point.position;
      const bool beyond = norm_of(goal - place) > kStandoff * rounding_;
      const std::uint32_t across =
          beyond && reached.point.on == On::edge ? face.neighbours[reached.point.corner] : Face::kNone;
      if (across == Face::kNone || ++creases > kMostCreases) return {{own, {place, On::inside, 0}}, true};
      own = across;
    }
    if (++creases > kMostCreases) return {{foot.triangle, {from, On::inside, 0}}, true};
  }
  return {foot, false};
}

/// Begins a contact with a tool that is inside a closed mesh when it is first seen.
void Mesh::begin_inside(const ToolStep& step, Proxy& proxy) const noexcept {
  proxy = {};
  if (!is_closed() || tree_.winding(step.to) == 0) return;
  const TriangleTree::Nearest nearest = tree_.nearest(step.to);
  if (!(nearest.distance2 < std::numeric_limits<double>::infinity())) return;
  stand({nearest.triangle, nearest.point}, step.to, Side::behind, proxy);
  proxy.began_inside = true;
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
    const Vec3& normal = tree_.face(foot.triangle).normal;
    return Eigen::Matrix3d::Identity() - normal * normal.transpose();
  }
  const Vec3 along =
      (tree_.corner(foot.triangle, (foot.point.corner + 1U) % 3) - tree_.corner(foot.triangle, foot.point.corner))
          .stableNormalized();
  return along * along.transpose();
}

Vec3 Mesh::smooth(const Proxy& proxy, double crease) const noexcept {
  if (radius_ > 0) return proxy.normal;
  const Face& face = tree_.face(proxy.memory.index[0]);
  const Vec3 &a = face.corners[0], &b = face.corners[1], &c = face.corners[2];
  const Vec3 p = proxy.position;
  const Vec3 weights = Vec3((b - p).cross(c - p).dot(face.normal), (c - p).cross(a - p).dot(face.normal),
                            (a - p).cross(b - p).dot(face.normal)) /
                       face.double_area;
  const double limit = std::cos(crease);
  Vec3 sum = Vec3::Zero();
  for (int i = 0; i < 3; ++i) {
    // At a crease the vertex keeps the normal of the faces on this side of it.
    const std::uint32_t vertex = face.vertices[static_cast<std::size_t>(i)];
    Vec3 normal = topology_.vertex_normals[vertex];
    const auto normal_of = [&](std::uint32_t k) -> const Vec3& { return tree_.face(topology_.around[k]).normal; };
    bool creased = false;
    for (std::uint32_t k = topology_.first_of[vertex]; k < topology_.first_of[vertex + 1]; ++k)
      creased = creased || normal_of(k).dot(face.normal) < limit;
    if (creased) {
      normal.setZero();
      for (std::uint32_t k = topology_.first_of[vertex]; k < topology_.first_of[vertex + 1]; ++k)
        if (const Vec3& other = normal_of(k); other.dot(face.normal) >= limit) normal += other;
      normal = normal.stableNormalized();
    }
    sum += std::max(0.0, weights[i]) * normal;
  }
  const double size = norm_of(sum);
  return size > 0 ? Vec3(sum / size) : face.normal;
}

TriangleMesh Mesh::tessellated(double, const Box&) const {
  return mesh_;
}

std::unique_ptr<Shape> read_mesh(JsonReader& reader, SceneFiles& files) {
  const std::string file = files.find(reader.require("file").text("file", ""));
  const std::string unit = reader.text("unit", "m");
  MeshLoad load = load_mesh(file, unit);
  auto mesh = std::make_unique<Mesh>(std::move(load.mesh), std::move(load.remarks));
  mesh->set("verify", reader.boolean("verify", false) ? 1 : 0);
  for (const Knob& knob : mesh->knobs())
    if (knob.name != "verify")
      mesh->set(knob.name, reader.integer(knob.name, static_cast<int>(knob.level), static_cast<int>(knob.least),
                                          static_cast<int>(knob.most)));
  return mesh;
}

}  // namespace haptrace
