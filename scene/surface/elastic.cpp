#include "scene/surface/elastic.h"

#include "base/error.h"

namespace haptrace {
namespace {

constexpr double kMaxSurfaceStiffness = 1e9;  // [N/m]
constexpr double kMaxSurfaceDamping = 1e5;    // [N s/m]
constexpr double kMaxLead = 3;                // [ticks]

}  // namespace

ElasticSpec read_elastic(JsonReader& reader) {
  const double stiffness = reader.require("stiffness").number("stiffness", 0, 0, kMaxSurfaceStiffness);
  ElasticSpec spec = read_damping(reader);
  spec.stiffness = stiffness;
  return spec;
}

ElasticSpec read_damping(JsonReader& reader) {
  return {.damping = reader.number("damping", 0, 0, kMaxSurfaceDamping), .lead = reader.number("lead", 0, 0, kMaxLead)};
}

ElasticSurface::ElasticSurface(const ElasticSpec& spec) : spec_(spec) {
  check_range("stiffness", spec.stiffness, 0, kMaxSurfaceStiffness, "N/m");
  check_range("damping", spec.damping, 0, kMaxSurfaceDamping, "N s/m");
  check_range("lead", spec.lead, 0, kMaxLead, "ticks");
}

Knob lead_knob(double level) {
  return {"lead", "ticks", {0, 0.5}, level, 0, kMaxLead};
}

std::vector<Knob> ElasticSurface::knobs() const {
  return {lead_knob(spec_.lead)};
}

void ElasticSurface::set(const std::string& knob, double level) {
  if (knob == "lead") spec_.lead = level;
}

}  // namespace haptrace
