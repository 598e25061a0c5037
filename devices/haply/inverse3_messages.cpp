#include "devices/haply/inverse3_messages.h"

#include "base/error.h"
#include "base/json_reader.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <span>

namespace haptrace {
namespace {

using nlohmann::json;

constexpr const char* kInverseArms = "inverse3";
constexpr std::array kInverseGrips{"wireless_verse_grip", "verse_grip"};

Error inverse_wrong(const std::string& key, const json& found) {
  return device_error(
      fmt::format("the Inverse Service sends '{}: {:.40}', which its versions 3.1 to 3.5 do not send; update the "
                  "service or haptrace",
                  key, found.dump(-1, ' ', false, json::error_handler_t::replace)));
}

/// Returns the value under `key`; null if there is none.
const json& inverse_field(const json& object, const char* key) {
  static const json absent;
  const auto found = object.find(key);
  return found != object.end() ? *found : absent;
}

/// Returns the object under `key`; an empty one if there is none.
const json& inverse_object(const json& parent, const char* key) {
  static const json empty = json::object();
  const json& found = inverse_field(parent, key);
  if (found.is_null()) return empty;
  if (!found.is_object()) throw inverse_wrong(key, found);
  return found;
}

double inverse_number(const json& object, const char* key, double otherwise = 0) {
  const json& found = inverse_field(object, key);
  if (found.is_null()) return otherwise;
  if (!found.is_number()) throw inverse_wrong(key, found);
  return found.get<double>();
}

bool inverse_flag(const json& object, const char* key) {
  const json& found = inverse_field(object, key);
  if (found.is_null()) return false;
  if (!found.is_boolean()) throw inverse_wrong(key, found);
  return found.get<bool>();
}

std::string inverse_text(const json& object, const char* key, const char* otherwise) {
  const json& found = inverse_field(object, key);
  if (found.is_null()) return otherwise;
  if (!found.is_string()) throw inverse_wrong(key, found);
  return found.get<std::string>();
}

Vec3 inverse_vector(const json& parent, const char* key, double otherwise = 0) {
  const json& object = inverse_object(parent, key);
  return {inverse_number(object, "x", otherwise), inverse_number(object, "y", otherwise),
          inverse_number(object, "z", otherwise)};
}

Quat inverse_rotation(const json& parent, const char* key) {
  const json& object = inverse_object(parent, key);
  const Quat q(inverse_number(object, "w", 1), inverse_number(object, "x"), inverse_number(object, "y"),
               inverse_number(object, "z"));
  if (!(q.norm() > 0.5 && q.norm() < 2)) throw inverse_wrong(key, object);
  return q.normalized();
}

constexpr double kSamePlacement = 1e-6;

/// Settings without a known default.
constexpr std::array kInverseTexts{std::pair{"handedness", &InverseArm::handedness},
                                   std::pair{"preset", &InverseArm::preset},
                                   std::pair{"filters", &InverseArm::filters}};

/// Adds the effects of `transform` on positions and forces to `displaced`, and its ten numbers to `placement`.
void inverse_displacement(const json& transform, const std::string& name, std::vector<std::string>& displaced,
                          std::span<double, 10> placement) {
  const Vec3 position = inverse_vector(transform, "position"), scale = inverse_vector(transform, "scale", 1);
  const Quat rotation = inverse_rotation(transform, "rotation");
  if (!position.isZero(kSamePlacement)) displaced.push_back(name + " position");
  if (rotation.angularDistance(Quat::Identity()) > kSamePlacement) displaced.push_back(name + " rotation");
  if (!scale.isOnes(kSamePlacement)) displaced.push_back(name + " scale");
  const double sign = rotation.w() < 0 ? -1 : 1;  // q and -q are the same rotation
  const std::array numbers{
      position.x(),        position.y(),        position.z(), sign * rotation.w(), sign * rotation.x(),
      sign * rotation.y(), sign * rotation.z(), scale.x(),    scale.y(),           scale.z()};
  std::copy(numbers.begin(), numbers.end(), placement.begin());
}

/// Returns a basis with all signs: "XYZ" and "+X+Y+Z" are the same.
std::string inverse_basis(const std::string& permutation) {
  std::string basis;
  for (const char c : permutation) {
    if (c != '+' && c != '-' && (basis.empty() || (basis.back() != '+' && basis.back() != '-'))) basis += '+';
    basis += c;
  }
  return basis;
}

/// Merges the values of `told` into `known`; null changes nothing.
void inverse_merge(json& known, const json& told) {
  if (!told.is_object()) {
    if (!told.is_null()) known = told;
    return;
  }
  if (!known.is_object()) known = json::object();
  for (const auto& [key, value] : told.items()) inverse_merge(known[key], value);
}

json inverse_parsed(const std::string& message) {
  json parsed;
  try {
    parsed = parse_json(message, "its message");
  } catch (const Error& error) {
    throw device_error(
        fmt::format("the program that answers is not Haply's Inverse Service: {}; check the url", error.what()));
  }
  if (!parsed.is_object()) throw inverse_wrong("message", parsed);
  return parsed;
}

}  // namespace

const char* to_string(InverseForceKey key) noexcept {
  return key == InverseForceKey::vector ? "vector" : "values";
}

InverseObstacle obstacle_of(const InverseArm& arm, bool ours) {
  if (!arm.powered)
    return {"it has no power supply, and USB alone moves no motor",
            "plug its power supply in and switch it on, until the service reports power_supply"};
  if (arm.in_use && !ours)
    return {"another program uses it",
            "close that program (a demo of the Haply Hub, another haptrace), then try again"};
  if (!arm.calibrated)
    return {"it is not calibrated, so its positions are meaningless",
            "put the grip into the inkwell and wait until the light shows that it is calibrated"};
  if (!arm.ready)
    return {"its service reports that it is not ready",
            "wait until its light is steady; then pull the emergency stop out if it has one, or restart the service"};
  return {};
}

void InverseServiceView::take(const std::string& message) {
  const json told = inverse_parsed(message);
  const json& refused = inverse_field(told, "error");
  refusal_ = refused.is_null()     ? ""
             : refused.is_string() ? refused.get<std::string>()
                                   : refused.dump(-1, ' ', false, json::error_handler_t::replace);
  listed_.clear();
  for (const std::string kind : {kInverseArms, kInverseGrips[0], kInverseGrips[1]}) {
    const json& devices = inverse_field(told, kind.c_str());
    if (devices.is_null()) continue;
    if (!devices.is_array()) throw inverse_wrong(kind, devices);
    for (const json& device : devices) {
      if (!device.is_object()) throw inverse_wrong(kind, device);
      const std::string id = inverse_text(device, "device_id", "");
      if (id.empty()) throw inverse_wrong(kind, device);
      if (kind == kInverseArms) listed_.push_back(id);
      inverse_merge(kinds_[kind][id], device);
    }
  }
}

bool InverseServiceView::lists(const std::string& id) const noexcept {
  return std::find(listed_.begin(), listed_.end(), id) != listed_.end();
}

InverseArm InverseServiceView::arm(const std::string& id) const {
  InverseArm arm;
  const auto arms = kinds_.find(kInverseArms);
  if (arms == kinds_.end() || !arms->second.contains(id)) return arm;
  const json& told = arms->second.at(id);
  const json &config = inverse_object(told, "config"), &state = inverse_object(told, "state"),
             &status = inverse_object(told, "status");
  arm.type = inverse_text(config, "type", kInverseArms);
  arm.position = inverse_vector(state, "cursor_position");
  if (state.contains("cursor_velocity")) arm.velocity = inverse_vector(state, "cursor_velocity");
  arm.powered = inverse_flag(status, "power_supply");
  arm.calibrated = inverse_flag(status, "calibrated");
  arm.ready = inverse_flag(status, "ready");
  arm.in_use = inverse_flag(status, "in_use");

  const std::string permutation = inverse_text(inverse_object(config, "basis"), "permutation", "XYZ");
  arm.basis = inverse_basis(permutation);
  if (arm.basis != "+X+Y+Z") arm.displaced.push_back("basis " + permutation);
  // The documentation shows a mount with these fields, and one with an object "transform" that has them.
  const json& mount = inverse_object(config, "mount");
  const std::span<double, 20> placement(arm.placement);
  inverse_displacement(mount.contains("transform") ? inverse_object(mount, "transform") : mount, "mount", arm.displaced,
                       placement.first<10>());
  inverse_displacement(inverse_object(state, "transform"), "transform", arm.displaced, placement.last<10>());
  arm.handedness = inverse_text(config, "handedness", "");
  arm.preset = inverse_text(config, "preset", "");
  if (const json& filters = inverse_field(config, "filters"); !filters.is_null())
    arm.filters = filters.dump(-1, ' ', false, json::error_handler_t::replace);
  return arm;
}

void InverseArm::complete(const InverseArm& now) {
  for (const auto& [name, text] : kInverseTexts)
    if ((this->*text).empty()) this->*text = now.*text;
}

std::string changed_setting(const InverseArm& before, const InverseArm& now) {
  if (before.basis != now.basis) return fmt::format("basis {} became {}", before.basis, now.basis);
  constexpr std::array kParts{"position", "position", "position", "rotation", "rotation",
                              "rotation", "rotation", "scale",    "scale",    "scale"};
  for (std::size_t i = 0; i < before.placement.size(); ++i)
    if (!(std::abs(before.placement[i] - now.placement[i]) <= kSamePlacement))
      return fmt::format("{} {} changed", i < kParts.size() ? "mount" : "transform", kParts[i % kParts.size()]);
  for (const auto& [name, text] : kInverseTexts)
    if (!(before.*text).empty() && before.*text != now.*text)
      return fmt::format("{} {:.60} became {:.60}", name, before.*text, now.*text);
  return "";
}

bool InverseEvent::ends_control() const noexcept {
  if (name == "device-disconnected") return true;
  return name == "device-safety-triggered" && level != "info" && level != "notice";
}

std::optional<InverseEvent> inverse_event(const std::string& message) {
  const json parsed = json::parse(message, nullptr, false);
  if (!parsed.is_object()) return std::nullopt;
  const auto text = [](const json& object, const char* key) {
    const json& found = inverse_field(object, key);
    return found.is_string() ? found.get<std::string>() : std::string();
  };
  const json none = json::object();
  const json& told = inverse_field(parsed, "data");
  const json& data = told.is_object() ? told : none;
  InverseEvent event{.name = text(parsed, "name"),
                     .type = text(data, "safety_type"),
                     .device = text(data, "device_id"),
                     .level = text(parsed, "level"),
                     .message = text(parsed, "message")};
  if (event.name.empty()) return std::nullopt;
  return event;
}

std::optional<InverseGrip> InverseServiceView::grip() const {
  for (const char* kind : kInverseGrips) {
    const auto grips = kinds_.find(kind);
    if (grips == kinds_.end() || grips->second.empty()) continue;
    const json& state = inverse_object(grips->second.begin()->second, "state");
    const json& buttons = inverse_object(state, "buttons");
    InverseGrip grip{.orientation = inverse_rotation(state, "orientation")};
    for (const auto& [key, bit] : {std::pair{"a", 1U}, {"b", 2U}, {"c", 4U}})
      if (inverse_flag(buttons, key)) grip.buttons |= bit;
    return grip;
  }
  return {};
}

InverseForceKey InverseServiceView::force_key() const {
  const auto arms = kinds_.find(kInverseArms);
  if (arms != kinds_.end())
    for (const auto& [id, arm] : arms->second)
      for (const char* key : {"basis", "mount", "preset", "filters"})
        if (inverse_object(arm, "config").contains(key)) return InverseForceKey::vector;
  return InverseForceKey::values;
}

std::string inverse_command(const std::string& id, const Vec3& force, InverseForceKey key, bool first) {
  const json vector{{"x", force.x()}, {"y", force.y()}, {"z", force.z()}};
  json arm{{"device_id", id}, {"commands", {{"set_cursor_force", {{to_string(key), vector}}}}}};
  json message{{kInverseArms, json::array({std::move(arm)})}};
  if (first) message["session"] = {{"configure", {{"profile", {{"name", "haptrace"}}}}}};
  return message.dump();
}

}  // namespace haptrace
