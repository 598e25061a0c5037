#include "scene/shape/volume.h"

#include "base/error.h"
#include "control/norm.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

constexpr int kMostSteps = 10;   // of the setting
constexpr int kMostMoves = 200;  // in a tick, of a fast tool
constexpr double kLeastShare = 0.05;
constexpr const char* kCut = "the surface is cut";

Eigen::Matrix3d without(const Vec3& normal) {
  return Eigen::Matrix3d::Identity() - normal * normal.transpose();
}

/// Principal directions and curvatures of the level of a field [1/m], positive where it curves away from the outside.
struct Bend {
  Bend(const FieldPoint& point, const Vec3& normal, double steep) noexcept {
    const Vec3 t = normal.unitOrthogonal(), s = normal.cross(t);
    const Vec3 ht = point.hessian * t;
    const double tt = ht.dot(t) / steep, ts = ht.dot(s) / steep, ss = s.dot(point.hessian * s) / steep;
    const double half = 0.5 * (tt - ss), size = std::sqrt(half * half + ts * ts);
    const double twice = size > 0 ? half / size : 1;  // cosine of twice the angle of the first direction
    along = std::sqrt(0.5 * (1 + twice)) * t + std::copysign(std::sqrt(0.5 * std::max(0.0, 1 - twice)), ts) * s;
    across = normal.cross(along);
    of_along = 0.5 * (tt + ss) + size;
    of_across = 0.5 * (tt + ss) - size;
  }
  Vec3 along, across;
  double of_along, of_across;
};

/// The triangles of a field's zeros: a vertex in every cell of a lattice whose corners have both signs, and a quad
/// around every edge of the lattice whose ends differ. The lattice divides each cell of the field into `fine` along
/// each axis.
class ZeroMesher {
 public:
  ZeroMesher(const ScalarField& field, int fine, bool mirrored) : field_(field), fine_(fine), mirrored_(mirrored) {
    for (std::size_t axis = 0; axis < 3; ++axis) count_[axis] = fine_ * (field_.size()[axis] - 3) + 1;
    columns_ = static_cast<std::size_t>(count_[0]);
    const std::size_t plane = columns_ * static_cast<std::size_t>(count_[1]);
    below_.resize(plane);
    above_.resize(plane);
    cells_.assign(plane, kNone);
    cells_below_.assign(plane, kNone);
    find_near();
  }

  TriangleMesh run() {
    find_signs(0, below_);
    for (int k = 0; k + 1 < count_[2]; ++k) {
      find_signs(k + 1, above_);
      std::fill(cells_.begin(), cells_.end(), kNone);
      for (int j = 0; j + 1 < count_[1]; ++j)
        for (int i = 0; i + 1 < count_[0]; ++i) mesh_cell(i, j, k);
      std::swap(cells_, cells_below_);
      std::swap(below_, above_);
    }
    return std::move(mesh_);
  }

 private:
  static constexpr std::uint32_t kNone = 0xffffffff;

  [[nodiscard]] Vec3 index_of(const Vec3& lattice) const { return Vec3::Ones() + lattice / fine_; }

  [[nodiscard]] std::uint8_t& near_at(int i, int j, int k) {
    const auto& size = field_.size();
    return near_[static_cast<std::size_t>(i) +
                 static_cast<std::size_t>(size[0]) *
                     (static_cast<std::size_t>(j) + static_cast<std::size_t>(size[1]) * static_cast<std::size_t>(k))];
  }

  /// Marks the cells of the field that have a zero, or that are beside one that has: only cells of the lattice in them
  /// can have one.
  void find_near() {
    const auto& size = field_.size();
    near_.resize(static_cast<std::size_t>(size[0]) * static_cast<std::size_t>(size[1]) *
                 static_cast<std::size_t>(size[2]));
    field_.each_zero_cell([&](int i, int j, int k) {
      for (int c = k - 1; c <= k + 1; ++c)
        for (int b = j - 1; b <= j + 1; ++b)
          for (int a = i - 1; a <= i + 1; ++a) near_at(a, b, c) = 1;
    });
  }

