#include "report/chart.h"

#include "control/path/path.h"
#include "plot/axis.h"
#include "plot/figure.h"
#include "report/local_time.h"
#include "report/markup.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <limits>

namespace haptrace {
namespace {

constexpr double kMm = 1e3;
constexpr double kLeft = 50, kRight = 14, kTop = 26, kBottom = 44;  // [px]
constexpr double kWidth = 480, kHeight = 320, kWayHeight = 400;

/// An SVG with a pair of axes.
class Plot {
 public:
  Plot(pugi::xml_node figure, const std::string& label, double height, const Range& x, const Range& y)
      : height_(height), x_(x), y_(y) {
    svg_ = figure.append_child("svg");
    set(svg_, "class", "chart");
    set(svg_, "viewBox", fmt::format("0 0 {} {}", kWidth, height));
    set(svg_, "role", "img");
    set(svg_, "aria-label", label);
  }

  [[nodiscard]] double px(double v) const { return kLeft + (v - x_.low) / x_.size() * (kWidth - kLeft - kRight); }
  [[nodiscard]] double py(double v) const { return kTop + (1 - (v - y_.low) / y_.size()) * (height_ - kTop - kBottom); }
  [[nodiscard]] double scale() const { return (kWidth - kLeft - kRight) / x_.size(); }  ///< [px] per unit of x

  void axes(const std::string& x_label, const std::string& y_label, bool whole_x = false) {
    const double bottom = height_ - kBottom;
    const Axis axis = make_axis(x_, 8, false);
    for (std::size_t i = 0; i < axis.ticks.size(); ++i) {
      const double v = axis.ticks[i];
      if (whole_x && v != std::round(v)) continue;
      line("grid", px(v), kTop, px(v), bottom);
      text("tick", px(v), bottom + 17, whole_x ? fmt::format("{:.0f}", v) : axis.labels[i], "middle");
    }
    line("axis", kLeft, bottom, kWidth - kRight, bottom);
    text("label", kWidth - kRight, height_ - 8, with_exponent(x_label, axis), "end");
    vertical_axis(y_label);
  }

  /// Draws the vertical axis, and these labels below places of the horizontal one. Labels that would overlap are left
  /// out.
  void dated_axes(const std::vector<std::pair<double, std::string>>& dates, const std::string& y_label) {
    constexpr double kLabelWidth = 92;  // [px]
    const double bottom = height_ - kBottom;
    double free_from = 0;
    for (const auto& [x, date] : dates) {
      line("grid", px(x), kTop, px(x), bottom);
      const double left = std::clamp(px(x) - kLabelWidth / 2, kLeft - 8, kWidth - kLabelWidth);
      if (left < free_from) continue;
      text("tick", left + kLabelWidth / 2, bottom + 17, date, "middle");
      free_from = left + kLabelWidth;
    }
    line("axis", kLeft, bottom, kWidth - kRight, bottom);
    text("label", kWidth - kRight, height_ - 8, "date", "end");
    vertical_axis(y_label);
  }

  /// Draws a vertical bar, in the units of the axes.
  void bar(const char* name, double x, double low, double high) { line(name, px(x), py(low), px(x), py(high)); }

  void line(const char* name, double x0, double y0, double x1, double y1) {
    pugi::xml_node node = child("line", name);
    const std::array<std::pair<const char*, double>, 4> ends{{{"x1", x0}, {"y1", y0}, {"x2", x1}, {"y2", y1}}};
    for (const auto& [key, value] : ends) set(node, key, fmt::format("{:.1f}", value));
  }

  void text(const char* name, double x, double y, const std::string& what, const char* anchor) {
    pugi::xml_node node = child("text", name);
    set(node, "x", fmt::format("{:.1f}", x));
    set(node, "y", fmt::format("{:.1f}", y));
    set(node, "text-anchor", anchor);
    add_text(node, what);
  }

  /// Draws a line through points in the units of the axes. NaN breaks it.
  pugi::xml_node curve(const std::string& name, const std::vector<double>& x, const std::vector<double>& y) {
    std::string data;
    bool pen_down = false;
    for (std::size_t i = 0; i < x.size(); ++i) {
      if (!std::isfinite(x[i]) || !std::isfinite(y[i])) {
        pen_down = false;
        continue;
      }
      data += fmt::format("{}{:.1f} {:.1f}", pen_down ? "L" : "M", px(x[i]), py(y[i]));
      pen_down = true;
    }
    pugi::xml_node node = child("path", name);
    set(node, "d", data);
    return node;
  }

