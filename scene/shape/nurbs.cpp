#include "scene/shape/nurbs.h"

#include "base/error.h"
#include "control/norm.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <map>
#include <utility>

namespace haptrace {
namespace {

constexpr std::uint32_t kNone = NurbsTrim::kNone;
constexpr int kManySteps = 16;      // where a foot is far from where it goes: a first contact, a pole, an edge
constexpr int kMostCrossings = 16;  // of edges in a tick
constexpr int kMostHalvings = 12;
constexpr double kRounding = 1e-14;  // of a foot, as a share of the sheet's size
constexpr double kNearPole = 0.05;   // |du| over its typical length
constexpr double kBehind = 1e-10;    // depth at which a tool still counts as in front, as a share of the size
constexpr double kFits = 1e-3;       // by which a ball has to be smaller than the smallest concave radius, as a share
constexpr double kLeastTolerance = 1e-6, kMostTolerance = 1e-2;
constexpr double kLeastParts = 100;  // of the sheet's size that the tessellation tells apart

}  // namespace

Nurbs::Nurbs(const std::vector<NurbsData>& patches, bool flip, const std::string& name) : sheet_(patches, flip, name) {
  prepare(0);
}

std::vector<Knob> Nurbs::knobs() const {
  return {{"steps", "", {1, 2, 3}, static_cast<double>(steps_), 1, 6},
          {"tessellation", "m", {1e-3, 1e-4}, tolerance_, kLeastTolerance, kMostTolerance}};
}

void Nurbs::set(const std::string& knob, double level) {
  if (knob == "steps") steps_ = static_cast<int>(std::lround(level));
  if (knob == "tessellation") tolerance_ = level;
}

void Nurbs::prepare(double radius) {
  const double tolerance = std::min(tolerance_, sheet_.size() / kLeastParts);
  if (tolerance != made_with_) {
    start_ = sheet_.tessellate(tolerance);
    tree_ = TriangleTree(start_.mesh);
    made_with_ = tolerance;
    bounds_ = {};
    for (const Vec3& vertex : start_.mesh.vertices) bounds_.include(vertex);
    bounds_.min.array() -= tolerance;
    bounds_.max.array() += tolerance;
    double most = 0;
    for (const SheetPlace& place : start_.places) {
      const SheetPatch& patch = sheet_.patches()[place.patch];
      const SurfaceJet jet = patch.regular(place.at);
      const double curvature = concave_curvature(jet, patch.normal(place.at, jet));
      if (curvature <= most) continue;
      most = curvature;
      least_radius_ = 1 / most;
      least_at_ = jet.s;
    }
  }
  if (!(radius > 0)) return;
  if (sheet_.valley().sine > 0) {
    const Vec3& at = sheet_.valley().place;
    throw input_error(
        fmt::format("a ball does not fit the concave edge at ({:.4g}, {:.4g}, {:.4g}) m, where patches meet at "
                    "an angle: use a tool of radius 0, or round the edge off",
                    at.x(), at.y(), at.z()));
  }
  if (radius > least_radius_ * (1 - kFits))
    throw input_error(
        fmt::format("a ball of radius {:.4g} m does not fit the surface: its smallest concave radius of "
                    "curvature is {:.4g} m, at ({:.4g}, {:.4g}, {:.4g}) m. Use a smaller tool",
                    radius, least_radius_, least_at_.x(), least_at_.y(), least_at_.z()));
}

// --- Feet ---

void Nurbs::set_down(Foot& foot, const SheetPlace& place) const noexcept {
  foot.place = place;
  foot.jet = sheet_.patches()[place.patch].surface.jet(place.at.x(), place.at.y());
}

Nurbs::Foot Nurbs::foot_at(const SheetPlace& place) const noexcept {
  Foot foot;
  set_down(foot, place);
  return foot;
}

/// Returns the place on a patch that a triangle stands for.
Nurbs::Foot Nurbs::foot_in(std::uint32_t triangle, const Vec3& place) const noexcept {
  const auto& corners = start_.mesh.triangles[triangle];
  const Vec3 &a = start_.mesh.vertices[corners[0]], &b = start_.mesh.vertices[corners[1]],
             &c = start_.mesh.vertices[corners[2]];
  const Vec3 across = (b - a).cross(c - a);
  const double area2 = across.squaredNorm();
  double share_b = 0, share_c = 0;
  if (area2 > 0) {
    share_b = std::clamp((place - a).cross(c - a).dot(across) / area2, 0.0, 1.0);
    share_c = std::clamp((b - a).cross(place - a).dot(across) / area2, 0.0, 1.0 - share_b);
  }
  const Vec2 &ua = start_.places[corners[0]].at, &ub = start_.places[corners[1]].at, &uc = start_.places[corners[2]].at;
  const std::uint32_t patch = start_.places[corners[0]].patch;
  Foot foot = foot_at({patch, sheet_.patches()[patch].clamped(ua + share_b * (ub - ua) + share_c * (uc - ua))});
  const NurbsTrim& trim = sheet_.patches()[patch].trim;
  if (!trim.empty() && !trim.holds(foot.place.at)) {
    Vec2 edge = foot.place.at;
    foot.part = trim.nearest(edge);
    set_down(foot, {patch, edge});
  }
  return foot;
}

Vec3 Nurbs::normal_of(const Foot& foot) const noexcept {
  return sheet_.patches()[foot.place.patch].normal(foot.place.at, foot.jet);
}

/// Takes a step in (u, v), as much of it as leads closer to the tool. Returns whether it moved.
bool Nurbs::move(Foot& foot, const Vec3& tool, const Vec2& step) const noexcept {
  const SheetPatch& patch = sheet_.patches()[foot.place.patch];
  const double before = (foot.jet.s - tool).squaredNorm();
  // The squares are rounded; what they cannot tell is no step back.
  const double rounding = 1e-15 * (before + std::sqrt(before) * (foot.jet.s.norm() + sheet_.size()));
  double share = 1;
  for (int half = 0; half < kMostHalvings; ++half, share *= half < 2 ? 0.5 : 0.25) {
    SheetPlace place{foot.place.patch, foot.place.at + share * step};
    std::uint32_t part = kNone;
    if (patch.trim.empty())
      place.at = patch.clamped(place.at);
    else
      part = patch.trim.stop(foot.place.at, place.at);
    const bool moved = place.at != foot.place.at;
    if (!moved) {
      if (part == kNone || part == foot.part) return false;
      foot.part = part;
      return true;
    }
    const SurfaceJet jet = patch.surface.jet(place.at.x(), place.at.y());
    if ((jet.s - tool).squaredNorm() <= before + rounding) {
      foot.place = place;
      foot.jet = jet;
      foot.part = part;
      return true;
    }
  }
  return false;
}

/// A place at an edge that is the same point of the surface as the foot's.
struct Nurbs::Candidate {
  SheetPlace place;
  std::uint32_t part = kNone;
};

/// Returns what is beyond a place on a side of an untrimmed patch, and how far along the part the place is.
SheetJoin Nurbs::join_at(const SheetPlace& place, std::size_t side, double& share) const noexcept {
  const SheetPatch& patch = sheet_.patches()[place.patch];
  const int axis = side < 2 ? 1 : 0;
  const double whole =
      (place.at[axis] - patch.surface.least()[axis]) / (patch.surface.most()[axis] - patch.surface.least()[axis]);
  const double scaled = std::clamp(whole, 0.0, 1.0) * SheetPatch::kParts;
  const auto part = std::min(static_cast<std::size_t>(scaled), SheetPatch::kParts - 1);
  share = scaled - static_cast<double>(part);
  return patch.joins[side * SheetPatch::kParts + part];
}

/// Goes on in the patch beyond the edge, corner or pole on which the foot stands, where that leads downhill. Returns
/// false if nothing does, and notes what holds the foot.
bool Nurbs::cross(Foot& foot, const Vec3& tool) const noexcept {
  constexpr std::size_t kMost = 16;
  std::array<Candidate, kMost> list;
  std::size_t count = 1;
  list[0] = {foot.place, foot.part};
  double steepest = 0;
  Candidate best;
  bool found = false, open = false;
  foot.other.setZero();
  foot.along.setZero();
  int edges = 0;
  const auto add = [&](const Candidate& one) {
    for (std::size_t i = 0; i < count; ++i)
      if (list[i].place.patch == one.place.patch) {
        const SheetPatch& patch = sheet_.patches()[one.place.patch];
        const Vec2 apart =
            (list[i].place.at - one.place.at).cwiseQuotient(patch.surface.most() - patch.surface.least());
        if (apart.cwiseAbs().maxCoeff() < 1e-6) return;
      }
    if (count < kMost) list[count++] = one;
  };
  // Notes how steeply it leads down from a place, in the directions that its edges leave.
  const auto look = [&](const Candidate& one) {
    const SheetPatch& patch = sheet_.patches()[one.place.patch];
    SurfaceJet jet = patch.surface.jet(one.place.at.x(), one.place.at.y());
    const Vec3 back = jet.s - tool;
    const double least = kRounding * (sheet_.size() + jet.s.norm());
    double slope = 0;
    if (patch.trim.empty()) {
      for (int axis = 0; axis < 2; ++axis) {
        const Vec3& way = axis == 0 ? jet.u : jet.v;
        const double length = way.norm();
        if (!(length > 1e-9 * (axis == 0 ? patch.length_u : patch.length_v))) continue;
        const double down = -way.dot(back) / length;
        if (one.place.at[axis] <= patch.surface.least()[axis]) slope = std::max(slope, down);
        if (one.place.at[axis] >= patch.surface.most()[axis]) slope = std::max(slope, -down);
      }
    } else if (one.part != kNone) {
      const NurbsTrim::Part& part = patch.trim.parts()[one.part];
      const Vec2 way = part.to - part.from;
      Vec3 in = -way.y() * jet.u + way.x() * jet.v;
      const Vec3 along = (way.x() * jet.u + way.y() * jet.v).stableNormalized();
      in -= in.dot(along) * along;
      slope = -in.stableNormalized().dot(back);
    }
    if (slope > least && slope > steepest) {
      steepest = slope;
      best = one;
      found = true;
    }
    return jet;
  };
  for (std::size_t i = 0; i < count; ++i) {
    const Candidate here = list[i];
    const SheetPatch& patch = sheet_.patches()[here.place.patch];
    SurfaceJet jet = foot.jet;
    if (i > 0) {
      jet = look(here);
      foot.other += patch.normal(here.place.at, jet);
    }
    const auto reached = [&](const SheetJoin& join, double share, const Vec3& along) {
      if (join.patch == SheetJoin::kOpen) {
        open = open || i == 0;
        return;
      }
      if (i == 0 && ++edges == 1) foot.along = along.stableNormalized();
      const SheetPatch& beyond = sheet_.patches()[join.patch];
      Candidate other{{join.patch, beyond.clamped(join.from + share * (join.to - join.from))}, kNone};
      if (!beyond.trim.empty()) {
        other.part = join.part;
        Vec2 edge = other.place.at;
        other.part = beyond.trim.nearest(edge);
        other.place.at = edge;
      } else {
        // Onto the side itself.
        const std::size_t side = join.part / SheetPatch::kParts;
        const int axis = side < 2 ? 0 : 1;
        other.place.at[axis] = side % 2 == 0 ? beyond.surface.least()[axis] : beyond.surface.most()[axis];
      }
      add(other);
    };
    if (!patch.trim.empty()) {
      if (here.part == kNone) continue;
      const NurbsTrim::Part& part = patch.trim.parts()[here.part];
      const Vec2 way = part.to - part.from;
      const double share = std::clamp((here.place.at - part.from).dot(way) / way.squaredNorm(), 0.0, 1.0);
      reached(patch.joins[here.part], share, way.x() * jet.u + way.y() * jet.v);
      continue;
    }
    for (std::size_t side = 0; side < 4; ++side) {
      const int axis = side < 2 ? 0 : 1;
      const double end = side % 2 == 0 ? patch.surface.least()[axis] : patch.surface.most()[axis];
      if (here.place.at[axis] != end) continue;
      if (patch.pole[side]) {
        // All points of this side are the same; each leads in another direction.
        constexpr int kDirections = 24;
        for (int k = 0; k <= kDirections; ++k)
          (void)look({{here.place.patch, patch.on_side(side, static_cast<double>(k) / kDirections)}, kNone});
        add({{here.place.patch, patch.on_side(side, 0)}, kNone});
        add({{here.place.patch, patch.on_side(side, 1)}, kNone});
        continue;
      }
      // Only edges over which the tool draws the foot.
      const Vec3 out = (side % 2 == 0 ? -1 : 1) * (axis == 0 ? jet.u : jet.v);
      if (i == 0 && !(out.dot(tool - jet.s) > 0)) continue;
      double share = 0;
      const SheetJoin join = join_at(here.place, side, share);
      reached(join, share, axis == 0 ? jet.v : jet.u);
    }
  }
  if (edges > 1) foot.along.setZero();
  if (found) {
    set_down(foot, best.place);
    foot.part = best.part;
    return true;
  }
  foot.held = open ? Foot::Held::off : Foot::Held::edge;
  return false;
}

/// Moves the foot downhill towards the tool: a step of Gauss and Newton, and `steps` of Newton.
void Nurbs::descend(Foot& foot, const Vec3& tool, int steps) const noexcept {
  int crossings = 0, left = steps;
  bool traced = false;
  foot.held = Foot::Held::inside;
  for (int round = 0; round < kMostCrossings + 4 * kManySteps; ++round) {
    const SheetPatch& patch = sheet_.patches()[foot.place.patch];
    const SurfaceJet& jet = foot.jet;
    const Vec3 back = jet.s - tool;
    const double gu = jet.u.dot(back), gv = jet.v.dot(back);
    const double e = jet.u.squaredNorm(), f = jet.u.dot(jet.v), g = jet.v.squaredNorm();
    const double length_u = std::sqrt(e), length_v = std::sqrt(g);
    const double least = kRounding * (sheet_.size() + jet.s.norm());
    bool fixed_u = length_u < 1e-9 * patch.length_u, fixed_v = length_v < 1e-9 * patch.length_v;
    bool at_edge = false;
    Vec2 along = Vec2::Zero();  // of the trimming's edge, along which alone the foot can move
    if (patch.trim.empty()) {
      const auto drawn_over = [&](int axis, double slope, double length) {
        return (foot.place.at[axis] <= patch.surface.least()[axis] && slope > least * length) ||
               (foot.place.at[axis] >= patch.surface.most()[axis] && -slope > least * length);
      };
      const bool over_u = !fixed_u && drawn_over(0, gu, length_u), over_v = !fixed_v && drawn_over(1, gv, length_v);
      at_edge = over_u || over_v;
      fixed_u = fixed_u || over_u;
      fixed_v = fixed_v || over_v;
    } else if (foot.part != kNone) {
      const NurbsTrim::Part& part = patch.trim.parts()[foot.part];
      const Vec2 way = part.to - part.from;
      Vec3 in = -way.y() * jet.u + way.x() * jet.v;
      const Vec3 tangent = (way.x() * jet.u + way.y() * jet.v).stableNormalized();
      in -= in.dot(tangent) * tangent;
      at_edge = in.stableNormalized().dot(back) > least;
      if (at_edge) along = way;
    }
    foot.held = Foot::Held::inside;
    if (at_edge) {
      if (crossings < kMostCrossings && cross(foot, tool)) {
        ++crossings;
        left = kManySteps;
        traced = false;
        continue;
      }
      if (foot.held == Foot::Held::off) return;
      foot.held = Foot::Held::edge;
    }

    Vec2 step = Vec2::Zero();
    const Vec3& uu = jet.uu;
    double huu = e, huv = f, hvv = g;
    if (traced) {
      huu += back.dot(uu);
      huv += back.dot(jet.uv);
      hvv += back.dot(jet.vv);
    }
    if (!along.isZero(0)) {
      const double slope = along.x() * gu + along.y() * gv;
      const double metric = along.x() * along.x() * e + 2 * along.x() * along.y() * f + along.y() * along.y() * g;
      double bend = along.x() * along.x() * huu + 2 * along.x() * along.y() * huv + along.y() * along.y() * hvv;
      if (!(bend > 1e-3 * metric)) bend = metric;
      const NurbsTrim::Part& part = patch.trim.parts()[foot.part];
      const double at = (foot.place.at - part.from).dot(along) / along.squaredNorm();
      double share = at - slope / bend;
      // Over the end of this part of the edge, to the next one.
      if (std::abs(slope) <= least * std::sqrt(metric)) return;
      std::uint32_t next = foot.part;
      if (share >= 1) next = part.next;
      if (share <= 0) next = part.before;
      share = std::clamp(share, 0.0, 1.0);
      const Vec2 to = part.from + share * along;
      const SurfaceJet there = patch.surface.jet(to.x(), to.y());
      const double before = back.squaredNorm();
      if (!((there.s - tool).squaredNorm() <= before * (1 + 1e-14))) return;
      if (next == foot.part && to == foot.place.at) return;
      foot.place.at = to;
      foot.jet = there;
      foot.part = next;
      if (traced && --left <= 0) break;
      traced = true;
      continue;
    }
    if (fixed_u && fixed_v) return;
    if (fixed_u || fixed_v) {
      const double slope = fixed_u ? gv : gu, metric = fixed_u ? g : e, length = fixed_u ? length_v : length_u;
      if (std::abs(slope) <= least * length) return;
      double bend = fixed_u ? hvv : huu;
      if (!(bend > 1e-3 * metric)) bend = metric;
      step[fixed_u ? 1 : 0] = -slope / bend;
    } else {
      if (std::abs(gu) <= least * length_u && std::abs(gv) <= least * length_v) return;
      double det = huu * hvv - huv * huv;
      const double area2 = e * g - f * f;
      if (!(huu > 0 && det > 1e-6 * area2)) {
        huu = e;
        huv = f;
        hvv = g;
        det = area2;
      }
      if (!(det > 0)) return;
      step = Vec2(-(hvv * gu - huv * gv) / det, -(huu * gv - huv * gu) / det);
    }
    // Near a pole the parameters are like polar ones, in which a straight way is bent.
    if (length_u < kNearPole * patch.length_u || length_v < kNearPole * patch.length_v)
      left = std::max(left, traced ? left : kManySteps);
    if (!move(foot, tool, step)) return;
    if (traced && --left <= 0) break;
    traced = true;
  }
}

/// Returns the foot as a point of the surface, with the tool's distance in front of it.
SurfacePoint Nurbs::surface_point(const Foot& foot, const Vec3& tool) const noexcept {
  const Vec3 out = tool - foot.jet.s;
  const Vec3 normal = normal_of(foot);
  const double height = out.dot(normal);
  SurfacePoint point{foot.jet.s, normal, height};
  if (foot.held == Foot::Held::inside) return point;
  const double distance = norm_of(out);
  // On a smooth edge the normal is the surface's, to the last digit.
  if (!(distance > 1e-9 * sheet_.size()) || std::abs(height) > distance * (1 - 1e-14)) return point;
  const double side = foot.held == Foot::Held::off ? height : height + out.dot(foot.other);
  point.distance = side < 0 ? -distance : distance;
  point.normal = (1 / point.distance) * out;
  return point;
}

// --- Contact ---

/// Sets the proxy from a foot. Returns whether it touches.
bool Nurbs::stand(const Foot& foot, const ToolStep& step, Proxy& proxy) const noexcept {
  const SurfacePoint point = surface_point(foot, step.to);
  const double depth = step.radius - point.distance;
  const bool comes_off = foot.held == Foot::Held::off && !(step.radius > 0 && point.distance > 0);
  if (!(depth > (proxy.touching ? -step.reach : 0)) || comes_off) {
    release(proxy);
    return false;
  }
  proxy.position = point.position + step.radius * point.normal;
  proxy.normal = point.normal;
  proxy.depth = depth;
  proxy.known = proxy.touching = true;
  proxy.memory.value = {foot.place.at.x(), foot.place.at.y()};
  // The part of a trimmed edge that holds the tool; for every patch, whether an edge holds it.
  proxy.memory.index = {foot.place.patch, foot.part};
  proxy.memory.place = foot.held == Foot::Held::inside ? nan3() : foot.along;
  return true;
}

void Nurbs::follow(const ToolStep& step, Proxy& proxy) const noexcept {
  if (!is_finite(step.to)) return;
  if (!proxy.touching) return begin(step, proxy);
  Foot foot = foot_at({proxy.memory.index[0], {proxy.memory.value[0], proxy.memory.value[1]}});
  foot.part = proxy.memory.index[1];
  descend(foot, step.to, steps_);
  (void)stand(foot, step, proxy);
}

void Nurbs::begin(const ToolStep& step, Proxy& proxy) const noexcept {
  release(proxy);
  const double radius = step.radius, size = sheet_.size();
  const bool first = std::isnan(step.from.x());
  const double reach = radius + 2 * made_with_;
  const auto near = [&](const Vec3& place, double most, Foot& foot) {
    const TriangleTree::Nearest found = tree_.nearest(place, most * most);
    if (!(found.distance2 < most * most)) return false;
    foot = foot_in(found.triangle, found.point.position);
    descend(foot, place, kManySteps);
    return true;
  };
  const auto in_front = [&](const Foot& foot, const Vec3& place) {
    const SurfacePoint point = surface_point(foot, place);
    return point.distance - radius >= -kBehind * size;
  };
  Foot foot;
  if (first) {
    // A tool that is behind an open surface may have come from any side.
    if (!near(step.to, sheet_.closed() ? std::numeric_limits<double>::infinity() : reach, foot)) return;
    const SurfacePoint point = surface_point(foot, step.to);
    if (!sheet_.closed() && !(radius > 0 && point.distance > 0)) return;
    if (stand(foot, step, proxy)) proxy.began_inside = true;
    return;
  }
  // The end of the step is near the surface, and its beginning was in front of the same part.
  if (near(step.to, reach, foot)) {
    Foot before = foot;
    descend(before, step.from, kManySteps);
    if (in_front(before, step.from) && stand(foot, step, proxy)) return;
  }
  // It crosses the triangles.
  const TriangleTree::Hit hit = tree_.sweep(step.from, step.to);
  if (hit) {
    const Vec3 crossed = step.from + hit.share * (step.to - step.from);
    foot = foot_in(hit.triangle, crossed);
    descend(foot, crossed, kManySteps);
    descend(foot, step.to, kManySteps);
    if (stand(foot, step, proxy)) return;
  }
  // It begins between the triangles and the surface in front of which it is.
  if (near(step.from, reach, foot) && in_front(foot, step.from)) {
    descend(foot, step.to, kManySteps);
    (void)stand(foot, step, proxy);
  }
}

void Nurbs::approach(const ToolStep& step, Proxy& proxy) const noexcept {
  if (!is_finite(step.to)) return;
  const double most = step.radius + step.reach + 2 * made_with_;
  const TriangleTree::Nearest found = tree_.nearest(step.to, most * most);
  if (!(found.distance2 < most * most)) return;
  Foot foot = foot_in(found.triangle, found.point.position);
  descend(foot, step.to, kManySteps);
  if (surface_point(foot, step.to).distance < 0) return;
  proxy.touching = true;  // within the reach, not only behind the surface
  (void)stand(foot, step, proxy);
}

// --- What others ask ---

SurfacePoint Nurbs::nearest(const Vec3& place) const noexcept {
  const TriangleTree::Nearest found = tree_.nearest(place);
  if (!(found.distance2 < std::numeric_limits<double>::infinity())) return {};
  Foot foot = foot_in(found.triangle, found.point.position);
  descend(foot, place, kManySteps);
  return surface_point(foot, place);
}

Eigen::Matrix3d Nurbs::slide(const Proxy& proxy) const noexcept {
  constexpr double kLeast = 1e-3;  // the proxy runs away where the tool reaches the centre of curvature
  const Vec3& n = proxy.normal;
  const Vec3& along = proxy.memory.place;
  const Foot foot = foot_at({proxy.memory.index[0], {proxy.memory.value[0], proxy.memory.value[1]}});
  // The ball's centre is at its radius from the foot.
  const double radius = (proxy.position - foot.jet.s).dot(n);
  if (!std::isnan(along.x()) && std::abs(normal_of(foot).dot(n)) < 1 - 1e-12) {
    const double roll = radius / std::max(kLeast * (radius + 1e-12), radius - proxy.depth);
    const Eigen::Matrix3d edge = along * along.transpose();
    return edge + roll * (Eigen::Matrix3d::Identity() - n * n.transpose() - edge);
  }
  const SurfaceJet jet = sheet_.patches()[foot.place.patch].regular(foot.place.at);
  // The shape operator in an orthonormal basis of the tangents: b = T^-T II T^-1, du = t1 |du|.
  const double length = jet.u.norm();
  if (!(length > 0)) return Shape::slide(proxy);
  const Vec3 t1 = jet.u / length, rest = jet.v - jet.v.dot(t1) * t1;
  const double height = rest.norm(), lean = jet.v.dot(t1);
  if (!(height > 0)) return Shape::slide(proxy);
  const Vec3 t2 = rest / height;
  const double l = -jet.uu.dot(n), m = -jet.uv.dot(n), k = -jet.vv.dot(n);  // positive: curves away from the tool
  Eigen::Matrix2d bend;
  const double b11 = l / (length * length), b12 = (m - lean * length * b11) / (length * height);
  bend << b11, b12, b12, (k - lean * lean * b11 - 2 * lean * height * b12) / (height * height);
  const double half = 0.5 * (bend(0, 0) - bend(1, 1)), mean = 0.5 * (bend(0, 0) + bend(1, 1));
  const double spread = std::hypot(half, bend(0, 1)), angle = 0.5 * std::atan2(bend(0, 1), half);
  const Vec3 first = std::cos(angle) * t1 + std::sin(angle) * t2, second = std::cos(angle) * t2 - std::sin(angle) * t1;
  const auto share = [&](double curvature) {
    const double of_offset = curvature / (1 + radius * curvature);
    return 1 / std::max(kLeast, 1 - proxy.depth * of_offset);
  };
  return share(mean + spread) * first * first.transpose() + share(mean - spread) * second * second.transpose();
}

TriangleMesh Nurbs::tessellated(double tolerance, const Box&) const {
  // Vertices of neighbouring patches become one.
  TriangleMesh whole = sheet_.tessellate(std::max(tolerance, 1e-9 * sheet_.size())).mesh, mesh;
  std::map<std::array<double, 3>, std::uint32_t> known;
  std::vector<std::uint32_t> index(whole.vertices.size(), kNone);
  for (auto& triangle : whole.triangles) {
    for (std::uint32_t& corner : triangle) {
      if (index[corner] == kNone) {
        const Vec3& v = whole.vertices[corner];
        const auto [found, added] =
            known.emplace(std::array{v.x(), v.y(), v.z()}, static_cast<std::uint32_t>(mesh.vertices.size()));
        if (added) mesh.vertices.push_back(v);
        index[corner] = found->second;
      }
      corner = index[corner];
    }
    mesh.triangles.push_back(triangle);
  }
  return mesh;
}

std::unique_ptr<Shape> read_nurbs(JsonReader& reader, SceneFiles& files) {
  const bool flip = reader.boolean("flip", false);
  const bool named = reader.has("file");
  if (named == reader.has("patches"))
    throw input_error(reader.where() + (named ? ": `patches` and `file` are both there; give one of them"
                                              : ": give `patches`, or a `file` that has them"));
  std::unique_ptr<Nurbs> nurbs;
  if (named) {
    const std::string file = files.find(reader.text("file", ""));
    nurbs = std::make_unique<Nurbs>(load_nurbs(file), flip, file);
  } else {
    nurbs = std::make_unique<Nurbs>(read_nurbs_patches(reader), flip, reader.where());
  }
  for (const Knob& knob : nurbs->knobs())
    nurbs->set(knob.name, knob.unit.empty() ? reader.integer(knob.name, static_cast<int>(knob.level),
                                                             static_cast<int>(knob.least), static_cast<int>(knob.most))
                                            : reader.number(knob.name, knob.level, knob.least, knob.most));
  return nurbs;
}

}  // namespace haptrace
