#include "report/recording_figure.h"

#include "control/rotation.h"
#include "formats/recording/recording_summary.h"
#include "metrics/touches.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numbers>
#include <optional>
#include <string_view>

namespace haptrace {
namespace {

constexpr std::size_t kPoints = 4000;  // points of a line over the whole width, more than any screen shows

enum Color : int { kBlue = 0, kOrange = 1, kGreen = 2, kBlack = 7 };

/// A line over time that is thinned while it grows.
class TimeLine {
 public:
  TimeLine(std::string label, int color, std::uint64_t rows)
      : points_per_row_(rows > 0 ? double(kPoints) / double(rows) : 1) {
    series_.label = std::move(label);
    series_.color = color;
  }

  void add(double t, double y) {
    block_.x.push_back(t);
    block_.y.push_back(y);
  }

  void end_block() {
    // Keeps the memory bounded for any number of blocks.
    if (series_.x.size() > 4 * kPoints) series_ = decimate(series_, 2 * kPoints);
    const auto points = static_cast<std::size_t>(std::ceil(points_per_row_ * static_cast<double>(block_.x.size())));
    const Series thin = decimate(block_, std::max<std::size_t>(points, 4));
    series_.x.insert(series_.x.end(), thin.x.begin(), thin.x.end());
    series_.y.insert(series_.y.end(), thin.y.begin(), thin.y.end());
    block_.x.clear();
    block_.y.clear();
  }

  Series take() { return decimate(series_, kPoints); }

 private:
  double points_per_row_;
  Series series_, block_;
};

/// A curve in space that is thinned while it grows. It keeps the first point of every bin and the extremes in
/// every axis, in order, and one break if there is any.
class SpaceLine {
 public:
  explicit SpaceLine(std::uint64_t rows) : span_(rows <= kPoints ? 1 : (rows + kBins - 1) / kBins) {}

  void add(const Vec3& p) {
    const std::uint64_t row = count_++ % span_;
    if (row == 0) end_bin();
    if (!is_finite(p)) {
      bin_[kBreak] = {row, p};
      return;
    }
    keep(kFirst, row, p, bin_[kFirst].row == kNone);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto i = static_cast<Eigen::Index>(axis);
      keep(axis, row, p, !(p[i] >= bin_[axis].point[i]));
      keep(3 + axis, row, p, !(p[i] <= bin_[3 + axis].point[i]));
    }
  }

  /// Ends a bin; also called after the last point.
  void end_bin() {
    std::sort(bin_.begin(), bin_.end(), [](const Point& a, const Point& b) { return a.row < b.row; });
    for (std::size_t i = 0; i < bin_.size() && bin_[i].row != kNone; ++i)
      if (i == 0 || bin_[i].row != bin_[i - 1].row) points_.push_back(bin_[i].point);
    bin_.fill({});
  }

  [[nodiscard]] Series projected(int horizontal, int vertical, const std::string& label, int color, bool dashed) const {
    Series series{.label = label, .color = color, .dashed = dashed};
    for (const Vec3& p : points_) {
      series.x.push_back(1e3 * p[horizontal]);
      series.y.push_back(1e3 * p[vertical]);
    }
    return series;
  }
  [[nodiscard]] bool empty() const { return points_.empty(); }

 private:
  static constexpr std::uint64_t kBins = 1000, kNone = std::numeric_limits<std::uint64_t>::max();
  static constexpr std::size_t kFirst = 6, kBreak = 7;  // after the lowest and the highest of every axis

  struct Point {
    std::uint64_t row = kNone;  ///< row within the bin
    Vec3 point = nan3();
  };

  void keep(std::size_t place, std::uint64_t row, const Vec3& p, bool better) {
    if (better) bin_[place] = {row, p};
  }

  std::uint64_t span_, count_ = 0;
  std::array<Point, 8> bin_;
  std::vector<Vec3> points_;
};

/// Returns the axes of a box, the widest first.
std::array<int, 3> by_extent(const Box& box) {
  std::array<int, 3> order{0, 1, 2};
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return box.size()[a] > 1.001 * box.size()[b]; });
  return order;
}

