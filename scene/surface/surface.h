// Interface of surfaces: what a contact feels like, whatever the shape.
#pragma once

#include "scene/shape/shape.h"
#include "scene/touch.h"

#include <array>
#include <string>
#include <vector>

namespace haptrace {

/// A contact as its surface sees it, in the shape's frame.
struct Press {
  const Shape& shape;  ///< to ask it for slide() and smooth()
  const Proxy& proxy;  ///< `known`
  const ToolStep& step;
  Vec3 velocity = Vec3::Zero();  ///< of the tool [m/s]
  double dt = 0;                 ///< time since the last query [s]; 0: not known

  /// Returns the point of the surface that is touched [m].
  [[nodiscard]] Vec3 place() const noexcept { return proxy.position - step.radius * proxy.normal; }
};

/// A surface's memory of a contact: the state of friction and adhesion. It belongs to the contact.
struct SurfaceMemory {
  Vec3 bristle = Vec3::Zero();  ///< elastic part of the tangential displacement [m]
  Vec3 place = nan3();          ///< touched point of the last query [m]
  bool slides = false;
  bool stuck = false;             ///< an adhesion holds the tool, once it has pressed into a raised surface
  bool used = false;              ///< holds anything: set by surfaces that remember
  std::array<double, 4> value{};  ///< of the surface's own
};

/// Pull of a surface on a tool that leaves it, up to a largest force; the contact then ends. It is a spring, so it
/// gives back no more than it took.
struct AdhesionSpec {
  double force = 0;      ///< largest pull [N]; 0: none
  double stiffness = 1;  ///< [N/m]

  /// Returns the distance in front of the surface at which it lets go [m].
  [[nodiscard]] double reach() const noexcept { return force / stiffness; }
};

/// The parts of a surface other than its spring and damper.
struct SurfaceParts {
  bool shading = false, friction = false, texture = false, adhesion = false;
};

/// Turns a contact into a force.
///
/// Order of calls: set() any number of times, prepare(), then all others. Real-time: press allocates nothing, locks
/// nothing, throws nothing.
class Surface : public Adjustable {
 public:
  virtual void prepare(const SceneTiming& timing) { (void)timing; }

  /// Returns the time by which contacts are evaluated ahead of the tool [s].
  [[nodiscard]] double ahead() const noexcept { return ahead_; }

  /// Returns the distance in front of the shape within which a contact lasts [m].
  [[nodiscard]] virtual double reach() const noexcept { return 0; }

  [[nodiscard]] virtual SurfaceParts parts() const noexcept { return {}; }

  /// Returns the spring that holds a tool back which leaves the surface; without an adhesion, none.
  [[nodiscard]] virtual AdhesionSpec adhesion() const noexcept { return {}; }

  /// Returns whether the tool can be touched in front of the shape, within the reach: a texture raises the surface.
  [[nodiscard]] virtual bool raised() const noexcept { return false; }
  /// Returns the height of a raised surface above the shape at a proxy in the shape's frame, for a tool that rests [m].
  [[nodiscard]] virtual double height(const Vec3& proxy) const noexcept {
    (void)proxy;
    return 0;
  }

  /// Returns notes for the user on the prepared surface: what the rate or the device does not do justice to.
  [[nodiscard]] virtual std::vector<std::string> remarks() const { return {}; }

  /// Returns the contact, in the shape's frame. If the proxy is not touching, its force is zero, and the memory is
  /// new. The depth is that behind the raised surface, if it is raised.
  [[nodiscard]] virtual Contact press(const Press& press, SurfaceMemory& memory) const noexcept = 0;

 protected:
  double ahead_ = 0;
};

}  // namespace haptrace
