#include "scene/shape/nurbs.h"

#include "base/error.h"
#include "control/norm.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <map>
#include <optional>
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

/// Returns the unit tangent of the surface that leads from a trimmed edge into the patch, across the edge.
Vec3 inward_of(const NurbsTrim::Part& part, const SurfaceJet& jet) noexcept {
  const Vec2 way = part.to - part.from;
  Vec3 in = -way.y() * jet.u + way.x() * jet.v;
  const Vec3 along = (way.x() * jet.u + way.y() * jet.v).stableNormalized();
  in -= in.dot(along) * along;
  return in.stableNormalized();
}

/// Half the squared distance from the tool as a function of (u, v): its derivatives at a foot.
struct LocalDistance {
  LocalDistance(const SurfaceJet& jet, const Vec3& tool, double size) noexcept
      : back(jet.s - tool),
        gu(jet.u.dot(back)),
        gv(jet.v.dot(back)),
        e(jet.u.squaredNorm()),
        f(jet.u.dot(jet.v)),
        g(jet.v.squaredNorm()),
        length_u(std::sqrt(e)),
        length_v(std::sqrt(g)),
        least(kRounding * (size + jet.s.norm())),
        huu(e),
        huv(f),
        hvv(g) {}

  /// Turns the second derivatives of Gauss and Newton into those of Newton.
  void add_curvature(const SurfaceJet& jet) noexcept {
    huu += back.dot(jet.uu);
    huv += back.dot(jet.uv);
    hvv += back.dot(jet.vv);
  }

  Vec3 back;                  ///< from the tool to the foot
  double gu, gv;              ///< slopes
  double e, f, g;             ///< metric of the surface
  double length_u, length_v;  ///< |du|, |dv|
  double least;               ///< slope per length that rounding hides [m]
  double huu, huv, hvv;       ///< second derivatives, at first those of Gauss and Newton
};

/// Returns the step in (u, v) to where the distance is least, along the directions that are not fixed. Returns none if
/// no step leads closer.
std::optional<Vec2> newton_step(const LocalDistance& local, bool fixed_u, bool fixed_v) noexcept {
  const double gu = local.gu, gv = local.gv, e = local.e, f = local.f, g = local.g;
  if (fixed_u && fixed_v) return std::nullopt;
  if (fixed_u || fixed_v) {
    const double slope = fixed_u ? gv : gu, metric = fixed_u ? g : e;
    if (std::abs(slope) <= local.least * (fixed_u ? local.length_v : local.length_u)) return std::nullopt;
    double bend = fixed_u ? local.hvv : local.huu;
    if (!(bend > 1e-3 * metric)) bend = metric;
    Vec2 step = Vec2::Zero();
    step[fixed_u ? 1 : 0] = -slope / bend;
    return step;
  }
  if (std::abs(gu) <= local.least * local.length_u && std::abs(gv) <= local.least * local.length_v) return std::nullopt;
  double huu = local.huu, huv = local.huv, hvv = local.hvv;
  double det = huu * hvv - huv * huv;
  const double area2 = e * g - f * f;
  if (!(huu > 0 && det > 1e-6 * area2)) {
    huu = e;
    huv = f;
    hvv = g;
    det = area2;
  }
  if (!(det > 0)) return std::nullopt;
  return Vec2(-(hvv * gu - huv * gv) / det, -(huu * gv - huv * gu) / det);
}

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

/// Moves a foot into the patch beyond the edge, corner or pole on which it stands, where that leads downhill: into the
/// one that leads down most steeply. Round a corner it goes from patch to patch, in a list of places that are the same
/// point.
class Nurbs::EdgeCrossing {
 public:
  EdgeCrossing(const Nurbs& nurbs, Foot& foot, const Vec3& tool) noexcept
      : nurbs_(nurbs), sheet_(nurbs.sheet_), foot_(foot), tool_(tool) {}

  /// Moves the foot. Returns false if nothing leads downhill, and notes what holds the foot.
  bool run() noexcept {
    foot_.other.setZero();
    foot_.along.setZero();
    list_[0] = {foot_.place, foot_.part};
    count_ = 1;
    for (std::size_t i = 0; i < count_; ++i) visit(list_[i], i == 0);
    if (edges_ > 1) foot_.along.setZero();
    if (found_) {
      nurbs_.set_down(foot_, best_.place);
      foot_.part = best_.part;
      return true;
    }
    foot_.held = open_ ? Foot::Held::off : Foot::Held::edge;
    return false;
  }

 private:
  static constexpr std::size_t kMost = 16;

  [[nodiscard]] const SheetPatch& patch_of(const Candidate& one) const noexcept {
    return sheet_.patches()[one.place.patch];
  }

