#include "scene/shape/nurbs_patch.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace haptrace {

NurbsPatch::NurbsPatch(const NurbsData& data) : knots_(data.knots) {
  for (std::size_t side = 0; side < 2; ++side) {
    degree_[side] = static_cast<std::size_t>(data.degree[side]);
    count_[side] = static_cast<std::size_t>(data.count[side]);
    least_[static_cast<int>(side)] = data.least(side);
    most_[static_cast<int>(side)] = data.most(side);
  }
  points_.reserve(data.points.size());
  for (const Eigen::Vector4d& point : data.points) {
    Eigen::Vector4d weighted = point[3] * point;
    weighted[3] = point[3];
    points_.push_back(weighted);
  }
}

int NurbsPatch::spans(std::size_t side) const noexcept {
  int spans = 0;
  for (std::size_t i = degree_[side]; i < count_[side]; ++i)
    if (knots_[side][i + 1] > knots_[side][i]) ++spans;
  return spans;
}

void NurbsPatch::basis(std::size_t side, double x, Basis& basis) const noexcept {
  const std::vector<double>& knots = knots_[side];
  const std::size_t p = degree_[side], n = count_[side];
  const auto first = knots.begin() + static_cast<std::ptrdiff_t>(p);
  auto after = std::upper_bound(first, knots.begin() + static_cast<std::ptrdiff_t>(n), x);
  if (after == first) ++after;
  auto span = static_cast<std::size_t>(after - knots.begin()) - 1;
  while (span + 1 > p && !(knots[span + 1] > knots[span])) --span;  // at the end of the domain
  if (span < p) span = p;
  while (!(knots[span + 1] > knots[span])) ++span;
  basis.first = span - p;
  basis.value[0] = 1;
  basis.d1[0] = basis.d2[0] = 0;
  // From degree k - 1 to k. The derivative of degree k comes from the values of degree k - 1, the second one from the
  // first one.
  for (std::size_t k = 1; k <= p; ++k) {
    double value = 0, d1 = 0, d2 = 0;
    const double slope = static_cast<double>(k);
    for (std::size_t r = 0; r < k; ++r) {
      const double low = knots[span + 1 + r - k], high = knots[span + 1 + r];
      const double share = 1 / (high - low);
      const double of_value = basis.value[r] * share, of_d1 = basis.d1[r] * share;
      basis.d2[r] = d2 - slope * of_d1;
      d2 = slope * of_d1;
      basis.d1[r] = d1 - slope * of_value;
      d1 = slope * of_value;
      basis.value[r] = value + (high - x) * of_value;
      value = (x - low) * of_value;
    }
    basis.value[k] = value;
    basis.d1[k] = d1;
    basis.d2[k] = d2;
  }
}

SurfaceJet NurbsPatch::jet(double u, double v) const noexcept {
  using Vec4 = Eigen::Vector4d;
  Basis bu, bv;
  basis(0, u, bu);
  basis(1, v, bv);
  Vec4 a = Vec4::Zero(), au = a, av = a, auu = a, auv = a, avv = a;
  for (std::size_t i = 0; i <= degree_[0]; ++i) {
    const Vec4* const row = &points_[(bu.first + i) * count_[1] + bv.first];
    Vec4 r = Vec4::Zero(), rv = r, rvv = r;
    for (std::size_t j = 0; j <= degree_[1]; ++j) {
      r += bv.value[j] * row[j];
      rv += bv.d1[j] * row[j];
      rvv += bv.d2[j] * row[j];
    }
    a += bu.value[i] * r;
    au += bu.d1[i] * r;
    auu += bu.d2[i] * r;
    av += bu.value[i] * rv;
    auv += bu.d1[i] * rv;
    avv += bu.value[i] * rvv;
  }
  const double share = 1 / a[3];
  SurfaceJet jet;
  jet.s = share * a.head<3>();
  jet.u = share * (au.head<3>() - au[3] * jet.s);
  jet.v = share * (av.head<3>() - av[3] * jet.s);
  jet.uu = share * (auu.head<3>() - 2 * au[3] * jet.u - auu[3] * jet.s);
  jet.uv = share * (auv.head<3>() - au[3] * jet.v - av[3] * jet.u - auv[3] * jet.s);
  jet.vv = share * (avv.head<3>() - 2 * av[3] * jet.v - avv[3] * jet.s);
  return jet;
}

// --- Creases ---

