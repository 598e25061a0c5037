// The support of the arm in the configuration of a recording.
#pragma once

#include "control/arm_support.h"
#include "control/sample.h"

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

namespace haptrace {

/// Adds a support to the configuration of a session: `support` [N], `up`, `support_top` and `support_fade` [m].
void put_support(nlohmann::json& config, const ArmSupport::Options& support);

/// Returns the support of a recording with this configuration; nothing without one. Throws Error(input) that begins
/// with `where` if its direction is none.
std::optional<ArmSupport::Options> recorded_support(const nlohmann::json& config, const std::string& where);

/// Returns the force with which the support carried the hand at a row of the recording, in W [N]. It rises over
/// ArmSupport::kRise from time 0 of the session, and follows ArmSupport::steady(). The velocity counts as zero where it
/// is not finite. The force is zero where the position is not finite, as in the session.
Vec3 carried_force(const ArmSupport::Options& support, const Sample& sample) noexcept;

}  // namespace haptrace
