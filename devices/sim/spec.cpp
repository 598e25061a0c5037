#include "devices/sim/spec.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "devices/sim/presets.h"

#include <filesystem>
#include <fmt/format.h>
#include <numbers>
#include <utility>

namespace haptrace {
namespace {

using nlohmann::json;

// Wide enough for any device that a hand can hold; a number outside is probably in the wrong unit.
constexpr double kMinMass = 1e-6, kMaxMass = 1e4;    // [kg]
constexpr double kMinInertia = 1e-9;                 // [kg m^2]
constexpr double kMaxForce = 1e5;                    // [N]
constexpr double kMaxLength = 100;                   // [m]
constexpr double kMaxStiffness = 1e9;                // [N/m]
constexpr double kMaxDamping = 1e5;                  // [N s/m]
constexpr double kMaxDelay = 1;                      // [s]
constexpr double kMinSpeed = 1e-6, kMaxSpeed = 100;  // [m/s]
constexpr double kMinPeriod = 1e-6;                  // [m]
constexpr double kMaxTime = 1e4;                     // [s]
constexpr double kMaxFrequency = 1e5;                // [Hz]
constexpr double kMinHandFrequency = 0.1;            // of its noise [Hz]
constexpr double kMaxHandFrequency = 100;            // [Hz]
constexpr double kMaxVariation = 0.9;                // of the mass, over the workspace

Error spec_error(const JsonReader& reader, const std::string& what) {
  return input_error(reader.where() + ": " + what);
}

HandSpec read_hand_parts(JsonReader reader, const std::string& folder) {
  if (!reader.has("mass")) throw spec_error(reader, "'mass' is missing; give the hand's mass in kg, or a 'preset'");
  HandSpec hand;
  hand.mass = reader.number("mass", 0, kMinMass, kMaxMass);
  hand.grip_stiffness = reader.number("grip_stiffness", 0, 0, kMaxStiffness);
  hand.grip_damping = reader.number("grip_damping", 0, 0, kMaxDamping);
  hand.arm_stiffness = reader.number("arm_stiffness", 0, 0, kMaxStiffness);
  hand.arm_relaxation = reader.number("arm_relaxation_s", 0, 0, kMaxTime);
  hand.arm_damping = reader.number("arm_damping", 0, 0, kMaxDamping);
  hand.tremor = reader.number("tremor", 0, 0, kMaxForce);
  hand.tremor_hz = reader.number("tremor_hz", 0, 0, kMaxHandFrequency);
  hand.drift = reader.number("drift", 0, 0, kMaxForce);
  hand.drift_hz = reader.number("drift_hz", 0, 0, kMaxHandFrequency);
  for (const auto& [key, frequency] : {std::pair{"tremor_hz", hand.tremor_hz}, {"drift_hz", hand.drift_hz}})
    if (frequency > 0 && frequency < kMinHandFrequency)
      throw spec_error(reader, fmt::format("{}: {} Hz is too slow for the hand's noise; give at least {} Hz", key,
                                           frequency, kMinHandFrequency));
  hand.intent_stiffness = reader.number("intent_stiffness", 0, 0, kMaxStiffness);
  hand.intent_damping = reader.number("intent_damping", 0, 0, kMaxDamping);
  hand.turn_stiffness = reader.number("turn_stiffness", 0, 0, kMaxStiffness);
  hand.turn_damping = reader.number("turn_damping", 0, 0, kMaxDamping);
  hand.intent = reader.text("intent", "");
  reader.finish();
  if (!hand.intent.empty()) hand.intent = (std::filesystem::path(folder) / hand.intent).string();
  return hand;
}

/// Reads a preset's name, or an object that may name a preset and change parts of it.
std::optional<HandSpec> read_hand(JsonReader& reader, const json& spec, const std::string& folder) {
  if (!spec.contains("hand")) return std::nullopt;
  json hand = spec["hand"];
  if (hand.is_string()) {
    const std::string preset = reader.text("hand", "");
    if (preset == "none") return std::nullopt;
    hand = hand_preset(preset, reader.where() + ": hand");
  } else if (JsonReader own = *reader.object("hand"); own.has("preset")) {
    json changes = hand;
    changes.erase("preset");
    hand = hand_preset(own.text("preset", ""), own.where());
    hand.merge_patch(changes);
  }
  return read_hand_parts(JsonReader(hand, reader.where() + ": hand"), folder);
}

Eigen::Matrix3d read_gradient(JsonReader& reader, const json& spec) {
  if (!spec.contains("gravity_gradient") || !spec["gravity_gradient"].is_object())
    return reader.vector("gravity_gradient", Vec3::Zero(), -kMaxStiffness, kMaxStiffness).asDiagonal();
  JsonReader rows = *reader.object("gravity_gradient");
  Eigen::Matrix3d gradient;
  for (int row = 0; row < 3; ++row)
    gradient.row(row) = rows.vector(std::string(1, "xyz"[row]), Vec3::Zero(), -kMaxStiffness, kMaxStiffness);
  rows.finish();
  if (gradient != gradient.transpose())
    throw spec_error(rows, "it is not symmetric, so the force would have no potential and create energy");
  return gradient;
}

Box read_workspace(JsonReader& reader, const Box& fallback) {
  auto workspace = reader.object("workspace");
  if (!workspace) return fallback;
  Box box{workspace->vector("min", fallback.min, -kMaxLength, kMaxLength),
          workspace->vector("max", fallback.max, -kMaxLength, kMaxLength)};
  workspace->finish();
  if ((box.min.array() >= box.max.array()).any())
    throw spec_error(*workspace, "'min' must lie below 'max' in every axis");
  return box;
}

std::array<bool, 3> read_axes(JsonReader& reader) {
  const std::string text = reader.text("axes", "xyz");
  std::array<bool, 3> axes{};
  for (const char c : text) {
    const std::size_t axis = std::string_view("xyz").find(c);
    if (axis == std::string_view::npos || axes[axis])
      throw spec_error(reader, fmt::format("axes: '{}' is not a selection of x, y and z", text));
    axes[axis] = true;
  }
  if (text.empty()) throw spec_error(reader, "axes: a device needs at least one axis");
  return axes;
}

void read_friction(JsonReader& reader, SimSpec& spec) {
  spec.coulomb = reader.vector("coulomb", Vec3::Zero(), 0, kMaxForce);
  const bool slides = !spec.coulomb.isZero(0);
  if (auto stribeck = reader.object("stribeck")) {
    if (!slides) throw spec_error(*stribeck, "it needs 'coulomb', which is missing");
    spec.static_ratio = stribeck->number("static_ratio", 1, 1, 100);
    spec.stribeck_velocity = stribeck->number("velocity", 0.01, kMinSpeed, kMaxSpeed);
    stribeck->finish();
  }
  if (auto presliding = reader.object("presliding")) {
    if (!slides) throw spec_error(*presliding, "it needs 'coulomb', which is missing");
    if (presliding->has("distance") == presliding->has("stiffness"))
      throw spec_error(*presliding, "give either 'distance' (m) or 'stiffness' (N/m)");
    const Vec3 distance = presliding->vector("distance", Vec3::Ones(), 1e-12, kMaxLength);
    const Vec3 stiffness = presliding->vector("stiffness", Vec3::Zero(), 1e-3, 1e12);
    spec.presliding_stiffness = presliding->has("distance") ? Vec3(spec.coulomb.cwiseQuotient(distance)) : stiffness;
    spec.presliding_damping = presliding->number("damping", 0, 0, kMaxDamping);
    presliding->finish();
  }
}

void read_structure(JsonReader& reader, SimSpec& spec) {
  if (auto mode = reader.object("structural_mode")) {
    if (!mode->has("frequency_hz")) throw spec_error(*mode, "'frequency_hz' is missing");
    spec.structural_mode.emplace();
    spec.structural_mode->frequency_hz = mode->number("frequency_hz", 0, 0.1, 5000);
    spec.structural_mode->damping_ratio = mode->number("damping_ratio", 0.02, 0, 1);
    spec.structural_mode->handle_fraction = mode->number("handle_fraction", 0.5, 0.01, 0.99);
    mode->finish();
  }
  spec.backlash = reader.number("backlash", 0, 0, kMaxLength);
  if (spec.backlash > 0 && !spec.structural_mode)
    throw spec_error(reader, "backlash: it acts between motor and handle, so it needs a 'structural_mode' as well");
}

void read_wrist(JsonReader& reader, SimSpec& spec) {
  auto wrist = reader.object("wrist");
  if (!wrist) return;
  for (const char* key : {"inertia", "max_torque"})
    if (!wrist->has(key)) throw spec_error(*wrist, fmt::format("'{}' is missing", key));
  spec.wrist = WristSpec{.inertia = wrist->number("inertia", 0, kMinInertia, kMaxMass),
                         .viscous = wrist->number("viscous", 0, 0, kMaxDamping),
                         .coulomb = wrist->number("coulomb", 0, 0, kMaxForce),
                         .max_torque = wrist->number("max_torque", 0, 1e-6, kMaxForce),
                         .resolution = wrist->number("resolution", 0, 0, 1)};
  wrist->finish();
}

/// Throws unless every axis held at zero is an actuator's own axis and has zero in its workspace.
void check_held_axes(const JsonReader& reader, const SimSpec& spec) {
  for (int axis = 0; axis < 3; ++axis) {
    if (spec.axes[static_cast<std::size_t>(axis)]) continue;
    const char name = "xyz"[axis];
    if (spec.workspace.min[axis] > 0 || spec.workspace.max[axis] < 0)
      throw spec_error(reader, fmt::format("axes: {} is held at 0, which the workspace does not contain", name));
    Vec3 rest = spec.rotation;
    rest[axis] = 0;
    if (!rest.isZero(0))
      throw spec_error(reader, fmt::format("axes: {} is held, so actuator_rotation can only turn about it", name));
  }
}

}  // namespace

SimSpec read_sim_spec(const json& spec, const std::string& where, const std::string& folder) {
  JsonReader reader(spec, where);
  for (const char* key : {"mass", "max_force"})
    if (!reader.has(key)) throw spec_error(reader, fmt::format("'{}' is missing; every device has one", key));

  SimSpec sim;
  sim.model = reader.text("model", sim.model);
  sim.rotation = reader.vector("actuator_rotation", sim.rotation, -7, 7);
  sim.axes = read_axes(reader);

  sim.max_force = reader.number("max_force", 0, 1e-6, kMaxForce);
  sim.max_continuous_force = reader.number("max_continuous_force", 0, 0, sim.max_force);
  sim.motor_limit = reader.number("motor_limit", 0, 0, sim.max_force);
  sim.force_resolution = reader.number("force_resolution", 0, 0, kMaxForce);
  sim.delay = reader.number("delay_s", 0, 0, kMaxDelay);
  sim.actuator_bandwidth_hz = reader.number("actuator_bandwidth_hz", 0, 0, kMaxFrequency);

  sim.mass = reader.vector("mass", Vec3::Zero(), kMinMass, kMaxMass);
  if (auto inertia = reader.object("inertia")) {
    sim.inertia_variation = inertia->number("variation", 0, 0, kMaxVariation);
    sim.inertia_length = inertia->number("length", sim.inertia_length, 1e-3, kMaxLength);
    inertia->finish();
  }
  sim.viscous = reader.vector("viscous", Vec3::Zero(), 0, kMaxDamping);
  read_friction(reader, sim);
  sim.gravity_bias = reader.vector("gravity_bias", Vec3::Zero(), -kMaxForce, kMaxForce);
  sim.gravity_gradient = read_gradient(reader, spec);
  if (auto cogging = reader.object("cogging")) {
    sim.cogging = cogging->vector("amplitude", Vec3::Zero(), 0, kMaxForce);
    sim.cogging_period = cogging->number("period", 0.005, kMinPeriod, kMaxLength);
    cogging->finish();
  }
  sim.workspace = read_workspace(reader, sim.workspace);
  read_structure(reader, sim);
  read_wrist(reader, sim);

  sim.position_resolution = reader.number("position_resolution", 0, 0, kMaxLength);
  if (auto noise = reader.object("noise")) {
    sim.position_noise = noise->number("position", 0, 0, kMaxLength);
    sim.force_noise = noise->number("force", 0, 0, kMaxForce);
    noise->finish();
  }
  sim.force_sensor = reader.boolean("force_sensor", false);
  sim.nominal_rate = reader.number("nominal_rate", sim.nominal_rate, 1, kMaxFrequency);

  sim.hand = read_hand(reader, spec, folder);
  check_held_axes(reader, sim);
  reader.finish();
  return sim;
}

SimSpec sim_spec_of(const PlantModel& plant, double max_force, double lag) {
  if (!(plant.mass.minCoeff<Eigen::PropagateNaN>() > 0))
    throw input_error("plant model: a simulated device needs a mass above zero in every axis");
  if (plant.gravity_gradient != plant.gravity_gradient.transpose())
    throw input_error("plant model: the gravity gradient is not symmetric, so the force would create energy");
  if (!(lag >= 0 && lag <= plant.delay))
    throw input_error(fmt::format("plant model: the motor's lag of {} s must be from 0 to the delay, which is {} s",
                                  lag, plant.delay));
  SimSpec sim;
  sim.max_force = sim.max_continuous_force = max_force;  // the model contains no motor heating
  sim.delay = plant.delay - lag;
  sim.actuator_bandwidth_hz = lag > 0 ? 1 / (2 * std::numbers::pi * lag) : 0;
  sim.mass = plant.mass;
  sim.viscous = plant.viscous;
  sim.coulomb = plant.coulomb;
  sim.gravity_bias = plant.gravity;
  sim.gravity_gradient = plant.gravity_gradient;
  sim.position_resolution = plant.position_resolution;
  sim.position_noise = plant.position_noise;
  return sim;
}

}  // namespace haptrace
