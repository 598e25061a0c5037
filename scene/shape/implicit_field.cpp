#include "scene/shape/implicit_field.h"

#include "base/error.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

/// The smooth minimum a - k / 6 h^3 of two numbers a <= b, with h = max(0, 1 - (b - a) / k), and its derivatives. Its
/// second derivatives are continuous.
Binary blended(double a, double b, double k) noexcept {
  const double apart = b - a, h = std::max(0.0, 1 - std::abs(apart) / k);
  const double of_larger = 0.5 * h * h, bend = h / k;
  const bool first = apart >= 0;
  return {std::min(a, b) - k / 6 * h * h * h,
          first ? 1 - of_larger : of_larger,
          first ? of_larger : 1 - of_larger,
          -bend,
          bend,
          -bend};
}

template <class N>
N least(const N& a, const N& b, double k) noexcept {
  const double x = value_of(a), y = value_of(b);
  if (k > 0 && std::abs(x - y) < k) return chained(a, b, blended(x, y, k));
  return y < x || std::isnan(x) ? b : a;
}

Interval least(Interval a, Interval b, double k) noexcept {
  if (!(k > 0)) return least_of(a, b);
  if (!a.finite() || !b.finite()) return kWholeLine;
  // It rises with either number.
  return widened(blended(a.lo, b.lo, k).f, blended(a.hi, b.hi, k).f, 8);
}

Span least(const Span& a, const Span& b, double k) noexcept {
  if (a.value.hi + k < b.value.lo) return a;
  if (b.value.hi + k < a.value.lo) return b;
  const Interval value = least(a.value, b.value, k);
  if (!(k > 0)) return {value, hull(a.rate, b.rate)};
  const Interval apart = a.value - b.value;
  if (!apart.finite()) return {value, kWholeLine};
  const Interval share = widened(blended(apart.hi, 0, k).fa, blended(apart.lo, 0, k).fa, 4);
  return {value, b.rate + share * (a.rate - b.rate)};
}

double negative(double a) noexcept {
  return -a;
}
template <class N>
N negative(const N& a) noexcept {
  return scaled(a, -1);
}

/// Folds the parts of a node from the values that `of` gives for each.
template <class N, class Of>
N combined(const FieldNode& node, const Of& of) noexcept {
  // Between planes at a right angle, the curvature where both are equal is then 1 / blend.
  const double k = 2 * std::numbers::sqrt2 * node.blend;
  N result = of(node.parts.front());
  for (std::size_t i = 1; i < node.parts.size(); ++i) {
    const N other = of(node.parts[i]);
    result = node.kind == FieldNode::Kind::least ? least(result, other, k)
                                                 : negative(least(negative(result), negative(other), k));
  }
  return result;
}

template <class N, class Of>
N evaluated(const FieldNode& node, const Of& of) noexcept {
  if (node.kind == FieldNode::Kind::field) {
    const N n = of(*node.field);
    return node.sign < 0 ? negative(n) : n;
  }
  return combined<N>(node, [&](const FieldNode& part) { return evaluated<N>(part, of); });
}

double value_at(const FieldNode& node, const Vec3& place) noexcept {
  return evaluated<double>(node, [&](const Field& field) { return field.value(place); });
}

FieldTree::Active active_at(const FieldNode& node, const Vec3& place) noexcept {
  if (node.piece != 0) return {value_at(node, place), node.piece};
  FieldTree::Active best = active_at(node.parts.front(), place);
  for (std::size_t i = 1; i < node.parts.size(); ++i) {
    const FieldTree::Active other = active_at(node.parts[i], place);
    const bool takes = node.kind == FieldNode::Kind::least ? other.value < best.value : other.value > best.value;
    if (takes || std::isnan(best.value)) best = other;
  }
  return best;
}

}  // namespace

Interval ExpressionField::over(const Box& box) const noexcept {
  return expression_.over({box.min.x(), box.max.x()}, {box.min.y(), box.max.y()}, {box.min.z(), box.max.z()});
}

MetaballField::MetaballField(std::vector<Metaball> balls, double threshold)
    : balls_(std::move(balls)), threshold_(threshold) {
  for (const Metaball& ball : balls_) {
    if (!(ball.weight > threshold_)) continue;
    const double s = std::cbrt(threshold_ / ball.weight);
    scale_ = ball.radius / (6 * ball.weight * s * s * std::sqrt(1 - s));
    break;
  }
}

double MetaballField::value(const Vec3& place) const noexcept {
  double sum = 0;
  for (const Metaball& ball : balls_) {
    const double s = 1 - (place - ball.centre).squaredNorm() / (ball.radius * ball.radius);
    if (s > 0) sum += ball.weight * s * s * s;
  }
  return scale_ * (threshold_ - sum);
}

Slope MetaballField::slope(const Vec3& place) const noexcept {
  Slope f{scale_ * threshold_, {}};
  for (const Metaball& ball : balls_) {
    const double inverse = 1 / (ball.radius * ball.radius);
    const Vec3 out = place - ball.centre;
    const double s = 1 - out.squaredNorm() * inverse;
    if (!(s > 0)) continue;
    const double w = scale_ * ball.weight, along = 6 * w * s * s * inverse;
    f.value -= w * s * s * s;
    for (std::size_t i = 0; i < 3; ++i) f.gradient[i] += along * out[static_cast<int>(i)];
  }
  return f;
}

