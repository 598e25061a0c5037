#include "control/pd.h"

#include "base/error.h"

#include <fmt/format.h>

namespace haptrace {
namespace {

void check(const char* name, const Vec3& gain, double largest, const char* unit) {
  for (int axis = 0; axis < 3; ++axis)
    if (!(gain[axis] >= 0 && gain[axis] <= largest))
      throw input_error(fmt::format("{} of the {} axis is {} {}; it must be from 0 to {} {}", name, "xyz"[axis],
                                    gain[axis], unit, largest, unit));
}

}  // namespace

std::vector<std::string> names_of(const Compensations& composed, bool present) {
  std::vector<std::string> names;
  for (const CompensationTerm& term : kCompensationTerms)
    if (composed.*term.composed == present) names.emplace_back(term.name);
  return names;
}

void validate(const PdGains& gains) {
  check("proportional gain kp", gains.kp, kLargestKp, "N/m");
  check("derivative gain kd", gains.kd, kLargestKd, "N s/m");
}

PdGains cautious_gains(double max_force, double rate_hz) {
  constexpr double kDeviationAtLimit = 0.016;  // [m]
  constexpr double kDerivativeTime = 0.012;    // [s]
  const double slow = std::min(1.0, rate_hz / 200);
  const double kp = std::min(max_force / kDeviationAtLimit * slow, kLargestKp);
  return {Vec3::Constant(kp), Vec3::Constant(std::min(kDerivativeTime * kp * slow, kLargestKd))};
}

}  // namespace haptrace
