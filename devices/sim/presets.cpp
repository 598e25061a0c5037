#include "devices/sim/presets.h"

#include "base/error.h"
#include "base/suggest.h"

#include <algorithm>
#include <fmt/format.h>
#include <span>

namespace haptrace {
namespace {

struct Preset {
  const char* name;
  const char* json;  ///< with comments
};

// Presets without a continuous force have no source for it. A session then applies the cautious limit of
// control/limits.h, as it does for the real devices.
//
// The source of each number stands beside it:
//   CHAI3D     the device table of CHAI3D 3.3.0
//   H3D        the Falcon page of the H3DAPI wiki
//   libnifalcon  derived from the geometry in libnifalcon's headers
//   quoted     commonly quoted data sheet figures, not verified
//   estimate   our own: no source gives it, least of all for the dynamics
constexpr Preset kDevices[] = {
    {"reference", R"({
       // The nominal device of the project's own measurements: an unidentified 3-DOF device, gently held.
       "model": "reference device",
       "mass": 0.4, "viscous": 1.8,
       "coulomb": [0.7, 0.8, 0.6],
       "stribeck": {"static_ratio": 1.25, "velocity": 0.01},
       "presliding": {"distance": 8e-5},
       "gravity_bias": [0.5, -1.0, 1.0],  // 1.5 N
       "gravity_gradient": [-8, -8, 6],
       "cogging": {"amplitude": 0.06, "period": 0.006},
       "actuator_rotation": [0.3, -0.5, 0.4],
       "position_resolution": 5e-5, "force_resolution": 0.005,
       "delay_s": 0.001, "actuator_bandwidth_hz": 318.31,  // a lag of 0.5 ms
       "max_force": 8.9,
       "workspace": {"min": -0.1, "max": 0.1},
       "hand": "relaxed"
     })"},
    {"falcon", R"({
       "model": "Novint Falcon",
       "mass": 0.4, "viscous": 1.8, "coulomb": 0.7,           // estimate (effective 0.2 to 0.6 kg, 0.5 to 1 N)
       "stribeck": {"static_ratio": 1.25, "velocity": 0.01},  // estimate
       "presliding": {"distance": 8e-5},                      // estimate
       "actuator_rotation": [0.3, -0.5, 0.4],                 // estimate: its three arms, as if they were straight
       "position_resolution": 5e-5,                // libnifalcon: 0.017 to 0.075 mm; H3D: 0.064 mm
       "delay_s": 0.001,                           // estimate: one exchange over USB
       "actuator_bandwidth_hz": 320,               // estimate
       "max_force": 8.9,                           // H3D; CHAI3D allows 8 N
       "workspace": {"min": -0.0508, "max": 0.0508},  // H3D: 4 inches each way
       "nominal_rate": 1000                        // libnifalcon: the firmware's loop
     })"},
    {"touch", R"({
       "model": "3D Systems Touch or Phantom Omni",
       "mass": 0.045,                              // quoted: apparent at the tip
       "viscous": 0.2,                             // estimate
       "coulomb": 0.2,                             // quoted: backdrive friction below 0.26 N
       "presliding": {"distance": 1e-4},           // estimate
       "structural_mode": {"frequency_hz": 50, "damping_ratio": 0.1},  // estimate, from a quoted 1 to 2.3 N/mm
       "position_resolution": 5.5e-5,              // quoted: 450 dpi
       "delay_s": 0.001,                           // estimate
       "actuator_bandwidth_hz": 300,               // estimate
       "max_force": 3.3,                           // CHAI3D
       "max_continuous_force": 0.88,               // quoted
       "workspace": {"min": [-0.08, -0.06, -0.035], "max": [0.08, 0.06, 0.035]},  // quoted: 160 x 120 x 70 mm
       "nominal_rate": 1000                        // quoted
     })"},
    {"premium1.5", R"({
       "model": "Phantom Premium 1.5",
       "mass": 0.075,                              // quoted: apparent at the tip
       "viscous": 0.1,                             // estimate
       "coulomb": 0.04,                            // quoted: backdrive friction
       "presliding": {"distance": 5e-5},           // estimate
       "position_resolution": 3e-5,                // quoted
       "delay_s": 0.0005,                          // estimate
       "actuator_bandwidth_hz": 400,               // estimate
       "max_force": 8.5,                           // CHAI3D
       "max_continuous_force": 1.4,                // quoted
       // quoted: 381 x 267 x 191 mm
       "workspace": {"min": [-0.1905, -0.1335, -0.0955], "max": [0.1905, 0.1335, 0.0955]},
       "nominal_rate": 1000                        // quoted
     })"},
    {"omega3", R"({
       "model": "Force Dimension omega.3",
       "mass": 0.22, "viscous": 0.8, "coulomb": 0.15,  // estimate
       "presliding": {"distance": 3e-5},           // estimate
       "position_resolution": 1e-5,                // quoted: below 0.01 mm
       "delay_s": 0.00025,                         // estimate: one exchange at the nominal rate
       "actuator_bandwidth_hz": 500,               // estimate
       "max_force": 12,                            // CHAI3D
       "workspace": {"min": [-0.055, -0.08, -0.08], "max": [0.055, 0.08, 0.08]},  // quoted: 160 mm wide, 110 mm deep
       "nominal_rate": 4000                        // quoted
     })"},
    {"sigma7", R"({
       "model": "Force Dimension sigma.7",
       "mass": 0.3, "viscous": 1.0, "coulomb": 0.25,  // estimate
       "presliding": {"distance": 4e-5},           // estimate
       "position_resolution": 1e-5,                // estimate: that of the omega.3
       "delay_s": 0.00025,                         // estimate: one exchange at the nominal rate
       "actuator_bandwidth_hz": 400,               // estimate
       "max_force": 12,                            // CHAI3D
       "wrist": {
         "inertia": 5e-4, "viscous": 2e-3, "coulomb": 0.01,  // estimate
         "max_torque": 0.4,                        // estimate: 400 mN m
         "resolution": 2e-4                        // estimate: 0.013 degrees
       },
       "workspace": {"min": [-0.05, -0.075, -0.05], "max": [0.05, 0.075, 0.05]},  // CHAI3D: a radius of 75 mm
       "nominal_rate": 4000                        // quoted for the omega.3, taken over
     })"},
    {"delta3", R"({
       "model": "Force Dimension delta.3",
       "mass": 0.35, "viscous": 1.2, "coulomb": 0.3,  // estimate
       "presliding": {"distance": 5e-5},           // estimate
       "position_resolution": 2e-5,                // quoted: below 0.02 mm
       "delay_s": 0.00025,                         // estimate
       "actuator_bandwidth_hz": 400,               // estimate
       "max_force": 20,                            // CHAI3D
       "workspace": {"min": [-0.13, -0.2, -0.2], "max": [0.13, 0.2, 0.2]},  // quoted: 400 mm wide, 260 mm deep
       "nominal_rate": 4000                        // quoted for the omega.3, taken over
     })"},
    {"inverse3", R"({
       "model": "Haply Inverse3",
       "mass": 0.3, "viscous": 0.8, "coulomb": 0.4,  // estimate
       "presliding": {"distance": 6e-5},           // estimate
       "position_resolution": 3e-5,                // estimate
       "delay_s": 0.001,                           // estimate: through its service
       "actuator_bandwidth_hz": 300,               // estimate
       "max_force": 10, "max_continuous_force": 4,  // quoted
       "workspace": {"min": -0.1, "max": 0.1},     // estimate
       "nominal_rate": 1000                        // estimate
     })"},
    {"planar", R"({
       "model": "planar rehabilitation robot of the MIT-Manus class",
       "axes": "xy",
       "mass": 1.0,                                // quoted: 1.0 +- 0.33 kg
       "viscous": 2,                               // estimate
       "coulomb": 0.84,                            // quoted: 0.84 +- 0.28 N
       "presliding": {"distance": 2e-4},           // estimate
       "position_resolution": 1e-4,                // estimate
       "delay_s": 0.001,                           // estimate
       "actuator_bandwidth_hz": 200,               // estimate
       "max_force": 45,                            // quoted
       // quoted: 0.9 x 0.6 m. It cannot move in z; the 5 mm let flat paths in.
       "workspace": {"min": [-0.45, -0.3, -0.005], "max": [0.45, 0.3, 0.005]},
       "nominal_rate": 1000                        // estimate
     })"},
    {"haply2diy", R"({
       "model": "Haply 2DIY",
       "axes": "xy",
       "mass": 0.06, "viscous": 0.15, "coulomb": 0.05,  // estimate
       "presliding": {"distance": 1e-4},           // estimate
       "position_resolution": 9e-5,                // 4880 counts a turn on arms of 70 mm
       "delay_s": 0.001,                           // estimate: one exchange over USB
       "actuator_bandwidth_hz": 300,               // estimate
       "max_force": 1.6,                           // of 0.123 N m in every direction of this workspace
       // Within reach and stops of the gen3. It cannot move in z; the 5 mm let flat paths in.
       "workspace": {"min": [-0.035, -0.025, -0.005], "max": [0.035, 0.025, 0.005]},
       "nominal_rate": 1000                        // estimate
     })"},
    {"hapkit", R"({
       "model": "Hapkit",
       "axes": "x",
       "mass": 0.1, "viscous": 0.3, "coulomb": 0.1,  // estimate: at the handle
       "presliding": {"distance": 1e-4},           // estimate
       "position_resolution": 2.3e-5,              // 0.0148 degrees a count on 90 mm
       "delay_s": 0.001,                           // estimate: one exchange over a serial line
       "actuator_bandwidth_hz": 200,               // estimate
       "max_force": 4.9,                           // of a motor of 0.03 N m
       // It cannot move in y and z; the 5 mm let flat paths in.
       "workspace": {"min": [-0.045, -0.005, -0.005], "max": [0.045, 0.005, 0.005]},
       "nominal_rate": 1000                        // estimate
     })"},
    {"ideal", R"({
       // A mass and nothing else.
       "model": "ideal mass",
       "mass": 0.1, "max_force": 50, "max_continuous_force": 50,
       "workspace": {"min": -0.25, "max": 0.25}
     })"},
};

