// What the command writes: to a terminal, a pipe, or nowhere.
#pragma once

#include <cstdio>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace::cli {

/// Writes to stdout or stderr. A stream that does not take it (a closed terminal, a pipe without a reader, a full disk)
/// is silent from then on: it neither throws, nor ends a session with a force in the motors. A terminal that stands
/// still (Ctrl+S) is waited for only with results, on stdout; messages are left out after a second.
void write_out(std::FILE* stream, const std::string& text) noexcept;

/// Whether stdout has refused a text for want of room.
bool results_lost() noexcept;

/// Columns of the terminal on standard error, as it is now; without an answer COLUMNS, else 80.
int terminal_width();

/// Columns that a text takes on a terminal: wide characters take two, combining ones none.
int display_width(std::string_view utf8);

/// A part of a progress line. Where room is short, parts with the largest rank are left out first; rank 0 stays.
struct LinePart {
  int rank = 0;
  std::string text;
};

/// Joins the parts that fit into `columns` with two spaces between; cuts the line where even those of rank 0 do not
/// fit.
std::string fitted_line(std::vector<LinePart> parts, int columns);

/// Replaces the line on standard error, which is a terminal, by as much of `parts` as fits into one line of it. Waits
/// for nothing: a line that the terminal does not take is left out.
void show_line(std::vector<LinePart> parts);
void show_line(const std::string& text);
void clear_line();

}  // namespace haptrace::cli
