// A report as a table for statistics.
#pragma once

#include "report/session_report.h"

#include <string>

namespace haptrace {

/// CSV (RFC 4180, a point in numbers, SI): a header, then one row per repetition, stopped ones included. Figures have
/// the names of all_trial_figures(); the field of one that is undefined is empty.
std::string report_table(const Report& report);

}  // namespace haptrace
