// Interface of an object that the hand can touch.
#pragma once

#include "base/error.h"
#include "base/types.h"
#include "control/path/path.h"

#include <string>
#include <vector>

namespace haptrace {

/// State of the tool in a query of an object.
struct Touch {
  Vec3 position = Vec3::Zero();  ///< position of the tool's tip, p_WT [m]
  Vec3 velocity = Vec3::Zero();  ///< in W [m/s]
  double dt = 0;                 ///< time since the last query [s]; 0 at the first query and after a reset

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
  Vec3 normal = Vec3::Zero();  ///< unit normal of the nearest surface, out of the object; zero if unknown
  double depth = 0;  ///< penetration depth along the normal [m]; outside, if the normal is known, minus the distance
  double stiffness = 0;  ///< -d force / d depth along the normal, at this depth [N/m]
  double damping = 0;    ///< -d force / d velocity along the normal, only while penetrating further [N s/m]
  double stored = 0;     ///< energy in the object's springs, which they can return [J]

  [[nodiscard]] bool touched() const noexcept { return depth > 0; }
};

/// A setting that trades accuracy for speed.
struct Knob {
  std::string name;            ///< key of the object in a scene file
  std::string unit;            ///< SI; empty if dimensionless
  std::vector<double> levels;  ///< levels worth trying, from the fastest to the most accurate
  double level = 0;            ///< current level
};

/// Timing for which an object prepares.
struct SceneTiming {
  double rate_hz = 1000;  ///< rate of the queries
};

/// One object of a scene. It depends only on its own settings, not on other objects. Objects that a scene does not
/// contain cost nothing.
///
/// Order of calls: set() any number of times, prepare() once before each session, then reset() and answer(). Real-time:
/// reset and answer allocate nothing, lock nothing, throw nothing, do no I/O. Threads: one at a time.
class SceneObject {
 public:
  virtual ~SceneObject() = default;

  /// Returns the name in the scene; it is unique there.
  [[nodiscard]] virtual const std::string& name() const noexcept = 0;

  /// Allocates all memory that answer() needs. Throws Error(input) when the memory or the rate is not possible.
  virtual void prepare(const SceneTiming& timing) { (void)timing; }

  /// Clears contacts and their history. Called at the start of a session, and after a gap in it.
  virtual void reset() noexcept {}

  /// Returns the force for the coming tick. An object with memory (a proxy, a deformation, a moving body) advances by
  /// touch.dt. A touch that is not valid() gives no contact and leaves the memory unchanged.
  [[nodiscard]] virtual Contact answer(const Touch& touch) noexcept = 0;

  /// Returns whether any part of the object is inside `space`; true if the object does not know.
  [[nodiscard]] virtual bool meets(const Box& space) const noexcept {
    (void)space;
    return true;
  }

  /// Returns the accuracy settings, for haptrace tradeoff.
  [[nodiscard]] virtual std::vector<Knob> knobs() const = 0;

  /// Sets an accuracy setting. Throws Error(input) naming the object, the setting and its range.
  virtual void set(const std::string& knob, double level) = 0;
};

/// Returns the error of set() for a setting that `object` does not have, with the nearest known name.
Error unknown_knob(const SceneObject& object, const std::string& knob);

}  // namespace haptrace
