#include "formats/documents/device_profile.h"

#include "base/error.h"
#include "base/json_digest.h"
#include "base/json_reader.h"
#include "base/output_file.h"
#include "base/rfc3339.h"

#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fmt/format.h>
#include <pwd.h>
#include <unistd.h>

namespace haptrace {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr const char* kProfileFormat = "haptrace-device-profile";
constexpr const char* kProfileVersion = "1.0";
constexpr double kSameFact = 1e-6;  // relative difference of equal facts

json rows_of(const Eigen::Matrix3d& matrix) {
  return {{"x", haptrace::json_of(matrix.row(0))},
          {"y", haptrace::json_of(matrix.row(1))},
          {"z", haptrace::json_of(matrix.row(2))}};
}

json json_of(const Cogging& cogging) {
  json waves = json::array();
  for (const CoggingWave& wave : cogging.waves)
    waves.push_back({{"wave_number_rad_per_m", haptrace::json_of(wave.wave_number)},
                     {"cosine_n", wave.cosine},
                     {"sine_n", wave.sine},
                     {"wave_number_half_width_rad_per_m", haptrace::json_of(wave.wave_number_half)},
                     {"amplitude_half_width_n", wave.amplitude_half}});
  return {{"centre_m", haptrace::json_of(cogging.centre)}, {"waves", std::move(waves)}};
}

json json_of(const PlantModel& plant) {
  json object{{"mass_kg", haptrace::json_of(plant.mass)},
              {"viscous_n_s_per_m", haptrace::json_of(plant.viscous)},
              {"coulomb_n", haptrace::json_of(plant.coulomb)},
              {"gravity_n", haptrace::json_of(plant.gravity)},
              {"gravity_gradient_n_per_m", rows_of(plant.gravity_gradient)},
              {"delay_s", plant.delay},
              {"position_resolution_m", plant.position_resolution},
              {"position_noise_m", plant.position_noise}};
  if (plant.actuators)
    object["actuators"] = {{"axes", rows_of(plant.actuators->axes)},
                           {"coulomb_n", haptrace::json_of(plant.actuators->coulomb)},
                           {"axes_half_width_rad", plant.actuators->angle_half},
                           {"coulomb_half_width_n", haptrace::json_of(plant.actuators->coulomb_half)}};
  if (plant.cogging) object["cogging"] = json_of(*plant.cogging);
  if (plant.motor_limit > 0) object["motor_limit_n"] = plant.motor_limit;
  return object;
}

json json_of(const LawVerdict& verdict) {
  json json{{"tried", verdict.tried}, {"improvement", verdict.improvement}, {"refused", verdict.refused}};
  if (!verdict.since.empty()) json["refused_since"] = verdict.since;
  if (verdict.force > 0) json["force_n"] = verdict.force;
  return json;
}

json json_of(const TrackingDesign& design) {
  return {{"kp", haptrace::json_of(design.gains.kp)},
          {"kd", haptrace::json_of(design.gains.kd)},
          {"largest_kp", haptrace::json_of(design.largest.kp)},
          {"largest_kd", haptrace::json_of(design.largest.kd)},
          {"plain_kp", haptrace::json_of(design.plain.kp)},
          {"plain_kd", haptrace::json_of(design.plain.kd)},
          {"mass_kg", haptrace::json_of(design.mass)},
          {"delay_s", design.delay},
          {"observer_hz", design.observer_hz},
          {"load_hz", design.load_hz},
          {"authority_n", design.authority},
          {"ripple_n", design.ripple},
          {"trial", json_of(design.verdict)},
          {"plain_calm", design.plain_calm},
          {"stiff_error", design.stiff_error},
          {"stiff_ripple_n", design.stiff_ripple},
          {"plain_bare", design.plain_bare},
          {"tremor_answer_n", design.tremor}};
}

/// A JsonReader of which all keys are required.
class Required {
 public:
  explicit Required(JsonReader& reader) : reader_(reader) {}

