// Volumes in files: scalar values on a grid, in NRRD, NIfTI-1 or raw bytes with a JSON header.
#pragma once

#include "base/types.h"

#include <array>
#include <cstddef>
#include <string>
#include <vector>

namespace haptrace {

/// Scalar values at the points of a grid with three axes, whose directions may have either handedness.
struct VolumeData {
  std::array<std::size_t, 3> size{};                    ///< number of samples along each axis
  std::vector<float> values;                            ///< the index of the first axis runs fastest
  Vec3 origin = Vec3::Zero();                           ///< place of the first sample [m]
  Eigen::Matrix3d steps = Eigen::Matrix3d::Identity();  ///< columns: from a sample to the next along each axis [m]

  [[nodiscard]] float at(std::size_t i, std::size_t j, std::size_t k) const noexcept {
    return values[i + size[0] * (j + size[1] * k)];
  }
  /// Returns the place of a sample, of which the indices may be fractions [m].
  [[nodiscard]] Vec3 place(const Vec3& index) const noexcept { return origin + steps * index; }
};

struct VolumeLoad {
  VolumeData data;
  std::string data_file;             ///< path of the file with the values, if the header is in a file of its own
  std::vector<std::string> remarks;  ///< notes for the user: what was assumed, and what may surprise
};

inline constexpr std::size_t kMostVoxels = std::size_t{512} << 20U;

/// Reads a volume; the ending of the name tells the format:
///
/// - .nrrd, .nhdr: NRRD, header attached or detached, encodings raw, gzip and ascii;
/// - .nii, .nii.gz: NIfTI-1 in one file, the place from the sform or else the qform;
/// - .json: {"file", "type", "sizes", "spacing", "origin", "endian", "unit"} for a file of raw values beside it.
///
/// Values are int8 to uint32, float or double, little or big endian, and become single precision. Lengths are in `unit`
/// ("m", "mm", "cm", "um", "in"); if it is empty, in the file's own unit, or in mm if the file states none. Axes are
/// those of the file, except that an NRRD file in left-posterior-superior or left-anterior-superior coordinates is
/// turned to right-anterior-superior ones, as those of NIfTI.
///
/// Throws Error(input) naming the file and what is wrong in it: it is missing or truncated, has more than kMostVoxels,
/// fewer than 2 samples along an axis, a value that is not finite, or axes that do not span the space. Memory is at
/// most in proportion to the file.
VolumeLoad load_volume(const std::string& file, const std::string& unit);

}  // namespace haptrace
