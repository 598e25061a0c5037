#include "studies/scene_report.h"

#include "base/json_reader.h"
#include "base/statistics.h"
#include "base/stopwatch.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <numeric>

namespace haptrace {
namespace {

constexpr int kRuns = 15;
constexpr int kMostTicks = 400, kLeastTicks = 8;  // of a run
constexpr std::size_t kAllTicks = 1'000'000;      // of all runs: they take a second where a tick takes 1 us
constexpr std::size_t kMostRows = 40;             // objects in the text
constexpr double kPressed = 1e-3;                 // depth of the tool while a touch is timed [m]

/// Returns the number of ticks of a run, so that a scene of many objects is reported in seconds.
int ticks_of_a_run(std::size_t objects) {
  const std::size_t fair = kAllTicks / (kRuns * std::max<std::size_t>(objects, 1));
  return std::clamp(static_cast<int>(fair), kLeastTicks, kMostTicks);
}

/// Returns the median CPU time of a tick while the tool trembles around a place [s].
double tick_at(Scene& scene, const Vec3& place, const Vec3& across, double rate_hz) {
  const int ticks = ticks_of_a_run(scene.size());
  std::vector<double> runs;
  for (int run = 0; run < kRuns; ++run) {
    const CpuStopwatch watch(CpuStopwatch::Of::thread);
    for (int i = 0; i < ticks; ++i)
      (void)scene.answer({place + 1e-5 * std::sin(0.3 * i) * across, Vec3::Zero(), 1 / rate_hz});
    runs.push_back(watch.seconds() / ticks);
  }
  return median(std::move(runs));
}

/// A place in an object, and the way out.
struct TouchedPlace {
  Vec3 place = nan3(), normal = Vec3::UnitZ();
};

/// Returns the middle of the object's largest triangle, pressed in along its normal.
TouchedPlace place_to_touch(const TriangleMesh& mesh) {
  TouchedPlace press;
  double largest = 0;
  for (const auto& t : mesh.triangles) {
    const Vec3 &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
    const Vec3 cross = (b - a).cross(c - a);
    if (!(cross.norm() > largest)) continue;
    largest = cross.norm();
    press = {(a + b + c) / 3, cross / largest};
  }
  return press;
}

/// Returns the objects that the text lists, in their order: those that cost most, if there are many.
std::vector<std::size_t> shown_rows(const SceneReport& report) {
  std::vector<std::size_t> rows(report.objects.size());
  std::iota(rows.begin(), rows.end(), std::size_t{0});
  if (rows.size() <= kMostRows) return rows;
  const auto cost = [&](std::size_t i) {
    const double touched = report.objects[i].touched_s;
    return std::isfinite(touched) ? touched : 0;
  };
  const auto last = rows.begin() + kMostRows;
  std::nth_element(rows.begin(), last, rows.end(), [&](auto a, auto b) { return cost(a) > cost(b); });
  rows.erase(last, rows.end());
  std::sort(rows.begin(), rows.end());
  return rows;
}

double mm(double metres) {
  return 1e3 * metres;
}

}  // namespace

Box space_of(const Scene& scene) {
  Box space;
  for (std::size_t i = 0; i < scene.size(); ++i)
    if (const Box box = scene.object(i).bounds(); is_finite(box.min) && is_finite(box.max)) {
      space.include(box.min);
      space.include(box.max);
    }
  if (!(space.min.x() <= space.max.x())) return {Vec3::Constant(-kSceneSpace / 2), Vec3::Constant(kSceneSpace / 2)};
  const Vec3 around = Vec3::Constant(0.15 * space.size().maxCoeff());
  return {space.min - around, space.max + around};
}

SceneReport report_scene(Scene& scene, double rate_hz) {
  scene.prepare({.rate_hz = rate_hz});
  const Box space = space_of(scene);
  SceneReport report{.objects = {}, .notes = scene.notes(), .tool_radius = scene.options().tool.radius};
  const Vec3 far = space.max + 10 * (space.size() + Vec3::Constant(1));
  report.free_s = tick_at(scene, far, Vec3::UnitX(), rate_hz);
  for (std::size_t i = 0; i < scene.size(); ++i) {
    const Object& object = scene.object(i);
    const TriangleMesh mesh = object.tessellated(0.01 * space.size().norm(), space);
    ObjectReport row{.name = object.name(),
                     .kind = object.kind(),
                     .bounds = object.bounds(),
                     .triangles = mesh.triangles.size(),
                     .knobs = object.knobs(),
                     .touched_s = kNaN};
    const TouchedPlace press = place_to_touch(mesh);
    if (is_finite(press.place)) {
      scene.reset();
      const double radius = report.tool_radius;
      (void)scene.answer({press.place + (radius + kPressed) * press.normal});
      const Vec3 in = press.place + (radius - kPressed) * press.normal;
      const SceneAnswer answer = scene.answer({in, Vec3::Zero(), 1 / rate_hz});
      const bool touched = std::any_of(answer.contacts.begin(), answer.contacts.end(), [&](const Contact& contact) {
        return contact.object == i && contact.touched();
      });
      if (touched) row.touched_s = tick_at(scene, in, press.normal.unitOrthogonal(), rate_hz);
    }
    report.objects.push_back(std::move(row));
  }
  return report;
}

nlohmann::json to_json(const SceneReport& report) {
  nlohmann::json objects = nlohmann::json::array();
  for (const ObjectReport& object : report.objects) {
    nlohmann::json knobs = nlohmann::json::object();
    for (const Knob& knob : object.knobs)
      knobs[knob.name] = {{"level", knob.level}, {"levels", knob.levels}, {"unit", knob.unit}};
    const bool finite = is_finite(object.bounds.min) && is_finite(object.bounds.max);
    objects.push_back(
        {{"name", object.name},
         {"kind", object.kind},
         {"bounds", finite ? nlohmann::json{{"min", json_of(object.bounds.min)}, {"max", json_of(object.bounds.max)}}
                           : nlohmann::json(nullptr)},
         {"triangles", object.triangles},
         {"tick_touched_s", json_of_number(object.touched_s)},
         {"settings", std::move(knobs)}});
  }
  return {{"objects", std::move(objects)},
          {"notes", report.notes},
          {"tick_free_s", report.free_s},
          {"tool", {{"kind", "point"}, {"radius_m", report.tool_radius}}}};
}

std::string text_of(const SceneReport& report) {
  std::string text =
      fmt::format("  {:<16} {:<10} {:>24} {:>10}  {}\n", "object", "kind", "size [mm]", "tick [us]", "settings");
  for (const std::size_t i : shown_rows(report)) {
    const ObjectReport& object = report.objects[i];
    const Vec3 size = object.bounds.size();
    std::string settings;
    for (const Knob& knob : object.knobs)
      settings += fmt::format("{}{} {:.10g}{}{}", settings.empty() ? "" : ", ", knob.name, knob.level,
                              knob.unit.empty() ? "" : " ", knob.unit);
    text += fmt::format(
        "  {:<16} {:<10} {:>24} {:>10}  {}\n", object.name, object.kind,
        is_finite(size) ? fmt::format("{:.3g} x {:.3g} x {:.3g}", mm(size.x()), mm(size.y()), mm(size.z())) : "no end",
        std::isfinite(object.touched_s) ? fmt::format("{:.2f}", 1e6 * object.touched_s) : "-", settings);
  }
  if (report.objects.size() > kMostRows)
    text += fmt::format("  and {} more, which cost no more; --json lists them\n", report.objects.size() - kMostRows);
  text += fmt::format("  far from all objects, a tick takes {:.2f} us\n", 1e6 * report.free_s);
  for (const std::string& note : report.notes) text += "  " + note + "\n";
  return text;
}

}  // namespace haptrace
