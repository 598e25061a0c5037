// A report as one page for people.
#pragma once

#include "report/session_report.h"

#include <string>

namespace haptrace {

/// HTML 5, in UTF-8, that is also well-formed XML: style and pictures are in it, it runs no script, asks no network,
/// follows the reader's light or dark, and prints on A4. About 10 kB a repetition at most, and the programme.
std::string report_page(const Report& report);

}  // namespace haptrace
