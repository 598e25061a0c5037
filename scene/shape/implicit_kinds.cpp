#include "scene/shape/implicit_kinds.h"

#include "base/error.h"
#include "scene/shape/implicit.h"
#include "scene/shape/solid.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <string>
#include <vector>

namespace haptrace {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr std::array<std::string_view, 3> kVariables{"x", "y", "z"};
constexpr std::size_t kMostParts = 64, kMostBalls = 256;
constexpr int kDeepest = 8;

/// A field and the box in which it is negative.
struct Part {
  FieldNode node;
  Box box;
};

Box box_of(const Vec3& min, const Vec3& max) {
  Box box;
  box.include(min);
  box.include(max);
  return box;
}

/// Makes min and max nodes of their own, so that their creases are known.
FieldNode node_of(Expression expression) {
  FieldNode node;
  if (const auto sides = expression.split()) {
    node.kind = sides->least ? FieldNode::Kind::least : FieldNode::Kind::most;
    for (const Expression* side : {&sides->a, &sides->b}) {
      FieldNode part = node_of(*side);
      if (part.kind == node.kind)
        std::move(part.parts.begin(), part.parts.end(), std::back_inserter(node.parts));
      else
        node.parts.push_back(std::move(part));
    }
    return node;
  }
  node.field = std::make_shared<ExpressionField>(std::move(expression));
  return node;
}

FieldNode node_of(const std::string& text) {
  return node_of(Expression(text, kVariables));
}

/// Returns whether a field is proven to be positive in a box.
bool is_positive(const Field& field, const Box& box, int& budget) {
  if (field.over(box).lo > 0) return true;
  if (--budget < 0 || !(field.value(box.center()) > 0)) return false;
  int axis = 0;
  box.size().maxCoeff(&axis);
  Box lower = box, upper = box;
  lower.max[axis] = upper.min[axis] = box.center()[axis];
  return is_positive(field, lower, budget) && is_positive(field, upper, budget);
}

/// Cuts a field at the sides of a box that it may reach. Returns the number of these sides.
int close(const Expression& expression, Part& part) {
  const ExpressionField whole(expression);
  FieldNode closed{.kind = FieldNode::Kind::most, .field = {}, .parts = {part.node}};
  int sides = 0;
  for (int axis = 0; axis < 3; ++axis)
    for (const bool upper : {false, true}) {
      Box side = part.box;
      const double at = upper ? part.box.max[axis] : part.box.min[axis];
      side.min[axis] = side.max[axis] = at;
      int budget = 4000;
      if (is_positive(whole, side, budget)) continue;
      closed.parts.push_back(
          upper ? node_of(fmt::format("{} - ({:.17g})", kVariables[static_cast<std::size_t>(axis)], at))
                : node_of(fmt::format("({:.17g}) - {}", at, kVariables[static_cast<std::size_t>(axis)])));
      ++sides;
    }
  if (sides > 0) part.node = std::move(closed);
  return sides;
}

Part read_expression_part(JsonReader& reader, std::vector<std::string>& remarks) {
  const std::string text = reader.require("expression").text("expression", "");
  JsonReader box = *reader.require("box").object("box");
  const Vec3 min = box.require("min").vector("min", Vec3::Zero(), -kFarthestCentre, kFarthestCentre);
  const Vec3 max = box.require("max").vector("max", Vec3::Zero(), -kFarthestCentre, kFarthestCentre);
  box.finish();
  for (int axis = 0; axis < 3; ++axis)
    if (!(max[axis] - min[axis] >= kMinLength))
      throw input_error(
          fmt::format("{}: max must be above min along every axis, by at least {} m", box.where(), kMinLength));
  try {
    Expression expression(text, kVariables);
    Part part{node_of(expression), box_of(min, max)};
    if (const int sides = close(expression, part); sides > 0)
      remarks.push_back(
          fmt::format("the surface reaches {} of 6 sides of its box, or comes near; they close it", sides));
    return part;
  } catch (const Error& error) {
    throw input_error(reader.where() + ".expression: " + error.what());
  }
}

Part read_balls(JsonReader& reader) {
  constexpr double kMostWeight = 100;
  std::vector<Metaball> balls;
  Box box;
  double most = 0;
  for (JsonReader& entry : reader.require("balls").objects("balls")) {
    Metaball ball;
    ball.centre = entry.require("centre").vector("centre", Vec3::Zero(), -kFarthestCentre, kFarthestCentre);
    ball.radius = entry.require("radius").number("radius", 0, kMinLength, kMaxLength);
    ball.weight = entry.number("weight", 1, -kMostWeight, kMostWeight);
    entry.finish();
    most += std::max(0.0, ball.weight);
    if (ball.weight > 0) {
      box.include(ball.centre - Vec3::Constant(ball.radius));
      box.include(ball.centre + Vec3::Constant(ball.radius));
    }
    balls.push_back(ball);
  }
  if (balls.empty() || balls.size() > kMostBalls)
    throw input_error(
        fmt::format("{}.balls: there are {} balls; 1 to {} are possible", reader.where(), balls.size(), kMostBalls));
  const double threshold = reader.number("threshold", 0.2, 1e-3, kMostWeight);
  if (!(most > threshold))
    throw input_error(fmt::format("{}.balls: the weights add up to {:g}, which must be above the threshold of {:g}",
                                  reader.where(), most, threshold));
  FieldNode node;
  node.field = std::make_shared<MetaballField>(std::move(balls), threshold);
  return {std::move(node), box};
}

Part read_part(JsonReader& reader, int depth, std::vector<std::string>& remarks);

Part read_combination(JsonReader& reader, int depth, std::vector<std::string>& remarks) {
  if (depth >= kDeepest)
    throw input_error(
        fmt::format("{}: parts nest deeper than {} levels; put them into fewer levels, since an operation "
                    "may have many parts",
                    reader.where(), kDeepest));
  const std::array<std::string, 3> operations{"union", "intersection", "difference"};
  const std::string operation = reader.require("operation").choice("operation", "", operations);
  const double blend = reader.number("blend", 0, 0, 1);
  std::vector<Part> parts;
  for (JsonReader& entry : reader.require("parts").objects("parts")) {
    parts.push_back(read_part(entry, depth + 1, remarks));
    entry.finish();
  }
  if (parts.size() < 2 || parts.size() > kMostParts)
    throw input_error(
        fmt::format("{}.parts: there are {} parts; 2 to {} are possible", reader.where(), parts.size(), kMostParts));
  Part whole;
  whole.node.kind = operation == "union" ? FieldNode::Kind::least : FieldNode::Kind::most;
  whole.node.blend = blend;
  whole.box = parts[0].box;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    if (operation == "union") {
      // A fillet fills the crease: by a third of the length within which it acts.
      const Vec3 more = Vec3::Constant(blend);
      whole.box.include(parts[i].box.min - more);
      whole.box.include(parts[i].box.max + more);
    } else if (operation == "intersection") {
      whole.box.min = whole.box.min.cwiseMax(parts[i].box.min);
      whole.box.max = whole.box.max.cwiseMin(parts[i].box.max);
    }
    const bool outside = operation == "difference" && i > 0;
    whole.node.parts.push_back(outside ? parts[i].node.negated() : std::move(parts[i].node));
  }
  if (!(whole.box.size().minCoeff() > 0))
    throw input_error(reader.where() + ".parts: the parts have no place in common; check their centres and sizes");
  return whole;
}

