#include "scene/shape/implicit.h"

#include "base/error.h"
#include "control/norm.h"
#include "scene/shape/level_set.h"
#include "scene/shape/sign_change.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr int kCoarse = 32;              // cells along each side for the start of a search
constexpr int kMostMoves = 24;           // of a proxy in a tick
constexpr int kMostParts = 200;          // of a line that is searched for a root
constexpr double kLongestMove = 0.1;     // of the radius of curvature
constexpr double kNothing = 1e-13;       // of the size: a move that is none
constexpr double kLeft = 1e-10;          // of the size: error of the proxy along the surface
constexpr double kShort = 1e-6;          // of the size: nothing is looked for within so short a move
constexpr double kUnseen = 1e-10;        // of the size: thinner parts are not seen by a proxy that moves on the surface
constexpr double kParallel = 1e-10;      // determinant of normals that say the same
constexpr double kLeastStretch = 1e-3;   // where the tool reaches the centre of curvature
constexpr std::uint32_t kPieceBits = 8;  // of a number of a piece in the contact's memory

/// Solves the symmetric equations gram x = b of count unknowns. False: they say the same.
bool solved(std::size_t count, const Eigen::Matrix3d& gram, const Vec3& b, Vec3& x) noexcept {
  x.setZero();
  if (count == 1) {
    x[0] = b[0] / gram(0, 0);
    return true;
  }
  if (count == 2) {
    const double determinant = gram(0, 0) * gram(1, 1) - gram(0, 1) * gram(0, 1);
    if (!(determinant > kParallel)) return false;
    x[0] = (gram(1, 1) * b[0] - gram(0, 1) * b[1]) / determinant;
    x[1] = (gram(0, 0) * b[1] - gram(0, 1) * b[0]) / determinant;
    return true;
  }
  if (!(gram.determinant() > kParallel)) return false;
  x = gram.inverse() * b;
  return true;
}

/// Returns the longest step on a surface of this curvature [1/m], which is at most `most` [m].
double limit_of(double most, double curvature) noexcept {
  return most * curvature > kLongestMove ? kLongestMove / curvature : most;
}

/// Directions along all held pieces.
struct Tangents {
  std::array<Vec3, 2> of{};
  std::size_t count = 0;

  Tangents(const std::array<Vec3, 3>& normals, std::size_t held) noexcept {
    if (held == 1) {
      of[0] = normals[0].unitOrthogonal();
      of[1] = normals[0].cross(of[0]);
      count = 2;
    } else if (held == 2) {
      of[0] = normals[0].cross(normals[1]).stableNormalized();
      count = 1;
    }
  }
};

/// Returns T (T' (I - bent) T)^-1 T', whose eigenvalues are bounded where the tool reaches a centre of curvature; the
/// inverse is that of a minimum: eigenvalues count without their sign.
Eigen::Matrix3d stretched(const Tangents& tangents, const Eigen::Matrix3d& bent) noexcept {
  const auto stretch = [](double e) { return 1 / std::max(kLeastStretch, std::abs(e)); };
  const auto& t = tangents.of;
  if (tangents.count == 0) return Eigen::Matrix3d::Zero();
  const double a = 1 - t[0].dot(bent * t[0]);
  if (tangents.count == 1) return stretch(a) * t[0] * t[0].transpose();
  const double b = 1 - t[1].dot(bent * t[1]), c = -t[0].dot(bent * t[1]);
  const double half = 0.5 * (a - b), angle = 0.5 * std::atan2(c, half), size = std::hypot(half, c),
               mean = 0.5 * (a + b);
  const Vec3 along = std::cos(angle) * t[0] + std::sin(angle) * t[1],
             across = std::cos(angle) * t[1] - std::sin(angle) * t[0];
  return stretch(mean + size) * along * along.transpose() + stretch(mean - size) * across * across.transpose();
}

}  // namespace

bool Implicit::Held::has(std::uint32_t one) const noexcept {
  return std::find(piece.begin(), piece.begin() + static_cast<std::ptrdiff_t>(count), one) !=
         piece.begin() + static_cast<std::ptrdiff_t>(count);
}

