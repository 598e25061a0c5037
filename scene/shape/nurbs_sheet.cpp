#include "scene/shape/nurbs_sheet.h"

#include "base/error.h"
#include "control/path/path.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <map>
#include <numeric>
#include <optional>
#include <utility>

namespace haptrace {
namespace {

constexpr double kSameEdge = 1e-5;     // distance of joined edges, as a share of the sheet's size
constexpr double kSameTrimmed = 5e-4;  // of trimmed ones, whose points lie where the file's program put them
constexpr double kNoNormal = 1e-10;    // |du x dv| over its typical size, below which there is none
constexpr double kValley = 0.02;       // sine of an angle below which an edge is smooth
constexpr int kMostCells = 400;        // of a tessellation along a side
constexpr double kMostTriangles = 4e6;

/// A part of an edge, as points of (u, v).
struct EdgePart {
  Vec2 from, to;
};

std::size_t parts_of(const SheetPatch& patch) {
  return patch.trim.empty() ? 4 * SheetPatch::kParts : patch.trim.parts().size();
}

EdgePart part_of(const SheetPatch& patch, std::size_t part) {
  if (!patch.trim.empty()) return {patch.trim.parts()[part].from, patch.trim.parts()[part].to};
  const std::size_t side = part / SheetPatch::kParts, i = part % SheetPatch::kParts;
  constexpr double kShare = 1.0 / SheetPatch::kParts;
  return {patch.on_side(side, static_cast<double>(i) * kShare),
          patch.on_side(side, static_cast<double>(i + 1) * kShare)};
}

Vec3 point_of(const SheetPatch& patch, const Vec2& at) {
  return patch.surface.jet(at.x(), at.y()).s;
}

/// Returns the tangential direction from an edge into its patch, of unit length.
Vec3 inward_of(const SheetPatch& patch, std::size_t part, const Vec2& at, const Vec3& along) {
  const SurfaceJet jet = patch.surface.jet(at.x(), at.y());
  Vec2 in;
  if (patch.trim.empty()) {
    const std::size_t side = part / SheetPatch::kParts;
    in = side == 0 ? Vec2(1, 0) : side == 1 ? Vec2(-1, 0) : side == 2 ? Vec2(0, 1) : Vec2(0, -1);
  } else {
    const Vec2 way = patch.trim.parts()[part].to - patch.trim.parts()[part].from;
    in = {-way.y(), way.x()};
  }
  Vec3 inward = in.x() * jet.u + in.y() * jet.v;
  inward -= inward.dot(along) * along;
  return inward.stableNormalized();
}

}  // namespace

double concave_curvature(const SurfaceJet& jet, const Vec3& normal) noexcept {
  const double e = jet.u.dot(jet.u), f = jet.u.dot(jet.v), g = jet.v.dot(jet.v), area2 = e * g - f * f;
  if (!(area2 > 1e-16 * e * g)) return 0;
  const double l = jet.uu.dot(normal), m = jet.uv.dot(normal), n = jet.vv.dot(normal);
  const double mean = 0.5 * (e * n - 2 * f * m + g * l) / area2, gauss = (l * n - m * m) / area2;
  return std::max(0.0, mean + std::sqrt(std::max(0.0, mean * mean - gauss)));
}

Vec2 SheetPatch::on_side(std::size_t side, double share) const noexcept {
  const Vec2 &low = surface.least(), &high = surface.most();
  const auto between = [&](int axis) { return share >= 1 ? high[axis] : low[axis] + share * (high[axis] - low[axis]); };
  switch (side) {
    case 0:
      return {low.x(), between(1)};
    case 1:
      return {high.x(), between(1)};
    case 2:
      return {between(0), low.y()};
    default:
      return {between(0), high.y()};
  }
}

SurfaceJet SheetPatch::regular(const Vec2& at) const noexcept {
  constexpr double kSmall = 1e-4;
  SurfaceJet jet = surface.jet(at.x(), at.y());
  if (jet.u.norm() > kSmall * length_u && jet.v.norm() > kSmall * length_v) return jet;
  const Vec2 inside = at + 1e-3 * (0.5 * (surface.least() + surface.most()) - at);
  return surface.jet(inside.x(), inside.y());
}

Vec3 SheetPatch::normal(const Vec2& at, const SurfaceJet& jet) const noexcept {
  constexpr double kSmall = 1e-5, kParallel = 1e-8;
  const double u = jet.u.norm(), v = jet.v.norm();
  const bool short_u = u < kSmall * length_u, short_v = v < kSmall * length_v;
  Vec3 across = jet.u.cross(jet.v);
  double area = across.norm();
  if (short_u || short_v || !(area > kParallel * u * v)) {
    // du vanishes along a side with v = constant. Near it, du is duv half way times the distance from it: the
    // difference of nearly equal points has lost its digits.
    const Vec2 middle = 0.5 * (surface.least() + surface.most());
    Vec2 half = at;
    across.setZero();
    if (short_u && !short_v) {
      const double end = at.y() > middle.y() ? surface.most().y() : surface.least().y();
      half.y() = 0.5 * (at.y() + end);
      across = (at.y() > middle.y() ? -1 : 1) * surface.jet(half.x(), half.y()).uv.cross(jet.v);
    } else if (short_v && !short_u) {
      const double end = at.x() > middle.x() ? surface.most().x() : surface.least().x();
      half.x() = 0.5 * (at.x() + end);
      across = (at.x() > middle.x() ? -1 : 1) * jet.u.cross(surface.jet(half.x(), half.y()).uv);
    }
    area = across.norm();
    if (!(area * (surface.most() - surface.least()).maxCoeff() > kParallel * length_u * length_v)) {
      const Vec2 inside = at + 1e-6 * (middle - at);
      const SurfaceJet near = surface.jet(inside.x(), inside.y());
      across = near.u.cross(near.v);
      area = across.norm();
    }
  }
  return area > 0 ? Vec3(sign / area * across) : Vec3::UnitZ();
}

// --- Making ---

NurbsSheet::NurbsSheet(const std::vector<NurbsData>& patches, bool flip, const std::string& name) {
  std::vector<NurbsData> whole;
  std::vector<std::size_t> number;
  for (std::size_t i = 0; i < patches.size(); ++i)
    for (NurbsData& part : split_at_creases(patches[i])) {
      whole.push_back(std::move(part));
      number.push_back(i);
    }
  Box box;
  for (const NurbsData& patch : whole)
    for (const Eigen::Vector4d& point : patch.points) box.include(point.head<3>());
  size_ = box.size().norm();
  patches_.reserve(whole.size());
  for (std::size_t i = 0; i < whole.size(); ++i) {
    patches_.emplace_back(whole[i]);
    patches_.back().sign = whole[i].turned ? -1 : 1;
    check_patch(patches_.back(), fmt::format("{}: patch {}", name, number[i] + 1));
  }
  join_edges();
  orient(flip, name);
  find_valleys();
  if (open_ > 0)
    remarks_.push_back(
        fmt::format("the surface has open edges, one at ({:.4g}, {:.4g}, {:.4g}) m: the tool can get behind "
                    "the surface there",
                    open_at_.x(), open_at_.y(), open_at_.z()));
}

void NurbsSheet::check_patch(SheetPatch& patch, const std::string& where) const {
  const Vec2 &low = patch.surface.least(), &high = patch.surface.most();
  constexpr int kSamples = 17;
  double area = 0;
  for (int i = 0; i < kSamples; ++i)
    for (int j = 0; j < kSamples; ++j) {
      const Vec2 at = low + (high - low).cwiseProduct(Vec2(i + 0.5, j + 0.5) / kSamples);
      const SurfaceJet jet = patch.surface.jet(at.x(), at.y());
      patch.length_u = std::max(patch.length_u, jet.u.norm());
      patch.length_v = std::max(patch.length_v, jet.v.norm());
      area = std::max(area, jet.u.cross(jet.v).norm());
    }
  const Vec2 extent = high - low;
  if (!(patch.length_u * extent.x() > 1e-9 * size_) || !(patch.length_v * extent.y() > 1e-9 * size_) ||
      !(area > 1e-9 * patch.length_u * patch.length_v))
    throw input_error(where + " is a curve or a point: it has no area. Leave it out, or move its points apart");
  for (int i = 0; i < kSamples; ++i)
    for (int j = 0; j < kSamples; ++j) {
      const Vec2 at = low + extent.cwiseProduct(Vec2(i + 0.5, j + 0.5) / kSamples);
      const SurfaceJet jet = patch.surface.jet(at.x(), at.y());
      if (!(jet.u.cross(jet.v).norm() > kNoNormal * area))
        throw input_error(
            fmt::format("{} has no normal at (u, v) = ({:.4g}, {:.4g}), at ({:.4g}, {:.4g}, {:.4g}) m: du and dv "
                        "are parallel or zero there",
                        where, at.x(), at.y(), jet.s.x(), jet.s.y(), jet.s.z()));
    }
  int poles = 0;
  for (std::size_t side = 0; side < 4; ++side) {
    const Vec3 first = point_of(patch, patch.on_side(side, 0));
    double wide = 0;
    for (int i = 1; i <= 8; ++i) wide = std::max(wide, (point_of(patch, patch.on_side(side, i / 8.0)) - first).norm());
    patch.pole[side] = wide < 1e-9 * size_;
    poles += patch.pole[side] ? 1 : 0;
  }
  if (poles > 2 || ((patch.pole[0] || patch.pole[1]) && (patch.pole[2] || patch.pole[3])))
    throw input_error(where + " has neighbouring sides that are points. Give it at least two sides of a length");
}

namespace {

/// Finds the edge that runs through the same points as a part of an edge.
class EdgeJoiner {
 public:
  /// Readies the joins of the patches: one for every part of their edges.
  EdgeJoiner(std::vector<SheetPatch>& patches, double size) : patches_(patches), size_(size), ends_(patches.size()) {
    for (std::uint32_t p = 0; p < patches_.size(); ++p) {
      SheetPatch& patch = patches_[p];
      const std::size_t count = parts_of(patch);
      patch.joins.assign(count, {});
      for (std::size_t k = 0; k < count; ++k) {
        const EdgePart part = part_of(patch, k);
        ends_[p].push_back({point_of(patch, part.from), point_of(patch, part.to)});
        if (k % SheetPatch::kParts == 0) chains_.push_back({p, k, 0, {}});
        ++chains_.back().count;
        for (const Vec3& end : ends_[p].back()) chains_.back().box.include(end);
      }
    }
  }