/// Returns the planes to draw: pairs of (horizontal, vertical) axes, in the order x, y, z within a pair.
std::vector<std::pair<int, int>> planes_of(const Box& box) {
  const auto [first, second, third] = by_extent(box);
  std::vector<std::pair<int, int>> planes{std::minmax(first, second)};
  if (box.size()[third] > 0.05 * box.size()[first]) planes.emplace_back(std::minmax(first, third));
  return planes;
}

constexpr double kDegrees = 180 / std::numbers::pi;  // degrees per radian
constexpr std::array<int, 3> kAxisColors{kBlue, kOrange, kGreen};

std::vector<Panel> space_panels(const Box& box, const SpaceLine& path, const char* path_label,
                                const SpaceLine& reference, const SpaceLine& proxy) {
  std::vector<Panel> panels;
  for (const auto& [horizontal, vertical] : planes_of(box)) {
    Panel panel{.title = "path",
                .x_label = fmt::format("{} [mm]", kAxisNames[std::size_t(horizontal)]),
                .y_label = fmt::format("{} [mm]", kAxisNames[std::size_t(vertical)]),
                .equal_scale = true};
    panel.series.push_back(path.projected(horizontal, vertical, path_label, kBlue, false));
    if (!reference.empty())
      panel.series.push_back(reference.projected(horizontal, vertical, "reference", kOrange, true));
    if (!proxy.empty()) panel.series.push_back(proxy.projected(horizontal, vertical, "proxy", kGreen, false));
    panels.push_back(std::move(panel));
  }
  return panels;
}

/// Returns a panel over the whole `duration` [s], so that stacked panels show the same instants.
Panel time_panel(std::string title, std::string y_label, std::vector<TimeLine>& lines, double duration) {
  Panel panel{.title = std::move(title), .x_label = "time [s]", .y_label = std::move(y_label)};
  if (duration > 0) panel.x_range = {0, duration};
  for (TimeLine& line : lines) panel.series.push_back(line.take());
  return panel;
}

/// Contacts with virtual objects over time: the depth in each of the most touched objects, and the proxy in space.
class ContactLines {
 public:
  explicit ContactLines(const RecordingReader& reader) : proxy_(reader.contact_rows()) {
    constexpr std::size_t kMost = 7;  // as many as there are colours beside black
    const std::vector<TouchFigures> figures = touch_figures(reader);
    std::vector<std::size_t> order;
    for (std::size_t i = 0; i < figures.size(); ++i)
      if (figures[i].times > 0) order.push_back(i);
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return figures[a].seconds > figures[b].seconds; });
    left_out_ = order.size() > kMost ? order.size() - kMost : 0;
    order.resize(std::min(order.size(), kMost));
    lines_.resize(figures.size());
    for (std::size_t i = 0; i < order.size(); ++i)
      lines_[order[i]].emplace(figures[order[i]].name, static_cast<int>(i), reader.contact_rows());
    std::uint64_t count = 0;
    (void)touch_figures(reader, [&](const ContactSample& contact) {
      add(contact);
      if (++count % 8192 == 0) end_block();
    });
    end_block();
    proxy_.end_bin();
  }

  [[nodiscard]] const SpaceLine& proxy() const noexcept { return proxy_; }

  /// Adds a row with the depths, if any object was touched.
  void draw(Figure& figure, double duration) {
    std::vector<TimeLine> lines;
    for (std::optional<Line>& line : lines_)
      if (line) lines.push_back(std::move(line->depth));
    if (lines.empty()) return;
    figure.rows.push_back({time_panel(left_out_ > 0 ? fmt::format("depth in the {} most touched objects of {}",
                                                                  lines.size(), lines.size() + left_out_)
                                                    : "depth in touched objects",
                                      "depth [mm]", lines, duration)});
    figure.height += 200;
  }

 private:
  struct Line {
    Line(const std::string& name, int color, std::uint64_t rows) : depth(name, color, rows) {}
    TimeLine depth;
    double last = kNaN;
  };

  void add(const ContactSample& contact) {
    if (!(contact.depth > 0)) return;
    const double t = 1e-9 * static_cast<double>(contact.time_ns);
    // The proxy's way breaks where the hand left all objects.
    if (t - last_ >= TouchFigures::kLeft) proxy_.add(nan3());
    last_ = t;
    proxy_.add(contact.proxy);
    if (contact.object >= lines_.size() || !lines_[contact.object]) return;
    Line& line = *lines_[contact.object];
    if (t - line.last >= TouchFigures::kLeft) line.depth.add(t, kNaN);
    line.last = t;
    line.depth.add(t, 1e3 * contact.depth);
  }
  void end_block() {
    for (std::optional<Line>& line : lines_)
      if (line) line->depth.end_block();
  }

  SpaceLine proxy_;
  std::vector<std::optional<Line>> lines_;  ///< by object
  std::size_t left_out_ = 0;
  double last_ = kNaN;
};

