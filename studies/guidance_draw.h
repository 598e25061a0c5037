// Random guidance for random trainees, to try it on whom it was not made for.
#pragma once

#include "player/guidance/guide.h"
#include "studies/ensemble_draw.h"

namespace haptrace {

/// What guidance and trainees are drawn from, beside the devices of draw_device(). All of it is our choice: as far as a
/// user can go, and hands from a finger to an arm. Even between low and high unless it says otherwise.
namespace guidance_ensemble {

using ensemble::Range;

// The loop.
inline constexpr Range kRate{250, 10000};       // even on a logarithmic scale [Hz]
inline constexpr Range kFurtherDelay{0, 5e-3};  // beyond the device's own [s]
inline constexpr double kCalibrated = 0.5;      // share of the devices; the others' delay is not known
inline constexpr Range kKnownDelay{0.9, 1.1};   // that calibration finds, times the true one

// The guidance: every term of it.
inline constexpr double kNoRadius = 0.25;     // share of the tunnels that have none
inline constexpr Range kRadius{0, 0.01};      // of the others [m]
inline constexpr Range kStiffness{100, 1e4};  // asked for, even on a logarithmic scale; the plan clamps it [N/m]
inline constexpr Range kOnset{0.2e-3, 2e-3};  // [m]
inline constexpr Range kWallDamping{0, 5};    // [N s/m]
inline constexpr Range kForceScale{0.5, 1.5};
inline constexpr Range kPace{0.5, 2};        // times the expert's
inline constexpr Range kPaceForce{0.2, 2};   // [N]
inline constexpr Range kResistance{0, 3};    // [N s/m]
inline constexpr Range kViscosity{0, 2};     // [N s/m]
inline constexpr Range kAmplify{0, 200};     // [N/m]
inline constexpr Range kAmplifyForce{0, 1};  // [N]
inline constexpr double kCursor = 0.3;       // share that follow a cursor
inline constexpr Range kCursorSpeed{0.5, 1.5};

// The trainee.
inline constexpr Range kHandMass{0.01, 1.5};         // a finger to an arm, even on a logarithmic scale [kg]
inline constexpr Range kIntentStiffness{150, 2000};  // slack to tense, even on a logarithmic scale [N/m]
inline constexpr Range kIntentDamping{0.2, 1};       // of the critical one
inline constexpr Range kTremor{0.02, 0.2};           // rms per axis, even on a logarithmic scale [N]
inline constexpr Range kSpeed{0.25, 4};              // times the expert's, even on a logarithmic scale
inline constexpr double kWander = 2e-3;              // rms per axis, below 3 Hz [m]
inline constexpr Range kPlace{0.1, 0.9};             // of the path, where he does something else
inline constexpr Range kWhile{0.5, 1.5};             // for which he does it [s]
inline constexpr Range kLeaves{0.01, 0.03};          // beyond the tunnel [m]
inline constexpr Range kPushes{0.02, 0.06};          // beyond the tunnel, into the wall [m]
inline constexpr double kLetsGo = 0.5;               // share of those who do

}  // namespace guidance_ensemble

/// What somebody does once, when he comes to a place.
struct Whim {
  double at = 0;            ///< share of the expert's time
  double lasts = 0;         ///< [s]
  Vec3 way = Vec3::Zero();  ///< how far he goes aside [m]
};

/// How somebody means to follow a path.
struct Trainee {
  double speed = 1;  ///< times the expert's
  Whim stops, returns, leaves, pushes;
  std::optional<double> lets_go;  ///< share of his time
  std::uint64_t seed = 0;         ///< of his wandering
};

/// Before a trainee sets out: the device goes to the start of the path meanwhile [s].
inline constexpr double kTraineeWaits = 0.8;

/// Where he means to be, from the beginning of a session on.
Path intent_of(const Trainee& trainee, const Path& expert);

/// One draw: who holds what, and how he is guided. A device that is known has its true dynamics, as far as guidance
/// reckons with them, and a delay that is right within a tenth.
struct GuidanceDraw {
  std::uint64_t index = 0;
  EnsembleDraw device;
  Trainee trainee;
  GuideOptions guide;
};

/// Draw `index` of the ensemble of `seed`. It depends on these two alone.
GuidanceDraw draw_guidance(std::uint64_t seed, std::uint64_t index);

/// An expert's movements of up to 0.25 m/s, with forces up to 2.3 N: figure eight, retraced line, closed square,
/// cursive, self-touching spiral, circle and corners.
std::vector<Path> guidance_paths();

}  // namespace haptrace
