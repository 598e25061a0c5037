#include "plot/figure.h"

#include "base/error.h"
#include "base/output_file.h"
#include "plot/axis.h"
#include "plot/palette.h"

#include <algorithm>
#include <array>
#include <cairo-pdf.h>
#include <cairo-svg.h>
#include <cairo.h>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <limits>
#include <memory>

namespace haptrace {
namespace {

constexpr double kBeyondPlotting = 1e100;
constexpr double kPx = 96.0 / 72;  // [px / pt]

bool drawable(double x, double y) {
  return std::abs(x) < kBeyondPlotting && std::abs(y) < kBeyondPlotting;
}

constexpr Rgb kInk{0.13, 0.13, 0.15}, kFaint{0.42, 0.42, 0.45}, kGrid{0.90, 0.90, 0.92}, kFrame{0.55, 0.55, 0.58};

// Text heights and distances [px].
constexpr double kFigureTitle = 17, kPanelTitle = 13, kText = 11.5, kMargin = 18, kGap = 22, kTick = 6,
                 kTickSpacing = 22;
constexpr double kEntryLine = 22, kEntryGap = 6;  // legend entries

const Rgb& color_of(const Series& s) {
  return palette(s.color);
}

struct Rect {
  double x = 0, y = 0, w = 0, h = 0;
};

enum class Align { left, center, right };

/// The few Cairo operations that a figure needs. Coordinates in px, y downwards.
class Canvas {
 public:
  explicit Canvas(cairo_t* cairo) : c_(cairo) {
    cairo_set_line_cap(c_, CAIRO_LINE_CAP_ROUND);
    cairo_set_line_join(c_, CAIRO_LINE_JOIN_ROUND);
  }

  void color(const Rgb& c, double opacity = 1) { cairo_set_source_rgba(c_, c.r, c.g, c.b, opacity); }

  void font(double size, bool bold = false) {
    cairo_select_font_face(c_, "sans-serif", CAIRO_FONT_SLANT_NORMAL,
                           bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
    cairo_set_font_size(c_, size);
  }

  double text_width(const std::string& text) {
    cairo_text_extents_t extents;
    cairo_text_extents(c_, text.c_str(), &extents);
    return extents.x_advance;
  }

  /// `y` is the base line.
  void text(double x, double y, const std::string& text, Align align) {
    const double width = text_width(text);
    cairo_move_to(c_, align == Align::left ? x : align == Align::center ? x - width / 2 : x - width, y);
    cairo_show_text(c_, text.c_str());
  }

  /// The same, in a smaller font if `width` requires it.
  void text_within(double x, double y, const std::string& what, Align align, double size, bool bold, double width) {
    font(size, bold);
    const double wide = text_width(what);
    if (wide > width) font(std::max(size * width / wide, 5.0), bold);
    text(x, y, what, align);
  }

  void text_upwards(double x, double y, const std::string& what, double size, double height) {
    cairo_save(c_);
    cairo_translate(c_, x, y);
    cairo_rotate(c_, -std::acos(0.0));
    text_within(0, 0, what, Align::center, size, false, height);
    cairo_restore(c_);
  }

  void line(double x0, double y0, double x1, double y1, double width) {
    cairo_set_line_width(c_, width);
    cairo_move_to(c_, x0, y0);
    cairo_line_to(c_, x1, y1);
    cairo_stroke(c_);
  }

  void fill(const Rect& r) {
    cairo_rectangle(c_, r.x, r.y, r.w, r.h);
    cairo_fill(c_);
  }

  void frame(const Rect& r, double width) {
    cairo_set_line_width(c_, width);
    cairo_rectangle(c_, r.x, r.y, r.w, r.h);
    cairo_stroke(c_);
  }

  void dot(double x, double y, double radius) {
    cairo_arc(c_, x, y, radius, 0, 4 * std::acos(0.0));
    cairo_fill(c_);
  }

  cairo_t* cairo() { return c_; }

 private:
  cairo_t* c_;
};

/// A panel's area on the canvas and its axes.
struct Plot {
  Rect area;
  Axis x, y;

