#include "player/calibration/calibration_plan.h"

#include "base/error.h"
#include "player/playback/approach.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr double kPeriod = 1.5;           // period of the excitation signal [s]
constexpr double kLongPeriod = 2;         // period at low loop rates, which leave fewer lines per period [s]
constexpr double kLowestLine = 15;        // above what a hand does of its own accord, and most grips [Hz]
constexpr double kHighestLine = 120;      // [Hz]
constexpr double kLargestReach = 0.02;    // [m]
constexpr double kSmallestReach = 0.003;  // [m]
constexpr double kPlaceShare = 0.6;       // distance of a place from the centre, as a share of the room
constexpr double kFarthestPlace = 0.06;   // [m]
constexpr double kDitherOfForce =
    CalibrationPlan::kMostDither / 0.7;  // share of the permitted force; peaks of three axes: 6 rms
constexpr double kLargestDither = 2;     // rms per axis [N]

constexpr std::array<double, 3> kQuickSizes{1, 0.5, 1};
constexpr std::array<double, 16> kFullSizes{1, 0.5, 0.75, 0.35, 1, 0.5, 0.75, 0.35,
                                            1, 0.5, 0.75, 0.35, 1, 0.5, 0.75, 0.35};

/// Returns half of the width of the workspace along an axis [m].
double half_width(const DeviceInfo& device, int axis) {
  return 0.5 * (device.workspace_max[axis] - device.workspace_min[axis]);
}

/// Sets the centre and the reach along every axis of the plan. Throws Error(input) if the workspace is too small.
void set_reach(const DeviceInfo& device, CalibrationPlan& plan) {
  for (int axis = 0; axis < 3; ++axis) {
    if (!plan.axes[static_cast<std::size_t>(axis)]) continue;
    const double room = half_width(device, axis);
    plan.centre[axis] = 0.5 * (device.workspace_max[axis] + device.workspace_min[axis]);
    plan.reach[axis] = std::min(kLargestReach, 0.4 * room);
    if (!(plan.reach[axis] >= kSmallestReach))
      throw input_error(fmt::format("the workspace of {} is {:.1f} mm wide in {}: calibration needs at least {:.0f} mm",
                                    device.name, 2e3 * room, "xyz"[axis], 2e3 * kSmallestReach / 0.4));
  }
}

/// Adds the places around the centre, first the nearer and then the farthest ones.
void add_places(const DeviceInfo& device, CalibrationPlan& plan) {
  // Opposite places of an axis are not visited one after the other.
  std::vector<Vec3> farthest;
  for (const double side : {1.0, -1.0})
    for (int axis = 0; axis < 3; ++axis) {
      if (!plan.axes[static_cast<std::size_t>(axis)]) continue;
      if (const double off = std::min(kPlaceShare * half_width(device, axis), kFarthestPlace); off > plan.reach[axis])
        farthest.push_back(plan.centre + side * off * Vec3::Unit(axis));
    }
  // Places half as far away show how the mass goes there, and what to expect beyond. One along each axis is enough.
  for (const Vec3& place : farthest) {
    const Vec3 half = 0.5 * (place - plan.centre);
    Eigen::Index axis = 0;
    if (const double off = half.cwiseAbs().maxCoeff(&axis); off > plan.reach[axis] && (half[axis] > 0) == (axis != 1))
      plan.places.push_back(plan.centre + half);
  }
  plan.nearer_places = plan.places.size();
  plan.places.insert(plan.places.end(), farthest.begin(), farthest.end());
}

/// Returns the duration of the planned session [s].
double planned_duration(const CalibrationPlan& plan) {
  const auto axes = static_cast<int>(std::ranges::count(plan.axes, true));
  const double sweep = 0.5 + static_cast<double>(plan.sweep_sizes().size());
  double duration = 3 * CalibrationPlan::kBlend + 2 * CalibrationPlan::kSettle + CalibrationPlan::kLook +
                    plan.dither_windows() * plan.dither.period() + axes * sweep / CalibrationPlan::kSweepHz;
  if (plan.pulses)
    duration += axes * (0.5 + static_cast<double>(CalibrationPlan::kPulseSizes.size())) / CalibrationPlan::kPulsedHz;
  Vec3 from = plan.centre;
  for (const Vec3& place : plan.places) {
    duration += Approach(from, place, plan.approach_speed, CalibrationPlan::kShortestApproach).duration() +
                CalibrationPlan::kSettle + plan.dither.period() + CalibrationPlan::kBlend;
    from = place;
  }
  if (!plan.places.empty())
    duration += Approach(from, plan.centre, plan.approach_speed, CalibrationPlan::kShortestApproach).duration();
  return duration;
}

}  // namespace

std::span<const double> CalibrationPlan::sweep_sizes() const noexcept {
  return full ? std::span<const double>(kFullSizes) : std::span<const double>(kQuickSizes);
}

double CalibrationPlan::swing_size() const noexcept {
  double size = kLargestReach;
  for (int axis = 0; axis < 3; ++axis)
    if (axes[static_cast<std::size_t>(axis)]) size = std::min(size, reach[axis]);
  return CalibrationPlan::kSwingSize * size;
}

double farthest_place(const CalibrationPlan& plan) {
  double farthest = 0;
  for (const Vec3& place : plan.places) farthest = std::max(farthest, (place - plan.centre).norm());
  return farthest;
}

CalibrationPlan plan_calibration(const DeviceInfo& device, const CalibrationOptions& options) {
  const double rate = options.session.loop.rate_hz;
  if (!(options.force_share >= 0.1 && options.force_share <= 1))
    throw input_error(fmt::format("the share of the force is {}; it must be from 0.1 to 1", options.force_share));
  if (!device.force_axes[0] && !device.force_axes[1] && !device.force_axes[2])
    throw input_error(device.name + " takes no force: there is nothing to calibrate");
  const double asked = options.session.loop.limits.max_force;
  double force = device.max_force;
  if (asked > 0) force = force > 0 ? std::min(force, asked) : asked;
  if (!(force > 0))
    throw input_error(fmt::format("{} does not state its largest force; give it with --max-force", device.name));

  const double highest = std::min(kHighestLine, rate / 6);
  const double most = std::min(options.force_share * force, CalibrationPlan::kLargestForce);
  CalibrationPlan plan{
      .full = options.full,
      .rate_hz = rate,
      .axes = device.force_axes,
      .max_force = most,
      .device_force = force,
      .max_dither = std::min({CalibrationPlan::kMostDither * force, kDitherOfForce * most, kLargestDither}),
      .dither = Multisine(kLowestLine, highest, highest < kHighestLine ? kLongPeriod : kPeriod, device.force_axes)};
  set_reach(device, plan);
  plan.pulses = options.places;
  if (options.places) add_places(device, plan);
  plan.max_speed = kTwoPi * plan.reach.maxCoeff();  // one circle with the radius of the reach per second
  plan.max_deviation = std::max(2 * plan.reach.maxCoeff(), 0.02);
  plan.duration = planned_duration(plan);
  return plan;
}

void lengthen(CalibrationPlan& plan) {
  plan.full = true;
  plan.duration = planned_duration(plan);
}

}  // namespace haptrace