  double number(const char* key, double min, double max) { return need(key).number(key, 0, min, max); }
  Vec3 vector(const char* key, double min, double max) { return need(key).vector(key, Vec3::Zero(), min, max); }
  std::string text(const char* key) { return need(key).text(key, ""); }
  bool boolean(const char* key) { return need(key).boolean(key, false); }
  JsonReader object(const char* key) { return *need(key).object(key); }

 private:
  JsonReader& need(const char* key) { return reader_.require(key); }
  JsonReader& reader_;
};

// Far beyond any device that a hand can hold.
constexpr double kLargest = 1e6;
constexpr const char* kAgain = "calibrate again (haptrace calibrate)";
constexpr double kMostLead = 5e-3;  // of a delay that noise made negative [s]
constexpr double kMostDelay = 0.1;  // with more, nothing follows a hand [s]
constexpr double kLeastKnown = 1;   // half width of a delay of which nothing is known [s]

Eigen::Matrix3d matrix_from(JsonReader reader, double most = kLargest) {
  Required rows(reader);
  Eigen::Matrix3d matrix;
  for (int row = 0; row < 3; ++row)
    matrix.row(row) = rows.vector(std::string(1, "xyz"[row]).c_str(), -most, most).transpose();
  reader.finish();
  return matrix;
}

ActuatorFriction actuators_from(JsonReader reader) {
  constexpr double kOrthonormal = 1e-6;
  Required required(reader);
  ActuatorFriction actuators;
  actuators.axes = matrix_from(required.object("axes"), 1);
  if (const Eigen::Matrix3d& r = actuators.axes; !(r * r.transpose()).isIdentity(kOrthonormal))
    throw input_error(fmt::format("{}: axes: the rows must be unit vectors at right angles", reader.where()));
  actuators.coulomb = required.vector("coulomb_n", 0, kLargest);
  actuators.angle_half = required.number("axes_half_width_rad", 0, kLargest);
  actuators.coulomb_half = required.vector("coulomb_half_width_n", 0, kLargest);
  reader.finish();
  return actuators;
}

Cogging cogging_from(JsonReader reader) {
  constexpr std::size_t kMostWaves = 16;     // more than a calibration finds
  constexpr double kLeastWaveNumber = 1e-3;  // [rad/m]
  Required required(reader);
  Cogging cogging{.centre = required.vector("centre_m", -kLargest, kLargest), .waves = {}};
  std::vector<JsonReader> waves = reader.require("waves").objects("waves");
  if (waves.empty() || waves.size() > kMostWaves)
    throw input_error(fmt::format("{}: waves: expected 1 to {} waves", reader.where(), kMostWaves));
  for (JsonReader& object : waves) {
    Required of_wave(object);
    CoggingWave wave{.wave_number = of_wave.vector("wave_number_rad_per_m", -kLargest, kLargest),
                     .cosine = of_wave.number("cosine_n", -kLargest, kLargest),
                     .sine = of_wave.number("sine_n", -kLargest, kLargest),
                     .wave_number_half = of_wave.vector("wave_number_half_width_rad_per_m", 0, kLargest),
                     .amplitude_half = of_wave.number("amplitude_half_width_n", 0, kLargest)};
    if (!(wave.wave_number.norm() >= kLeastWaveNumber))
      throw input_error(fmt::format("{}: wave_number_rad_per_m: must not be zero", object.where()));
    object.finish();
    cogging.waves.push_back(wave);
  }
  reader.finish();
  return cogging;
}

PlantModel plant_from(JsonReader reader, double most_delay = kMostDelay) {
  Required required(reader);
  PlantModel plant;
  plant.mass = required.vector("mass_kg", 0, kLargest);
  plant.viscous = required.vector("viscous_n_s_per_m", 0, kLargest);
  plant.coulomb = required.vector("coulomb_n", 0, kLargest);
  plant.gravity = required.vector("gravity_n", -kLargest, kLargest);
  plant.gravity_gradient = matrix_from(required.object("gravity_gradient_n_per_m"));
  plant.delay = required.number("delay_s", -kMostLead, most_delay);
  plant.position_resolution = required.number("position_resolution_m", 0, 1);
  plant.position_noise = required.number("position_noise_m", 0, 1);
  if (auto actuators = reader.object("actuators")) plant.actuators = actuators_from(std::move(*actuators));
  if (auto cogging = reader.object("cogging")) plant.cogging = cogging_from(std::move(*cogging));
  plant.motor_limit = reader.number("motor_limit_n", 0, 0, kLargest);
  reader.finish();
  return plant;
}

/// Reads a time as text.
std::string time_from(Required& required, const char* key, const std::string& where) {
  std::string time = required.text(key);
  if (!parse_rfc3339(time))
    throw input_error(fmt::format("{}: {}: expected a time as 2026-01-31T12:00:00Z, found '{}'", where, key, time));
  return time;
}

LawVerdict verdict_from(JsonReader reader) {
  Required required(reader);
  LawVerdict verdict{.tried = required.boolean("tried"),
                     .improvement = required.number("improvement", 0, kLargest),
                     .refused = required.text("refused")};
  if (reader.has("refused_since")) verdict.since = time_from(required, "refused_since", reader.where());
  verdict.force = reader.number("force_n", 0, 0, kLargest);
  reader.finish();
  return verdict;
}

TrackingDesign design_from(JsonReader reader, double rate_hz) {
  Required required(reader);
  TrackingDesign design;
  design.gains = {required.vector("kp", 0, kLargestKp), required.vector("kd", 0, kLargestKd)};
  design.largest = {required.vector("largest_kp", 0, kLargestKp), required.vector("largest_kd", 0, kLargestKd)};
  design.plain = {required.vector("plain_kp", 0, kLargestKp), required.vector("plain_kd", 0, kLargestKd)};
  design.mass = required.vector("mass_kg", 0, kLargest);
  design.delay = required.number("delay_s", -kMostLead, kMostDelay);
  design.observer_hz = required.number("observer_hz", 0, rate_hz / 2);
  design.load_hz = required.number("load_hz", 0, rate_hz / 2);
  design.authority = required.number("authority_n", 0, kLargest);
  design.ripple = required.number("ripple_n", 0, kLargest);
  if (auto trial = reader.object("trial")) design.verdict = verdict_from(*trial);
  design.plain_calm = reader.boolean("plain_calm", false);
  design.stiff_error = reader.number("stiff_error", 0, 0, kLargest);
  design.stiff_ripple = reader.number("stiff_ripple_n", 0, 0, kLargest);
  design.plain_bare = reader.boolean("plain_bare", false);
  design.tremor = reader.number("tremor_answer_n", 0, 0, kLargest);
  reader.finish();
  return design;
}

/// The numbers of a HeldModel per axis, which its JSON groups by the body that they belong to.
struct HeldKeys {
  using Get = double& (*)(HeldModel&, std::size_t axis);
  struct Key {
    const char *body, *name;
    Get get;
  };
  static constexpr std::array<Key, 11> kKeys{{
      {"device", "mass_kg",
       [](HeldModel& m, std::size_t i) -> double& { return m.mass[static_cast<Eigen::Index>(i)]; }},
      {"device", "viscous_n_s_per_m",
       [](HeldModel& m, std::size_t i) -> double& { return m.viscous[static_cast<Eigen::Index>(i)]; }},
      {"link", "mass_kg", [](HeldModel& m, std::size_t i) -> double& { return m.link[i].mass; }},
      {"link", "stiffness_n_per_m", [](HeldModel& m, std::size_t i) -> double& { return m.link[i].stiffness; }},
      {"link", "damping_n_s_per_m", [](HeldModel& m, std::size_t i) -> double& { return m.link[i].damping; }},
      {"hand", "mass_kg", [](HeldModel& m, std::size_t i) -> double& { return m.hand[i].mass; }},
      {"hand", "grip_stiffness_n_per_m",
       [](HeldModel& m, std::size_t i) -> double& { return m.hand[i].grip_stiffness; }},
      {"hand", "grip_damping_n_s_per_m", [](HeldModel& m, std::size_t i) -> double& { return m.hand[i].grip_damping; }},
      {"hand", "arm_stiffness_n_per_m", [](HeldModel& m, std::size_t i) -> double& { return m.hand[i].arm_stiffness; }},
      {"hand", "arm_damping_n_s_per_m", [](HeldModel& m, std::size_t i) -> double& { return m.hand[i].arm_damping; }},
      {"hand", "arm_relaxation_s", [](HeldModel& m, std::size_t i) -> double& { return m.hand[i].arm_relaxation_s; }},
  }};
};

json json_of(HeldModel held) {
  json object{{"delay_s", held.delay},
              {"lag_s", held.lag},
              {"noise",
               {{"drift_n", held.noise.drift},
                {"drift_hz", held.noise.drift_hz},
                {"tremor_n", held.noise.tremor},
                {"tremor_hz", held.noise.tremor_hz}}}};
  for (const HeldKeys::Key& key : HeldKeys::kKeys) {
    json& values = object[key.body][key.name] = json::array();
    for (std::size_t axis = 0; axis < 3; ++axis) values.push_back(key.get(held, axis));
  }
  return object;
}

constexpr double kStrongestTremor = 10;                    // [N]
constexpr double kSlowestTremor = 1, kFastestTremor = 20;  // [Hz]

HeldModel held_from(JsonReader reader, double most_delay = kMostDelay) {
  Required required(reader);
  HeldModel held;
  held.delay = required.number("delay_s", 0, most_delay);
  held.lag = required.number("lag_s", 0, most_delay);
  JsonReader noise = required.object("noise");
  Required of_noise(noise);
  held.noise = {.drift = of_noise.number("drift_n", 0, kLargest),
                .drift_hz = of_noise.number("drift_hz", 0, kLargest),
                .tremor = of_noise.number("tremor_n", 0, kStrongestTremor),
                .tremor_hz = of_noise.number("tremor_hz", 0, kFastestTremor)};
  noise.finish();
  for (const char* body : {"device", "link", "hand"}) {
    JsonReader object = required.object(body);
    Required of_body(object);
    for (const HeldKeys::Key& key : HeldKeys::kKeys) {
      if (std::string_view(key.body) != body) continue;
      const Vec3 values = of_body.vector(key.name, 0, kLargest);
      for (std::size_t axis = 0; axis < 3; ++axis) key.get(held, axis) = values[static_cast<Eigen::Index>(axis)];
    }
    object.finish();
  }
  reader.finish();
  return held;
}

struct NumberKey {
  const char* name = nullptr;
  double LqgNumbers::*number = nullptr;
  double least = 1e-30, most = kLargest;
};
constexpr std::array<NumberKey, 6> kNumberKeys{{{"drift_n", &LqgNumbers::drift},
                                                {"drift_hz", &LqgNumbers::drift_hz},
                                                {"force_noise_n_sqrt_s", &LqgNumbers::force_noise},
                                                {"ripple_weight_m2_per_n2", &LqgNumbers::ripple_weight},
                                                {"mass_factor", &LqgNumbers::mass_factor, 0.1, 10},
                                                {"hand_share", &LqgNumbers::hand_share, 1e-3, 10}}};

json json_of(const LqgDesign& design) {
  json object{{"error_m", design.figures.error},
              {"ripple_n", design.figures.ripple},
              {"unmet", design.unmet},
              {"trial", json_of(design.verdict)}};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    json& numbers = object[std::string(1, "xyz"[axis])];
    if (!design.numbers[axis]) continue;
    for (const NumberKey& key : kNumberKeys) numbers[key.name] = *design.numbers[axis].*key.number;
  }
  return object;
}

