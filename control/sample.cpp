#include "control/sample.h"

#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;  // in a radian

}  // namespace

std::string describe(const Event& event) {
  const auto& [a, b, c] = event.values;
  switch (event.code) {
    case EventCode::started:
      return "started";
    case EventCode::finished:
      return "finished";
    case EventCode::interrupted:
      return "interrupted: releasing";
    case EventCode::overrun:
      return fmt::format("overrun: {:.0f} ticks missed, woke {:.3f} ms late", a, 1e3 * b);
    case EventCode::samples_lost:
      return fmt::format("{:.0f} samples lost: the writer could not keep up", a);
    case EventCode::recovered:
      return fmt::format("recovered after its writer died: {:.0f} samples kept, {:.0f} could not be read", a, b);
    case EventCode::force_limit:
      return fmt::format("force limited: {:.3g} N asked, {:.3g} N allowed", a, b);
    case EventCode::continuous_limit:
      if (c == 1) return fmt::format("continuous torque limited to {:.3g} N m", a);
      if (b > 0)
        return fmt::format(
            "continuous force limited to {:.3g} N: the device states no continuous force, {:.3g} N are assumed", a, b);
      return fmt::format("continuous force limited to {:.3g} N", a);
    case EventCode::velocity_limit:
      return fmt::format("stopped: {:.3g} m/s is over the limit of {:.3g} m/s", a, b);
    case EventCode::deviation_limit:
      return fmt::format("stopped: {:.1f} mm off the path, the limit is {:.1f} mm", 1e3 * a, 1e3 * b);
    case EventCode::deviation_over:
      return fmt::format("{:.1f} mm off the path, the limit is {:.1f} mm", 1e3 * a, 1e3 * b);
    case EventCode::oscillation:
      if (!std::isfinite(c)) return fmt::format("oscillates at {:.0f} Hz, {:.2f} mm", b, 1e3 * a);
      return fmt::format("oscillates at {:.0f} Hz, {:.2f} mm: gains softened to {:.0f} %", b, 1e3 * a, 100 * c);
    case EventCode::oscillation_stays:
      return fmt::format("still oscillates at {:.0f} Hz, {:.2f} mm with {:.0f} % of its gains", b, 1e3 * a, 100 * c);
    case EventCode::warming:
      if (!std::isfinite(b))
        return fmt::format("motors warm: {:.0f} % of the heat from which they are limited", 100 * a);
      return fmt::format("motors warm: {:.0f} % of the heat from which they are limited, in {:.0f} s", 100 * a, b);
    case EventCode::hand_resists:
      return fmt::format("the hand resists with {:.1f} N for {:.1f} s", a, b);
    case EventCode::hand_let_go:
      return fmt::format("the hand let go: the load fell by {:.1f} N from {:.1f} N", a, b);
    case EventCode::not_finite:
      return a == 0 ? "stopped: the device's position is not finite" : "stopped: the controller's force is not finite";
    case EventCode::device_not_ready:
      return "the device does not allow forces";
    case EventCode::device_ready:
      return "the device allows forces";
    case EventCode::device_lost:
      return std::isfinite(a) ? fmt::format("the device did not come back within {:.3g} s", a) : "the device was lost";
    case EventCode::device_found:
      return fmt::format("the device is back after {:.3f} s", a);
    case EventCode::repetition:
      return fmt::format("repetition {:.0f}", a + 1);
    case EventCode::mark:
      return "mark";
    case EventCode::paused:
      return "paused";
    case EventCode::resumed:
      return "resumed";
    case EventCode::triggered:
      if (a == 0) return fmt::format("triggered: a force of {:.3g} N is over {:.3g} N", b, event.values[2]);
      if (a == 1) return fmt::format("triggered: a speed of {:.3g} m/s is over {:.3g} m/s", b, event.values[2]);
      return "triggered: a button was pressed";
    case EventCode::path_waits:
      return fmt::format("the path waits at {:.3f} s: what follows was not read in time", a);
    case EventCode::path_unreadable:
      return fmt::format("stopped: the path cannot be played beyond {:.3f} s", a);
    case EventCode::time_over:
      return fmt::format("the time is over at {:.3f} m of {:.3f} m", a, b);
    case EventCode::rotation_limit:
      return fmt::format("stopped: the tool points {:.1f} degrees off, the limit is {:.1f}", kDegrees * a,
                         kDegrees * b);
    case EventCode::touched:
      return fmt::format("object {:.0f} touched: {:.2g} N", a + 1, b);
    case EventCode::left:
      return fmt::format("object {:.0f} left: {:.2f} mm deep at most, {:.2f} s", a + 1, 1e3 * b, c);
    case EventCode::reference_waits:
      return fmt::format("the reference waits for the hand: {:.1f} mm off the path, the limit is {:.1f} mm", 1e3 * a,
                         1e3 * b);
    case EventCode::reference_goes_on:
      return "the hand is back: the reference goes on";
    case EventCode::states_stopped:
      return fmt::format("no fresh state from the device for {:.0f} ms: the force fades to zero", 1e3 * a);
    case EventCode::states_resumed:
      return fmt::format("fresh states again after {:.0f} ms: the force fades in", 1e3 * a);
    case EventCode::outside_workspace:
      return fmt::format(
          "stopped: the device's position is {:.3g} m from the centre of its workspace, no hand reaches beyond {:.3g} "
          "m",
          a, b);
    case EventCode::force_resisted:
      return fmt::format("the hand resists the force: it falls to {:.1f} N, and the session ends in {:.0f} s", a, b);
    case EventCode::resistance_limit:
      return fmt::format("stopped: the hand resisted the force for {:.0f} s", a);
    case EventCode::vibrates:
      return fmt::format("the force vibrates at {:.0f} Hz, {:.2g} N rms: feedback softened to {:.0f} %", b, a, 100 * c);
    case EventCode::vibrates_regularly:
      return fmt::format("the force alternates at {:.0f} Hz, {:.2g} N rms: feedback softened to {:.0f} %", b, a,
                         100 * c);
    case EventCode::bounces:
      return fmt::format("the tool bounces at {:.1f} Hz, {:.2g} N: feedback softened to {:.0f} %", b, a, 100 * c);
    case EventCode::sways:
      return fmt::format("loop or hand sways at {:.1f} Hz, {:.2g} N: feedback at {:.0f} % for now", b, a, 100 * c);
    case EventCode::vibration_stays:
      return fmt::format("stopped: the force still vibrates at {:.0f} Hz, {:.2g} N rms with {:.0f} % of the feedback",
                         b, a, 100 * c);
    case EventCode::torque_vibrates:
      return fmt::format("the torque vibrates at {:.0f} Hz, {:.2g} N m rms: feedback softened to {:.0f} %", b, a,
                         100 * c);
  }
  return fmt::format("event {}", static_cast<int>(event.code));
}

}  // namespace haptrace
