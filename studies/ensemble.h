// A calibrated playback against plain PD on many random devices and hands.
#pragma once

#include "control/path/path.h"
#include "devices/loop/servo_loop.h"
#include "plot/figure.h"
#include "studies/ensemble_draw.h"
#include "studies/ensemble_run.h"

#include <array>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace haptrace {

/// What an ensemble is counted by.
namespace ensemble {

inline constexpr double kRippleCutoff = 25;         // of positions and forces while moving [Hz]
inline constexpr double kMostRipple = 0.02e-3;      // rms above it of the true position, 3-D; more is a limit cycle [m]
inline constexpr double kHold = 5;                  // [s]
inline constexpr double kHoldJudged = 2;            // at its end [s]
inline constexpr double kHoldRippleCutoff = 20;     // [Hz]
inline constexpr double kMostHoldRipple = 0.02e-3;  // rms above it of the true position; more is a limit cycle [m]
inline constexpr double kHuntingCutoff = 2;         // [Hz]
inline constexpr double kMostHunting = 0.02e-3;     // rms above it of the true position; more is a limit cycle too [m]
inline constexpr double kMostSaturated = 0.01;      // of the ticks of a run
inline constexpr double kCatchWithin = 0.3;         // from an oscillation's onset until it is noticed [s]

}  // namespace ensemble

enum class EnsembleController : std::uint8_t {
  stiff,       ///< plain PD of 3000 N/m and 25 N s/m, velocity low-passed at 100 Hz
  cautious,    ///< plain PD of 500 N/m and 6 N s/m
  calibrated,  ///< what calibrate() made of the device, with learning repetitions
};
inline constexpr std::array kEnsembleControllers{EnsembleController::stiff, EnsembleController::cautious,
                                                 EnsembleController::calibrated};
const char* to_string(EnsembleController controller) noexcept;

struct EnsembleOptions {
  std::uint64_t seed = 1;
  std::uint64_t first = 0;  ///< index of the first draw: one that stood out can be run alone
  std::size_t draws = 100;
  std::vector<Path> paths;  ///< fitted into the workspace; empty: ensemble_paths()
  int learn = 5;            ///< learning repetitions of the calibrated player; the last one counts
  double beyond = 3;        ///< times the stiffness that a free device is stable with, for EnsembleOverdrive
  std::size_t threads = 0;  ///< 0: one for every core. The report does not depend on it
};

/// Circle of 80 mm in 4 s, square of 100 mm in 8 s, script of 108 mm in 6 s: peaks of 0.12, 0.09 and 0.17 m/s.
std::vector<Path> ensemble_paths();

/// How a path was followed: the last repetition, over phase run.
struct EnsembleRun {
  StopCause cause = StopCause::finished;
  double rms_error = 0, peak_error = 0;                    ///< of the true position, which no controller sees [m]
  double measured_rms_error = 0, measured_peak_error = 0;  ///< of the device's own position [m]
  double force_ripple = 0;                                 ///< of the sent force above 25 Hz, rms [N]
  double ripple = 0;                                       ///< of the true error above kRippleCutoff, rms [m]
  double max_force = 0;                                    ///< largest magnitude sent [N]
  double saturated = 0;                                    ///< share of the ticks at the device's largest force
  double needed_force = 0;                                 ///< largest on the way to the path and along it: what the
                                                           ///< device and a hand without tremor ask for, whoever
                                                           ///< controls it (studies/needed_force.h) [N]
  bool stopped_at_largest = false;                         ///< a limit stopped it while it was at the largest force
  int oscillations = 0;  ///< times that the oscillation monitor spoke, all repetitions

  [[nodiscard]] bool limit_cycle() const noexcept { return ripple > ensemble::kMostRipple; }
  [[nodiscard]] bool overpowered() const noexcept { return saturated > ensemble::kMostSaturated || stopped_at_largest; }
};

/// The end of a hold after a reach, with a hand that does nothing by itself.
struct EnsembleHold {
  StopCause cause = StopCause::finished;
  double ripple = 0;   ///< of the true position above kHoldRippleCutoff, rms over the last kHoldJudged [m]
  double hunting = 0;  ///< the same above kHuntingCutoff [m]
  int oscillations = 0;

  [[nodiscard]] bool limit_cycle() const noexcept {
    return ripple > ensemble::kMostHoldRipple || hunting > ensemble::kMostHunting;
  }
};

/// The same reach with gains beyond what the device bears.
struct EnsembleOverdrive {
  StopCause cause = StopCause::finished;
  double onset = kNaN;   ///< when the true position began to oscillate: 0.1 mm rms above 8 Hz for 0.2 s [s]
  double caught = kNaN;  ///< when the oscillation monitor first spoke [s]
  bool calm = true;      ///< no such oscillation over the last half second

  [[nodiscard]] bool oscillates() const noexcept { return std::isfinite(onset); }
  /// From onset to caught; infinite when it never was [s].
  [[nodiscard]] double delay() const noexcept;
};

/// What one controller did with one device.
struct EnsembleTrial {
  std::vector<EnsembleRun> runs;  ///< for each path
  EnsembleHold hold;
};

struct EnsembleMember {
  std::uint64_t index = 0;
  std::string calibration_error;  ///< why there is no calibrated trial; empty when there is
  std::array<EnsembleTrial, kEnsembleControllers.size()> trials;
  EnsembleOverdrive overdrive;

  [[nodiscard]] bool calibrated() const noexcept { return calibration_error.empty(); }
  [[nodiscard]] const EnsembleTrial& trial(EnsembleController controller) const noexcept {
    return trials[static_cast<std::size_t>(controller)];
  }
  /// True when this path needs more force than the device has, and that showed: the calibrated player was at the
  /// largest force for more than kMostSaturated of the run, or stopped there. What it does at the largest force without
  /// such need is its fault.
  [[nodiscard]] bool beyond_force(std::size_t path) const noexcept;
};

struct EnsembleReport {
  std::uint64_t seed = 0;
  std::size_t draws = 0;           ///< asked for; fewer members when it was cancelled
  std::vector<std::string> paths;  ///< names
  int learn = 0;
  std::vector<EnsembleMember> members;  ///< by index
};

/// Runs the ensemble: each draw is calibrated blind, and every run is a play() on a device of its own in virtual time,
/// of which the controller sees what Device tells. `progress` is called in the calling thread about ten times a second.
/// When `stop` is raised the draws that are finished are reported.
///
/// Throws Error(input): options out of range, a path that cannot be played.
EnsembleReport run_ensemble(const EnsembleOptions& options, const StopRequest& stop,
                            const std::function<void(const EnsembleProgress&)>& progress = {});

/// One draw on `options.paths`, of which there must be some. Of no use when `stop` was raised meanwhile. Throws what
/// play() throws before its first tick.
EnsembleMember run_member(std::uint64_t seed, std::uint64_t index, const EnsembleOptions& options,
                          const StopRequest& stop);

}  // namespace haptrace
