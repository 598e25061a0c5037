// The plan of a calibration.
#pragma once

#include "control/design/multisine.h"
#include "player/calibration/calibration.h"

#include <array>
#include <span>
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

  static constexpr double kSweepHz = 2.5;    ///< frequency of the sweeps
  static constexpr double kSweepLead = 0.5;  ///< cycles before the measurement of a sweep, or of pulses, starts
  static constexpr double kPulsedHz = 2.5;   ///< frequency of the strokes under pulses
  /// Sizes of the pulses, as a share of the largest: one cycle of strokes each.
  static constexpr std::array<double, 3> kPulseSizes{0.4, 0.7, 1};
  static constexpr double kBlend = 0.3;             ///< in which a movement grows from nothing, or shrinks to it [s]
  static constexpr double kSettle = 0.4;            ///< from a change of the excitation to the first window [s]
  static constexpr double kLook = 0.75;             ///< duration of the first look [s]
  static constexpr double kShortestApproach = 0.5;  ///< [s]
  static constexpr double kMostDither = 0.12;       ///< excitation, as a share of the largest force
  static constexpr double kLargestForce = 15;       ///< bound for strong devices [N]
  /// Share of the force that is available for acceleration.
  static constexpr double kInertiaShare = 0.4;
  /// Size of the swing, as a share of the reach. A hand that is dragged along the whole reach leaves hardly any force
  /// for friction and the excitation signal if it holds firmly: the device sticks, and its mass seems two or three
  /// times its true value.
  static constexpr double kSwingSize = 0.5;

  /// Returns the size of each cycle of a sweep, as a share of the largest.
  [[nodiscard]] std::span<const double> sweep_sizes() const noexcept;
  /// Returns the number of periods of the excitation signal that are measured at the centre.
  [[nodiscard]] double dither_windows() const noexcept { return full ? 8 : 2; }
  /// Returns the frequency of the swing [Hz]. The excitation signal has no lines at its harmonics.
  [[nodiscard]] double swing_hz() const noexcept { return 2 / dither.period(); }
  /// Returns the radius of the swing, and of the circles on which laws are tried [m].
  [[nodiscard]] double swing_size() const noexcept;
};

/// Returns the largest distance of a place from the centre [m]; 0 without places.
double farthest_place(const CalibrationPlan& plan);

/// Returns the plan for a device. Throws Error(input) when the device takes no force, its largest force is unknown, its
/// workspace leaves less than 3 mm to move, or the rate is too low for the excitation signal.
CalibrationPlan plan_calibration(const DeviceInfo& device, const CalibrationOptions& options);

/// Makes a plan a full one, with the same bounds.
void lengthen(CalibrationPlan& plan);

}  // namespace haptrace