// Ranges: finger 4 to 10 g, 1 to 5 N s/m, 100 to 800 N/m; pen or pinch 0.02 to 0.15 kg, 1 to 8 N s/m, 100 to 1000 N/m;
// grip of the project's ensemble 0.05 to 0.3 kg, 2 to 10 N s/m, 200 to 2000 N/m before an arm of 5 to 200 N/m that
// relaxes in 0.3 to 2 s, 1 to 5 N s/m; whole arm 50 to 400 N/m relaxed, up to 1000 N/m co-contracted, 10 to 40 N s/m.
// The hands relaxed, loose and firm are also in control/design/lqg_search.h; a test compares them.
// The stiffness with which a hand follows its intent is an estimate within the range of the whole arm.
constexpr Preset kHands[] = {
    {"relaxed", R"({
       "mass": 0.15, "grip_stiffness": 800, "grip_damping": 4,
       "arm_stiffness": 40, "arm_relaxation_s": 0.5, "arm_damping": 2, "tremor": 0.04, "drift": 0.15,
       "intent_stiffness": 800, "intent_damping": 25,
       "turn_stiffness": 0.2, "turn_damping": 0.004
     })"},
    {"loose", R"({
       "mass": 0.05, "grip_stiffness": 200, "grip_damping": 2,
       "arm_stiffness": 5, "arm_relaxation_s": 0.3, "arm_damping": 1, "tremor": 0.04, "drift": 0.15,
       "intent_stiffness": 400, "intent_damping": 10,
       "turn_stiffness": 0.05, "turn_damping": 0.001
     })"},
    {"firm", R"({
       "mass": 0.3, "grip_stiffness": 2000, "grip_damping": 10,
       "arm_stiffness": 200, "arm_relaxation_s": 2, "arm_damping": 5, "tremor": 0.04, "drift": 0.15,
       "intent_stiffness": 1000, "intent_damping": 40,
       "turn_stiffness": 1, "turn_damping": 0.02
     })"},
    {"tense", R"({
       // Co-contracted: the arm keeps its place.
       "mass": 0.3, "grip_stiffness": 2000, "grip_damping": 10,
       "arm_stiffness": 1000, "arm_damping": 40, "tremor": 0.08, "drift": 0.3,
       "intent_stiffness": 1000, "intent_damping": 40,
       "turn_stiffness": 2, "turn_damping": 0.04
     })"},
    {"finger", R"({
       "mass": 0.007, "grip_stiffness": 400, "grip_damping": 3,
       "arm_stiffness": 40, "arm_relaxation_s": 0.5, "arm_damping": 2, "tremor": 0.02, "drift": 0.05,
       "intent_stiffness": 300, "intent_damping": 3,
       "turn_stiffness": 0.02, "turn_damping": 0.0005
     })"},
    {"pinch", R"({
       "mass": 0.08, "grip_stiffness": 500, "grip_damping": 4,
       "arm_stiffness": 40, "arm_relaxation_s": 0.5, "arm_damping": 2, "tremor": 0.04, "drift": 0.1,
       "intent_stiffness": 600, "intent_damping": 15,
       "turn_stiffness": 0.1, "turn_damping": 0.002
     })"},
    {"tremor", R"({
       // Pathological: the relaxed hand with a tremor of about a millimetre (estimate).
       "mass": 0.15, "grip_stiffness": 800, "grip_damping": 4,
       "arm_stiffness": 40, "arm_relaxation_s": 0.5, "arm_damping": 2, "tremor": 1.0, "drift": 0.3,
       "intent_stiffness": 800, "intent_damping": 25,
       "turn_stiffness": 0.2, "turn_damping": 0.004
     })"},
};

std::vector<std::string> preset_names(std::span<const Preset> presets, const char* also) {
  std::vector<std::string> names;
  for (const Preset& preset : presets) names.emplace_back(preset.name);
  names.emplace_back(also);
  return names;
}

nlohmann::json find(std::span<const Preset> presets, const std::string& name, const std::string& where,
                    const char* kind, const std::vector<std::string>& known) {
  const auto preset = std::find_if(presets.begin(), presets.end(), [&](const Preset& p) { return p.name == name; });
  if (preset == presets.end())
    throw input_error(fmt::format("{}: there is no {} preset '{}'{}", where, kind, name, suggestion(name, known)));
  return nlohmann::json::parse(preset->json, nullptr, true, true);
}

}  // namespace

nlohmann::json device_preset(const std::string& name, const std::string& where) {
  return find(kDevices, name == "omni" ? "touch" : name, where, "device", device_preset_names());
}

std::vector<std::string> device_preset_names() {
  return preset_names(kDevices, "omni");
}

nlohmann::json hand_preset(const std::string& name, const std::string& where) {
  return find(kHands, name, where, "hand", hand_preset_names());
}

std::vector<std::string> hand_preset_names() {
  return preset_names(kHands, "none");
}

}  // namespace haptrace