/// Returns the distance from an axis that is parallel to z, as a text.
std::string from_axis(const Vec3& centre) {
  return fmt::format("sqrt((x - ({:.17g}))^2 + (y - ({:.17g}))^2)", centre.x(), centre.y());
}

Part read_part(JsonReader& reader, int depth, std::vector<std::string>& remarks) {
  static const std::vector<std::string> kinds{"box",      "cone",      "csg",   "cylinder", "ellipsoid",
                                              "implicit", "metaballs", "plane", "sphere",   "torus"};
  const std::string kind = reader.require("kind").choice("kind", "", kinds);
  if (kind == "csg") return read_combination(reader, depth, remarks);
  if (kind == "implicit") return read_expression_part(reader, remarks);
  if (kind == "metaballs") return read_balls(reader);
  const auto length = [&](const char* key) { return reader.require(key).number(key, 0, kMinLength, kMaxLength); };
  if (kind == "plane") {
    const Vec3 point = reader.require("point").vector("point", Vec3::Zero(), -kFarthestCentre, kFarthestCentre);
    const Vec3 normal = reader.require("normal").vector("normal", Vec3::UnitZ(), -1e6, 1e6);
    if (!(normal.stableNorm() > 1e-6)) throw input_error(reader.where() + ".normal: the vector has no direction");
    const Vec3 n = normal.stableNormalized();
    return {
        node_of(fmt::format("({:.17g})*x + ({:.17g})*y + ({:.17g})*z - ({:.17g})", n.x(), n.y(), n.z(), n.dot(point))),
        box_of(Vec3::Constant(-kInfinity), Vec3::Constant(kInfinity))};
  }
  const Vec3 c = reader.vector("centre", Vec3::Zero(), -kFarthestCentre, kFarthestCentre);
  const auto around = [&](const Vec3& half) { return box_of(c - half, c + half); };
  const std::string x = fmt::format("(x - ({:.17g}))", c.x()), y = fmt::format("(y - ({:.17g}))", c.y()),
                    z = fmt::format("(z - ({:.17g}))", c.z());
  if (kind == "sphere") {
    const double r = length("radius");
    return {node_of(fmt::format("sqrt({}^2 + {}^2 + {}^2) - {:.17g}", x, y, z, r)), around(Vec3::Constant(r))};
  }
  if (kind == "box") {
    const Vec3 half = 0.5 * reader.require("size").vector("size", Vec3::Ones(), kMinLength, kMaxLength);
    FieldNode node{.kind = FieldNode::Kind::most, .field = {}, .parts = {}};
    int axis = 0;
    for (const std::string& u : {x, y, z}) {
      node.parts.push_back(node_of(fmt::format("{} - {:.17g}", u, half[axis])));
      node.parts.push_back(node_of(fmt::format("-{:.17g} - {}", half[axis], u)));
      ++axis;
    }
    return {std::move(node), around(half)};
  }
  if (kind == "cylinder") {
    const double r = length("radius"), half = 0.5 * length("height");
    return {node_of(fmt::format("max({0} - {1:.17g}, max({2} - {3:.17g}, -{3:.17g} - {2}))", from_axis(c), r, z, half)),
            around({r, r, half})};
  }
  if (kind == "cone") {
    const double r = length("radius"), h = length("height"), side = std::hypot(r, h);
    return {node_of(fmt::format("max({:.17g}*{} + {:.17g}*({} - {:.17g}), -{})", h / side, from_axis(c), r / side, z, h,
                                z)),
            box_of(c - Vec3(r, r, 0), c + Vec3(r, r, h))};
  }
  if (kind == "torus") {
    const double r = length("radius"), tube = length("tube");
    if (!(tube < r))
      throw input_error(fmt::format("{}.tube: {} m must be less than the radius, {} m", reader.where(), tube, r));
    return {node_of(fmt::format("sqrt(({} - {:.17g})^2 + {}^2) - {:.17g}", from_axis(c), r, z, tube)),
            around({r + tube, r + tube, tube})};
  }
  const Vec3 radii = reader.require("radii").vector("radii", Vec3::Ones(), kMinLength, kMaxLength);
  return {node_of(fmt::format("{:.17g}*(sqrt(({}/{:.17g})^2 + ({}/{:.17g})^2 + ({}/{:.17g})^2) - 1)", radii.minCoeff(),
                              x, radii.x(), y, radii.y(), z, radii.z())),
          around(radii)};
}

std::unique_ptr<Shape> made(JsonReader& reader, Part part, std::vector<std::string> remarks) {
  const int steps = reader.integer("steps", 4, 1, Implicit::kMostSteps);
  for (int axis = 0; axis < 3; ++axis)
    if (!std::isfinite(part.box.size()[axis]))
      throw input_error(reader.where() + ": the shape has no end; intersect it with a box");
  try {
    auto shape = std::make_unique<Implicit>(std::move(part.node), part.box, std::move(remarks));
    shape->set("steps", steps);
    return shape;
  } catch (const Error& error) {
    throw input_error(reader.where() + ": " + error.what());
  }
}

}  // namespace

std::unique_ptr<Shape> read_implicit(JsonReader& reader) {
  std::vector<std::string> remarks;
  Part part = read_expression_part(reader, remarks);
  return made(reader, std::move(part), std::move(remarks));
}

std::unique_ptr<Shape> read_metaballs(JsonReader& reader) {
  return made(reader, read_balls(reader), {});
}

std::unique_ptr<Shape> read_csg(JsonReader& reader) {
  std::vector<std::string> remarks;
  Part part = read_combination(reader, 0, remarks);
  return made(reader, std::move(part), std::move(remarks));
}

}  // namespace haptrace
