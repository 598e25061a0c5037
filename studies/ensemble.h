// Comparison of calibrated playback with plain PD control on many random devices and hands.
#pragma once

#include "control/path/path.h"
#include "control/ripple.h"
#include "devices/loop/servo_loop.h"
#include "player/playback/playback.h"
#include "plot/figure.h"
#include "studies/ensemble_draw.h"
#include "studies/ensemble_run.h"

#include <array>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// Criteria for the runs of an ensemble.
namespace ensemble {

inline constexpr double kMostRipple = 0.02e-3;      // 3-D rms of the true error above it; more is a limit cycle [m]
inline constexpr double kHold = 5;                  // [s]
inline constexpr double kHoldJudged = 2;            // judged part at the end of the hold [s]
inline constexpr double kHoldRippleCutoff = 20;     // [Hz]
inline constexpr double kMostHoldRipple = 0.02e-3;  // rms of the true position above it; more is a limit cycle [m]
inline constexpr double kHuntingCutoff = 2;         // [Hz]
inline constexpr double kMostHunting = 0.02e-3;     // rms of the true position above it; more is a limit cycle too [m]
inline constexpr double kMostSaturated = 0.01;      // share of the ticks of a run
inline constexpr double kShakingWindow = 0.25;      // [s]
inline constexpr double kMostShaking = 0.06e-3;     // ripple in the worst window above it; more shakes the hand [m]
inline constexpr double kCatchWithin = 0.3;         // time from the onset of an oscillation to its detection [s]

}  // namespace ensemble

enum class EnsembleController : std::uint8_t {
  stiff,       ///< plain PD of 3000 N/m and 25 N s/m, velocity low-passed at 100 Hz
  cautious,    ///< plain PD of 500 N/m and 6 N s/m
  calibrated,  ///< design from calibrate(), with learning repetitions
};
inline constexpr std::array kEnsembleControllers{EnsembleController::stiff, EnsembleController::cautious,
                                                 EnsembleController::calibrated};
const char* to_string(EnsembleController controller) noexcept;

struct EnsembleOptions {
  /// Draw i is of kind i modulo the number of kinds. Not empty; see hard_kinds().
  std::vector<EnsembleKind> kinds{EnsembleKind::small};
  std::uint64_t seed = 1;
  std::uint64_t first = 0;  ///< index of the first draw; allows a single draw to be rerun
  std::size_t draws = 100;
  std::vector<Path> paths;  ///< paths, fitted into the workspace; empty: ensemble_paths()
  int learn = 5;            ///< learning repetitions of the calibrated playback; the last one counts, as of stiff PD
  std::optional<TrackingLaw> law;    ///< of the calibrated playback; none: the one that play() chooses
  std::optional<Firmness> firmness;  ///< of the LQG law; none: the one that play() chooses
  double beyond = 3;        ///< stiffness of EnsembleOverdrive, relative to the stability limit of a free device
  std::size_t threads = 0;  ///< 0: one for every core. The report does not depend on it
};

/// Returns a circle of 80 mm in 4 s, a square of 100 mm in 8 s and a script of 108 mm in 6 s: peaks of 0.12, 0.09 and
/// 0.17 m/s.
std::vector<Path> ensemble_paths();

/// Metrics of one playback of a path: the last repetition, over phase run.
struct EnsembleRun {
  StopCause cause = StopCause::finished;
  double rms_error = 0, peak_error = 0;  ///< errors of the true position, which no controller sees [m]
  double measured_rms_error = 0, measured_peak_error = 0;  ///< errors of the measured position [m]
  double force_ripple = 0;                                 ///< sent force above 25 Hz, rms [N]
  double ripple = 0;                                       ///< true error above kRippleCutoff, rms [m]
  double shaking = 0;                                      ///< the same in the worst kShakingWindow [m]
  double max_force = 0;                                    ///< largest magnitude sent [N]
  double saturated = 0;                                    ///< share of the ticks at the device's largest force
  double needed_force = 0;  ///< largest force that the movement needs, from the approach on, for the device and a hand
                            ///< without tremor and under any controller (studies/needed_force.h) [N]
  double available_force = 0;       ///< largest force of the motors, which they may not state [N]
  bool stopped_at_largest = false;  ///< a limit stopped the session while it sent the largest force
  int oscillations = 0;             ///< reports of the oscillation monitor in all repetitions

