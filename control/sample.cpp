#include "control/sample.h"

#include "base/enum_names.h"
#include "control/event_words.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <iterator>
#include <numbers>
#include <string>

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
    {EventCode::feedback_renewed, "feedback_renewed", kNote, "plain PD control replaced a law that vibrated", false, 1},
};
static_assert(std::size(kEventWords) <= kMostEventKinds);

// --- Texts of events ---

using EventValues = std::array<double, 3>;

std::string interrupted_text(const EventValues& v) {
  const StopSource source = v[0] > 0 && v[0] < 4 ? static_cast<StopSource>(v[0]) : StopSource::user;
  return std::string(interruption_text(source)) + ": releasing";
}

std::string overrun_text(const EventValues& v) {
  const auto& [missed, late, exchange] = v;
  if (std::isfinite(exchange))
    return fmt::format("overrun: {:.0f} ticks missed, the exchange with the device took {:.1f} ms", missed,
                       1e3 * exchange);
  return fmt::format("overrun: {:.0f} ticks missed, woke {:.3f} ms late", missed, 1e3 * late);
}

std::string force_limit_text(const EventValues& v) {
  return fmt::format("force limited: {} N requested, {} N allowed", digits_apart(v[0], v[1]), digits_apart(v[1], v[0]));
}

std::string continuous_limit_text(const EventValues& v) {
  const auto& [allowed, assumed, is_torque] = v;
  if (is_torque == 1) return fmt::format("continuous torque limited to {:.3g} N m", allowed);
  if (assumed > 0)
    return fmt::format(
        "continuous force limited to {:.3g} N: the device states no continuous force, {:.3g} N are assumed", allowed,
        assumed);
  return fmt::format("continuous force limited to {:.3g} N", allowed);
}

std::string deviation_over_text(const EventValues& v) {
  if (v[2] == 2)
    return fmt::format("the lock gave way: it was pressed off by {:.1f} mm, and it holds up to {:.1f} mm", 1e3 * v[0],
                       1e3 * v[1]);
  if (std::isfinite(v[2]))
    return fmt::format("the clamp went off: the hand was {:.1f} mm off, the limit is {:.1f} mm", 1e3 * v[0],
                       1e3 * v[1]);
  return fmt::format("{:.1f} mm off the path, the limit is {:.1f} mm", 1e3 * v[0], 1e3 * v[1]);
}

std::string oscillation_text(const EventValues& v) {
  const auto& [amplitude, frequency, share] = v;
  if (!std::isfinite(share))
    return fmt::format("the loop oscillates at {:.0f} Hz, {:.2f} mm", frequency, 1e3 * amplitude);
  return fmt::format("the loop oscillates at {:.0f} Hz, {:.2f} mm: gains softened to {:.0f} %", frequency,
                     1e3 * amplitude, 100 * share);
}

std::string warming_text(const EventValues& v) {
  const double heat = v[0], left = v[1];
  if (std::isfinite(left) && left < 1)
    return fmt::format("motors warm: {:.0f} % of the heat at which the force is limited, reached now", 100 * heat);
  if (!std::isfinite(left))
    return fmt::format("motors warm: {:.0f} % of the heat at which the force is limited", 100 * heat);
  return fmt::format(
      "motors warm: {:.0f} % of the heat at which the force is limited; at this force they reach it in {:.0f} s",
      100 * heat, left);
}

std::string not_finite_text(const EventValues& v) {
  return v[0] == 0 ? "stopped: the device's position is not finite" : "stopped: the controller's force is not finite";
}

std::string device_lost_text(const EventValues& v) {
  return std::isfinite(v[0]) ? fmt::format("the device did not come back within {:.3g} s", v[0])
                             : "the device was lost";
}

std::string repetition_text(const EventValues& v) {
  return fmt::format("repetition {:.0f}", v[0] + 1);
}

std::string triggered_text(const EventValues& v) {
  const auto& [cause, value, threshold] = v;
  if (cause == 0) return fmt::format("triggered: a force of {:.3g} N is over {:.3g} N", value, threshold);
  if (cause == 1) return fmt::format("triggered: a speed of {:.3g} m/s is over {:.3g} m/s", value, threshold);
  return "triggered: a button was pressed";
}

std::string time_over_text(const EventValues& v) {
  const auto& [reached, length, start] = v;
  if (std::isfinite(start)) return fmt::format("the hand did not hold still in the start within {:.0f} s", start);
  if (!std::isfinite(length)) return fmt::format("the time limit was reached at {:.3f} m", reached);
  return fmt::format("the time limit was reached at {:.3f} m of {:.3f} m", reached, length);
}

