#include "formats/documents/device_frame.h"

#include "base/error.h"
#include "base/json_reader.h"

#include <Eigen/SVD>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <vector>

namespace haptrace {
namespace {

constexpr double kTolerance = 1e-3;  // of a unit length and a right angle, for rounded numbers
constexpr double kFarthest = 1000;   // [m]

std::vector<double> numbers_of(const nlohmann::json& json, std::size_t count, const std::string& where) {
  std::vector<double> numbers;
  if (json.is_array() && json.size() == count)
    for (const nlohmann::json& one : json)
      if (one.is_number() && std::isfinite(one.get<double>())) numbers.push_back(one.get<double>());
  if (numbers.size() != count) throw input_error(fmt::format("{}: expected {} numbers", where, count));
  return numbers;
}

Quat quaternion_of(const std::vector<double>& q, const std::string& where) {
  const Quat quaternion(q[0], q[1], q[2], q[3]);
  if (std::abs(quaternion.norm() - 1) > kTolerance)
    throw input_error(fmt::format("{}: the quaternion's length is {:.6g}; a rotation has length 1, as w, x, y, z",
                                  where, quaternion.norm()));
  return quaternion.normalized();
}

/// Returns the nearest rotation (Kabsch: U V^T of the singular value decomposition).
Quat rotation_of(const Eigen::Matrix3d& matrix, const std::string& where) {
  for (int row = 0; row < 3; ++row)
    if (const double length = matrix.row(row).norm(); std::abs(length - 1) > kTolerance)
      throw input_error(
          fmt::format("{}[{}]: the row's length is {:.6g}; a rigid motion does not scale, and its rows have length 1",
                      where, row, length));
  for (int row = 0; row < 3; ++row)
    if (const double cosine = matrix.row(row).dot(matrix.row((row + 1) % 3)); std::abs(cosine) > kTolerance)
      throw input_error(fmt::format(
          "{}: rows {} and {} are not at right angles (their product is {:.6g}); a rigid motion does not shear", where,
          row, (row + 1) % 3, cosine));
  if (matrix.determinant() < 0)
    throw input_error(fmt::format(
        "{}: the matrix mirrors (its determinant is {:.6g}); a device's frame is right-handed. Use mirror for the path",
        where, matrix.determinant()));
  const Eigen::JacobiSVD<Eigen::Matrix3d> parts(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return Quat(Eigen::Matrix3d(parts.matrixU() * parts.matrixV().transpose())).normalized();
}

}  // namespace

DeviceFrame read_device_frame(JsonReader& reader) {
  DeviceFrame frame;
  if (reader.has("rotation")) {
    const nlohmann::json json = reader.value("rotation");
    const std::string where = reader.where() + ": rotation";
    if (json.is_array() && json.size() == 4) {
      frame.rotation = quaternion_of(numbers_of(json, 4, where), where);
    } else if (json.is_array() && json.size() == 3) {
      Eigen::Matrix3d matrix;
      for (std::size_t row = 0; row < 3; ++row) {
        const std::vector<double> numbers = numbers_of(json[row], 3, fmt::format("{}[{}]", where, row));
        matrix.row(static_cast<Eigen::Index>(row)) = Eigen::Map<const Eigen::RowVector3d>(numbers.data());
      }
      frame.rotation = rotation_of(matrix, where);
    } else {
      throw input_error(
          fmt::format("{}: expected a unit quaternion [w, x, y, z] or three rows of three numbers", where));
    }
  }
  frame.translation = reader.vector("translation", Vec3::Zero(), -kFarthest, kFarthest);
  return frame;
}

DeviceFrame load_device_frame(const std::string& file) {
  const nlohmann::json document = load_json(file);
  JsonReader reader(document, file);
  (void)reader.text("$schema", "");
  (void)reader.text("description", "");
  if (!reader.has("rotation") && !reader.has("translation"))
    throw input_error(fmt::format("{}: a device's frame needs a rotation, a translation or both", file));
  DeviceFrame frame = read_device_frame(reader);
  reader.finish();
  return frame;
}

nlohmann::json to_json(const DeviceFrame& frame) {
  const Quat& q = frame.rotation;
  return {{"rotation", {q.w(), q.x(), q.y(), q.z()}}, {"translation", json_of(frame.translation)}};
}

}  // namespace haptrace
