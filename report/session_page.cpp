#include "report/session_page.h"

#include "base/units.h"
#include "report/chart.h"
#include "report/course_page.h"
#include "report/local_time.h"
#include "report/markup.h"
#include "report/table.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <map>
#include <set>

namespace haptrace {
namespace {

using pugi::xml_node;

void add_fact(xml_node list, const std::string& key, const std::string& value) {
  if (value.empty()) return;
  xml_node pair = list.append_child("div");
  add(pair, "dt", key);
  add(pair, "dd", value);
}

/// Returns the first of these keys of the operator's metadata that is there; else words that say that none is.
std::string recorded(const ReportSession& session, std::initializer_list<const char*> keys) {
  for (const char* key : keys)
    if (const auto found = session.meta.find(key); found != session.meta.end() && !found->second.empty())
      return found->second;
  return "not recorded";
}

std::string force_in_words(const ReportSession& session) {
  if (session.force_limit) return fmt::format("{:g}{}N, set for this session", *session.force_limit, kNarrowSpace);
  if (session.device_force > 0) return fmt::format("{:g}{}N, of the device", session.device_force, kNarrowSpace);
  return "not recorded";
}

bool is_drawn(const ReportExercise& exercise, std::string_view name) {
  return name == exercise.figure || name == "movement_time_s" || name == "sparc" || name == "lateral_deviation_m" ||
         name == "after_effect_m" || name == "adaptation_index";
}

/// Returns the name of the participant of a session for the rows of tables; empty if the report has one participant.
std::string person_of(const Report& report, std::size_t session) {
  if (report.persons.size() < 2) return "";
  for (const ReportPerson& person : report.persons)
    if (std::find(person.sessions.begin(), person.sessions.end(), session) != person.sessions.end()) return person.name;
  return "";
}

/// Adds a sentence on the primary metric: its median, the middle half of the repetitions, and the norms.
void add_primary(xml_node section, const Report& report, const ReportCourse::Point& point) {
  const ReportExercise& exercise = exercise_of(report, point);
  const std::optional<std::size_t> primary = primary_figure(exercise);
  if (!primary) return;
  const TrialFigure& figure = all_trial_figures()[*primary];
  const ReportSummary summary = summary_of(exercise, *primary);
  std::string text =
      fmt::format("Primary metric ({}): {}. ",
                  exercise.figure_named ? "named by the programme" : "the default of this mode", with_unit(figure));
  text += std::isfinite(summary.median) ? fmt::format("Median {}", shown(figure, summary.median))
                                        : fmt::format("The median is undefined: {}", why_undefined(exercise, *primary));
  if (const std::string half = middle_half(figure, summary); half != kUndefined)
    text += fmt::format(", middle half of the repetitions {}", half);
  text += fmt::format("; {}.", counts_in_words(exercise));
  const std::string range = reference_range(report, point, *primary);
  text += range.empty() ? " No norms were given for this device, task and mode."
                        : fmt::format(" Reference range {}.", range);
  text += " The other metrics are exploratory.";
  set(add(section, "p", text), "class", "primary");
}

/// Returns whether the assistance differed between repetitions.
bool changes(const ReportExercise& exercise) {
  const ReportTrial& first = exercise.trials.front();
  const auto differs = [](const std::optional<double>& a, const std::optional<double>& b) {
    return a.has_value() != b.has_value() || (a && std::abs(*a - *b) > 1e-3 * std::abs(*b));
  };
  return std::any_of(exercise.trials.begin(), exercise.trials.end(), [&](const ReportTrial& trial) {
    return differs(trial.pace, first.pace) || differs(trial.radius, first.radius) ||
           differs(trial.stiffness, first.stiffness) || differs(trial.assistance, first.assistance) ||
           differs(trial.support, first.support);
  });
}

/// A setting that has a column in the table.
struct Setting {
  const char* title;
  std::optional<double> ReportTrial::*value;
  double scale;
  int digits;
};
constexpr std::array<Setting, 6> kSettings{{{"radius (mm)", &ReportTrial::radius, 1e3, 1},
                                            {"stiffness (N/m)", &ReportTrial::stiffness, 1, 0},
                                            {"pace", &ReportTrial::pace, 1, 2},
                                            {"assistance allowed (%)", &ReportTrial::assistance, 100, 0},
                                            {"level", &ReportTrial::level, 1, 2},
                                            {"support of the arm (N)", &ReportTrial::support, 1, 1}}};

/// `person` is in every row if it is not empty.
void add_trial_table(xml_node parent, const ReportExercise& exercise, const std::vector<std::size_t>& figures,
                     bool settings, const std::string& person, const std::string& caption) {
  const bool named = !person.empty();
  const auto& trials = exercise.trials;
  const bool rounds = std::any_of(trials.begin(), trials.end(), [](const ReportTrial& t) { return t.round > 1; });
  std::vector<Setting> used;
  for (const Setting& setting : kSettings)
    if (settings &&
        std::any_of(trials.begin(), trials.end(), [&](const ReportTrial& t) { return (t.*setting.value).has_value(); }))
      used.push_back(setting);

  Table table(parent, caption, trials.size());
  table.column("repetition");
  if (named) table.column("participant");
  const bool targets =
      std::any_of(trials.begin(), trials.end(), [](const ReportTrial& t) { return !t.target.empty(); });
  if (targets) table.column("reach");
  const bool answers = std::any_of(trials.begin(), trials.end(), [](const ReportTrial& t) { return t.answer > 0; });
  if (answers) table.column("answer");
  if (settings) table.column("rank", true);
  const bool ends = std::any_of(trials.begin(), trials.end(),
                                [](const ReportTrial& t) { return !t.finished() || !t.missing.empty(); });
  if (ends) table.column("how it ended");
  if (settings) table.column("duration (s)", true);
  if (settings) table.column("samples", true);
  for (const Setting& setting : used) table.column(setting.title, true);
  for (const std::size_t i : figures) table.column(with_unit(all_trial_figures()[i]), true);
  for (const ReportTrial& trial : trials) {
    std::string name =
        rounds ? fmt::format("{}, round {}", trial.repetition, trial.round) : fmt::format("{}", trial.repetition);
    if (trial.attempt > 1) name += fmt::format(", attempt {}", trial.attempt);
    xml_node row = table.row(name);
    if (!trial.finished()) set(row, "class", "stopped");
    if (named) table.text(person);
    if (targets) table.text(trial.target);
    if (answers) table.text(trial.answer == 1 ? "first" : trial.answer == 2 ? "second" : kUndefined);
    if (settings) table.number(trial.rank ? fmt::format("{}", *trial.rank) : kUndefined);
    if (ends) table.text(trial.end_in_words() + (trial.missing.empty() ? "" : ", recording missing"));
    if (settings) table.number(fmt::format("{:.1f}", trial.duration));
    if (settings) table.number(trial.samples > 0 ? fmt::format("{}", trial.samples) : kUndefined);
    for (const Setting& setting : used) {
      const std::optional<double>& value = trial.*setting.value;
      table.number(value ? fmt::format("{:.{}f}", setting.scale * *value, setting.digits) : kUndefined);
    }
    for (const std::size_t i : figures) {
      const std::string value = shown(all_trial_figures()[i], trial.figures[i].value_or(kNaN), false);
      table.number(trial.at_limit && all_trial_figures()[i].limited && trial.figures[i] ? "\u2265 " + value : value);
    }
  }
}

void add_trials(xml_node section, const ReportExercise& exercise, const std::string& person) {
  std::vector<std::size_t> first, others;
  for (std::size_t i = 0; i < all_trial_figures().size(); ++i)
    if (std::any_of(exercise.trials.begin(), exercise.trials.end(),
                    [&](const ReportTrial& trial) { return trial.figures[i].has_value(); }))
      (is_main(i) ? first : others).push_back(i);
  add_trial_table(
      section, exercise, first, true, person,
      fmt::format("{}: every repetition. {} means undefined; see the end of the page.", exercise.name, kUndefined));
  if (others.empty()) return;
  xml_node details = section.append_child("details");
  add(details, "summary", fmt::format("More metrics of {}", exercise.name));
  add_trial_table(details, exercise, others, false, person,
                  fmt::format("More metrics of {}: every repetition.", exercise.name));
}

/// Adds the means of the blocks of a reaching exercise.
void add_blocks(xml_node section, const ReportExercise& exercise) {
  if (exercise.blocks.empty()) return;
  Table table(section,
              fmt::format("Blocks of {}: means over the finished reaches in which the field acted. Deviations are "
                          "positive to the left of the "
                          "reach. The change of the after-effect is less the deviation before the first field.",
                          exercise.name),
              exercise.blocks.size());
  table.column("block");
  table.column("force field");
  for (const char* title : {"plain reaches", "with less than 90 % of the field", "catch trials", "clamps",
                            "clamps without an index", "reaction time, median (ms)", "lateral deviation (mm)",
                            "after-effect (mm)", "its change (mm)", "adaptation index"})
    table.column(title, true);
  const auto number = [&](const std::optional<double>& value, double scale, int digits) {
    table.number(value ? with_minus(fmt::format("{:.{}f}", scale * *value, digits)) : kUndefined);
  };
  for (const ReachBlockSummary& block : exercise.blocks) {
    table.row(block.name.empty() ? "all" : block.name);
    table.text(block.field ? "on" : "off");
    for (const std::size_t n : {block.plain, block.weakened, block.catches, block.clamps, block.refused})
      table.number(fmt::format("{}", n));
    number(block.reaction_time, 1e3, 0);
    number(block.lateral_deviation, 1e3, 1);
    number(block.after_effect, 1e3, 1);
    number(block.after_effect_change, 1e3, 1);
    number(block.adaptation_index, 1, 2);
  }
}

/// Adds the best of the tries in each direction of a range of motion or a press.
void add_assessment(xml_node section, const ReportExercise& exercise) {
  if (!exercise.assessment || exercise.assessment->directions.empty()) return;
  const AssessmentSummary& summary = *exercise.assessment;
  const bool range = summary.goal == ReachGoal::range;
  std::string caption = fmt::format("Results of {}: the best of the tries in each direction.", exercise.name);
  if (summary.area)
    caption += fmt::format(" The area within these places is {}{:.1f}{}cm².", summary.at_limit() ? "at least " : "",
                           1e4 * *summary.area, kNarrowSpace);
  if (summary.at_limit())
    caption += range ? " ≥: the device ends there, and the person may come farther."
                     : " ≥: the device had no more force, or gave way; the person may be stronger.";
  Table table(section, caption, summary.directions.size());
  table.column("direction (degrees)");
  table.column("tries", true);
  table.column(range ? "range of motion (mm)" : "maximum force (N)", true);
  for (const DirectionSummary& one : summary.directions) {
    table.row(std::isnan(one.angle) ? kUndefined : fmt::format("{:.0f}", one.angle));
    table.number(fmt::format("{}", one.tries));
    table.number(one.best ? with_minus(fmt::format("{}{:.{}f}", one.at_limit ? "≥ " : "", (range ? 1e3 : 1) * *one.best,
                                                   range ? 1 : 2))
                          : kUndefined);
  }
}

void add_exercise(xml_node section, const Report& report, const ReportCourse::Point& point, int depth) {
  const ReportExercise& exercise = exercise_of(report, point);
  add(section, heading(depth), exercise.name);
  std::string about = fmt::format("The device {}.", mode_in_words(exercise));
  if (!exercise.path.empty()) about += fmt::format(" Path: {}", exercise.path);
  if (exercise.path_length > 0 && exercise.reach.empty())
    about += fmt::format("{}{:.0f}{}mm long", exercise.path.empty() ? " The path is " : ", ",
                         1e3 * exercise.path_length, kNarrowSpace);
  if (!exercise.path.empty() || exercise.path_length > 0) about += ".";
  set(add(section, "p", about), "class", "about");
  if (exercise.trials.empty()) {
    add(section, "p", "No repetition was made.");
    return;
  }
  add_primary(section, report, point);
  xml_node charts = section.append_child("div");
  set(charts, "class", "charts");
  add_way_chart(charts, exercise);
  add_deviation_chart(charts, exercise);
  add_force_chart(charts, exercise);
  for (const ReportTrend& trend : exercise.trends)
    if (is_drawn(exercise, all_trial_figures()[trend.figure].name)) add_trend_chart(charts, exercise, trend);
  if (!charts.first_child()) section.remove_child(charts);
  if (changes(exercise))
    set(add(section, "p", "The settings changed between repetitions, so a trend here does not show skill alone."),
        "class", "soft");
  add_blocks(section, exercise);
  add_assessment(section, exercise);
  if (exercise.sense) add(section, "p", capitalised(describe(*exercise.sense)) + ".");
  add_trials(section, exercise, person_of(report, point.session));
}

void add_touches(xml_node main, const ReportSession& session, int depth) {
  if (session.touches.empty()) return;
  add(main, heading(depth), "Touched objects");
  Table table(main, "The objects of the scene. Depth and force are the largest ones.", session.touches.size());
  table.column("Object");
  table.column("Touches", true);
  table.column("Time (s)", true);
  table.column("Depth (mm)", true);
  table.column("Force (N)", true);
  for (const TouchFigures& touch : session.touches) {
    const bool touched = touch.times > 0;
    table.row(touch.name);
    table.number(fmt::format("{}", touch.times));
    table.number(touched ? fmt::format("{:.2f}", touch.seconds) : kUndefined);
    table.number(touched ? fmt::format("{:.2f}", 1e3 * touch.max_depth) : kUndefined);
    table.number(touched ? fmt::format("{:.2f}", touch.max_force) : kUndefined);
  }
}

void add_events(xml_node main, const ReportSession& session, int depth) {
  add(main, heading(depth), "Stops and warnings");
  if (session.events.empty()) {
    add(main, "p", "There were no stops and no warnings.");
    return;
  }
  Table table(main,
              "In the order of the repetitions. An event that occurred several times in a repetition is listed once.",
              session.events.size());
  table.column("Kind");
  table.column("Where");
  table.column("Time", true);
  table.column("Count", true);
  table.column("Description");
  for (const ReportEvent& event : session.events) {
    const char* kind = event.kind == ReportEvent::Kind::stop   ? "stop"
                       : event.kind == ReportEvent::Kind::mark ? "mark"
                                                               : "warning";
    table.row(kind);
    set(table.title(), "class", fmt::format("kind {}", kind));
    table.text(event.where.empty() ? kUndefined : event.where);
    table.number(event.time ? fmt::format("{:.2f}{}s", *event.time, kNarrowSpace) : kUndefined);
    table.number(fmt::format("{}", event.times));
    table.text(event.text);
  }
}

void add_settings(xml_node main, const ReportSession& session, int depth) {
  add(main, heading(depth), "Settings");
  if (!session.sittings.empty()) {
    Table table(main, "Sittings of the session.", session.sittings.size());
    for (const char* title : {"Started", "Ended by"}) table.column(title);
    table.column("Duration", true);
    table.column("Force dose (N s)", true);
    for (const Sitting& sitting : session.sittings) {
      table.row(local_time(sitting.began));
      table.text(sitting.ended_by.empty() ? "unknown" : sitting.ended_by);
      table.number(lasting(sitting.duration));
      table.number(fmt::format("{:.1f}", sitting.force_dose));
    }
  }
  xml_node details = main.append_child("details");
  set(details, "class", "data");  // not on paper
  add(details, "summary", "All settings");
  add(details, "p",
      fmt::format("{}{}", session.source, session.software.empty() ? "" : ", recorded by " + session.software));
  add(details, "pre", session.settings.dump(2, ' ', false, nlohmann::json::error_handler_t::replace));
}

}  // namespace

const char* heading(int depth) {
  static constexpr std::array kElements{"h1", "h2", "h3", "h4", "h5", "h6"};
  return kElements[static_cast<std::size_t>(std::clamp(depth, 1, 6) - 1)];
}

std::string capitalised(std::string text) {
  if (!text.empty()) text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
  return text;
}

std::string lasting(double seconds) {
  return long_duration_text(seconds, kNarrowSpace);
}

std::string mode_in_words(const ReportExercise& exercise) {
  static const std::map<std::string, std::string> kWords{
      {"passive", "moved the hand along the path"},
      {"assisted", "helped as far as it was allowed and needed"},
      {"tunnel", "kept the hand in a tunnel around the path"},
      {"cursor", "pulled the hand towards a cursor that moves along the path"},
      {"resist", "resisted the movement along the path within a tunnel"},
      {"free", "gave no guidance"},
      {"reach", "left the hand to reach for targets"},
      {"range", "left the hand to move as far as it can"},
      {"press", "held the hand, which pressed as hard as it can"},
      {"track", "left the hand to follow a moving target"},
      {"weigh", "held the hand, on which the arm rested"},
      {"sense", "moved the hand to two places, of which the person named the farther one"},
      {"playback", "played back the path"},
      {"recording", "recorded the movement"}};
  const auto found = kWords.find(exercise.mode);
  std::string text = found == kWords.end() ? exercise.mode : found->second;
  if (!exercise.test.empty()) text += fmt::format(" (test, {})", exercise.test);
  if (exercise.warm_up) text += " (warm-up)";
  return text;
}

std::string with_unit(const TrialFigure& figure) {
  return *figure.unit != '\0' ? fmt::format("{} ({})", figure.title, figure.unit) : figure.title;
}

bool is_main(std::size_t figure) {
  static const std::set<std::string_view> kMain{
      "contour_rms_m",       "contour_peak_m",    "deviation_rms_m", "time_in_tunnel",
      "completion",          "helped_time",       "movement_time_s", "sparc",
      "speed_peaks",         "force_error_rms_n", "mean_force_n",    "reaction_time_s",
      "lateral_deviation_m", "after_effect_m",    "field_share",     "end_error_m",
      "adaptation_index",    "range_m",           "press_force_n",   "tracking_rms_m",
      "arm_weight_n",        "tracking_gain",     "tracking_delay_s"};
  return kMain.contains(all_trial_figures()[figure].name);
}

std::string anchor(std::size_t session, std::size_t exercise) {
  return fmt::format("exercise-{}-{}", session + 1, exercise + 1);
}

void add_facts(xml_node parent, const ReportSession& session) {
  xml_node list = parent.append_child("dl");
  set(list, "class", "facts");
  add_fact(list, "Participant", session.subject.empty() ? "not recorded" : session.subject);
  add_fact(list, "Side", recorded(session, {"side", "hand"}));
  if (session.meta.contains("age")) add_fact(list, "Age", session.meta.at("age"));
  add_fact(list, "Operator", session.operator_name.empty() ? "not recorded" : session.operator_name);
  add_fact(list, "Date", local_time(session.created));
  add_fact(list, "Duration", session.duration > 0 ? lasting(session.duration) : "");
  add_fact(list, "Device", session.device);
  add_fact(list, "Force limit", force_in_words(session));
  add_fact(list, "Protocol", recorded(session, {"protocol"}));
  if (session.meta.contains("protocol-reference"))
    add_fact(list, "Reference of the protocol", session.meta.at("protocol-reference"));
  add_fact(list, "Recorded by", session.software);
  add_fact(list, "Notes", session.notes);
}

void add_remarks(xml_node parent, const ReportSession& session) {
  if (session.remarks.empty()) return;
  xml_node box = parent.append_child("div");
  set(box, "class", "remarks");
  set(box, "role", "note");
  for (const std::string& remark : session.remarks) add(box, "p", capitalised(remark) + ".");
}

void add_session(xml_node parent, const Report& report, std::size_t s, int depth) {
  const ReportSession& session = report.sessions[s];
  for (std::size_t e = 0; e < session.exercises.size(); ++e) {
    xml_node section = parent.append_child("section");
    set(section, "id", anchor(s, e));
    add_exercise(section, report, {.session = s, .exercise = e}, depth);
  }
  add_touches(parent, session, depth);
  add_events(parent, session, depth);
  add_settings(parent, session, depth);
}

}  // namespace haptrace