  /// Fills the area between two lines over the same x, between breaks.
  void band(const std::string& name, const std::vector<double>& x, const std::vector<double>& low,
            const std::vector<double>& high) {
    std::string data;
    for (std::size_t from = 0; from < x.size();) {
      std::size_t to = from;
      while (to < x.size() && std::isfinite(low[to]) && std::isfinite(high[to])) ++to;
      for (std::size_t i = from; i < to; ++i)
        data += fmt::format("{}{:.1f} {:.1f}", i == from ? "M" : "L", px(x[i]), py(high[i]));
      for (std::size_t i = to; i-- > from;) data += fmt::format("L{:.1f} {:.1f}", px(x[i]), py(low[i]));
      if (to > from) data += "Z";
      from = to + 1;
    }
    set(child("path", name), "d", data);
  }

  /// Draws a dot with a tooltip.
  void dot(const std::string& name, double x, double y, const std::string& what) {
    pugi::xml_node node = child("circle", name);
    set(node, "cx", fmt::format("{:.1f}", px(x)));
    set(node, "cy", fmt::format("{:.1f}", py(y)));
    set(node, "r", "4");
    add(node, "title", what);
  }

  void cross(double x, const std::string& what) {
    const double cx = px(x), cy = height_ - kBottom - 8;
    pugi::xml_node node = child("path", "undefined");
    set(node, "d",
        fmt::format("M{0:.1f} {2:.1f}L{1:.1f} {3:.1f}M{0:.1f} {3:.1f}L{1:.1f} {2:.1f}", cx - 4, cx + 4, cy - 4,
                    cy + 4));
    add(node, "title", what);
  }

  pugi::xml_node child(const char* element, const std::string& name) {
    pugi::xml_node node = svg_.append_child(element);
    set(node, "class", name);
    return node;
  }

 private:
  void vertical_axis(const std::string& label) {
    const Axis axis = make_axis(y_, 6, false);
    for (std::size_t i = 0; i < axis.ticks.size(); ++i) {
      line("grid", kLeft, py(axis.ticks[i]), kWidth - kRight, py(axis.ticks[i]));
      text("tick", kLeft - 7, py(axis.ticks[i]) + 4, axis.labels[i], "end");
    }
    text("label", 4, 15, with_exponent(label, axis), "start");
  }