LqgDesign lqg_design_from(JsonReader reader) {
  Required required(reader);
  LqgDesign design;
  design.figures = {.error = required.number("error_m", 0, kLargest),
                    .ripple = required.number("ripple_n", 0, kLargest)};
  design.verdict = verdict_from(required.object("trial"));
  for (const json& unmet : reader.require("unmet").value("unmet")) {
    if (!unmet.is_string()) throw input_error(fmt::format("{}: unmet: expected texts", reader.where()));
    design.unmet.push_back(unmet.get<std::string>());
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::string name(1, "xyz"[axis]);
    if (!reader.has(name) || reader.value(name).is_null()) continue;
    JsonReader object = required.object(name.c_str());
    Required of_axis(object);
    LqgNumbers& numbers = design.numbers[axis].emplace();
    for (const NumberKey& key : kNumberKeys) numbers.*key.number = of_axis.number(key.name, key.least, key.most);
    object.finish();
  }
  reader.finish();
  return design;
}

json json_of(const InertiaMap& map) {
  return {{"centre_m", haptrace::json_of(map.centre)}, {"reach_m", haptrace::json_of(map.reach)},
          {"slope_per_m", rows_of(map.slope)},         {"bend_per_m2", rows_of(map.bend)},
          {"curve_per_m2", rows_of(map.curve)},        {"least", haptrace::json_of(map.least)},
          {"most", haptrace::json_of(map.most)}};
}

