#include "report/page.h"

#include "base/rfc3339.h"
#include "report/chart.h"
#include "report/markup.h"
#include "report/page_css.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <map>
#include <set>
#include <sstream>

namespace haptrace {
namespace {

using pugi::xml_node;

std::string capitalised(std::string text) {
  if (!text.empty()) text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
  return text;
}

std::string count(std::size_t n, const std::string& what) {
  return fmt::format("{} {}{}", n, what, n == 1 ? "" : "s");
}

std::string date_of(const std::string& time) {
  const auto point = parse_rfc3339(time);
  if (!point) return time;
  const std::time_t seconds = std::chrono::system_clock::to_time_t(*point);
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  return fmt::format("{:%d %B %Y, %H:%M} UTC", utc);
}

/// Returns the title of a session with its date, because repeated sessions have the same title.
std::string dated(const ReportSession& session) {
  const std::string date = date_of(session.created);
  return date.empty() ? session.title : fmt::format("{}, {}", session.title, date.substr(0, date.find(',')));
}

std::string lasting(double seconds) {
  if (seconds < 100) return fmt::format("{:.{}f}{}s", seconds, seconds < 10 ? 1 : 0, kNarrowSpace);
  const long minutes = std::lround(seconds / 60);
  if (minutes < 100) return fmt::format("{}{}min", minutes, kNarrowSpace);
  return fmt::format("{}{}h {}{}min", minutes / 60, kNarrowSpace, minutes % 60, kNarrowSpace);
}

/// Returns the action of the device, in words.
std::string mode_in_words(const ReportExercise& exercise) {
  static const std::map<std::string, std::string> kWords{
      {"passive", "moved the hand along the path"},
      {"assisted", "helped as far as it was allowed and needed"},
      {"tunnel", "kept the hand in a tunnel around the path"},
      {"cursor", "pulled the hand towards a cursor that moves along the path"},
      {"resist", "resisted the movement along the path within a tunnel"},
      {"free", "gave no guidance"},
      {"playback", "played back the path"},
      {"recording", "recorded the movement"}};
  const auto found = kWords.find(exercise.mode);
  std::string text = found == kWords.end() ? exercise.mode : found->second;
  if (!exercise.test.empty()) text += fmt::format(" (test, {})", exercise.test);
  if (exercise.warm_up) text += " (warm-up)";
  return text;
}

double completion_of(const ReportTrial& trial) {
  for (std::size_t i = 0; i < trial.figures.size(); ++i)
    if (std::string_view(all_trial_figures()[i].name) == "completion") return trial.figures[i].value_or(kNaN);
  return kNaN;
}

std::size_t finished(const ReportExercise& exercise) {
  return static_cast<std::size_t>(std::count_if(exercise.trials.begin(), exercise.trials.end(),
                                                [](const ReportTrial& trial) { return trial.finished(); }));
}

/// Returns the number of partial repetitions and the shares of the path in them: "; 2 in part (40 to 55 %)"; empty for
/// none.
std::string partial_in_words(const ReportExercise& exercise) {
  std::size_t count = 0;
  double least = kNaN, most = kNaN;
  for (const ReportTrial& trial : exercise.trials) {
    if (!trial.out_of_time()) continue;
    ++count;
    const double share = completion_of(trial);
    least = std::fmin(least, share);
    most = std::fmax(most, share);
  }
  if (count == 0) return "";
  if (!std::isfinite(most)) return fmt::format("; {} in part", count);
  const std::string from = fmt::format("{:.0f}", 100 * least), to = fmt::format("{:.0f}", 100 * most);
  return fmt::format("; {} in part ({}{}%)", count, from == to ? from : from + " to " + to, kNarrowSpace);
}

/// Returns the trend of the main metric of an exercise.
const ReportTrend* main_trend(const ReportExercise& exercise) {
  for (const ReportTrend& trend : exercise.trends)
    if (all_trial_figures()[trend.figure].name == exercise.figure) return &trend;
  return nullptr;
}

/// Returns the values of the first and last repetition in which a metric is defined.
std::pair<double, double> ends_of(const ReportTrend& trend) {
  double first = kNaN, last = kNaN;
  for (const double v : trend.values)
    if (std::isfinite(v)) {
      if (!std::isfinite(first)) first = v;
      last = v;
    }
  return {first, last};
}

std::size_t defined(const ReportTrend& trend) {
  return static_cast<std::size_t>(
      std::count_if(trend.values.begin(), trend.values.end(), [](double v) { return std::isfinite(v); }));
}

/// A table with a caption in a box that scrolls sideways, also with the keyboard.
class Table {
 public:
  /// A table with few `rows` stays on one printed page.
  Table(xml_node parent, const std::string& caption, std::size_t rows) {
    constexpr std::size_t kFew = 16;
    xml_node box = parent.append_child("div");
    set(box, "class", rows <= kFew ? "table short" : "table");
    set(box, "role", "region");
    set(box, "aria-label", caption);
    set(box, "tabindex", "0");
    table_ = box.append_child("table");
    add(add(table_, "caption"), "span", caption);
    head_ = add(add(table_, "thead"), "tr");
    body_ = add(table_, "tbody");
  }

