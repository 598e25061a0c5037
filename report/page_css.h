// The contents of page.css, embedded by the build. Private to report.
#pragma once

namespace haptrace {

extern const char* const kPageCss;

}  // namespace haptrace
