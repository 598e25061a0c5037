// Where a fixed body is.
#pragma once

#include "scene/shape/shape.h"
#include "scene/touch.h"

namespace haptrace {

/// A body at the origin of W: its shape's frame is W. Costs nothing.
struct AtOrigin {
  [[nodiscard]] static Vec3 place_of(const Vec3& in_world) noexcept { return in_world; }
  [[nodiscard]] static Vec3 vector_of(const Vec3& in_world) noexcept { return in_world; }
  static void to_world(Contact&) noexcept {}
};

/// Position and orientation of a frame in W.
struct Pose {
  Vec3 position = Vec3::Zero();                        ///< of its origin [m]
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  ///< columns: its axes in W, orthonormal

  /// Returns a point of W in this frame.
  [[nodiscard]] Vec3 place_of(const Vec3& in_world) const noexcept { return axes.transpose() * (in_world - position); }
  /// Returns a vector of W in this frame.
  [[nodiscard]] Vec3 vector_of(const Vec3& in_world) const noexcept { return axes.transpose() * in_world; }
  /// Turns a contact of this frame into one of W.
  void to_world(Contact& contact) const noexcept {
    contact.force = axes * contact.force;
    contact.normal = axes * contact.normal;
    contact.place = position + axes * contact.place;
    contact.proxy = position + axes * contact.proxy;
  }
};

/// Returns the box of W, with sides along its axes, around a box of the frame; infinite where that is.
Box box_in_world(const Pose& pose, const Box& box) noexcept;
/// Returns the box of the frame, with sides along its axes, around a box of W.
Box box_in_frame(const Pose& pose, const Box& box) noexcept;

}  // namespace haptrace
