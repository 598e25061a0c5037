// Random guidance settings and trainees for testing guidance.
#pragma once

#include "player/guidance/guide.h"
#include "studies/ensemble_draw.h"

namespace haptrace {

/// Ranges of the draws of guidance and trainees; devices come from draw_device(). All values are our choice: settings
/// over the whole range open to a user, and hands from a finger to an arm. Values are uniform between low and high
/// unless stated otherwise.
namespace guidance_ensemble {

using ensemble::Range;

// Loop.
inline constexpr Range kRate{250, 10000};       // uniform on a logarithmic scale [Hz]
inline constexpr Range kFurtherDelay{0, 5e-3};  // delay added to the device's own [s]
inline constexpr double kCalibrated = 0.5;      // share of calibrated devices; the delay of the others is unknown
inline constexpr Range kKnownDelay{0.9, 1.1};   // identified delay, relative to the true one

// Guidance, with all its terms.
inline constexpr double kNoRadius = 0.25;     // share of tunnels with zero radius
inline constexpr Range kRadius{0, 0.01};      // radius of the other tunnels [m]
inline constexpr Range kStiffness{100, 1e4};  // requested, uniform on a logarithmic scale; the plan clamps it [N/m]
inline constexpr Range kOnset{0.2e-3, 2e-3};  // [m]
inline constexpr Range kWallDamping{0, 5};    // [N s/m]
inline constexpr Range kForceScale{0.5, 1.5};
inline constexpr Range kPace{0.5, 2};        // relative to the expert's
inline constexpr Range kPaceForce{0.2, 2};   // [N]
inline constexpr Range kResistance{0, 3};    // [N s/m]
inline constexpr Range kViscosity{0, 2};     // [N s/m]
inline constexpr Range kAmplify{0, 200};     // [N/m]
inline constexpr Range kAmplifyForce{0, 1};  // [N]
inline constexpr double kCursor = 0.3;       // share of draws in cursor mode
inline constexpr Range kCursorSpeed{0.5, 1.5};

// Trainee.
inline constexpr Range kHandMass{0.01, 1.5};         // a finger to an arm, uniform on a logarithmic scale [kg]
inline constexpr Range kIntentStiffness{150, 2000};  // slack to tense, uniform on a logarithmic scale [N/m]
inline constexpr Range kIntentDamping{0.2, 1};       // relative to critical damping
inline constexpr Range kTremor{0.02, 0.2};           // rms per axis, uniform on a logarithmic scale [N]
inline constexpr Range kSpeed{0.25, 4};              // relative to the expert's, uniform on a logarithmic scale
inline constexpr double kWander = 2e-3;              // rms per axis, below 3 Hz [m]
inline constexpr Range kPlace{0.1, 0.9};             // place on the path of a deviation from it, as a share
inline constexpr Range kWhile{0.5, 1.5};             // duration of a deviation [s]
inline constexpr Range kLeaves{0.01, 0.03};          // distance beyond the tunnel [m]
inline constexpr Range kPushes{0.02, 0.06};          // distance beyond the tunnel, into the wall [m]
inline constexpr double kLetsGo = 0.5;               // share of trainees who let go

}  // namespace guidance_ensemble

/// A single deviation of a trainee at one place on the path.
struct Whim {
  double at = 0;            ///< place on the path, as a share of the expert's time
  double lasts = 0;         ///< duration [s]
  Vec3 way = Vec3::Zero();  ///< sideways displacement [m]
};

/// Intended movement of a trainee along a path.
struct Trainee {
  double speed = 1;  ///< speed relative to the expert's
  Whim stops, returns, leaves, pushes;
  std::optional<double> lets_go;  ///< moment at which the hand lets go, as a share of the trainee's time
  std::uint64_t seed = 0;         ///< seed of the trainee's wandering
};

/// Time before the trainee starts, during which the device moves to the start of the path [s].
inline constexpr double kTraineeWaits = 0.8;

/// Returns the trainee's intended positions from the start of a session.
Path intent_of(const Trainee& trainee, const Path& expert);

/// One draw: device, hand, trainee and guidance. A calibrated device has its true dynamics, as far as guidance uses
/// them, and a delay that is correct within a tenth.
struct GuidanceDraw {
  std::uint64_t index = 0;
  EnsembleDraw device;
  Trainee trainee;
  GuideOptions guide;
};

/// Returns draw `index` of the ensemble of `seed`. The result depends only on these two.
GuidanceDraw draw_guidance(std::uint64_t seed, std::uint64_t index);

/// Returns expert paths with speeds of up to 0.25 m/s and forces of up to 2.3 N: figure eight, retraced line, closed
/// square, cursive, self-touching spiral, circle and corners.
std::vector<Path> guidance_paths();

}  // namespace haptrace