InertiaMap inertia_from(JsonReader reader) {
  constexpr double kLeast = 0.01;
  Required required(reader);
  InertiaMap map;
  map.centre = required.vector("centre_m", -kLargest, kLargest);
  map.reach = required.vector("reach_m", 0, kLargest);
  map.slope = matrix_from(required.object("slope_per_m"));
  map.bend = matrix_from(required.object("bend_per_m2"));
  if (auto curve = reader.object("curve_per_m2")) map.curve = matrix_from(*curve);
  map.least = required.vector("least", kLeast, 1);
  map.most = required.vector("most", 1, kLargest);
  reader.finish();
  return map;
}

json json_of(const HeldDevice& held) {
  json object{
      {"model", json_of(held.model)}, {"half_width", json_of(held.half_width)},  {"hand_is", to_string(held.hand)},
      {"evidence", held.margin},      {"position_noise_m", held.position_noise}, {"ripple_n", held.ripple}};
  if (held.inertia) object["inertia"] = json_of(*held.inertia);
  if (held.designed_for != Vec3::Ones()) object["designed_for"] = haptrace::json_of(held.designed_for);
  object["one_mass"] = held.one_mass;
  for (const Firmness firmness : kFirmnesses) object["laws"][to_string(firmness)] = json_of(held.design(firmness));
  return object;
}

