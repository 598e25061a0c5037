// A surface where a field is zero.
#pragma once

#include "scene/shape/bvh.h"
#include "scene/shape/implicit_field.h"
#include "scene/shape/shape.h"

#include <array>
#include <string>
#include <vector>

namespace haptrace {

/// The solid f < 0 of a Boolean combination of fields, inside a box. It is touched by a point.
///
/// The first contact is the first root of f along the tool's step, which interval arithmetic finds however thin the
/// solid is. Then the proxy is the closest point of the surface: Newton's method on the conditions of
///
///     least |x - tool|^2,  f_i(x) = 0 for one, two or three pieces,  x - tool = sum l_i grad f_i,  l_i >= 0,
///
/// starts from the proxy's last place and holds the pieces that the proxy met: on an inner edge two, in an inner corner
/// three. A step is at most a tenth of the radius of curvature, and bounds of f along it show that nothing of the
/// solid is in between; where there is, that piece is held, too. Where the proxy leaves a piece over its outer edge, it
/// goes straight to the tool, until it meets the solid again.
///
/// Where the gradient vanishes or is not finite, the surface has no direction, and the tool feels nothing.
///
/// The accuracy setting `steps` is the largest number of Newton's steps in a tick.
class Implicit final : public Shape {
 public:
  static constexpr int kMostSteps = 8;

  /// `box`: where the surface is; the field should not be negative on its sides. Throws Error(input) when no place in
  /// it is inside.
  Implicit(FieldNode root, const Box& box, std::vector<std::string> remarks = {});

  void prepare(double radius) override;
  void follow(const ToolStep& step, Proxy& proxy) const noexcept override;
  void approach(const ToolStep& step, Proxy& proxy) const noexcept override;
  [[nodiscard]] SurfacePoint nearest(const Vec3& place) const noexcept override;
  [[nodiscard]] Eigen::Matrix3d slide(const Proxy& proxy) const noexcept override;
  [[nodiscard]] std::vector<std::string> remarks() const override { return remarks_; }
  [[nodiscard]] Box bounds() const noexcept override { return box_; }
  [[nodiscard]] bool meets(const Box& space) const noexcept override;
  [[nodiscard]] TriangleMesh tessellated(double tolerance, const Box& space) const override;
  [[nodiscard]] std::vector<Knob> knobs() const override;
  void set(const std::string& knob, double level) override;

  [[nodiscard]] const FieldTree& field() const noexcept { return field_; }

 private:
  /// Pieces that hold the proxy.
  struct Held {
    std::array<std::uint32_t, 3> piece{};
    std::size_t count = 0;
    [[nodiscard]] bool has(std::uint32_t one) const noexcept;
    void drop(std::size_t i) noexcept;
    void add(std::uint32_t one) noexcept;
  };
  struct Stand {
    Vec3 place = nan3();
    Held held;
  };
  struct Sweep {
    bool hit = false;
    Vec3 place = nan3();  ///< the last one outside
    double share = 1;
    std::uint32_t piece = 0;
  };
  struct Move {
    enum class Result : std::uint8_t { moves, free, stuck, lost } result = Result::lost;
    Vec3 step = Vec3::Zero();
    Vec3 out = Vec3::Zero();  ///< vector to the outside of all held pieces, 1 m from each
    double bend = 0;          ///< largest curvature [1/m]
    double slope = 0;         ///< least |grad f|
  };
  class Pieces;

  [[nodiscard]] Sweep sweep(const Vec3& from, const Vec3& to) const noexcept;
  [[nodiscard]] Sweep between(const Stand& stand, const Move& move) const noexcept;
  [[nodiscard]] Move newton(const Vec3& to, bool pulls, Stand& stand) const noexcept;
  [[nodiscard]] bool begin(const ToolStep& step, Stand& stand, bool& inside) const noexcept;
  [[nodiscard]] bool walk(const Vec3& to, bool pulls, Stand& stand) const noexcept;
  bool polish(Stand& stand, std::array<Vec3, 3>& normals) const noexcept;
  [[nodiscard]] Vec3 closest(const Vec3& place, Held& held) const noexcept;
  [[nodiscard]] SurfacePoint nearest(const Vec3& place, Held& held) const noexcept;
  static void remember(const Held& held, Proxy& proxy) noexcept;
  [[nodiscard]] TriangleMesh triangles(const std::array<int, 3>& cells) const;

  FieldTree field_;
  Box box_;
  double size_;  ///< of the box [m]
  TriangleMesh coarse_;
  TriangleTree tree_;  ///< over coarse_: where the search for the nearest surface begins
  std::vector<std::string> remarks_;
  int steps_ = 4;
};

}  // namespace haptrace
