// page.css, as the build found it. Private to report.
#pragma once

namespace haptrace {

extern const char* const kPageCss;

}  // namespace haptrace