// Scenes number their objects from 1 in texts.
std::string touched_text(const EventValues& v) {
  return fmt::format("object {:.0f} touched: {:.2f} N", v[0] + 1, v[1]);
}

std::string left_text(const EventValues& v) {
  return fmt::format("object {:.0f} left: {:.2f} mm deep at most, {:.2f} s", v[0] + 1, 1e3 * v[1], v[2]);
}

std::string began_inside_text(const EventValues& v) {
  return fmt::format("the tool began inside object {:.0f}, which pushes it out softly: {:.2f} mm deep", v[0] + 1,
                     1e3 * v[1]);
}

std::string force_resisted_text(const EventValues& v) {
  const double allowed = v[0], left = v[1];
  if (std::isnan(allowed)) return fmt::format("the hand does not yield: the session ends in {:.0f} s", left);
  return fmt::format("the hand resists the force: it falls to {:.1f} N, and the session ends in {:.0f} s", allowed,
                     left);
}

std::string input_text(const EventValues& v) {
  constexpr std::array kInputs{"mouse", "pen", "touch", "gamepad", "keys"};
  const bool known = v[0] >= 1 && v[0] <= static_cast<double>(kInputs.size());
  return fmt::format("input: {}, depth from {}", known ? kInputs[static_cast<std::size_t>(v[0]) - 1] : "unknown",
                     v[1] == 1 ? "path" : "a plane");
}

std::string initiation_text(const EventValues& v) {
  const auto& [initiator, waited, work] = v;
  if (initiator == 1)
    return fmt::format("the trainee started alone after {:.2f} s; the back wall did {:.2g} J of work", waited, work);
  if (initiator == 2)
    return fmt::format("the back wall started the trainee after {:.2f} s and did {:.2g} J of work", waited, work);
  return fmt::format("the trainee did not start within {:.2f} s; the back wall did {:.2g} J of work", waited, work);
}

std::string tank_empty_text(const EventValues& v) {
  const auto& [duration, share, of_reach] = v;
  if (std::isfinite(of_reach))
    return fmt::format(
        "the energy tank is empty for {:.1f} s: {:.0f} % of the force field remain; a larger `energy` of the reach "
        "keeps it",
        duration, 100 * share);
  return fmt::format(
      "the energy tank is empty for {:.1f} s: {:.0f} % of the expert's force and of the help remain; a larger "
      "--energy keeps them",
      duration, 100 * share);
}

/// The text of an event of one kind: a template of its values, each times its scale, or a function of the values where
/// the words depend on them.
struct EventText {
  constexpr EventText(EventCode of, const char* with, const EventValues& times = {1, 1, 1})
      : code(of), words(with), scale(times) {}
  constexpr EventText(EventCode of, std::string (*words_by_value)(const EventValues&))
      : code(of), by_value(words_by_value) {}

  [[nodiscard]] std::string text(const EventValues& v) const {
    if (by_value != nullptr) return by_value(v);
    return fmt::format(fmt::runtime(words), scale[0] * v[0], scale[1] * v[1], scale[2] * v[2]);
  }

  EventCode code;
  const char* words = "";
  EventValues scale{1, 1, 1};
  std::string (*by_value)(const EventValues&) = nullptr;
};

