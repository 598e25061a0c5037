// Vectors and directions as users give them.
#pragma once

#include "base/types.h"

#include <string_view>

namespace haptrace {

/// Parses "10mm,0,0", three numbers with or without units of the quantity whose SI unit is `si` ("1": without units),
/// and returns them in SI. Throws Error(input), which begins with `what`.
Vec3 parse_vector(std::string_view text, std::string_view si, std::string_view what);

/// Returns the unit vector along `vector`, which has any length but zero. Throws Error(input), which begins with
/// `what`, if the vector has no length or is not finite.
Vec3 direction_of(const Vec3& vector, std::string_view what);

/// Parses "0,1,0" as a direction and returns its unit vector. Throws Error(input), which begins with `what`.
Vec3 parse_direction(std::string_view text, std::string_view what);

}  // namespace haptrace