/// Orientation and torque over time: the angle to the reference, or, without one, the rotation vector from the first
/// orientation; and the torque.
class TurningLines {
 public:
  TurningLines(const RecordingColumns& columns, std::uint64_t rows)
      : pointed_(columns.orientation), tracked_(columns.orientation && columns.reference_orientation) {
    if (tracked_) rotation_.emplace_back("deviation", kBlue, rows);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (pointed_ && !tracked_) rotation_.emplace_back(kAxisNames[axis], kAxisColors[axis], rows);
      if (columns.torque) torque_.emplace_back(kAxisNames[axis], kAxisColors[axis], rows);
    }
  }

  void name_columns(std::vector<std::string_view>& columns) const {
    if (pointed_) columns.emplace_back("orientation");
    if (tracked_) columns.emplace_back("reference_orientation");
    if (!torque_.empty()) columns.emplace_back("torque");
  }

  void add(double t, const Sample& sample) {
    for (std::size_t axis = 0; axis < torque_.size(); ++axis)
      torque_[axis].add(t, sample.torque[static_cast<Eigen::Index>(axis)]);
    if (tracked_) {
      const double angle = rotation_between(sample.orientation, sample.reference_orientation).norm();
      rotation_[0].add(t, sample.phase == Phase::run ? kDegrees * angle : kNaN);
    } else if (pointed_) {
      if (!is_finite(first_)) first_ = sample.orientation;
      const Vec3 rotation = kDegrees * rotation_between(first_, sample.orientation);
      for (int axis = 0; axis < 3; ++axis) rotation_[std::size_t(axis)].add(t, rotation[axis]);
    }
  }

  void end_block() {
    for (std::vector<TimeLine>* lines : {&rotation_, &torque_})
      for (TimeLine& line : *lines) line.end_block();
  }

  /// Adds a row for each quantity in the recording.
  void draw(Figure& figure, double duration) {
    if (pointed_)
      add_row(figure, tracked_ ? time_panel("deviation of the orientation", "deviation [degrees]", rotation_, duration)
                               : time_panel("rotation of the tool", "rotation [degrees]", rotation_, duration));
    if (!torque_.empty()) add_row(figure, time_panel("torque sent", "torque [N m]", torque_, duration));
  }

 private:
  static void add_row(Figure& figure, Panel panel) {
    figure.rows.push_back({std::move(panel)});
    figure.height += 200;
  }

  bool pointed_, tracked_;
  Quat first_ = nan_quat();
  std::vector<TimeLine> rotation_, torque_;
};

/// Returns an empty line for each axis.
std::vector<TimeLine> axis_lines(std::uint64_t rows) {
  std::vector<TimeLine> lines;
  for (std::size_t axis = 0; axis < 3; ++axis) lines.emplace_back(kAxisNames[axis], kAxisColors[axis], rows);
  return lines;
}

std::string caption_of(const RecordingHeader& header, const RecordingSummary& summary, std::uint64_t rows) {
  std::string caption = fmt::format("{} · {} samples in {:.2f} s at {:.1f} Hz, {} missed", header.device_name, rows,
                                    summary.duration(), summary.mean_rate(), summary.missed);
  if (summary.tracked > 0)
    caption +=
        fmt::format(" · rms error {:.3f} mm, peak {:.3f} mm", 1e3 * summary.rms_error(), 1e3 * summary.peak_error());
  return caption;
}

}  // namespace

