// Metrics of a reach: reaction, aim, deviation, and what an error clamp shows.
#pragma once

#include "control/reaching.h"
#include "metrics/movement.h"

#include <optional>
#include <string>

namespace haptrace {

/// Metrics of one reach, from low-passed positions and forces (see movement_figures()). The trial begins with the cue.
/// Onset and end are those of movement_figures(); u is the direction from start to target, n the lateral axis.
struct ReachFigures {
  /// Time from the cue to the start of the movement [s]. A threshold on the speed is late, so the start is found by a
  /// back-fit, as Botzer and Karniel (Frontiers in Neuroscience 3:61, 2009) do it with a cubic: here with the speed of
  /// a minimum-jerk movement, v = v_peak (4 w (1 - w))^2, whose first term is their cubic. The rise of the speed from
  /// 10 to 60 % of the first peak gives w(t), and a straight line through it has its zero at the start. The cubic alone
  /// would begin too early by some 3 % of the duration. Undefined below kFastest (the cue was not the cause) and beyond
  /// kSlowest.
  std::optional<double> reaction_time;

  /// Angle between u and the direction from the hand's place at the onset to that at the first maximum of the speed
  /// [rad], positive to the left. The first minimum of the speed (Coderre and others 2010) would be the end of a reach
  /// with one maximum, where the error has been corrected.
  std::optional<double> initial_direction_error;

  double path_ratio = 0;         ///< length of the hand's path from onset to end over the distance of the target
  double lateral_deviation = 0;  ///< from the line, along n, at the largest speed [m]
  double end_error = 0;          ///< distance from the target at the end of the movement [m]
  double lateral_play = 0;       ///< largest distance from the line, from onset to end [m]

  /// Share of the field that acted, of a reach in which it should: sum(F . B v) / sum |B v|^2 from onset to end, with
  /// the sent force F. Limits of force and energy, and the guard, lower it.
  std::optional<double> field_share;

  /// Adaptation index of an error clamp: sum(F_m F_i) / sum(F_i^2) from onset to end. F_m is the force of the channel
  /// on the hand along n; F_i is the channel's force on a hand that expects the whole field, n . B u (u . v), from the
  /// speed along the reach in the same trial. 0: nothing learned, 1: the whole field.
  std::optional<double> adaptation_index;
  std::optional<double> adaptation_r;  ///< Pearson correlation of F_m and F_i
  std::string refused;                 ///< why a clamp has no index; empty otherwise

  static constexpr double kFastest = 0.1, kSlowest = 1;  ///< bounds of the reaction time [s]
  static constexpr double kMostPlay = 3e-3;              ///< lateral play beyond which there is no index [m]
  static constexpr double kLeastField = 0.9;             ///< share of the field below which a reach is weakened
};

/// Computes the metrics of a reach. Nothing without a movement, see movement_figures(). The force of an index is the
/// measured one if the trial has it, else the force that was sent. `spoiled` says why the channel of a clamp did not
/// act as planned; it then has no index. Throws what movement_figures() throws.
std::optional<ReachFigures> reach_figures(const Trial& trial, const ReachTrial& reach, const std::string& spoiled = "",
                                          const MovementOptions& options = {});

}  // namespace haptrace