void Implicit::Held::drop(std::size_t i) noexcept {
  for (; i + 1 < count; ++i) piece[i] = piece[i + 1];
  --count;
}

void Implicit::Held::add(std::uint32_t one) noexcept {
  if (has(one)) return;
  if (count == piece.size()) drop(0);
  piece[count++] = one;
}

Implicit::Implicit(FieldNode root, const Box& box, std::vector<std::string> remarks)
    : field_(std::move(root)),
      box_(box),
      size_(box.size().maxCoeff()),
      coarse_(triangles({kCoarse, kCoarse, kCoarse})),
      tree_(coarse_),
      remarks_(std::move(remarks)) {
  if (coarse_.triangles.empty())
    throw input_error(fmt::format(
        "no place is inside the surface: f < 0 on none of {} x {} x {} points of the box from [{:g}, {:g}, {:g}] to "
        "[{:g}, {:g}, {:g}] m. Check the box, the sign (f < 0 is inside) and the unit (metres); a thin solid needs a "
        "box that fits "
        "it",
        kCoarse + 1, kCoarse + 1, kCoarse + 1, box.min.x(), box.min.y(), box.min.z(), box.max.x(), box.max.y(),
        box.max.z()));
  // A gradient that belongs to the values of the field is about their range per size of the box.
  double range = 0;
  std::size_t without = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 place(corner & 1 ? box.max.x() : box.min.x(), corner & 2 ? box.max.y() : box.min.y(),
                     corner & 4 ? box.max.z() : box.min.z());
    if (const double value = std::abs(field_.value(place)); std::isfinite(value)) range = std::max(range, value);
  }
  for (const Vec3& vertex : coarse_.vertices) {
    const FieldTree::Active active = field_.active(vertex);
    const double slope = field_.slope(active.piece, vertex).vector().norm();
    if (!(slope * size_ > 1e-4 * range)) ++without;
  }
  if (without > 0)
    remarks_.push_back(
        fmt::format("the gradient of the surface vanishes, or nearly so, at {} of {} points; the tool may feel nothing "
                    "there. Write the field so that it falls evenly towards the inside, as a distance does",
                    without, coarse_.vertices.size()));
}

void Implicit::prepare(double radius) {
  if (radius > 0)
    throw input_error(
        "a ball cannot touch an implicit surface: its centre would have to keep the distance of its radius, and a "
        "field states no distance. Use a point (\"tool\": {\"radius\": 0}), or make the object a mesh");
}

// --- Lines ---

/// Returns where the way from one place to another, which begins outside, enters the solid.
Implicit::Sweep Implicit::sweep(const Vec3& from, const Vec3& to) const noexcept {
  Sweep result{.place = to};
  const Vec3 way = to - from;
  const double length = norm_of(way);
  if (!(length > 0)) return result;
  const double least = std::max(1e-12 * size_ / length, 1e-15);
  const auto at = [&](double t) { return field_.value(from + t * way); };
  const auto root = [&](double out, double in) {
    const double value = at(out);
    const SignChange change = value >= 0 ? narrow(at, {.in = in, .out = out}, at(in), value, 0.1 * least, 100)
                                         : SignChange{.in = out, .out = out};  // inside already, but for rounding
    result.hit = true;
    result.share = change.out;
    result.place = from + change.out * way;
    result.piece = field_.active(from + change.in * way).piece;
  };

  std::array<double, 64> ends{};
  std::size_t count = 1;
  ends[0] = 1;
  double begin = 0;
  for (int part = 0; count > 0; ++part) {
    const double end = ends[count - 1], half = 0.5 * (end - begin), middle = begin + half;
    const Span span = field_.along(from, way, {begin, end});
    const bool outside = span.value.lo > 0 || (span.rate.finite() && at(middle) - half * span.rate.most() > 0);
    if (!outside) {
      // Where the field only falls, or only rises from a value that is not inside but for rounding, its end decides.
      const bool one_way = span.rate.finite() && (span.rate.lo > 0 || span.rate.hi < 0);
      if (!one_way && !(2 * half <= least) && part < kMostParts && count < ends.size()) {
        ends[count++] = middle;
        continue;
      }
      if (at(end) < 0) {
        root(begin, end);
        return result;
      }
    }
    begin = end;
    --count;
  }
  return result;
}