  /// Looks downhill from a candidate, and adds those beyond the edges on which it is. `own`: it is the foot itself.
  void visit(Candidate here, bool own) noexcept {
    const SheetPatch& patch = patch_of(here);
    SurfaceJet jet = foot_.jet;
    if (!own) {
      jet = look(here);
      foot_.other += patch.normal(here.place.at, jet);
    }
    if (patch.trim.empty()) {
      leave_by_sides(here, jet, own);
    } else if (here.part != kNone) {
      const NurbsTrim::Part& part = patch.trim.parts()[here.part];
      const Vec2 way = part.to - part.from;
      const double share = std::clamp((here.place.at - part.from).dot(way) / way.squaredNorm(), 0.0, 1.0);
      leave_by(patch.joins[here.part], share, way.x() * jet.u + way.y() * jet.v, own);
    }
  }

  /// Notes how steeply it leads down from a place, in the directions that its edges leave.
  SurfaceJet look(const Candidate& one) noexcept {
    const SheetPatch& patch = patch_of(one);
    SurfaceJet jet = patch.surface.jet(one.place.at.x(), one.place.at.y());
    const Vec3 back = jet.s - tool_;
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
      slope = -inward_of(patch.trim.parts()[one.part], jet).dot(back);
    }
    if (slope > least && slope > steepest_) {
      steepest_ = slope;
      best_ = one;
      found_ = true;
    }
    return jet;
  }

  /// Goes over those sides of an untrimmed patch on which the candidate is.
  void leave_by_sides(const Candidate& here, const SurfaceJet& jet, bool own) noexcept {
    const SheetPatch& patch = patch_of(here);
    for (std::size_t side = 0; side < 4; ++side) {
      const int axis = side < 2 ? 0 : 1;
      const double end = side % 2 == 0 ? patch.surface.least()[axis] : patch.surface.most()[axis];
      if (here.place.at[axis] != end) continue;
      if (patch.pole[side]) {
        look_round_pole(here.place.patch, side);
        continue;
      }
      // Only edges over which the tool draws the foot.
      const Vec3 out = (side % 2 == 0 ? -1 : 1) * (axis == 0 ? jet.u : jet.v);
      if (own && !(out.dot(tool_ - jet.s) > 0)) continue;
      double share = 0;
      const SheetJoin join = nurbs_.join_at(here.place, side, share);
      leave_by(join, share, axis == 0 ? jet.v : jet.u, own);
    }
  }

  /// Looks from a pole: all points of its side are the same, and each leads in another direction.
  void look_round_pole(std::uint32_t number, std::size_t side) noexcept {
    const SheetPatch& patch = sheet_.patches()[number];
    constexpr int kDirections = 24;
    for (int k = 0; k <= kDirections; ++k)
      (void)look({{number, patch.on_side(side, static_cast<double>(k) / kDirections)}, kNone});
    add({{number, patch.on_side(side, 0)}, kNone});
    add({{number, patch.on_side(side, 1)}, kNone});
  }

  /// Adds the place beyond a join, at a share of it. `along`: direction of the edge.
  void leave_by(const SheetJoin& join, double share, const Vec3& along, bool own) noexcept {
    if (join.patch == SheetJoin::kOpen) {
      open_ = open_ || own;
      return;
    }
    if (own && ++edges_ == 1) foot_.along = along.stableNormalized();
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
  }

  /// Appends a candidate, unless it is known.
  void add(const Candidate& one) noexcept {
    for (std::size_t i = 0; i < count_; ++i)
      if (list_[i].place.patch == one.place.patch) {
        const SheetPatch& patch = patch_of(one);
        const Vec2 apart =
            (list_[i].place.at - one.place.at).cwiseQuotient(patch.surface.most() - patch.surface.least());
        if (apart.cwiseAbs().maxCoeff() < 1e-6) return;
      }
    if (count_ < kMost) list_[count_++] = one;
  }

  const Nurbs& nurbs_;
  const NurbsSheet& sheet_;
  Foot& foot_;
  const Vec3& tool_;
  std::array<Candidate, kMost> list_;
  std::size_t count_ = 0;
  double steepest_ = 0;
  Candidate best_;  ///< where it leads down most steeply, if `found_`
  bool found_ = false;
  bool open_ = false;  ///< the foot itself stands on an open edge
  int edges_ = 0;      ///< joined edges on which the foot stands
};

/// Moves a foot downhill towards the tool, within a patch, along its edge, and over it.
class Nurbs::Descent {
 public:
  Descent(const Nurbs& nurbs, Foot& foot, const Vec3& tool, int steps) noexcept
      : nurbs_(nurbs), foot_(foot), tool_(tool), left_(steps) {}

  void run() noexcept {
    int crossings = 0;
    foot_.held = Foot::Held::inside;
    for (int round = 0; round < kMostCrossings + 4 * kManySteps; ++round) {
      LocalDistance local(foot_.jet, tool_, nurbs_.sheet_.size());
      const Freedom freedom = freedom_of(local);
      foot_.held = Foot::Held::inside;
      if (freedom.at_edge) {
        if (crossings < kMostCrossings && EdgeCrossing(nurbs_, foot_, tool_).run()) {
          ++crossings;
          left_ = kManySteps;
          traced_ = false;
          continue;
        }
        if (foot_.held == Foot::Held::off) return;
        foot_.held = Foot::Held::edge;
      }
      if (traced_) local.add_curvature(foot_.jet);
      const bool moved = freedom.along.isZero(0) ? step_within(freedom, local) : slide_along(freedom.along, local);
      if (!moved || (traced_ && --left_ <= 0)) return;
      traced_ = true;
    }
  }

