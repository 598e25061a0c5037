// Trainees on ten paths, with the true place at every tick: what PlaceTracker has to find.
#pragma once

#include "control/path/arc_path.h"

#include <cstdint>
#include <string>
#include <vector>

namespace haptrace::test {

/// An expert's path, walked at 80 mm/s.
struct Stroke {
  std::string name;
  std::vector<Vec3> points;     ///< corners and points of curves, joined by straight lines [m]
  std::vector<double> corners;  ///< arc length of the corners and turns [m]
};

inline constexpr double kExpertSpeed = 0.08;  // [m/s]

/// Returns ten paths of about 100 mm: line and back, three laps of a circle, two of a figure eight, a zigzag, a square,
/// a spiral, script, one stretch three times, a hairpin and two laps 2 mm apart.
std::vector<Stroke> strokes();

/// Returns the path of a stroke, with an expert's force that depends on the place.
ArcPath path_of(const Stroke& stroke, double radius);

/// How a trainee departs from the expert. Lengths in m, angles in rad.
struct Departure {
  std::string name;
  double noise = 0.7e-3;  ///< rms per axis, below 3 Hz
  double speed = 1;       ///< relative to the expert's
  double stop = 0;        ///< [s], once on the way
  double scale = 1;
  bool about_start = false;  ///< scaled about the start of the path, not its centre
  double shift = 0, rotation = 0;
  double low_pass = 0;  ///< cutoff of a zero-phase low-pass over time [Hz]; 0: none
  double early = 0;     ///< turns so early, and cuts corners there
  double back = 0;      ///< goes back so far, once
  bool again = false;   ///< goes back to the start, once
  double skip = 0;      ///< leaves out so much, once
  bool middle = false;  ///< starts in the middle
  double wander = 0;    ///< leaves the path so far, and comes back to the same place
  double tremor = 0;    ///< amplitude at 5 Hz
  double shake = 0;     ///< amplitude at 5 Hz for 20 s at one place, in all directions
};

/// A trial at 1 kHz.
struct Trial {
  std::vector<Vec3> hand;     ///< [m]
  std::vector<double> truth;  ///< arc length [m]
  std::vector<bool> grace;    ///< the place cannot be known yet: soon after a departure
  bool any_lap = false;       ///< every place with the same position and direction is right
};

/// Returns the trial of a trainee; it depends on the arguments only.
Trial trial_of(const Stroke& stroke, const ArcPath& path, const Departure& departure, std::uint64_t seed);

/// The result of a tracker on a trial.
struct Verdict {
  bool kept = false;         ///< right at the end, and never wrong for longer than 0.5 s
  int jumps = 0;             ///< moves from the right place to a wrong one, 15 mm away or more
  double longest_wrong = 0;  ///< [s]
  double wrong_wall = 0;     ///< largest depth in a wall beyond that in the wall of the true place [m]
  double doubt = 0;          ///< share of the time in which the certainty is below 1
  double fastest = 0;        ///< largest move of the place in a tick while it bears force [m]
  double error = 0;          ///< rms distance from the true place along the path, outside of grace [m]
};

/// Follows a trial with PlaceTracker.
Verdict judge(const ArcPath& path, const Trial& trial, bool allow_back = true);

}  // namespace haptrace::test
