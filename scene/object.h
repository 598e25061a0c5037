// Something the hand can touch.
#pragma once

#include "base/error.h"
#include "base/types.h"
#include "control/path/path.h"

#include <string>
#include <vector>

namespace haptrace {

/// Where the tool is when an object is asked.
struct Touch {
  Vec3 position = Vec3::Zero();  ///< of the tool's tip, p_WT [m]
  Vec3 velocity = Vec3::Zero();  ///< in W [m/s]
  double dt = 0;                 ///< since the object was asked last [s]; 0 at the first time and after a reset

  /// Whether there is an answer to it: numbers, and none so large that its square is none.
  [[nodiscard]] bool valid() const noexcept {
    return (position.array().abs() < kFarthest).all() && (velocity.array().abs() < kFarthest).all();
  }
  static constexpr double kFarthest = 1e9;  ///< [m], [m/s]
};

/// What an object answers: its force on the hand, and what whoever predicts or supervises that force has to know. An
/// object that is not touched, or knows nothing near the tool, answers with the default.
struct Contact {
  Vec3 force = Vec3::Zero();   ///< on the hand, in W [N]
  Vec3 place = Vec3::Zero();   ///< of the tool for which this holds, p_WT: where it is, or ahead of it [m]
  Vec3 normal = Vec3::Zero();  ///< of the surface nearest to it, unit, out of the object; zero when it knows none
  double depth = 0;  ///< inside the object along the normal [m]; where a normal is known outside, minus the distance
  double stiffness = 0;  ///< -d force / d depth along the normal, here [N/m]
  double damping = 0;    ///< the same by the speed of penetration, and only against it [N s/m]
  double stored = 0;     ///< energy that its springs hold and could give back [J]

  [[nodiscard]] bool touched() const noexcept { return depth > 0; }
};

/// A choice that buys speed with exactness, or exactness with speed.
struct Knob {
  std::string name;            ///< a key of the object in a scene file
  std::string unit;            ///< SI; empty for a number
  std::vector<double> levels;  ///< worth trying, from the fastest to the most exact
  double level = 0;            ///< in force
};

/// What an object is prepared for.
struct SceneTiming {
  double rate_hz = 1000;  ///< at which it will be asked
};

/// One object of a scene. It is built from what the scene names and knows nothing of the others: a scene without it
/// computes nothing of it.
///
/// Order of calls: set() any number of times, prepare() once before each session, then reset() and answer().
/// Real-time: reset and answer allocate nothing, lock nothing, throw nothing, do no I/O. Threads: one at a time.
class SceneObject {
 public:
  virtual ~SceneObject() = default;

  /// As the scene calls it, unique there.
  [[nodiscard]] virtual const std::string& name() const noexcept = 0;

  /// Takes all the memory that answer() is going to need. Throws Error(input) when that, or the rate, cannot be had.
  virtual void prepare(const SceneTiming& timing) { (void)timing; }

  /// Forgets what the hand did: no contact, no history of one. At the start of a session, and after a gap in it.
  virtual void reset() noexcept {}

  /// The force for the coming tick. An object that remembers (a proxy, a deformation, a body that moves) goes on by
  /// touch.dt; a touch that is not valid() is no contact and leaves its memory as it was.
  [[nodiscard]] virtual Contact answer(const Touch& touch) noexcept = 0;

  /// Whether any of it lies in `space`; true when it does not know.
  [[nodiscard]] virtual bool meets(const Box& space) const noexcept {
    (void)space;
    return true;
  }

  /// Its choices between speed and exactness, for haptrace tradeoff.
  [[nodiscard]] virtual std::vector<Knob> knobs() const = 0;

  /// Turns a knob. Throws Error(input) naming the object, the knob and its range.
  virtual void set(const std::string& knob, double level) = 0;
};

/// What set() throws for a knob that `object` does not have, with the nearest that it has.
Error unknown_knob(const SceneObject& object, const std::string& knob);

}  // namespace haptrace