 private:
  /// The directions in which the foot can move towards the tool.
  struct Freedom {
    bool fixed_u = false, fixed_v = false;
    bool at_edge = false;       ///< the tool draws the foot over an edge
    Vec2 along = Vec2::Zero();  ///< the trimming's edge along which alone the foot can move; zero: there is none
  };

  [[nodiscard]] const SheetPatch& patch() const noexcept { return nurbs_.sheet_.patches()[foot_.place.patch]; }

  [[nodiscard]] Freedom freedom_of(const LocalDistance& local) const noexcept {
    const SheetPatch& on = patch();
    const Vec2& at = foot_.place.at;
    Freedom freedom{.fixed_u = local.length_u < 1e-9 * on.length_u, .fixed_v = local.length_v < 1e-9 * on.length_v};
    if (on.trim.empty()) {
      const auto drawn_over = [&](int axis, double slope, double length) {
        return (at[axis] <= on.surface.least()[axis] && slope > local.least * length) ||
               (at[axis] >= on.surface.most()[axis] && -slope > local.least * length);
      };
      const bool over_u = !freedom.fixed_u && drawn_over(0, local.gu, local.length_u);
      const bool over_v = !freedom.fixed_v && drawn_over(1, local.gv, local.length_v);
      freedom.at_edge = over_u || over_v;
      freedom.fixed_u = freedom.fixed_u || over_u;
      freedom.fixed_v = freedom.fixed_v || over_v;
    } else if (foot_.part != kNone) {
      const NurbsTrim::Part& part = on.trim.parts()[foot_.part];
      freedom.at_edge = inward_of(part, foot_.jet).dot(local.back) > local.least;
      if (freedom.at_edge) freedom.along = part.to - part.from;
    }
    return freedom;
  }

  /// Takes Newton's step in the directions that are free. Returns false if the foot is where it belongs.
  bool step_within(const Freedom& freedom, const LocalDistance& local) noexcept {
    const std::optional<Vec2> step = newton_step(local, freedom.fixed_u, freedom.fixed_v);
    if (!step) return false;
    // Near a pole the parameters are like polar ones, in which a straight way is bent.
    const bool near_pole =
        local.length_u < kNearPole * patch().length_u || local.length_v < kNearPole * patch().length_v;
    if (near_pole && !traced_) left_ = std::max(left_, kManySteps);
    return nurbs_.move(foot_, tool_, *step);
  }

  /// Takes Newton's step along the part of the trimming's edge that holds the foot, and over its end to the next part.
  /// Returns false if the foot is where it belongs.
  bool slide_along(const Vec2& along, const LocalDistance& local) noexcept {
    const auto along_edge = [&](double uu, double uv, double vv) {
      return along.x() * along.x() * uu + 2 * along.x() * along.y() * uv + along.y() * along.y() * vv;
    };
    const double slope = along.x() * local.gu + along.y() * local.gv;
    const double metric = along_edge(local.e, local.f, local.g);
    double bend = along_edge(local.huu, local.huv, local.hvv);
    if (!(bend > 1e-3 * metric)) bend = metric;
    const SheetPatch& on = patch();
    const NurbsTrim::Part& part = on.trim.parts()[foot_.part];
    const double at = (foot_.place.at - part.from).dot(along) / along.squaredNorm();
    double share = at - slope / bend;
    if (std::abs(slope) <= local.least * std::sqrt(metric)) return false;
    std::uint32_t next = foot_.part;
    if (share >= 1) next = part.next;
    if (share <= 0) next = part.before;
    share = std::clamp(share, 0.0, 1.0);
    const Vec2 to = part.from + share * along;
    const SurfaceJet there = on.surface.jet(to.x(), to.y());
    const double before = local.back.squaredNorm();
    if (!((there.s - tool_).squaredNorm() <= before * (1 + 1e-14))) return false;
    if (next == foot_.part && to == foot_.place.at) return false;
    foot_.place.at = to;
    foot_.jet = there;
    foot_.part = next;
    return true;
  }

  const Nurbs& nurbs_;
  Foot& foot_;
  const Vec3& tool_;
  int left_;             ///< steps of Newton
  bool traced_ = false;  ///< a step of Gauss and Newton has taken the foot along
};

/// Moves the foot downhill towards the tool: a step of Gauss and Newton, and `steps` of Newton.
void Nurbs::descend(Foot& foot, const Vec3& tool, int steps) const noexcept {
  Descent(*this, foot, tool, steps).run();
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