/// Looks for the solid between the proxy and its next place, a little outside the pieces that hold it.
Implicit::Sweep Implicit::between(const Stand& stand, const Move& move) const noexcept {
  const double length = norm_of(move.step);
  if (!(length > kShort * size_)) return {};
  const double lift = move.bend * length * length + 1e-6 * length + kUnseen * size_;
  const Vec3 up = lift * move.out;
  if (lift > 1e-4 * size_) {
    // So far out that something thin might be passed on the way there.
    Sweep out = sweep(stand.place + kUnseen * size_ * move.out, stand.place + up);
    if (out.hit) {
      out.share = 0;
      return out;
    }
  }
  return sweep(stand.place + up, stand.place + up + move.step);
}

// --- The closest point ---

/// The held pieces at a place: their jets, unit normals and distances from it, and how hard each holds.
class Implicit::Pieces {
 public:
  explicit Pieces(Held& held) noexcept : held_(held) {}

  /// Returns false if a piece has no direction there.
  bool look(const FieldTree& field, const Vec3& place) noexcept {
    for (std::size_t i = 0; i < held_.count; ++i) {
      const int k = static_cast<int>(i);
      jets[i] = field.jet(held_.piece[i], place);
      slopes[k] = norm_of(jets[i].vector());
      normals[i] = jets[i].vector() / slopes[k];
      off[k] = jets[i].value / slopes[k];
      if (!(slopes[k] > 0 && is_finite(normals[i]) && std::isfinite(off[k]) && jets[i].matrix().allFinite()))
        return false;
    }
    return true;
  }

  /// Finds how hard each piece holds a proxy that is drawn by -back. Drops the pieces that say the same as another, and
  /// those that would have to pull, unless `pulls`. Returns false if two against each other hold it.
  bool balance(const Vec3& back, bool pulls) noexcept {
    while (held_.count > 0) {
      Vec3 along = Vec3::Zero();
      for (std::size_t i = 0; i < held_.count; ++i) {
        along[static_cast<int>(i)] = normals[i].dot(back);
        for (std::size_t j = 0; j < held_.count; ++j)
          gram(static_cast<int>(i), static_cast<int>(j)) = normals[i].dot(normals[j]);
      }
      if (!solved(held_.count, gram, along, pull)) {
        // Two against each other, or three that leave no way in their plane: nothing moves. Otherwise the oldest goes.
        if (held_.count == 2 && gram(0, 1) < 0) return false;
        drop(0);
        continue;
      }
      if (pulls) break;
      int least = 0;
      if (!(pull.head(static_cast<int>(held_.count)).minCoeff(&least) < 0)) break;
      drop(static_cast<std::size_t>(least));
    }
    return true;
  }

  std::array<Jet, 3> jets{};
  std::array<Vec3, 3> normals{};
  Vec3 off = Vec3::Zero(), slopes = Vec3::Zero();
  Eigen::Matrix3d gram = Eigen::Matrix3d::Identity();  ///< products of the normals
  Vec3 pull = Vec3::Zero();                            ///< l_i |grad f_i|

 private:
  void drop(std::size_t i) noexcept {
    held_.drop(i);
    for (; i < held_.count; ++i) {
      jets[i] = jets[i + 1];
      normals[i] = normals[i + 1];
      off[static_cast<int>(i)] = off[static_cast<int>(i) + 1];
      slopes[static_cast<int>(i)] = slopes[static_cast<int>(i) + 1];
    }
  }

  Held& held_;
};

