#include "control/path/path_change.h"

#include "base/enum_names.h"
#include "base/error.h"
#include "base/number.h"
#include "base/units.h"
#include "base/vectors.h"
#include "control/rotation.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>
#include <vector>

namespace haptrace {
namespace {

constexpr EnumNames<int, 4> kMirrorNames{"mirror axis", {"none", "x", "y", "z"}};
constexpr double kLeastScale = 0.01, kMostScale = 100;
constexpr double kMostOffset = 10;  // [m]

/// Removes the rounding errors of a rotation by right angles, which maps axes to axes.
Eigen::Matrix3d without_rounding(Eigen::Matrix3d turn) {
  constexpr double kRounding = 1e-14;
  const Eigen::Matrix3d whole = turn.array().round().matrix();
  if ((turn - whole).cwiseAbs().maxCoeff() < kRounding) turn = whole;
  return turn;
}

std::string number_text(double value) {
  return fmt::format("{:.4g}", value == 0 ? 0 : value);
}

std::string millimetres(const Vec3& v) {
  return fmt::format("{}, {}, {} mm", number_text(1e3 * v.x()), number_text(1e3 * v.y()), number_text(1e3 * v.z()));
}

std::string rotation_text(const Quat& rotation) {
  const Vec3 turn = rotation_vector(rotation);
  const double angle = turn.norm();
  const Vec3 axis = turn / angle;
  std::string name = fmt::format("({:.4g}, {:.4g}, {:.4g})", axis.x(), axis.y(), axis.z());
  double sign = 1;
  for (int i = 0; i < 3; ++i)
    if (std::abs(axis[i]) > 1 - 1e-9) {
      name = "xyz"[i];
      sign = axis[i] > 0 ? 1 : -1;
    }
  return fmt::format("rotated by {} degrees about {}", number_text(sign * angle * 180 / std::numbers::pi), name);
}

}  // namespace

Quat parse_rotation(std::string_view text) {
  const std::size_t equals = text.find('=');
  const auto wrong = [&](const char* what) {
    return input_error(
        fmt::format("the rotation '{}' {}; give an axis and an angle, as in z=90deg or 1,1,0=30deg", text, what));
  };
  if (equals == std::string_view::npos) throw wrong("has no =");
  const std::string_view axis_text = text.substr(0, equals);
  const std::optional<double> angle = parse_quantity(text.substr(equals + 1), "rad");
  if (!angle) throw wrong("has no valid angle");
  if (number_of<double>(text.substr(equals + 1)) && std::abs(*angle) > 2 * std::numbers::pi)
    throw input_error(
        fmt::format("the rotation '{0}' is in radians and more than a full turn; {0}deg was meant? Otherwise write "
                    "{0}rad",
                    text));
  Vec3 axis = Vec3::Zero();
  if (axis_text.size() == 1 && std::string_view("xyz").find(axis_text) != std::string_view::npos)
    axis[static_cast<Eigen::Index>(axis_text[0] - 'x')] = 1;
  else
    axis = parse_direction(axis_text, fmt::format("the axis of the rotation '{}'", text));
  return quaternion(*angle * axis).normalized();
}

Quat Similarity::orientation(const Quat& q) const {
  if (!haptrace::is_finite(q)) return nan_quat();
  // turn R tool = (turn tool) (tool R tool), and tool R tool turns about the mirrored axis, a pseudovector.
  const Vec3 sign = tool.prod() * tool;
  const Quat mirrored(q.w(), sign.x() * q.x(), sign.y() * q.y(), sign.z() * q.z());
  return Quat(Eigen::Matrix3d(turn * tool.asDiagonal())) * mirrored;
}

bool Similarity::is_identity() const {
  return turn == Eigen::Matrix3d::Identity() && scale == 1 && offset == Vec3::Zero() && tool == Vec3::Ones();
}

bool Similarity::keeps_axes() const {
  return turn == turn.array().round().matrix();
}

Box Similarity::box(const Box& box) const {
  Box result;
  for (unsigned corner = 0; corner < 8; ++corner) {
    Vec3 p = box.min;
    for (unsigned axis = 0; axis < 3; ++axis)
      if (((corner >> axis) & 1U) != 0) p[axis] = box.max[axis];
    result.include(point(p));
  }
  return result;
}

Similarity Similarity::inverse() const {
  const Eigen::Matrix3d back = turn.transpose();
  return {.turn = back, .scale = 1 / scale, .offset = -(back * offset) / scale, .tool = tool};
}

void Similarity::apply(Path& path) const {
  for (Vec3& p : path.position) p = point(p);
  for (Vec3& v : path.velocity) v = velocity(v);
  for (Vec3& f : path.force) f = direction(f);
  for (Quat& q : path.orientation) q = orientation(q);
}

Similarity operator*(const Similarity& second, const Similarity& first) {
  return {.turn = without_rounding(second.turn * first.turn),
          .scale = second.scale * first.scale,
          .offset = second.point(first.offset),
          .tool = second.tool.cwiseProduct(first.tool)};
}

Similarity to_device(const DeviceFrame& frame) {
  const Eigen::Matrix3d turn = without_rounding(frame.rotation.toRotationMatrix().transpose());
  return {.turn = turn, .offset = -(turn * frame.translation)};
}

bool PathChange::is_identity() const {
  return !frame && !mirror && scale == 1 && offset == Vec3::Zero() && !start && rotation.vec() == Vec3::Zero();
}

Similarity PathChange::of(const Vec3& first, const Box& bounds) const {
  validate(*this);
  const Similarity arrival = frame ? to_device(*frame) : Similarity{};
  Similarity change;
  change.turn = rotation.toRotationMatrix();
  if (mirror) {
    change.tool[*mirror] = -1;
    change.turn = change.turn * change.tool.asDiagonal();
  }
  change.turn = without_rounding(change.turn);
  change.scale = scale;
  Vec3 fixed = Vec3::Zero();
  if (about.kind == ChangeCentre::Kind::start) fixed = arrival.point(first);
  if (about.kind == ChangeCentre::Kind::centre) fixed = arrival.point(bounds.center());
  if (about.kind == ChangeCentre::Kind::point) fixed = about.point;
  change.offset = fixed - change.point(fixed) + offset;
  if (start) change.offset += *start - change.point(arrival.point(first));
  return change * arrival;
}

void PathChange::apply(Path& path) const {
  if (path.position.empty() || is_identity()) return;
  of(path.position.front(), path.bounds()).apply(path);
}

void validate(const PathChange& change) {
  constexpr double kUnit = 1e-6;  // tolerance of the norm of a unit quaternion
  if (!(change.scale >= kLeastScale && change.scale <= kMostScale))
    throw input_error(
        fmt::format("the scale of a path is {}; it must be from {} to {}", change.scale, kLeastScale, kMostScale));
  const auto check_rotation = [](const Quat& rotation) {
    if (!(std::abs(rotation.norm() - 1) <= kUnit)) throw input_error("the rotation of a path is not a unit quaternion");
  };
  check_rotation(change.rotation);
  for (const Vec3* offset : {&change.offset, &change.about.point})
    if (!(offset->cwiseAbs().maxCoeff() <= kMostOffset))
      throw input_error(
          fmt::format("a path cannot be moved, or changed about a point, by {}, {}, {} m; the most is "
                      "{} m per axis. Positions are in metres, or have a unit: 20mm",
                      offset->x(), offset->y(), offset->z(), kMostOffset));
  if (change.mirror && (*change.mirror < 0 || *change.mirror > 2))
    throw input_error(fmt::format("the mirror axis is {}; it must be 0, 1 or 2", *change.mirror));
  if (change.start && !is_finite(*change.start)) throw input_error("the place of a path's start is not finite");
  if (change.frame) {
    check_rotation(change.frame->rotation);
    if (!is_finite(change.frame->translation)) throw input_error("the translation of a device's frame is not finite");
  }
}

std::string describe(const PathChange& change) {
  std::vector<std::string> parts;
  if (change.frame) parts.emplace_back("brought from the world's to the device's coordinates");
  const std::size_t before = parts.size();
  if (change.mirror) parts.push_back(fmt::format("mirrored in {}", "xyz"[*change.mirror]));
  if (change.rotation.vec() != Vec3::Zero()) parts.push_back(rotation_text(change.rotation));
  if (change.scale != 1) parts.push_back(fmt::format("scaled by {:.4g}", change.scale));
  if (parts.size() > before && !change.start) {
    if (change.about.kind == ChangeCentre::Kind::start) parts.back() += " about its start";
    if (change.about.kind == ChangeCentre::Kind::centre) parts.back() += " about its centre";
    if (change.about.kind == ChangeCentre::Kind::point) parts.back() += " about " + millimetres(change.about.point);
  }
  if (change.start)
    parts.push_back("moved to start at " + millimetres(*change.start));
  else if (change.offset != Vec3::Zero())
    parts.push_back("moved by " + millimetres(change.offset));
  return fmt::format("{}", fmt::join(parts, ", "));
}

std::optional<int> parse_mirror(std::string_view text) {
  const int axis = kMirrorNames.parse(text);
  return axis > 0 ? std::optional(axis - 1) : std::nullopt;
}

ChangeCentre parse_change_centre(std::string_view text) {
  using Kind = ChangeCentre::Kind;
  if (text == "origin") return {};
  if (text == "start") return {.kind = Kind::start};
  if (text == "centre" || text == "center") return {.kind = Kind::centre};
  if (text.find(',') == std::string_view::npos)
    throw input_error(fmt::format("'{}' is not a place; give origin, start, centre or a point X,Y,Z", text));
  return {.kind = Kind::point, .point = parse_vector(text, "m", "the point")};
}

}  // namespace haptrace
