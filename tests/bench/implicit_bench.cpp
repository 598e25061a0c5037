// Time of a tick of implicit surfaces, beside the same solids in closed form: a hand of 0.1 m/s that slides along the
// surface, 2 mm deep, and a hand in free space near it.
#include "base/json_reader.h"
#include "scene/shape/shape_kinds.h"

#include <benchmark/benchmark.h>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

namespace {

using namespace haptrace;

std::unique_ptr<Shape> shape_of(const char* text) {
  const nlohmann::json object = parse_json(text, "bench");
  JsonReader reader(object, "bench");
  SceneFiles files;
  std::unique_ptr<Shape> shape = read_kind(reader).read(reader, files);
  shape->prepare(0);
  return shape;
}

/// Returns a path around the shape, at a distance from its surface; negative: inside.
std::vector<Vec3> path(const Shape& shape, double distance) {
  std::vector<Vec3> places;
  constexpr double kStep = 1e-4, kRadius = 0.03;
  for (int i = 0; i < 4096; ++i) {
    const double a = i * kStep / kRadius, b = 0.4 * std::sin(0.37 * a);
    const Vec3 around = kRadius * Vec3(std::cos(a) * std::cos(b), std::sin(a) * std::cos(b), std::sin(b));
    const SurfacePoint point = shape.nearest(around);
    places.push_back(point.position + distance * point.normal);
  }
  return places;
}

void follow(benchmark::State& state, const char* text, double distance) {
  const auto shape = shape_of(text);
  const std::vector<Vec3> places = path(*shape, distance);
  Proxy proxy;
  Vec3 from = shape->nearest(places[0]).position;
  std::size_t i = 0, touched = 0;
  for (auto _ : state) {
    const Vec3& to = places[i];
    shape->follow({.from = from, .to = to}, proxy);
    benchmark::DoNotOptimize(proxy);
    touched += proxy.touching ? 1 : 0;
    from = to;
    i = (i + 1) % places.size();
  }
  state.counters["touched"] = static_cast<double>(touched) / static_cast<double>(state.iterations());
}

constexpr const char* kSphere = R"({"kind": "sphere", "radius": 0.03})";
constexpr const char* kSphereField = R"({"kind": "implicit", "expression": "x^2 + y^2 + z^2 - 0.03^2",
    "box": {"min": -0.04, "max": 0.04}})";
constexpr const char* kTorus = R"({"kind": "torus", "radius": 0.03, "tube": 0.01})";
constexpr const char* kTorusField = R"({"kind": "implicit",
    "expression": "(sqrt(x^2 + y^2) - 0.03)^2 + z^2 - 0.01^2", "box": {"min": -0.05, "max": 0.05}})";
constexpr const char* kTwoBalls = R"({"kind": "metaballs", "balls": [
    {"centre": [-0.02, 0, 0], "radius": 0.04}, {"centre": [0.02, 0, 0], "radius": 0.04}]})";
constexpr const char* kEightBalls = R"({"kind": "metaballs", "balls": [
    {"centre": [-0.02, 0, 0], "radius": 0.04}, {"centre": [0.02, 0, 0], "radius": 0.04},
    {"centre": [0, 0.02, 0], "radius": 0.04}, {"centre": [0, -0.02, 0], "radius": 0.04},
    {"centre": [0, 0, 0.02], "radius": 0.04}, {"centre": [0, 0, -0.02], "radius": 0.04},
    {"centre": [0.01, 0.01, 0.01], "radius": 0.03}, {"centre": [-0.01, -0.01, 0], "radius": 0.03}]})";
constexpr const char* kBoxAndBall = R"({"kind": "csg", "operation": "difference", "parts": [
    {"kind": "box", "size": 0.06}, {"kind": "sphere", "centre": [0.03, 0, 0], "radius": 0.015}]})";
constexpr const char* kBlended = R"({"kind": "csg", "operation": "union", "blend": 0.004, "parts": [
    {"kind": "sphere", "radius": 0.03}, {"kind": "cylinder", "radius": 0.01, "height": 0.1}]})";

BENCHMARK_CAPTURE(follow, sphere, kSphere, -0.002);
BENCHMARK_CAPTURE(follow, sphere_expression, kSphereField, -0.002);
BENCHMARK_CAPTURE(follow, sphere_expression_free, kSphereField, 0.002);
BENCHMARK_CAPTURE(follow, torus, kTorus, -0.002);
BENCHMARK_CAPTURE(follow, torus_expression, kTorusField, -0.002);
BENCHMARK_CAPTURE(follow, metaballs_2, kTwoBalls, -0.002);
BENCHMARK_CAPTURE(follow, metaballs_8, kEightBalls, -0.002);
BENCHMARK_CAPTURE(follow, metaballs_8_free, kEightBalls, 0.002);
BENCHMARK_CAPTURE(follow, csg_box_minus_ball, kBoxAndBall, -0.002);
BENCHMARK_CAPTURE(follow, csg_blended, kBlended, -0.002);

}  // namespace
