// The part of a page that shows one exercise over sessions. Private to report.
#pragma once

#include "report/course.h"

#include <pugixml.hpp>

namespace haptrace {

/// Adds the heading (`heading` is an element: h2, h3 or h4), the trend, and one row per session with its median, its
/// middle half, the share that was finished, and what the change says.
void add_course(pugi::xml_node parent, const Report& report, const ReportPerson& person, const ReportCourse& course,
                const char* heading);

/// Returns "8 of 10 done, 1 partial, 1 stopped".
std::string counts_in_words(const ReportExercise& exercise);

/// Returns "1.23 to 1.45 mm", the middle half of the repetitions.
std::string middle_half(const TrialFigure& figure, const ReportSummary& summary);

/// Returns "0.8 to 2.1 mm (source; ages 20 to 60)", the reference range of a metric; empty without one that holds for
/// this exercise.
std::string reference_range(const Report& report, const ReportCourse::Point& point, std::size_t figure);

/// Returns the index of the primary metric of an exercise; nothing when it has none.
std::optional<std::size_t> primary_figure(const ReportExercise& exercise);

}  // namespace haptrace