  [[nodiscard]] bool is_pole(std::uint32_t p, std::size_t part) const {
    return patches_[p].trim.empty() && patches_[p].pole[part / SheetPatch::kParts];
  }

  /// Joins a part to the nearest edge. Returns false if none is near enough.
  bool join(std::uint32_t p, std::size_t k) {
    SheetPatch& patch = patches_[p];
    const EdgePart part = part_of(patch, k);
    const Vec2 middle = 0.5 * (part.from + part.to);
    const Vec3 place = point_of(patch, middle);
    Found best{1e300, 0, Vec2::Zero()};
    const Chain* chain = nullptr;
    for (const Chain& other : chains_) {
      const double reach = reach_of(patch, patches_[other.patch]);
      // Not the part itself, nor its neighbours in the same edge.
      const bool own = other.patch == p && k >= other.first && k < other.first + other.count;
      if (own || is_pole(other.patch, other.first) || !may_reach(other.box, place, reach)) continue;
      const Found found = nearest_on(other, place);
      if (found.distance2 > reach * reach || found.distance2 >= best.distance2) continue;
      if (other.patch == p &&
          (found.at - middle).cwiseQuotient(patch.surface.most() - patch.surface.least()).norm() < 0.02)
        continue;
      best = found;
      chain = &other;
    }
    if (chain == nullptr) return false;
    SheetJoin& join = patch.joins[k];
    join.patch = chain->patch;
    join.part = static_cast<std::uint32_t>(best.part);
    join.from = nearest_on(*chain, point_of(patch, part.from)).at;
    join.to = nearest_on(*chain, point_of(patch, part.to)).at;
    return true;
  }

