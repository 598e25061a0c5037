// Figures: panels of lines with axes, drawn by Cairo.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace haptrace {

/// One line through points. NaN breaks it.
struct Series {
  std::string label;  ///< in the legend unless empty
  std::vector<double> x, y;
  int color = 0;  ///< index into the figure's palette, which stays distinguishable to colour-blind readers
  bool dashed = false;
  double width = 1.2;  ///< [pt]
};

/// One pair of axes.
struct Panel {
  std::string title, x_label, y_label;
  std::vector<Series> series;
  bool equal_scale = false;  ///< the same metre on both axes, for paths in space
  std::optional<std::pair<double, double>> x_range, y_range;  ///< else from the data
};

/// A grid of panels: rows of columns. Rows may have different numbers of columns.
struct Figure {
  std::string title, caption;
  std::vector<std::vector<Panel>> rows;
  double width = 960, height = 720;  ///< [px] at 96 dpi
};

/// Thins a line to about `points` of them without losing a peak: keeps first, lowest, highest and last of every bin.
Series decimate(const Series& series, std::size_t points);

/// Draws `figure` into `file`: .png, .svg or .pdf by its ending. Throws Error(input): unknown ending, file exists
/// (unless `overwrite`), cannot be written.
void save_figure(const Figure& figure, const std::string& file, bool overwrite);

}  // namespace haptrace