/// Older profiles kept here what `design` holds now: it is moved there.
HeldDevice held_device_from(JsonReader reader, TrackingDesign& design) {
  Required required(reader);
  HeldDevice held;
  held.model = held_from(required.object("model"));
  if (const HandNoise& noise = held.model.noise; noise.tremor > 0 && noise.tremor_hz < kSlowestTremor)
    throw input_error(fmt::format("{}: model: noise: tremor_hz is {}; with a tremor it must be from {} to {} Hz",
                                  reader.where(), noise.tremor_hz, kSlowestTremor, kFastestTremor));
  held.half_width = held_from(required.object("half_width"), kLeastKnown);
  held.hand = parse_hand_known(required.text("hand_is"));
  held.margin = required.number("evidence", -1e300, 1e300);
  held.position_noise = required.number("position_noise_m", 0, 1);
  held.ripple = required.number("ripple_n", 0, kLargest);
  if (const auto inertia = reader.object("inertia")) held.inertia = inertia_from(*inertia);
  held.designed_for = reader.vector("designed_for", held.designed_for, 0.01, 100);
  held.one_mass = required.boolean("one_mass");
  if (auto trial = reader.object("observer_trial")) design.verdict = verdict_from(*trial);
  design.plain_calm = reader.boolean("plain_calm", design.plain_calm);
  JsonReader laws = required.object("laws");
  Required of_laws(laws);
  for (const Firmness firmness : kFirmnesses)
    held.design(firmness) = lqg_design_from(of_laws.object(to_string(firmness)));
  laws.finish();
  reader.finish();
  return held;
}