namespace {

/// Returns the index of the first knot at which the derivative in this direction may jump, or 0.
std::size_t crease_of(const NurbsData& patch, std::size_t side) {
  const auto p = static_cast<std::size_t>(patch.degree[side]);
  const std::vector<double>& knots = patch.knots[side];
  for (std::size_t i = p + 1; i + p - 1 < knots.size(); ++i)
    if (knots[i] > patch.least(side) && knots[i] < patch.most(side) && knots[i + p - 1] == knots[i]) return i;
  return 0;
}

}  // namespace

std::vector<NurbsData> split_at_creases(NurbsData patch) {
  std::vector<NurbsData> done, left;
  left.push_back(std::move(patch));
  while (!left.empty()) {
    NurbsData whole = std::move(left.back());
    left.pop_back();
    std::size_t side = 0, at = 0;
    if (whole.outer.empty() && whole.holes.empty())
      for (; side < 2 && at == 0; ++side) at = crease_of(whole, side);
    if (at == 0) {
      done.push_back(std::move(whole));
      continue;
    }
    --side;
    // At a knot that is there as often as the degree says, the surface passes through a line of points.
    const auto p = static_cast<std::size_t>(whole.degree[side]);
    const std::vector<double>& knots = whole.knots[side];
    const double knot = knots[at];
    const auto part = [&](std::size_t first, std::size_t count) {
      NurbsData half = whole;
      half.count[side] = static_cast<int>(count);
      half.points.clear();
      for (std::size_t i = 0; i < static_cast<std::size_t>(whole.count[0]); ++i)
        for (std::size_t j = 0; j < static_cast<std::size_t>(whole.count[1]); ++j)
          if (const std::size_t k = side == 0 ? i : j; k >= first && k < first + count)
            half.points.push_back(whole.points[i * static_cast<std::size_t>(whole.count[1]) + j]);
      return half;
    };
    NurbsData lower = part(0, at), upper = part(at - 1, static_cast<std::size_t>(whole.count[side]) - at + 1);
    lower.knots[side].assign(knots.begin(), knots.begin() + static_cast<std::ptrdiff_t>(at + p));
    lower.knots[side].push_back(knot);
    upper.knots[side].assign(knots.begin() + static_cast<std::ptrdiff_t>(at), knots.end());
    upper.knots[side].insert(upper.knots[side].begin(), knot);
    left.push_back(std::move(upper));
    left.push_back(std::move(lower));
  }
  return done;
}

// --- Trimming ---

namespace {

double cross_of(const Vec2& a, const Vec2& b) noexcept {
  return a.x() * b.y() - a.y() * b.x();
}

double area_of(const NurbsData::Loop& loop) {
  double area = 0;
  for (std::size_t i = 0; i < loop.size(); ++i) area += 0.5 * cross_of(loop[i], loop[(i + 1) % loop.size()]);
  return area;
}

}  // namespace

NurbsTrim::NurbsTrim(const NurbsData& data) {
  if (data.outer.empty() && data.holes.empty()) return;
  least_ = {data.least(0), data.least(1)};
  const Vec2 most(data.most(0), data.most(1));
  size_ = most - least_;
  const auto add = [&](NurbsData::Loop loop, bool left) {
    if ((area_of(loop) > 0) != left) std::reverse(loop.begin(), loop.end());
    const auto first = static_cast<std::uint32_t>(parts_.size()), count = static_cast<std::uint32_t>(loop.size());
    for (std::uint32_t i = 0; i < count; ++i)
      parts_.push_back({loop[i], loop[(i + 1) % count], first + (i + 1) % count, first + (i + count - 1) % count});
  };
  if (data.outer.empty()) {
    constexpr int kParts = 32;  // along an edge, for the search for its neighbours
    NurbsData::Loop edges;
    for (const auto& [from, to] : {std::pair(Vec2(0, 0), Vec2(1, 0)), std::pair(Vec2(1, 0), Vec2(1, 1)),
                                   std::pair(Vec2(1, 1), Vec2(0, 1)), std::pair(Vec2(0, 1), Vec2(0, 0))})
      for (int i = 0; i < kParts; ++i)
        edges.push_back(least_ + size_.cwiseProduct(from + (static_cast<double>(i) / kParts) * (to - from)));
    add(edges, true);
  }
  for (const NurbsData::Loop& loop : data.outer) add(loop, true);
  for (const NurbsData::Loop& loop : data.holes) add(loop, false);

  // A cell is on the surface if its middle is, and no part of a loop is near.
  inside_.assign(kCells * kCells, 1);
  const auto at = [](int i, int j) { return static_cast<std::size_t>(i) * kCells + static_cast<std::size_t>(j); };
  for (const Part& part : parts_) {
    const Vec2 low = part.from.cwiseMin(part.to), high = part.from.cwiseMax(part.to);
    const int i0 = std::max(0, cell_of(low.x(), 0) - 1), i1 = std::min(kCells - 1, cell_of(high.x(), 0) + 1);
    const int j0 = std::max(0, cell_of(low.y(), 1) - 1), j1 = std::min(kCells - 1, cell_of(high.y(), 1) + 1);
    for (int i = i0; i <= i1; ++i)
      for (int j = j0; j <= j1; ++j) inside_[at(i, j)] = 0;
  }
  for (int i = 0; i < kCells; ++i)
    for (int j = 0; j < kCells; ++j)
      if (inside_[at(i, j)] != 0 && !holds(least_ + size_.cwiseProduct(Vec2(i + 0.5, j + 0.5) / kCells)))
        inside_[at(i, j)] = 0;
}