  [[nodiscard]] bool limit_cycle() const noexcept { return ripple > ensemble::kMostRipple; }
  [[nodiscard]] bool shakes() const noexcept { return shaking > ensemble::kMostShaking; }
  [[nodiscard]] bool overpowered() const noexcept { return saturated > ensemble::kMostSaturated || stopped_at_largest; }
};

/// End of a hold after a reach, with a passive hand.
struct EnsembleHold {
  StopCause cause = StopCause::finished;
  double ripple = 0;   ///< true position above kHoldRippleCutoff, rms over the last kHoldJudged [m]
  double hunting = 0;  ///< the same above kHuntingCutoff [m]
  int oscillations = 0;

  [[nodiscard]] bool limit_cycle() const noexcept {
    return ripple > ensemble::kMostHoldRipple || hunting > ensemble::kMostHunting;
  }
};

/// The same reach with gains beyond the device's stability limit.
struct EnsembleOverdrive {
  StopCause cause = StopCause::finished;
  double onset = kNaN;   ///< time at which the true position starts to oscillate: 0.1 mm rms above 8 Hz for 0.2 s [s]
  double caught = kNaN;  ///< time of the first report of the oscillation monitor [s]
  bool calm = true;      ///< no such oscillation in the last half second

  [[nodiscard]] bool oscillates() const noexcept { return std::isfinite(onset); }
  /// Returns the time from `onset` to `caught` [s]; infinite if never caught, NaN without oscillation.
  [[nodiscard]] double delay() const noexcept;
};

/// Results of one controller on one device.
struct EnsembleTrial {
  std::vector<EnsembleRun> runs;  ///< one for each path
  EnsembleHold hold;
};

struct EnsembleMember {
  std::uint64_t index = 0;
  EnsembleKind kind = EnsembleKind::small;
  std::string calibration_error;  ///< why there is no calibrated trial; empty if there is one
  std::array<EnsembleTrial, kEnsembleControllers.size()> trials;
  EnsembleOverdrive overdrive;

  [[nodiscard]] bool calibrated() const noexcept { return calibration_error.empty(); }
  [[nodiscard]] const EnsembleTrial& trial(EnsembleController controller) const noexcept {
    return trials[static_cast<std::size_t>(controller)];
  }
  /// Returns true when this path needs more force than the motors have and the calibrated playback (the stiff one if
  /// the calibration failed) therefore sent the largest force for more than kMostSaturated of the run, or stopped
  /// there. Saturation without such a need counts against the controller.
  [[nodiscard]] bool beyond_force(std::size_t path) const noexcept;
};

struct EnsembleReport {
  std::vector<EnsembleKind> kinds{EnsembleKind::small};  ///< of the options
  std::uint64_t seed = 0;
  std::size_t draws = 0;           ///< number of draws requested; fewer members after a cancellation
  std::vector<std::string> paths;  ///< names of the paths
  int learn = 0;
  std::vector<EnsembleMember> members;  ///< in the order of their index
};

/// Runs the ensemble. Each draw is calibrated without knowledge of its model, and every run is a play() on a new device
/// in virtual time whose controller sees only what Device provides. Calls `progress` in the calling thread about ten
/// times a second. If `stop` is raised, the report contains the finished draws.
///
/// Throws Error(input) when an option is out of range or a path cannot be played.
EnsembleReport run_ensemble(const EnsembleOptions& options, const StopRequest& stop,
                            const std::function<void(const EnsembleProgress&)>& progress = {});

/// Runs one draw on `options.paths`, which must not be empty; `options.kinds` determines its kind. The result is
/// invalid if `stop` was raised meanwhile. Throws what play() throws before its first tick.
EnsembleMember run_member(std::uint64_t seed, std::uint64_t index, const EnsembleOptions& options,
                          const StopRequest& stop);

/// Runs only the reach of one draw with gains beyond its stability limit, as run_member() does.
EnsembleOverdrive run_overdrive(std::uint64_t seed, std::uint64_t index, const EnsembleOptions& options,
                                const StopRequest& stop);

}  // namespace haptrace
