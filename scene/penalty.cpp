#include "scene/penalty.h"

#include "base/error.h"

#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr double kMaxSurfaceStiffness = 1e9;  // [N/m]
constexpr double kMaxSurfaceDamping = 1e5;    // [N s/m]
constexpr double kMaxLead = 3;                // [ticks]

}  // namespace

PenaltySpec read_penalty(JsonReader& reader) {
  return {.stiffness = reader.require("stiffness").number("stiffness", 0, 0, kMaxSurfaceStiffness),
          .damping = reader.number("damping", 0, 0, kMaxSurfaceDamping),
          .lead = reader.number("lead", 0, 0, kMaxLead)};
}

Penalty::Penalty(const std::string& name, const PenaltySpec& spec) : spec_(spec) {
  check_range(name + ": stiffness", spec.stiffness, 0, kMaxSurfaceStiffness, "N/m");
  check_range(name + ": damping", spec.damping, 0, kMaxSurfaceDamping, "N s/m");
  set_lead(name, spec.lead);
}

void Penalty::prepare(const SceneTiming& timing) noexcept {
  tick_ = 1 / timing.rate_hz;
  ahead_ = spec_.lead * tick_;
}

void Penalty::set_lead(const std::string& name, double lead) {
  check_range(name + ": lead", lead, 0, kMaxLead, "ticks");
  spec_.lead = lead;
  ahead_ = lead * tick_;
}

}  // namespace haptrace