  /// Finds where the field is negative on a plane of the lattice.
  void find_signs(int k, std::vector<std::uint8_t>& signs) {
    const auto& size = field_.size();
    for (int j = 0; j < count_[1]; ++j)
      for (int i = 0; i < count_[0]; ++i) {
        const Vec3 u = index_of(Vec3(i, j, k));
        const int a = std::min(static_cast<int>(u.x()), size[0] - 3),
                  b = std::min(static_cast<int>(u.y()), size[1] - 3),
                  c = std::min(static_cast<int>(u.z()), size[2] - 3);
        // Away from the zeros, and at the samples, the sign is that of the sample.
        const bool sampled = near_at(a, b, c) == 0 || (i % fine_ == 0 && j % fine_ == 0 && k % fine_ == 0);
        const int ia = i / fine_ + 1, ib = j / fine_ + 1, ic = k / fine_ + 1;
        signs[static_cast<std::size_t>(i) + columns_ * static_cast<std::size_t>(j)] =
            sampled ? field_.negative(ia, ib, ic) : field_.slope_at(field_.place_of(u)).value < 0;
      }
  }

  /// Makes the vertex of a cell of the lattice, and the quads around the edges at its least corner.
  void mesh_cell(int i, int j, int k) {
    const std::size_t at = static_cast<std::size_t>(i) + columns_ * static_cast<std::size_t>(j);
    const std::array<std::uint8_t, 8> s{below_[at], below_[at + 1], below_[at + columns_], below_[at + columns_ + 1],
                                        above_[at], above_[at + 1], above_[at + columns_], above_[at + columns_ + 1]};
    Vec3 sum = Vec3::Zero();
    int crossings = 0;
    for (unsigned corner = 0; corner < 8; ++corner)
      for (unsigned axis = 0; axis < 3; ++axis) {
        const unsigned other = corner | (1U << axis);
        if (other == corner || s[corner] == s[other]) continue;
        Vec3 middle((corner & 1) != 0, (corner & 2) != 0, (corner & 4) != 0);
        middle[static_cast<int>(axis)] = 0.5;
        sum += middle;
        ++crossings;
      }
    if (crossings > 0) cells_[at] = add_vertex(Vec3(i, j, k) + sum / crossings);
    // Each edge of the lattice at this corner whose ends differ is crossed by the quad of the cells around it.
    if (s[0] != s[1] && j > 0 && k > 0)
      add_quad(cells_below_[at - columns_], cells_below_[at], cells_[at], cells_[at - columns_], s[0] == 0);
    if (s[0] != s[2] && i > 0 && k > 0)
      add_quad(cells_below_[at - 1], cells_[at - 1], cells_[at], cells_below_[at], s[0] == 0);
    if (s[0] != s[4] && i > 0 && j > 0)
      add_quad(cells_[at - 1 - columns_], cells_[at - columns_], cells_[at], cells_[at - 1], s[0] == 0);
  }

  /// Adds a vertex on the zeros near a place of the lattice.
  std::uint32_t add_vertex(const Vec3& middle) {
    Vec3 place = field_.place_of(index_of(middle));
    const Vec3 start = place;
    for (int polish = 0; polish < 4; ++polish) {
      const FieldPoint point = field_.slope_at(place);
      const double steep = point.gradient.squaredNorm();
      if (!(steep > 0)) break;
      const Vec3 next = place - point.value / steep * point.gradient;
      // Not into another cell's neighbour.
      if (!((fine_ * (field_.index_of(next) - field_.index_of(start))).cwiseAbs().maxCoeff() < 1)) break;
      place = next;
    }
    mesh_.vertices.push_back(place);
    return static_cast<std::uint32_t>(mesh_.vertices.size() - 1);
  }

  /// Adds two triangles along the shorter diagonal.
  void add_quad(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d, bool turned) {
    if (turned != mirrored_) std::swap(b, d);
    const auto& v = mesh_.vertices;
    if ((v[a] - v[c]).squaredNorm() <= (v[b] - v[d]).squaredNorm()) {
      mesh_.triangles.push_back({a, b, c});
      mesh_.triangles.push_back({a, c, d});
    } else {
      mesh_.triangles.push_back({b, c, d});
      mesh_.triangles.push_back({b, d, a});
    }
  }

  const ScalarField& field_;
  int fine_;
  bool mirrored_;  ///< the axes of the field are left-handed
  std::array<int, 3> count_{};
  std::size_t columns_ = 0;
  std::vector<std::uint8_t> near_;                  ///< cells of the field
  std::vector<std::uint8_t> below_, above_;         ///< signs at two planes of the lattice
  std::vector<std::uint32_t> cells_, cells_below_;  ///< vertices of two layers of cells
  TriangleMesh mesh_;
};

}  // namespace

