#include "control/sample.h"

#include "base/enum_names.h"
#include "control/event_words.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;  // degrees in a radian

constexpr std::optional<Severity> kSilent;
constexpr Severity kNote = Severity::note, kWarning = Severity::warning;

/// Returns `value` with as many digits, from three on, as tell it from `other`.
std::string digits_apart(double value, double other) {
  for (int digits = 3; digits < 9; ++digits)
    if (std::string text = fmt::format("{:.{}g}", value, digits); text != fmt::format("{:.{}g}", other, digits))
      return text;
  return fmt::format("{:.3g}", value);
}

/// Holds a row for every EventCode. Events that end a session are silent here: the end itself is a warning.
constexpr EventWords kEventWords[] = {
    {EventCode::started, "started", kSilent},
    {EventCode::finished, "finished", kSilent},
    {EventCode::interrupted, "interrupted", kSilent, "", true},
    {EventCode::overrun, "overrun", kSilent},            // a few are normal; see overruns_of in player/session.cpp
    {EventCode::samples_lost, "samples_lost", kSilent},  // the recorder creates these and warns itself
    {EventCode::recovered, "recovered", kSilent},
    {EventCode::force_limit, "force_limit", kWarning, "the force was limited"},
    {EventCode::continuous_limit, "continuous_limit", kWarning, "the continuous force was limited"},
    {EventCode::velocity_limit, "velocity_limit", kSilent, "", true},
    {EventCode::deviation_limit, "deviation_limit", kSilent, "", true},
    {EventCode::deviation_over, "deviation_over", kWarning, "the hand was too far off the path"},
    {EventCode::oscillation, "oscillation", kWarning, "the loop oscillated", false, 2},
    {EventCode::warming, "warming", kNote, "the motors warmed up"},
    {EventCode::hand_resists, "hand_resists", kWarning, "the hand resisted"},
    {EventCode::hand_let_go, "hand_let_go", kNote, "the hand let go"},
    {EventCode::oscillation_stays, "oscillation_stays", kSilent, "", true, 2},
    {EventCode::not_finite, "not_finite", kSilent, "", true},
    {EventCode::device_not_ready, "device_not_ready", kWarning, "the device did not allow forces", true},
    {EventCode::device_ready, "device_ready", kSilent},
    {EventCode::device_lost, "device_lost", kSilent, "", true},  // the session also warns while it waits for the device
    {EventCode::repetition, "repetition", kSilent},
    {EventCode::mark, "mark", kSilent},
    {EventCode::paused, "paused", kSilent},  // the operator asked for it
    {EventCode::resumed, "resumed", kSilent},
    {EventCode::triggered, "triggered", kSilent},
    {EventCode::path_waits, "path_waits", kWarning, "the path waited until its next part was read"},
    {EventCode::path_unreadable, "path_unreadable", kSilent, "", true},
    {EventCode::device_found, "device_found", kNote, "the device came back"},
    {EventCode::time_over, "time_over", kNote, "the time limit was reached", true},
    {EventCode::rotation_limit, "rotation_limit", kSilent, "", true},
    {EventCode::touched, "touched", kSilent},
    {EventCode::left, "left", kSilent},
    {EventCode::reference_waits, "reference_waits", kWarning, "the reference waited for the hand"},
    {EventCode::reference_goes_on, "reference_goes_on", kSilent},
    {EventCode::states_stopped, "states_stopped", kWarning, "the device sent no fresh state, and the force faded out"},
    {EventCode::states_resumed, "states_resumed", kNote, "the device sent fresh states again"},
    {EventCode::outside_workspace, "outside_workspace", kSilent, "", true},
    {EventCode::force_resisted, "force_resisted", kWarning, "the hand resisted the force for a long time"},
    {EventCode::force_held, "force_held", kWarning,
     "the motors kept the last force because no new force could be sent"},
    {EventCode::resistance_limit, "resistance_limit", kSilent, "", true},
    {EventCode::vibrates, "vibrates", kWarning, "the force vibrated", false, 2},
    {EventCode::vibrates_regularly, "vibrates_regularly", kWarning, "the force alternated", false, 2},
    {EventCode::bounces, "bounces", kWarning, "the tool bounced", false, 2},
    {EventCode::sways, "sways", kNote, "the loop or the hand swayed", false, 2},
    {EventCode::vibration_stays, "vibration_stays", kSilent, "", true, 2},
    {EventCode::torque_vibrates, "torque_vibrates", kWarning, "the torque vibrated", false, 2},
    {EventCode::sway_over, "sway_over", kNote, "the loop and the hand were calm again", false, 2},
    {EventCode::recording_resumed, "recording_resumed", kSilent},  // the recorder creates these two and warns itself
    {EventCode::recording_ended, "recording_ended", kSilent},
    {EventCode::values_lost, "values_lost", kSilent},
    {EventCode::shown_go, "shown_go", kSilent},
    {EventCode::shown_done, "shown_done", kSilent},
    {EventCode::input, "input", kSilent},
    {EventCode::began_inside, "began_inside", kWarning, "the tool began inside objects"},
    {EventCode::initiation, "initiation", kSilent},
    {EventCode::place_in_doubt, "place_in_doubt", kNote,
     "the expert's force faded because the place on the path was in doubt"},
    {EventCode::tank_empty, "tank_empty", kWarning, "the expert's force was reduced because the energy tank was empty",
     false, 1},
};
static_assert(std::size(kEventWords) <= kMostEventKinds);

}  // namespace

