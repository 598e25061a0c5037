// From what a device did to a model of it.
#pragma once

#include "control/design/multisine.h"
#include "control/design/plant_model.h"

#include <array>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace haptrace {

/// One tick of an experiment: what was measured, and the force that was sent from then on.
struct TickRow {
  double time = 0;               ///< [s]
  Vec3 position = Vec3::Zero();  ///< [m]
  Vec3 force = Vec3::Zero();     ///< on the hand, held until the next tick [N]
};

/// Rows [begin, end) of a log.
struct Stretch {
  std::size_t begin = 0, end = 0;
};

/// What was done to the device, and when.
struct Experiment {
  std::span<const TickRow> rows;  ///< in the order of time; a missed tick is a gap
  double rate_hz = 1000;
  std::array<bool, 3> axes{true, true, true};  ///< that take a force

  /// Added to the force during `dithered`, steadily and by the rows' own time, while the device slides along a path
  /// that repeats every half period of the dither.
  const Multisine* dither = nullptr;
  std::vector<Stretch> dithered;

  /// To and fro along one axis of W, the others held, without dither; several cycles a stretch, of different sizes.
  std::array<std::vector<Stretch>, 3> sweeps;
};

/// What an experiment said.
struct Identification {
  PlantModel plant;           ///< zero on axes that take no force
  PlantModel half_width;      ///< of the 95 % confidence intervals; zero where there is none
  double line_residual = 0;   ///< share of the response at the lines that the model does not explain, rms; of a coarse
                              ///< one, of the force below 20 Hz
  double sweep_residual = 0;  ///< rms force of the sweeps that the model does not explain [N]
  bool fits = false;
  bool coarse = false;  ///< by identify_coarsely: fits only as far as a law that is tried out needs it
  std::string reason;   ///< why it does not fit; empty when it does
};

/// Identifies a plant from an experiment.
///
/// Mass and delay come from the dither: above the resonance of a hand on its grip the hand is a spring, a damper and
/// what they leave at high frequencies, so that the response at the lines, X, obeys
///
///     X = A e^{-jw delay} / (1 + jw lag) U / (jw)^2 + sum_p D_p X / (jw)^p,   p = 1 .. 4
///
/// with U the held command (a zero-order hold of its samples), A the 3 x 3 mobility whose diagonal is 1 / mass, and D_p
/// what the mechanism's damping, stiffness and the hand are divided by the mass. Linear least squares for A and D at
/// given delay and lag, Gauss-Newton for these two (variable projection, Golub and Pereyra 1973). The reported delay is
/// delay plus lag. The mass of an axis is what a force along it alone moves: 1 / (M^-1)_ii of the mass matrix M.
///
/// Friction, gravity and viscous damping come from the sweeps: least squares of the force on sgn v, v, a, x, its
/// integral and what drifts slower than a sweep, every column through the same zero-phase kernel, without the
/// surroundings of reversals. A hand's arm shares in viscous damping and gradient, but not in the friction, which is
/// what does not grow with the size of the sweep. Intervals: the lines' from the covariance of the fit, the sweeps' by
/// the jackknife over blocks of sweeps; both widened by what such models were seen to leave out.
///
/// Needs no more than the log: neither the device's data sheet nor its model. Not for the tick: it allocates.
Identification identify(const Experiment& experiment);

/// A rougher model where the lines are not those of a mass: play between motor and handle, links that swing, a device
/// so heavy that the dither hardly moves it. In place of the response at every line, mass, delay and friction come from
/// all of the movement as seen through a Gaussian kernel, which ends near 20 Hz: least squares of the force on a, sgn
/// v, v, x and an offset, at the delay that leaves least. There the play is short against the movement, and the mass is
/// what moves along, of a hand too. Intervals by the jackknife over blocks of a third of a second. Gravity, its
/// gradient and damping are the sweeps' as in identify(), where these slid; else zero. The harmonics of the place, down
/// to a period of 10 mm, are taken along: cables that pull by place would seem a delay.
///
/// `coarse` is set; it fits when every mass is certain to three quarters. What is designed for it is to be tried out
/// first.
Identification identify_coarsely(const Experiment& experiment);

/// The smallest step that positions make, 0 when none repeats [m]: the quantum of a lattice, also a rotated one.
double position_quantum(std::span<const TickRow> rows);

}  // namespace haptrace
