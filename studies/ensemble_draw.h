// Random devices and hands for testing a controller on dynamics that it was not designed for.
#pragma once

#include "devices/sim/noise.h"
#include "devices/sim/spec.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace haptrace {

/// Ranges of the draws: small desktop devices like the Falcon, held gently to firmly. Values are uniform between low
/// and high unless stated otherwise.
namespace ensemble {

struct Range {
  double low, high;
};

// Mechanism. We know of no published identification of such devices. All values are our own estimates, close to the
// Falcon's.
inline constexpr Range kMass{0.2, 0.65};                       // [kg]
inline constexpr Range kViscous{1, 3};                         // [N s/m]
inline constexpr Range kCoulomb{0.3, 1.1};                     // [N]
inline constexpr Range kOfAxis{0.85, 1.15};                    // factor on the three above, for each actuator axis
inline constexpr Range kStaticRatio{1.1, 1.4};                 // static over sliding friction
inline constexpr Range kStribeckVelocity{6e-3, 20e-3};         // [m/s]
inline constexpr Range kPreslidingDistance{0.05e-3, 0.12e-3};  // sliding friction over the LuGre model's stiffness [m]
inline constexpr Range kCogging{0, 0.1};                       // [N]
inline constexpr Range kCoggingPeriod{4e-3, 10e-3};            // [m]
inline constexpr Range kGravity{1.2, 1.6};                     // uncompensated gravity, in any direction [N]
inline constexpr Range kGravityGradient{-10, 10};              // gradient of each axis of W along itself [N/m]
inline constexpr Range kRotation{0, 3};  // rotation of the actuator axes, about any direction [rad]

// Sensors, motors and delays: the Falcon's stated 8.9 N (H3DAPI), its encoders' 0.02 to 0.08 mm in space (from the
// geometry in libnifalcon), and our estimate of the delays of a USB device at 1 kHz.
inline constexpr Range kDelay{0.3e-3, 2e-3};          // [s]
inline constexpr Range kActuatorLag{0.2e-3, 0.9e-3};  // time constant [s]
inline constexpr double kPositionResolution = 5e-5;   // [m]
inline constexpr double kForceResolution = 5e-3;      // [N]
inline constexpr double kMaxForce = 8.9;              // [N]
inline constexpr double kReach = 0.1;                 // extent of the workspace from the origin, per axis [m]

// Hand: fingers (Hajian and Howe 1997), a pinch (Hasser and Cutkosky 2002), up to the hand's own mass. The arm behind
// it (Mussa-Ivaldi, Hogan and Bizzi 1985; Gomi and Kawato 1997) yields to a slow movement, like an arm that moves
// along. Tremor and drift are our estimates for healthy hands.
inline constexpr double kNobody = 0.1;             // share of free devices without a hand
inline constexpr Range kHandMass{0.05, 0.3};       // [kg]
inline constexpr Range kGripStiffness{200, 2000};  // uniform on a logarithmic scale [N/m]
inline constexpr Range kGripDamping{2, 10};        // [N s/m]
inline constexpr Range kArmStiffness{5, 200};      // [N/m]
inline constexpr Range kArmRelaxation{0.3, 2};     // [s]
inline constexpr Range kArmDamping{1, 5};          // [N s/m]
inline constexpr double kTremor = 0.04;            // rms per axis [N]
inline constexpr double kDrift = 0.15;             // rms per axis [N]

// All hard kinds: the force acts later, and the noise of the hand reaches into the band of a disturbance observer.
inline constexpr Range kLateDelay{1e-3, 2.4e-3};  // [s]
inline constexpr double kLateLag = 0.5e-3;        // [s]
inline constexpr double kHardDriftHz = 0.7;       // corner of first order [Hz]
inline constexpr double kHardTremorHz = 8.5;      // [Hz]

// The property that each hard kind is named after.
inline constexpr double kInertiaLength = 0.06;     // from the largest mass to the smallest [m]
inline constexpr double kCable = 1;                // force of the cables [N]
inline constexpr double kCablePeriod = 3e-3;       // [m]
inline constexpr double kBacklash = 0.2e-3;        // between the encoders and the handle [m]
inline constexpr double kBacklashLinkHz = 150;     // of the link that has it: nearly rigid [Hz]
inline constexpr Range kLinkHz{45, 75};            // of a flexible link [Hz]
inline constexpr Range kLinkDamping{0.03, 0.1};    // damping ratio
inline constexpr Range kHandleFraction{0.3, 0.5};  // of the mass
inline constexpr Range kMotorLimit{3, 5};          // silent [N]
inline constexpr double kStrongTremorHz = 10;      // [Hz]

}  // namespace ensemble

