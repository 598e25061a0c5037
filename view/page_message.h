// Text messages of a page (docs/view-protocol.md). Private to view.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

enum class PageWants { none, state, samples };

/// A text message of a page. Members that its type does not have keep their defaults.
struct PageMessage {
  enum class Type { unknown, hello, want, bins, rows, open, command, stop, shown, ping };

  Type type = Type::unknown;
  std::uint32_t id = 0;
  std::uint32_t version = 0, pixels = 0, index = 0, trial = 0;
  std::uint64_t frame = 0;
  double t0 = 0, t1 = 0;       ///< [s]
  double time = 0, sent = 0;   ///< [s]
  std::optional<double> last;  ///< time of the last row that the page has [s]
  std::string token, line, what;
  PageWants wants = PageWants::none;
  std::vector<std::string> channels;
};

/// Parses a text message. Returns nothing if it is not a JSON object with a text `type`, or a value has another type
/// than the protocol says, is not finite or is out of range. Never throws for any text.
std::optional<PageMessage> parse_page_message(std::string_view text);

}  // namespace haptrace
