#include "base/vectors.h"

#include "base/error.h"
#include "base/units.h"

#include <algorithm>
#include <fmt/format.h>
#include <optional>

namespace haptrace {

Vec3 parse_vector(std::string_view text, std::string_view si, std::string_view what) {
  Vec3 vector;
  std::string_view rest = text;
  for (int axis = 0; axis < 3; ++axis) {
    const std::size_t comma = axis < 2 ? rest.find(',') : rest.size();
    const std::optional<double> value =
        comma == std::string_view::npos ? std::nullopt : parse_quantity(rest.substr(0, comma), si);
    if (!value)
      throw input_error(fmt::format("{} is '{}'; it must be three numbers, separated by commas{}", what, text,
                                    si == "1" ? "" : fmt::format(", each with or without a unit of {}", si)));
    vector[axis] = *value;
    rest.remove_prefix(std::min(rest.size(), comma + 1));
  }
  return vector;
}

Vec3 direction_of(const Vec3& vector, std::string_view what) {
  const double largest = vector.cwiseAbs().maxCoeff();
  if (!is_finite(vector) || !(largest > 0))
    throw input_error(fmt::format(
        "{}: has no length, so it is no direction; give three finite numbers, at least one of which is not 0", what));
  return (vector / largest).normalized();  // scaled, because the square of a large or small number is not finite, or 0
}

Vec3 parse_direction(std::string_view text, std::string_view what) {
  return direction_of(parse_vector(text, "1", what), what);
}

}  // namespace haptrace
