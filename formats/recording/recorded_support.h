// The support of the arm in the configuration of a recording.
#pragma once

#include "control/arm_support.h"

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

namespace haptrace {

/// Adds a support to the configuration of a session: `support` [N], `up`, `support_top` and `support_fade` [m].
void put_support(nlohmann::json& config, const ArmSupport::Options& support);

/// Returns the support of a recording with this configuration; nothing without one. Throws Error(input) that begins
/// with `where` if its direction is none.
std::optional<ArmSupport::Options> recorded_support(const nlohmann::json& config, const std::string& where);

}  // namespace haptrace
