// Identification of a device's dynamics from experiments.
#pragma once

#include "control/design/held_model.h"
#include "control/design/line_spectrum.h"
#include "control/design/multisine.h"
#include "control/design/plant_model.h"

#include <array>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace haptrace {

/// One tick of an experiment: the measured position and the force sent from then on.
struct TickRow {
  double time = 0;               ///< [s]
  Vec3 position = Vec3::Zero();  ///< [m]
  Vec3 force = Vec3::Zero();     ///< on the hand, held until the next tick [N]
};

/// Rows [begin, end) of a log.
struct Stretch {
  std::size_t begin = 0, end = 0;
};

/// A place at which a part of the excitation was repeated.
struct ExperimentPlace {
  Vec3 position = Vec3::Zero();  ///< [m]
  Stretch dithered;              ///< with the excitation signal, for at least one of its periods
};

/// The inputs of an identification: log, excitation and sections of the log.
struct Experiment {
  std::span<const TickRow> rows;  ///< in the order of time; a missed tick is a gap
  double rate_hz = 1000;
  std::array<bool, 3> axes{true, true, true};  ///< axes with force output

  /// Excitation signal that is added to the force during `dithered`, without interruption and on the time of the rows.
  /// Meanwhile the device slides along a path that repeats every half period of this signal.
  const Multisine* dither = nullptr;
  std::vector<Stretch> dithered;

  /// Place of `dithered` [m], and places around it.
  Vec3 centre = Vec3::Zero();
  std::vector<ExperimentPlace> places;

  /// Strokes to and fro along one axis of W, with the others held and without excitation signal. A stretch has several
  /// cycles of different sizes.
  std::array<std::vector<Stretch>, 3> sweeps;

  /// Strokes to and fro along one axis of W under pulses of force along it, with the others held.
  std::array<std::vector<Stretch>, 3> pulsed{};
};

/// Returns the response at the lines of the excitation signal, from the whole periods in `dithered`; no lines without
/// one.
LineSpectrum spectrum_of(const Experiment& experiment);

/// Identifies a plant from an experiment.
///
/// Mass and delay come from the response to the excitation signal from 15 Hz. Above the resonance of a hand on its
/// grip, the hand acts as a spring, a damper and smaller terms at high frequencies, so that the response at the lines,
/// X, obeys
///
///     X = A e^{-jw delay} / (1 + jw lag) U / (jw)^2 + sum_p D_p X / (jw)^p,   p = 1 .. 4
///
/// with U the held command (a zero-order hold of its samples), A the 3 x 3 mobility whose diagonal is 1 / mass, and D_p
/// the damping and stiffness of the mechanism and the hand divided by the mass. Linear least squares gives A and D for
/// a given delay and lag; Gauss-Newton finds these two (variable projection, Golub and Pereyra 1973). The reported
/// delay is delay plus lag. The mass of an axis is the mass that a force along it alone moves: 1 / (M^-1)_ii of the
/// mass matrix M.
///
/// Friction, gravity and viscous damping come from the sweeps: least squares of the force on sgn v, v, a, x, its
/// integral, jerk, snap, and a drift slower than a sweep. Every column passes the same zero-phase kernel, and samples
/// near reversals are left out. The operator's arm adds to viscous damping and gradient, but not to the friction,
/// which does not grow with the size of the sweep. Confidence intervals come from the covariance of the fit (lines) and
/// from the jackknife over blocks of sweeps (sweeps). Both are widened by the known errors of such models.
///
/// On a device with motors along all axes, sweeps and swing also show the axes of its actuators; see
/// find_friction_axes(). The same movements, and those at the places, show a force that repeats over the place; see
/// find_cogging(). All else is then identified without this force, which would count as noise.
///
/// Needs only the log, neither a data sheet nor a model of the device. Not real-time: it allocates.
Identification identify(const Experiment& experiment);

/// A device in the hand that holds it.
struct HeldIdentification {
  HeldModel held;        ///< zero if no model explains the response at the lines
  HeldModel half_width;  ///< half widths of the 95 % confidence intervals; zero where there is none
  /// Evidence for this model over the best one with another choice of hand and link: 2 ln of the Bayes factor. Above
  /// 10, the choice is clear; 0 if there is no model.
  double margin = 0;
};

/// Identifies the hand that holds a device, a flexible link in it, and lag and whole delay apart, from all lines of the
/// excitation signal; see fit_hand(). They should start at 4 Hz, since the resonance of a hand lies at 5 to 30 Hz.
/// `identified` is the result of identify() for the experiment.
///
/// The delay is the whole number of periods with which the model of identify() fits best with any lag from 0. A hand is
/// accepted when its evidence is clear. If the device does not respond like a mass, models with a flexible link are
/// tried, at every whole delay up to six periods. A link is accepted when its evidence is overwhelming, since a hand on
/// a light device responds in a similar way. Not real-time: it allocates.
HeldIdentification identify_held(const Experiment& experiment, const Identification& identified);

/// Identifies a coarser model for devices that do not respond like a mass at the lines: with backlash between motor and
/// handle, with links that swing, or so heavy that the excitation signal hardly moves them.
///
/// Mass, delay and friction come from the whole movement after a Gaussian kernel with a cut-off near 20 Hz: least
/// squares of the force on a, sgn v, v, x and an offset, at the delay with the smallest residual. At these frequencies
/// the backlash is small against the movement, and the mass includes everything that moves along, also the hand.
/// Confidence intervals come from the jackknife over blocks of a third of a second. Gravity, its gradient and damping
/// come from the sweeps as in identify(), where these slide; otherwise they are zero. The fit includes harmonics of the
/// position, down to a period of 10 mm: without them, cable forces that depend on position would look like a delay.
///
/// Sets `coarse`. The model fits when the half width of every mass interval is below 75 % of the mass. Test a
/// controller designed for it before use.
Identification identify_coarsely(const Experiment& experiment);

/// Returns the encoder resolution: the smallest step of the positions [m], also on a rotated lattice. 0 when no step
/// repeats.
double position_quantum(std::span<const TickRow> rows);

}  // namespace haptrace
