#include "report/page.h"

#include "report/chart.h"
#include "report/course_page.h"
#include "report/local_time.h"
#include "report/markup.h"
#include "report/page_css.h"
#include "report/session_page.h"
#include "report/table.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <sstream>

namespace haptrace {
namespace {

using pugi::xml_node;

/// Returns the title of a session with its date, because repeated sessions have the same title.
std::string dated(const ReportSession& session) {
  const std::string date = local_time(session.created);
  return date.empty() ? session.title : fmt::format("{}, {}", session.title, date.substr(0, date.find(',')));
}

/// Returns a text as a string of a style sheet. Every byte that is not a letter or digit is written as a number, so
/// that no name of a participant ends the string; characters beyond ASCII stay.
std::string style_text(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) {
    const auto code = static_cast<unsigned char>(c);
    if (code >= 0x80 || std::isalnum(code) != 0)
      result += c;
    else
      result += fmt::format("\\{:06x}", code < 0x20 || code == 0x7f ? 0x20U : code);
  }
  return result + "\"";
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
    if (!report_.sessions.empty()) add_summary(main);
    for (const ReportPerson& person : report_.persons) {
      xml_node part = main;
      if (persons()) {
        part = main.append_child("section");
        set(part, "class", fmt::format("person person-{}", &person - report_.persons.data() + 1));
        add(part, heading(2), person.name);
      }
      add_person(part, person);
    }
    add_meanings(main);
    add_footer(main);
    std::ostringstream text;
    document_.save(text, "", pugi::format_raw | pugi::format_no_declaration, pugi::encoding_utf8);
    return text.str() + "\n";
  }

 private:
  [[nodiscard]] bool several() const { return report_.sessions.size() > 1; }
  [[nodiscard]] bool persons() const { return report_.persons.size() > 1; }
  /// Returns the depth of the headings of a participant's part.
  [[nodiscard]] int depth() const { return persons() ? 3 : 2; }

  [[nodiscard]] std::string title() const {
    if (persons()) return fmt::format("{} participants", report_.persons.size());
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
    add(head, "style", kPageCss + print_margins());
  }

  /// Returns the margins of printed pages: name, and page x of y. Pages of a participant have their name.
  [[nodiscard]] std::string print_margins() const {
    const auto margins = [](const std::string& page, const std::string& name) {
      return fmt::format("@page {} {{ @bottom-left {{ content: {}; font: 8pt sans-serif; color: #56606e; }} }}\n", page,
                         style_text(name));
    };
    if (report_.persons.size() == 1) return margins("", report_.persons.front().name + ", " + title());
    std::string css = margins("", title());
    for (std::size_t i = 0; i < report_.persons.size(); ++i)
      css += margins(fmt::format("person-{}", i + 1), report_.persons[i].name) +
             fmt::format(".person-{0} {{ page: person-{0}; }}\n", i + 1);
    return css;
  }

  void add_top(xml_node main) {
    add(main, "h1", title());
    if (!several())
      for (const ReportSession& session : report_.sessions) add_facts(main, session);
    set(add(main, "p", sentence()), "class", "lead");
    if (!several())
      for (const ReportSession& session : report_.sessions) add_remarks(main, session);
  }

  /// Returns the numbers of repetitions, in one sentence.
  [[nodiscard]] std::string counts() const {
    std::size_t exercises = 0, begun = 0, ended = 0, late = 0;
    double duration = 0;
    for (const ReportSession& session : report_.sessions) {
      duration += session.duration;
      for (const ReportExercise& exercise : session.exercises) {
        if (exercise.trials.empty()) continue;
        ++exercises;
        begun += exercise.trials.size();
        ended += exercise.finished();
        late += exercise.out_of_time();
      }
    }
    const bool named = report_.persons.size() == 1 && !report_.sessions.front().subject.empty();
    const std::string who = named ? report_.persons.front().name : "The participant";
    std::string text = persons() ? fmt::format("{} were made", capitalised(count(begun, "repetition")))
                                 : fmt::format("{} did {}", who, count(begun, "repetition"));
    text += fmt::format(" of {} in {}; ", count(exercises, "exercise"), lasting(duration));
    const std::size_t stopped = begun - ended - late;
    if (late > 0) text += fmt::format("{} ran out of time{}", late, stopped > 0 ? ", " : ".");
    text += begun == 0       ? "there is nothing to report."
            : ended == begun ? (begun == 1 ? "it was completed." : "all were completed.")
            : stopped > 0    ? fmt::format("{} {} not completed.", stopped, stopped == 1 ? "was" : "were")
                             : "";
    return text;
  }

