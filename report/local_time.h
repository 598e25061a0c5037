// Times of recordings in the reader's zone. Private to report.
#pragma once

#include <string>

namespace haptrace {

/// Returns "04 March 2026, 10:30 CET (UTC+01:00)" in the computer's time zone; the text itself if it is no RFC 3339
/// time.
std::string local_time(const std::string& rfc3339);

/// Returns "4 Mar 2026, 10:30" in the computer's time zone; the text itself if it is no RFC 3339 time.
std::string local_minute(const std::string& rfc3339);

/// Returns "4 Mar 2026" in the computer's time zone; the text itself if it is no RFC 3339 time.
std::string local_date(const std::string& rfc3339);

}  // namespace haptrace
