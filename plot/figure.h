// Figures: panels of lines with axes, drawn by Cairo.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace haptrace {

inline constexpr std::array<const char*, 3> kAxisNames{"x", "y", "z"};

/// One line through points. A value that is not finite, or beyond 1e100, breaks it. A single point is a dot.
struct Series {
  std::string label;  ///< in the legend unless empty
  std::vector<double> x, y;
  int color = 0;  ///< index into the figure's palette (Okabe and Ito), which colour-blind readers can tell apart:
                  ///< 0 blue, 1 vermillion, 2 green, 3 purple, 4 sky blue, 5 orange, 6 yellow, 7 black, and again
  bool dashed = false;
  double width = 1.2;  ///< [pt]
};

/// One pair of axes. Without anything to draw it says so.
struct Panel {
  std::string title, x_label, y_label;
  std::vector<Series> series;
  bool equal_scale = false;                                   ///< the same metre on both axes, for paths in space
  std::optional<std::pair<double, double>> x_range, y_range;  ///< else from the data
  bool log_x = false, log_y = false;                          ///< logarithmic axes; what is not positive breaks a line
};

/// A grid of panels: rows of columns. Rows may have different numbers of columns; those with a panel of equal scale are
/// taller.
struct Figure {
  std::string title, caption;
  std::vector<std::vector<Panel>> rows;
  double width = 960, height = 720;  ///< [px] at 96 dpi, 200 to 10000
};

/// Thins a line to about `points` of them without losing a peak: keeps first, lowest, highest and last of every bin,
/// and one break of a bin that has any. A line that is short enough is left as it is.
Series decimate(const Series& series, std::size_t points);

/// Round numbers (1, 2 or 5 times a power of ten apart) within [low, high]: at most `most` of them, and at least two
/// when `most` allows it. None unless low < high.
std::vector<double> tick_values(double low, double high, std::size_t most);

/// Throws Error(input) unless a figure can have this name by its ending, for those who compute before they draw.
void check_figure_name(const std::string& file);

/// Draws `figure` into `file`: .png (two pixels per px, so that it stays crisp), .svg or .pdf by its ending. The file
/// appears under its name only when it is complete. Throws Error(input): unknown ending, the file exists (unless
/// `overwrite`), cannot be written, a size out of its range.
void save_figure(const Figure& figure, const std::string& file, bool overwrite);

}  // namespace haptrace
