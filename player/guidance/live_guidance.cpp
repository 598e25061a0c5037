#include "player/guidance/live_guidance.h"

#include "base/error.h"
#include "base/units.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace haptrace {
namespace {

constexpr double kLeastRadius = 1e-4;  // [m]
constexpr double kLeastStiffness = 1;  // [N/m]
constexpr double kLargestForce = 1.5;  // factor on the expert's force
constexpr double kLeastRadiusFactor = 0.1, kLargestRadiusFactor = 10;

}  // namespace

struct LiveGuidance::Quantity {
  const char *name, *label, *unit, *part;
  double GuidanceValues::*value;
  std::optional<double> Changed::*changed;
  bool (*present)(const Scope&);
  double (*least)(const Scope&);
  double (*largest)(const Scope&);
  const char* because;  ///< name of the largest value; null: that of the scope
};

const std::vector<LiveGuidance::Quantity>& LiveGuidance::all() {
  static const std::vector<Quantity> kAll{
      {"radius", "Radius of the tunnel", "m", "tunnel", &GuidanceValues::radius, &Changed::radius,
       [](const Scope& scope) { return scope.walls; },
       [](const Scope& scope) { return scope.varies ? kLeastRadiusFactor : kLeastRadius; },
       [](const Scope& scope) { return scope.varies ? kLargestRadiusFactor : scope.largest_radius; },
       "distance at which the session stops"},
      {"stiffness", "Stiffness of the walls", "N/m", "walls", &GuidanceValues::stiffness, &Changed::stiffness,
       [](const Scope& scope) { return scope.walls; }, [](const Scope&) { return kLeastStiffness; },
       [](const Scope& scope) { return scope.largest_stiffness; }, nullptr},
      {"force", "Share of the expert's force", "", "force of the expert", &GuidanceValues::force, &Changed::force,
       [](const Scope& scope) { return scope.expert_force; }, [](const Scope&) { return 0.0; },
       [](const Scope& scope) { return std::max(kLargestForce, scope.start.force); }, "limit for the expert's force"},
      {"assist", "Help", "", "help along the path", &GuidanceValues::assist, &Changed::assist,
       [](const Scope& scope) { return scope.help || scope.adapts; }, [](const Scope&) { return 0.0; },
       [](const Scope&) { return 1.0; }, "full help"},
      {"damping", "Damping of the walls", "N s/m", "damping in walls", &GuidanceValues::damping, &Changed::damping,
       [](const Scope& scope) { return scope.walls && scope.composed.damping > 0; }, [](const Scope&) { return 0.0; },
       [](const Scope& scope) { return scope.start.damping; }, "damping at the start"},
  };
  return kAll;
}

const std::vector<std::string>& LiveGuidance::quantities() const {
  static const std::vector<std::string> kNames = [] {
    std::vector<std::string> names;
    for (const Quantity& one : all()) names.emplace_back(one.name);
    return names;
  }();
  return kNames;
}

std::string LiveGuidance::help() const {
  return "radius LENGTH, as 6mm or 0.006 (a factor if the radius varies) | radius * F | radius / F ; "
         "stiffness X [N/m] | * F | / F ; force F 0 to 1.5 ; assist SHARE 0 to 1 ; damping X [N s/m]";
}

std::string LiveGuidance::missing(const Quantity& one) const {
  if (!scope_)
    return unguided_.empty() ? fmt::format("{}: no repetition has begun yet", one.name)
                             : fmt::format("{}: {}", one.name, unguided_);
  return fmt::format("{}: this session has no {}{}", one.name, one.part,
                     scope_->without.empty() ? "" : "; " + scope_->without);
}

const LiveGuidance::Quantity& LiveGuidance::quantity(const std::string& name) const {
  const auto found = std::find_if(all().begin(), all().end(), [&](const Quantity& one) { return name == one.name; });
  const bool present = scope_ && found->present(*scope_) && !(scope_->adapts && name != "assist");
  if (!present) throw input_error(missing(*found));
  return *found;
}

double LiveGuidance::parsed(const Quantity& one, Words values) const {
  const std::string name = one.name;
  const double now = wanted_.*one.value;
  if (const auto factor = factor_of(name, values)) return *factor * now;
  std::string text;
  for (const std::string& value : values) text += value;  // "6 mm"
  const bool length = name == "radius" && !scope_->varies;
  const auto value = length ? parse_quantity(text, "m") : values.size() == 1 ? finite_number(name, text) : kNaN;
  if (!value || !std::isfinite(*value))
    throw input_error(length ? "radius takes a length, such as 6mm or 0.006"
                             : fmt::format("{} takes one number, or a factor as in {} * 1.1", name, name));
  if (*value < 0) throw input_error(fmt::format("{} is negative; it must be at least 0", name));
  return *value;
}

std::string LiveGuidance::value_text(const Quantity& one, double value) const {
  const bool length = one.value == &GuidanceValues::radius && !(scope_ && scope_->varies);
  return length ? fmt::format("{:.6g}mm", 1e3 * value) : fmt::format("{:.6g}", value);
}

std::string LiveGuidance::text_of(const std::string& name) const {
  const Quantity& one = quantity(name);
  return fmt::format("{} {}", name, value_text(one, wanted_.*one.value));
}

