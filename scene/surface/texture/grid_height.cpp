#include "scene/surface/texture/grid_height.h"

#include "scene/surface/hash.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

constexpr double kTexelsPerWave = 4;  // a wave of fewer texels is not resolved

/// Weights of the four points around a place between the second and the third (Catmull and Rom 1974), and their slopes.
struct Cubic {
  explicit Cubic(double t)
      : weight{0.5 * t * (t * (2 - t) - 1), 1 + 0.5 * t * t * (3 * t - 5), 0.5 * t * (t * (4 - 3 * t) + 1),
               0.5 * t * t * (t - 1)},
        slope{0.5 * (t * (4 - 3 * t) - 1), 0.5 * t * (9 * t - 10), 0.5 * (t * (8 - 9 * t) + 1), 0.5 * t * (3 * t - 2)} {
  }
  std::array<double, 4> weight, slope;
};

struct Linear {
  explicit Linear(double t) : weight{0, 1 - t, t, 0}, slope{0, -1, 1, 0} {}
  std::array<double, 4> weight, slope;
};

int wrapped(int index, int count) noexcept {
  const int rest = index % count;
  return rest < 0 ? rest + count : rest;
}

struct FlatSample {
  double value = 0, du = 0, dv = 0;
};

template <class Weights>
FlatSample interpolated(const HeightGrid& grid, double column, double row) noexcept {
  const double c = std::floor(column), r = std::floor(row);
  const Weights across(column - c), along(row - r);
  FlatSample sum;
  for (int j = 0; j < 4; ++j) {
    const int y = wrapped(static_cast<int>(r) + j - 1, grid.rows);
    double value = 0, slope = 0;
    for (int i = 0; i < 4; ++i) {
      const double height = grid.at(wrapped(static_cast<int>(c) + i - 1, grid.columns), y);
      value += across.weight[static_cast<std::size_t>(i)] * height;
      slope += across.slope[static_cast<std::size_t>(i)] * height;
    }
    sum.value += along.weight[static_cast<std::size_t>(j)] * value;
    sum.du += along.weight[static_cast<std::size_t>(j)] * slope;
    sum.dv += along.slope[static_cast<std::size_t>(j)] * value;
  }
  return sum;
}

/// Returns the grid with at most `most` columns and rows: every point is the mean of the points that it stands for.
HeightGrid averaged(const HeightGrid& grid, int most) {
  if (grid.columns <= most && grid.rows <= most) return grid;
  HeightGrid coarse{std::min(grid.columns, most), std::min(grid.rows, most), {}};
  for (int row = 0; row < coarse.rows; ++row)
    for (int column = 0; column < coarse.columns; ++column) {
      const int x0 = column * grid.columns / coarse.columns, x1 = (column + 1) * grid.columns / coarse.columns;
      const int y0 = row * grid.rows / coarse.rows, y1 = (row + 1) * grid.rows / coarse.rows;
      double sum = 0;
      for (int y = y0; y < y1; ++y)
        for (int x = x0; x < x1; ++x) sum += grid.at(x, y);
      coarse.values.push_back(static_cast<float>(sum / ((x1 - x0) * (y1 - y0))));
    }
  return coarse;
}

/// Returns the largest slope in a cell of four points, from its differences along columns and rows.
double steepest_cell(const HeightGrid& grid) {
  double most = 0;
  for (int row = 0; row < grid.rows; ++row)
    for (int column = 0; column < grid.columns; ++column) {
      const int right = wrapped(column + 1, grid.columns), down = wrapped(row + 1, grid.rows);
      const double a = grid.at(column, row), b = grid.at(right, row), c = grid.at(column, down),
                   d = grid.at(right, down);
      const double across = std::max(std::abs(b - a), std::abs(d - c));
      const double along = std::max(std::abs(c - a), std::abs(d - b));
      most = std::max(most, across * across + along * along);
    }
  return std::sqrt(most);
}

}  // namespace

GridHeight::GridHeight(HeightGrid grid, const Mapping& mapping, double amplitude)
    : whole_(std::move(grid)),
      mapping_(mapping),
      amplitude_(amplitude),
      texels_(std::max(whole_.columns, whole_.rows)) {
  prepare();
}