  void column(const std::string& title, bool number = false) {
    xml_node cell = add(head_, "th", title);
    set(cell, "scope", "col");
    if (number) set(cell, "class", "number");
  }

  xml_node row(const std::string& title) {
    row_ = body_.append_child("tr");
    xml_node cell = add(row_, "th", title);
    set(cell, "scope", "row");
    return row_;
  }
  /// Returns the title cell of the row.
  [[nodiscard]] xml_node title() const { return row_.first_child(); }

  xml_node text(const std::string& what) { return add(row_, "td", what); }
  xml_node number(const std::string& what) {
    xml_node cell = text(what);
    set(cell, "class", "number");
    return cell;
  }

 private:
  xml_node table_, head_, body_, row_;
};

std::string with_unit(const TrialFigure& figure) {
  return *figure.unit != '\0' ? fmt::format("{} ({})", figure.title, figure.unit) : figure.title;
}

class Page {
 public:
  explicit Page(const Report& report) : report_(report) {}

  std::string build() {
    document_.append_child(pugi::node_doctype).set_value("html");
    xml_node html = document_.append_child("html");
    set(html, "lang", "en");
    add_head(html.append_child("head"));
    xml_node main = html.append_child("body").append_child("main");
    add_top(main);
    add_summary(main);
    for (const ReportComparison& comparison : report_.comparisons) add_comparison(main, comparison);
    for (const ReportSession& session : report_.sessions) add_session(main, session);
    add_meanings(main);
    add_footer(main);
    std::ostringstream text;
    document_.save(text, "", pugi::format_raw | pugi::format_no_declaration, pugi::encoding_utf8);
    return text.str() + "\n";
  }

 private:
  [[nodiscard]] bool several() const { return report_.sessions.size() > 1; }

  [[nodiscard]] std::string title() const {
    if (several()) return fmt::format("{} and {} more", report_.sessions.front().title, report_.sessions.size() - 1);
    return report_.sessions.empty() ? "Empty report" : report_.sessions.front().title;
  }

  void add_head(xml_node head) {
    set(head.append_child("meta"), "charset", "utf-8");
    // Forbids the page to load or run anything, whatever a title contains.
    xml_node policy = head.append_child("meta");
    set(policy, "http-equiv", "Content-Security-Policy");
    set(policy, "content", "default-src 'none'; style-src 'unsafe-inline'");
    xml_node view = head.append_child("meta");
    set(view, "name", "viewport");
    set(view, "content", "width=device-width, initial-scale=1");
    add(head, "title", title() + " \u2013 report");
    add(head, "style", kPageCss);
  }