 private:
  /// Parts that follow each other: a side, or a piece of a trimming loop, with its box.
  struct Chain {
    std::uint32_t patch;
    std::size_t first, count;
    Box box;
  };

  struct Found {
    double distance2;
    std::size_t part = 0;
    Vec2 at;
  };

  /// Returns the distance within which edges of two patches are the same [m].
  [[nodiscard]] double reach_of(const SheetPatch& one, const SheetPatch& other) const {
    return (one.trim.empty() && other.trim.empty() ? kSameEdge : kSameTrimmed) * size_;
  }

  [[nodiscard]] bool may_reach(const Box& box, const Vec3& place, double reach) const {
    return !((place.array() < box.min.array() - 3 * reach - 0.01 * size_).any() ||
             (place.array() > box.max.array() + 3 * reach + 0.01 * size_).any());
  }

  /// Finds the nearest point of a chain, on the edge itself.
  [[nodiscard]] Found nearest_on(const Chain& chain, const Vec3& place) const {
    Found best{1e300, 0, Vec2::Zero()};
    const SheetPatch& patch = patches_[chain.patch];
    for (std::size_t k = chain.first; k < chain.first + chain.count; ++k) {
      const auto& [a, b] = ends_[chain.patch][k];
      const Vec3 way = b - a;
      const double length2 = way.squaredNorm();
      const double share = length2 > 0 ? std::clamp((place - a).dot(way) / length2, 0.0, 1.0) : 0;
      const double distance2 = (a + share * way - place).squaredNorm();
      if (distance2 >= best.distance2) continue;
      const EdgePart part = part_of(patch, k);
      best = {distance2, k, part.from + share * (part.to - part.from)};
    }
    // The chord is not the edge: along it to where it is nearest.
    const EdgePart part = part_of(patch, best.part);
    const Vec2 along = part.to - part.from;
    for (int i = 0; i < 6; ++i) {
      const SurfaceJet jet = patch.surface.jet(best.at.x(), best.at.y());
      const Vec3 way = along.x() * jet.u + along.y() * jet.v;
      const Vec3 bend =
          along.x() * along.x() * jet.uu + 2 * along.x() * along.y() * jet.uv + along.y() * along.y() * jet.vv;
      const double steep = std::max(way.squaredNorm() + (jet.s - place).dot(bend), 0.3 * way.squaredNorm());
      if (!(steep > 0)) break;
      best.at = patch.clamped(best.at - (jet.s - place).dot(way) / steep * along);
    }
    best.distance2 = (point_of(patch, best.at) - place).squaredNorm();
    return best;
  }