/// Returns a name with only characters that every file system accepts.
std::string safe(const std::string& name) {
  std::string result;
  for (const char c : name.substr(0, 40)) {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-';
    result += plain ? c : '_';
  }
  return result;
}

/// Returns FNV-1a of the parts and their ends.
std::uint32_t hash(const DeviceIdentity& device) {
  std::uint32_t value = 2166136261;
  for (const std::string* part : {&device.backend, &device.model, &device.serial}) {
    for (const char c : *part) value = (value ^ static_cast<unsigned char>(c)) * 16777619;
    value = (value ^ 0x100U) * 16777619;
  }
  return value;
}

/// Returns this user's home from the system's list of users; empty if there is none.
std::string home_of_user() {
  std::array<char, 4096> buffer{};
  passwd entry{};
  passwd* found = nullptr;
  if (getpwuid_r(getuid(), &entry, buffer.data(), buffer.size(), &found) != 0 || found == nullptr) return {};
  return entry.pw_dir != nullptr ? entry.pw_dir : "";
}

std::string environment(const char* name) {
  const char* value = std::getenv(name);
  return value != nullptr ? value : "";
}

bool same(double a, double b) {
  return std::abs(a - b) <= kSameFact * std::max(std::abs(a), std::abs(b));
}

bool same(const Vec3& a, const Vec3& b) {
  return same(a.x(), b.x()) && same(a.y(), b.y()) && same(a.z(), b.z());
}

std::string name_of(const DeviceIdentity& device) {
  return fmt::format("{} {}{}", device.backend, device.model.empty() ? "device" : device.model,
                     device.serial.empty() ? "" : ", serial " + device.serial);
}

}  // namespace

std::string device_in_words(const DeviceIdentity& device) {
  if (device.model.empty()) return "a device without a name";
  return device.serial.empty() ? device.model : fmt::format("{} {}", device.model, device.serial);
}

json to_json(const DeviceProfile& profile) {
  json object{{"format", kProfileFormat},
              {"format_version", kProfileVersion},
              {"created", profile.created},
              {"software", profile.software},
              {"device",
               {{"backend", profile.device.backend},
                {"model", profile.device.model},
                {"serial", profile.device.serial},
                {"max_force_n", profile.facts.max_force},
                {"position_resolution_m", profile.facts.position_resolution},
                {"workspace_min_m", haptrace::json_of(profile.facts.workspace.min)},
                {"workspace_max_m", haptrace::json_of(profile.facts.workspace.max)}}},
              {"rate_hz", profile.rate_hz},
              {"plant", json_of(profile.plant)},
              {"half_width", json_of(profile.half_width)},
              {"line_residual", profile.line_residual},
              {"sweep_residual_n", profile.sweep_residual},
              {"fits", profile.fits},
              {"reason", profile.reason},
              {"design", json_of(profile.design)}};
  if (profile.coarse) object["coarse"] = true;
  if (profile.held) object["held"] = json_of(*profile.held);
  return object;
}

