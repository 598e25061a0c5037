#include "scene/wall.h"

#include "base/error.h"

namespace haptrace {
namespace {

constexpr double kMaxPoint = 100;                      // [m], of each coordinate
constexpr double kMinNormal = 1e-6, kMaxNormal = 1e6;  // length

}  // namespace

Wall::Wall(std::string name, const WallSpec& spec) : name_(std::move(name)), surface_(name_, spec.surface) {
  for (int axis = 0; axis < 3; ++axis) check_range(name_ + ": point", spec.point[axis], -kMaxPoint, kMaxPoint, "m");
  check_range(name_ + ": the length of normal", spec.normal.stableNorm(), kMinNormal, kMaxNormal);
  normal_ = spec.normal.stableNormalized();
  height_ = normal_.dot(spec.point);
}

Contact Wall::answer(const Touch& touch) noexcept {
  if (!touch.valid()) return {};
  const Vec3 place = surface_.place(touch);
  return surface_.contact(touch, place, normal_, height_ - normal_.dot(place));
}

bool Wall::meets(const Box& space) const noexcept {
  const Vec3 deepest = (normal_.array() > 0).select(space.min, space.max);
  return normal_.dot(deepest) < height_;
}

void Wall::set(const std::string& knob, double level) {
  if (knob != "lead") throw unknown_knob(*this, knob);
  surface_.set_lead(name_, level);
}

std::unique_ptr<SceneObject> read_wall(JsonReader& reader, const std::string& name) {
  WallSpec spec;
  spec.point = reader.require("point").vector("point", spec.point, -kMaxPoint, kMaxPoint);
  spec.normal = reader.require("normal").vector("normal", spec.normal, -kMaxNormal, kMaxNormal);
  if (!(spec.normal.stableNorm() >= kMinNormal && spec.normal.stableNorm() <= kMaxNormal))
    throw input_error(reader.where() + ".normal: the vector has no direction");
  spec.surface = read_penalty(reader);
  return std::make_unique<Wall>(name, spec);
}

}  // namespace haptrace