  std::vector<SheetPatch>& patches_;
  double size_;  ///< of the sheet [m]
  std::vector<Chain> chains_;
  std::vector<std::vector<std::array<Vec3, 2>>> ends_;  ///< of the parts of every patch
};

}  // namespace

void NurbsSheet::join_edges() {
  EdgeJoiner joiner(patches_, size_);
  for (std::uint32_t p = 0; p < patches_.size(); ++p)
    for (std::size_t k = 0; k < patches_[p].joins.size(); ++k) {
      if (joiner.is_pole(p, k) || joiner.join(p, k)) continue;
      if (open_++ > 0) continue;
      const EdgePart part = part_of(patches_[p], k);
      open_at_ = point_of(patches_[p], 0.5 * (part.from + part.to));
    }
}

namespace {

/// Where the edge of a patch meets its neighbour.
struct Seam {
  const SheetPatch& other;
  std::size_t part;  ///< of the other patch
  Vec3 along;        ///< unit vector
  Vec2 here, there;  ///< its middle, in both patches
};

std::optional<Seam> seam_at(const std::vector<SheetPatch>& patches, const SheetPatch& patch, std::size_t part) {
  const SheetJoin& join = patch.joins[part];
  if (join.patch == SheetJoin::kOpen) return std::nullopt;
  const EdgePart edge = part_of(patch, part);
  return Seam{.other = patches[join.patch],
              .part = join.part,
              .along = (point_of(patch, edge.to) - point_of(patch, edge.from)).stableNormalized(),
              .here = 0.5 * (edge.from + edge.to),
              .there = 0.5 * (join.from + join.to)};
}

Vec3 normal_at(const SheetPatch& patch, const Vec2& at) {
  return patch.normal(at, patch.surface.jet(at.x(), at.y()));
}

}  // namespace

void NurbsSheet::orient(bool flip, const std::string& name) {
  // Two patches agree if the edge between them runs in opposite directions round them.
  std::vector<int> turn(patches_.size(), 0);  // 0: not known
  std::size_t turned = 0;
  std::vector<std::uint32_t> front;
  for (std::uint32_t seed = 0; seed < patches_.size(); ++seed) {
    if (turn[seed] != 0) continue;
    turn[seed] = 1;
    front.assign(1, seed);
    while (!front.empty()) {
      const std::uint32_t p = front.back();
      front.pop_back();
      const SheetPatch& patch = patches_[p];
      for (std::size_t k = 0; k < patch.joins.size(); ++k) {
        const std::optional<Seam> seam = seam_at(patches_, patch, k);
        if (!seam) continue;
        const Vec3 own = inward_of(patch, k, seam->here, seam->along).cross(normal_at(patch, seam->here));
        const Vec3 its =
            inward_of(seam->other, seam->part, seam->there, seam->along).cross(normal_at(seam->other, seam->there));
        const double same = own.dot(its);
        if (std::abs(same) < 0.5) continue;  // too short to tell
        const int wanted = same < 0 ? turn[p] : -turn[p];
        const std::uint32_t neighbour = patch.joins[k].patch;
        if (turn[neighbour] == 0) {
          turn[neighbour] = wanted;
          turned += wanted < 0 ? 1 : 0;
          front.push_back(neighbour);
        } else if (turn[neighbour] != wanted) {
          const Vec3 at = point_of(patch, seam->here);
          throw input_error(
              fmt::format("{}: near ({:.4g}, {:.4g}, {:.4g}) m the patches form a surface with only one side, "
                          "like a Moebius strip, which has no outside",
                          name, at.x(), at.y(), at.z()));
        }
      }
    }
  }
  for (std::size_t p = 0; p < patches_.size(); ++p) patches_[p].sign *= turn[p] * (flip ? -1 : 1);
  if (turned > 0)
    remarks_.push_back(
        fmt::format("{} patches looked the other way than their neighbours, and were turned over", turned));
}

void NurbsSheet::find_valleys() {
  for (const SheetPatch& patch : patches_)
    for (std::size_t k = 0; k < patch.joins.size(); ++k) {
      const std::optional<Seam> seam = seam_at(patches_, patch, k);
      if (!seam) continue;
      const double sine = normal_at(seam->other, seam->there).dot(inward_of(patch, k, seam->here, seam->along));
      if (sine > kValley && sine > valley_.sine) valley_ = {sine, point_of(patch, seam->here)};
    }
}

// --- Tessellation ---

namespace {

using CellCounts = std::array<int, 2>;  ///< along u and v of a patch

/// Returns the cells that keep the chords of a patch within a tolerance.
CellCounts cells_of(const SheetPatch& patch, double tolerance) {
  const Vec2 &low = patch.surface.least(), extent = patch.surface.most() - patch.surface.least();
  const int nu = std::min(64, 4 * patch.surface.spans(0) + 1), nv = std::min(64, 4 * patch.surface.spans(1) + 1);
  double uu = 0, uv = 0, vv = 0;
  for (int i = 0; i <= nu; ++i)
    for (int j = 0; j <= nv; ++j) {
      const Vec2 at = low + extent.cwiseProduct(Vec2(static_cast<double>(i) / nu, static_cast<double>(j) / nv));
      const SurfaceJet jet = patch.surface.jet(at.x(), at.y());
      uu = std::max(uu, jet.uu.norm() * extent.x() * extent.x());
      uv = std::max(uv, jet.uv.norm() * extent.x() * extent.y());
      vv = std::max(vv, jet.vv.norm() * extent.y() * extent.y());
    }
  // Error of linear interpolation: (uu / nu^2 + 2 uv / (nu nv) + vv / nv^2) / 8, a third each.
  const auto cells = [&](double bend) {
    return std::clamp(std::ceil(std::sqrt(3 * bend / (8 * tolerance))), 1.0, 1e4);
  };
  double u = cells(uu), v = cells(vv);
  const double more = std::sqrt(std::max(1.0, 3 * uv / (4 * tolerance * u * v)));
  u = std::clamp(std::ceil(u * more), patch.surface.spans(0) > 1 ? 2.0 : 1.0, static_cast<double>(kMostCells));
  v = std::clamp(std::ceil(v * more), patch.surface.spans(1) > 1 ? 2.0 : 1.0, static_cast<double>(kMostCells));
  return {static_cast<int>(u), static_cast<int>(v)};
}

/// Triangulates the part of a patch between its loops: strips between lines of constant u, cut where loops turn.
class StripMesher {
 public:
  StripMesher(const SheetPatch& patch, std::uint32_t index, CellCounts cells, SheetMesh& out)
      : patch_(patch),
        index_(index),
        out_(out),
        extent_(patch.surface.most() - patch.surface.least()),
        us_(grid_lines(0, cells[0])) {
    for (const NurbsTrim::Part& part : patch.trim.parts()) us_.push_back(part.from.x());
    sort_apart(us_, 1e-9 * extent_.x());
    strips_.resize(us_.size());
    for (std::size_t i = 0; i + 1 < us_.size(); ++i) strips_[i] = strips_between(us_[i], us_[i + 1]);
    mark_lines(grid_lines(1, cells[1]));
  }