/// Returns Newton's step towards the place nearest to `to` on the held pieces. Drops the pieces that would have to
/// pull, unless `pulls`, and those that say the same as another.
Implicit::Move Implicit::newton(const Vec3& to, bool pulls, Stand& stand) const noexcept {
  Held& held = stand.held;
  Move move;
  Pieces at(held);
  if (!at.look(field_, stand.place)) return move;
  const Vec3 back = stand.place - to;
  if (!at.balance(back, pulls)) {
    move.result = Move::Result::stuck;
    return move;
  }
  if (held.count == 0) {
    move.result = Move::Result::free;
    return move;
  }

  Vec3 normal_part = Vec3::Zero(), share = Vec3::Zero(), ones = Vec3::Ones();
  (void)solved(held.count, at.gram, -at.off, share);
  Vec3 out_share = Vec3::Zero();
  (void)solved(held.count, at.gram, ones, out_share);
  Eigen::Matrix3d bent = Eigen::Matrix3d::Zero();
  move.slope = at.slopes[0];
  for (std::size_t i = 0; i < held.count; ++i) {
    const int k = static_cast<int>(i);
    normal_part += share[k] * at.normals[i];
    move.out += out_share[k] * at.normals[i];
    const Eigen::Matrix3d hessian = at.jets[i].matrix() / at.slopes[k];
    bent += at.pull[k] * hessian;
    move.bend = std::max(move.bend, hessian.norm());
    move.slope = std::min(move.slope, at.slopes[k]);
  }
  const Vec3 rest = back + normal_part - bent * normal_part;
  move.step = normal_part - stretched(Tangents(at.normals, held.count), bent) * rest;
  move.result = is_finite(move.step) ? Move::Result::moves : Move::Result::lost;
  return move;
}

/// Takes the proxy to the place nearest to `to` that it can reach. Returns false if it is free, or has no direction.
bool Implicit::walk(const Vec3& to, bool pulls, Stand& stand) const noexcept {
  Held& held = stand.held;
  double most = 0.125 * size_;
  int steps = 0;
  for (int i = 0; i < kMostMoves && steps < steps_; ++i) {
    if (held.count == 0) {
      const Sweep fall = sweep(stand.place, to);
      if (!fall.hit) return false;
      stand.place = fall.place;
      held.add(fall.piece);
    }
    Move move = newton(to, pulls, stand);
    if (move.result == Move::Result::lost) return false;
    if (move.result == Move::Result::stuck) return true;
    if (move.result == Move::Result::free) continue;
    const double length = norm_of(move.step), limit = limit_of(most, move.bend);
    const bool limited = length > limit;
    if (limited) move.step *= limit / length;
    if (const Sweep hit = between(stand, move); hit.hit) {
      if (held.has(hit.piece)) {
        most = 0.25 * std::min(length, limit);
        if (!(most > kUnseen * size_)) return true;
      } else {
        stand.place += hit.share * move.step;
        held.add(hit.piece);
      }
      continue;
    }
    stand.place += move.step;
    const FieldTree::Active active = field_.active(stand.place);
    bool changed = false;
    if (!held.has(active.piece)) {
      changed = true;
      if (active.value > kUnseen * size_ * move.slope)
        held.count = 0;  // over an outer edge
      else if (active.value < -kUnseen * size_ * move.slope)
        held.add(active.piece);
      else
        changed = false;
    }
    // The remaining error is of the order of the step squared; polish() removes its part along the normal.
    if (held.count > 0 && !changed && !limited && move.bend * length * length <= kLeft * size_) return true;
    if (!limited) ++steps;
  }
  if (held.count > 0) return true;
  const Sweep fall = sweep(stand.place, to);
  if (!fall.hit) return false;
  stand.place = fall.place;
  held.add(fall.piece);
  return true;
}