/// Holds the text of every row of kEventWords, in the same order.
constexpr EventText kEventTexts[] = {
    {EventCode::started, "started"},
    {EventCode::finished, "finished"},
    {EventCode::interrupted, interrupted_text},
    {EventCode::overrun, overrun_text},
    {EventCode::samples_lost, "{0:.0f} samples lost: the writer could not keep up"},
    {EventCode::recovered, "recovered after its writer died: {0:.0f} samples kept, {1:.0f} could not be read"},
    {EventCode::force_limit, force_limit_text},
    {EventCode::continuous_limit, continuous_limit_text},
    {EventCode::velocity_limit, "stopped: {0:.3g} m/s is over the limit of {1:.3g} m/s"},
    {EventCode::deviation_limit, "stopped: {0:.1f} mm off the path, the limit is {1:.1f} mm", {1e3, 1e3, 1}},
    {EventCode::deviation_over, deviation_over_text},
    {EventCode::oscillation, oscillation_text},
    {EventCode::warming, warming_text},
    {EventCode::hand_resists, "the hand resists with {0:.1f} N for {1:.1f} s"},
    {EventCode::hand_let_go, "the hand let go: the load fell by {0:.1f} N from {1:.1f} N"},
    {EventCode::oscillation_stays,
     "the loop still oscillates at {1:.0f} Hz, {0:.2f} mm with {2:.0f} % of its gains",
     {1e3, 1, 100}},
    {EventCode::not_finite, not_finite_text},
    {EventCode::device_not_ready, "the device does not allow forces"},
    {EventCode::device_ready, "the device was ready after {0:.3g} s"},
    {EventCode::device_lost, device_lost_text},
    {EventCode::repetition, repetition_text},
    {EventCode::mark, "mark"},
    {EventCode::paused, "paused"},
    {EventCode::resumed, "resumed"},
    {EventCode::triggered, triggered_text},
    {EventCode::path_waits, "the path waits at {0:.3f} s: its next part was not read in time"},
    {EventCode::path_unreadable, "stopped: the path cannot be played beyond {0:.3f} s"},
    {EventCode::device_found, "the device is back after {0:.3f} s"},
    {EventCode::time_over, time_over_text},
    {EventCode::rotation_limit,
     "stopped: the tool points {0:.1f} degrees off, the limit is {1:.1f}",
     {kDegrees, kDegrees, 1}},
    {EventCode::touched, touched_text},
    {EventCode::left, left_text},
    {EventCode::reference_waits,
     "the reference waits for the hand: {0:.1f} mm off the path, the limit is {1:.1f} mm",
     {1e3, 1e3, 1}},
    {EventCode::reference_goes_on, "the hand is back: the reference continues"},
    {EventCode::states_stopped, "no fresh state from the device for {0:.0f} ms: the force fades to zero", {1e3, 1, 1}},
    {EventCode::states_resumed,
     "the device sends fresh states again after {0:.0f} ms: the force fades in",
     {1e3, 1, 1}},
    {EventCode::outside_workspace,
     "stopped: the device's position is {0:.3g} m from the centre of its workspace, and no hand reaches beyond "
     "{1:.3g} m"},
    {EventCode::force_resisted, force_resisted_text},
    {EventCode::force_held, "no force could be sent for {0:.0f} ms: the motors kept {1:.1f} N", {1e3, 1, 1}},
    {EventCode::resistance_limit, "stopped: the hand resisted the force for {0:.0f} s"},
    {EventCode::vibrates,
     "the force vibrates at {1:.0f} Hz, {0:.2g} N rms: feedback softened to {2:.0f} %",
     {1, 1, 100}},
    {EventCode::vibrates_regularly,
     "the force alternates at {1:.0f} Hz, {0:.2g} N rms: feedback softened to {2:.0f} %",
     {1, 1, 100}},
    {EventCode::bounces, "the tool bounces at {1:.1f} Hz, {0:.2g} N: feedback softened to {2:.0f} %", {1, 1, 100}},
    {EventCode::sways,
     "the loop or the hand sways at {1:.1f} Hz, {0:.2g} N: feedback softened to {2:.0f} % for now",
     {1, 1, 100}},
    {EventCode::vibration_stays,
     "stopped: the force still vibrates at {1:.0f} Hz, {0:.2g} N rms with {2:.0f} % of the feedback",
     {1, 1, 100}},
    {EventCode::torque_vibrates,
     "the torque vibrates at {1:.0f} Hz, {0:.2g} N m rms: feedback softened to {2:.0f} %",
     {1, 1, 100}},
    {EventCode::sway_over, "the loop and the hand are calm again: feedback back at {2:.0f} %", {1, 1, 100}},
    {EventCode::recording_resumed,
     "recording continues in a further file: its file could not be written for {0:.2f} s, {1:.0f} samples are "
     "missing"},
    {EventCode::recording_ended, "the recording ends here: there is no room left for it"},
    {EventCode::values_lost, "values could not be recovered"},
    {EventCode::shown_go, "go shown"},
    {EventCode::shown_done, "done shown"},
    {EventCode::input, input_text},
    {EventCode::began_inside, began_inside_text},
    {EventCode::initiation, initiation_text},
    {EventCode::place_in_doubt,
     "the place on the path is in doubt for {0:.1f} s, {1:.3f} m or {2:.3f} m: the expert's force fades"},
    {EventCode::tank_empty, tank_empty_text},
    {EventCode::feedback_renewed,
     "plain PD control replaces the law that vibrated: feedback from {0:.0f} % to {1:.0f} %",
     {100, 100, 1}},
};
static_assert(std::equal(std::begin(kEventWords), std::end(kEventWords), std::begin(kEventTexts), std::end(kEventTexts),
                         [](const EventWords& words, const EventText& text) { return words.code == text.code; }));

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
  const EventWords* const words = words_of(event.code);
  if (words == nullptr) return fmt::format("event {}", static_cast<int>(event.code));
  return kEventTexts[words - std::begin(kEventWords)].text(event.values);
}

}  // namespace haptrace