  void triangulate() {
    for (std::size_t i = 0; i + 1 < us_.size(); ++i)
      for (const Strip& strip : strips_[i]) triangulate(strip, i);
  }

 private:
  /// A piece of the patch between two lines of constant u: the least and the largest v on the line before it, and on
  /// the line after it.
  using Strip = std::array<double, 4>;

  /// Returns the borders of `n` equal cells along an axis.
  [[nodiscard]] std::vector<double> grid_lines(int axis, int n) const {
    const double low = patch_.surface.least()[axis], high = patch_.surface.most()[axis];
    std::vector<double> lines;
    for (int i = 0; i <= n; ++i) lines.push_back(i == n ? high : low + (high - low) * (static_cast<double>(i) / n));
    return lines;
  }

  /// Sorts numbers, and drops those that are less than `least` above the one before.
  static void sort_apart(std::vector<double>& numbers, double least) {
    std::sort(numbers.begin(), numbers.end());
    numbers.erase(std::unique(numbers.begin(), numbers.end(), [&](double x, double y) { return y - x < least; }),
                  numbers.end());
  }

  /// Returns the strips between two lines. No loop turns between the lines.
  [[nodiscard]] std::vector<Strip> strips_between(double a, double b) const {
    const double low = patch_.surface.least().y(), high = patch_.surface.most().y();
    if (patch_.trim.empty()) return {{low, high, low, high}};
    struct Cross {
      double at_middle, at_a, at_b;
    };
    const double middle = 0.5 * (a + b);
    std::vector<Cross> crossed;
    for (const NurbsTrim::Part& part : patch_.trim.parts()) {
      if ((part.from.x() > middle) == (part.to.x() > middle)) continue;
      const auto at = [&](double u) {
        const double share = std::clamp((u - part.from.x()) / (part.to.x() - part.from.x()), 0.0, 1.0);
        return part.from.y() + share * (part.to.y() - part.from.y());
      };
      crossed.push_back({at(middle), at(a), at(b)});
    }
    std::sort(crossed.begin(), crossed.end(), [](const Cross& x, const Cross& y) { return x.at_middle < y.at_middle; });
    std::vector<Strip> strips;
    for (std::size_t k = 0; k + 1 < crossed.size(); k += 2)
      strips.push_back({crossed[k].at_a, crossed[k + 1].at_a, crossed[k].at_b, crossed[k + 1].at_b});
    return strips;
  }