Volume::Volume(std::shared_ptr<const VolumeData> data, const VolumeSpec& spec, std::vector<std::string> remarks)
    : data_(std::move(data)), spec_(spec), remarks_(std::move(remarks)) {
  const auto [least, most] = std::minmax_element(data_->values.begin(), data_->values.end());
  if (!(*least < spec_.iso && spec_.iso < *most))
    throw input_error(fmt::format("{}: iso is {}, but the values are from {} to {}: there is no surface", spec_.name,
                                  spec_.iso, *least, *most));
  build();
}

void Volume::build() {
  const double iso = spec_.iso, sign = spec_.inside_above ? -1 : 1;
  const auto change = [&](float value) { return static_cast<float>(sign * (static_cast<double>(value) - iso)); };
  // Beyond the border the field is at least as far outside as it is inside at the border, at most.
  float deepest = 0;
  std::size_t cut = 0;
  const auto& size = data_->size;
  for (std::size_t k = 0; k < size[2]; ++k)
    for (std::size_t j = 0; j < size[1]; ++j) {
      const bool edge = k == 0 || k + 1 == size[2] || j == 0 || j + 1 == size[1];
      for (std::size_t i = 0; i < size[0]; i += edge ? 1 : size[0] - 1) {
        const float value = change(data_->at(i, j, k));
        cut += value < 0 ? 1 : 0;
        deepest = std::min(deepest, value);
      }
    }
  const float floor = std::max(-deepest, std::numeric_limits<float>::min());
  field_ = std::make_unique<ScalarField>(*data_, spec_.order, change,
                                         [floor](float border) { return std::max(border, floor); });
  longest_ = 0.5 * field_->spacing().minCoeff();
  std::erase_if(remarks_, [](const std::string& remark) { return remark.starts_with(kCut); });
  if (cut > 0)
    remarks_.push_back(fmt::format("{} by the border of the grid, at {} samples, and closed there", kCut, cut));
  bounds_ = {};
  field_->each_zero_cell([&](int i, int j, int k) {
    for (int corner = 0; corner < 8; ++corner)
      bounds_.include(field_->place_of(
          Vec3(i + ((corner & 1) != 0 ? 2 : -1), j + ((corner & 2) != 0 ? 2 : -1), k + ((corner & 4) != 0 ? 2 : -1))));
  });
}

void Volume::prepare(double radius) {
  if (shown_only_) return;
  if (field_->order() != spec_.order) build();
  if (radius > 0) check_ball(radius);
}

void Volume::only_show(const Box& bounds) {
  if (spec_.order != 3)
    throw input_error("interpolation: a field needs 3, because its force is the gradient of its energy");
  shown_only_ = true;
  bounds_ = bounds;
  std::erase_if(remarks_, [](const std::string& remark) { return remark.starts_with(kCut); });
}

/// Throws Error(input) if a ball that touches some point of the surface reaches beyond another.
void Volume::check_ball(double radius) const {
  constexpr double kAllowed = 0.02;  // of the radius
  field_->each_zero_cell([&](int i, int j, int k) {
    const Vec3 start = field_->zero_near(field_->place_of(Vec3(i + 0.5, j + 0.5, k + 0.5)), 2 * longest_);
    if (!is_finite(start)) return;
    const Vec3 foot = moved(start, start, 2).place;
    const FieldPoint point = field_->at(foot);
    const double steep = norm_of(point.gradient);
    if (!(steep > 0)) return;
    const Vec3 normal = point.gradient / steep;
    const Bend bend(point, normal, steep);
    const Vec3 centre = foot + radius * normal;
    const bool hollow = radius * bend.of_across < -1;
    if (!hollow && !is_finite(field_->zero_near(centre, (1 - kAllowed) * radius))) return;
    throw input_error(
        fmt::format("a ball of {:.3g} m does not fit to the surface of {} at ({:.4g}, {:.4g}, {:.4g}) m, "
                    "which is hollow or near another part there. Use a smaller radius of the tool, or a "
                    "smoother volume",
                    radius, spec_.name, foot.x(), foot.y(), foot.z()));
  });
}

bool Volume::inside(const Vec3& place) const noexcept {
  return field_->covers(place) && field_->slope_at(place).value < 0;
}

