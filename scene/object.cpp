#include "scene/object.h"

#include "base/error.h"
#include "base/suggest.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

/// An object on a body that does not move. A body at the origin costs nothing, and neither does a surface that no
/// texture raises.
template <class Body, bool kRaised>
class FixedObject final : public Object {
 public:
  FixedObject(std::string name, std::string kind, std::unique_ptr<Shape> shape, std::unique_ptr<Surface> surface,
              const Body& body)
      : Object(std::move(name), std::move(kind), std::move(shape), std::move(surface)), body_(body) {}

  [[nodiscard]] Pose pose() const noexcept override {
    if constexpr (std::is_same_v<Body, Pose>)
      return body_;
    else
      return {};
  }

  [[nodiscard]] Contact answer(const Touch& touch) noexcept override {
    if (!touch.valid()) return {};
    const double ahead = surface_->ahead();
    const ToolStep step{.from = body_.place_of(touch.last_position + ahead * touch.last_velocity),
                        .to = body_.place_of(touch.position + ahead * touch.velocity),
                        .radius = radius_,
                        .reach = surface_->reach()};
    [[maybe_unused]] const bool began_inside = proxy_.began_inside;
    shape_->follow(step, proxy_);
    if constexpr (kRaised)
      if (!proxy_.touching) shape_->approach(step, proxy_);
    Contact contact;
    if (!proxy_.touching && memory_.used) memory_ = {};
    if (proxy_.known)
      contact = surface_->press({.shape = *shape_,
                                 .proxy = proxy_,
                                 .step = step,
                                 .velocity = body_.vector_of(touch.velocity),
                                 .dt = touch.dt},
                                memory_);
    else
      look_ahead(step.to, contact);
    if constexpr (kRaised) {
      if (!proxy_.touching && !contact.normal.isZero(0)) contact.depth += surface_->height(contact.proxy);
      // Not behind the shape but behind the raised surface.
      proxy_.began_inside = contact.touched() && (began_inside || std::isnan(touch.last_position.x()));
    }
    if (proxy_.began_inside) soften(touch.dt, contact);
    body_.to_world(contact);
    return contact;
  }

 private:
  Body body_;
};

}  // namespace

void Object::prepare(const SceneTiming& timing, const PointTool& tool) {
  radius_ = tool.radius;
  ahead_ = timing.ahead;
  try {
    shape_->prepare(tool.radius);
    surface_->prepare(timing);
  } catch (const Error& error) {
    throw input_error(name_ + ": " + error.what());
  }
  reset();
}

void Object::reset() noexcept {
  release(proxy_);
  memory_ = {};
  pushed_out_ = 0;
}

void Object::soften(double dt, Contact& contact) noexcept {
  if (pushed_out_ >= kPushOut) return;
  const double share = pushed_out_ / kPushOut;
  pushed_out_ += dt;
  contact.force *= share;
  contact.stiffness *= share;
  contact.damping *= share;
  contact.stored *= share;
  contact.vibration *= share;
  contact.pushed_out = true;
}

void Object::look_ahead(const Vec3& place, Contact& contact) const noexcept {
  contact.place = place;
  if (!(ahead_ > 0)) return;
  const SurfacePoint point = shape_->nearest(place);
  if (!(point.distance > radius_ && point.distance < ahead_)) return;
  contact.normal = point.normal;
  contact.proxy = point.position + radius_ * point.normal;
  contact.depth = radius_ - point.distance;
}

Box Object::bounds() const noexcept {
  Box box = box_in_world(pose(), shape_->bounds());
  const Vec3 around = Vec3::Constant(radius_ + surface_->reach());
  return {box.min - around, box.max + around};
}

bool Object::meets(const Box& space) const noexcept {
  return shape_->meets(box_in_frame(pose(), space));
}

TriangleMesh Object::tessellated(double tolerance, const Box& space) const {
  const Pose frame = pose();
  TriangleMesh mesh = shape_->tessellated(tolerance, box_in_frame(frame, space));
  for (Vec3& vertex : mesh.vertices) vertex = frame.position + frame.axes * vertex;
  return mesh;
}

std::vector<std::string> Object::remarks() const {
  std::vector<std::string> remarks = shape_->remarks();
  for (std::string& remark : surface_->remarks()) remarks.push_back(std::move(remark));
  if (!surface_->parts().shading) return remarks;
  if (shape_->smooths())
    remarks.emplace_back(
        "`shading` can drive the hand: a closed stroke may give energy, more with coarse triangles; smaller triangles "
        "or no `shading` give less");
  else if (kind_ == "mesh")
    remarks.emplace_back("`shading` has no effect on a tool with a radius, which rolls over the edges");
  else
    remarks.push_back(fmt::format("`shading` has no effect on the kind '{}': it smooths only meshes", kind_));
  return remarks;
}

std::vector<Knob> Object::knobs() const {
  std::vector<Knob> knobs = shape_->knobs();
  for (Knob& knob : surface_->knobs()) knobs.push_back(std::move(knob));
  return knobs;
}

void Object::set(const std::string& knob, double level) {
  std::vector<std::string> known;
  for (Adjustable* part : std::initializer_list<Adjustable*>{shape_.get(), surface_.get()})
    for (const Knob& own : part->knobs()) {
      known.push_back(own.name);
      if (own.name != knob) continue;
      check_range(name_ + ": " + knob, level, own.least, own.most, own.unit);
      return part->set(knob, level);
    }
  throw input_error(fmt::format("{}: there is no accuracy setting '{}'{}", name_, knob, suggestion(knob, known)));
}

std::unique_ptr<Object> make_fixed_object(std::string name, std::string kind, std::unique_ptr<Shape> shape,
                                          std::unique_ptr<Surface> surface, const std::optional<Pose>& pose) {
  const auto make = [&]<class Body>(const Body& body) -> std::unique_ptr<Object> {
    if (surface->raised())
      return std::make_unique<FixedObject<Body, true>>(std::move(name), std::move(kind), std::move(shape),
                                                       std::move(surface), body);
    return std::make_unique<FixedObject<Body, false>>(std::move(name), std::move(kind), std::move(shape),
                                                      std::move(surface), body);
  };
  return pose ? make(*pose) : make(AtOrigin{});
}

}  // namespace haptrace