  /// Finds the v at which each line needs a vertex: at the ends of strips, and at lines of the grid.
  void mark_lines(const std::vector<double>& vs) {
    marks_.resize(us_.size());
    for (std::size_t i = 0; i + 1 < us_.size(); ++i)
      for (const auto& [a0, a1, b0, b1] : strips_[i]) {
        marks_[i].insert(marks_[i].end(), {a0, a1});
        marks_[i + 1].insert(marks_[i + 1].end(), {b0, b1});
      }
    for (std::vector<double>& marks : marks_) {
      marks.insert(marks.end(), vs.begin(), vs.end());
      sort_apart(marks, 1e-9 * extent_.y());  // a loop's point near a line of the grid takes its place
    }
  }

  /// Returns the marks of a line between two v.
  [[nodiscard]] std::vector<double> marked(std::size_t line, double from, double to) const {
    std::vector<double> marked;
    const double slack = 2e-9 * extent_.y();
    for (const double mark : marks_[line])
      if (mark >= from - slack && mark <= to + slack) marked.push_back(mark);
    return marked;
  }

  /// Returns the vertex on a line, which it makes at the first request.
  std::uint32_t vertex(std::size_t line, double v) {
    const auto [found, added] = known_.emplace(std::pair(line, v), static_cast<std::uint32_t>(out_.places.size()));
    if (added) {
      out_.places.push_back({index_, {us_[line], v}});
      out_.mesh.vertices.push_back(point_of(patch_, {us_[line], v}));
    }
    return found->second;
  }