  [[nodiscard]] double px(double v) const { return area.x + area.w * (v - x.range.low) / x.range.size(); }
  [[nodiscard]] double py(double v) const { return area.y + area.h * (1 - (v - y.range.low) / y.range.size()); }
};

/// Clamps a coordinate to the range of Cairo's fixed-point numbers. A clamped point is outside the figure.
double on_paper(double v) {
  return std::clamp(v, -2e4, 2e4);
}

/// Returns the runs of a line between its breaks, in px, without points that are too near to the previous one to be
/// seen.
std::vector<std::vector<std::pair<double, double>>> runs_of(const Series& series, const Plot& plot) {
  const std::size_t n = std::min(series.x.size(), series.y.size());
  const bool over_time = std::is_sorted(series.x.begin(), series.x.begin() + static_cast<std::ptrdiff_t>(n));
  const Series thin = over_time ? decimate(series, static_cast<std::size_t>(8 * plot.area.w)) : Series{};
  const Series& s = over_time ? thin : series;

  std::vector<std::vector<std::pair<double, double>>> runs(1);
  for (std::size_t i = 0; i < std::min(s.x.size(), s.y.size()); ++i) {
    if (!drawable(s.x[i], s.y[i])) {
      if (!runs.back().empty()) runs.emplace_back();
      continue;
    }
    const std::pair p{on_paper(plot.px(s.x[i])), on_paper(plot.py(s.y[i]))};
    auto& run = runs.back();
    if (run.size() > 1 && std::hypot(p.first - run.back().first, p.second - run.back().second) < 0.2) continue;
    run.push_back(p);
  }
  return runs;
}

void draw_series(Canvas& canvas, const Series& series, const Plot& plot) {
  const double width = series.width * kPx;
  canvas.color(color_of(series));
  cairo_t* c = canvas.cairo();
  cairo_set_line_width(c, width);
  const std::array dashes{5 * width, 3.5 * width};
  double drawn = 0;
  for (const auto& run : runs_of(series, plot)) {
    if (run.empty()) continue;
    if (run.size() == 1) {
      canvas.dot(run[0].first, run[0].second, std::max(1.5 * width, 2.5));
      continue;
    }
    // Draws in pieces, because the cost of a stroke grows with the square of the crossings within it.
    constexpr std::size_t kPiece = 500;
    for (std::size_t from = 0; from + 1 < run.size(); from += kPiece) {
      if (series.dashed) cairo_set_dash(c, dashes.data(), dashes.size(), drawn);
      cairo_move_to(c, run[from].first, run[from].second);
      for (std::size_t i = from + 1; i < run.size() && i <= from + kPiece; ++i) {
        cairo_line_to(c, run[i].first, run[i].second);
        drawn += std::hypot(run[i].first - run[i - 1].first, run[i].second - run[i - 1].second);
      }
      cairo_stroke(c);
    }
  }
  cairo_set_dash(c, nullptr, 0, 0);
}

/// Draws one legend entry: a piece of the line and its label. `y` is the base line. Returns the right end of the entry.
double draw_entry(Canvas& canvas, const Series& s, double x, double y) {
  const double width = std::max(s.width, 1.4) * kPx;
  const std::array dashes{3 * width, 2.2 * width};
  canvas.color(color_of(s));
  if (s.dashed) cairo_set_dash(canvas.cairo(), dashes.data(), dashes.size(), 0);
  canvas.line(x, y - 4, x + kEntryLine, y - 4, width);
  cairo_set_dash(canvas.cairo(), nullptr, 0, 0);
  canvas.color(kInk);
  canvas.text(x + kEntryLine + kEntryGap, y, s.label, Align::left);
  return x + kEntryLine + kEntryGap + canvas.text_width(s.label);
}

/// Returns the position at which a box of this size hides the least of the lines. It tries the corners first, then the
/// middles of the edges, then the centre.
Rect least_hiding(const Panel& panel, const Plot& plot, double w, double h) {
  const Rect& a = plot.area;
  const std::array xs{a.x + a.w - w - 8, a.x + 8, a.x + (a.w - w) / 2},
      ys{a.y + 8, a.y + a.h - h - 8, a.y + (a.h - h) / 2};
  constexpr std::array<std::array<std::size_t, 2>, 9> kPlaces{
      {{0, 0}, {1, 0}, {0, 1}, {1, 1}, {2, 0}, {2, 1}, {0, 2}, {1, 2}, {2, 2}}};
  std::array<std::size_t, kPlaces.size()> hidden{};
  const auto count = [&](double x, double y) {
    for (std::size_t i = 0; i < kPlaces.size(); ++i) {
      const double left = xs[kPlaces[i][0]], top = ys[kPlaces[i][1]];
      hidden[i] += x > left - 4 && x < left + w + 4 && y > top - 4 && y < top + h + 4;
    }
  };
  for (const Series& s : panel.series)
    for (const auto& run : runs_of(s, plot))
      for (std::size_t i = 0; i < run.size(); ++i) {
        const auto [x1, y1] = run[i];
        const auto [x0, y0] = run[i > 0 ? i - 1 : 0];
        const double pieces = std::ceil(std::clamp(std::hypot(x1 - x0, y1 - y0) / 5, 1.0, 1000.0));
        for (double k = 1; k <= pieces; ++k) count(x0 + k / pieces * (x1 - x0), y0 + k / pieces * (y1 - y0));
      }
  const auto place = kPlaces[static_cast<std::size_t>(std::min_element(hidden.begin(), hidden.end()) - hidden.begin())];
  return {xs[place[0]], ys[place[1]], w, h};
}

bool has_legend(const Panel& panel) {
  return std::any_of(panel.series.begin(), panel.series.end(), [](const Series& s) { return !s.label.empty(); });
}

/// Draws the legend beside the panel's title if one line has room for it, else in a box over the lines.
void draw_legend(Canvas& canvas, const Panel& panel, const Plot& plot) {
  constexpr double kPad = 7, kHeight = 17, kBetween = 16;
  if (!has_legend(panel)) return;
  double widest_text = 0, line = 0, entries = 0;
  canvas.font(kPanelTitle, true);
  const double title = canvas.text_width(panel.title);
  canvas.font(kText);
  for (const Series& s : panel.series)
    if (!s.label.empty()) {
      const double text = canvas.text_width(s.label);
      widest_text = std::max(widest_text, text);
      line += kEntryLine + kEntryGap + text + (entries > 0 ? kBetween : 0);
      ++entries;
    }

  const Rect& a = plot.area;
  if (title + 2 * kBetween + line < a.w) {
    double x = a.x + a.w - line;
    for (const Series& s : panel.series)
      if (!s.label.empty()) x = draw_entry(canvas, s, x, a.y - 8) + kBetween;
    return;
  }
  const Rect box = least_hiding(panel, plot, kPad + kEntryLine + kEntryGap + widest_text + kPad,
                                kPad + kHeight * entries + kPad - 3);
  canvas.color({1, 1, 1}, 0.85);
  canvas.fill(box);
  canvas.color(kGrid);
  canvas.frame(box, 1);
  double y = box.y + kPad + 10;
  for (const Series& s : panel.series) {
    if (s.label.empty()) continue;
    draw_entry(canvas, s, box.x + kPad, y);
    y += kHeight;
  }
}

struct Ranges {
  Range x, y;
  bool data = false;
};

Ranges ranges_of(const Panel& panel) {
  Ranges r;
  for (const Series& s : panel.series)
    for (std::size_t i = 0; i < std::min(s.x.size(), s.y.size()); ++i)
      if (drawable(s.x[i], s.y[i])) {
        r.x.include(s.x[i]);
        r.y.include(s.y[i]);
        r.data = true;
      }
  r.x = r.x.padded(panel.equal_scale ? 0.06 : 0);
  r.y = r.y.padded(0.06);
  const auto given = [](const auto& range) { return range && range->first < range->second; };
  if (given(panel.x_range)) r.x = {panel.x_range->first, panel.x_range->second};
  if (given(panel.y_range)) r.y = {panel.y_range->first, panel.y_range->second};
  return r;
}

/// Widens one of the two ranges so that both have the same scale on `area`.
void equalise(Ranges& r, const Rect& area) {
  const double scale = std::max(r.x.size() / area.w, r.y.size() / area.h);
  const auto widened = [scale](const Range& range, double pixels) {
    return Range{range.center() - 0.5 * scale * pixels, range.center() + 0.5 * scale * pixels};
  };
  r.x = widened(r.x, area.w);
  r.y = widened(r.y, area.h);
}

std::size_t ticks_for(double pixels, double spacing) {
  return static_cast<std::size_t>(std::max(pixels / spacing, 2.0));
}

double widest(Canvas& canvas, const std::vector<std::string>& labels) {
  double width = 0;
  for (const std::string& label : labels) width = std::max(width, canvas.text_width(label));
  return width;
}

/// Returns an axis with as many ticks as there is room for labels.
Axis horizontal_axis(Canvas& canvas, const Range& range, double pixels, bool log) {
  for (std::size_t most = ticks_for(pixels, 50); most > 2; --most) {
    Axis axis = make_axis(range, most, log);
    if ((widest(canvas, axis.labels) + 14) * static_cast<double>(axis.labels.size()) < pixels) return axis;
  }
  return make_axis(range, 2, log);
}

struct Margins {
  double left, top, right, bottom;
};

Margins margins_of(Canvas& canvas, const Panel& panel, double height) {
  canvas.font(kText);
  const Axis y = make_axis(ranges_of(panel).y, ticks_for(height, kTickSpacing), panel.log_y);
  return {widest(canvas, y.labels) + kTick + 4 + (panel.y_label.empty() ? 0 : kText + 9),
          panel.title.empty() && !has_legend(panel) ? 8 : kPanelTitle + 10, 12,
          kTick + kText + 3 + (panel.x_label.empty() ? 0 : kText + 7)};
}

void draw_axes(Canvas& canvas, const Panel& panel, const Plot& plot, double outer_left) {
  const Rect& a = plot.area;
  canvas.font(kText);
  for (std::size_t i = 0; i < plot.x.ticks.size(); ++i) {
    const double x = plot.px(plot.x.ticks[i]);
    canvas.color(kGrid);
    canvas.line(x, a.y, x, a.y + a.h, 1);
    canvas.color(kInk);
    canvas.text(x, a.y + a.h + kTick + kText - 1, plot.x.labels[i], Align::center);
  }
  for (std::size_t i = 0; i < plot.y.ticks.size(); ++i) {
    const double y = plot.py(plot.y.ticks[i]);
    canvas.color(kGrid);
    canvas.line(a.x, y, a.x + a.w, y, 1);
    canvas.color(kInk);
    canvas.text(a.x - kTick, y + 0.35 * kText, plot.y.labels[i], Align::right);
  }
  const std::string x_label = with_exponent(panel.x_label, plot.x), y_label = with_exponent(panel.y_label, plot.y);
  canvas.color(kInk);
  canvas.text_within(a.x + a.w / 2, a.y + a.h + kTick + 2 * kText + 7, x_label, Align::center, kText, false, a.w);
  canvas.text_upwards(outer_left + kText, a.y + a.h / 2, y_label, kText, a.h);
  if (!panel.title.empty()) canvas.text_within(a.x, a.y - 8, panel.title, Align::left, kPanelTitle, true, a.w);
}

void draw_panel(Canvas& canvas, const Panel& panel, const Rect& cell, const Margins& m) {
  Plot plot;
  plot.area = {cell.x + m.left, cell.y + m.top, std::max(cell.w - m.left - m.right, 10.0),
               std::max(cell.h - m.top - m.bottom, 10.0)};
  const Rect& a = plot.area;
  Ranges ranges = ranges_of(panel);
  if (panel.equal_scale) equalise(ranges, a);
  canvas.font(kText);
  plot.x = horizontal_axis(canvas, ranges.x, a.w, panel.log_x);
  plot.y = make_axis(ranges.y, ticks_for(a.h, kTickSpacing), panel.log_y);
  if (!ranges.data) plot.x.ticks.clear(), plot.y.ticks.clear();

  draw_axes(canvas, panel, plot, cell.x);
  cairo_save(canvas.cairo());
  cairo_rectangle(canvas.cairo(), a.x, a.y, a.w, a.h);
  cairo_clip(canvas.cairo());
  for (const Series& s : panel.series) draw_series(canvas, s, plot);
  cairo_restore(canvas.cairo());
  canvas.color(kFrame);
  canvas.frame(a, 1);
  if (ranges.data) {
    draw_legend(canvas, panel, plot);
  } else {
    canvas.color(kFaint);
    canvas.text_within(a.x + a.w / 2, a.y + a.h / 2 + 4, "no data", Align::center, kText, false, a.w);
  }
}

std::vector<std::string> wrapped(Canvas& canvas, const std::string& text, double width) {
  std::vector<std::string> lines;
  std::size_t from = 0;
  while (from < text.size()) {
    const std::size_t to = std::min(text.find_first_of(" \n", from), text.size());
    const std::string word = text.substr(from, to - from);
    if (lines.empty() || (from > 0 && text[from - 1] == '\n') || canvas.text_width(lines.back() + " " + word) > width)
      lines.push_back(word);
    else
      lines.back() += " " + word;
    from = to + 1;
  }
  return lines;
}

/// Returns the panel with decimal logarithms on its logarithmic axes.
Panel in_logarithms(Panel panel) {
  const auto take = [](std::vector<double>& values) {
    for (double& v : values) v = v > 0 ? std::log10(v) : std::numeric_limits<double>::quiet_NaN();
  };
  const auto take_range = [](std::optional<std::pair<double, double>>& range) {
    if (range) range = std::pair(std::log10(range->first), std::log10(range->second));
  };
  for (Series& s : panel.series) {
    if (panel.log_x) take(s.x);
    if (panel.log_y) take(s.y);
  }
  if (panel.log_x) take_range(panel.x_range);
  if (panel.log_y) take_range(panel.y_range);
  return panel;
}

void draw(Canvas& canvas, Figure figure) {
  for (auto& row : figure.rows)
    for (Panel& panel : row) panel = in_logarithms(std::move(panel));
  canvas.color({1, 1, 1});
  canvas.fill({0, 0, figure.width, figure.height});

  double top = kMargin, bottom = figure.height - kMargin;
  const double wide = figure.width - 2 * kMargin;
  if (!figure.title.empty()) {
    canvas.color(kInk);
    canvas.text_within(kMargin, top + kFigureTitle - 2, figure.title, Align::left, kFigureTitle, true, wide);
    top += kFigureTitle + 14;
  }
  canvas.font(kText);
  const std::vector<std::string> caption = wrapped(canvas, figure.caption, wide);
  canvas.color(kFaint);
  for (std::size_t i = caption.size(); i-- > 0; bottom -= kText + 4)
    canvas.text(kMargin, bottom, caption[i], Align::left);
  if (!caption.empty()) bottom -= 8;

  double shares = 0;
  const auto share = [](const std::vector<Panel>& row) {
    return std::any_of(row.begin(), row.end(), [](const Panel& p) { return p.equal_scale; }) ? 2.0 : 1.0;
  };
  for (const auto& row : figure.rows) shares += share(row);
  const double room = bottom - top - kGap * static_cast<double>(std::max<std::size_t>(figure.rows.size(), 1) - 1);

  // All panels of a column have the same left margin, so that their axes are aligned.
  std::vector<double> left;
  for (const auto& row : figure.rows)
    for (std::size_t i = 0; i < row.size(); ++i) {
      if (i == left.size()) left.push_back(0);
      left[i] = std::max(left[i], margins_of(canvas, row[i], room / shares).left);
    }

  for (const auto& row : figure.rows) {
    const double height = room * share(row) / shares, columns = static_cast<double>(row.size());
    const double width = (wide - kGap * (columns - 1)) / columns;
    for (std::size_t i = 0; i < row.size(); ++i) {
      Margins margins = margins_of(canvas, row[i], height);
      margins.left = left[i];
      draw_panel(canvas, row[i], {kMargin + static_cast<double>(i) * (width + kGap), top, width, height}, margins);
    }
    top += height + kGap;
  }
}

cairo_status_t append(void* to, const unsigned char* bytes, unsigned int count) {
  static_cast<std::string*>(to)->append(reinterpret_cast<const char*>(bytes), count);
  return CAIRO_STATUS_SUCCESS;
}

using SurfacePtr = std::unique_ptr<cairo_surface_t, decltype(&cairo_surface_destroy)>;
using CairoPtr = std::unique_ptr<cairo_t, decltype(&cairo_destroy)>;

/// Returns the contents of the file.
std::string rendered(const Figure& figure, const std::string& file, const std::string& ending) {
  constexpr double kPngScale = 2;
  std::string bytes;
  double scale = 1;
  SurfacePtr surface(nullptr, cairo_surface_destroy);
  if (ending == ".png") {
    scale = kPngScale;
    surface.reset(cairo_image_surface_create(CAIRO_FORMAT_RGB24, static_cast<int>(scale * figure.width),
                                             static_cast<int>(scale * figure.height)));
  } else if (ending == ".svg") {
    surface.reset(cairo_svg_surface_create_for_stream(append, &bytes, figure.width, figure.height));
    cairo_svg_surface_set_document_unit(surface.get(), CAIRO_SVG_UNIT_PX);
  } else {
    scale = 1 / kPx;
    surface.reset(cairo_pdf_surface_create_for_stream(append, &bytes, scale * figure.width, scale * figure.height));
  }
  cairo_status_t status = CAIRO_STATUS_SUCCESS;
  {
    const CairoPtr cairo(cairo_create(surface.get()), cairo_destroy);
    cairo_scale(cairo.get(), scale, scale);
    Canvas canvas(cairo.get());
    draw(canvas, figure);
    status = cairo_status(cairo.get());
  }
  if (status == CAIRO_STATUS_SUCCESS && ending == ".png")
    status = cairo_surface_write_to_png_stream(surface.get(), append, &bytes);
  cairo_surface_finish(surface.get());
  if (status == CAIRO_STATUS_SUCCESS) status = cairo_surface_status(surface.get());
  if (status != CAIRO_STATUS_SUCCESS)
    throw input_error(fmt::format("{}: the figure cannot be drawn: {}", file, cairo_status_to_string(status)));
  return bytes;
}

}  // namespace

Series decimate(const Series& series, std::size_t points) {
  const std::size_t n = std::min(series.x.size(), series.y.size()), bins = std::max<std::size_t>(points / 4, 1);
  if (n <= 4 * bins) return series;

  Series thin = series;
  thin.x.clear();
  thin.y.clear();
  for (std::size_t bin = 0; bin < bins; ++bin) {
    // Indices to keep: first, lowest, highest, last, and one break.
    constexpr std::size_t none = std::numeric_limits<std::size_t>::max();
    std::array<std::size_t, 5> keep{};
    keep.fill(none);
    auto& [first, lowest, highest, last, broken] = keep;
    for (std::size_t i = n / bins * bin + n % bins * bin / bins; i < n / bins * (bin + 1) + n % bins * (bin + 1) / bins;
         ++i) {
      if (!drawable(series.x[i], series.y[i])) {
        if (broken == none) broken = i;
        continue;
      }
      if (first == none) first = lowest = highest = i;
      if (series.y[i] < series.y[lowest]) lowest = i;
      if (series.y[i] > series.y[highest]) highest = i;
      last = i;
    }
    std::sort(keep.begin(), keep.end());
    for (std::size_t k = 0; k < keep.size() && keep[k] != none; ++k) {
      if (k > 0 && keep[k] == keep[k - 1]) continue;
      thin.x.push_back(series.x[keep[k]]);
      thin.y.push_back(series.y[keep[k]]);
    }
  }
  return thin;
}

void check_figure_name(const std::string& file) {
  const std::string ending = std::filesystem::path(file).extension().string();
  if (ending != ".png" && ending != ".svg" && ending != ".pdf")
    throw input_error(fmt::format("{}: a figure's name must end in .png, .svg or .pdf", file));
}

void save_figure(const Figure& figure, const std::string& file, bool overwrite) {
  check_figure_name(file);
  const std::string ending = std::filesystem::path(file).extension().string();
  for (const double side : {figure.width, figure.height})
    if (!(side >= 200 && side <= 10000))
      throw input_error(
          fmt::format("{}: the figure is {} x {} px; each must be 200 to 10000", file, figure.width, figure.height));

  OutputFile output(file, overwrite);
  const std::string bytes = rendered(figure, file, ending);
  output.create();
  std::ofstream stream(output.path(), std::ios::binary | std::ios::trunc);
  stream.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  stream.close();
  if (!stream) throw input_error(fmt::format("{}: cannot be written: is the disk full?", file));
  output.commit();
}

}  // namespace haptrace