void GridHeight::prepare() {
  used_ = averaged(whole_, texels_);
  // Around a cylinder, a sphere or a cube the length depends on the shape; the size stands for it.
  wavelength_ = kTexelsPerWave * mapping_.size / std::max(used_.columns, used_.rows);

  // Cubic interpolation is steeper than the differences, by up to half for waves of two texels, and overshoots.
  constexpr double kSteeper = 1.5, kBeyond = 1.25 * 1.25;
  // The gradients of u and v on a cube meet at an angle of which the cosine is up to 1/2.
  const double skew = mapping_.kind == MappingKind::cube ? std::sqrt(1.5) : 1;
  steepest_ = skew * (order_ == 1 ? 1 : kSteeper) * steepest_cell(used_);
  const auto [least, most] = std::minmax_element(used_.values.begin(), used_.values.end());
  const double middle = 0.5 * (*least + *most), half = 0.5 * (*most - *least) * (order_ == 1 ? 1 : kBeyond);
  range_ = {amplitude_ * (middle - half), amplitude_ * (middle + half)};
}

std::vector<Knob> GridHeight::knobs() const {
  const double all = std::max(whole_.columns, whole_.rows);
  return {{"order", "", {1, 3}, static_cast<double>(order_), 1, 3},
          {"texels", "", {std::ceil(all / 16), std::ceil(all / 4), all}, static_cast<double>(texels_), 1, all}};
}

void GridHeight::set(const std::string& knob, double level) {
  if (knob == "order") order_ = level < 2 ? 1 : 3;
  if (knob == "texels") texels_ = static_cast<int>(std::lround(level));
}

HeightSample GridHeight::at(const Vec3& place, double finest) const noexcept {
  constexpr double kMostTexels = 1e9;
  const MappedPlace mapped = mapping_.at(place);
  const double column = mapped.u * used_.columns, row = mapped.v * used_.rows;
  if (!(std::abs(column) < kMostTexels && std::abs(row) < kMostTexels)) return {};
  // The length of a texel follows from how fast u and v change there.
  const double fastest = std::max(mapped.du.norm() * used_.columns, mapped.dv.norm() * used_.rows);
  const double share = fastest > 0 ? amplitude_ * fade(kTexelsPerWave / fastest, finest) : 0;
  if (share == 0) return {};
  const FlatSample flat =
      order_ == 1 ? interpolated<Linear>(used_, column, row) : interpolated<Cubic>(used_, column, row);
  return {share * flat.value, share * (flat.du * used_.columns * mapped.du + flat.dv * used_.rows * mapped.dv),
          share * steepest_ * fastest};
}

HeightGrid reaction_diffusion(int side, int steps, double feed, double kill, std::uint64_t seed) {
  constexpr float kDiffusionU = 0.16F, kDiffusionV = 0.08F;
  const auto n = static_cast<std::size_t>(side);
  std::vector<float> u(n * n, 1), v(n * n, 0), next_u(n * n), next_v(n * n);
  std::mt19937_64 random(seed);
  const int patches = std::max(4, side * side / 400);
  for (int patch = 0; patch < patches; ++patch) {
    const auto x0 = random() % n, y0 = random() % n;
    for (std::size_t y = y0; y < y0 + 4; ++y)
      for (std::size_t x = x0; x < x0 + 4; ++x) {
        u[y % n * n + x % n] = 0.5F;
        v[y % n * n + x % n] = 0.25F + 0.05F * static_cast<float>(unit_number(random()));
      }
  }
  const auto f = static_cast<float>(feed), k = static_cast<float>(kill);
  for (int step = 0; step < steps; ++step) {
    for (std::size_t y = 0; y < n; ++y) {
      const std::size_t up = (y + n - 1) % n * n, down = (y + 1) % n * n, here = y * n;
      for (std::size_t x = 0; x < n; ++x) {
        const std::size_t left = x == 0 ? n - 1 : x - 1, right = x + 1 == n ? 0 : x + 1;
        const float a = u[here + x], b = v[here + x], reaction = a * b * b;
        const float spread_u = u[up + x] + u[down + x] + u[here + left] + u[here + right] - 4 * a;
        const float spread_v = v[up + x] + v[down + x] + v[here + left] + v[here + right] - 4 * b;
        next_u[here + x] = a + kDiffusionU * spread_u - reaction + f * (1 - a);
        next_v[here + x] = b + kDiffusionV * spread_v + reaction - (f + k) * b;
      }
    }
    std::swap(u, next_u);
    std::swap(v, next_v);
  }
  const auto [least, most] = std::minmax_element(v.begin(), v.end());
  const float low = *least, span = std::max(*most - *least, 1e-6F);
  HeightGrid grid{side, side, std::vector<float>(v.size())};
  std::transform(v.begin(), v.end(), grid.values.begin(), [&](float value) { return 2 * (value - low) / span - 1; });
  return grid;
}

}  // namespace haptrace