  void triangulate(const Strip& strip, std::size_t line) {
    const auto& [a0, a1, b0, b1] = strip;
    const std::vector<double> left = marked(line, a0, a1), right = marked(line + 1, b0, b1);
    std::size_t l = 0, r = 0;
    while (l + 1 < left.size() || r + 1 < right.size()) {
      const bool up_left = r + 1 >= right.size() || (l + 1 < left.size() && left[l + 1] <= right[r + 1]);
      const std::uint32_t a = vertex(line, left[l]), b = vertex(line + 1, right[r]);
      const std::uint32_t c = up_left ? vertex(line, left[++l]) : vertex(line + 1, right[++r]);
      if (patch_.sign > 0)
        out_.mesh.triangles.push_back({a, b, c});
      else
        out_.mesh.triangles.push_back({b, a, c});
    }
  }

  const SheetPatch& patch_;
  std::uint32_t index_;
  SheetMesh& out_;
  Vec2 extent_;
  std::vector<double> us_;                  ///< u of the lines
  std::vector<std::vector<Strip>> strips_;  ///< after each line
  std::vector<std::vector<double>> marks_;  ///< v at which a line needs a vertex
  std::map<std::pair<std::size_t, double>, std::uint32_t> known_;
};

/// Returns the cells that keep every patch within a tolerance, or fewer where that would be too many triangles.
std::vector<CellCounts> cells_within(const std::vector<SheetPatch>& patches, double tolerance) {
  std::vector<CellCounts> cells;
  double total = 0;
  for (const SheetPatch& patch : patches) {
    cells.push_back(cells_of(patch, tolerance));
    total += 2.0 * cells.back()[0] * cells.back()[1];
  }
  for (auto& [u, v] : cells)
    if (total > kMostTriangles) {
      u = std::max(1, static_cast<int>(u * std::sqrt(kMostTriangles / total)));
      v = std::max(1, static_cast<int>(v * std::sqrt(kMostTriangles / total)));
    }
  return cells;
}

/// Returns true if the whole side of an untrimmed patch is joined to one side of another.
bool is_joined_to_one_side(const SheetPatch& patch, std::size_t side) {
  const SheetJoin& first = patch.joins[side * SheetPatch::kParts];
  bool whole = true;
  for (std::size_t k = 0; k < SheetPatch::kParts; ++k) {
    const SheetJoin& join = patch.joins[side * SheetPatch::kParts + k];
    whole = whole && join.patch == first.patch && join.part / SheetPatch::kParts == first.part / SheetPatch::kParts;
  }
  return whole;
}

/// Gives directions whose sides are joined with the same parameters the same number of cells: the largest.
void match_cells(const std::vector<SheetPatch>& patches, std::vector<CellCounts>& cells) {
  std::vector<std::size_t> group(2 * patches.size());
  std::iota(group.begin(), group.end(), 0);
  const auto root = [&](std::size_t i) {
    while (group[i] != i) i = group[i] = group[group[i]];
    return i;
  };
  for (std::size_t p = 0; p < patches.size(); ++p) {
    const SheetPatch& patch = patches[p];
    if (!patch.trim.empty()) continue;
    for (std::size_t side = 0; side < 4; ++side) {
      const SheetJoin& first = patch.joins[side * SheetPatch::kParts];
      if (first.patch == SheetJoin::kOpen || !patches[first.patch].trim.empty()) continue;
      const std::size_t other = first.part / SheetPatch::kParts;
      if (is_joined_to_one_side(patch, side))
        group[root(2 * p + (side < 2 ? 1 : 0))] = root(2 * first.patch + (other < 2 ? 1 : 0));
    }
  }
  std::vector<int> most(group.size(), 1);
  for (std::size_t i = 0; i < group.size(); ++i) most[root(i)] = std::max(most[root(i)], cells[i / 2][i % 2]);
  for (std::size_t i = 0; i < group.size(); ++i) cells[i / 2][i % 2] = most[root(i)];
}

/// Vertices in the cells of a grid, where near ones are found.
class VertexGrid {
 public:
  VertexGrid(const std::vector<Vec3>& vertices, double same) : vertices_(vertices), same_(same), cell_(4 * same) {}

