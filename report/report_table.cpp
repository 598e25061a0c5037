#include "report/report_table.h"

#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

/// A line of fields. Texts are quoted where RFC 4180 requires it.
class TableRow {
 public:
  void add(std::string_view text) {
    separate();
    if (text.find_first_of(",\"\r\n") == std::string_view::npos) {
      line_ += text;
      return;
    }
    line_ += '"';
    for (const char c : text) line_ += c == '"' ? std::string("\"\"") : std::string(1, c);
    line_ += '"';
  }
  void add_count(int value) { add(fmt::format("{}", value)); }
  void add_number(const std::optional<double>& value) {
    add(value && std::isfinite(*value) ? fmt::format("{}", *value) : "");
  }

  [[nodiscard]] std::string end() && { return std::move(line_) + "\r\n"; }

 private:
  void separate() {
    if (!begun_)
      begun_ = true;
    else
      line_ += ',';
  }

  std::string line_;
  bool begun_ = false;
};

}  // namespace

std::string report_table(const Report& report) {
  TableRow header;
  for (const char* name :
       {"session", "subject",  "created",           "exercise",   "mode",     "test",       "warm_up",
        "path",    "round",    "repetition",        "attempt",    "began",    "file",       "stopped_by",
        "pace",    "radius_m", "stiffness_n_per_m", "assistance", "level",    "duration_s", "samples",
        "rank",    "reach",    "at_limit",          "answer",     "support_n"})
    header.add(name);
  for (const TrialFigure& figure : all_trial_figures()) header.add(figure.name);
  std::string table = std::move(header).end();
  for (const ReportSession& session : report.sessions)
    for (const ReportExercise& exercise : session.exercises)
      for (const ReportTrial& trial : exercise.trials) {
        TableRow row;
        for (const std::string* text :
             {&session.source, &session.subject, &session.created, &exercise.name, &exercise.mode, &exercise.test})
          row.add(*text);
        row.add_count(exercise.warm_up ? 1 : 0);
        row.add(exercise.path);
        for (const int number : {trial.round, trial.repetition, trial.attempt}) row.add_count(number);
        for (const std::string* text : {&trial.began, &trial.file, &trial.stopped_by}) row.add(*text);
        for (const auto& setting : {trial.pace, trial.radius, trial.stiffness, trial.assistance, trial.level})
          row.add_number(setting);
        row.add_number(trial.duration);
        row.add_count(static_cast<int>(trial.samples));
        row.add(trial.rank ? fmt::format("{}", *trial.rank) : "");
        row.add(trial.target);
        row.add_count(trial.at_limit ? 1 : 0);
        row.add(trial.answer ? fmt::format("{}", *trial.answer) : "");
        row.add_number(trial.support);
        for (const std::optional<double>& figure : trial.figures) row.add_number(figure);
        table += std::move(row).end();
      }
  return table;
}

}  // namespace haptrace
