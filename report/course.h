// Exercises over sessions: one summary per session, and what a change between sessions says. Private to report.
#pragma once

#include "report/session_report.h"

#include <optional>
#include <span>
#include <string>

namespace haptrace {

/// Groups sessions by participant, and their exercises by path, mode and test label. Steered sessions have no course.
std::vector<ReportPerson> persons_of(std::span<const ReportSession> sessions);

/// How sure a change of a metric between two sessions is.
struct ReportChange {
  enum class Verdict {
    undefined,     ///< one of the values is
    incomparable,  ///< device, side or assistance changed
    unknown,       ///< the error between sessions is not known
    none,          ///< within the minimal detectable change
    beyond,        ///< beyond it
  };
  Verdict verdict = Verdict::unknown;
  double change = 0;            ///< of the medians; NaN where undefined
  std::optional<double> mdc95;  ///< minimal detectable change, if the norms state it for this exercise
  std::string words;            ///< the verdict, for readers
};

/// Judges the change of a metric from one exercise to another one on the same path, which may be in different sessions.
/// Only a change beyond the test-retest error of the norms is claimed: the spread of repetitions is not this error.
ReportChange change_between(const Report& report, const ReportCourse::Point& from, const ReportCourse::Point& to,
                            std::size_t figure);

/// Returns the norm of a metric if the norms hold for the device, task and mode of an exercise.
const MetricNorm* norm_of(const Report& report, const ReportCourse::Point& point, std::size_t figure);

/// Returns the minimal detectable change that a norm states or implies.
std::optional<double> mdc95_of(const MetricNorm& norm);

/// Returns why a value of `to` must not be compared with one of `from`; empty if it may.
std::string obstacle(const Report& report, const ReportCourse::Point& from, const ReportCourse::Point& to);

inline constexpr std::size_t kFewestForLine = 5;  ///< sessions; with fewer the interval of a line says nothing

/// A straight line over sessions.
struct CourseLine {
  double first = 0, last = 0;  ///< on the line, at the first and last session with a value
  double half_width = 0;       ///< of the 95 % confidence interval of last - first, if sessions were independent
  double from_day = 0, to_day = 0;
  std::size_t sessions = 0;
};

/// Fits a line to the medians of a metric; nothing below five comparable sessions with a value, or without dates.
std::optional<CourseLine> line_of(const Report& report, const ReportCourse& course, std::size_t figure);

/// Returns the exercise of a point.
inline const ReportExercise& exercise_of(const Report& report, const ReportCourse::Point& point) {
  return report.sessions[point.session].exercises[point.exercise];
}

}  // namespace haptrace