int NurbsTrim::cell_of(double x, int axis) const noexcept {
  const double cell = std::floor((x - least_[axis]) / size_[axis] * kCells);
  return static_cast<int>(std::clamp(cell, 0.0, kCells - 1.0));
}

bool NurbsTrim::clear(const Vec2& a, const Vec2& b) const noexcept {
  const Vec2 low = a.cwiseMin(b), high = a.cwiseMax(b);
  if (!((low - least_).array() >= 0).all() || !((high - least_ - size_).array() <= 0).all()) return false;
  const int i0 = cell_of(low.x(), 0), i1 = cell_of(high.x(), 0), j0 = cell_of(low.y(), 1), j1 = cell_of(high.y(), 1);
  if ((i1 - i0 + 1) * (j1 - j0 + 1) > 16) return false;
  for (int i = i0; i <= i1; ++i)
    for (int j = j0; j <= j1; ++j)
      if (inside_[static_cast<std::size_t>(i) * kCells + static_cast<std::size_t>(j)] == 0) return false;
  return true;
}

bool NurbsTrim::holds(const Vec2& place) const noexcept {
  bool odd = false;
  for (const Part& part : parts_) {
    const bool above = part.from.y() > place.y();
    if (above == (part.to.y() > place.y())) continue;
    // To the right of the part that crosses the place's height.
    if ((cross_of(part.to - part.from, place - part.from) > 0) == above) odd = !odd;
  }
  return odd;
}

std::uint32_t NurbsTrim::nearest(Vec2& place) const noexcept {
  std::uint32_t best = kNone;
  double least = std::numeric_limits<double>::infinity();
  const Vec2 from = place;
  for (std::uint32_t i = 0; i < parts_.size(); ++i) {
    const Vec2 way = (parts_[i].to - parts_[i].from).cwiseQuotient(size_);
    const Vec2 out = (from - parts_[i].from).cwiseQuotient(size_);
    const double share = std::clamp(out.dot(way) / way.squaredNorm(), 0.0, 1.0);
    const double distance = (out - share * way).squaredNorm();
    if (distance < least) {
      least = distance;
      best = i;
      place = parts_[i].from + share * (parts_[i].to - parts_[i].from);
    }
  }
  return best;
}

std::uint32_t NurbsTrim::stop(const Vec2& from, Vec2& to) const noexcept {
  if (clear(from, to)) return kNone;
  const Vec2 way = to - from;
  std::uint32_t best = kNone;
  double first = std::numeric_limits<double>::infinity();
  Vec2 place = to;
  for (std::uint32_t i = 0; i < parts_.size(); ++i) {
    const Vec2 along = parts_[i].to - parts_[i].from;
    const double out = -cross_of(along, way);  // positive: the step goes to the right of the part
    if (!(out > 0)) continue;
    const Vec2 off = parts_[i].from - from;
    const double of_step = cross_of(off, along) / cross_of(way, along);
    const double of_part = cross_of(off, way) / cross_of(way, along);
    if (of_step < -1e-9 || of_step > 1 || of_part < -1e-9 || of_part > 1 + 1e-9) continue;
    if (of_step < first) {
      first = of_step;
      best = i;
      place = parts_[i].from + std::clamp(of_part, 0.0, 1.0) * along;
    }
  }
  if (best != kNone) {
    to = place;
    return best;
  }
  if (holds(to)) return kNone;
  return nearest(to);
}

}  // namespace haptrace