std::span<const EventWords> event_words() noexcept {
  return kEventWords;
}

const EventWords* words_of(EventCode code) noexcept {
  const auto* found = std::find_if(std::begin(kEventWords), std::end(kEventWords),
                                   [code](const EventWords& words) { return words.code == code; });
  return found == std::end(kEventWords) ? nullptr : found;
}

const char* to_string(StopSource source) noexcept {
  static constexpr EnumNames<StopSource, 4> kSources{"source of a stop", {"user", "page", "lost_page", "command"}};
  return kSources.name(source);
}

const char* interruption_text(StopSource source) noexcept {
  switch (source) {
    case StopSource::page:
      return "interrupted by a page of the view";
    case StopSource::lost_page:
      return "interrupted because the controlling page is silent";
    case StopSource::command:
      return "interrupted by a command";
    case StopSource::user:
      break;
  }
  return "interrupted";
}

bool is_of_event(std::string_view warning_code) noexcept {
  return std::any_of(std::begin(kEventWords), std::end(kEventWords),
                     [warning_code](const EventWords& words) { return words.severity && warning_code == words.name; });
}

Warning warning_of(const EventWords& words, const EventCount& events) {
  const double time = 1e-9 * static_cast<double>(events.first.time_ns);
  Warning warning{words.severity.value_or(Severity::note), words.name, time, {}};
  if (events.count < 2) {
    warning.text = fmt::format("{}, at {:.1f} s", describe(events.first), time);
    return warning;
  }
  warning.text = fmt::format("{} {} times, first at {:.1f} s", words.repeated, events.count, time);
  if (words.share >= 0) warning.text += "; last: " + describe(events.last);
  return warning;
}

void EventTally::push(const Event& event) noexcept {
  const EventWords* words = words_of(event.code);
  if (words == nullptr || !words->severity) return;
  EventCount& kind = counts_[static_cast<std::size_t>(words - std::begin(kEventWords))];
  if (kind.count++ == 0) kind.first = event;
  kind.last = event;
  mailbox_.post(counts_);
}