  /// Returns the numbers of repetitions and, for one participant, the medians of the first tests that can be compared.
  [[nodiscard]] std::string sentence() const {
    std::string text = counts();
    if (persons() || report_.comparisons.empty()) return text;
    const ReportComparison& comparison = report_.comparisons.front();
    const std::size_t i = main_figure(comparison);
    const ReportComparison::Group &from = comparison.groups.front(), &to = comparison.groups.back();
    const TrialFigure& figure = all_trial_figures()[i];
    const double before = from.summaries[i].median, after = to.summaries[i].median;
    if (std::isfinite(before) && std::isfinite(after))
      text += fmt::format(" Without guidance, the median {} was {} in the test ‘{}’ and {} in the test ‘{}’: {}.",
                          figure.title, shown(figure, before), from.test, shown(figure, after), to.test,
                          change_between(report_, point_of(from), point_of(to), i).words);
    return text;
  }

  static ReportCourse::Point point_of(const ReportComparison::Group& group) {
    return {.session = group.session, .exercise = group.exercise};
  }

  static std::size_t main_figure(const ReportComparison& comparison) {
    for (std::size_t i = 0; i < all_trial_figures().size(); ++i)
      if (std::all_of(comparison.groups.begin(), comparison.groups.end(),
                      [&](const ReportComparison::Group& group) { return group.summaries[i].finished > 0; }))
        return i;
    return 0;
  }

  [[nodiscard]] std::string name_of(std::size_t session) const {
    for (const ReportPerson& person : report_.persons)
      if (std::find(person.sessions.begin(), person.sessions.end(), session) != person.sessions.end())
        return person.name;
    return "";
  }

  void add_summary(xml_node main) {
    std::size_t exercises = 0;
    for (const ReportSession& session : report_.sessions) exercises += session.exercises.size();
    add(main, "h2", persons() ? "Comparison" : "Summary");
    if (persons())
      add(main, "p",
          "One row per participant, session and exercise. A difference between two participants says nothing by "
          "itself: "
          "only norms for this device, task and age do.");
    Table table(main, "Primary metric of every exercise. Repetitions that ran out of time rank below finished ones.",
                exercises);
    if (persons()) table.column("Participant");
    if (several()) table.column("Session");
    table.column("Exercise");
    table.column("The device");
    table.column("Repetitions");
    table.column("Primary metric");
    table.column("Median", true);
    table.column("Middle half", true);
    for (const ReportPerson& person : report_.persons)
      for (const std::size_t s : person.sessions) add_summary_rows(table, person, s);
  }

  void add_summary_rows(Table& table, const ReportPerson& person, std::size_t s) const {
    for (std::size_t e = 0; e < report_.sessions[s].exercises.size(); ++e) {
      const ReportExercise& exercise = report_.sessions[s].exercises[e];
      const std::string session = dated(report_.sessions[s]);
      table.row(persons() ? person.name : several() ? session : "");
      if (persons()) table.text(session);
      xml_node link = add(several() ? table.text("") : table.title(), "a", exercise.name);
      set(link, "href", "#" + anchor(s, e));
      table.text(mode_in_words(exercise));
      table.text(counts_in_words(exercise));
      const std::optional<std::size_t> primary = primary_figure(exercise);
      if (!primary) {
        table.text(kUndefined);
        for (int i = 0; i < 2; ++i) table.number(kUndefined);
        continue;
      }
      const TrialFigure& figure = all_trial_figures()[*primary];
      const ReportSummary summary = summary_of(exercise, *primary);
      table.text(with_unit(figure));
      table.number(shown(figure, summary.median, false));
      table.number(middle_half(figure, summary));
    }
  }

  /// Adds everything about one participant, and room for a signature.
  void add_person(xml_node part, const ReportPerson& person) {
    for (const ReportCourse& course : person.courses) add_course(part, report_, person, course, heading(depth()));
    for (const ReportComparison& comparison : report_.comparisons)
      if (name_of(comparison.groups.front().session) == person.name) add_comparison(part, comparison);
    for (const std::size_t s : person.sessions) {
      const ReportSession& session = report_.sessions[s];
      add(part, heading(depth()), several() ? dated(session) : "Exercises");
      if (several()) {
        add_facts(part, session);
        add_remarks(part, session);
      }
      add_session(part, report_, s, depth() + 1);
    }
    add_signature(part, person);
  }

  static void add_signature(xml_node part, const ReportPerson& person) {
    xml_node box = part.append_child("div");
    set(box, "class", "signature");
    for (const char* field : {"Adverse events that the operator noted", "Name", "Date", "Signature"})
      set(add(add(box, "div"), "span", field), "class", "field");
    set(add(box, "p", "For " + person.name + "."), "class", "soft");
  }

