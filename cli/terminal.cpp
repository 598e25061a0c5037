#include "cli/terminal.h"

#include "base/printable.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <fcntl.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>
#include <utility>

namespace haptrace::cli {
namespace {

std::atomic<bool> no_room{false};  // standard output ran out of room

constexpr const char* kReplaceLine = "\r\033[K";

struct CodeRange {
  char32_t first, last;
};
// East Asian Width W and F (Unicode 15, UAX #11), merged across gaps with only rare scripts.
constexpr std::array<CodeRange, 10> kWide{{{0x1100, 0x115F},
                                           {0x2E80, 0x303E},
                                           {0x3041, 0xA4CF},
                                           {0xAC00, 0xD7A3},
                                           {0xF900, 0xFAFF},
                                           {0xFE30, 0xFE6F},
                                           {0xFF00, 0xFF60},
                                           {0xFFE0, 0xFFE6},
                                           {0x1F300, 0x1FAFF},
                                           {0x20000, 0x3FFFD}}};
constexpr std::array<CodeRange, 4> kNoWidth{{{0x0300, 0x036F}, {0x200B, 0x200F}, {0x20D0, 0x20FF}, {0xFE00, 0xFE0F}}};

template <class Ranges>
bool in_one_of(char32_t code, const Ranges& ranges) {
  return std::any_of(ranges.begin(), ranges.end(),
                     [code](const CodeRange& range) { return range.first <= code && code <= range.last; });
}

/// Returns the number of bytes of a text's first character, and its columns. A byte that is not UTF-8 takes one column.
std::pair<std::size_t, int> measured_character(std::string_view text) {
  const Character character = first_character(text);
  return {std::max<std::size_t>(character.bytes, 1), in_one_of(character.code, kNoWidth) ? 0
                                                     : in_one_of(character.code, kWide)  ? 2
                                                                                         : 1};
}

std::string joined(const std::vector<LinePart>& parts) {
  std::string line;
  for (const LinePart& part : parts) line += (line.empty() ? "" : "  ") + part.text;
  return line;
}

std::string cut(std::string_view text, int columns) {
  std::size_t end = 0;
  while (end < text.size()) {
    const auto [bytes, width] = measured_character(text.substr(end));
    if ((columns -= width) < 0) break;
    end += bytes;
  }
  return std::string(text.substr(0, end));
}

/// Returns true if a stream accepts output within `patience_ms`, or if it cannot be polled.
bool takes(std::FILE* stream, int patience_ms) noexcept {
  pollfd asked{.fd = fileno(stream), .events = POLLOUT, .revents = 0};
  return ::poll(&asked, 1, patience_ms) != 0;
}

}  // namespace

void write_out(std::FILE* stream, const std::string& text) noexcept {
  constexpr int kPatience = 1000;  // longest wait for a stopped terminal [ms]
  if (stream == stderr && isatty(fileno(stream)) != 0 && !takes(stream, kPatience)) return;
  if (std::fwrite(text.data(), 1, text.size(), stream) == text.size() && std::fflush(stream) == 0) return;
  const int reason = errno;
  if (stream == stdout && (reason == ENOSPC || reason == EDQUOT || reason == EFBIG)) no_room = true;
  std::clearerr(stream);
  const int nowhere = ::open("/dev/null", O_WRONLY | O_CLOEXEC);
  if (nowhere < 0) return;
  (void)::dup2(nowhere, fileno(stream));
  ::close(nowhere);
}

bool results_lost() noexcept {
  return no_room;
}

int terminal_width() {
  winsize size{};
  if (ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0) return size.ws_col;
  const char* columns = std::getenv("COLUMNS");  // NOLINT(concurrency-mt-unsafe): nobody sets it
  const long asked = columns != nullptr ? std::strtol(columns, nullptr, 10) : 0;
  return asked > 0 && asked < 10'000 ? static_cast<int>(asked) : 80;
}

int display_width(std::string_view utf8) {
  int width = 0;
  while (!utf8.empty()) {
    const auto [bytes, columns] = measured_character(utf8);
    width += columns;
    utf8.remove_prefix(bytes);
  }
  return width;
}

std::string fitted_line(std::vector<LinePart> parts, int columns) {
  std::erase_if(parts, [](const LinePart& part) { return part.text.empty(); });
  std::string line = joined(parts);
  while (display_width(line) > columns) {
    // Among equal ranks, drop the last part first.
    const auto least = std::max_element(parts.rbegin(), parts.rend(),
                                        [](const LinePart& a, const LinePart& b) { return a.rank < b.rank; });
    if (least == parts.rend() || least->rank == 0) return cut(line, columns);
    parts.erase(std::prev(least.base()));
    line = joined(parts);
  }
  return line;
}

void show_line(std::vector<LinePart> parts) {
  // After Ctrl+S a terminal accepts nothing; the end of a session must not wait for it.
  if (!takes(stderr, 0)) return;
  // A line that fills the last column makes some terminals wrap.
  write_out(stderr, kReplaceLine + fitted_line(std::move(parts), terminal_width() - 1));
}

void show_line(const std::string& text) {
  show_line({{0, text}});
}

void clear_line() {
  if (!takes(stderr, 0)) return;
  write_out(stderr, kReplaceLine);
}

}  // namespace haptrace::cli
