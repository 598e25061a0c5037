// From what is known of a device to the numbers of a tracking law.
#pragma once

#include "control/design/plant_model.h"
#include "control/tuning.h"

namespace haptrace {

/// The numbers that a tracking law with an observer is built from.
struct TrackingDesign {
  PdGains gains;             ///< stiff, with margins
  PdGains largest;           ///< what they may be raised to: half of what makes the device alone unstable
  PdGains plain;             ///< for a PD law without the observer, likewise
  Vec3 mass = Vec3::Zero();  ///< that the observer reckons with, per axis of W [kg]
  double delay = 0;          ///< from the tick that commands a force to the force [s]
  double observer_hz = 0;    ///< triple pole of the state observer
  double load_hz = 0;        ///< bandwidth of the disturbance's compensation
  double authority = 0;      ///< largest force of the disturbance's compensation, magnitude [N]
  double ripple = 0;         ///< expected of the command above 25 Hz, from the position quantum and noise, rms
                             ///< magnitude, where the tool crosses a quantum every few ticks [N]
};

/// A device that was calibrated.
struct IdentifiedDevice {
  PlantModel plant;
  TrackingDesign design;
};

/// What a design must keep.
struct DesignOptions {
  double rate_hz = 1000;
  double max_force = 0;   ///< of the device [N]
  double max_ripple = 0;  ///< of the command above 25 Hz [N]; 0: that of a plain PD of 3000 N/m and 25 N s/m whose
                          ///< velocity is low-passed at 100 Hz
  double bandwidth = 1;   ///< share of w that is kept: less for a plant that is known badly
};

/// The stiffest law that the plant's delay allows and whose ripple stays in its bound, per axis:
///
///     w = 0.4 / (delay + 1 / rate), kp = m w^2, kd = 1.5 m w, observer_hz = 1.5 w / (2 pi), load_hz = 5
///
/// with w lowered until a lighter (0.8) and slower (half a tick) free device bears twice the gains, and the position
/// quantum makes no more ripple than allowed, and then to its `bandwidth` share. The observer's mass is 1.1 times the
/// identified: a hand goes along. Throws Error(input) when the plant has no mass, is later than
/// LoopAnalysis::kLongestDelay periods, or has a number that none can be.
TrackingDesign design_tracking(const PlantModel& plant, const DesignOptions& options);

}  // namespace haptrace
