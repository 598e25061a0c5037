// Test of guidance on many random trainees and devices: it must be stable and stay within its energy budget.
#pragma once

#include "studies/ensemble_run.h"
#include "studies/guidance_draw.h"

#include <nlohmann/json.hpp>

namespace haptrace {

/// Limits for guidance. A run that exceeds one of them has failed.
namespace guidance_ensemble {

inline constexpr double kMostExcess = 5e-3;    // energy given to the hand beyond the budget: the work of a tick [J]
inline constexpr double kMostJump = 2e-3;      // movement of the place per tick beyond that of the trainee [m]
inline constexpr double kRippleCutoff = 15;    // above the frequencies of hands [Hz]
inline constexpr double kRippleTime = 0.6;     // shortest duration of an oscillation; an impact ends sooner [s]
inline constexpr double kMostRipple = 0.2e-3;  // rms of the true position above it; more is an oscillation [m]
inline constexpr double kMoreThanAlone = 1.5;  // ripple of the hand without guidance is allowed this many times on top
inline constexpr double kHold = 2;             // hold at the end, when the trainee rests [s]
inline constexpr double kRestJudged = 0.5;     // judged part at the end of the hold [s]
inline constexpr double kMostRest = 0.03;      // rms of the true speed in it; more is an oscillation [m/s]

}  // namespace guidance_ensemble

/// Result of one draw on one path. Energies are true work of the motors, which no controller sees.
struct GuidanceRun {
  StopCause cause = StopCause::finished;
  double given = 0;         ///< energy given to hand and device beyond what springs store, at the end [J]
  double budget = 0;        ///< energy budget at the end [J]
  double excess = 0;        ///< largest value of given - budget; negative if always below the budget [J]
  double jump = 0;          ///< largest movement of the place in a tick beyond the trainee's [m]; 0 with a cursor
  double ripple = 0;        ///< largest rms of the true position above kRippleCutoff that lasted for kRippleTime [m]
  double rest = 0;          ///< rms of the true speed at the end of the hold [m/s]
  double ripple_alone = 0;  ///< ripple of this hand on this device without force; 0 if `ripple` is small [m]
  double speed = 0;         ///< largest true speed [m/s]
  double progress = 0;      ///< farthest place, as a share of the path
  int oscillations = 0;     ///< number of events of an oscillating or swaying wall

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
  double rate_hz = 0, delay = 0, radius = 0, stiffness = 0;  ///< `delay` is the true one, with the motors' lag [s]
  bool cursor = false, held = false, calibrated = false;
  std::vector<GuidanceRun> runs;  ///< one for each path
};

struct GuidanceReport {
  std::uint64_t seed = 0;
  std::size_t draws = 0;           ///< number of draws requested; fewer members after a cancellation
  std::vector<std::string> paths;  ///< names of the paths
  std::vector<GuidanceMember> members;

  /// Returns the number of failed runs.
  [[nodiscard]] std::size_t failures() const noexcept;
};

struct GuidanceEnsembleOptions {
  std::uint64_t seed = 1;
  std::uint64_t first = 0;  ///< index of the first draw; allows a single draw to be rerun
  std::size_t draws = 100;
  std::vector<Path> paths;  ///< paths within the workspace of ensemble::kReach; empty: guidance_paths()
  std::size_t threads = 0;  ///< 0: one for every core. The report does not depend on it
};

/// Guides every draw along every path, each on a new device in virtual time. Otherwise like run_ensemble.
///
/// Throws Error(input) when an option is out of range or a path cannot be used for guidance.
GuidanceReport run_guidance_ensemble(const GuidanceEnsembleOptions& options, const StopRequest& stop,
                                     const std::function<void(const EnsembleProgress&)>& progress = {});

/// Runs one draw on `paths`.
GuidanceMember run_guidance_member(const GuidanceDraw& draw, const std::vector<Path>& paths, const StopRequest& stop);

/// Returns the counts and their criteria in SI units. Failed runs are identified by draw and path.
nlohmann::json to_json(const GuidanceReport& report);

/// Returns a short text summary.
std::string text_of(const GuidanceReport& report);

}  // namespace haptrace
