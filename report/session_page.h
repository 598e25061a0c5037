// The part of a page that shows one session. Private to report.
#pragma once

#include "report/session_report.h"

#include <pugixml.hpp>
#include <string>

namespace haptrace {

/// Names of heading elements from h1 on; `depth` 1 is h1.
const char* heading(int depth);

/// Adds participant, device, protocol and the other facts that a reader needs to sign.
void add_facts(pugi::xml_node parent, const ReportSession& session);

/// Adds the warnings for the reader.
void add_remarks(pugi::xml_node parent, const ReportSession& session);

/// Adds the exercises, touched objects, stops and settings of a session. Their headings have this depth.
void add_session(pugi::xml_node parent, const Report& report, std::size_t session, int depth);

/// Returns the id of the section of an exercise.
std::string anchor(std::size_t session, std::size_t exercise);

/// Returns "movement time (s)".
std::string with_unit(const TrialFigure& figure);

/// Returns the action of the device, in words.
std::string mode_in_words(const ReportExercise& exercise);

/// Returns whether a metric is in the first table; the others are collapsed.
bool is_main(std::size_t figure);

/// Returns a duration as "12 s", "8 min" or "2 h 5 min", with spaces that do not break a line.
std::string lasting(double seconds);

/// Returns `text` with a capital first letter.
std::string capitalised(std::string text);

}  // namespace haptrace