  void add_comparison(xml_node main, const ReportComparison& comparison) {
    const std::string whose = comparison.session ? dated(report_.sessions[*comparison.session]) : comparison.subject;
    add(main, heading(depth()),
        several() ? fmt::format("Without guidance: {}, {}", whose, comparison.task)
                  : fmt::format("Without guidance: {}", comparison.task));
    add(main, "p",
        "Repetitions without any guidance are compared only with each other. A movement that improves under guidance "
        "is not necessarily learned, and much guidance can harm retention (guidance hypothesis: Salmoni, Schmidt and "
        "Walter 1984). Judge the practice by these metrics; the retention test is the most informative.");
    std::vector<std::size_t> first, others;
    for (std::size_t i = 0; i < all_trial_figures().size(); ++i)
      if (std::any_of(comparison.groups.begin(), comparison.groups.end(),
                      [&](const ReportComparison::Group& group) { return group.summaries[i].finished > 0; }))
        (is_main(i) ? first : others).push_back(i);
    const std::string caption = "Median (middle half) of the repetitions of each test, and the change of the median";
    add_comparison_table(main, comparison, first, caption + ".");
    if (others.empty()) return;
    xml_node details = main.append_child("details");
    add(details, "summary", "More metrics without guidance");
    add_comparison_table(details, comparison, others, caption + ": more metrics.");
  }

  /// Returns "Before (04 Mar 2026; 3 of 4 done, 1 partial)".
  [[nodiscard]] std::string test_title(const ReportComparison::Group& group) const {
    const ReportSession& session = report_.sessions[group.session];
    return fmt::format("{} ({}; {})", capitalised(group.test), local_date(session.created),
                       counts_in_words(session.exercises[group.exercise]));
  }

  void add_comparison_table(xml_node parent, const ReportComparison& comparison,
                            const std::vector<std::size_t>& figures, const std::string& caption) const {
    Table table(parent, caption, figures.size());
    table.column("Metric");
    const ReportComparison::Group& first = comparison.groups.front();
    for (const ReportComparison::Group& group : comparison.groups) {
      table.column(test_title(group), true);
      if (&group == &first) continue;
      table.column("Change", true);
      table.column("What it says");
    }
    for (const std::size_t i : figures) {
      const TrialFigure& figure = all_trial_figures()[i];
      table.row(with_unit(figure));
      for (const ReportComparison::Group& group : comparison.groups) {
        const ReportSummary& summary = group.summaries[i];
        std::string text = shown(figure, summary.median, false);
        if (const std::string half = middle_half(figure, summary); half != kUndefined)
          text += fmt::format(" ({})", half);
        table.number(text);
        if (&group == &first) continue;
        const ReportChange change = change_between(report_, point_of(first), point_of(group), i);
        table.number(shown(figure, change.change, false, true));
        table.text(change.words);
      }
    }
  }

  static void add_meanings(xml_node main) {
    add(main, "h2", "How the metrics are defined");
    add(main, "p",
        "Each metric describes one repetition after the approach to the start. The speed of the hand and the forces, "
        "but "
        "for peak forces, are low-pass filtered at 10 Hz without lag, so the metrics do not depend on the sampling "
        "rate. "
        "Each definition states its filter; the tables state the number of samples.");
    add(main, "p",
        fmt::format("{} stands for an undefined value, never for zero: nothing moved, there was no path or no force to "
                    "compare with, the repetition was stopped, or its recording is missing.",
                    kUndefined));
    add(main, "p", kOnsetAndEnd);
    add(main, "p", kAlignment);
    add(main, "p",
        "A repetition that ran out of time has the metrics of its movement until then. It counts in no trend. In "
        "medians "
        "and ranks it is below every finished repetition; leaving it out would make the weakest look best. A "
        "repetition "
        "that was stopped counts in neither.");
    add(main, "p",
        "One summary stands for a session: the median of its repetitions. Repetitions of different sessions are never "
        "pooled. A change between sessions is claimed only beyond the minimal detectable change of test-retest data; "
        "the "
        "spread of repetitions is not that error. This page claims no recovery, no learning and no clinical score.");
    xml_node list = main.append_child("dl");
    set(list, "class", "meanings");
    for (const TrialFigure& figure : all_trial_figures()) {
      add(list, "dt", with_unit(figure));
      add(list, "dd", fmt::format("{} Filter: {}.", figure.meaning, figure.filter));
    }
    add(list, "dt", "Trend");
    add(list, "dd",
        "A straight line fitted by least squares to at least four finished repetitions. The practice curve is a power "
        "law (Newell and Rosenbloom 1981) or an exponential (Heathcote, Brown and Mewhort 2000), whichever has the "
        "smaller residual. Over sessions, a line needs at least five of them.");
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
