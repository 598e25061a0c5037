// All objects that the hand can touch.
#pragma once

#include "scene/object.h"

#include <memory>
#include <span>
#include <string>
#include <vector>

namespace haptrace {

/// The answer of a scene.
struct SceneAnswer {
  Vec3 force = Vec3::Zero();          ///< sum over all objects, on the hand, in W [N]
  double stored = 0;                  ///< sum over all objects [J]
  std::span<const Contact> contacts;  ///< one per object, in the scene's order; valid until the next answer
};

/// Interface between a session and a scene. A session queries it at every tick. It is a scene, or a wrapper of one.
///
/// Real-time: reset and answer. Threads: one at a time.
class Touchable {
 public:
  virtual ~Touchable() = default;

  /// Clears contacts and their history.
  virtual void reset() noexcept = 0;
  [[nodiscard]] virtual SceneAnswer answer(const Touch& touch) noexcept = 0;

  /// Runs after every tick, outside of it, as in Controller. It may wait only on a virtual clock, which stands still
  /// meanwhile.
  virtual void between_ticks(bool may_wait) noexcept { (void)may_wait; }

  /// Returns notes for the user about the past session.
  [[nodiscard]] virtual std::vector<std::string> remarks() const { return {}; }
};

/// A set of independent objects; their forces add up. The cost is the sum of theirs.
///
/// Order of calls: as for an object.
class Scene final : public Touchable {
 public:
  /// Throws Error(input) when there is no object, or when two have the same name.
  explicit Scene(std::vector<std::unique_ptr<SceneObject>> objects, bool passivity = false);

  /// Prepares every object. Throws their errors, and Error(input) when the rate is not from 0.1 to 1e6 Hz.
  void prepare(const SceneTiming& timing);
  void reset() noexcept override;
  [[nodiscard]] SceneAnswer answer(const Touch& touch) noexcept override;

  [[nodiscard]] std::size_t size() const noexcept { return objects_.size(); }
  [[nodiscard]] const SceneObject& object(std::size_t index) const { return *objects_.at(index); }
  [[nodiscard]] std::vector<std::string> names() const;
  /// Returns the names of the objects that lie outside `workspace`.
  [[nodiscard]] std::vector<std::string> out_of(const Box& workspace) const;

  /// Returns whether a passivity layer supervises the sum.
  [[nodiscard]] bool passivity() const noexcept { return passivity_; }

  /// Returns the accuracy settings of all objects, as "object.setting".
  [[nodiscard]] std::vector<Knob> knobs() const;
  /// Sets an accuracy setting. Throws Error(input) naming the setting, with the nearest known name.
  void set(const std::string& knob, double level);

 private:
  std::vector<std::unique_ptr<SceneObject>> objects_;
  std::vector<Contact> contacts_;
  bool passivity_;
};

}  // namespace haptrace
