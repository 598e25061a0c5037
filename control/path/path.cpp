#include "control/path/path.h"

#include "base/enum_names.h"
#include "base/error.h"

#include <algorithm>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr EnumNames<Interpolation, 4> kInterpolations{"interpolation", {"hold", "linear", "cubic", "quintic"}};

/// Larger than any workspace. A path that exceeds it has the wrong unit, usually millimetres.
constexpr double kLargestExtent = 50;  // [m]

constexpr double kUnit = 1e-3;  // tolerance of the norm of a unit quaternion

bool is_number(const Vec3& v) {
  return is_finite(v);
}

bool is_unit(const Quat& q) {
  return std::abs(q.norm() - 1) <= kUnit;
}

template <class Value>
void check_column(const Path& path, const std::vector<Value>& column, const char* name, std::uint64_t rows_before,
                  bool (*is_good)(const Value&), const char* what) {
  if (column.size() != path.size())
    throw input_error(
        fmt::format("{}: {} has {} samples, but time has {}", path.name, name, column.size(), path.size()));
  const auto bad = std::find_if_not(column.begin(), column.end(), is_good);
  if (bad != column.end())
    throw input_error(fmt::format("{}: sample {}: {} is not a {}", path.name,
                                  rows_before + static_cast<std::uint64_t>(bad - column.begin()) + 1, name, what));
}

}  // namespace

Interpolation parse_interpolation(std::string_view name) {
  return kInterpolations.parse(name);
}

const char* to_string(Interpolation interpolation) noexcept {
  return kInterpolations.name(interpolation);
}

Box Path::bounds() const {
  Box box;
  for (const Vec3& p : position) box.include(p);
  return box;
}

void validate(const Path& path, std::uint64_t rows_before) {
  if (path.time.empty()) throw input_error(fmt::format("{}: the path has no samples", path.name));
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (!std::isfinite(path.time[i]))
      throw input_error(fmt::format("{}: sample {}: time is not a finite number", path.name, rows_before + i + 1));
    if (i > 0 && path.time[i] <= path.time[i - 1])
      throw input_error(fmt::format(
          "{}: sample {}: time {} s does not come after {} s of the previous sample; time stamps must increase",
          path.name, rows_before + i + 1, path.time[i], path.time[i - 1]));
  }
  check_column(path, path.position, "position", rows_before, is_number, "finite number");
  if (!path.velocity.empty()) check_column(path, path.velocity, "velocity", rows_before, is_number, "finite number");
  if (!path.force.empty()) check_column(path, path.force, "force", rows_before, is_number, "finite number");
  if (!path.orientation.empty())
    check_column(path, path.orientation, "orientation", rows_before, is_unit, "unit quaternion");
  validate_size(path.name, path.bounds());
}

void validate_size(const std::string& name, const Box& box) {
  const double extent = box.size().maxCoeff();
  const double reach = std::max(box.min.cwiseAbs().maxCoeff(), box.max.cwiseAbs().maxCoeff());
  if (std::max(extent, reach) > kLargestExtent)
    throw input_error(fmt::format(
        "{}: the path is {:.4g} m wide and reaches {:.4g} m from the origin; positions are in metres, and these look "
        "like {}: divide them by {}",
        name, extent, reach, reach > 5e4 ? "micrometres" : "millimetres", reach > 5e4 ? "1 000 000" : "1000"));
}

std::string describe(const Fit& fit) {
  return fmt::format("scaled by {:.4g}, moved by {:.1f}, {:.1f}, {:.1f} mm", fit.scale, 1e3 * fit.offset.x(),
                     1e3 * fit.offset.y(), 1e3 * fit.offset.z());
}

double distance_outside(const Vec3& point, const Box& box) {
  return (point - point.cwiseMax(box.min).cwiseMin(box.max)).norm();
}

double distance_outside(const Path& path, const Box& workspace) {
  double distance = 0;
  for (const Vec3& p : path.position) distance = std::max(distance, distance_outside(p, workspace));
  return distance;
}

Fit fit_into(const Box& box, const Box& workspace, double margin) {
  const Vec3 inset = margin * workspace.size();
  const Box room{workspace.min + inset, workspace.max - inset};

  Fit fit;
  for (int axis = 0; axis < 3; ++axis)
    if (box.size()[axis] > room.size()[axis]) fit.scale = std::min(fit.scale, room.size()[axis] / box.size()[axis]);

  // Scales about the centre, then moves no farther than needed.
  const Vec3 half = 0.5 * fit.scale * box.size();
  const Vec3 center = box.center().cwiseMax(room.min + half).cwiseMin(room.max - half);
  fit.offset = center - fit.scale * box.center();
  return fit;
}

void apply(const Fit& fit, Path& path) {
  for (Vec3& p : path.position) p = fit.scale * p + fit.offset;
  for (Vec3& v : path.velocity) v *= fit.scale;
}

}  // namespace haptrace