  static void add_fact(xml_node list, const std::string& key, const std::string& value) {
    if (value.empty()) return;
    xml_node pair = list.append_child("div");
    add(pair, "dt", key);
    add(pair, "dd", value);
  }

  static void add_facts(xml_node parent, const ReportSession& session) {
    xml_node list = parent.append_child("dl");
    set(list, "class", "facts");
    add_fact(list, "Participant", session.subject);
    add_fact(list, "Operator", session.operator_name);
    add_fact(list, "Date", date_of(session.created));
    add_fact(list, "Duration", session.duration > 0 ? lasting(session.duration) : "");
    add_fact(list, "Device", session.device);
    add_fact(list, "Notes", session.notes);
  }

  static void add_remarks(xml_node parent, const ReportSession& session) {
    if (session.remarks.empty()) return;
    xml_node box = parent.append_child("div");
    set(box, "class", "remarks");
    set(box, "role", "note");
    for (const std::string& remark : session.remarks) add(box, "p", capitalised(remark) + ".");
  }

  void add_top(xml_node main) {
    add(main, "h1", title());
    if (!several())
      for (const ReportSession& session : report_.sessions) add_facts(main, session);
    set(add(main, "p", sentence()), "class", "lead");
    if (!several())
      for (const ReportSession& session : report_.sessions) add_remarks(main, session);
  }

  /// Returns one sentence with the number of repetitions and their result.
  [[nodiscard]] std::string sentence() const {
    std::size_t exercises = 0, begun = 0, ended = 0, late = 0;
    double duration = 0;
    std::set<std::string> people;
    const ReportTrend* best = nullptr;
    const ReportExercise* told = nullptr;
    for (const ReportSession& session : report_.sessions) {
      duration += session.duration;
      people.insert(session.subject.empty()
                        ? session.source
                        : session.subject);  // without a name, every session counts as a different participant
      for (const ReportExercise& exercise : session.exercises) {
        if (exercise.trials.empty()) continue;
        ++exercises;
        begun += exercise.trials.size();
        ended += finished(exercise);
        late += static_cast<std::size_t>(std::count_if(exercise.trials.begin(), exercise.trials.end(),
                                                       [](const ReportTrial& trial) { return trial.out_of_time(); }));
        const ReportTrend* trend = main_trend(exercise);
        if (exercise.test.empty() && !exercise.warm_up && trend != nullptr &&
            (best == nullptr || defined(*trend) > defined(*best))) {
          best = trend;
          told = &exercise;
        }
      }
    }
    const bool named = people.size() == 1 && !report_.sessions.front().subject.empty();
    const std::string who = named ? *people.begin() : "The participant";
    std::string text = people.size() > 1 ? fmt::format("{} were made", capitalised(count(begun, "repetition")))
                                         : fmt::format("{} did {}", who, count(begun, "repetition"));
    text += fmt::format(" of {} in {}; ", count(exercises, "exercise"), lasting(duration));
    const std::size_t stopped = begun - ended - late;
    if (late > 0) text += fmt::format("{} ran out of time{}", late, stopped > 0 ? ", " : ".");
    text += begun == 0       ? "there is nothing to report."
            : ended == begun ? (begun == 1 ? "it was completed." : "all were completed.")
            : stopped > 0    ? fmt::format("{} {} not completed.", stopped, stopped == 1 ? "was" : "were")
                             : "";
    if (best != nullptr && defined(*best) > 1) {
      const TrialFigure& figure = all_trial_figures()[best->figure];
      const auto [first, last] = ends_of(*best);
      text += fmt::format(" In ‘{}’, {} changed from {} to {}.", told->name, figure.title, shown(figure, first),
                          shown(figure, last));
    }
    for (const ReportComparison& comparison : report_.comparisons) {
      const std::size_t i = main_figure(comparison);
      const ReportComparison::Group &from = comparison.groups.front(), &to = comparison.groups.back();
      const TrialFigure& figure = all_trial_figures()[i];
      if (std::isfinite(from.typical(i)) && std::isfinite(to.typical(i)))
        text += fmt::format(" Without guidance, it was {} in the test ‘{}’ and {} in the test ‘{}’.",
                            shown(figure, from.typical(i)), from.test, shown(figure, to.typical(i)), to.test);
      break;
    }
    return text;
  }