Jet MetaballField::jet(const Vec3& place) const noexcept {
  Jet f{scale_ * threshold_, {}, {}};
  for (const Metaball& ball : balls_) {
    const double inverse = 1 / (ball.radius * ball.radius);
    const Vec3 out = place - ball.centre;
    const double s = 1 - out.squaredNorm() * inverse;
    if (!(s > 0)) continue;
    const double w = scale_ * ball.weight, along = 6 * w * s * s * inverse, bend = -24 * w * s * inverse * inverse;
    f.value -= w * s * s * s;
    for (std::size_t i = 0; i < 3; ++i) {
      f.gradient[i] += along * out[static_cast<int>(i)];
      f.hessian[i] += along + bend * out[static_cast<int>(i)] * out[static_cast<int>(i)];
    }
    f.hessian[3] += bend * out.x() * out.y();
    f.hessian[4] += bend * out.x() * out.z();
    f.hessian[5] += bend * out.y() * out.z();
  }
  return f;
}

Span MetaballField::along(const Vec3& from, const Vec3& way, Interval share) const noexcept {
  const double threshold = scale_ * threshold_;
  Span f{{threshold, threshold}, {0, 0}};
  const double square = way.squaredNorm();
  for (const Metaball& ball : balls_) {
    const Vec3 out = from - ball.centre;
    const double b = out.dot(way);
    const auto at = [&](double t) { return (out + t * way).squaredNorm(); };
    // The squared distance is least where the line passes the centre.
    const double p = at(share.lo), q = at(share.hi);
    const double turn = square > 0 ? std::clamp(-b / square, share.lo, share.hi) : share.lo;
    const double inverse = 1 / (ball.radius * ball.radius);
    const Interval u = inverse * widened(std::min({p, q, at(turn)}), std::max(p, q), 8);
    if (!(u.lo < 1)) continue;
    const Interval s{std::max(0.0, 1 - u.hi), widened(1 - u.lo, 1 - u.lo).hi};
    const Interval rate = (2 * inverse) * (Interval{b, b} + square * share);
    const double w = scale_ * ball.weight;
    f.value = f.value + -w * power_of(s, 3);
    f.rate = f.rate + (3 * w) * (square_of(s) * rate);
  }
  return f;
}

Interval MetaballField::over(const Box& box) const noexcept {
  Interval f{scale_ * threshold_, scale_ * threshold_};
  for (const Metaball& ball : balls_) {
    Interval u{0, 0};
    for (int axis = 0; axis < 3; ++axis)
      u = u + square_of(widened(box.min[axis] - ball.centre[axis], box.max[axis] - ball.centre[axis]));
    u = 1 / (ball.radius * ball.radius) * u;
    if (!(u.lo < 1)) continue;
    const Interval s{std::max(0.0, 1 - u.hi), widened(1 - u.lo, 1 - u.lo).hi};
    f = f + -scale_ * ball.weight * power_of(s, 3);
  }
  return f;
}

FieldNode FieldNode::negated() const {
  FieldNode node = *this;
  if (kind == Kind::field) {
    node.sign = -sign;
    return node;
  }
  node.kind = kind == Kind::least ? Kind::most : Kind::least;
  for (FieldNode& part : node.parts) part = part.negated();
  return node;
}

FieldTree::FieldTree(FieldNode root) : root_(std::move(root)) {
  number(root_);
}

void FieldTree::number(FieldNode& node) {
  if (node.kind == FieldNode::Kind::field || node.blend > 0) {
    if (pieces_.size() >= kMostPieces)
      throw input_error(fmt::format("the shape has more than {} smooth pieces", kMostPieces));
    pieces_.push_back(&node);
    node.piece = static_cast<std::uint32_t>(pieces_.size());
    return;
  }
  for (FieldNode& part : node.parts) number(part);
}

double FieldTree::value(const Vec3& place) const noexcept {
  return value_at(root_, place);
}

FieldTree::Active FieldTree::active(const Vec3& place) const noexcept {
  return active_at(root_, place);
}

Slope FieldTree::slope(std::uint32_t piece, const Vec3& place) const noexcept {
  return evaluated<Slope>(*pieces_[piece - 1], [&](const Field& field) { return field.slope(place); });
}

Jet FieldTree::jet(std::uint32_t piece, const Vec3& place) const noexcept {
  return evaluated<Jet>(*pieces_[piece - 1], [&](const Field& field) { return field.jet(place); });
}

Span FieldTree::along(const Vec3& from, const Vec3& way, Interval share) const noexcept {
  return evaluated<Span>(root_, [&](const Field& field) { return field.along(from, way, share); });
}

Interval FieldTree::over(const Box& box) const noexcept {
  return evaluated<Interval>(root_, [&](const Field& field) { return field.over(box); });
}

}  // namespace haptrace