DeviceProfile profile_from_json(const json& object, const std::string& where) {
  JsonReader reader(object, where);
  Required required(reader);
  if (const std::string format = required.text("format"); format != kProfileFormat)
    throw input_error(
        fmt::format("{}: is not a device profile: its format is '{}', not '{}'", where, format, kProfileFormat));
  if (const std::string version = required.text("format_version"); version != kProfileVersion)
    throw input_error(
        fmt::format("{}: has format version '{}', but this program reads {}; calibrate again (haptrace calibrate)",
                    where, version, kProfileVersion));
  DeviceProfile profile;
  profile.created = time_from(required, "created", where);
  profile.software = required.text("software");
  JsonReader device = required.object("device");
  Required facts(device);
  profile.device = {facts.text("backend"), facts.text("model"), facts.text("serial")};
  profile.facts = {.max_force = facts.number("max_force_n", 0, kLargest),
                   .position_resolution = facts.number("position_resolution_m", 0, 1),
                   .workspace = {facts.vector("workspace_min_m", -kLargest, kLargest),
                                 facts.vector("workspace_max_m", -kLargest, kLargest)}};
  device.finish();
  profile.rate_hz = required.number("rate_hz", 1, kLargest);
  profile.plant = plant_from(required.object("plant"));
  profile.half_width = plant_from(required.object("half_width"), kLeastKnown);
  profile.line_residual = required.number("line_residual", 0, kLargest);
  profile.sweep_residual = required.number("sweep_residual_n", 0, kLargest);
  profile.fits = required.boolean("fits");
  profile.coarse = reader.boolean("coarse", false);
  profile.reason = required.text("reason");
  profile.design = design_from(required.object("design"), profile.rate_hz);
  if (const auto held = reader.object("held")) profile.held = held_device_from(*held, profile.design);
  reader.finish();
  return profile;
}

DeviceDynamics DeviceDynamics::of(const DeviceProfile& profile) {
  DeviceDynamics dynamics{.created = profile.created, .plant = profile.plant, .inertia = {}};
  if (!profile.held) return dynamics;
  dynamics.inertia = profile.held->inertia;
  dynamics.in_a_hand = profile.held->hand == HandKnown::identified;
  return dynamics;
}

json to_json(const DeviceDynamics& dynamics) {
  json object{{"created", dynamics.created}, {"plant", json_of(dynamics.plant)}, {"in_a_hand", dynamics.in_a_hand}};
  if (dynamics.inertia) object["inertia"] = json_of(*dynamics.inertia);
  return object;
}

DeviceDynamics dynamics_from_json(const json& object, const std::string& where) {
  JsonReader reader(object, where);
  Required required(reader);
  DeviceDynamics dynamics{.created = time_from(required, "created", where),
                          .plant = plant_from(required.object("plant")),
                          .inertia = {},
                          .in_a_hand = required.boolean("in_a_hand")};
  if (const auto inertia = reader.object("inertia")) dynamics.inertia = inertia_from(*inertia);
  reader.finish();
  return dynamics;
}

DeviceProfile load_profile(const std::string& file) {
  return profile_from_json(without_digest(load_json(file), file, kAgain), file);
}

void save_profile(const DeviceProfile& profile, const std::string& file, bool overwrite) {
  const fs::path parent = fs::path(file).parent_path();
  if (!parent.empty() && parent == fs::path(profile_folder())) {
    std::error_code error;
    fs::create_directories(parent, error);
    if (error) throw input_error(fmt::format("{}: cannot be created: {}", parent.string(), error.message()));
  }
  save_json(with_digest(to_json(profile)), file, overwrite);
}

void check_profile_output(const std::string& file, bool overwrite) {
  const fs::path parent = fs::path(file).parent_path();
  if (!parent.empty() && parent == fs::path(profile_folder()))
    check_output_in_new_folders(file, overwrite);
  else
    check_output(file, overwrite);
}

std::string profile_folder() {
  if (const std::string own = environment("HAPTRACE_PROFILES"); !own.empty())
    return fs::path(own).lexically_normal().string();
  // The XDG Base Directory Specification requires programs to ignore relative paths.
  if (const fs::path data = environment("XDG_DATA_HOME"); data.is_absolute())
    return (data / "haptrace" / "profiles").string();
  fs::path home = environment("HOME");
  if (!home.is_absolute()) home = home_of_user();
  if (!home.is_absolute())
    throw input_error(
        "no folder for device profiles: neither HOME nor the system's list of users names the home folder of this "
        "user; set HOME or HAPTRACE_PROFILES");
  return (home / ".local/share/haptrace/profiles").string();
}

std::string profile_name(const DeviceIdentity& device) {
  return fmt::format("{}-{}-{}-{:08x}.json", safe(device.backend), safe(device.model), safe(device.serial),
                     hash(device));
}

