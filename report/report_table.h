// A report as a table for statistics.
#pragma once

#include "report/session_report.h"

#include <string>

namespace haptrace {

/// Returns CSV (RFC 4180, decimal points, SI): a header, then one row per repetition, including stopped ones. Metrics
/// have the names of all_trial_figures(); an undefined metric has an empty field.
std::string report_table(const Report& report);

}  // namespace haptrace
