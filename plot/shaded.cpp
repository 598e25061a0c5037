#include "plot/shaded.h"

#include "base/error.h"
#include "base/output_file.h"
#include "base/text_file.h"
#include "plot/palette.h"

#include <algorithm>
#include <cairo.h>
#include <cmath>
#include <cstdint>
#include <fmt/format.h>
#include <limits>
#include <memory>

namespace haptrace {
namespace {

constexpr int kWidth = 1920, kHeight = 1440;  // [px]
constexpr double kBorder = 0.08;              // share of the picture
constexpr double kAmbient = 0.35;

/// Axes of the picture in W: to the right, upwards, and towards the viewer.
struct View {
  Vec3 right, up, towards;
};

View view_from(const Vec3& towards) {
  View view;
  view.towards = towards.normalized();
  view.right = Vec3::UnitZ().cross(view.towards).normalized();
  view.up = view.towards.cross(view.right);
  return view;
}

/// Pixels with depths, over a white background.
class Canvas {
 public:
  Canvas() : depth_(std::size_t{kWidth} * kHeight, -std::numeric_limits<float>::infinity()) {
    pixels_.assign(depth_.size(), 0xffffffff);
  }

  /// Fills a triangle; x and y in pixels, z towards the viewer.
  void fill(const Vec3& a, const Vec3& b, const Vec3& c, std::uint32_t colour) {
    const int x0 = std::max(0, static_cast<int>(std::floor(std::min({a.x(), b.x(), c.x()}))));
    const int x1 = std::min(kWidth - 1, static_cast<int>(std::ceil(std::max({a.x(), b.x(), c.x()}))));
    const int y0 = std::max(0, static_cast<int>(std::floor(std::min({a.y(), b.y(), c.y()}))));
    const int y1 = std::min(kHeight - 1, static_cast<int>(std::ceil(std::max({a.y(), b.y(), c.y()}))));
    const double area = (b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x());
    if (area == 0) return;
    for (int y = y0; y <= y1; ++y)
      for (int x = x0; x <= x1; ++x) {
        const double px = x + 0.5, py = y + 0.5;
        const double u = ((b.x() - px) * (c.y() - py) - (b.y() - py) * (c.x() - px)) / area;
        const double v = ((c.x() - px) * (a.y() - py) - (c.y() - py) * (a.x() - px)) / area;
        const double w = 1 - u - v;
        if (u < 0 || v < 0 || w < 0) continue;
        const auto z = static_cast<float>(u * a.z() + v * b.z() + w * c.z());
        const std::size_t at = static_cast<std::size_t>(y) * kWidth + static_cast<std::size_t>(x);
        if (z <= depth_[at]) continue;
        depth_[at] = z;
        pixels_[at] = colour;
      }
  }

  [[nodiscard]] std::vector<std::uint32_t>& pixels() { return pixels_; }

 private:
  std::vector<float> depth_;
  std::vector<std::uint32_t> pixels_;
};

std::uint32_t shaded(const Rgb& colour, double light) {
  const auto part = [&](double value) {
    return static_cast<std::uint32_t>(std::lround(255 * std::clamp(value * light, 0.0, 1.0)));
  };
  return 0xff000000U | part(colour.r) << 16U | part(colour.g) << 8U | part(colour.b);
}

/// Returns a round length of about a fifth of the picture's width.
double round_length(double length) {
  const double power = std::pow(10, std::floor(std::log10(length)));
  for (const double step : {5.0, 2.0})
    if (step * power <= length) return step * power;
  return power;
}

}  // namespace

void draw_shaded(const std::vector<ShadedObject>& objects, const std::string& title, const std::string& file,
                 bool overwrite) {
  if (file_ending(file) != ".png") throw input_error(file + ": a picture of a scene is a .png");
  OutputFile output(file, overwrite);
  const View view = view_from(Vec3(0.6, -1, 0.7));
  Vec3 least = Vec3::Constant(std::numeric_limits<double>::infinity()), most = -least;
  const auto seen = [&](const Vec3& v) { return Vec3(view.right.dot(v), view.up.dot(v), view.towards.dot(v)); };
  for (const ShadedObject& object : objects)
    for (const auto& triangle : object.mesh.triangles)
      for (const std::uint32_t corner : triangle) {
        least = least.cwiseMin(seen(object.mesh.vertices[corner]));
        most = most.cwiseMax(seen(object.mesh.vertices[corner]));
      }
  if (!(least.x() <= most.x())) throw input_error(file + ": there is nothing to draw");
  const Vec3 size = (most - least).cwiseMax(1e-12);
  const double scale = (1 - 2 * kBorder) * std::min(kWidth / size.x(), kHeight / size.y());
  const Vec3 middle = 0.5 * (least + most);
  const auto placed = [&](const Vec3& v) {
    const Vec3 at = seen(v) - middle;
    return Vec3(0.5 * kWidth + scale * at.x(), 0.5 * kHeight - scale * at.y(), scale * at.z());
  };

  Canvas canvas;
  const Vec3 light = (view.towards + 0.6 * view.up - 0.4 * view.right).normalized();
  for (const ShadedObject& object : objects)
    for (const auto& t : object.mesh.triangles) {
      const Vec3 &a = object.mesh.vertices[t[0]], &b = object.mesh.vertices[t[1]], &c = object.mesh.vertices[t[2]];
      const Vec3 normal = (b - a).cross(c - a).stableNormalized();
      const double brightness = kAmbient + (1.1 - kAmbient) * std::max(0.0, normal.dot(light));
      canvas.fill(placed(a), placed(b), placed(c), shaded(palette(object.color), brightness));
    }

  const int stride = 4 * kWidth;
  const std::unique_ptr<cairo_surface_t, void (*)(cairo_surface_t*)> surface(
      cairo_image_surface_create_for_data(reinterpret_cast<unsigned char*>(canvas.pixels().data()), CAIRO_FORMAT_ARGB32,
                                          kWidth, kHeight, stride),
      cairo_surface_destroy);
  const std::unique_ptr<cairo_t, void (*)(cairo_t*)> cairo(cairo_create(surface.get()), cairo_destroy);
  cairo_set_source_rgb(cairo.get(), 0.13, 0.13, 0.15);
  cairo_select_font_face(cairo.get(), "sans-serif", CAIRO_FONT_SLANT_NORMAL, CAIRO_FONT_WEIGHT_NORMAL);
  cairo_set_font_size(cairo.get(), 34);
  cairo_move_to(cairo.get(), 40, 60);
  cairo_show_text(cairo.get(), title.c_str());
  const double bar = round_length(0.2 * kWidth / scale);
  cairo_set_line_width(cairo.get(), 4);
  cairo_move_to(cairo.get(), 40, kHeight - 50);
  cairo_line_to(cairo.get(), 40 + bar * scale, kHeight - 50);
  cairo_stroke(cairo.get());
  cairo_move_to(cairo.get(), 40, kHeight - 66);
  cairo_show_text(cairo.get(), fmt::format("{:g} mm", 1e3 * bar).c_str());

  output.create();
  if (cairo_surface_write_to_png(surface.get(), output.path().c_str()) != CAIRO_STATUS_SUCCESS)
    throw input_error(file + ": cannot be written");
  output.commit();
}

}  // namespace haptrace