std::string profile_file(const DeviceIdentity& device) {
  return (fs::path(profile_folder()) / profile_name(device)).string();
}

std::optional<DeviceProfile> find_profile(const DeviceIdentity& device) {
  const std::string file = profile_file(device);
  std::error_code error;
  if (!fs::exists(file, error)) return std::nullopt;
  return load_profile(file);
}

namespace {

/// Returns what of the model takes more force than the device has; empty if nothing does, or if that is not known.
/// Feedforward is not watched for vibration, so no force of the model may be beyond the device.
std::string beyond(const DeviceProfile& profile) {
  const PlantModel& plant = profile.plant;
  const double most = profile.facts.max_force;
  if (!(most > 0)) return "";
  // Less than any movement has: a model that takes more for it is not of a device that moved.
  constexpr double kAcceleration = 0.5, kSpeed = 0.1, kWay = 0.01;  // [m/s^2], [m/s], [m]
  Vec3 mass = plant.mass;                                           // where it is largest
  if (profile.held && profile.held->inertia) mass = mass.cwiseProduct(profile.held->inertia->range().second);
  double cogging = 0;
  if (plant.cogging)
    for (const CoggingWave& wave : plant.cogging->waves) cogging += wave.amplitude();
  const double friction = std::max(plant.coulomb.maxCoeff(), plant.actuators ? plant.actuators->coulomb.maxCoeff() : 0);
  const struct {
    const char* what;
    double force;  // [N]
  } parts[] = {{"cogging", cogging},
               {"friction", friction},
               {"gravity", plant.gravity.norm()},
               {"change of gravity within 10 mm", kWay * plant.gravity_gradient.cwiseAbs().maxCoeff()},
               {"damping at 0.1 m/s", kSpeed * plant.viscous.maxCoeff()},
               {"inertia at 0.5 m/s^2", kAcceleration * mass.maxCoeff()}};
  for (const auto& part : parts)
    if (part.force > most)
      return fmt::format("{} of {:.1f} N is beyond the device's {:.1f} N", part.what, part.force, most);
  return "";
}

}  // namespace

std::string check_profile(const DeviceProfile& profile, const DeviceIdentity& device, const DeviceFacts& facts,
                          double rate_hz, std::chrono::system_clock::time_point now) {
  if (profile.device != device)
    return fmt::format("the profile belongs to another device: {}, and this is {}", name_of(profile.device),
                       name_of(device));
  if (!profile.fits) return fmt::format("the profile's model does not fit the device ({}); {}", profile.reason, kAgain);
  if (std::abs(rate_hz - profile.rate_hz) > kProfileRateTolerance * profile.rate_hz)
    return fmt::format("the profile is for a servo rate of {:g} Hz, but the rate is {:g} Hz; {} at this rate",
                       profile.rate_hz, rate_hz, kAgain);
  const auto changed = [&](const char* what) {
    return fmt::format("the device's {} changed since the profile was made; {}", what, kAgain);
  };
  if (!same(profile.facts.max_force, facts.max_force)) return changed("largest force");
  if (!same(profile.facts.position_resolution, facts.position_resolution)) return changed("position resolution");
  if (!same(profile.facts.workspace.min, facts.workspace.min) ||
      !same(profile.facts.workspace.max, facts.workspace.max))
    return changed("workspace");
  const auto made = parse_rfc3339(profile.created);
  const double age = made ? std::chrono::duration<double>(now - *made).count() : kNaN;
  constexpr double kClocksDiffer = 2 * 86400;  // [s]
  if (age < -kClocksDiffer)
    return fmt::format("the profile is from {}, which is in the future: check the clock, or {}", profile.created,
                       kAgain);
  if (const std::string excess = beyond(profile); !excess.empty())
    return fmt::format("the profile's {}; {}", excess, kAgain);
  if (!(age <= kProfileLifetime))
    return fmt::format("the profile is {:.0f} days old, but it is valid for {:.0f} days only; {}", age / 86400,
                       kProfileLifetime / 86400, kAgain);
  return "";
}

}  // namespace haptrace
