// Guidance of many random trainees on many random devices: that it is stable, and gives no energy beyond its budget.
#pragma once

#include "studies/ensemble_run.h"
#include "studies/guidance_draw.h"

#include <nlohmann/json.hpp>

namespace haptrace {

/// What guidance is held to. A run in which one of them is passed has failed.
namespace guidance_ensemble {

inline constexpr double kMostExcess = 5e-3;    // given to the hand beyond the budget: a tick's work [J]
inline constexpr double kMostJump = 2e-3;      // of the place in a tick, beyond what the trainee moved [m]
inline constexpr double kRippleCutoff = 15;    // beyond what hands do by themselves [Hz]
inline constexpr double kRippleTime = 0.6;     // for which it lasts: an impact is over by then [s]
inline constexpr double kMostRipple = 0.2e-3;  // rms above it of the true position; more is an oscillation [m]
inline constexpr double kMoreThanAlone = 1.5;  // and so many times what the hand does without guidance
inline constexpr double kHold = 2;             // at the end, when the trainee rests [s]
inline constexpr double kRestJudged = 0.5;     // at its end [s]
inline constexpr double kMostRest = 0.03;      // rms of the true speed there; more is an oscillation [m/s]

}  // namespace guidance_ensemble

/// One draw on one path. Energies are those that the motors gave in truth, which no controller sees.
struct GuidanceRun {
  StopCause cause = StopCause::finished;
  double given = 0;   ///< to hand and device beyond what springs hold, at the end [J]
  double budget = 0;  ///< at the end [J]
  double excess = 0;  ///< largest of given - budget; negative when it always stayed below [J]
  double jump = 0;    ///< largest of the place in a tick, beyond what the trainee moved [m]; 0 with a cursor
  double ripple = 0;  ///< of the true position above kRippleCutoff, rms; the largest that lasted for kRippleTime [m]
  double rest = 0;    ///< rms of the true speed at the end of the hold [m/s]
  double ripple_alone = 0;  ///< of this hand on this device without any force; 0 when ripple is small anyway [m]
  double speed = 0;         ///< largest true speed [m/s]
  double progress = 0;      ///< farthest place, share of the path
  int oscillations = 0;     ///< times that the oscillation monitor softened the walls

  [[nodiscard]] bool overdrawn() const noexcept { return excess > guidance_ensemble::kMostExcess; }
  [[nodiscard]] bool jumped() const noexcept { return jump > guidance_ensemble::kMostJump; }
  [[nodiscard]] bool ripples() const noexcept {
    return ripple > guidance_ensemble::kMostRipple + guidance_ensemble::kMoreThanAlone * ripple_alone;
  }
  [[nodiscard]] bool restless() const noexcept { return rest > guidance_ensemble::kMostRest; }
  [[nodiscard]] bool unstable() const noexcept { return ripples() || restless(); }
  [[nodiscard]] bool stopped() const noexcept { return cause != StopCause::finished; }
  [[nodiscard]] bool failed() const noexcept { return overdrawn() || jumped() || unstable() || stopped(); }
};

struct GuidanceMember {
  std::uint64_t index = 0;
  double rate_hz = 0, delay = 0, radius = 0, stiffness = 0;  ///< delay: the true one, with the motors' lag [s]
  bool cursor = false, held = false, calibrated = false;
  std::vector<GuidanceRun> runs;  ///< for each path
};

struct GuidanceReport {
  std::uint64_t seed = 0;
  std::size_t draws = 0;           ///< asked for; fewer members when it was cancelled
  std::vector<std::string> paths;  ///< names
  std::vector<GuidanceMember> members;

  /// Of the runs, how many failed.
  [[nodiscard]] std::size_t failures() const noexcept;
};

struct GuidanceEnsembleOptions {
  std::uint64_t seed = 1;
  std::uint64_t first = 0;  ///< index of the first draw: one that stood out can be run alone
  std::size_t draws = 100;
  std::vector<Path> paths;  ///< within the workspace of ensemble::kReach; empty: guidance_paths()
  std::size_t threads = 0;  ///< 0: one for every core. The report does not depend on it
};

/// Guides every draw along every path, each on a device of its own in virtual time. Otherwise as run_ensemble.
///
/// Throws Error(input): options out of range, a path that cannot be taught.
GuidanceReport run_guidance_ensemble(const GuidanceEnsembleOptions& options, const StopRequest& stop,
                                     const std::function<void(const EnsembleProgress&)>& progress = {});

/// One draw on `paths`.
GuidanceMember run_guidance_member(const GuidanceDraw& draw, const std::vector<Path>& paths, const StopRequest& stop);

/// SI. Holds the criteria beside what was counted by them; runs that failed are named by draw and path.
nlohmann::json to_json(const GuidanceReport& report);

/// A few lines for people.
std::string text_of(const GuidanceReport& report);

}  // namespace haptrace
