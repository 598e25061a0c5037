// A flat, frictionless wall.
#pragma once

#include "scene/penalty.h"

#include <memory>

namespace haptrace {

struct WallSpec {
  Vec3 point = Vec3::Zero();    ///< any point of its surface, in W [m]
  Vec3 normal = Vec3::UnitZ();  ///< out of the wall, of any length above 1e-6
  PenaltySpec surface;
};

/// A half space: everything behind the plane through a point. Has no memory.
class Wall final : public SceneObject {
 public:
  /// Throws Error(input) naming the value that is out of range.
  Wall(std::string name, const WallSpec& spec);

  [[nodiscard]] const std::string& name() const noexcept override { return name_; }
  void prepare(const SceneTiming& timing) override { surface_.prepare(timing); }
  [[nodiscard]] Contact answer(const Touch& touch) noexcept override;
  [[nodiscard]] bool meets(const Box& space) const noexcept override;
  [[nodiscard]] std::vector<Knob> knobs() const override { return {surface_.knob()}; }
  void set(const std::string& knob, double level) override;

 private:
  std::string name_;
  Vec3 normal_;    ///< unit normal
  double height_;  ///< height of the surface along the normal [m]
  Penalty surface_;
};

/// Reads {"kind": "wall", "point": [x, y, z], "normal": [x, y, z], "stiffness": N/m, "damping", "lead"}
std::unique_ptr<SceneObject> read_wall(JsonReader& reader, const std::string& name);

}  // namespace haptrace