/// Brings the proxy onto its pieces, and sets their normals.
bool Implicit::polish(Stand& stand, std::array<Vec3, 3>& normals) const noexcept {
  Held& held = stand.held;
  for (int round = 0; round < 4; ++round) {
    Vec3 off = Vec3::Zero(), share = Vec3::Zero();
    Eigen::Matrix3d gram = Eigen::Matrix3d::Identity();
    for (std::size_t i = 0; i < held.count; ++i) {
      const Slope slope = field_.slope(held.piece[i], stand.place);
      const double steep = norm_of(slope.vector());
      normals[i] = slope.vector() / steep;
      off[static_cast<int>(i)] = slope.value / steep;
      if (!(steep > 0) || !is_finite(normals[i]) || !std::isfinite(off[static_cast<int>(i)])) return false;
      for (std::size_t j = 0; j <= i; ++j)
        gram(static_cast<int>(i), static_cast<int>(j)) = gram(static_cast<int>(j), static_cast<int>(i)) =
            normals[i].dot(normals[j]);
    }
    if (off.cwiseAbs().maxCoeff() <= kNothing * size_ || !solved(held.count, gram, -off, share)) break;
    Vec3 move = Vec3::Zero();
    for (std::size_t i = 0; i < held.count; ++i) move += share[static_cast<int>(i)] * normals[i];
    if (!(norm_of(move) < 0.01 * size_)) break;
    stand.place += move;
  }
  return true;
}

bool Implicit::begin(const ToolStep& step, Stand& stand, bool& inside) const noexcept {
  const bool known = !std::isnan(step.from.x());
  // A step outside the box meets nothing.
  for (int axis = 0; axis < 3; ++axis) {
    const double from = known ? step.from[axis] : step.to[axis];
    if (std::max(from, step.to[axis]) < box_.min[axis] || std::min(from, step.to[axis]) > box_.max[axis]) return false;
  }
  if (!known || field_.value(step.from) < 0) {
    if (!(field_.value(step.to) < 0)) return false;
    stand.place = closest(step.to, stand.held);
    inside = true;
    return true;
  }
  const Sweep hit = sweep(step.from, step.to);
  if (!hit.hit) return false;
  stand.place = hit.place;
  stand.held.add(hit.piece);
  inside = false;
  return true;
}

void Implicit::follow(const ToolStep& step, Proxy& proxy) const noexcept {
  if (!is_finite(step.to)) return;
  Stand stand;
  bool inside = proxy.began_inside;
  const bool lasts = proxy.touching && step.reach > 0;
  if (proxy.touching) {
    stand.place = proxy.position;
    for (std::uint32_t packed = proxy.memory.index[0]; packed != 0; packed >>= kPieceBits)
      stand.held.add(packed & ((1U << kPieceBits) - 1));
  } else if (!begin(step, stand, inside)) {
    return release(proxy);
  }
  const Stand before = stand;
  // In front of the surface, one piece holds the tool back within the reach.
  bool pulls = lasts && stand.held.count == 1;
  std::array<Vec3, 3> normals{};
  bool held = walk(step.to, pulls, stand) && polish(stand, normals);
  if (held && pulls && (stand.held.count != 1 || normals[0].dot(stand.place - step.to) < -step.reach)) {
    stand = before;
    pulls = false;
    held = walk(step.to, pulls, stand) && polish(stand, normals);
  }
  if (!held) return release(proxy);

  const Vec3 back = stand.place - step.to;
  const double distance = norm_of(back);
  double depth = normals[0].dot(back);
  Vec3 normal = normals[0];
  if (stand.held.count > 1 || (!pulls && !(depth > 0))) {
    // Held by several pieces, or not yet by the right one: the way back is the direction.
    for (std::size_t i = 1; i < stand.held.count; ++i) normal += normals[i];
    if (distance > kNothing * size_)
      normal = back / distance;
    else
      normal = normal.stableNormalized();
    depth = distance;
    if (!(field_.value(step.to) < 0)) return release(proxy);
  }
  proxy.position = stand.place;
  proxy.normal = normal;
  proxy.depth = depth;
  proxy.known = proxy.touching = true;
  proxy.began_inside = inside;
  remember(stand.held, proxy);
}