/// Kinds of devices and hands. Draws of one seed and index are alike except for what distinguishes their kinds.
enum class EnsembleKind : std::uint8_t {
  small,             ///< the ranges of namespace ensemble, and nothing else
  late,              ///< what all kinds from here on have: see ensemble::kLateDelay. Somebody always holds them
  delay_2,           ///< a delay of exactly 2 ms, beside the lag
  delay_3,           ///< 3 ms
  delay_4,           ///< 4 ms
  inertia_50,        ///< the mass varies by +-50 % over the workspace and is largest in the middle
  inertia_70,        ///< +-70 %
  inertia_50_delay,  ///< +-50 %, and 3 ms
  cables,            ///< a force that is locked to the place
  backlash,          ///< between the encoders and the handle
  link,              ///< half of the mass swings behind a flexible link
  saturation,        ///< motors that saturate below the stated force
  tremor_half,       ///< a tremor of 0.5 N
  tremor_one,        ///< 1 N
  everything,        ///< inertia_50_delay, cables and backlash
};
inline constexpr std::size_t kEnsembleKinds = 15;
const char* to_string(EnsembleKind kind) noexcept;
/// Throws Error(input) with a suggestion.
EnsembleKind parse_ensemble_kind(const std::string& text);
std::vector<std::string> ensemble_kind_names();

/// Returns the kinds of the hard ensemble in the order of its draws, which repeats: seven in twenty are `late`, and one
/// is of each of the 13 others.
std::vector<EnsembleKind> hard_kinds();

/// Random numbers of one draw. Their order defines the ensemble: append new ones at the end.
class Lot {
 public:
  Lot(std::uint64_t seed, std::uint64_t index) : bits_(seed, index) {}

  double in(const ensemble::Range& range) { return bits_.between(range.low, range.high); }

  double in_logarithm(const ensemble::Range& range) {
    return range.low * std::pow(range.high / range.low, bits_.between(0, 1));
  }

  bool happens(double probability) { return bits_.between(0, 1) < probability; }

  /// Returns `value`, varied slightly for each axis.
  Vec3 by_axis(double value) {
    Vec3 v;
    for (double& component : v) component = value * in(ensemble::kOfAxis);
    return v;
  }

  /// Returns a unit vector of uniform direction.
  Vec3 direction() {
    Vec3 v;
    do {
      for (double& component : v) component = bits_.symmetric();
    } while (v.squaredNorm() > 1 || v.squaredNorm() < 1e-6);
    return v.normalized();
  }

  std::uint64_t seed() { return bits_.next(); }

 private:
  SplitMix64 bits_;
};

/// Throws Error(input) if `draws` is out of range.
void check_draws(std::size_t draws);

/// A device and, in most draws, a hand.
struct EnsembleDraw {
  SimSpec spec;
  std::uint64_t noise_seed = 0;  ///< seed of the hand's own movement
};

/// Returns device `index` of the ensemble of `seed`. The result depends only on the arguments and not on the standard
/// library's distributions.
EnsembleDraw draw_device(std::uint64_t seed, std::uint64_t index, EnsembleKind kind = EnsembleKind::small);

}  // namespace haptrace
