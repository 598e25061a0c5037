// The plan of a calibration.
#pragma once

#include "control/design/multisine.h"
#include "player/calibration/calibration.h"

#include <array>
#include <vector>

namespace haptrace {

/// Movement, forces and bounds of a calibration.
struct CalibrationPlan {
  bool full = false;
  bool pulses = false;  ///< with strokes under pulses of force along every axis, which show how much the motors give
  double rate_hz = 1000;
  std::array<bool, 3> axes{};     ///< axes that take a force
  Vec3 centre = Vec3::Zero();     ///< centre of the movements: the middle of the workspace [m]
  Vec3 reach = Vec3::Zero();      ///< largest distance from the centre, per axis [m]
  std::vector<Vec3> places;       ///< places around the centre that are visited after the sweeps [m]
  std::size_t nearer_places = 0;  ///< number of them that are half as far away as the others, and come first
  double max_force = 0;           ///< bound on the magnitude [N]
  double device_force = 0;        ///< largest force that the device and the session's limits allow [N]
  double max_dither = 0;          ///< bound on the excitation signal, rms per axis [N]
  double max_speed = 0;           ///< peak speed of the sweeps [m/s]
  double max_deviation = 0;       ///< distance from the reference beyond which the session stops [m]
  double approach_speed = 0.1;    ///< peak speed of the approach [m/s]
  double duration = 0;            ///< without the approach to the centre [s]
  Multisine dither;
};

/// Returns the largest distance of a place from the centre [m]; 0 without places.
double farthest_place(const CalibrationPlan& plan);

/// Returns the plan for a device. Throws Error(input) when the device takes no force, its largest force is unknown, its
/// workspace leaves less than 3 mm to move, or the rate is too low for the excitation signal.
CalibrationPlan plan_calibration(const DeviceInfo& device, const CalibrationOptions& options);

}  // namespace haptrace