  pugi::xml_node svg_;
  double height_;
  Range x_, y_;
};

pugi::xml_node begin_figure(pugi::xml_node parent) {
  pugi::xml_node figure = parent.append_child("figure");
  return figure;
}

/// Adds the title of a figure, a description, and the keys of its lines (class and words).
void add_caption(pugi::xml_node figure, const std::string& title, const std::string& text,
                 const std::vector<std::pair<std::string, std::string>>& keys = {}) {
  pugi::xml_node caption = figure.append_child("figcaption");
  add(caption, "strong", title);
  if (!text.empty()) add_text(caption, " " + text);
  if (keys.empty()) return;
  pugi::xml_node list = caption.append_child("span");
  set(list, "class", "keys");
  for (const auto& [name, words] : keys) set(add(list, "span", words), "class", "key " + name);
}

std::vector<double> scaled(std::vector<double> values, double by) {
  for (double& v : values) v *= by;
  return values;
}

/// Returns the class of a repetition's lines, by its position in the order.
std::string class_of(const ReportExercise& exercise, std::size_t i) {
  const std::size_t n = exercise.trials.size();
  const std::size_t shade = n > 1 ? (4 * i + (n - 1) / 2) / (n - 1) : 4;
  std::string name = fmt::format("trial t{}", shade);
  if (i + 1 == n)
    name += " last";
  else if (i == 0)
    name += " first";
  if (!exercise.trials[i].finished()) name += " stopped";
  return name;
}

/// Returns the keys of the repetitions that `drawn` accepts.
template <class Drawn>
std::vector<std::pair<std::string, std::string>> keys_of_trials(const ReportExercise& exercise, const Drawn& drawn) {
  std::size_t count = 0;
  bool stopped = false;
  for (const ReportTrial& trial : exercise.trials)
    if (drawn(trial)) {
      ++count;
      stopped = stopped || !trial.finished();
    }
  std::vector<std::pair<std::string, std::string>> keys;
  if (count == 1) keys.emplace_back("line t4 last", "repetition");
  if (count > 1) keys.emplace_back("line t0 first", "first repetition");
  if (count > 2) keys.emplace_back("line t2", "repetitions between");
  if (count > 1) keys.emplace_back("line t4 last", "last repetition");
  if (stopped) keys.emplace_back("line t2 stopped", "not completed");
  return keys;
}

/// Returns the two axes of W with the largest extent; the first points right.
std::array<int, 2> plane_of(const Box& box) {
  int least = 2;
  for (const int axis : {1, 0})
    if (box.size()[axis] < box.size()[least]) least = axis;
  return {least == 0 ? 1 : 0, least == 2 ? 1 : 2};
}

std::vector<double> component(const std::vector<Vec3>& points, int axis) {
  std::vector<double> values;
  for (const Vec3& p : points) values.push_back(kMm * p[axis]);
  return values;
}

/// Returns the value of a line at an arc length.
double at(const ReportLine& line, double arc) {
  const auto after = std::lower_bound(line.arc.begin(), line.arc.end(), arc);
  if (after == line.arc.begin()) return line.value.front();
  if (after == line.arc.end()) return line.value.back();
  const auto i = static_cast<std::size_t>(after - line.arc.begin());
  const double share = (arc - line.arc[i - 1]) / (line.arc[i] - line.arc[i - 1]);
  return line.value[i - 1] + share * (line.value[i] - line.value[i - 1]);
}

/// Draws the tunnel as strokes of its width.
void draw_tunnel(Plot& plot, const ReportExercise& exercise, const std::array<int, 2>& plane) {
  if (exercise.radius.arc.empty() || exercise.curve.size() < 2) return;
  pugi::xml_node group = plot.child("g", "tunnel");
  const auto stroke = [&](const std::vector<Vec3>& points, double radius) {
    pugi::xml_node path = plot.curve("", component(points, plane[0]), component(points, plane[1]));
    path.remove_attribute("class");
    set(path, "stroke-width", fmt::format("{:.1f}", 2 * kMm * radius * plot.scale()));
    group.append_move(path);
  };
  const auto [low, high] = std::minmax_element(exercise.radius.value.begin(), exercise.radius.value.end());
  if (*high - *low < 0.01 * *high) return stroke(exercise.curve, *high);
  constexpr int kPieces = 100;
  const Polyline curve(exercise.curve);
  const double piece = curve.length() / kPieces;
  for (int i = 0; i < kPieces; ++i) {
    std::vector<Vec3> points;
    for (const double share : {0.0, 0.5, 1.0}) points.push_back(curve.at((i + share) * piece));
    stroke(points, at(exercise.radius, (i + 0.5) * piece));
  }
}

bool tunnel_changes(const ReportExercise& exercise) {
  return std::any_of(exercise.trials.begin(), exercise.trials.end(), [&](const ReportTrial& trial) {
    return std::abs(trial.radius.value_or(0) - exercise.trials.front().radius.value_or(0)) > 1e-5;
  });
}

/// Returns "12 repetitions, 1000 to 1200 samples each".
std::string samples_of(const ReportExercise& exercise) {
  std::size_t n = 0, least = 0, most = 0;
  for (const ReportTrial& trial : exercise.trials) {
    if (trial.samples == 0) continue;
    least = n == 0 ? trial.samples : std::min(least, trial.samples);
    most = std::max(most, trial.samples);
    ++n;
  }
  if (n == 0) return "no samples";
  return fmt::format("{} repetition{}, {} samples{}", n, n == 1 ? "" : "s",
                     least == most ? fmt::format("{}", most) : fmt::format("{} to {}", least, most),
                     n == 1 ? "" : " each");
}

std::string repetitions(std::size_t n) {
  return fmt::format("{} repetition{}", n, n == 1 ? "" : "s");
}

/// Returns the span of an axis for a metric. A metric that is never negative begins at zero; the axis of a smoothness
/// covers at least 1. A closer view would enlarge the spread of repetitions until it looked like a change.
Range calm(const Range& y) {
  constexpr double kLeastSpan = 1;
  if (y.low >= 0) return {0, y.high > 0 ? 1.08 * y.high : 1};
  const double missing = std::max(0.0, kLeastSpan - y.size());
  return Range{y.low - missing / 2, y.high + missing / 2}.padded(0.08);
}

std::string name_of(const ReportTrial& trial) {
  return trial.round > 1 ? fmt::format("repetition {}, round {}", trial.repetition, trial.round)
                         : fmt::format("repetition {}", trial.repetition);
}

}  // namespace

std::string shown(const TrialFigure& figure, double value, bool with_unit, bool sign) {
  if (!std::isfinite(value)) return kUndefined;
  std::string text = fmt::format("{:.{}f}", figure.scale * value, figure.digits);
  const bool zero = text.find_first_not_of("-0.") == std::string::npos;
  if (zero && text[0] == '-') text.erase(0, 1);
  if (sign && !zero && text[0] != '-') text = "+" + text;
  text = with_minus(text);
  return with_unit && *figure.unit != '\0' ? text + kNarrowSpace + figure.unit : text;
}

std::string in_words(const ReportTrend& trend) {
  if (!trend.line) return "";
  const TrialFigure& figure = all_trial_figures()[trend.figure];
  // Shows two digits of the slope, which is smaller than the metric itself.
  TrialFigure finer = figure;
  const double slope = trend.line->slope, size = std::max(figure.scale * std::abs(slope), 1e-12);
  finer.digits = std::clamp(1 - static_cast<int>(std::floor(std::log10(size))), figure.digits, figure.digits + 4);
  return fmt::format("{} by {} per repetition", slope < 0 ? "falls" : "rises", shown(finer, std::abs(slope)));
}

void add_way_chart(pugi::xml_node parent, const ReportExercise& exercise) {
  Box box;
  std::size_t ways = 0;
  for (const Vec3& p : exercise.curve) box.include(p);
  for (const ReportTrial& trial : exercise.trials) {
    for (const Vec3& p : trial.way) box.include(p);
    ways += trial.way.empty() ? 0 : 1;
  }
  if (!(box.min.x() <= box.max.x())) return;

  const std::array<int, 2> plane = plane_of(box);
  double room = 0;
  for (const double radius : exercise.radius.value) room = std::max(room, radius);
  room = std::min(room, box.size().maxCoeff());
  // Same scale on both axes.
  constexpr double kLeastExtent =
      5e-3;  // half of it on either side: a picture of tremor alone would look like a movement
  const double least = std::max(kLeastExtent, 0.02 * box.size().maxCoeff());
  const double wide = kWidth - kLeft - kRight, high = kWayHeight - kTop - kBottom;
  const double metre = std::max((box.size()[plane[0]] + 2 * room + 2 * least) / wide,
                                (box.size()[plane[1]] + 2 * room + 2 * least) / high);
  const auto span = [&](int axis, double pixels) {
    const double center = kMm * box.center()[axis], half = 0.5 * kMm * metre * pixels;
    return Range{center - half, center + half};
  };

  pugi::xml_node figure = begin_figure(parent);
  Plot plot(figure, fmt::format("Path of the hand in space, {}", repetitions(ways)), kWayHeight, span(plane[0], wide),
            span(plane[1], high));
  plot.axes(fmt::format("{} (mm)", kAxisNames[static_cast<std::size_t>(plane[0])]),
            fmt::format("{} (mm)", kAxisNames[static_cast<std::size_t>(plane[1])]));
  draw_tunnel(plot, exercise, plane);
  if (!exercise.curve.empty())
    plot.curve("path", component(exercise.curve, plane[0]), component(exercise.curve, plane[1]));
  for (std::size_t i = 0; i < exercise.trials.size(); ++i) {
    const std::vector<Vec3>& way = exercise.trials[i].way;
    if (way.empty()) continue;
    add(plot.curve(class_of(exercise, i), component(way, plane[0]), component(way, plane[1])), "title",
        name_of(exercise.trials[i]));
  }
  if (!exercise.curve.empty()) {
    const Vec3 start = kMm * exercise.curve.front();
    plot.dot("start", start[plane[0]], start[plane[1]], "start of the path");
  }

  auto keys = keys_of_trials(exercise, [](const ReportTrial& trial) { return !trial.way.empty(); });
  if (!exercise.curve.empty()) keys.insert(keys.begin(), {"line path", "path"});
  if (!exercise.curve.empty()) keys.emplace_back("spot", "start");
  if (!exercise.radius.arc.empty())
    keys.emplace_back("area tunnel", tunnel_changes(exercise) ? "tunnel of the last repetition" : "tunnel");
  add_caption(figure, "In space,",
              fmt::format("seen along {}. No filter; {}.",
                          kAxisNames[static_cast<std::size_t>(3 - plane[0] - plane[1])], samples_of(exercise)),
              keys);
}

void add_deviation_chart(pugi::xml_node parent, const ReportExercise& exercise) {
  Range x{0, kMm * exercise.path_length}, y{0, 0};
  std::size_t lines = 0;
  for (const ReportTrial& trial : exercise.trials) {
    for (const double v : trial.deviation.value) y.include(kMm * v);
    lines += trial.deviation.arc.empty() ? 0 : 1;
  }
  if (lines == 0 || !(x.size() > 0)) return;
  // A tunnel far wider than all deviations is left out, so that the deviations stay visible.
  constexpr double kMostTunnel = 3;
  const double largest = y.high;
  for (const double v : exercise.radius.value)
    if (kMm * v <= kMostTunnel * largest) y.include(kMm * v);
  constexpr double kLeastDeviation = 1;  // [mm]: less would enlarge noise
  y.high = std::max(1.05 * y.high, kLeastDeviation);

  pugi::xml_node figure = begin_figure(parent);
  Plot plot(figure,
            fmt::format("Deviation from the path over its length, {}, {:.1f} mm at most", repetitions(lines), largest),
            kHeight, x, y);
  std::vector<double> top = scaled(exercise.radius.value, kMm);
  for (double& v : top) v = std::min(v, y.high);
  if (!top.empty()) plot.band("tunnel-area", scaled(exercise.radius.arc, kMm), std::vector<double>(top.size(), 0), top);
  plot.axes("along the path (mm)", "deviation (mm)");
  for (std::size_t i = 0; i < exercise.trials.size(); ++i) {
    const ReportLine& line = exercise.trials[i].deviation;
    if (line.arc.empty()) continue;
    add(plot.curve(class_of(exercise, i), scaled(line.arc, kMm), scaled(line.value, kMm)), "title",
        name_of(exercise.trials[i]));
  }
  auto keys = keys_of_trials(exercise, [](const ReportTrial& trial) { return !trial.deviation.arc.empty(); });
  if (!top.empty())
    keys.emplace_back("area tunnel", tunnel_changes(exercise) ? "tunnel of the last repetition" : "tunnel");
  add_caption(figure, "Deviation", fmt::format("from the path, over its length. No filter; {}.", samples_of(exercise)),
              keys);
}

void add_force_chart(pugi::xml_node parent, const ReportExercise& exercise) {
  std::size_t cells = exercise.expert_force.size(), felt = 0;
  for (const ReportTrial& trial : exercise.trials)
    if (trial.finished() && !trial.force.empty()) {
      cells = std::max(cells, trial.force.size());
      ++felt;
    }
  if (cells < 2 || (felt == 0 && exercise.expert_force.empty())) return;

  std::vector<double> arc(cells), mean(cells, kNaN), low(cells, kNaN), high(cells, kNaN);
  Range y{0, 0};
  for (std::size_t i = 0; i < cells; ++i) {
    arc[i] = kMm * exercise.cell * (static_cast<double>(i) + 0.5);
    double n = 0, sum = 0, squares = 0;
    for (const ReportTrial& trial : exercise.trials)
      if (trial.finished() && i < trial.force.size() && std::isfinite(trial.force[i])) {
        ++n;
        sum += trial.force[i];
        squares += trial.force[i] * trial.force[i];
      }
    if (n == 0) continue;
    mean[i] = sum / n;
    const double spread = n > 1 ? std::sqrt(std::max(0.0, (squares - n * mean[i] * mean[i]) / (n - 1))) : 0;
    low[i] = std::max(0.0, mean[i] - spread);
    high[i] = mean[i] + spread;
    y.include(high[i]);
  }
  for (const double v : exercise.expert_force) y.include(v);
  if (!(y.high > 0)) return;
  const double largest = y.high;
  constexpr double kLeastForce = 0.5;  // [N]: less would enlarge noise
  y.high = std::max(1.05 * y.high, kLeastForce);

  pugi::xml_node figure = begin_figure(parent);
  Plot plot(
      figure,
      fmt::format("Force of the device over the length of the path, {}, {:.1f} N at most", repetitions(felt), largest),
      kHeight, {0, kMm * exercise.path_length}, y);
  if (felt > 1) plot.band("spread-area", arc, low, high);
  plot.axes("along the path (mm)", "force (N)");
  if (felt > 0) plot.curve("felt", arc, mean);
  std::vector<std::pair<std::string, std::string>> keys;
  if (felt > 0) keys.emplace_back("line felt", felt > 1 ? "felt force, mean" : "felt force");
  if (felt > 1) keys.emplace_back("area spread", "± standard deviation over repetitions");
  if (!exercise.expert_force.empty()) {
    plot.curve("expert", arc, exercise.expert_force);
    keys.emplace_back("line expert", "expert's force");
  }
  add_caption(
      figure, "Force",
      fmt::format("of the device on the hand, over the length of the path. No filter; mean of the samples in each "
                  "{:.1f} mm of path, so peaks are in the table only; {}.",
                  kMm * exercise.cell, samples_of(exercise)),
      keys);
}

namespace {

/// Points of the practice curve or the straight line of a trend, in the unit of the chart.
struct FittedLine {
  std::vector<double> x, y;
};

/// Returns an empty line if the trend has no fit.
FittedLine fitted_line(const ReportTrend& trend, double scale) {
  FittedLine fitted;
  constexpr int kSteps = 80;
  for (int i = 0; (trend.curve || trend.line) && i <= kSteps; ++i) {
    const double at = 1 + static_cast<double>(i) / kSteps * static_cast<double>(trend.values.size() - 1);
    fitted.x.push_back(at);
    fitted.y.push_back(scale * (trend.curve ? trend.curve->at(at) : trend.line->first + trend.line->slope * (at - 1)));
  }
  return fitted;
}

/// Describes a trend and its practice curve; empty without either.
std::string caption_of(const ReportTrend& trend, const TrialFigure& figure) {
  std::string text = in_words(trend);
  if (trend.curve)
    text += fmt::format("{}practice curve ({}): from {} towards {}, R² = {:.2f}", text.empty() ? "" : "; ",
                        trend.curve->law == LearningLaw::power ? "power law" : "exponential",
                        shown(figure, trend.curve->first), shown(figure, trend.curve->plateau), trend.curve->r_squared);
  return text;
}

std::string capitalised(std::string title) {
  title[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(title[0])));
  return title;
}

}  // namespace