std::string describe(const Event& event) {
  const auto& [a, b, c] = event.values;
  switch (event.code) {
    case EventCode::started:
      return "started";
    case EventCode::finished:
      return "finished";
    case EventCode::interrupted:
      return std::string(interruption_text(a > 0 && a < 4 ? static_cast<StopSource>(a) : StopSource::user)) +
             ": releasing";
    case EventCode::overrun:
      if (std::isfinite(c))
        return fmt::format("overrun: {:.0f} ticks missed, the exchange with the device took {:.1f} ms", a, 1e3 * c);
      return fmt::format("overrun: {:.0f} ticks missed, woke {:.3f} ms late", a, 1e3 * b);
    case EventCode::samples_lost:
      return fmt::format("{:.0f} samples lost: the writer could not keep up", a);
    case EventCode::recovered:
      return fmt::format("recovered after its writer died: {:.0f} samples kept, {:.0f} could not be read", a, b);
    case EventCode::force_limit:
      return fmt::format("force limited: {} N requested, {} N allowed", digits_apart(a, b), digits_apart(b, a));
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
      if (std::isfinite(c))
        return fmt::format("the clamp went off: the hand was {:.1f} mm off, the limit is {:.1f} mm", 1e3 * a, 1e3 * b);
      return fmt::format("{:.1f} mm off the path, the limit is {:.1f} mm", 1e3 * a, 1e3 * b);
    case EventCode::oscillation:
      if (!std::isfinite(c)) return fmt::format("the loop oscillates at {:.0f} Hz, {:.2f} mm", b, 1e3 * a);
      return fmt::format("the loop oscillates at {:.0f} Hz, {:.2f} mm: gains softened to {:.0f} %", b, 1e3 * a,
                         100 * c);
    case EventCode::oscillation_stays:
      return fmt::format("the loop still oscillates at {:.0f} Hz, {:.2f} mm with {:.0f} % of its gains", b, 1e3 * a,
                         100 * c);
    case EventCode::warming:
      if (std::isfinite(b) && b < 1)
        return fmt::format("motors warm: {:.0f} % of the heat at which the force is limited, reached now", 100 * a);
      if (!std::isfinite(b))
        return fmt::format("motors warm: {:.0f} % of the heat at which the force is limited", 100 * a);
      return fmt::format(
          "motors warm: {:.0f} % of the heat at which the force is limited; at this force they reach it in {:.0f} s",
          100 * a, b);
    case EventCode::hand_resists:
      return fmt::format("the hand resists with {:.1f} N for {:.1f} s", a, b);
    case EventCode::hand_let_go:
      return fmt::format("the hand let go: the load fell by {:.1f} N from {:.1f} N", a, b);
    case EventCode::not_finite:
      return a == 0 ? "stopped: the device's position is not finite" : "stopped: the controller's force is not finite";
    case EventCode::device_not_ready:
      return "the device does not allow forces";
    case EventCode::device_ready:
      return fmt::format("the device was ready after {:.3g} s", a);
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
      return fmt::format("the path waits at {:.3f} s: its next part was not read in time", a);
    case EventCode::path_unreadable:
      return fmt::format("stopped: the path cannot be played beyond {:.3f} s", a);
    case EventCode::time_over:
      if (std::isfinite(c)) return fmt::format("the hand did not hold still in the start within {:.0f} s", c);
      if (!std::isfinite(b)) return fmt::format("the time limit was reached at {:.3f} m", a);
      return fmt::format("the time limit was reached at {:.3f} m of {:.3f} m", a, b);
    case EventCode::rotation_limit:
      return fmt::format("stopped: the tool points {:.1f} degrees off, the limit is {:.1f}", kDegrees * a,
                         kDegrees * b);
    case EventCode::touched:
      return fmt::format("object {:.0f} touched: {:.2f} N", a + 1, b);
    case EventCode::began_inside:
      return fmt::format("the tool began inside object {:.0f}, which pushes it out softly: {:.2f} mm deep", a + 1,
                         1e3 * b);
    case EventCode::initiation:
      if (a == 1)
        return fmt::format("the trainee started alone after {:.2f} s; the back wall did {:.2g} J of work", b, c);
      if (a == 2) return fmt::format("the back wall started the trainee after {:.2f} s and did {:.2g} J of work", b, c);
      return fmt::format("the trainee did not start within {:.2f} s; the back wall did {:.2g} J of work", b, c);
    case EventCode::place_in_doubt:
      return fmt::format(
          "the place on the path is in doubt for {:.1f} s, {:.3f} m or {:.3f} m: the expert's force fades", a, b, c);
    case EventCode::tank_empty:
      if (std::isfinite(c))
        return fmt::format(
            "the energy tank is empty for {:.1f} s: {:.0f} % of the force field remain; a larger `energy` of the reach "
            "keeps it",
            a, 100 * b);
      return fmt::format(
          "the energy tank is empty for {:.1f} s: {:.0f} % of the expert's force and of the help remain; a larger "
          "--energy keeps them",
          a, 100 * b);
    case EventCode::left:
      return fmt::format("object {:.0f} left: {:.2f} mm deep at most, {:.2f} s", a + 1, 1e3 * b, c);
    case EventCode::reference_waits:
      return fmt::format("the reference waits for the hand: {:.1f} mm off the path, the limit is {:.1f} mm", 1e3 * a,
                         1e3 * b);
    case EventCode::reference_goes_on:
      return "the hand is back: the reference continues";
    case EventCode::states_stopped:
      return fmt::format("no fresh state from the device for {:.0f} ms: the force fades to zero", 1e3 * a);
    case EventCode::states_resumed:
      return fmt::format("the device sends fresh states again after {:.0f} ms: the force fades in", 1e3 * a);
    case EventCode::outside_workspace:
      return fmt::format(
          "stopped: the device's position is {:.3g} m from the centre of its workspace, and no hand reaches beyond "
          "{:.3g} m",
          a, b);
    case EventCode::force_resisted:
      if (std::isnan(a)) return fmt::format("the hand does not yield: the session ends in {:.0f} s", b);
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
      return fmt::format("the loop or the hand sways at {:.1f} Hz, {:.2g} N: feedback softened to {:.0f} % for now", b,
                         a, 100 * c);
    case EventCode::vibration_stays:
      return fmt::format("stopped: the force still vibrates at {:.0f} Hz, {:.2g} N rms with {:.0f} % of the feedback",
                         b, a, 100 * c);
    case EventCode::torque_vibrates:
      return fmt::format("the torque vibrates at {:.0f} Hz, {:.2g} N m rms: feedback softened to {:.0f} %", b, a,
                         100 * c);
    case EventCode::sway_over:
      return fmt::format("the loop and the hand are calm again: feedback back at {:.0f} %", 100 * c);
    case EventCode::recording_resumed:
      return fmt::format(
          "recording continues in a further file: its file could not be written for {:.2f} s, {:.0f} samples are "
          "missing",
          a, b);
    case EventCode::recording_ended:
      return "the recording ends here: there is no room left for it";
    case EventCode::values_lost:
      return "values could not be recovered";
    case EventCode::shown_go:
      return "go shown";
    case EventCode::shown_done:
      return "done shown";
    case EventCode::force_held:
      return fmt::format("no force could be sent for {:.0f} ms: the motors kept {:.1f} N", 1e3 * a, b);
    case EventCode::input: {
      constexpr std::array kInputs{"mouse", "pen", "touch", "gamepad", "keys"};
      const bool known = a >= 1 && a <= static_cast<double>(kInputs.size());
      return fmt::format("input: {}, depth from {}", known ? kInputs[static_cast<std::size_t>(a) - 1] : "unknown",
                         b == 1 ? "path" : "a plane");
    }
  }
  return fmt::format("event {}", static_cast<int>(event.code));
}

}  // namespace haptrace
