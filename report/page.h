// A report as one HTML page for readers.
#pragma once

#include "report/session_report.h"

#include <string>

namespace haptrace {

/// Returns the report as HTML 5 in UTF-8, which is also well-formed XML. Styles and charts are embedded. The page runs
/// no script, uses no network, follows the reader's light or dark theme, and prints on A4. Its size is the programme
/// and at most about 10 kB per repetition.
std::string report_page(const Report& report);

}  // namespace haptrace
