#include "devices/haply/inverse3_calibration.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "control/norm.h"

#include <fmt/format.h>

namespace haptrace {

Vec3 Inverse3Calibration::command(const Vec3& force) const noexcept {
  const double magnitude = norm_of(force);
  return axes.transpose() * (magnitude > max_force ? Vec3(max_force / magnitude * force) : force);
}

Eigen::Matrix3d read_inverse3_axes(const std::string& text, const std::string& where) {
  Eigen::Matrix3d axes = Eigen::Matrix3d::Zero();
  Eigen::Index row = 0;
  double sign = 1;
  bool read = true;
  for (const char c : text) {
    const auto axis = std::string_view("XYZ").find(c);
    if (c == '+' || c == '-') {
      sign = c == '-' ? -1 : 1;
    } else if (axis != std::string_view::npos && row < 3) {
      axes(row++, static_cast<Eigen::Index>(axis)) = sign;
      sign = 1;
    } else {
      read = false;
    }
  }
  // The triple product is 1 only if each of the three axes occurs once and they are right-handed.
  if (!read || row != 3 || axes.row(0).cross(axes.row(1)).dot(axes.row(2)) < 0.5)
    throw input_error(
        fmt::format("{}: '{}' does not name three right-handed axes; expected, for example, XZ-Y: W's x is the "
                    "service's x, W's y its z, and W's z its -y",
                    where, text));
  return axes;
}

Inverse3Calibration read_inverse3_calibration(const nlohmann::json& json, const std::string& where) {
  Inverse3Calibration calibration;
  JsonReader reader(json, where);
  calibration.axes = read_inverse3_axes(reader.text("axes", "XZ-Y"), where + ": axes");
  calibration.origin = reader.vector("origin", calibration.origin, -1, 1);
  calibration.workspace = reader.vector("workspace", calibration.workspace, 1e-3, 1);
  calibration.max_force = reader.number("max_force", calibration.max_force, 0.1, 30);
  calibration.max_continuous_force =
      reader.number("max_continuous_force", std::min(calibration.max_continuous_force, calibration.max_force), 0.1,
                    calibration.max_force);
  reader.finish();
  return calibration;
}

}  // namespace haptrace