void Implicit::approach(const ToolStep& step, Proxy& proxy) const noexcept {
  if (!is_finite(step.to) || field_.value(step.to) < 0) return;
  const double most = step.reach + (box_.size() / kCoarse).norm();
  if (!(tree_.nearest(step.to, most * most).distance2 < most * most)) return;
  Held held;
  const SurfacePoint point = nearest(step.to, held);
  if (!(point.distance < step.reach)) return;
  proxy = {
      .position = point.position, .normal = point.normal, .depth = -point.distance, .known = true, .touching = true};
  remember(held, proxy);
}

void Implicit::remember(const Held& held, Proxy& proxy) noexcept {
  proxy.memory.index = {};
  for (std::size_t i = held.count; i-- > 0;)
    proxy.memory.index[0] = proxy.memory.index[0] << kPieceBits | held.piece[i];
}

Eigen::Matrix3d Implicit::slide(const Proxy& proxy) const noexcept {
  std::array<Vec3, 3> normals{};
  std::array<Eigen::Matrix3d, 3> hessians{};
  std::size_t count = 0;
  Eigen::Matrix3d gram = Eigen::Matrix3d::Identity();
  Vec3 along = Vec3::Zero(), pull = Vec3::Zero();
  for (std::uint32_t packed = proxy.memory.index[0]; packed != 0; packed >>= kPieceBits) {
    const Jet jet = field_.jet(packed & ((1U << kPieceBits) - 1), proxy.position);
    const double slope = norm_of(jet.vector());
    normals[count] = jet.vector() / slope;
    hessians[count] = jet.matrix() / slope;
    if (!is_finite(normals[count]) || !hessians[count].allFinite()) return Shape::slide(proxy);
    along[static_cast<int>(count)] = proxy.depth * normals[count].dot(proxy.normal);
    for (std::size_t j = 0; j <= count; ++j)
      gram(static_cast<int>(count), static_cast<int>(j)) = gram(static_cast<int>(j), static_cast<int>(count)) =
          normals[count].dot(normals[j]);
    ++count;
  }
  if (count == 0 || !solved(count, gram, along, pull)) return Shape::slide(proxy);
  Eigen::Matrix3d bent = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < count; ++i) bent += pull[static_cast<int>(i)] * hessians[i];
  return stretched(Tangents(normals, count), bent);
}

// --- Without history ---

/// Returns the surface point nearest to a place, and its pieces: from the nearest triangle by Newton's method. At an
/// outer edge the pieces on both sides hold it.
Vec3 Implicit::closest(const Vec3& place, Held& held) const noexcept {
  const TriangleTree::Nearest nearest = tree_.nearest(place);
  const Vec3 first = nearest.point.position;
  const double cell = (box_.size() / kCoarse).norm();
  Stand stand{.place = first, .held = {}};
  stand.held.add(field_.active(first).piece);
  constexpr int kMostTries = 60;
  for (int i = 0; i < kMostTries; ++i) {
    const Move move = newton(place, true, stand);
    if (move.result != Move::Result::moves) break;
    const double length = norm_of(move.step), limit = limit_of(size_, move.bend);
    stand.place += length > limit ? Vec3(limit / length * move.step) : move.step;
    if (length > kNothing * size_) continue;
    const FieldTree::Active active = field_.active(stand.place);
    const bool on = std::abs(active.value) <= kUnseen * size_ * move.slope;
    if (!on && !stand.held.has(active.piece) && stand.held.count < 3) {
      stand.held.add(active.piece);
      continue;
    }
    if (!on || (stand.place - place).norm() > std::sqrt(nearest.distance2) + 2 * cell) break;
    held = stand.held;
    return stand.place;
  }
  // Down the gradient, onto the surface near the triangle.
  Vec3 point = first;
  for (int i = 0; i < 20; ++i) {
    const FieldTree::Active active = field_.active(point);
    const Vec3 gradient = field_.slope(active.piece, point).vector();
    const Vec3 step = -active.value / gradient.squaredNorm() * gradient;
    if (!is_finite(step) || step.norm() > cell) break;
    point += step;
    if (step.norm() <= kNothing * size_) break;
  }
  held = {};
  held.add(field_.active(point).piece);
  return point;
}