/// Moves a point near the surface to where its distance from `goal` is least, with as many steps that are not
/// shortened.
Volume::Foot Volume::moved(const Vec3& start, const Vec3& goal, int steps) const noexcept {
  constexpr double kTurn = 0.5;  // cosine
  constexpr int kHalvings = 6;
  Vec3 place = start;
  FieldPoint point = field_->at(place);
  double reach = longest_;
  int halvings = 0;
  for (int move = 0; move < kMostMoves && steps > 0; ++move) {
    const double steep = norm_of(point.gradient);
    if (!(steep > 0)) break;
    const Vec3 normal = point.gradient / steep;
    const double off = point.value / steep;
    const Vec3 on = place - off * normal, rest = goal - on;
    const double depth = -rest.dot(normal);
    const Bend bend(point, normal, steep);
    // Beyond the centre of curvature the distance is not least, and the step leads downhill.
    const auto part = [&](const Vec3& direction, double curvature) {
      return rest.dot(direction) / std::max(kLeastShare, std::abs(1 - depth * curvature));
    };
    double u = part(bend.along, bend.of_along), v = part(bend.across, bend.of_across);
    double length = std::hypot(u, v);
    const bool shortened = length > reach;
    if (shortened) {
      u *= reach / length;
      v *= reach / length;
      length = reach;
    }
    const double sag = 0.5 * (bend.of_along * u * u + bend.of_across * v * v);
    const double limit = 0.5 * length + reach;
    const Vec3 back = std::clamp(off + sag, -limit, limit) * normal;
    const Vec3 next = place + u * bend.along + v * bend.across - back;
    const FieldPoint there = field_->at(next);
    const double steep_there = norm_of(there.gradient);
    const double turned = there.gradient.dot(normal);
    const bool nearer = (goal - next + there.value / (steep_there * steep_there) * there.gradient).squaredNorm() <=
                        rest.squaredNorm() * (1 + 1e-9) + 1e-20;
    if (!(turned > kTurn * steep_there) || (length > 1e-3 * longest_ && !nearer)) {
      reach = 0.25 * length;
      if (++halvings > kHalvings) break;
      continue;
    }
    place = next;
    point = there;
    if (!shortened) --steps;
    if (length < 1e-8 * longest_ && std::abs(off) < 1e-8 * longest_) break;
    reach = std::min(longest_, 2 * reach);
  }
  const double steep = point.gradient.squaredNorm();
  if (steep > 0 && std::abs(point.value) < longest_ * std::sqrt(steep)) place -= point.value / steep * point.gradient;
  return {place, point.gradient};
}

/// Returns the surface point at which a step begins a contact, or NaN. `outside`: the tool has left the surface.
Vec3 Volume::first_contact(const ToolStep& step, bool outside) const noexcept {
  if (!is_finite(step.from)) {
    if (step.radius > 0) return inside(step.to) ? nearest(step.to).position : field_->zero_near(step.to, step.radius);
    return inside(step.to) ? nearest(step.to).position : nan3();
  }
  const Vec3 way = step.to - step.from;
  const double hit = field_->entered(step.from, step.to);
  if (step.radius > 0) {
    constexpr int kMostPlaces = 64;
    const int places = std::clamp(static_cast<int>(std::min(1e6, 2 * norm_of(way) / step.radius)) + 1, 1, kMostPlaces);
    for (int i = 1; i <= places; ++i) {
      const double share = static_cast<double>(i) / places;
      Vec3 foot = field_->zero_near(step.from + std::min(hit, share) * way, step.radius);
      if (is_finite(foot)) return foot;
      if (share > hit) break;
    }
  }
  if (hit <= 1) return step.from + hit * way;
  if (outside || !inside(step.to)) return nan3();
  return nearest(step.to).position;
}

void Volume::follow(const ToolStep& step, Proxy& proxy) const noexcept {
  if (!is_finite(step.to)) return;
  constexpr int kMostParts = 3;  // of the surface that a tick passes
  const bool before = proxy.touching, anew = !before && !is_finite(step.from);
  Vec3 place = before ? proxy.memory.place : first_contact(step, false);
  for (int part = 0; part < kMostParts && is_finite(place); ++part) {
    const Foot foot = moved(place, step.to, spec_.steps);
    place = foot.place;
    const double steep = norm_of(foot.gradient);
    if (!(steep > 0)) break;
    proxy.normal = foot.gradient / steep;
    proxy.depth = step.radius + proxy.normal.dot(place - step.to);
    if (proxy.depth > (before ? -step.reach : 0)) {
      proxy.position = place + step.radius * proxy.normal;
      proxy.memory.place = place;
      proxy.known = proxy.touching = true;
      proxy.began_inside = before ? proxy.began_inside : anew;
      return;
    }
    // Free here, the tool may meet another part of the surface on its way on.
    place = first_contact({.from = place + step.radius * proxy.normal, .to = step.to}, true);
  }
  release(proxy);
}

