// The pictures of a report, as SVG within its page. Private to report.
#pragma once

#include "report/session_report.h"

#include <pugixml.hpp>
#include <string>

namespace haptrace {

// Each appends a <figure> with its picture and what is to be seen in it, or nothing where there is nothing to draw.
// Colours, widths and dashes are classes of page.css; repetitions go from class t0 (the first) to t4 (the last).

/// Path, tunnel and the ways of the hand in the plane of two axes of W in which they are largest, the same metre on
/// both.
void add_way_chart(pugi::xml_node parent, const ReportExercise& exercise);

/// Distance from the path by place, and the tunnel.
void add_deviation_chart(pugi::xml_node parent, const ReportExercise& exercise);

/// The felt force by place, mean and spread over the finished repetitions, and the expert's.
void add_force_chart(pugi::xml_node parent, const ReportExercise& exercise);

/// A figure by repetition, and what was fitted to it; nothing for fewer than four.
void add_trend_chart(pugi::xml_node parent, const ReportExercise& exercise, const ReportTrend& trend);

/// "-1.40 mm" with a true minus sign and a narrow space; an en dash for what is undefined. `sign`: also plus.
std::string shown(const TrialFigure& figure, double value, bool with_unit = true, bool sign = false);

/// "falls by 0.2 mm a repetition (95 % interval 0.1 to 0.3 mm): better". Empty without a line.
std::string in_words(const ReportTrend& trend);

}  // namespace haptrace
