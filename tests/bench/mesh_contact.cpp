// Benchmark of contacts with meshes per tick: bumpy spheres of 50 mm, touched 3 mm deep along a smooth path.
//
//     build/release/tests/bench/haptrace_bench --benchmark_filter='^mesh_'
#include "formats/mesh/mesh_file.h"
#include "scene/shape/mesh.h"
#include "tests/scene/meshes.h"

#include <benchmark/benchmark.h>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fmt/format.h>
#include <map>
#include <memory>
#include <string>
#include <unistd.h>

namespace haptrace {
namespace {

constexpr double kRadius = 0.05, kRelief = 0.0015;  // of the bumpy sphere [m]

TriangleMesh sphere_of(std::int64_t triangles) {
  return test::bumpy_sphere(kRadius, kRelief, static_cast<int>(triangles));
}

Mesh& mesh_of(std::int64_t triangles) {
  static std::map<std::int64_t, std::unique_ptr<Mesh>> made;
  std::unique_ptr<Mesh>& mesh = made[triangles];
  if (!mesh) mesh = std::make_unique<Mesh>(clean_mesh(sphere_of(triangles), "bench").mesh, std::vector<std::string>{});
  return *mesh;
}

/// Returns the tool's path [m]: all around the sphere at about 0.1 m/s, this far from its mean surface.
std::vector<Vec3> path_at(double height) {
  std::vector<Vec3> path;
  for (int i = 0; i < 20'000; ++i) {
    const double t = 1e-3 * i, along = 1.9 * t, up = 1.1 * std::sin(0.73 * t);
    path.push_back((kRadius + height) *
                   Vec3(std::cos(up) * std::cos(along), std::cos(up) * std::sin(along), std::sin(up)));
  }
  return path;
}

void follow_path(benchmark::State& bench, double height, double radius, bool verify) {
  Mesh& mesh = mesh_of(bench.range(0));
  mesh.set("verify", verify ? 1 : 0);
  mesh.prepare(radius);
  const std::vector<Vec3> path = path_at(height);
  Proxy proxy;
  Vec3 at = 2 * path[0];
  std::size_t i = 0, touched = 0, ticks = 0;
  for (auto _ : bench) {
    mesh.follow({.from = at, .to = path[i], .radius = radius}, proxy);
    benchmark::DoNotOptimize(proxy);
    at = path[i];
    touched += proxy.touching ? 1 : 0;
    ++ticks;
    // At the end of the path the tool leaves, and comes back.
    if (++i == path.size()) {
      i = 0;
      proxy = {};
      at = 2 * path[0];
    }
  }
  bench.counters["touching"] = static_cast<double>(touched) / static_cast<double>(ticks);
}

void first_contact(benchmark::State& bench, double radius) {
  Mesh& mesh = mesh_of(bench.range(0));
  mesh.set("verify", 0);
  mesh.prepare(radius);
  const std::vector<Vec3> path = path_at(-0.003);
  std::size_t i = 0;
  for (auto _ : bench) {
    Proxy proxy;
    mesh.follow({.from = 1.2 * path[i], .to = path[i], .radius = radius}, proxy);
    benchmark::DoNotOptimize(proxy);
    i = (i + 37) % path.size();
  }
}

void mesh_build(benchmark::State& bench) {
  const TriangleMesh triangles = clean_mesh(sphere_of(bench.range(0)), "bench").mesh;
  for (auto _ : bench) {
    const Mesh mesh(triangles, {});
    benchmark::DoNotOptimize(&mesh);
  }
}

/// From an OBJ file to a mesh that can be touched.
void mesh_load(benchmark::State& bench) {
  const std::string file =
      (std::filesystem::temp_directory_path() / fmt::format("haptrace_bench_{}.obj", getpid())).string();
  {
    const TriangleMesh mesh = sphere_of(bench.range(0));
    std::FILE* const out = std::fopen(file.c_str(), "w");
    if (out == nullptr) return bench.SkipWithError("cannot write a file for it");
    for (const Vec3& v : mesh.vertices) fmt::print(out, "v {:.9g} {:.9g} {:.9g}\n", v.x(), v.y(), v.z());
    for (const auto& t : mesh.triangles) fmt::print(out, "f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1);
    (void)std::fclose(out);
  }
  for (auto _ : bench) {
    MeshLoad load = load_mesh(file, "m");
    const Mesh mesh(std::move(load.mesh), std::move(load.remarks));
    benchmark::DoNotOptimize(&mesh);
  }
  std::filesystem::remove(file);
}

void sizes(benchmark::internal::Benchmark* bench) {
  bench->Arg(10'000)->Arg(100'000)->Arg(1'000'000);
}

BENCHMARK_CAPTURE(follow_path, mesh_point, -0.003, 0, false)->Name("mesh_point")->Apply(sizes);
BENCHMARK_CAPTURE(follow_path, mesh_point_verified, -0.003, 0, true)->Name("mesh_point_verified")->Apply(sizes);
BENCHMARK_CAPTURE(follow_path, mesh_ball_small, -0.003, 2e-4, false)->Name("mesh_ball_0.2mm")->Apply(sizes);
BENCHMARK_CAPTURE(follow_path, mesh_ball_large, -0.003, 2e-3, false)->Name("mesh_ball_2mm")->Apply(sizes);
BENCHMARK_CAPTURE(follow_path, mesh_free, 0.005, 0, false)->Name("mesh_free")->Apply(sizes);
BENCHMARK_CAPTURE(follow_path, mesh_free_ball, 0.005, 2e-3, false)->Name("mesh_free_ball_2mm")->Apply(sizes);
BENCHMARK_CAPTURE(first_contact, mesh_first, 0)->Name("mesh_first_contact")->Apply(sizes);
BENCHMARK_CAPTURE(first_contact, mesh_first_ball, 2e-3)->Name("mesh_first_contact_ball_2mm")->Apply(sizes);
BENCHMARK(mesh_build)->Apply(sizes)->Unit(benchmark::kMillisecond);
BENCHMARK(mesh_load)->Arg(1'000'000)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace haptrace
