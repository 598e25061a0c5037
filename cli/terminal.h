// Output of the command: to a terminal, a pipe, or nowhere.
#pragma once

#include <cstdio>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace::cli {

/// Writes to stdout or stderr. A stream that fails (a closed terminal, a pipe without a reader, a full disk) is silent
/// from then on. The failure neither throws nor ends a session with a force in the motors. If a terminal is stopped
/// (Ctrl+S), results on stdout wait for it, and messages are dropped after a second.
void write_out(std::FILE* stream, const std::string& text) noexcept;

/// Returns true if stdout refused text for lack of room.
bool results_lost() noexcept;

/// Returns the current columns of the terminal on standard error; if unknown, COLUMNS or else 80.
int terminal_width();

/// Returns the columns that a text takes on a terminal: wide characters take two, combining ones none.
int display_width(std::string_view utf8);

/// A part of a progress line. If room is short, parts with the largest rank are dropped first; rank 0 stays.
struct LinePart {
  int rank = 0;
  std::string text;
};

/// Joins the parts that fit into `columns`, separated by two spaces. Cuts the line if even those of rank 0 do not fit.
std::string fitted_line(std::vector<LinePart> parts, int columns);

/// Replaces the line on standard error, which is a terminal, with the `parts` that fit into one line. Never waits: a
/// line that the terminal does not accept is dropped.
void show_line(std::vector<LinePart> parts);
void show_line(const std::string& text);
void clear_line();

}  // namespace haptrace::cli
