// Everything that the hand can touch, at once.
#pragma once

#include "scene/object.h"

#include <memory>
#include <span>
#include <string>
#include <vector>

namespace haptrace {

/// What a scene answers.
struct SceneAnswer {
  Vec3 force = Vec3::Zero();          ///< sum of all objects', on the hand, in W [N]
  double stored = 0;                  ///< sum of all objects' [J]
  std::span<const Contact> contacts;  ///< one per object, in the scene's order; valid until the next answer
};

/// What a session touches, at every tick: a scene, or something in front of one.
///
/// Real-time: reset and answer. Threads: one at a time.
class Touchable {
 public:
  virtual ~Touchable() = default;

  /// Forgets what the hand did.
  virtual void reset() noexcept = 0;
  [[nodiscard]] virtual SceneAnswer answer(const Touch& touch) noexcept = 0;

  /// As for Controller: after every tick, outside of it; may wait only where time stands still meanwhile.
  virtual void between_ticks(bool may_wait) noexcept { (void)may_wait; }

  /// What a person should know of the session that it was in, once that is over.
  [[nodiscard]] virtual std::vector<std::string> remarks() const { return {}; }
};

/// Objects that know nothing of each other; their forces add up. Costs what they cost.
///
/// Order of calls: as for an object.
class Scene final : public Touchable {
 public:
  /// Throws Error(input) when there is no object, or two have one name.
  explicit Scene(std::vector<std::unique_ptr<SceneObject>> objects, bool passivity = false);

  /// Prepares every object. Throws as they do, and Error(input) when the rate is not from 0.1 to 1e6 Hz.
  void prepare(const SceneTiming& timing);
  void reset() noexcept override;
  [[nodiscard]] SceneAnswer answer(const Touch& touch) noexcept override;

  [[nodiscard]] std::size_t size() const noexcept { return objects_.size(); }
  [[nodiscard]] const SceneObject& object(std::size_t index) const { return *objects_.at(index); }
  [[nodiscard]] std::vector<std::string> names() const;
  /// Names of the objects of which nothing lies in `workspace`.
  [[nodiscard]] std::vector<std::string> out_of(const Box& workspace) const;

  /// Whether a passivity layer is to supervise the sum.
  [[nodiscard]] bool passivity() const noexcept { return passivity_; }

  /// Those of all objects, as "object.knob".
  [[nodiscard]] std::vector<Knob> knobs() const;
  /// Throws Error(input) naming the knob, with the nearest.
  void set(const std::string& knob, double level);

 private:
  std::vector<std::unique_ptr<SceneObject>> objects_;
  std::vector<Contact> contacts_;
  bool passivity_;
};

}  // namespace haptrace