  [[nodiscard]] std::size_t exercises() const {
    std::size_t n = 0;
    for (const ReportSession& session : report_.sessions) n += session.exercises.size();
    return n;
  }

  static std::size_t main_figure(const ReportComparison& comparison) {
    for (std::size_t i = 0; i < all_trial_figures().size(); ++i)
      if (std::all_of(comparison.groups.begin(), comparison.groups.end(),
                      [&](const ReportComparison::Group& group) { return !group.values[i].empty(); }))
        return i;
    return 0;
  }

  static std::string anchor(std::size_t session, std::size_t exercise) {
    return fmt::format("exercise-{}-{}", session + 1, exercise + 1);
  }

  void add_summary(xml_node main) {
    add(main, "h2", "Summary");
    Table table(main, "Main metric of every exercise in its first and last finished repetition.", exercises());
    if (several()) table.column("Session");
    table.column("Exercise");
    table.column("The device");
    table.column("Finished", true);
    table.column("Figure");
    table.column("First", true);
    table.column("Last", true);
    table.column("Trend");
    for (std::size_t s = 0; s < report_.sessions.size(); ++s)
      for (std::size_t e = 0; e < report_.sessions[s].exercises.size(); ++e) {
        const ReportExercise& exercise = report_.sessions[s].exercises[e];
        table.row(several() ? dated(report_.sessions[s]) : "");
        xml_node cell = several() ? table.text("") : table.title();
        xml_node link = add(cell, "a", exercise.name);
        set(link, "href", "#" + anchor(s, e));
        table.text(mode_in_words(exercise));
        table.number(fmt::format("{} of {}{}", finished(exercise), exercise.trials.size(), partial_in_words(exercise)));
        const ReportTrend* trend = main_trend(exercise);
        if (trend == nullptr) {
          for (int i = 0; i < 4; ++i) table.text(kUndefined);
          continue;
        }
        const TrialFigure& figure = all_trial_figures()[trend->figure];
        const auto [first, last] = ends_of(*trend);
        table.text(figure.title);
        table.number(shown(figure, first));
        table.number(shown(figure, last));
        const std::string words = in_words(*trend);
        const bool some = !partial_in_words(exercise).empty();
        table.text((words.empty() ? "fewer than four repetitions" : words) +
                   (some ? "; of finished repetitions only, the partial ones rank below" : ""));
      }
  }

  /// Returns whether a metric is in the first table; the others are collapsed.
  static bool is_main(std::size_t figure) {
    static const std::set<std::string_view> kMain{
        "contour_rms_m",   "contour_peak_m", "deviation_rms_m", "time_in_tunnel",    "completion",  "helped_time",
        "movement_time_s", "sparc",          "speed_peaks",     "force_error_rms_n", "mean_force_n"};
    return kMain.contains(all_trial_figures()[figure].name);
  }