SurfacePoint Implicit::nearest(const Vec3& place) const noexcept {
  Held held;
  return nearest(place, held);
}

SurfacePoint Implicit::nearest(const Vec3& place, Held& held) const noexcept {
  SurfacePoint point{.position = closest(place, held)};
  const Vec3 out = place - point.position;
  const double distance = norm_of(out), sign = field_.value(place) < 0 ? -1 : 1;
  Vec3 normal = Vec3::Zero();
  for (std::size_t i = 0; i < held.count; ++i)
    normal += field_.slope(held.piece[i], point.position).vector().stableNormalized();
  normal = normal.stableNormalized();
  point.normal = distance > 1e-9 * size_ ? Vec3(sign / distance * out) : is_finite(normal) ? normal : Vec3::UnitZ();
  point.distance = sign * distance;
  return point;
}

bool Implicit::meets(const Box& space) const noexcept {
  if (!Shape::meets(space)) return false;
  // Halves boxes until the field is negative in the middle of one, or in none.
  struct Part {
    Box box;
    int depth;
  };
  std::array<Part, 64> parts{};
  std::size_t count = 1;
  parts[0] = {{box_.min.cwiseMax(space.min), box_.max.cwiseMin(space.max)}, 0};
  for (int i = 0; i < 4000 && count > 0; ++i) {
    const Part part = parts[--count];
    if (field_.over(part.box).lo >= 0) continue;
    if (field_.value(part.box.center()) < 0) return true;
    if (part.depth >= 30) continue;
    int axis = 0;
    part.box.size().maxCoeff(&axis);
    for (const bool upper : {false, true}) {
      Part half{part.box, part.depth + 1};
      (upper ? half.box.min : half.box.max)[axis] = part.box.center()[axis];
      parts[count++] = half;
    }
  }
  return count > 0;  // undecided
}

TriangleMesh Implicit::triangles(const std::array<int, 3>& cells) const {
  // Half a cell further out, so that no side of the solid coincides with a plane of the grid.
  Box box = box_;
  for (int axis = 0; axis < 3; ++axis) {
    const double more = 0.5 * box_.size()[axis] / (cells[static_cast<std::size_t>(axis)] - 1);
    box.min[axis] -= more;
    box.max[axis] += more;
  }
  return level_set([this](const Vec3& place) { return field_.value(place); }, box, cells);
}

TriangleMesh Implicit::tessellated(double tolerance, const Box&) const {
  constexpr double kFewest = 24, kMost = 128;
  double chord = 0.5 * std::sqrt(std::max(tolerance, 0.0) * size_);
  for (;;) {
    std::array<int, 3> cells{};
    for (std::size_t axis = 0; axis < 3; ++axis)
      cells[axis] =
          static_cast<int>(std::clamp(std::ceil(box_.size()[static_cast<int>(axis)] / chord), kFewest, kMost));
    TriangleMesh mesh = triangles(cells);
    if (size_ / chord >= kMost) return mesh;
    // The distance of the middle of a triangle from the surface, to the first order.
    double worst = 0;
    for (const auto& t : mesh.triangles) {
      const Vec3 middle = (mesh.vertices[t[0]] + mesh.vertices[t[1]] + mesh.vertices[t[2]]) / 3;
      const FieldTree::Active active = field_.active(middle);
      const double off = std::abs(active.value) / field_.slope(active.piece, middle).vector().norm();
      if (off > worst) worst = off;
    }
    constexpr double kMargin = 0.6;  // an edge errs more than the middle of a triangle
    if (worst <= kMargin * tolerance) return mesh;
    chord *= std::max(0.4, 0.95 * std::sqrt(kMargin * tolerance / worst));
  }
}

std::vector<Knob> Implicit::knobs() const {
  return {{"steps", "", {1, 2, 4}, static_cast<double>(steps_), 1, kMostSteps}};
}

void Implicit::set(const std::string& knob, double level) {
  if (knob == "steps") steps_ = static_cast<int>(std::lround(level));
}

}  // namespace haptrace
