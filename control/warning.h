// Warnings: everything that the operator should know about a session, from any source. One type and one list,
// SessionResult::warnings, which reaches the terminal, the summary, --json, the recording and the report.
#pragma once

#include "base/severity.h"
#include "base/types.h"

#include <string>

namespace haptrace {

struct Warning {
  Severity severity = Severity::warning;
  std::string code;    ///< the kind, for programs: lower case, words joined by _
  double time = kNaN;  ///< time since the session's first tick [s]; NaN: no particular moment
  std::string text;    ///< one line of text, complete without the other members
};

}  // namespace haptrace