void Volume::approach(const ToolStep& step, Proxy& proxy) const noexcept {
  if (!is_finite(step.to) || inside(step.to)) return;
  const Vec3 start = field_->zero_near(step.to, step.radius + step.reach);
  if (!is_finite(start)) return;
  const Foot foot = moved(start, step.to, kMostSteps);
  const double steep = norm_of(foot.gradient);
  if (!(steep > 0)) return;
  const Vec3 normal = foot.gradient / steep;
  const double depth = step.radius + normal.dot(foot.place - step.to);
  if (!(depth > -step.reach)) return;
  proxy = {
      .position = foot.place + step.radius * normal, .normal = normal, .depth = depth, .known = true, .touching = true};
  proxy.memory.place = foot.place;
}

SurfacePoint Volume::nearest(const Vec3& place) const noexcept {
  SurfacePoint point;
  const Vec3 start = field_->zero_near(place, std::numeric_limits<double>::infinity());
  if (!is_finite(start)) return point;
  const Foot foot = moved(start, place, kMostSteps);
  point.position = foot.place;
  point.normal = foot.gradient.stableNormalized();
  point.distance = (inside(place) ? -1 : 1) * norm_of(place - point.position);
  return point;
}

Eigen::Matrix3d Volume::slide(const Proxy& proxy) const noexcept {
  constexpr double kLeast = 1e-3;  // the proxy runs away where the tool reaches the centre of curvature
  const FieldPoint point = field_->at(proxy.memory.place);
  const double steep = norm_of(point.gradient);
  if (!(steep > 0)) return without(proxy.normal);
  const Bend bend(point, proxy.normal, steep);
  const double radius = norm_of(proxy.position - proxy.memory.place);
  const auto share = [&](double k) {
    k /= std::max(kLeast, 1 + radius * k);
    return 1 / std::max(kLeast, 1 - proxy.depth * k);
  };
  return share(bend.of_along) * bend.along * bend.along.transpose() +
         share(bend.of_across) * bend.across * bend.across.transpose();
}

TriangleMesh Volume::tessellated(double tolerance, const Box&) const {
  // The finer the lattice, the less a triangle's middle is from a surface that curves by a sample's length.
  constexpr int kFinest = 6;
  const double side = field_->spacing().maxCoeff();
  const int fine =
      std::clamp(static_cast<int>(std::ceil(std::sqrt(0.25 * side / std::max(tolerance, 1e-9)))), 1, kFinest);
  return ZeroMesher(*field_, fine, data_->steps.determinant() < 0).run();
}

std::vector<Knob> Volume::knobs() const {
  if (shown_only_) return {};
  return {{"interpolation", "", {1, 3}, static_cast<double>(spec_.order), 0, 3},
          {"steps", "", {1, 2, 3}, static_cast<double>(spec_.steps), 0, kMostSteps}};
}

void Volume::set(const std::string& knob, double level) {
  if (knob == "interpolation") spec_.order = level < 2 ? 1 : 3;
  if (knob == "steps") spec_.steps = std::max(1, static_cast<int>(std::lround(level)));
}

std::unique_ptr<Shape> read_volume(JsonReader& reader, SceneFiles& files) {
  constexpr double kLargest = 1e30;
  VolumeSpec spec;
  const std::string file = files.find(reader.require("file").text("file", ""));
  const std::string unit = reader.text("unit", "");
  const std::array<std::string, 2> sides{"above", "below"};
  spec.name = file;
  spec.iso = reader.require("iso").number("iso", 0, -kLargest, kLargest);
  spec.inside_above = reader.choice("inside", "above", sides) == "above";
  spec.order = reader.integer("interpolation", spec.order, 1, 3);
  if (spec.order == 2) throw input_error(reader.where() + ".interpolation: it is 1 (trilinear) or 3 (tricubic)");
  spec.steps = reader.integer("steps", spec.steps, 1, kMostSteps);
  VolumeLoad load = load_volume(file, unit);
  if (!load.data_file.empty()) (void)files.find(std::filesystem::absolute(load.data_file).string());
  return std::make_unique<Volume>(std::make_shared<const VolumeData>(std::move(load.data)), spec,
                                  std::move(load.remarks));
}

}  // namespace haptrace
