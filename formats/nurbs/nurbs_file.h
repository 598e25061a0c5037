// Rational B-spline patches: as JSON in a scene or in a file of their own, and in STEP and IGES files.
#pragma once

#include "base/json_reader.h"
#include "base/types.h"

#include <array>
#include <string>
#include <vector>

namespace haptrace {

/// Largest degree of a patch in u and v.
inline constexpr int kMostNurbsDegree = 5;

/// A rational B-spline patch.
struct NurbsData {
  using Loop = std::vector<Eigen::Vector2d>;  ///< closed; the last point is not the first one again

  std::array<int, 2> degree{};               ///< in u and v
  std::array<std::vector<double>, 2> knots;  ///< of u and v; one more than points + degree, not decreasing
  std::array<int, 2> count{};                ///< of points along u and v
  std::vector<Eigen::Vector4d> points;       ///< x, y, z [m] and weight, not multiplied; v runs fastest
  std::vector<Loop> outer;                   ///< loops in (u, v) around the patch; empty: all of the domain
  std::vector<Loop> holes;                   ///< loops in (u, v) around what is cut out
  bool turned = false;                       ///< its outside is not du x dv but dv x du

  [[nodiscard]] double least(std::size_t side) const { return knots[side][static_cast<std::size_t>(degree[side])]; }
  [[nodiscard]] double most(std::size_t side) const { return knots[side][static_cast<std::size_t>(count[side])]; }
};

/// Reads the keys `patches` and `unit` of an object: {"patches": [{"degree", "knots_u", "knots_v", "points", "trim"}]}.
/// Throws Error(input) naming the key.
std::vector<NurbsData> read_nurbs_patches(JsonReader& reader);

/// Reads patches from a file: JSON of the same form, or STEP or IGES if haptrace was built with OCCT. STEP and IGES are
/// read in a process of its own, with limits on memory and time.
///
/// Throws Error(input) naming the file, what is wrong in it and where.
std::vector<NurbsData> load_nurbs(const std::string& file);

/// Throws Error(input) for a patch that has no surface: numbers that do not fit, knots that decrease, weights that are
/// not positive, loops outside the domain. `where` names the patch.
void check_nurbs(const NurbsData& patch, const std::string& where);

/// Returns whether this build reads STEP and IGES files.
bool reads_step_files() noexcept;

/// Reads the patches of a STEP or IGES file in this process. Throws Error(input). Call load_nurbs() instead: the
/// library may end the process at a broken file.
std::vector<NurbsData> load_nurbs_with_occt(const std::string& file);

}  // namespace haptrace
