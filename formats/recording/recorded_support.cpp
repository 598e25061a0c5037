#include "formats/recording/recorded_support.h"

#include "base/json_reader.h"
#include "base/vectors.h"

#include <algorithm>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace haptrace {

void put_support(nlohmann::json& config, const ArmSupport::Options& support) {
  config["support"] = support.force;
  config["up"] = fmt::format("{:.6g},{:.6g},{:.6g}", support.up.x(), support.up.y(), support.up.z());
  config["support_top"] = support.top;
  config["support_fade"] = support.fade;
}

std::optional<ArmSupport::Options> recorded_support(const nlohmann::json& config, const std::string& where) {
  ArmSupport::Options support{.force = number_in(config, "support").value_or(0)};
  if (!(support.force > 0)) return std::nullopt;
  support.up = parse_direction(text_in(config, "up", "0,1,0"), where + ": up");
  support.top = number_in(config, "support_top").value_or(support.top);
  support.fade = std::max(number_in(config, "support_fade").value_or(support.fade), 1e-4);  // as ArmSupport asks
  return support;
}

Vec3 carried_force(const ArmSupport::Options& support, const Sample& sample) noexcept {
  if (!is_finite(sample.position)) return Vec3::Zero();
  const Vec3 velocity = is_finite(sample.velocity) ? sample.velocity : Vec3(Vec3::Zero());
  // The time counts from the session's first tick, also in a later part and in a piece that was cut out.
  const double risen = std::clamp(1e-9 * static_cast<double>(sample.time_ns) / ArmSupport::kRise, 0.0, 1.0);
  return risen * ArmSupport::steady(support, sample.position, velocity);
}

}  // namespace haptrace