void add_trend_chart(pugi::xml_node parent, const ReportExercise& exercise, const ReportTrend& trend) {
  const TrialFigure& figure_of = all_trial_figures()[trend.figure];
  const std::size_t n = trend.values.size();
  Range y;
  std::size_t defined = 0;
  for (const double v : trend.values) {
    y.include(figure_of.scale * v);
    defined += std::isfinite(v) ? 1 : 0;
  }
  constexpr std::size_t kFewest = 4;  // points needed for a fit; the table shows fewer better
  if (defined < kFewest) return;
  const FittedLine fit = fitted_line(trend, figure_of.scale);
  for (const double v : fit.y) y.include(v);
  y = calm(y);

  const std::string unit = *figure_of.unit != '\0' ? fmt::format(" ({})", figure_of.unit) : "";
  pugi::xml_node figure = begin_figure(parent);
  std::string label = fmt::format("{} over {}", figure_of.title, repetitions(n));
  if (const std::string words = in_words(trend); !words.empty()) label += ": " + words;
  Plot plot(figure, label, kHeight, {0.5, static_cast<double>(n) + 0.5}, y);
  plot.axes("repetition", figure_of.title + unit, true);
  if (!fit.x.empty()) plot.curve("fit", fit.x, fit.y);
  bool undefined = false;
  for (std::size_t i = 0; i < n; ++i) {
    const double number = static_cast<double>(i + 1);
    const std::string name = name_of(exercise.trials[i]);
    if (std::isfinite(trend.values[i])) {
      plot.dot("point", number, figure_of.scale * trend.values[i],
               fmt::format("{}: {}", name, shown(figure_of, trend.values[i])));
    } else {
      undefined = true;
      const ReportTrial& trial = exercise.trials[i];
      plot.cross(number, fmt::format("{}: {}", name,
                                     trial.finished()      ? "undefined"
                                     : trial.out_of_time() ? trial.end_in_words()
                                                           : "stopped"));
    }
  }

  std::string text = caption_of(trend, figure_of);
  std::vector<std::pair<std::string, std::string>> keys;
  if (!fit.x.empty()) keys.emplace_back("line fit", trend.curve ? "practice curve" : "straight line");
  if (undefined) keys.emplace_back("cross", "undefined, or not finished");
  if (!text.empty()) text += ". Repetition spread; day-to-day error unknown.";
  text += fmt::format(" Filter: {}; {}.", figure_of.filter, samples_of(exercise));
  add_caption(figure, capitalised(figure_of.title) + ":", text, keys);
}