std::string LiveGuidance::change(const std::string& name, Words values) {
  const Quantity& one = quantity(name);
  const double asked = parsed(one, values);
  const double least = one.least(*scope_), largest = one.largest(*scope_);
  const double value = std::clamp(asked, std::min(least, largest), largest);
  if (value != wanted_.*one.value) {
    wanted_.*one.value = value;
    changed_[exercise_].*one.changed = value;
    post();
    log_change(name, text_of(name));
  }
  std::string text = text_of(name);
  if (value != asked)
    text +=
        fmt::format(" clamped from {}: {} is the {}", value_text(one, asked), value_text(one, value),
                    value < asked ? (one.because != nullptr ? one.because : scope_->because.c_str()) : "least value");
  if (scope_->adapts) text += " from the next repetition";
  return text;
}

std::string LiveGuidance::reset() {
  if (!scope_) throw input_error(missing(all().front()));
  changed_.erase(exercise_);
  const bool differs = !(wanted_ == scope_->start);
  wanted_ = scope_->start;
  std::string text = summarise();
  if (differs) {
    post();
    log_change("reset", "reset to " + text);
  }
  return text;
}

void LiveGuidance::post() {
  const GuidanceValues& base = scope_->composed;
  const auto factor = [](double wanted, double composed) { return composed > 0 ? wanted / composed : 1; };
  GuideTuning tuning;
  if (scope_->varies)
    tuning.radius_scale = wanted_.radius;
  else
    tuning.radius_offset = wanted_.radius - base.radius;
  tuning.assist = factor(wanted_.assist, base.assist);
  tuning.stiffness = factor(wanted_.stiffness, base.stiffness) * (scope_->walls_help ? tuning.assist : 1);
  tuning.force = factor(wanted_.force, base.force);
  tuning.damping = factor(wanted_.damping, base.damping);
  mailbox_.post(scope_->adapts ? GuideTuning{} : tuning);
}

void LiveGuidance::begin(Scope scope, std::size_t exercise) {
  const std::lock_guard lock(mutex());
  scope.largest_radius = std::max(scope.largest_radius, scope.start.radius);
  scope.largest_stiffness = std::max(scope.largest_stiffness, scope.start.stiffness);
  scope_ = std::move(scope);
  exercise_ = exercise;
  wanted_ = scope_->start;
  change_as_asked(wanted_, exercise);
  wanted_.stiffness = std::min(wanted_.stiffness, scope_->largest_stiffness);
  post();
}

void LiveGuidance::begin_unguided(std::string name) {
  const std::lock_guard lock(mutex());
  scope_.reset();
  unguided_ = std::move(name);
}

void LiveGuidance::change_as_asked(GuidanceValues& values, std::size_t exercise) const {
  const auto found = changed_.find(exercise);
  if (found == changed_.end()) return;
  for (const Quantity& one : all())
    if (const auto value = found->second.*one.changed) values.*one.value = *value;
}

GuidanceValues LiveGuidance::next(std::size_t exercise, const GuidanceValues& start) const {
  const std::lock_guard lock(mutex());
  GuidanceValues values = start;
  change_as_asked(values, exercise);
  return values;
}

GuidanceValues LiveGuidance::wanted() const {
  const std::lock_guard lock(mutex());
  return wanted_;
}

nlohmann::json LiveGuidance::state() const {
  nlohmann::json json = nlohmann::json::object();
  if (!scope_) return json;
  json["limits"] = nlohmann::json::object();
  for (const LiveControl& control : list_controls()) {
    json[control.name] = control.value;
    json["limits"][control.name] = control.largest;
  }
  return json;
}

std::vector<LiveControl> LiveGuidance::list_controls() const {
  constexpr double kSteps = 20;   // from the least to the largest value
  constexpr double kRatio = 1.1;  // of a button for the stiffness, as of a key in the terminal
  std::vector<LiveControl> controls;
  if (!scope_) return controls;
  for (const Quantity& one : all()) {
    if (!one.present(*scope_) || (scope_->adapts && one.value != &GuidanceValues::assist)) continue;
    const bool radius = one.value == &GuidanceValues::radius, stiffness = one.value == &GuidanceValues::stiffness;
    const double value = wanted_.*one.value;
    const double largest = one.largest(*scope_);
    controls.push_back({.name = one.name,
                        .label = radius && scope_->varies ? "Factor on the radius of the tunnel" : one.label,
                        .unit = radius && scope_->varies ? "" : one.unit,
                        .value = value,
                        .least = std::min(one.least(*scope_), largest),
                        .largest = largest,
                        .step = radius      ? (scope_->varies ? 0.1 : 5e-4)
                                : stiffness ? (kRatio - 1) * value
                                            : largest / kSteps,
                        .ratio = stiffness ? kRatio : 0,
                        .because = one.because != nullptr ? one.because : scope_->because});
  }
  return controls;
}

std::string LiveGuidance::summarise() const {
  std::string text;
  if (!scope_) return text;
  for (const LiveControl& control : list_controls())
    text += fmt::format("{}{}", text.empty() ? "" : " ", text_of(control.name));
  return text;
}

}  // namespace haptrace