  void add_comparison(xml_node main, const ReportComparison& comparison) {
    const std::string whose = comparison.session ? dated(report_.sessions[*comparison.session]) : comparison.subject;
    add(main, "h2",
        several() ? fmt::format("Without guidance: {}, {}", whose, comparison.task)
                  : fmt::format("Without guidance: {}", comparison.task));
    add(main, "p",
        "Repetitions without any guidance are compared only with each other. A movement that improves under guidance "
        "is not necessarily learned, and much guidance can harm retention (guidance hypothesis: Salmoni, Schmidt and "
        "Walter 1984). Judge the practice by these metrics; the retention test is the most informative.");
    std::vector<std::size_t> first, others;
    for (std::size_t i = 0; i < all_trial_figures().size(); ++i)
      if (std::any_of(comparison.groups.begin(), comparison.groups.end(),
                      [&](const ReportComparison::Group& group) { return !group.values[i].empty(); }))
        (is_main(i) ? first : others).push_back(i);
    const std::string caption =
        "Mean ± standard deviation over repetitions, and the change from the first test. With partial repetitions, "
        "which "
        "ran out of time: the median, in which each of them is worse than every finished one";
    add_comparison_table(main, comparison, first, caption + ".");
    if (others.empty()) return;
    xml_node details = main.append_child("details");
    add(details, "summary", "More metrics without guidance");
    add_comparison_table(details, comparison, others, caption + ": more metrics.");
  }

  static void add_comparison_table(xml_node parent, const ReportComparison& comparison,
                                   const std::vector<std::size_t>& figures, const std::string& caption) {
    Table table(parent, caption, figures.size());
    table.column("Figure");
    const ReportComparison::Group& first = comparison.groups.front();
    // Number of repetitions; a metric that is undefined in some of them shows its own number.
    const auto repetitions = [](const ReportComparison::Group& group) {
      std::size_t most = 0;
      for (const std::vector<double>& values : group.values) most = std::max(most, values.size());
      return most;
    };
    for (const ReportComparison::Group& group : comparison.groups) {
      table.column(fmt::format("{} ({}{})", capitalised(group.test), repetitions(group),
                               group.partial.empty() ? "" : fmt::format(" and {} in part", group.partial.size())),
                   true);
      if (&group != &first) table.column("Change", true);
    }
    for (const std::size_t i : figures) {
      const TrialFigure& figure = all_trial_figures()[i];
      table.row(with_unit(figure));
      for (const ReportComparison::Group& group : comparison.groups) {
        const bool ranked = !group.partial.empty() && figure.better != 0;
        std::string text = shown(figure, group.typical(i), false);
        if (ranked && !std::isfinite(group.typical(i))) text = "most in part";
        if (const double spread = group.spread(i); std::isfinite(spread) && !ranked)
          text += fmt::format(" ± {}", shown(figure, spread, false));
        if (const std::size_t n = group.values[i].size(); n > 0 && n < repetitions(group))
          text += fmt::format(" ({} of {})", n, repetitions(group));
        table.number(text);
        if (&group == &first) continue;
        // A mean and a median are no pair.
        const bool pair = group.partial.empty() == first.partial.empty();
        const auto compared = [&](const ReportComparison::Group& of) {
          return pair || figure.better == 0 ? of.typical(i) : of.ranked_median(i);
        };
        const double change = compared(group) - compared(first);
        const std::string words = shown(figure, change, false, true);
        xml_node cell = table.number(words);
        const bool changed = words != shown(figure, 0, false);
        if (std::isfinite(change) && figure.better != 0 && changed)
          cell.attribute("class").set_value((change < 0) == (figure.better < 0) ? "number better" : "number worse");
      }
    }
  }

  void add_session(xml_node main, const ReportSession& session) {
    const auto s = static_cast<std::size_t>(&session - report_.sessions.data());
    add(main, "h2", several() ? dated(session) : "Exercises");
    if (several()) {
      add_facts(main, session);
      add_remarks(main, session);
    }
    for (std::size_t e = 0; e < session.exercises.size(); ++e) {
      xml_node section = main.append_child("section");
      set(section, "id", anchor(s, e));
      add_exercise(section, session.exercises[e]);
    }
    add_touches(main, session);
    add_events(main, session);
    add_settings(main, session);
  }

