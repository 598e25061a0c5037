// Charts of a report, as SVG within its page. Private to report.
#pragma once

#include "report/course.h"

#include <pugixml.hpp>
#include <string>

namespace haptrace {

// Each function appends a <figure> with a chart and its description, or nothing if there is nothing to draw. Colours,
// widths and dashes are classes of page.css; repetitions have the classes t0 (the first) to t4 (the last).

/// Adds path, tunnel and hand paths in the plane of the two axes of W with the largest extent, with the same scale on
/// both axes.
void add_way_chart(pugi::xml_node parent, const ReportExercise& exercise);

/// Adds the distance from the path along it, and the tunnel.
void add_deviation_chart(pugi::xml_node parent, const ReportExercise& exercise);

/// Adds the felt force along the path, with mean and spread over the finished repetitions, and the expert's force.
void add_force_chart(pugi::xml_node parent, const ReportExercise& exercise);

/// Adds a metric by repetition and its fit; nothing for fewer than four repetitions.
void add_trend_chart(pugi::xml_node parent, const ReportExercise& exercise, const ReportTrend& trend);

/// Returns "-1.40 mm" with a true minus sign and a narrow space; an en dash for an undefined value. `sign` adds a plus.
std::string shown(const TrialFigure& figure, double value, bool with_unit = true, bool sign = false);

/// Adds a metric over sessions with their dates: median and middle half, and a line from five comparable sessions on.
void add_course_chart(pugi::xml_node parent, const Report& report, const ReportCourse& course, std::size_t figure);

/// Returns "falls by 0.2 mm per repetition". It claims nothing: the spread of repetitions is not the error of a
/// session. Empty without a line.
std::string in_words(const ReportTrend& trend);

}  // namespace haptrace