  /// Returns a vertex of the grid that is at the same place, but for `same`; null if there is none.
  [[nodiscard]] const Vec3* at(const Vec3& place) const {
    const Key low = key(place - Vec3::Constant(same_)), high = key(place + Vec3::Constant(same_));
    for (std::int64_t x = low[0]; x <= high[0]; ++x)
      for (std::int64_t y = low[1]; y <= high[1]; ++y)
        for (std::int64_t z = low[2]; z <= high[2]; ++z)
          if (const auto list = grid_.find({x, y, z}); list != grid_.end())
            for (const std::uint32_t i : list->second)
              if ((vertices_[i] - place).norm() < same_) return &vertices_[i];
    return nullptr;
  }

  void add(std::uint32_t i) { grid_[key(vertices_[i])].push_back(i); }

 private:
  using Key = std::array<std::int64_t, 3>;

  [[nodiscard]] Key key(const Vec3& place) const {
    return {static_cast<std::int64_t>(std::floor(place.x() / cell_)),
            static_cast<std::int64_t>(std::floor(place.y() / cell_)),
            static_cast<std::int64_t>(std::floor(place.z() / cell_))};
  }

  const std::vector<Vec3>& vertices_;
  double same_, cell_;
  std::map<Key, std::vector<std::uint32_t>> grid_;
};

/// Gives vertices of different patches at the same place the same coordinates, so that no gap is between them.
void close_seams(const std::vector<SheetPatch>& patches, double same, SheetMesh& made) {
  VertexGrid grid(made.mesh.vertices, same);
  for (std::uint32_t i = 0; i < made.places.size(); ++i) {
    const SheetPatch& patch = patches[made.places[i].patch];
    const Vec2& at = made.places[i].at;
    if (patch.trim.empty() && (at.array() > patch.surface.least().array()).all() &&
        (at.array() < patch.surface.most().array()).all())
      continue;
    if (const Vec3* const known = grid.at(made.mesh.vertices[i]))
      made.mesh.vertices[i] = *known;
    else
      grid.add(i);
  }
}

/// Drops triangles without an area.
void drop_flat_triangles(TriangleMesh& mesh) {
  std::erase_if(mesh.triangles, [&](const auto& t) {
    const Vec3 &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
    const double longest = std::max({(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()});
    return !((b - a).cross(c - a).norm() > 1e-14 * longest);
  });
}

}  // namespace

SheetMesh NurbsSheet::tessellate(double tolerance) const {
  std::vector<CellCounts> cells = cells_within(patches_, tolerance);
  match_cells(patches_, cells);
  SheetMesh made;
  for (std::uint32_t p = 0; p < patches_.size(); ++p) StripMesher(patches_[p], p, cells[p], made).triangulate();
  close_seams(patches_, kSameEdge * size_, made);
  drop_flat_triangles(made.mesh);
  return made;
}

}  // namespace haptrace
