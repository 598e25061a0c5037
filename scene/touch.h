// The question to a virtual object, and its answer.
#pragma once

#include "base/types.h"

#include <cstdint>

namespace haptrace {

/// State of the tool in a query of an object.
struct Touch {
  Vec3 position = Vec3::Zero();  ///< position of the tool's tip, p_WT [m]
  Vec3 velocity = Vec3::Zero();  ///< in W [m/s]
  double dt = 0;                 ///< time since the last query [s]; 0 at the first query and after a reset
  // From the last query; a scene fills them in. NaN: there was none, so the tool may already be inside an object.
  Vec3 last_position = nan3();  ///< [m]
  Vec3 last_velocity = nan3();  ///< [m/s]

  /// Returns whether position and velocity are finite and small enough to be squared.
  [[nodiscard]] bool valid() const noexcept {
    return (position.array().abs() < kFarthest).all() && (velocity.array().abs() < kFarthest).all();
  }
  static constexpr double kFarthest = 1e9;  ///< [m], [m/s]
};

/// An object's answer: its force on the hand, and the quantities needed to predict or supervise this force. An object
/// that is not touched, or has no surface near the tool, returns the default.
struct Contact {
  Vec3 force = Vec3::Zero();   ///< on the hand, in W [N]
  Vec3 place = Vec3::Zero();   ///< tool position for which the answer holds, p_WT: current, or ahead [m]
  Vec3 proxy = nan3();         ///< where the surface holds the tool back, in W [m]; NaN if no surface is near
  Vec3 normal = Vec3::Zero();  ///< unit normal of the nearest surface, out of the object; zero if unknown
  double depth = 0;  ///< penetration depth along the normal [m]; outside, if the normal is known, minus the distance
  double stiffness = 0;      ///< -d force / d depth along the normal, at this depth [N/m]
  double damping = 0;        ///< -d force / d velocity along the normal, only while penetrating further [N s/m]
  double stored = 0;         ///< energy in the object's springs, which they can return [J]
  double vibration = 0;      ///< amplitude of an intended vibration in the force, as of a texture [N]
  std::uint32_t object = 0;  ///< index in the scene
  bool pushed_out = false;   ///< the tool began inside the object, whose force grows slowly
  bool clings = false;       ///< holds the tool without a penetration: an adhesion pulls, or a field drags

  /// Returns whether the tool presses into the object.
  [[nodiscard]] bool touched() const noexcept { return depth > 0; }
  /// Returns whether the object acts on the tool, or would if the tool moved.
  [[nodiscard]] bool acts() const noexcept { return touched() || clings; }
};

/// Timing for which an object prepares.
struct SceneTiming {
  double rate_hz = 1000;  ///< rate of the queries
  /// Distance from an object within which its contact states the nearest surface of an object that is not touched, for
  /// a prediction [m]. Shapes that know it at no cost state it at any distance.
  double ahead = 0;
  double resolution = 0;  ///< distance between the device's positions; 0: not known [m]
};

}  // namespace haptrace
