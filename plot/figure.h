// Figures: panels of lines with axes, drawn by Cairo.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace haptrace {

inline constexpr std::array<const char*, 3> kAxisNames{"x", "y", "z"};

/// One line through points. A value that is not finite, or beyond 1e100, breaks it. A single point is drawn as a dot.
struct Series {
  std::string label;  ///< legend text; empty: not in the legend
  std::vector<double> x, y;
  int color = 0;  ///< index into the palette (Okabe and Ito), whose colours colour-blind readers can distinguish: 0
                  ///< blue, 1 vermillion, 2 green, 3 purple, 4 sky blue, 5 orange, 6 yellow, 7 black; then it repeats
  bool dashed = false;
  double width = 1.2;  ///< [pt]
};

/// One pair of axes. A panel without data shows "no data".
struct Panel {
  std::string title, x_label, y_label;
  std::vector<Series> series;
  bool equal_scale = false;                                   ///< same scale on both axes, for paths in space
  std::optional<std::pair<double, double>> x_range, y_range;  ///< empty: from the data
  bool log_x = false, log_y = false;  ///< logarithmic axes; a value that is not positive breaks a line
};

/// A grid of panels: rows of columns. Rows may have different numbers of columns. Rows that contain a panel of equal
/// scale are taller.
struct Figure {
  std::string title, caption;
  std::vector<std::vector<Panel>> rows;
  double width = 960, height = 720;  ///< [px] at 96 dpi, 200 to 10000
};

/// Thins a line to about `points` points without losing a peak: keeps first, lowest, highest and last of every bin, and
/// one break if the bin has any. A shorter line stays unchanged.
Series decimate(const Series& series, std::size_t points);

/// Throws Error(input) unless the ending of `file` is that of a figure. Callers check the name before a long
/// computation.
void check_figure_name(const std::string& file);

/// Draws `figure` into `file`: .png (two pixels per px, for sharp display), .svg or .pdf by its ending. The file
/// appears under its name only when it is complete. Throws Error(input) when the ending is unknown, the file exists
/// (unless `overwrite`) or cannot be written, or a size is out of range.
void save_figure(const Figure& figure, const std::string& file, bool overwrite);

}  // namespace haptrace