void add_course_chart(pugi::xml_node parent, const Report& report, const ReportCourse& course, std::size_t figure) {
  const TrialFigure& of = all_trial_figures()[figure];
  std::vector<std::pair<double, std::string>> dates;
  std::vector<ReportSummary> summaries;
  Range x, y;
  for (const ReportCourse::Point& point : course.points) {
    const ReportSummary summary = summary_of(exercise_of(report, point), figure);
    if (!std::isfinite(point.day)) continue;
    dates.emplace_back(point.day, local_date(report.sessions[point.session].created));
    summaries.push_back(summary);
    x.include(point.day);
    for (const double v : {summary.median, summary.better_quartile, summary.worse_quartile}) y.include(of.scale * v);
  }
  if (dates.size() < 2 || y.empty()) return;
  const std::optional<CourseLine> fit = line_of(report, course, figure);
  if (fit) {
    y.include(of.scale * fit->first);
    y.include(of.scale * fit->last);
  }
  y = calm(y);
  constexpr double kLeastDays = 1;  // sessions of one day are in its middle
  const double missing = std::max(0.0, kLeastDays - x.size());
  x = Range{x.low - missing / 2, x.high + missing / 2}.padded(0.1);

  const std::string unit = *of.unit != '\0' ? fmt::format(" ({})", of.unit) : "";
  pugi::xml_node chart = begin_figure(parent);
  Plot plot(chart, fmt::format("{} over {} sessions", of.title, dates.size()), kHeight, x, y);
  plot.dated_axes(dates, of.title + unit);
  if (fit) plot.curve("fit", {fit->from_day, fit->to_day}, {of.scale * fit->first, of.scale * fit->last});
  bool undefined = false;
  for (std::size_t i = 0; i < dates.size(); ++i) {
    const ReportSummary& summary = summaries[i];
    if (!std::isfinite(summary.median)) {
      undefined = true;
      plot.cross(dates[i].first, dates[i].second + ": undefined");
      continue;
    }
    if (std::isfinite(summary.better_quartile) && std::isfinite(summary.worse_quartile))
      plot.bar("whisker", dates[i].first, of.scale * summary.better_quartile, of.scale * summary.worse_quartile);
    plot.dot("point", dates[i].first, of.scale * summary.median,
             fmt::format("{}: {}", dates[i].second, shown(of, summary.median)));
  }
  std::vector<std::pair<std::string, std::string>> keys{{"spot median", "median of a session"},
                                                        {"line whisker", "middle half of its repetitions"}};
  if (fit) keys.emplace_back("line fit", "straight line");
  if (undefined) keys.emplace_back("cross", "more than half were not finished");
  std::string text =
      fit ? fmt::format(
                "change from first to last on the line {} \u00b1 {} (95\u202f% confidence interval over {} "
                "sessions; neighbouring sessions correlate, so the true interval is wider).",
                shown(of, fit->last - fit->first, false, true), shown(of, fit->half_width), fit->sessions)
          : fmt::format("no line below {} comparable sessions.", kFewestForLine);
  text += fmt::format(" Filter: {}.", of.filter);
  add_caption(chart, capitalised(of.title) + " over sessions:", text, keys);
}

}  // namespace haptrace
