// An object that the hand can touch: a shape with a surface on a body.
#pragma once

#include "scene/body/pose.h"
#include "scene/shape/shape.h"
#include "scene/surface/surface.h"
#include "scene/tool/point_tool.h"
#include "scene/touch.h"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// One object of a scene, and its contact with the tool. It depends only on its own settings, not on other objects.
/// Objects that a scene does not contain cost nothing, and neither does what an object does not name.
///
/// If the tool is inside when a session starts, its force grows from zero within kPushOut, and the contact says so.
/// Inside means behind the surface that is felt: on the crest of a texture that is in front of the shape.
///
/// Order of calls: set() any number of times, prepare() once before each session, then reset() and answer(). Real-time:
/// reset and answer allocate nothing, lock nothing, throw nothing, do no I/O. Threads: one at a time.
class Object {
 public:
  static constexpr double kPushOut = 0.5;  ///< [s]

  virtual ~Object() = default;
  Object(const Object&) = delete;
  Object& operator=(const Object&) = delete;

  /// Returns the name in the scene; it is unique there.
  [[nodiscard]] const std::string& name() const noexcept { return name_; }
  /// Returns the kind of its shape, as in a scene file.
  [[nodiscard]] const std::string& kind() const noexcept { return kind_; }
  [[nodiscard]] const Shape& shape() const noexcept { return *shape_; }
  [[nodiscard]] const Surface& surface() const noexcept { return *surface_; }
  [[nodiscard]] virtual Pose pose() const noexcept = 0;

  /// Allocates all memory that answer() needs. Throws Error(input) when the tool or the rate is not possible.
  void prepare(const SceneTiming& timing, const PointTool& tool);

  /// Forgets the contact and its history. Called at the start of a session, and after a gap in it.
  void reset() noexcept;

  /// Returns the force for the coming tick. An object with memory advances by touch.dt. A touch that is not valid()
  /// gives no contact and leaves the memory unchanged.
  [[nodiscard]] virtual Contact answer(const Touch& touch) noexcept = 0;

  /// Returns whether the last answer was a contact, which a tool outside the object's bounds may still have: it has
  /// been pushed through.
  [[nodiscard]] bool holds() const noexcept { return proxy_.touching; }

  /// Returns the box around the object, the reach of its surface included [m, in W].
  [[nodiscard]] Box bounds() const noexcept;
  /// Returns whether any part of the object is inside `space`, a box of W.
  [[nodiscard]] bool meets(const Box& space) const noexcept;
  /// Returns triangles within `tolerance` [m] of the object, of its part inside `space`. In W.
  [[nodiscard]] TriangleMesh tessellated(double tolerance, const Box& space) const;

  /// Returns notes for the user on the prepared shape and surface, and on what they do to each other.
  [[nodiscard]] std::vector<std::string> remarks() const;

  /// Returns the accuracy settings of its parts, for haptrace tradeoff.
  [[nodiscard]] std::vector<Knob> knobs() const;
  /// Sets an accuracy setting. Throws Error(input) naming the object, the setting and its range, or the nearest known
  /// setting.
  void set(const std::string& knob, double level);

 protected:
  Object(std::string name, std::string kind, std::unique_ptr<Shape> shape, std::unique_ptr<Surface> surface)
      : name_(std::move(name)), kind_(std::move(kind)), shape_(std::move(shape)), surface_(std::move(surface)) {}

  /// Lets the force of a tool that began inside grow.
  void soften(double dt, Contact& contact) noexcept;
  /// States the nearest surface of an object that is not touched.
  void look_ahead(const Vec3& place, Contact& contact) const noexcept;

  std::string name_, kind_;
  std::unique_ptr<Shape> shape_;
  std::unique_ptr<Surface> surface_;
  double radius_ = 0;  ///< of the tool [m]
  double ahead_ = 0;   ///< SceneTiming::ahead [m]
  Proxy proxy_;
  SurfaceMemory memory_;
  double pushed_out_ = 0;  ///< time in a contact that began inside [s]
};

/// Makes an object on a body that does not move. Without a pose, its shape's frame is W.
std::unique_ptr<Object> make_fixed_object(std::string name, std::string kind, std::unique_ptr<Shape> shape,
                                          std::unique_ptr<Surface> surface, const std::optional<Pose>& pose = {});

}  // namespace haptrace
