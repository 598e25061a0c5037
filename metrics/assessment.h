// Metrics of assessments with a cue: range of motion, maximum force, tracking, weight of the arm.
#pragma once

#include "control/reaching.h"
#include "metrics/movement.h"

#include <optional>
#include <string>

namespace haptrace {

/// How far a hand came in the direction of a range of motion.
struct RangeFigures {
  /// Largest distance from the start, along the direction, that the hand kept for the hold: the largest of the minima
  /// over windows as long as the hold. A place that the hand only passed does not count [m].
  double distance = 0;
  /// The hand was within kMargin of the workspace there, in the direction: it may come farther on a larger device.
  bool at_limit = false;

  static constexpr double kMargin = 5e-3;  ///< [m]
};

/// How hard a hand pressed against a lock.
struct PressFigures {
  /// Largest mean of the force of the hand along the direction over kWindow [N]. The force is the measured one if the
  /// trial has it, else the force that the device sent, which is the hand's but for the friction of the device. If the
  /// lock did not hold, also the mean over the last kBeforeBreak.
  double force = 0;
  /// The device had no more force in over kLimited of these samples, or the lock did not hold: the hand may be
  /// stronger.
  bool at_limit = false;
  std::string refused;  ///< why `force` is no result; else empty

  static constexpr double kWindow = 0.5, kBeforeBreak = 0.1;  ///< [s]
  static constexpr double kNearLimit = 0.95;                  ///< share of the largest force that counts as all of it
  static constexpr double kLimited = 0.1;                     ///< share of the samples
  static constexpr double kLeast = 0.2;                       ///< of a result [N]
  static constexpr double kLockedPlay = 5e-3;                 ///< largest movement of a handle that is locked [m]
};

/// How a hand followed a target that moves, without the time that TrackSignal discards.
struct TrackFigures {
  double rms = 0;  ///< root mean square over time of the distance from the target [m]
  /// Gain g and delay tau of the hand at the frequencies of the target: g s(t - tau) is nearest to the sines of these
  /// frequencies in the hand's movement along the line (least squares). The delay of a hand that moved with less than
  /// kLeastGain of the target is undefined.
  std::optional<double> gain, delay;  ///< [1], [s]

  static constexpr double kLeastGain = 0.1;
  static constexpr double kEarliest = -0.5, kLatest = 1.5;  ///< delays that are tried [s]
};

/// How heavy an arm rested on a lock.
struct WeighFigures {
  /// Mean over the last kWindow of the force of the hand straight down, measured as in PressFigures; that of
  /// PressFigures if the lock gave way [N].
  double weight = 0;
  bool at_limit = false;  ///< the device had no more force, or gave way: the arm may be heavier
  std::string refused;    ///< why `weight` is no result; else empty

  static constexpr double kWindow = 3;    ///< [s]
  static constexpr double kRests = 0.01;  ///< largest movement of an arm that rests [m]
  static constexpr double kLeast = 0.2;   ///< of a result [N]
};

/// Compute the metrics of a trial whose goal is range, press, track or weigh, from samples as they were recorded. The
/// trial begins with the cue. Nothing if the trial is too short for the metric, or has no positions or forces.
/// `spoiled` says why a lock did not act as planned; empty if it did. Throw nothing.
std::optional<RangeFigures> range_figures(const Trial& trial, const ReachTrial& reach);
std::optional<PressFigures> press_figures(const Trial& trial, const ReachTrial& reach, const std::string& spoiled = "");
std::optional<TrackFigures> track_figures(const Trial& trial, const ReachTrial& reach);
std::optional<WeighFigures> weigh_figures(const Trial& trial, const ReachTrial& reach, const std::string& spoiled = "");

}  // namespace haptrace
