// Design of a tracking law from an identified device model.
#pragma once

#include "control/design/plant_model.h"
#include "control/tuning.h"

#include <string>

namespace haptrace {

/// Result of a law's trial on the device, and of the playbacks after it.
struct LawVerdict {
  bool tried = false;
  double improvement = 0;  ///< error of plain PD control over that of the law, at the place where it is smallest
  std::string refused;     ///< why the law must not be used; empty if it may
  std::string since{};     ///< time of the playback that refused it, RFC 3339; empty: refused in its trial
  double force = 0;        ///< magnitude that it sent in its trial, rms [N]; 0: not known
};

/// Parameters of a tracking law with an observer, and of plain PD control.
struct TrackingDesign {
  PdGains gains;    ///< stiff, with margins
  PdGains largest;  ///< tuning limit: half of the gains that destabilise the free device, at most 3 times `gains`
  PdGains plain;    ///< gains of a PD law without the observer, with the same margin, or stiff_gains() if the device
                    ///< bore them in a trial
  Vec3 mass = Vec3::Zero();  ///< mass in the observer, per axis of W [kg]
  double delay = 0;          ///< from the tick that commands a force to the force [s]
  double observer_hz = 0;    ///< triple pole of the state observer [Hz]
  double load_hz = 0;        ///< bandwidth of the disturbance compensation [Hz]
  double authority = 0;      ///< largest force of the disturbance compensation, magnitude [N]
  double ripple = 0;  ///< expected ripple of the command above 25 Hz from position resolution and noise, rms magnitude,
                      ///< if the tool crosses a count every few ticks [N]
  LawVerdict verdict{};     ///< on the law with an observer
  bool plain_calm = false;  ///< `plain` was tried and stayed calm
  /// Error of stiff PD control over that of the law that a playback chooses, in the trials without learning, where
  /// stiff PD control was not calm; 0: it was calm, or they were not compared.
  double stiff_error = 0;
  double stiff_ripple = 0;  ///< its largest force ripple at a place, rms [N]
  /// In a trial, plain PD control was less accurate with the model's feedforward than without it.
  bool plain_bare = false;
  double tremor = 0;  ///< peaks of the answer to the hand's tremor that calibration heard; 0: none (ServoOptions) [N]
};

/// Constraints of a design.
struct DesignOptions {
  double rate_hz = 1000;
  double max_force = 0;   ///< maximum force of the device [N]
  double max_ripple = 0;  ///< allowed ripple of the command above 25 Hz [N]; 0: that of stiff_gains()
  double bandwidth = 1;   ///< fraction of w to use; less for an inaccurate model
};

/// Returns the gains of stiff PD control: 3000 N/m and 25 N s/m, with a velocity low pass of 100 Hz.
PdGains stiff_gains();

/// Returns whether a PD law with a velocity low pass of 100 Hz is stable on the free plant, with gains up to `margin`
/// times these.
bool is_stable(const PlantModel& plant, const PdGains& gains, double margin, double rate_hz);

/// Returns the ripple of the command above 25 Hz, rms per axis, that stiff PD control makes of white noise of unit
/// standard deviation in the position, in its loop [N/m].
double plain_ripple(double rate_hz);

/// Designs the stiffest law that the plant's delay allows and whose ripple stays within its bound, per axis:
///
///     w = 0.4 / (delay + 1 / rate), kp = m w^2, kd = 1.5 m w, observer_hz = 1.5 w / (2 pi), load_hz = 5
///
/// w is lowered until a lighter (0.8) and slower (half a tick) free device is stable up to twice the gains, and until
/// the ripple from the position resolution is within its bound; then it is multiplied by `bandwidth`. The observer's
/// mass is 1.1 times the identified mass because a hand moves along. Throws Error(input) when the plant has no mass,
/// its delay is longer than LoopAnalysis::kLongestDelay periods, or a parameter is invalid.
TrackingDesign design_tracking(const PlantModel& plant, const DesignOptions& options);

}  // namespace haptrace
