// Volumes for tests, made from formulas.
#pragma once

#include "formats/volume/volume_file.h"
#include "tests/support/temp_folder.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fmt/format.h>
#include <functional>
#include <string>

namespace haptrace::test {

using Field = std::function<double(const Vec3&)>;

/// Returns the values of a field on a grid around a place, with `steps` as its columns [m].
inline VolumeData volume_of(const Field& field, const std::array<std::size_t, 3>& size, const Eigen::Matrix3d& steps,
                            const Vec3& middle = Vec3::Zero()) {
  VolumeData data;
  data.size = size;
  data.steps = steps;
  data.origin = middle - 0.5 * steps *
                             Vec3(static_cast<double>(size[0] - 1), static_cast<double>(size[1] - 1),
                                  static_cast<double>(size[2] - 1));
  for (std::size_t k = 0; k < size[2]; ++k)
    for (std::size_t j = 0; j < size[1]; ++j)
      for (std::size_t i = 0; i < size[0]; ++i)
        data.values.push_back(static_cast<float>(
            field(data.place(Vec3(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k))))));
  return data;
}

inline VolumeData volume_of(const Field& field, std::size_t side, double spacing) {
  return volume_of(field, {side, side, side}, spacing * Eigen::Matrix3d::Identity());
}

/// Returns a volume as the text of an NRRD file in metres.
inline std::string nrrd_of(const VolumeData& data) {
  const auto vector = [](const Vec3& v) { return fmt::format("({:.17g},{:.17g},{:.17g})", v.x(), v.y(), v.z()); };
  std::string text = fmt::format(
      "NRRD0004\ntype: float\ndimension: 3\nsizes: {} {} {}\nencoding: raw\nendian: little\nspace dimension: 3\n"
      "space directions: {} {} {}\nspace origin: {}\nspace units: \"m\" \"m\" \"m\"\n\n",
      data.size[0], data.size[1], data.size[2], vector(data.steps.col(0)), vector(data.steps.col(1)),
      vector(data.steps.col(2)), vector(data.origin));
  const std::size_t begin = text.size();
  text.resize(begin + 4 * data.values.size());
  std::memcpy(text.data() + begin, data.values.data(), 4 * data.values.size());
  return text;
}

/// Returns the name of a file with this volume, which lasts as long as the tests run.
inline std::string volume_file(const std::string& name, const VolumeData& data) {
  static const TempFolder folder;
  return folder.write(name, nrrd_of(data));
}

/// Returns the distance from a sphere of 60 mm around the origin, 3 mm a sample, with the sphere's inside negative.
inline const std::string& ball_volume() {
  static const std::string file =
      volume_file("ball.nrrd", volume_of([](const Vec3& p) { return p.norm() - 0.06; }, 59, 3e-3));
  return file;
}

}  // namespace haptrace::test