Figure figure_of(const RecordingReader& reader, const std::string& title,
                 const std::function<void(std::uint64_t)>& progress) {
  constexpr std::uint64_t kBlock = 8192;  // rows
  const RecordingSummary summary = summarise(reader, progress);
  const std::uint64_t rows = reader.rows();
  const bool tracked = summary.tracked > 0;
  SpaceLine path(tracked ? summary.run_rows : rows), reference(summary.run_rows);
  std::vector<TimeLine> force = axis_lines(rows), upper;
  if (tracked)
    upper.emplace_back("deviation", kBlue, rows);
  else
    upper = axis_lines(rows);
  TurningLines turning(reader.columns(), rows);
  ContactLines contacts(reader);
  const bool sensed = reader.columns().force_measured && summary.max_force == 0;

  std::vector<std::string_view> columns{"time", "position", "phase", sensed ? "force_measured" : "force"};
  if (tracked) columns.emplace_back("reference_position");
  turning.name_columns(columns);
  for (std::uint64_t first = 0; first < rows; first += kBlock) {
    for (const Sample& sample : reader.read(first, kBlock, columns)) {
      const double t = 1e-9 * static_cast<double>(sample.time_ns);
      const bool run = sample.phase == Phase::run;
      if (run || !tracked) path.add(sample.position);
      if (run && tracked) reference.add(sample.reference_position);
      if (tracked) {
        upper[0].add(t, run ? 1e3 * (sample.position - sample.reference_position).norm() : kNaN);
      } else {
        for (int axis = 0; axis < 3; ++axis) upper[std::size_t(axis)].add(t, 1e3 * sample.position[axis]);
      }
      turning.add(t, sample);
      const Vec3& shown = sensed ? sample.force_measured : sample.force;
      for (int axis = 0; axis < 3; ++axis) force[std::size_t(axis)].add(t, shown[axis]);
    }
    for (TimeLine& line : upper) line.end_block();
    for (TimeLine& line : force) line.end_block();
    turning.end_block();
    if (progress) progress(std::min(first + kBlock, rows));
  }
  path.end_bin();
  reference.end_bin();

  const RecordingHeader header = reader.header();
  Figure figure;
  figure.title = header.title.empty() ? title : header.title;
  figure.caption = caption_of(header, summary, rows);
  figure.rows.push_back(
      space_panels(summary.bounds, path, tracked ? "played" : "recorded", reference, contacts.proxy()));
  Panel over_time = tracked ? time_panel("deviation from the reference", "deviation [mm]", upper, summary.duration())
                            : time_panel("position", "position [mm]", upper, summary.duration());
  if (summary.peak_error() > 0) over_time.y_range = {0, 1.05e3 * summary.peak_error()};
  figure.rows.push_back({std::move(over_time)});
  figure.rows.push_back({time_panel(sensed ? "force measured" : "force sent", "force [N]", force, summary.duration())});
  figure.height = 900;
  contacts.draw(figure, summary.duration());
  turning.draw(figure, summary.duration());
  return figure;
}

Figure figure_of(const Path& path) {
  SpaceLine space(path.size());
  std::vector<TimeLine> position = axis_lines(path.size()), speed;
  speed.emplace_back("", kBlue, path.size());
  for (std::size_t i = 0; i < path.size(); ++i) {
    const double t = path.time[i] - path.time.front();
    space.add(path.position[i]);
    for (int axis = 0; axis < 3; ++axis) position[std::size_t(axis)].add(t, 1e3 * path.position[i][axis]);
    if (i > 0) speed[0].add(t, (path.position[i] - path.position[i - 1]).norm() / (path.time[i] - path.time[i - 1]));
  }
  space.end_bin();
  for (TimeLine& line : position) line.end_block();
  speed[0].end_block();

  Figure figure;
  figure.title = path.name;
  figure.caption = fmt::format("{} samples in {:.2f} s", path.size(), path.duration());
  figure.rows.push_back(space_panels(path.bounds(), space, "path", SpaceLine(0), SpaceLine(0)));
  figure.rows.push_back({time_panel("position", "position [mm]", position, path.duration())});
  figure.rows.push_back({time_panel("speed", "speed [m/s]", speed, path.duration())});
  figure.height = 900;
  return figure;
}

}  // namespace haptrace
