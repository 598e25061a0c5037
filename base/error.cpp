#include "base/error.h"

#include <fmt/format.h>

namespace haptrace {

void check_range(std::string_view what, double value, double least, double most, std::string_view unit) {
  if (value >= least && value <= most) return;
  const std::string_view blank = unit.empty() ? "" : " ";
  throw input_error(
      fmt::format("{} is {}{}{}; it must be from {} to {}{}{}", what, value, blank, unit, least, most, blank, unit));
}

}  // namespace haptrace