  void add_exercise(xml_node section, const ReportExercise& exercise) {
    add(section, "h3", exercise.name);
    std::string about = fmt::format("The device {}.", mode_in_words(exercise));
    if (!exercise.path.empty()) about += fmt::format(" Path: {}", exercise.path);
    if (exercise.path_length > 0)
      about += fmt::format("{}{:.0f}{}mm long", exercise.path.empty() ? " The path is " : ", ",
                           1e3 * exercise.path_length, kNarrowSpace);
    if (!exercise.path.empty() || exercise.path_length > 0) about += ".";
    set(add(section, "p", about), "class", "about");
    if (exercise.trials.empty()) {
      add(section, "p", "No repetition was made.");
      return;
    }
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
    add_trials(section, exercise);
  }

  static bool is_drawn(const ReportExercise& exercise, std::string_view name) {
    return name == exercise.figure || name == "movement_time_s" || name == "sparc";
  }

  /// Returns whether the assistance differed between repetitions.
  static bool changes(const ReportExercise& exercise) {
    const ReportTrial& first = exercise.trials.front();
    const auto differs = [](const std::optional<double>& a, const std::optional<double>& b) {
      return a.has_value() != b.has_value() || (a && std::abs(*a - *b) > 1e-3 * std::abs(*b));
    };
    return std::any_of(exercise.trials.begin(), exercise.trials.end(), [&](const ReportTrial& trial) {
      return differs(trial.pace, first.pace) || differs(trial.radius, first.radius) ||
             differs(trial.stiffness, first.stiffness) || differs(trial.assistance, first.assistance);
    });
  }

  /// A setting that has a column in the table.
  struct Setting {
    const char* title;
    std::optional<double> ReportTrial::*value;
    double scale;
    int digits;
  };
  static constexpr std::array<Setting, 5> kSettings{{{"radius (mm)", &ReportTrial::radius, 1e3, 1},
                                                     {"stiffness (N/m)", &ReportTrial::stiffness, 1, 0},
                                                     {"pace", &ReportTrial::pace, 1, 2},
                                                     {"assistance allowed (%)", &ReportTrial::assistance, 100, 0},
                                                     {"level", &ReportTrial::level, 1, 2}}};

  void add_trials(xml_node section, const ReportExercise& exercise) {
    std::vector<std::size_t> first, others;
    for (std::size_t i = 0; i < all_trial_figures().size(); ++i)
      if (std::any_of(exercise.trials.begin(), exercise.trials.end(),
                      [&](const ReportTrial& trial) { return trial.figures[i].has_value(); }))
        (is_main(i) ? first : others).push_back(i);
    add_trial_table(
        section, exercise, first, true,
        fmt::format("{}: every repetition. {} means undefined; see the end of the page.", exercise.name, kUndefined));
    if (others.empty()) return;
    xml_node details = section.append_child("details");
    add(details, "summary", fmt::format("More metrics of {}", exercise.name));
    add_trial_table(details, exercise, others, false,
                    fmt::format("More metrics of {}: every repetition.", exercise.name));
  }

  static void add_trial_table(xml_node parent, const ReportExercise& exercise, const std::vector<std::size_t>& figures,
                              bool settings, const std::string& caption) {
    const auto& trials = exercise.trials;
    const bool rounds = std::any_of(trials.begin(), trials.end(), [](const ReportTrial& t) { return t.round > 1; });
    std::vector<Setting> used;
    for (const Setting& setting : kSettings)
      if (settings && std::any_of(trials.begin(), trials.end(),
                                  [&](const ReportTrial& t) { return (t.*setting.value).has_value(); }))
        used.push_back(setting);

    Table table(parent, caption, trials.size());
    table.column("repetition");
    const bool ends = std::any_of(trials.begin(), trials.end(),
                                  [](const ReportTrial& t) { return !t.finished() || !t.missing.empty(); });
    if (ends) table.column("how it ended");
    if (settings) table.column("duration (s)", true);
    for (const Setting& setting : used) table.column(setting.title, true);
    for (const std::size_t i : figures) table.column(with_unit(all_trial_figures()[i]), true);
    for (const ReportTrial& trial : trials) {
      std::string name =
          rounds ? fmt::format("{}, round {}", trial.repetition, trial.round) : fmt::format("{}", trial.repetition);
      if (trial.attempt > 1) name += fmt::format(", attempt {}", trial.attempt);
      xml_node row = table.row(name);
      if (!trial.finished()) set(row, "class", "stopped");
      if (ends) table.text(trial.end_in_words() + (trial.missing.empty() ? "" : ", recording missing"));
      if (settings) table.number(fmt::format("{:.1f}", trial.duration));
      for (const Setting& setting : used) {
        const std::optional<double>& value = trial.*setting.value;
        table.number(value ? fmt::format("{:.{}f}", setting.scale * *value, setting.digits) : kUndefined);
      }
      for (const std::size_t i : figures)
        table.number(shown(all_trial_figures()[i], trial.figures[i].value_or(kNaN), false));
    }
  }

  static void add_touches(xml_node main, const ReportSession& session) {
    if (session.touches.empty()) return;
    add(main, "h3", "Touched objects");
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

  static void add_events(xml_node main, const ReportSession& session) {
    add(main, "h3", "Stops and warnings");
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

  static void add_settings(xml_node main, const ReportSession& session) {
    add(main, "h3", "Settings");
    if (!session.sittings.empty()) {
      Table table(main, "Sittings of the session.", session.sittings.size());
      for (const char* title : {"Started", "Ended by"}) table.column(title);
      table.column("Duration", true);
      table.column("Force dose (N s)", true);
      for (const Sitting& sitting : session.sittings) {
        table.row(date_of(sitting.began));
        table.text(sitting.ended_by.empty() ? "unknown" : sitting.ended_by);
        table.number(lasting(sitting.duration));
        table.number(fmt::format("{:.1f}", sitting.force_dose));
      }
    }
    xml_node details = main.append_child("details");
    add(details, "summary", "All settings");
    add(details, "p",
        fmt::format("{}{}", session.source, session.software.empty() ? "" : ", recorded by " + session.software));
    add(details, "pre", session.settings.dump(2, ' ', false, nlohmann::json::error_handler_t::replace));
  }

  static void add_meanings(xml_node main) {
    add(main, "h2", "How the metrics are defined");
    add(main, "p",
        "Each metric describes one repetition after the approach to the start. The movement of the hand is low-pass "
        "filtered at 10 Hz without lag, so the metrics do not depend on the sampling rate.");
    add(main, "p",
        fmt::format("{} stands for an undefined value, never for zero: nothing moved, there was no path or no force to "
                    "compare with, the repetition was stopped, or its recording is missing.",
                    kUndefined));
    add(main, "p",
        "A repetition that ran out of time has the metrics of its movement until then. Like a stopped repetition, it "
        "counts in no trend, mean or comparison, and is neither first nor last.");
    xml_node list = main.append_child("dl");
    set(list, "class", "meanings");
    for (const TrialFigure& figure : all_trial_figures()) {
      add(list, "dt", with_unit(figure));
      add(list, "dd", figure.meaning);
    }
    add(list, "dt", "Trend");
    add(list, "dd",
        "A straight line fitted by least squares to at least four finished repetitions, with the 95 % confidence "
        "interval of its slope (Student's t). \u201cNo clear trend\u201d means that this interval contains zero. The "
        "learning curve is a power law (Newell and Rosenbloom 1981) or an exponential (Heathcote, Brown and Mewhort "
        "2000), whichever has the smaller residual.");
  }

  static void add_footer(xml_node main) {
    set(add(main, "p",
            "Made by haptrace. This page contains everything it shows. Its curves are thinned without a visible "
            "difference; the recordings keep every sample."),
        "class", "soft");
  }

  const Report& report_;
  pugi::xml_document document_;
};

}  // namespace

std::string report_page(const Report& report) {
  return Page(report).build();
}

}  // namespace haptrace
